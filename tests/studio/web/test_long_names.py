"""Names of eighty letters in one word: sitters, photos, paintings, versions, panels, files."""

import io
from contextlib import suppress

import pytest

from lfportrait.files import write_json
from tests.studio.web.conftest import Opened, Studio, face, picture

pytestmark = pytest.mark.slow  # in a browser; names in requests: tests/studio/test_guard.py

LONG = ("Donaudampfschiffahrtselektrizitaetenhauptbetriebswerkbauunterbeamtengesellschaft"
        "mitbeschraenkterhaftung")[:80]
SCREENS = ("sitters", "photos", "making", "style", "portrait", "show", "show/files")
OUTSIDE = """() => {
  const cut = (element) => {
    for (let each = element.parentElement; each; each = each.parentElement)
      if (getComputedStyle(each).overflowX !== "visible") return true;
    return false;
  };
  return [...document.querySelectorAll("body *")].filter((element) => {
    const { left, right, width } = element.getBoundingClientRect();
    return width > 0 && (left < -1 || right > innerWidth + 1)
      && !element.closest(".unseen, .skip") && !cut(element);
  }).map((element) => `${element.tagName} ${element.className} ${element.textContent}`);
}"""


@pytest.fixture(scope="module")
def long_names(tmp_path_factory):
    from lfportrait.face import write_landmarks
    from lfportrait.field import save_field
    from tests.share.page.portraits import painted_head

    folder = tmp_path_factory.mktemp("long") / "mine"
    sitter = folder / LONG
    for name in ("photos", "paintings", "portrait", "exports", ".studio/exports"):
        (sitter / name).mkdir(parents=True)
    save_field(painted_head(32), sitter / "portrait" / "field.npz")
    for number in range(3):
        picture(number).save(sitter / "photos" / f"{LONG}{number}.jpg")
    picture(9, 300).save(sitter / "paintings" / f"{LONG}.png")
    write_landmarks(sitter / "paintings" / f"{LONG}.landmarks.txt", face())
    picture(5, 40).save(sitter / "exports" / f"{LONG}.png")
    write_json(sitter / ".studio" / "exports" / "one.json",
               {"file": f"{LONG}.png", "kind": "coded", "fine": False})
    running = Studio(folder)
    yield running
    running.stop()


@pytest.fixture(scope="module")
def sitter(browser, long_names):
    """The sitter's id and the painting's; a version and a panel are made."""
    with Opened(browser, long_names) as each:
        sitter = each.ask("GET", "/api/projects")["projects"][0]["id"]
        style = next(one["id"] for one in
                     each.ask("GET", f"/api/styles?project={sitter}")["styles"]
                     if one["kind"] == "project")
        for name in (LONG, f"{LONG[:-1]}2"):
            each.ask("POST", f"/api/projects/{sitter}/versions", {"name": name, "style": style})
        panel = each.ask("POST", "/api/displays", {"name": LONG, "copy": "generic-4k"})["id"]
        each.ask("PATCH", f"/api/projects/{sitter}", {"display": panel, "style": style})
        return sitter, style


WIDTHS = 1280, 768, 390


def fits(each, what, whole=False):
    """Nothing leaves the window, however wide it is; the ``whole`` page is no wider, either."""
    def beyond():
        wide = each.run("() => document.documentElement.scrollWidth")
        return each.run(OUTSIDE), wide if whole and wide > width else 0

    for width in WIDTHS:
        each.page.set_viewport_size({"width": width, "height": 800})
        each.run("() => new Promise(requestAnimationFrame)")
        # What is drawn for the window's size may follow later.
        with suppress(AssertionError):
            each.eventually(lambda: beyond() == ([], 0), seconds=20)
        assert beyond() == ([], 0), (what, width)


def test_no_name_leaves_the_window(browser, long_names, sitter):
    sitter, style = sitter
    with Opened(browser, long_names, width=WIDTHS[-1]) as each:
        for screen in SCREENS:
            name, _, rest = screen.partition("/")
            if screen != "sitters":
                each.go("/".join([name, sitter, rest]).rstrip("/"))
            if screen == "show/files":
                each.page.wait_for_selector(".files .card")
            if screen == "show":  # of a head without photos the eye sees nothing, and says whose
                each.page.wait_for_selector(f".eye p:has-text('{LONG}')")
            fits(each, screen, whole=True)
        # What is refused is named, too.
        each.go(f"photos/{sitter}")
        buffer = io.BytesIO()
        picture(3).save(buffer, "PNG")
        each.page.set_input_files("#photo-files", [
            {"name": f"{LONG}.cr2", "mimeType": "image/x", "buffer": buffer.getvalue()}])
        each.page.wait_for_selector(".note.bad")
        fits(each, "a file that is refused")
        for editor in ("landmarks", "regions"):
            each.go(f"style/{sitter}/{style}/{editor}")
            fits(each, editor)
        each.go(f"portrait/{sitter}")
        # What can't be shown of this head lies over it: nothing is pressed by hand.
        each.run("() => document.querySelector('header button[aria-pressed]').click()")
        each.page.wait_for_selector(".stages-pair.two")
        fits(each, "two side by side")
        each.run("() => document.querySelector('.version-tools button').click()")
        each.page.wait_for_selector("dialog[open]")
        fits(each, "a dialog")


def test_a_name_that_is_cut_off_is_in_its_title(browser, long_names, sitter):
    with Opened(browser, long_names, width=390) as each:
        each.go(f"portrait/{sitter[0]}")
        for place in (".who strong", ".version strong"):
            shown = each.page.locator(place).first
            assert shown.get_attribute("title") == LONG
            assert shown.bounding_box()["height"] < 90
