"""Tasks in processes of our own: `Workers` is the runner, `serve` what each process does.

A process is sent a request, and tells what it likes while it works on it. The last message of a
request is ``("end", result)`` or ``("failed", code, message, trace)`` (`Failure`). A process that
ends without that was killed, or its memory was too small.
"""

from __future__ import annotations

import contextlib
import queue
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic

from .processes import Child, Pipe
from .scheduler import AnyTask, Failure, Outcome, Runner, failure_of


def serve(work: Callable[[Any, Callable[..., None]], Any],
          read: Callable[[BaseException], Failure] = failure_of) -> None:
    """Do what is asked for, one request after the other, until the parent ends.

    Parameters
    ----------
    work
        Does a request: it is given that, and what tells the parent a message in between.
    read
        Reads an error.
    """
    pipe = Pipe()
    while True:
        request = pipe.requests.get()
        try:
            pipe.tell("end", work(request, pipe.tell))
        except Exception as error:
            failure = read(error)
            if failure.trace:
                print(failure.trace, file=sys.stderr, flush=True)
            pipe.tell("failed", failure.code, failure.message, failure.trace)


@dataclass(eq=False)
class _Worker(Generic[AnyTask]):
    """A process that does one task at a time, once it has started."""

    child: Child | None = None
    task: AnyTask | None = None
    memory: int = 0
    attempts: int = 0


class Workers(Runner[AnyTask]):
    """Processes on this machine, one task at a time each.

    Parameters
    ----------
    slots
        Processes.
    begin
        Starts one, for its first task.
    ask
        What is sent of a task; what it raises is how the task ends.
    died
        Of a task whose process has died.
    attempts
        How often a task is given out whose process dies.
    memory
        Bytes that tasks may take together; None: any.
    stay
        Whether a process goes on with other tasks.
    said
        Called with the messages between, by `wait`.
    read
        Reads an error of ``ask``.
    wake
        Called from any thread when there is something for `wait` to take in.

    Attributes
    ----------
    children
        The processes of the tasks that run, by the tasks' names.
    """

    def __init__(self, slots: int, begin: Callable[[AnyTask], Child],
                 ask: Callable[[AnyTask], Any], died: Failure, *, attempts: int = 1,
                 memory: float | None = None, stay: bool = True,
                 said: Callable[[AnyTask, Any], None] = lambda task, message: None,
                 read: Callable[[BaseException], Failure] = failure_of,
                 wake: Callable[[], None] = lambda: None) -> None:
        self.slots, self.children = slots, dict[str, Child]()
        self._begin, self._ask, self._died, self._attempts = begin, ask, died, attempts
        self._memory, self._stay, self._said, self._read = memory, stay, said, read
        self._wake = wake
        self._idle = [_Worker[AnyTask]() for _ in range(slots)]
        self._busy: dict[str, _Worker[AnyTask]] = {}
        self._heard: queue.SimpleQueue[tuple[_Worker[AnyTask], Child | None, Any]] = (
            queue.SimpleQueue())

    def fits(self, memory: int) -> bool:
        """Whether there is a process, and memory beside what the others take."""
        taken = sum(worker.memory for worker in self._busy.values())
        # A task that is larger than all there is may try it alone.
        return bool(self._idle) and (not self._busy or self._memory is None
                                     or taken + memory <= self._memory)

    def start(self, task: AnyTask, memory: int) -> None:
        """Give out a task."""
        worker = self._idle.pop()
        worker.task, worker.memory, worker.attempts = task, memory, 0
        self._busy[task.name] = worker
        self._give(worker, task)

    def _give(self, worker: _Worker[AnyTask], task: AnyTask) -> None:
        """Have a worker do its task; a process that is not there, or died, is started first."""
        worker.attempts += 1
        try:
            request = self._ask(task)
            if worker.child is None or not worker.child.alive:
                if worker.child is not None:
                    worker.child.close()
                    worker.child = None
                child = worker.child = self._begin(task)
                child.listen(lambda message: self._hear(worker, child, message))
        except Exception as error:
            found = self._read(error)
            self._hear(worker, worker.child, ("failed", found.code, found.message, found.trace))
            return
        self.children[task.name] = worker.child
        with contextlib.suppress(OSError):  # it has ended, which is heard
            worker.child.send(request)

    def _hear(self, worker: _Worker[AnyTask], child: Child | None, message: Any) -> None:
        self._heard.put((worker, child, message))
        self._wake()

    def wait(self, seconds: float) -> list[Outcome]:
        """Outcomes of tasks that have ended, after ``seconds`` at most."""
        outcomes = []
        with contextlib.suppress(queue.Empty):
            heard = self._heard.get(seconds > 0, seconds)
            while True:
                outcome = self._outcome(*heard)
                if outcome is not None:
                    outcomes.append(outcome)
                heard = self._heard.get_nowait()
        return outcomes

    def _outcome(self, worker: _Worker[AnyTask], child: Child | None, message: Any,
                 ) -> Outcome | None:
        """How a worker's task has ended; None where it goes on, or is given out again."""
        if message is None and child is not None:
            child.close()
        task = worker.task
        if task is None or child is not worker.child:
            return None  # of a process that had nothing to do, or was stopped
        if message is None:
            if worker.attempts < self._attempts:
                self._give(worker, task)
                return None
            outcome = Outcome.failed(task.name, self._died)
        elif message[0] == "end":
            outcome = (message[1] if isinstance(message[1], Outcome)
                       else Outcome(task.name, figures=message[1]))
        elif message[0] == "failed":
            outcome = Outcome.failed(task.name, Failure(*message[1:]))
        else:
            self._said(task, message)
            return None
        ended = self._freed(worker, task)
        if ended is not None and self._stay:
            worker.child = ended
        elif ended is not None:
            ended.kill()
            threading.Thread(target=ended.close).start()  # its end may take a moment
        return outcome

    def _freed(self, worker: _Worker[AnyTask], task: AnyTask) -> Child | None:
        """Take task and process from a worker; that process."""
        child, worker.child, worker.task = worker.child, None, None
        self.children.pop(task.name, None)
        self._idle.append(self._busy.pop(task.name))
        return child

    def stop(self, name: str) -> Child | None:
        """Kill the process of a task, which has no outcome then; the caller closes it."""
        worker = self._busy.get(name)
        if worker is None or worker.task is None:
            return None
        child = self._freed(worker, worker.task)
        if child is not None:
            child.kill()
        return child

    def close(self) -> None:
        """End all processes; what still runs is given up."""
        for worker in [*self._idle, *self._busy.values()]:
            child, worker.child, worker.task = worker.child, None, None
            if child is not None:
                child.close()
        self._idle += self._busy.values()
        self._busy.clear()
        self.children.clear()
