"""The server as a process: its address, its events, and how all of it ends."""

from __future__ import annotations

import asyncio
import http.client
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lfportrait.studio.answers import Events

from .conftest import jpeg, run_apart
from .test_jobs import gone, pids

SERVER = """
import sys
from pathlib import Path
from lfportrait.studio.jobs import Jobs
from lfportrait.studio.app import run
Jobs.ENTRY = "tests.studio.slow_work:serve"
def ready(address):
    heavy = {"numba", "torch", "scipy", "cv2", "av", "pycolmap", "mediapipe"} & set(sys.modules)
    print("imported:", *sorted(heavy), flush=True)
run(Path(sys.argv[1]), browse=False, ready=ready)
print("ended", flush=True)
"""


class Server:
    """A server in a process of its own, and a page."""

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVER, str(folder)], stdout=subprocess.PIPE, text=True,
            cwd=Path(__file__).resolve().parents[2], start_new_session=True)
        assert self.process.stdout is not None
        found = re.match(r"http://127\.0\.0\.1:(\d+)/#token=(\S+)",
                         self.process.stdout.readline())
        assert found is not None
        self.port, self.token = int(found[1]), found[2]
        self.imported = self.process.stdout.readline()
        self.cookie = ""
        answer = self.ask("POST", "/api/session", {"token": self.token})
        self.cookie = answer.headers["set-cookie"].partition(";")[0]

    def ask(self, method: str, path: str, data=None, **headers: str) -> http.client.HTTPResponse:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        body = None if method == "GET" else json.dumps(data or {})
        connection.request(method, path, body, {
            "Origin": f"http://127.0.0.1:{self.port}", "X-Lfportrait": "1", "Cookie": self.cookie,
            **({} if body is None else {"Content-Type": "application/json"}), **headers})
        return connection.getresponse()

    def head(self, name: str, folder: Path) -> tuple[str, Path]:
        """A sitter whose head is made as long as a file is there; the job and the folder."""
        project = json.loads(self.ask("POST", "/api/projects", {"name": name}).read())["id"]
        place = folder / name
        for number in range(3):
            (place / "photos" / f"{number}.jpg").write_bytes(jpeg(number))
        (place / "wait").touch()
        job = json.loads(self.ask("POST", "/api/jobs", {"kind": "head", "project": project}).read())
        return job["id"], place

    def events(self, until: str, **headers: str) -> list[tuple[int | None, str, dict]]:
        """Lines of the stream up to a kind of event."""
        answer = self.ask("GET", "/api/events", **headers)
        assert answer.status == 200
        assert answer.headers["content-type"].startswith("text/event-stream")
        found, number, kind = [], None, ""
        while line := answer.readline().decode().rstrip("\n"):
            while line:
                word, _, rest = line.partition(": ")
                if word == "id":
                    number = int(rest)
                elif word == "event":
                    kind = rest
                elif word == "data":
                    found.append((number, kind, json.loads(rest)))
                line = answer.readline().decode().rstrip("\n")
            if kind == until:
                answer.close()
                return found
            number = None
        raise AssertionError("the stream ended")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "portraits"


@pytest.fixture
def server(folder):
    found = Server(folder)
    yield found
    found.process.kill()
    found.process.wait()
    found.process.stdout.close()


def test_nothing_slow_is_imported_and_the_end_is_clean(server):
    assert server.imported.strip() == "imported:"
    server.process.send_signal(signal.SIGINT)
    assert server.process.stdout.read() == "ended\n"
    assert server.process.wait(60) == 0


@pytest.mark.parametrize(("number", "paused"), [
    (signal.SIGTERM, True), *(pytest.param(number, paused, marks=pytest.mark.slow) for
                              number, paused in ((signal.SIGINT, False), (signal.SIGKILL, False),
                                                 (signal.SIGKILL, True)))])
def test_all_processes_end_with_the_server(server, folder, number, paused):
    if paused and sys.platform != "linux":
        pytest.skip("paused processes end with their server on Linux only")
    job, place = server.head("Anna", folder)
    numbers = pids(place)
    if paused:
        assert server.ask("POST", f"/api/jobs/{job}/pause").status == 200
    stream = server.ask("GET", "/api/events")  # a page that listens does not hold it up
    server.process.send_signal(number)
    server.process.wait(60)
    assert gone(*numbers), numbers
    stream.close()
    (place / "wait").unlink()
    again = Server(folder)
    try:
        until = time.monotonic() + 60
        state = ""
        while state != "done" and time.monotonic() < until:
            state = json.loads(again.ask("GET", f"/api/jobs/{job}").read())["state"]
            time.sleep(0.05)
        assert state == "done", "the next run goes on"
    finally:
        again.process.kill()
        again.process.wait()
        again.process.stdout.close()


def test_a_page_that_comes_back_gets_what_it_missed(server, folder):
    job, place = server.head("Anna", folder)
    first = server.events("progress")
    assert first[0][1] == "hello" and first[-1][0] is None
    assert first[-1][2]["job"] == job
    seen = first[0][2]["event"]
    (place / "wait").unlink()
    rest = server.events("project", **{"Last-Event-ID": "0"})
    numbers = [number for number, _, _ in rest if number is not None]
    assert numbers == list(range(1, len(numbers) + 1)), "every line, in order"
    after = server.events("job", **{"Last-Event-ID": str(seen)})
    assert next(number for number, _, _ in after if number is not None) == seen + 1
    assert server.events("reset", **{"Last-Event-ID": "99999"})[-1][1] == "reset"
    assert server.events("hello", **{"Last-Event-ID": "evil"})[0][1] == "hello"


def test_lines_are_replayed_once_and_old_ones_are_forgotten():
    events = Events()
    for count in range(5):
        events.tell("job", {"count": count})
    events.tell("progress", {}, numbered=False)
    assert [json.loads(line.partition("data: ")[2])["count"] for line in events.after(2)] == [2, 3,
                                                                                           4]
    assert events.after(5) == [] and events.after(None) == []
    for count in range(1000):
        events.tell("job", {"count": count})
    assert "event: reset" in events.after(4)[0] and "event: reset" in events.after(2000)[0]
    assert len(events.after(5)) == 1000


def test_a_page_that_does_not_read_costs_nothing():
    async def run():
        events = Events()
        stream = events.stream(None)
        assert (await anext(stream)).startswith("event: hello")
        for count in range(5000):
            events.tell("job", {"count": count})
        for _ in range(10):
            await asyncio.sleep(0)
        assert len(events._kept) == 1000 and not events._pages, "it is let go"
        with pytest.raises(StopAsyncIteration):
            while True:
                await asyncio.wait_for(anext(stream), 5)

    run_apart(run())


@pytest.mark.slow  # many requests
def test_hours_of_idling_do_not_grow(server):
    """What each request leaves behind: files, threads, memory."""
    def state():
        base = Path(f"/proc/{server.process.pid}")
        text = (base / "status").read_text()
        values = {name: int(re.search(rf"{name}:\s+(\d+)", text)[1])
                  for name in ("VmRSS", "Threads")}
        return values["VmRSS"], values["Threads"], len(os.listdir(base / "fd"))

    if not Path("/proc/self/status").exists():
        pytest.skip("this system has no /proc")
    paths = ("/api/state", "/api/projects", "/api/jobs", "/", "/api/displays")

    def rounds(count):
        for _ in range(count):
            for path in paths:
                server.ask("GET", path).read()
            server.events("hello")

    rounds(20)
    memory, threads, files = state()
    rounds(40)
    # The server hears a moment later that the last ones have gone.
    until = time.monotonic() + 20
    while (after := state())[2] > files + 2 and time.monotonic() < until:
        time.sleep(0.05)
    assert after[0] - memory < 3000 and after[1] <= threads + 2 and after[2] <= files + 2
