"""Time left: it counts down between what the server says, and never says what nobody knows."""

import re

import pytest

pytestmark = pytest.mark.slow  # in a browser; the time that is left: tests/job/test_time_left.py

JOB = {"id": "j-1", "kind": "head", "project": "ben", "name": "ben", "version": None,
       "export": None, "state": "running", "place": 0, "progress": 0.5, "left": 0, "notes": [],
       "error": None, "result": None}


def stage(name, state, left, seconds=0.0):
    return {"name": name, "title": name, "state": state, "progress": None, "note": "",
            "seconds": seconds, "left": left, "picture": None}


@pytest.fixture(scope="module")
def page(opened_here):
    """The page, for all that is computed of a job that is handed over, and kept nowhere."""
    return opened_here


def words(page, job, *moments, again=()):
    """What is said of the first stage and of the job, at moments in seconds after an event."""
    return page.run("""async ([job, moments, again]) => {
      const { heardJob, heardStage, leftOfJob, leftOfStage } = await import("/static/times.js");
      heardJob(job, null, 0);
      for (const [moment, left] of again) {
        job.stages[0].left = left;
        heardStage(job.stages[0], job.stages[0], 1000 * moment);
      }
      return moments.map((moment) =>
        [leftOfStage(job.stages[0], 1000 * moment), leftOfJob(job, 1000 * moment)]);
    }""", [job, moments, again])


def test_a_stage_counts_down_and_says_when_it_is_late(page):
    job = {**JOB, "stages": [stage("capture", "running", 20), stage("surface", "waiting", 10)]}
    assert words(page, job, 0, 8, 17, 29, 31) == [
        ["about 20 s left", "about 30 s left"], ["about 12 s left", "about 22 s left"],
        ["a few seconds left", "about 13 s left"], ["a few seconds left", "about 10 s left"],
        ["takes longer than usual", "takes longer than usual"]]


def test_what_is_late_stays_late_while_nothing_is_known_to_be_left(page):
    job = {**JOB, "stages": [stage("capture", "running", 5)]}
    # The server says again and again that nothing is left.
    again = [[6, 0], [9, 0], [14, 0]]
    assert words(page, job, 14, 16, again=again)[1][0] == "takes longer than usual"
    # Once it knows better, that counts.
    assert words(page, job, 16, again=[*again, [15, 40]]) == [["about 39 s left"] * 2]


def test_a_long_stage_is_late_later(page):
    job = {**JOB, "stages": [stage("reconstruct", "running", 0, seconds=600)]}
    assert [said[0] for said in words(page, job, 60, 160)] == [
        "a few seconds left", "takes longer than usual"]


def test_what_is_late_says_how_much_the_others_take_at_least(page):
    job = {**JOB, "stages": [stage("capture", "running", 0), stage("reconstruct", "waiting", 240)]}
    assert words(page, job, 20) == [["takes longer than usual", "more than 4 min left"]]


def test_nothing_is_said_where_nobody_knows(page):
    job = {**JOB, "stages": [stage("capture", "running", None), stage("surface", "waiting", 9)]}
    assert words(page, job, 3) == [["…", ""]]


def heard(opened, job):
    opened.run("""async (job) => {
      const { keepJob } = await import("/static/state.js");
      keepJob(job);
    }""", job)


def seconds(place):
    """The number of seconds that is said there."""
    return int(re.search(r"(\d+) s left", place.inner_text())[1])


def test_the_screen_counts_without_a_word_from_the_server(opened):
    opened.go("making/ben")
    heard(opened, {**JOB, "stages": [stage("capture", "running", 40)]})
    said = opened.page.locator(".phase .when")
    total = opened.page.locator(".stage-list .tight .soft")
    opened.page.wait_for_selector(".phase .when:has-text('s left')")
    first = seconds(said)
    assert 25 < first <= 40
    opened.eventually(lambda: 25 < seconds(said) < first)
    assert 20 < seconds(total) < first


@pytest.mark.parametrize("screen", ["making", "style"])
def test_a_job_that_waits_says_so_and_no_share(opened, screen):
    opened.go(f"{screen}/ben")
    heard(opened, {**JOB, "state": "waiting", "place": 1, "progress": 0,
                   "stages": [stage("capture", "waiting", 40)]})
    opened.until("""() => document.querySelector("[data-step=making] .state").textContent ===
      "waiting" """)
    if screen == "making":
        opened.page.wait_for_selector(".stage-list:has-text('waiting · number 2 in the queue')")
        shown = opened.page.inner_text(".stage-list")
        assert "waiting · number 2 in the queue" in shown and "%" not in shown
        assert not opened.page.is_visible(".stage-list progress")


def test_the_photos_that_were_looked_at_are_counted(opened):
    opened.page.route("**/api/projects/ben/photos", lambda route: route.fulfill(json={
        "photos": [{"id": "a", "name": "a.jpg", "size": 1, "left_out": False, "video": False,
                    "grade": "none", "reasons": [], "picture": None}],
        "checked": False, "checking": {"job": "j-1", "done": 0, "total": 64}, "advice": [],
        "arc": {"gaps": [], "reach": None, "yaws": [], "placed": False}, "looked": 0, "faces": 0}))
    opened.go("photos/ben")
    opened.run("""async () => {
      const { tell } = await import("/static/state.js");
      tell("progress", { job: "j-1", progress: 0.25 });
    }""")
    opened.page.wait_for_selector("#main >> text=16 of 64")
