"""What a batch tells: the table, JSON lines, the index."""

import io
import json
import shutil
from html.parser import HTMLParser
from urllib.parse import unquote

from rich.console import Console

from lfportrait.job.batch import BatchTable, JsonLines
from lfportrait.job.batch.journal import duration, read_events


def test_durations():
    assert [duration(seconds) for seconds in (4.2, 200, 7500)] == ["4 s", "3 min 20 s", "2 h 5 min"]


def test_the_table_counts_down(either):
    table = BatchTable(io.StringIO())
    left = []
    for event in either[2]:
        table(event)
        if event["event"] != "end":
            left.append(table.seconds_left())
    assert left[0] > left[len(left) // 2] > left[-1] == 0
    text = io.StringIO()
    Console(file=text, width=100).print(table._table())
    many = either[1]["ran"]["stylize"]
    row = next(line for line in text.getvalue().splitlines() if "stylize" in line)
    assert f"{many} of {many}" in row


def test_failures_are_told_at_once():
    stream = io.StringIO()
    table = BatchTable(stream)
    table({"event": "plan", "slots": 1, "stages": {"field": {
        "tasks": 1, "to_do": 1, "core_seconds": 3}}})
    table({"event": "failed", "task": "anna/field", "stage": "field", "why": "no [light]"})
    assert "failed: anna/field: no [light]" in stream.getvalue()
    assert table.seconds_left() == 0


def test_events_are_lines_of_json_and_kept(small):
    stream = io.StringIO()
    lines = JsonLines(stream)
    for event in small[2]:
        lines(event)
    assert [json.loads(line) for line in stream.getvalue().splitlines()] == small[2]
    assert read_events(small[0]) == small[2]
    done = [event for event in small[2] if event["event"] == "done"]
    assert all(event["cpu_seconds"] >= 0 and event["peak_memory_bytes"] > 1e7 for event in done)
    assert all(event["bytes"] > 0 for event in done)


def test_a_torn_journal_is_read_as_far_as_it_goes(small, tmp_path):
    copy = shutil.copytree(small[0], tmp_path / "results")
    with open(copy / ".batch" / "journal.jsonl", "a") as stream:
        stream.write('{"event": "plan", "time": 1}\n{"event": "started", "ta')
    assert [event["event"] for event in read_events(copy)] == ["plan"]


class Page(HTMLParser):
    """Addresses on a page."""

    def __init__(self):
        super().__init__()
        self.addresses = []

    def handle_starttag(self, tag, attributes):
        self.addresses += [value for name, value in attributes if name in ("href", "src")]


def test_the_index_shows_all_and_leads_somewhere(either):
    folder, figures, _ = either
    page = Page()
    page.feed((folder / "index.html").read_text())
    # A page is linked twice.
    assert len(page.addresses) == len({*page.addresses}) + figures["ran"]["page"]
    for address in page.addresses:
        assert (folder / unquote(address)).is_file(), address
    wanted = {"anna/ken/portrait.html", "anna/ken/desk.png", "anna/photo.jpg"}
    if figures["ran"]["page"] > 1:
        wanted |= {"bert/chalk/wall.png", "bert/photo.jpg"}
    assert wanted <= {*page.addresses}
