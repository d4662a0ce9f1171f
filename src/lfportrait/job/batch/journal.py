"""Events of a batch: sent to watchers, kept in the results' folder, and shown.

The same objects are the lines of ``--json-lines``, the rows of the table in the terminal and the
lines of ``.batch/journal.jsonl``, from which ``lfportrait batch status`` reads what runs and what
failed.
"""

import json
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, TextIO

from filelock import Timeout
from rich.console import Console
from rich.live import Live
from rich.table import Table

from ...cache import finished_record
from ...errors import UserError
from ...files import lock, read_json
from ...runner import Costs, Need
from ...temporary import sweep_below
from ..graph import STAGES

FOLDER = ".batch"  # Folder in the results for the batch's own files.

Event = dict[str, Any]
Watcher = Callable[[Event], None]


class Journal:
    """Sends events to watchers and keeps them in a file in the folder of all results."""

    def __init__(self, results: Path, watchers: list[Watcher]) -> None:
        self._watchers = watchers
        self._stream: IO[str] | None = None
        with suppress(OSError):
            self._stream = (results / FOLDER / "journal.jsonl").open("a", encoding="utf-8")

    def tell(self, event: str, **facts: Any) -> None:
        """An event, with the time in seconds since 1970."""
        entry: Event = {"event": event, "time": round(time.time(), 3), **facts}
        for watcher in self._watchers:
            watcher(entry)
        # A full disk must not end a batch that can still report what it could not write.
        with suppress(OSError, ValueError):
            if self._stream is not None:
                self._stream.write(json.dumps(entry) + "\n")
                self._stream.flush()

    def close(self) -> None:
        """Close the file."""
        with suppress(OSError):
            if self._stream is not None:
                self._stream.close()


def read_events(results: Path) -> list[Event]:
    """The events of the last run in a folder; lines that were torn by a crash are left out."""
    try:
        lines = (results / FOLDER / "journal.jsonl").read_text("utf-8", "replace").splitlines()
    except OSError:
        return []
    events: list[Event] = []
    for line in lines:
        with suppress(ValueError, RecursionError):
            entry = json.loads(line)
            if isinstance(entry, dict):
                events = [entry] if entry.get("event") == "plan" else [*events, entry]
    return events


@contextmanager
def locked(results: Path) -> Iterator[None]:
    """The results' folder for one batch at a time; the lock goes with the process."""
    try:
        (results / FOLDER).mkdir(parents=True, exist_ok=True)
        held = lock(results / FOLDER / "lock")
    except Timeout as error:
        raise UserError(f"another batch is writing to {results}; wait for it, or choose "
                        "another folder with --out") from error
    except OSError as error:
        raise UserError(f"can't write to {results}: {error.strerror}; choose another folder with "
                        "--out") from error
    try:
        sweep_below(results)  # of tasks that were killed with an earlier batch
        yield
    finally:
        held.release()


def is_running(results: Path) -> bool:
    """Whether a batch is writing to a folder."""
    path = results / FOLDER / "lock"
    if not path.is_file() or not os.access(path, os.W_OK):
        return False
    try:
        lock(path).release()
    except OSError:
        return True
    return False


_EVERY = 10.0  # Seconds between lines where there is no terminal.
_SHOWN = 40  # Tasks of the graph that a dry run shows at most.


def duration(seconds: float) -> str:
    """Time in words: ``4 s``, ``3 min 20 s``, ``2 h 5 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


class JsonLines:
    """Events as JSON, one a line."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stdout

    def __call__(self, event: Event) -> None:
        """Write an event."""
        self._stream.write(json.dumps(event) + "\n")
        self._stream.flush()


class BatchTable:
    """A table of the stages that is redrawn: done, running, failed, time left.

    Where there is no terminal, a line every ten seconds and one for each failure.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._console = Console(file=stream or sys.stderr)
        self._live: Live | None = None
        self._stages: dict[str, dict[str, Any]] = {}
        self._slots = 1
        self._running: dict[str, str] = {}
        self._done: Counter[str] = Counter()
        self._failed: Counter[str] = Counter()
        self._costs = Costs()
        self._last = time.monotonic()

    def __call__(self, event: Event) -> None:
        """Take an event in."""
        kind, stage, task = event["event"], event.get("stage", ""), event.get("task", "")
        if kind == "plan":
            self._stages, self._slots = event["stages"], max(1, event["slots"])
            self._costs = Costs({name: Need(row["core_seconds"] / max(1, row["to_do"]))
                                 for name, row in self._stages.items()})
            if self._console.is_terminal:
                self._live = Live(console=self._console, get_renderable=self._table,
                                  refresh_per_second=4)
                self._live.start()
        elif kind == "started":
            self._running[task] = stage
        elif kind in ("done", "failed"):
            self._running.pop(task, None)
            (self._done if kind == "done" else self._failed)[stage] += 1
            if kind == "done":
                self._costs.learn(stage, Need.of(event))
            else:
                self._console.print(f"failed: {task}: {event['why']}", markup=False,
                                    highlight=False)
        elif kind == "end":
            self.close()
        if self._live is None and (time.monotonic() - self._last > _EVERY):
            self._last = time.monotonic()
            self._console.print(self._line(), markup=False, highlight=False)

    def close(self) -> None:
        """Leave the table as it is now."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _left(self, stage: str) -> int:
        row = self._stages[stage]
        return max(0, int(row["to_do"]) - self._done[stage] - self._failed[stage])

    def seconds_left(self) -> float:
        """Time left, from what tasks took and how many run at once."""
        total = sum(self._left(stage) * self._costs.need(stage).seconds for stage in self._stages)
        return total / self._slots

    def _line(self) -> str:
        done, failed = sum(self._done.values()), sum(self._failed.values())
        every = sum(int(row["to_do"]) for row in self._stages.values())
        return (f"{done} of {every} tasks done, {len(self._running)} running, {failed} failed, "
                f"about {duration(self.seconds_left())} left")

    def _table(self) -> Table:
        table = Table("stage", "done", "running", "failed", "left",
                      caption=f"{self._line()}", title=", ".join(sorted(self._running)[:4]))
        running = Counter(self._running.values())
        for stage, row in self._stages.items():
            before = int(row["tasks"]) - int(row["to_do"])
            left = duration(self._left(stage) * self._costs.need(stage).seconds / self._slots)
            table.add_row(stage, f"{before + self._done[stage]} of {row['tasks']}",
                          str(running[stage] or ""), str(self._failed[stage] or ""), left)
        return table


def _bytes(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"


def dry_table(figures: dict[str, Any], slots: int) -> str:
    """Summary of a batch (`dry_figures`) before it runs on ``slots`` cores: graph and needs."""
    lines = [f"{figures['sitters']} sitters, {figures['styles']} styles, "
             f"{figures['displays']} displays: {figures['tasks']} tasks, "
             f"{figures['to_do']} to do"]
    for entry in figures["graph"][:_SHOWN]:
        mark = "  " if entry["to_do"] else "ok"
        lines.append(f"  {mark} {entry['task']:<40} {', '.join(entry['needs'])}")
    if len(figures["graph"]) > _SHOWN:
        lines.append(f"     ... and {len(figures['graph']) - _SHOWN} more (all with --json FILE)")
    lines.append("stage      to do   core time      memory each   disk")
    for stage, row in figures["stages"].items():
        lines.append(f"{stage:<9}{row['to_do']:>7}   {duration(row['core_seconds']):<14} "
                     f"{_bytes(row['memory_bytes']):<13} {_bytes(row['disk_bytes'])}")
    lines.append(f"about {duration(figures['core_seconds'] / slots)} on {slots} cores, "
                 f"{_bytes(figures['disk_bytes'])} on the disk, where "
                 f"{_bytes(figures['free_disk_bytes'])} are free")
    lines += [f"can't be used: {name}: {why}" for name, why in figures["refused"].items()]
    return "\n".join(lines)


def batch_status(results: Path) -> tuple[str, dict[str, Any]]:
    """Progress of a batch, read from its folder, while it runs or later: text, and ``--json``."""
    path = results / FOLDER / "plan.json"
    if not path.is_file():
        raise UserError(f"there is no batch in {results}; give the folder that --out named")
    plan, running = read_json(path), is_running(results)
    failed: dict[str, str] = dict(plan["refused"])
    started: set[str] = set()
    for event in read_events(results):
        if event["event"] == "started":
            started.add(event["task"])
        elif event["event"] in ("done", "failed"):
            started.discard(event["task"])
            if event["event"] == "failed":
                failed[event["task"]] = event["why"]
    stages: dict[str, Counter[str]] = {stage: Counter() for stage in STAGES}
    for task in plan["tasks"]:
        found = finished_record(results / task["folder"], task["record"], task["key"],
                                task["outputs"])
        state = ("done" if found is not None else "failed" if task["name"] in failed
                 else "running" if running and task["name"] in started else "waiting")
        stages[task["stage"]][state] += 1
    figures = {"running": running, "failed": failed,
               "stages": {stage: dict(count) for stage, count in stages.items() if count}}
    lines = ["a batch is running" if running else "no batch is running"]
    for stage, count in stages.items():
        if count:
            lines.append(f"{stage:<9} " + ", ".join(f"{count[state]} {state}" for state in
                                                    ("done", "running", "failed", "waiting")
                                                    if count[state]))
    lines += [f"failed: {name}: {why}" for name, why in failed.items()]
    return "\n".join(lines), figures
