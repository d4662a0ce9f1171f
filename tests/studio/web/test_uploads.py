"""Photos on their way: four at a time, by their hash, over broken lines, the damaged ones named."""

import pytest

from tests.studio.web.conftest import picture

pytestmark = pytest.mark.slow  # in a browser; by requests alone: tests/studio/test_uploads.py


@pytest.fixture
def sitter(opened):
    """A new sitter's photo screen."""
    opened.id = opened.sitter("cleo")
    opened.go(f"photos/{opened.id}")
    yield opened
    # What has come is looked at by itself, in a job that may begin at any moment: one that works
    # holds the project.
    opened.until("""async (id) => {
      const { send } = await import("/static/api.js");
      try {
        await send("DELETE", `/api/projects/${id}`, { confirm: "cleo" });
      } catch (error) {
        if (error.code === "busy") return false;
        throw error;
      }
      return true;
    }""", opened.id)


def write(folder, count, first=10):
    paths = [folder / f"photo {number}.png" for number in range(count)]
    for number, path in enumerate(paths):
        picture(first + number).save(path)
    return paths


def cards(opened):
    return opened.run("() => document.querySelectorAll('.shot-card').length")


def choose(opened, paths):
    opened.page.set_input_files("#photo-files", paths)


def test_photos_come_in_are_shown_and_stay(sitter, tmp_path):
    paths = write(tmp_path, 9)
    choose(sitter, paths)
    sitter.page.wait_for_selector("text=9 files added, 0 were here already.", timeout=60000)
    sitter.until("() => document.querySelectorAll('.shot-card').length === 9")
    names = {path.name for path in (sitter.studio.folder / "cleo" / "photos").iterdir()}
    assert len(names) == 9
    for path in paths:  # what came is what was sent
        assert any((sitter.studio.folder / "cleo" / "photos" / name).read_bytes()
                   == path.read_bytes() for name in names)
    sitter.reload()
    assert cards(sitter) == 9
    # The same folder again: nothing is sent.
    sent = [url for url in sitter.requests if "/uploads/" in url]
    choose(sitter, paths)
    sitter.page.wait_for_selector("text=0 files added, 9 were here already.")
    assert [url for url in sitter.requests if "/uploads/" in url] == sent


def test_at_most_four_are_on_their_way_at_once(sitter, tmp_path):
    sitter.run("""() => {
      const send = XMLHttpRequest.prototype.send;
      window.going = window.most = 0;
      const late = Date.now() + 5000;
      XMLHttpRequest.prototype.send = function (body) {
        window.most = Math.max(window.most, ++window.going);
        this.addEventListener("loadend", () => { window.going--; });
        // A busy machine is slow to begin the others: none ends before.
        const wait = () => (window.most < 4 && Date.now() < late)
          ? setTimeout(wait, 10) : setTimeout(() => send.call(this, body), 30);
        wait();
      };
    }""")
    choose(sitter, write(tmp_path, 12))
    sitter.page.wait_for_selector("text=12 files added", timeout=60000)
    assert sitter.run("() => window.most") == 4


def test_a_broken_line_is_tried_again(sitter, tmp_path):
    broken = []

    def breaks(route):
        if len(broken) < 2:
            broken.append(route.request.url)
            route.abort("connectionreset")
        else:
            route.continue_()

    sitter.page.route("**/uploads/*", breaks)
    choose(sitter, write(tmp_path, 3))
    sitter.page.wait_for_selector("text=3 files added", timeout=60000)
    assert len(broken) == 2


def test_what_is_no_photo_is_named(sitter, tmp_path):
    good = write(tmp_path, 1)
    note = tmp_path / "notes.txt"
    note.write_text("not a photo")
    choose(sitter, [*good, note])
    sitter.page.wait_for_selector("text=1 file was not taken")
    assert sitter.page.inner_text(".note.bad").count("notes.txt") == 1
    assert sitter.page.inner_text(".card").startswith("1 file added")


def test_a_photo_may_be_called_anything(sitter, tmp_path):
    names = ['Who? "Me", <b> | a*b.png', "\N{WOMAN}\N{ZERO WIDTH JOINER}\N{ARTIST PALETTE}.png",
             f"{'long ' * 49}.png"]
    for number, name in enumerate(names):
        picture(80 + number).save(tmp_path / name)
    choose(sitter, [tmp_path / name for name in names])
    sitter.page.wait_for_selector("text=3 files added", timeout=60000)
    kept = sorted(path.name for path in (sitter.studio.folder / "cleo" / "photos").iterdir())
    assert kept[0] == 'Who- -Me-, -b- - a-b.png' and kept[1].startswith("long long")
    assert kept[2] == "\N{WOMAN}-\N{ARTIST PALETTE}.png"


def test_a_folder_is_dropped_with_what_lies_in_it(sitter, tmp_path):
    """A drop as the page sees it; folders themselves can't be dropped by a test."""
    write(tmp_path, 2)
    data = [list((tmp_path / f"photo {number}.png").read_bytes()) for number in range(2)]
    sitter.run("""(data) => {
      const transfer = new DataTransfer();
      data.forEach((bytes, number) => transfer.items.add(
        new File([new Uint8Array(bytes)], `dropped ${number}.png`, { type: "image/png" })));
      transfer.items.add(new File(["x"], ".DS_Store"));
      document.querySelector(".drop").dispatchEvent(
        new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
    }""", data)
    sitter.page.wait_for_selector("text=2 files added", timeout=60000)
    sitter.until("() => document.querySelectorAll('.shot-card').length === 2")
    assert "dropped 0.png" in sitter.page.inner_text(".sheet")


def test_a_photo_is_left_out_and_taken_in_again(sitter, tmp_path):
    choose(sitter, write(tmp_path, 2))
    sitter.wait("text=2 files added")
    sitter.until("() => document.querySelectorAll('.shot-card').length === 2")
    first = ".shot-card:first-child button"
    sitter.page.click(first)
    sitter.wait(f"{first}[aria-pressed=true]")
    assert len(list((sitter.studio.folder / "cleo" / "left-out").iterdir())) == 1
    sitter.until("(s) => document.activeElement === document.querySelector(s)", first)
    sitter.page.click(first)
    sitter.wait(f"{first}[aria-pressed=false]")
    assert len(list((sitter.studio.folder / "cleo" / "left-out").iterdir())) == 0


def test_a_button_that_is_drawn_again_while_it_is_pressed_is_pressed(sitter, tmp_path):
    """Each photo that comes draws the sheet again, whatever a hand does at that moment."""
    one, other = write(tmp_path, 2)
    choose(sitter, [one])
    first = ".shot-card:first-child button"
    sitter.wait(first)
    sitter.page.hover(first)
    sitter.page.mouse.down()
    sitter.run("(s) => { document.querySelector(s).old = true; }", first)
    choose(sitter, [other])
    sitter.until("(s) => document.querySelectorAll('.shot-card').length === 2 "
                 "&& !document.querySelector(s).old", first)
    sitter.page.mouse.up()
    sitter.wait(".shot-card button[aria-pressed=true]")


def test_an_answer_that_is_late_does_not_draw_what_was_before(sitter, tmp_path):
    choose(sitter, write(tmp_path, 1))
    sitter.wait(".shot-card")
    held = []

    def hold(route):  # the next question's answer, until the one after it has come
        held.append((route, route.fetch()))

    sitter.page.route("**/photos", hold, times=1)
    tell = """async () => {
      const { tell } = await import("/static/state.js");
      tell("photos", { project: location.hash.split("/")[1] });
    }"""
    sitter.run(tell)
    sitter.eventually(lambda: bool(held))
    choose(sitter, write(tmp_path, 2))
    sitter.until("() => document.querySelectorAll('.shot-card').length === 2")
    sitter.eventually(lambda: len(sitter.open) == 2)  # the one that is held, and the events
    route, answer = held[0]
    route.fulfill(response=answer)
    sitter.page.wait_for_timeout(200)
    assert cards(sitter) == 2
