"""Events of a batch: sent to watchers, and kept in the results' folder.

The same objects are the lines of ``--json-lines``, the rows of the table and the lines of
``.batch/journal.jsonl``, from which ``lfportrait batch status`` reads what runs and what failed.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from filelock import Timeout

from ...errors import UserError
from ...files import lock
from ...temporary import sweep_below

__all__ = ["FOLDER", "Event", "Journal", "Watcher", "is_running", "locked",
           "locked_file", "read_events"]

FOLDER = ".batch"
"""Folder in the results for the batch's own files."""

Event = dict[str, Any]
Watcher = Callable[[Event], None]


class Journal:
    """Sends events to watchers and keeps them in a file.

    Parameters
    ----------
    results
        Folder of all results.
    watchers
        Called with each event.
    """

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
def locked_file(path: Path) -> Iterator[None]:
    """A block that one process of a machine is in at a time; others wait."""
    held = lock(path, wait=-1)
    try:
        yield
    finally:
        held.release()


@contextmanager
def locked(results: Path) -> Iterator[None]:
    """The results' folder for one batch at a time; the lock goes with the process.

    Raises
    ------
    UserError
        If another batch writes there, or the folder can't be written to.
    """
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
