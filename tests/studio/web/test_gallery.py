"""The gallery before there is a head and after; what is chosen; files dropped and pasted."""

import io

import pytest

from tests.studio.web.conftest import picture

pytestmark = pytest.mark.slow  # in a browser; paintings by requests: tests/studio/test_uploads.py


def png(seed):
    buffer = io.BytesIO()
    picture(seed, 200).save(buffer, "PNG")
    return list(buffer.getvalue())


def give(opened, how, target, name, data, kind="image/png"):
    """Drop a file on the middle of an element, or paste it."""
    opened.run("""([how, target, name, data, kind]) => {
      const transfer = new DataTransfer();
      transfer.items.add(new File([new Uint8Array(data)], name, { type: kind }));
      const element = document.querySelector(target);
      const send = (type, Kind, more) => element.dispatchEvent(
        new Kind(type, { bubbles: true, cancelable: true, ...more }));
      if (how === "paste") return send("paste", ClipboardEvent, { clipboardData: transfer });
      for (const type of how === "hold" ? ["dragenter", "dragover"]
                                        : ["dragenter", "dragover", "drop"])
        send(type, DragEvent, { dataTransfer: transfer });
    }""", [how, target, name, data, kind])


def own(opened):
    """The sitter's own painting that a face is known in."""
    styles = opened.ask("GET", "/api/styles?project=ben")["styles"]
    return next(one["id"] for one in styles if one["name"] == "ken")


def test_without_a_head_paintings_are_shown_alone_and_large(opened):
    opened.go(f"style/ben/{own(opened)}")
    opened.until("""() => {
      const image = document.querySelector(".both img");
      return image?.complete && image.naturalWidth === 400;
    }""")
    assert opened.page.locator(".on-sitter, .both .blank").count() == 0
    assert opened.page.locator(".both img").bounding_box()["width"] > 300
    assert "not made yet" in opened.page.inner_text("#main .note.fair")
    # Once there is one, without a reload, the sitter stands beside each. (What the studio says of
    # the sitter meanwhile, that there is none, may come after it.)
    opened.until("""async () => {
      const { keepProject, project } = await import("/static/state.js");
      const ben = project("ben");
      if (!ben.has.field) keepProject({ ...ben, has: { ...ben.has, field: true } });
      return document.querySelectorAll(".on-sitter").length > 0;
    }""")
    opened.until("() => document.querySelectorAll('.both figure').length === 2")
    assert "not made yet" not in opened.page.inner_text("#main")


def test_the_editors_show_the_painting_at_once_and_say_when_a_preview_comes(opened):
    # Its face is found once, which takes a busy machine its time.
    opened.ask("GET", f"/api/styles/{own(opened)}/landmarks?project=ben")
    waiting, free = [], []
    opened.page.route("**/landmarks?*",
                      lambda route: route.continue_() if free else waiting.append(route))
    opened.run("(name) => { location.hash = name; }", f"style/ben/{own(opened)}/landmarks")
    opened.until("() => document.querySelector('.reading img')?.naturalWidth > 0")
    assert "its face found" in opened.page.inner_text(".reading [role=status]")
    free.append(True)
    for route in waiting:
        route.continue_()
    opened.page.wait_for_selector(".mark")
    assert "comes when the head is made" in opened.page.inner_text(".preview")
    assert opened.page.locator(".viewport").bounding_box()["width"] > 800
    opened.page.locator(".mark[data-number='30']").focus()
    opened.page.keyboard.press("ArrowLeft")
    opened.page.wait_for_selector("header [role=status]:text('Saved')")


def test_the_chosen_painting_stays_chosen(opened):
    """When its screen is left, and when the page is read again."""
    for again in (False, True):
        opened.go("style/ben")
        cards = opened.page.locator(".paintings [data-style]")
        chosen = "[data-style]:has([aria-pressed=true])"
        first = opened.page.get_attribute(chosen, "data-style")
        other = next(name for name in cards.evaluate_all("all => all.map(a => a.dataset.style)")
                     if name != first)
        opened.page.click(f"[data-style='{other}'] button")
        opened.go("making/ben")
        if again:
            opened.until("""async (id) => {
              const { projects } = await (await fetch("/api/projects")).json();
              return projects.find((each) => each.id === "ben").style === id;
            }""", other)
            opened.reload()
        opened.go("style/ben")
        assert opened.page.get_attribute(chosen, "data-style") == other


def test_a_painting_is_dropped_anywhere_or_pasted_and_is_chosen(opened):
    pressed = ".paintings [aria-pressed=true] .name"
    for how, target in (("drop", "#main h1"), ("drop", "#main"), ("paste", "body")):
        opened.go("style/ben")
        name = f"{how}{len(target)}"
        give(opened, how, target, f"{name}.png", png(50 + len(target)))
        kept = "pasted" if how == "paste" else name
        opened.page.wait_for_selector(f"{pressed}:text-matches('^{kept}')")
        chosen = opened.page.inner_text(pressed)
        opened.go("making/ben")
        opened.go("style/ben")
        assert opened.page.inner_text(pressed) == chosen


def test_photos_are_dropped_anywhere_or_pasted(opened):
    opened.go("photos/ben")
    give(opened, "hold", "#main .lead", "x.png", png(1))
    shown = "() => getComputedStyle(document.getElementById('main')).outlineStyle"
    assert opened.run(shown) == "dashed"
    words = opened.run("() => getComputedStyle(main, '::after').content")
    assert "the photos are added" in words
    give(opened, "drop", "#main .lead", "drop-there.png", png(81))
    opened.page.wait_for_selector(".shot-card .name:text('drop-there')")
    assert opened.run(shown) == "none"
    give(opened, "paste", "body", "paste-there.png", png(74))
    opened.page.wait_for_selector(".shot-card .name:text('paste-there')")


def test_a_text_that_is_dragged_or_pasted_is_no_file(opened):
    opened.go("photos/ben")
    before = opened.page.locator(".shot-card").count()
    opened.run("""() => {
      const transfer = new DataTransfer();
      transfer.setData("text/plain", "words");
      const main = document.getElementById("main");
      for (const type of ["dragenter", "dragover", "drop"])
        main.dispatchEvent(new DragEvent(type,
          { bubbles: true, cancelable: true, dataTransfer: transfer }));
      document.body.dispatchEvent(new ClipboardEvent("paste",
        { bubbles: true, cancelable: true, clipboardData: transfer }));
    }""")
    assert not opened.run("() => document.getElementById('main').classList.contains('over')")
    assert opened.page.locator(".shot-card").count() == before
    assert opened.page.locator(".toast").all_inner_texts() == []
