"""Tasks that need each other, run in order: what they need and took, and what errors mean.

A `Schedule` has tasks that come and go. It gives each to a `Runner` when those that it needs are
done, and takes in its `Outcome`. `run_tasks` runs those of a `Plan` to their end. `Costs` learns
what a kind of work takes; `failure_of` reads an error for the user.
"""

from __future__ import annotations

import contextlib
import errno
import heapq
import itertools
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from ..cache import finished_record
from ..errors import UserError
from ..files import read_json, write_json


@dataclass(frozen=True)
class Task:
    """A piece of work: files in, files out."""

    name: str  # Its place in the plan; what follows the last ``/`` is the name of its record.
    stage: str  # The kind of work.
    folder: str  # Where it writes, relative to the results.
    outputs: tuple[str, ...]  # What it writes there.
    key: str  # Hash of all that the outputs depend on.
    needs: tuple[str, ...]  # Names of the tasks whose outputs it reads.

    @property
    def record(self) -> str:
        """Name of its record in the folder."""
        return self.name.rpartition("/")[2]


AnyTask = TypeVar("AnyTask", bound=Task)


def finished(task: Task, results: Path) -> dict[str, Any] | None:
    """The figures of a task whose outputs are there, made from the same inputs; else None."""
    return finished_record(results / task.folder, task.record, task.key, task.outputs)


@dataclass
class Plan(Generic[AnyTask]):
    """Tasks, each after those that it needs."""

    tasks: dict[str, AnyTask] = field(default_factory=dict)  # By name.
    refused: dict[str, str] = field(default_factory=dict)  # What can't be begun at all, and why.

    def wanted(self) -> list[AnyTask]:
        """The tasks that nothing else needs: what the user gets."""
        needed = {need for task in self.tasks.values() for need in task.needs}
        return [task for task in self.tasks.values() if task.name not in needed]

    def done(self, results: Path) -> set[str]:
        """Names of the tasks that were done before, from the same inputs."""
        return {name for name, task in self.tasks.items() if finished(task, results) is not None}

    def to_do(self, done: set[str]) -> list[AnyTask]:
        """The tasks that are left, where these are done: what leads to something missing."""
        lacking: set[str] = set()
        left = [task.name for task in self.wanted() if task.name not in done]
        while left:
            name = left.pop()
            if name not in lacking:
                lacking.add(name)
                left += [need for need in self.tasks[name].needs if need not in done]
        return [task for name, task in self.tasks.items() if name in lacking]


_NEWEST = 0.25
"""What the newest work counts in the mean at the least: parameters and machines change."""
_SLACK = 1.2  # Memory of work over the largest that was measured of its kind.


@dataclass(frozen=True)
class Need:
    """Resources of a piece of work."""

    seconds: float  # Time on one core; by the clock where that is what is learnt.
    memory: int = 0  # Peak of its process in bytes.
    disk: int = 0  # Bytes that it writes.

    @classmethod
    def of(cls, cost: Mapping[str, Any]) -> Need:
        """Of a task's ``cost`` (`lfportrait.measure.Cost` and bytes), on one core."""
        return cls(cost["cpu_seconds"], cost["peak_memory_bytes"], cost["bytes"])


class Costs:
    """Means of what each kind of work took, kept in ``file`` if given; else what is ``usual``."""

    def __init__(self, usual: Mapping[str, Need] | None = None, file: Path | None = None) -> None:
        self.usual, self._file = dict(usual or {}), file
        self._known: dict[str, tuple[int, Need]] = {}
        if file is not None:
            with contextlib.suppress(UserError, TypeError, ValueError, AttributeError):
                self._known = {kind: (int(count), Need(float(seconds), int(memory), int(disk)))
                               for kind, (count, seconds, memory, disk) in read_json(file).items()}

    def learn(self, kind: str, took: Need) -> None:
        """Work of a kind is done, and took this."""
        count, mean = self._known.get(kind, (0, took))
        newest = max(1.0 / (count + 1), _NEWEST)
        self._known[kind] = count + 1, Need(
            mean.seconds + newest * (took.seconds - mean.seconds), max(mean.memory, took.memory),
            round(mean.disk + newest * (took.disk - mean.disk)))
        if self._file is not None:
            with contextlib.suppress(UserError):  # a full disk loses an estimate
                write_json(self._file, {one: (times, *astuple(need))
                                        for one, (times, need) in self._known.items()})

    def need(self, kind: str) -> Need:
        """What the next work of a kind takes; of an unknown kind: the mean of all others."""
        if kind in self._known:
            need = self._known[kind][1]
            return Need(need.seconds, int(_SLACK * need.memory), need.disk)
        if kind in self.usual:
            return self.usual[kind]
        every = [need.seconds for _, need in self._known.values()]
        return Need(sum(every) / len(every) if every else 0.0)


_FULL = {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)}
_FORBIDDEN = {errno.EACCES, errno.EPERM, errno.EROFS}


@dataclass(frozen=True)
class Failure:
    """An error, read."""

    # ``user_error``, ``disk_full``, ``memory``, ``killed``: a process was ended from outside, or
    # ``internal``: a fault of ours.
    code: str
    message: str  # One line: what is wrong and what to do.
    trace: str = ""  # Where a fault of ours was; else empty.


def failure_of(error: BaseException) -> Failure:
    """What an error means."""
    line = " ".join(str(error).split())
    if isinstance(error, UserError):
        return Failure("disk_full" if "No space left" in line else "user_error", line)
    if isinstance(error, OSError) and error.errno in _FULL:
        where = f": {error.filename}" if error.filename else ""
        return Failure("disk_full", f"no space is left on a disk{where}; free some, or choose "
                       "folders with more room (--out, and TMPDIR for temporary files)")
    if isinstance(error, OSError) and error.errno in _FORBIDDEN:
        return Failure("user_error", f"can't write {error.filename or 'a file'}: {error.strerror}; "
                       "see that its folder may be written to, then try it once more")
    if isinstance(error, MemoryError):
        return Failure("memory", "the memory is too small: close other programs, let fewer tasks "
                       "of a batch run at once (--workers), or make the field smaller "
                       "(reconstruct.max_voxels)")
    if type(error).__name__ == "OutOfMemoryError":  # torch's, which is not imported for this
        return Failure("memory", "the GPU has too little memory for this: use --device cpu")
    return Failure("internal", f"internal error: {type(error).__name__}: {line}",
                   "".join(traceback.format_exception(error)))


_PATIENCE = 0.5  # Seconds after which it is looked again whether more tasks can run at once.


@dataclass(frozen=True)
class Outcome:
    """How a task ended."""

    task: str  # Its name.
    error: str = ""  # Cause of the failure, on one line; empty if it is done.
    figures: dict[str, Any] = field(default_factory=dict)  # Of the work.
    fault: str = ""  # The traceback of an internal error; empty for errors of the user.
    worker: str = ""  # Machine and process that did it.
    again: bool = False  # Whether it had been done before.
    code: str = ""  # Of the failure (`Failure`); empty if it is done.

    @classmethod
    def failed(cls, task: str, failure: Failure, worker: str = "") -> Outcome:
        """Of a task that ended with an error."""
        return cls(task, failure.message, fault=failure.trace, worker=worker, code=failure.code)


def outcome_of(task: Task, work: Callable[[], dict[str, Any]], worker: str = "") -> Outcome:
    """How a task ends whose work is done by a call, which returns its figures."""
    try:
        return Outcome(task.name, figures=work(), worker=worker)
    except Exception as error:
        return Outcome.failed(task.name, failure_of(error), worker)


Given = TypeVar("Given", bound=Task, contravariant=True)


class Runner(Protocol[Given]):
    """Interface of what runs tasks."""

    slots: int
    """Tasks that run at once."""

    def fits(self, memory: int) -> bool:
        """Whether a task that takes so many bytes can be given out now."""

    def start(self, task: Given, memory: int) -> None:
        """Give out a task whose needs are done."""

    def wait(self, seconds: float) -> list[Outcome]:
        """Outcomes of tasks that have ended, after ``seconds`` at most."""

    def close(self) -> None:
        """End: what still runs is given up."""


class Here(Runner[AnyTask]):
    """Tasks in this process, one after the other, done where they are given out.

    ``work`` does a task, and returns its outcome; what it raises ends the run.
    """

    slots = 1

    def __init__(self, work: Callable[[AnyTask], Outcome]) -> None:
        self._work = work
        self._ended: list[Outcome] = []

    def fits(self, memory: int) -> bool:
        """Whether nothing is left to be taken in."""
        return not self._ended

    def start(self, task: AnyTask, memory: int) -> None:
        """Do a task."""
        self._ended = [self._work(task)]

    def wait(self, seconds: float) -> list[Outcome]:
        """The outcome of the task that was done."""
        ended, self._ended = self._ended, []
        return ended

    def close(self) -> None:
        """Nothing runs any more."""


@dataclass(eq=False)
class _Entry(Generic[AnyTask]):
    """A task of a schedule, as long as it has not ended."""

    task: AnyTask
    lane: str
    place: tuple[Any, int]
    needs: set[str]
    begun: bool = False


class Schedule(Generic[AnyTask]):
    """Tasks that wait for each other and for room, and those that run.

    It runs nothing by itself: `step` takes in what has ended, and gives out what can begin. All of
    it is called from one thread.

    Parameters
    ----------
    runner : Runs them; it is not closed.
    heard : Called with each task when it begins, and with its outcome when it has ended.
    lost : Called with each task that can't begin, and the name of the task before it that
        failed; it may add the task again, with other needs.
    memory : Bytes that a task takes.
    lane : What a task stands in: tasks of one lane begin in their order, past those of another.
    at_once : Tasks of a lane that run at once; by default as many as the runner takes.
    """

    def __init__(self, runner: Runner[AnyTask],
                 heard: Callable[[AnyTask, Outcome | None], None] = lambda task, outcome: None,
                 lost: Callable[[AnyTask, str], None] = lambda task, cause: None,
                 memory: Callable[[AnyTask], int] = lambda task: 0,
                 lane: Callable[[AnyTask], str] = lambda task: "",
                 at_once: Mapping[str, int] | None = None) -> None:
        self._runner, self._heard, self._lost = runner, heard, lost
        self._memory, self._lane, self._at_once = memory, lane, dict(at_once or {})
        self._entries: dict[str, _Entry[AnyTask]] = {}
        self._followers: dict[str, list[str]] = defaultdict(list)
        self._ready: dict[str, list[tuple[tuple[Any, int], str]]] = defaultdict(list)
        self._running: Counter[str] = Counter()
        self._numbers = itertools.count()

    def __contains__(self, name: str) -> bool:
        return name in self._entries

    def __len__(self) -> int:
        return len(self._entries)

    def add(self, task: AnyTask, place: Any = 0) -> None:
        """A new task; its needs that neither wait nor run are done.

        The lower its ``place``, the earlier it begins; of the same place the first one goes first.
        """
        needs = {need for need in task.needs if need in self._entries}
        entry = _Entry(task, self._lane(task), (place, next(self._numbers)), needs)
        self._entries[task.name] = entry
        for need in needs:
            self._followers[need].append(task.name)
        self._queue(entry)

    def move(self, name: str, place: Any) -> None:
        """Give a task that waits another place."""
        entry = self._entries[name]
        entry.place = place, entry.place[1]
        self._queue(entry)

    def _queue(self, entry: _Entry[AnyTask]) -> None:
        if not entry.needs and not entry.begun:
            heapq.heappush(self._ready[entry.lane], (entry.place, entry.task.name))

    def give(self) -> None:
        """Give out what can begin now."""
        for lane, ready in list(self._ready.items()):
            most = self._at_once.get(lane)
            while ready and (most is None or self._running[lane] < most):
                place, name = ready[0]
                entry = self._entries.get(name)
                if entry is None or entry.begun or entry.place != place:
                    heapq.heappop(ready)  # it has ended, or has another place
                    continue
                memory = self._memory(entry.task)
                if not self._runner.fits(memory):
                    break
                heapq.heappop(ready)
                entry.begun = True
                self._running[lane] += 1
                self._heard(entry.task, None)
                self._runner.start(entry.task, memory)

    def end(self, outcome: Outcome) -> None:
        """Take in how a task has ended; also of one that waits and is not to begin."""
        entry = self._entries.pop(outcome.task)
        self._running[entry.lane] -= entry.begun
        followers = self._followers_of(outcome.task)
        self._heard(entry.task, outcome)
        for follower in followers:
            if outcome.error:
                self._lose(follower, outcome.task)
            else:
                follower.needs.discard(outcome.task)
                self._queue(follower)

    def _followers_of(self, name: str) -> list[_Entry[AnyTask]]:
        """The tasks that wait for one; those that were given up, and came again, may not."""
        known = (self._entries.get(one) for one in self._followers.pop(name, []))
        return [entry for entry in known if entry is not None and name in entry.needs]

    def _lose(self, entry: _Entry[AnyTask], cause: str) -> None:
        """A task can't begin, nor can those that need it."""
        name = entry.task.name
        if self._entries.get(name) is not entry:
            return
        del self._entries[name]
        followers = self._followers_of(name)
        self._lost(entry.task, cause)
        for follower in followers:
            self._lose(follower, cause)

    def step(self, seconds: float = 0.0) -> None:
        """Take in what has ended, after ``seconds`` at most, and give out what can begin."""
        for outcome in self._runner.wait(seconds):
            self.end(outcome)
        self.give()


def run_tasks(tasks: Iterable[AnyTask], runner: Runner[AnyTask],
              heard: Callable[[AnyTask, Outcome | None], None] = lambda task, outcome: None,
              memory: Callable[[AnyTask], int] = lambda task: 0) -> dict[str, str]:
    """Run tasks to their end; one that fails takes only those with it that need it.

    Each stands after those that it needs; needs that are not among them are done. ``heard`` and
    ``memory`` are as for `Schedule`. Gives the names of the tasks that could not begin, and of the
    one before each that failed.
    """
    lost: dict[str, str] = {}

    def lose(task: AnyTask, cause: str) -> None:
        lost[task.name] = cause

    schedule = Schedule(runner, heard, lose, memory)
    for task in tasks:
        schedule.add(task)
    schedule.give()
    while len(schedule):
        schedule.step(_PATIENCE)
    return lost
