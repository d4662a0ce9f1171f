"""The page in a real browser: from the first screen to the answer file, and all kinds of slips."""

import json
from collections import Counter
from contextlib import contextmanager

import pytest

from lfportrait.cli import main
from lfportrait.files import read_json
from lfportrait_eval.study import StudyConfig, write_study
from tests.share.page.browser import CONTEXTS, SMALL

pytestmark = pytest.mark.slow  # in a browser; what it shows: test_entries.py, test_results.py

READY = 'html[data-ready="yes"]'
SIZE = {"viewport": {"width": 900, "height": 700}}


class Visit:
    """A person's browser with the study in it."""

    def __init__(self, browser, study, person=None):
        self.context = CONTEXTS.take(browser, **SIZE)
        self.address = (study / "index.html").resolve().as_uri() + (
            "" if person is None else f"?person={person}")
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page = self.open()

    def open(self):
        page = self.context.new_page()
        page.set_default_timeout(60000)
        page.on("console", lambda message: self.complaints.append(message.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))
        page.goto(self.address)
        return page

    def start(self):
        self.page.check("#consent")
        self.page.click("#start")
        self.page.wait_for_selector(READY)

    def press(self, key="ArrowLeft"):
        """Answer when the page is ready for it; its next screen."""
        before = self.answered()
        self.page.keyboard.press(key)
        assert self.answered() == before + 1
        self.next()

    def next(self):
        """Wait until the page takes the next answer, or says thanks."""
        self.page.wait_for_selector(f"{READY}, #done:not([hidden])", state="attached")

    def state(self):
        return self.page.evaluate("() => lfstudy.session.state")

    def answered(self):
        return self.page.evaluate("() => lfstudy.session.state.place")

    def finish(self, keys=("ArrowLeft", "2")):
        """Answer all that is left; the downloaded file."""
        left = self.page.evaluate("() => lfstudy.session.steps") - self.answered()
        for number in range(left - 1):
            self.press(keys[number % len(keys)])
        with self.page.expect_download() as download:
            self.press(keys[0])
        return download.value


@contextmanager
def visit(browser, study, person=None):
    opened = Visit(browser, study, person)
    yield opened
    CONTEXTS.give(opened.context, SMALL.as_uri(), **SIZE)


def test_from_the_start_to_the_results(browser, short, tmp_path):
    design = read_json(short / "study.json")
    with visit(browser, short) as each:
        page = each.page
        assert page.title() == "Portraits side by side"
        assert page.is_disabled("#start") and not page.is_visible("#message")
        assert "4 pairs" in page.inner_text("#amount") and "12 answers" in page.inner_text(
            "#amount")
        each.start()
        assert page.inner_text("#question") == design["questions"][0]["text"]
        assert page.inner_text("#count") == "Pair 1 of 4"
        each.press("ArrowLeft")
        each.press("ArrowRight")
        each.press("1")
        assert page.inner_text("#count") == "Pair 2 of 4"
        page.click('[data-side="right"] .choice')
        each.next()
        # A reload in the middle goes on where it was, in the same order.
        before, person = each.state()["answers"], each.state()["person"]
        order = page.evaluate("() => lfstudy.session.trials")
        page.reload()
        page.wait_for_selector(READY)
        assert each.state()["answers"] == before and each.answered() == 4
        assert each.state()["person"] == person
        assert page.evaluate("() => lfstudy.session.trials") == order
        assert page.inner_text("#question") == design["questions"][1]["text"]
        download = each.finish()
        assert download.suggested_filename == f"answers-{design['study']}-{person}.json"
        download.save_as(tmp_path / "answers.json")
        assert page.is_visible("#done") and not page.is_visible("#trial")
        assert each.complaints == []
        assert {url for url in each.requests if not url.startswith("blob:")} == {each.address}
    data = json.loads((tmp_path / "answers.json").read_text())
    assert [list(trial["choices"].values()) for trial in data["trials"][:2]] == [
        ["left", "right", "left"], ["right", "left", "right"]]
    assert set(data) == {"format", "study", "title", "person", "sheet", "questions", "trials"}
    assert all(0 <= time < 60 for trial in data["trials"] for time in trial["seconds"].values())
    shown = {(trial["pair"], trial["left"], trial["right"]) for trial in data["trials"]}
    sheet = {(pair, *(design["entries"][entry]["method"]
                      for entry in design["pairs"][pair][::-1 if swapped else 1]))
             for pair, swapped in design["sheets"][data["sheet"]]}
    again = data["trials"][-1]
    assert again["repeat"] and shown == sheet | {(again["pair"], again["left"], again["right"])}
    assert (again["pair"], again["right"], again["left"]) in sheet
    assert main(["study", "results", str(tmp_path / "answers.json"), "--study", str(short),
                 "--out", str(tmp_path / "out")]) == 0
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["people"] == 1 and results["left_out"] == []
    assert results["left"][0]["total"] == 4


def test_double_clicks_and_held_keys_count_once(browser, study):
    with visit(browser, study) as each:
        page = each.page
        each.start()
        page.dblclick('[data-side="left"] .choice')
        each.next()
        assert each.answered() == 1
        # A slow one: its second click comes when the next question is there already.
        box = page.locator('[data-side="left"] .choice').bounding_box()
        page.mouse.move(box["x"] + 9, box["y"] + 9)
        page.mouse.down(click_count=1)
        page.mouse.up(click_count=1)
        each.next()
        page.mouse.down(click_count=2)
        page.mouse.up(click_count=2)
        page.wait_for_timeout(400)
        assert each.answered() == 2
        page.keyboard.down("ArrowRight")
        for _ in range(8):
            page.wait_for_timeout(120)
            page.keyboard.down("ArrowRight")
        page.keyboard.up("ArrowRight")
        each.next()
        assert each.answered() == 3
        # Hammered: at once, as presses one by one may take longer than the page's pause.
        page.evaluate("""() => {
          for (let n = 0; n < 5; n++) {
            document.body.dispatchEvent(
              new KeyboardEvent("keydown", { key: "ArrowLeft", bubbles: true, cancelable: true }));
          }
        }""")
        each.next()
        assert each.answered() == 4
        page.keyboard.press("Control+1")
        page.keyboard.press("a")
        assert each.answered() == 4


def test_going_back_and_pausing(browser, single):
    with visit(browser, single) as each:
        page = each.page
        each.start()
        assert page.is_disabled("#back")
        each.press("1")
        page.click("#back")
        page.wait_for_selector(READY)
        assert each.answered() == 0 and page.is_disabled("#back")
        each.press("2")
        assert [side for side, _ in each.state()["answers"]] == ["right"]
        page.click("#pause")
        assert page.get_attribute("#pause", "aria-pressed") == "true"
        playing = "() => [...document.querySelectorAll('video')].map((video) => !video.paused)"
        assert page.evaluate(playing) == [False, False]
        page.click("#pause")
        page.wait_for_function(f"() => String(({playing})()) === 'true,true'")
        each.finish()
        page.click("#change")
        page.wait_for_selector(READY)
        assert each.answered() == 2
        with page.expect_download():
            each.press("2")


def test_both_portraits_turn_together(browser, study):
    with visit(browser, study) as each:
        each.start()
        each.page.evaluate("() => { document.querySelectorAll('video')[1].currentTime += 0.9; }")
        apart = """() => {
          const [left, right] = document.querySelectorAll("video");
          const apart = Math.abs(left.currentTime - right.currentTime);
          return !left.paused && !right.paused && left.currentTime > 0
            && Math.min(apart, left.duration - apart) < 0.12;
        }"""
        each.page.wait_for_function(apart, timeout=60000)
        assert each.page.evaluate("() => [...document.querySelectorAll('video')].every("
                                  "(video) => video.muted && video.loop)")


def test_another_person_at_the_same_screen(browser, single):
    with visit(browser, single) as each:
        each.start()
        first = each.state()["person"]
        with each.finish().path().open() as stream:
            assert json.load(stream)["person"] == first
        each.page.reload()  # thanks stay, and nothing is downloaded again
        each.page.wait_for_selector("#done", state="visible")
        assert each.state()["saved"]
        with each.page.expect_download() as download:
            each.page.click("#save")
        assert first in download.value.suggested_filename
        each.page.once("dialog", lambda dialog: dialog.accept())
        each.page.click("#another")
        each.page.wait_for_selector("#welcome", state="visible")
        assert each.page.is_disabled("#start")
        assert each.state()["person"] != first and each.answered() == 0


def test_two_windows_show_the_same(browser, study):
    with visit(browser, study, person=3) as each:
        each.start()
        other = each.open()
        other.wait_for_selector(READY)
        first = other.inner_text("#question")
        other.keyboard.press("1")
        # The next question is shown after a pause, and in the other window a moment later.
        for page in (other, each.page):
            page.wait_for_function("""(first) => lfstudy.session.state.place === 1
              && document.querySelector("#question").innerText !== first""", arg=first)
        assert each.page.inner_text("#question") == other.inner_text("#question")


def test_numbered_people_and_addresses_that_name_none(browser, study):
    with visit(browser, study, person=1) as one, visit(browser, study, person="x") as wrong:
        one.start()
        assert one.state()["person"] == "1" and one.state()["number"] == 1
        assert "no number" in wrong.page.inner_text("#message")
        assert not wrong.page.is_visible("#welcome")


def test_order_and_repeats_are_spread_over_people(browser, study, design):
    script = "() => [...Array(400).keys()].map((number) => lfstudy.trialsOf(lfstudy.study, number))"
    with visit(browser, study) as each:
        assert each.page.title() == "Whose is <b>better</b> </script>?"
        people = each.page.evaluate(script)
        assert people[7] == each.page.evaluate("() => lfstudy.trialsOf(lfstudy.study, 7)")
    first = Counter(trials[0]["pair"] for trials in people)
    again = Counter(trials[-1]["pair"] for trials in people)
    lefts = Counter((trial["pair"], trial["swapped"]) for trials in people
                    for trial in trials[:-1])
    assert set(lefts.values()) == {200}
    for counts in (first, again):  # 33 of each of 12 pairs are expected, give or take 6
        assert len(counts) == 12 and 12 < min(counts.values()) <= max(counts.values()) < 58
    for trials in people:
        assert [trial["repeat"] for trial in trials] == [False] * 12 + [True]
        place = [trial["pair"] for trial in trials].index(trials[-1]["pair"])
        assert place < 6 and trials[place]["swapped"] != trials[-1]["swapped"]


def test_videos_beside_the_page(browser, videos, tmp_path):
    write_study([str(video) for video in videos[:2]], tmp_path / "out",
                StudyConfig(max_embedded=0, questions="paper", repeats=0))
    with visit(browser, tmp_path / "out") as each:
        each.start()
        assert each.page.is_visible("#photo") and each.complaints == []
        assert any("/media/video" in url for url in each.requests)
        each.finish()
    for path in (tmp_path / "out" / "media").iterdir():
        path.unlink()
    with visit(browser, tmp_path / "out") as each:
        each.page.check("#consent")
        each.page.click("#start")
        each.page.wait_for_selector("#message:not([hidden])")
        assert "can't be played" in each.page.inner_text("#message")
        each.page.keyboard.press("1")
        assert each.answered() == 0


def test_a_page_that_was_cut_off_says_so(browser, study, tmp_path):
    whole = (study / "index.html").read_bytes()
    (tmp_path / "index.html").write_bytes(whole[:len(whole) // 2])
    context = browser.new_context()
    page = context.new_page()
    page.set_default_timeout(60000)
    page.goto((tmp_path / "index.html").as_uri())
    assert "incomplete" in page.inner_text("#message")
    context.close()


def test_everything_has_a_name_and_a_keyboard_reaches_it(browser, study):
    with visit(browser, study) as each:
        page = each.page
        page.keyboard.press("Tab")
        page.keyboard.press("Space")
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        page.wait_for_selector(READY)
        assert page.evaluate("() => document.activeElement.id") == "question"
        for button in page.query_selector_all("button, video, progress, img"):
            assert (button.get_attribute("aria-label") or button.get_attribute("alt")
                    or button.inner_text())
        reached = set()
        for _ in range(5):
            page.keyboard.press("Tab")
            reached.add(page.evaluate("() => document.activeElement.innerText.trim()"))
        assert {"← Left", "Right →", "Pause"} <= reached


def test_what_was_kept_and_is_damaged_is_begun_anew(browser, study, design):
    with visit(browser, study) as each:
        for kept in ("{", '{"person": 3}', "null",
                     '{"person": "a", "number": 1, "place": 9, "answers": []}'):
            each.page.evaluate("([key, text]) => localStorage.setItem(key, text)",
                               [f"lfportrait-study-{design['study']}", kept])
            each.page.reload()
            assert each.page.is_visible("#welcome") and each.answered() == 0, kept
