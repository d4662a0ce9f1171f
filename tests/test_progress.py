"""Progress lines: now and then, and at once where another step begins."""

import io
from types import SimpleNamespace

import pytest

from lfportrait.progress import Progress


@pytest.fixture(autouse=True)
def no_time(monkeypatch):
    """Between two notes no time passes, however slow this machine is."""
    monkeypatch.setattr("lfportrait.progress.time", SimpleNamespace(perf_counter=lambda: 5.0))


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
