"""All screens for everybody: names, roles, contrast, keys alone, small windows, no other host."""

from pathlib import Path

import pytest

from tests.studio.web.conftest import SCREENS, Opened

axe = pytest.importorskip("axe_playwright_python")
AXE = Path(axe.__file__).with_name("axe.min.js")


def faults(opened, **options):
    """What axe finds, a line each: the rules of WCAG 2.2 A and AA, and good practice."""
    opened.until("""() => [...document.images].every(
        (each) => each.complete || each.loading === "lazy")
      && document.getAnimations().every((each) => each.playState === "finished")""")
    if not opened.run("() => Boolean(window.axe)"):
        opened.run(AXE.read_text("utf-8"))
    found = opened.run("""async (options) => {
      const { violations } = await axe.run(document, { iframes: false, ...options });
      return violations.flatMap(({ id, nodes }) => nodes.map(
        ({ html, failureSummary }) => `${id}: ${html} ${failureSummary}`));
    }""", options)
    return found


@pytest.mark.slow  # in a browser; below one test opens the studio
def test_axe_finds_nothing_in_the_editors_and_dialogs(opened):
    own = next(style["id"] for style in opened.ask("GET", "/api/styles?project=ben")["styles"]
               if style["kind"] == "project")
    opened.go(f"style/ben/{own}/landmarks")
    opened.page.locator(".mark[data-number='30']").focus()
    assert faults(opened) == []
    opened.go("sitters")
    opened.page.click("text=New sitter")
    assert faults(opened) == []
    opened.page.keyboard.press("Escape")
    opened.go("show/anna")
    opened.page.click("text=Pattern wizard")
    opened.page.wait_for_selector(".wizard form")
    assert faults(opened) == []


SCREENS_OF = ("sitters", *(f"{screen}/{sitter}" for screen in SCREENS[1:]
                           for sitter in ("anna", "ben")), "show/anna/files")
LOOKS = [(1280, "light"), (390, "dark"), (1280, "dark"), (390, "light")]
"""A wide window and a narrow one, in both schemes."""


@pytest.mark.slow  # in a browser
def test_axe_finds_nothing_on_any_screen(opened):
    """Half of the screens wide and light, narrow and dark; the others the other way round."""
    for number, hash_ in enumerate(SCREENS_OF):
        opened.go(hash_)
        if hash_.endswith("files"):
            opened.page.wait_for_selector(".kind-card")
        for width, scheme in LOOKS[number % 2 * 2:][:2]:
            opened.page.set_viewport_size({"width": width, "height": 800})
            opened.page.emulate_media(color_scheme=scheme)
            assert faults(opened) == [], (hash_, width, scheme)


@pytest.mark.slow  # in a browser
def test_no_screen_is_wider_than_its_window(browser, studio):
    """In German, whose words are longer; `test_long_names` looks at the English page."""
    with Opened(browser, studio, locale="de") as each:
        for hash_ in ("sitters", *(f"{screen}/anna" for screen in SCREENS[1:]),
                      "show/anna/files"):
            each.go(hash_)
            for width in (1280, 768, 320):
                each.page.set_viewport_size({"width": width, "height": 800})
                each.run("() => new Promise(requestAnimationFrame)")
                wide = each.run("() => document.documentElement.scrollWidth")
                assert wide <= width, (hash_, width)
                narrow = each.run("""() => [...document.querySelectorAll("h1, h2, p.lead")]
                  .map((each) => [each.textContent, each.getBoundingClientRect().width])
                  .filter(([text, width]) => width > 0 && text.length > 8 && width < 60)""")
                assert narrow == [], (hash_, width)


@pytest.mark.slow  # in a browser; by requests: tests/studio
def test_a_sitter_is_made_and_removed_by_keys_alone(opened):
    opened.reload()  # nothing has the focus yet
    keyboard = opened.page.keyboard

    def reach(name):
        """Tab until a button of that name has the focus, which is seen."""
        for _ in range(60):
            keyboard.press("Tab")
            focused = opened.run("""() => [document.activeElement.getAttribute("aria-label")
              ?? document.activeElement.textContent.trim(),
              getComputedStyle(document.activeElement).outlineStyle]""")
            if focused[0] == name:
                assert focused[1] != "none", name
                return
        raise AssertionError(f"{name} can't be reached")

    keyboard.press("Tab")
    assert opened.run("() => document.activeElement.id") == "skip"
    keyboard.press("Enter")
    assert opened.run("() => document.activeElement.id") == "main"
    reach("New sitter")
    keyboard.press("Enter")
    opened.page.wait_for_selector("dialog[open] input")
    keyboard.type("Dora")
    keyboard.press("Enter")
    opened.page.wait_for_selector("[data-screen=photos][data-ready]")
    # The new screen's heading has the focus, so that it is read out.
    opened.until("() => document.activeElement.tagName === 'H1'")
    assert opened.page.title().startswith("Dora · Photos")
    opened.go("sitters")
    reach("Remove Dora")
    keyboard.press("Enter")
    opened.page.wait_for_selector("dialog[open]")
    reach("Remove")
    keyboard.press("Enter")
    opened.page.wait_for_selector(".toast:has-text('Dora')")
    opened.until("() => !document.querySelector('.sitters').innerText.includes('Dora')")
    assert list((opened.studio.folder / ".trash").iterdir())
    reach("Undo")
    keyboard.press("Enter")
    opened.page.wait_for_selector(".sitter:has-text('Dora')")
    opened.until("() => document.activeElement.textContent.includes('Dora')")
    assert not list((opened.studio.folder / ".trash").iterdir())
    dora = next(one["id"] for one in opened.ask("GET", "/api/projects")["projects"]
                if one["name"] == "Dora")
    opened.ask("DELETE", f"/api/projects/{dora}", {"confirm": "Dora"})


def test_nothing_is_asked_of_another_host_and_nothing_complains(opened, studio):
    opened.reload()
    for screen in SCREENS[1:]:
        opened.go(f"{screen}/anna")
    assert {url.split("/")[2] for url in opened.requests if url.startswith("http")} == {
        studio.home.split("/")[2]}
    # 409: a picture was asked for that a newer request took the place of, as on a busy machine.
    # 422: this sitter has no photos, so nothing new can be painted on it.
    assert [text for text in opened.complaints
            if "409 (Conflict)" not in text and "/preview" not in text] == []
    assert "token" not in opened.page.url


@pytest.mark.slow  # in a browser; keys: tests/studio/test_guard.py
def test_a_browser_without_the_key_is_told_what_to_do(opened, studio):
    opened.context.clear_cookies()
    try:
        opened.page.goto(studio.home)
        opened.page.wait_for_selector(".empty")
        assert "Open the address that the terminal printed" in opened.page.inner_text(".empty")
    finally:
        opened.page.goto(studio.address)
        opened.page.wait_for_selector("[data-screen][data-ready]")


@pytest.mark.slow  # in a browser
def test_the_theme_follows_the_system_until_it_is_chosen(opened):
    ground = "() => getComputedStyle(document.body).backgroundColor"
    opened.page.emulate_media(color_scheme="dark")
    dark = opened.run(ground)
    opened.page.click(".rail >> text=Light")
    light = opened.run(ground)
    assert light != dark
    opened.reload()
    assert opened.run(ground) == light
    opened.page.click(".rail >> text=Auto")
    assert opened.run(ground) == dark
