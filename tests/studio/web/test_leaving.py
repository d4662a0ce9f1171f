"""A screen that is left: what it waits for is given up, what it keeps is kept first."""

import re

import pytest

pytestmark = pytest.mark.slow  # in a browser; what is given up: tests/studio/test_previews.py

GIVEN_UP = "net::ERR_ABORTED"
SLOW = {
    "style/anna": "**/preview",
    "portrait/anna": "**/viewer",
    "show/anna": "**/eye",
    "style/ben": "**/check?*",
    "photos/ben": "**/photos",
}


def test_a_request_that_waits_is_given_up(opened):
    begun, failed = [], []
    opened.page.on("requestfailed", lambda request: failed.append((request.url, request.failure)))
    for screen, slow in SLOW.items():
        begun.clear()
        opened.page.route(slow, lambda route: begun.append(route.request.url))
        opened.run("(name) => { location.hash = name; }", screen)
        opened.eventually(lambda: bool(begun))
        opened.go("making/ben")
        opened.eventually(lambda: (begun[0], GIVEN_UP) in failed)
        # Nobody is troubled with it.
        assert opened.page.locator("#alerts .toast").all_inner_texts() == [], screen
        opened.page.unroute(slow)


def test_a_picture_that_waits_is_given_up(opened):
    begun, failed = [], []
    opened.page.route("**/picture?*", lambda route: begun.append(route.request.url))
    opened.page.on("requestfailed", lambda request: failed.append((request.url, request.failure)))
    opened.go("style/ben")
    opened.eventually(lambda: any("builtin" in url for url in begun))
    opened.page.wait_for_timeout(300)
    assert 0 < sum("builtin" in url for url in begun) <= 3, "a few at a time"
    opened.go("making/ben")
    opened.eventually(lambda: {(url, GIVEN_UP) for url in begun} <= set(failed))


def test_a_screen_that_is_left_at_once_is_not_drawn(opened):
    opened.run("""() => {
      location.hash = "show/anna";
      setTimeout(() => { location.hash = "photos/anna"; });
      setTimeout(() => { location.hash = "making/ben"; });
    }""")
    opened.page.wait_for_selector("[data-screen=making][data-ready]")
    opened.page.wait_for_timeout(700)
    assert opened.page.locator("[data-screen]").count() == 1
    assert opened.page.get_attribute("[data-screen]", "data-screen") == "making"


def test_a_change_is_kept_before_the_next_screen_reads_it(opened):
    style = next(one["id"] for one in opened.ask("GET", "/api/styles?project=ben")["styles"]
                 if one["kind"] == "project")
    # Its face is found once, which takes a busy machine its time.
    opened.ask("GET", f"/api/styles/{style}/landmarks?project=ben")
    opened.go(f"style/ben/{style}/landmarks")
    mark = opened.page.locator(".mark[data-number='30']")
    mark.focus()
    opened.page.keyboard.press("Shift+ArrowRight")
    moved = mark.get_attribute("aria-label")
    opened.go("making/ben")
    points = opened.ask("GET", f"/api/styles/{style}/landmarks?project=ben")["points"]
    x = float(re.search(r"x ([\d.]+)", moved)[1])
    assert points[30][0] == pytest.approx(x, abs=0.06)


def test_a_screen_that_can_not_be_shown_says_so_and_is_tried_again(opened):
    opened.page.route("**/api/projects/ben/photos", lambda route: route.fulfill(
        status=500, json={"error": {"code": "internal", "message": "x"}}))
    opened.go("photos/ben")
    assert "went wrong" in opened.page.inner_text("#main")
    opened.page.unroute("**/api/projects/ben/photos")
    opened.page.click("#main >> text=Try again")
    opened.page.wait_for_selector(".drop")


def test_the_editor_of_a_painting_that_is_gone_leads_to_the_gallery(opened):
    for what in ("landmarks", "regions"):
        opened.go(f"style/ben/own-nobody/{what}")
        opened.page.wait_for_selector(".paintings li")
