"""Progress lines: now and then, and at once where another step begins."""

import io
from types import SimpleNamespace

import pytest

from lfportrait.progress import Progress


@pytest.fixture(autouse=True)
def no_time(monkeypatch):
    """Between two notes no time passes, however slow this machine is."""
    monkeypatch.setattr("lfportrait.progress.time", SimpleNamespace(
        perf_counter=lambda: 5.0, process_time=float))


class Terminal(io.StringIO):
    def isatty(self):
        return True


def lines(stream, *notes):
    progress = Progress("stage", stream=stream)
    for number, note in enumerate(notes):
        progress.update(number, note)
    return stream.getvalue()


def test_the_first_note_of_a_step_is_seen_however_soon_it_comes():
    text = lines(Terminal(), *(f"cutting out: {number} of 64" for number in range(64)),
                 "checking whether the head moved", "edges")
    assert "cutting out: 0 of 64" in text and "cutting out: 1 of 64" not in text
    assert "checking whether the head moved" in text and text.rstrip().endswith("edges")


def test_a_file_gets_a_line_every_ten_seconds_whatever_the_step():
    assert lines(io.StringIO(), "first", "second", "third") == ""


def test_the_time_left_is_that_of_the_work_not_of_what_came_before_it(monkeypatch):
    """Twenty seconds of compiling, then a percent a second."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr("lfportrait.progress.time",
                        SimpleNamespace(perf_counter=lambda: clock.now, process_time=float))
    stream = io.StringIO()
    progress = Progress("stage", total=100, stream=stream)
    for done, clock.now in ((0, 12.0), (1, 22.0), (2, 33.0), (50, 71.0), (75, 96.0)):
        progress.update(done)
    written = stream.getvalue().splitlines()
    assert "left" not in written[0] and "left" not in written[1]
    assert "50 s left" in written[3] and "25 s left" in written[4]


def test_the_time_left_of_the_whole_job_is_shown_where_it_is_known():
    heard = []

    class Job:
        def at(self, stage, note, share=None):
            heard.append((stage, note, share))

        def left(self):
            return 99.6

    stream = Terminal()
    progress = Progress("stage", stream=stream, outlook=Job())
    progress.update(0, "pair 3 of 12")
    progress.update(0, "edges")
    assert "stage: 0 s, 100 s left in all  pair 3 of 12" in stream.getvalue()
    assert heard == [("stage", "start", None), ("stage", "pair 3 of 12", 0.25),
                     ("stage", "edges", None)]
    progress.close()
    assert stream.getvalue().rstrip().endswith("stage: 0.0 s")
