"""Processes of our own, and tasks in them.

`Child` is the parent's end of a process, `Pipe` the child's. Messages go through the child's
standard input and output: pickled, and behind that the arrays as they are; only a program and its
own children talk this way. What libraries print goes to standard error. When the parent is gone,
however it ended, standard input ends, and so do the child, whatever it does at that moment, and
what it has started.

`Workers` runs tasks in such processes, `serve` is what each of them does. A process is sent a
request, and tells what it likes while it works on it. The last message of a request is
``("end", result)`` or ``("failed", code, message, trace)`` (`Failure`). A process that ends without
that was killed, or its memory was too small.
"""

import contextlib
import ctypes
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Generic

from ..errors import UserError
from ..measure import keep_memory
from .scheduler import AnyTask, Failure, Outcome, Runner, failure_of

CAN_PAUSE = hasattr(os, "killpg")
"""Whether this system can stop a process and all that it has started, and let it go on."""
_LOG = 1 << 20  # Bytes of a log after which it begins again.
_BEGIN = ("import gc; gc.disable(); from {module} import {function}; gc.freeze(); gc.enable(); "
          "{function}()")
"""What a process runs. Nothing that is imported is ever garbage: to look for some meanwhile, and
among it later, takes an eighth of a start."""
_WOKEN_BY = 1  # Linux: prctl's number for the signal that a process gets when its parent ends.


def send(stream: IO[bytes], value: Any) -> None:
    """Write an object; arrays follow it as they are, without a copy."""
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    parts = [part.raw() for part in buffers]
    sizes = [len(head), *(part.nbytes for part in parts)]
    first = struct.pack(f"<Q{len(sizes)}Q", len(sizes), *sizes) + head
    for part in (memoryview(first), *parts):
        while len(part):
            part = part[stream.write(part):]


def receive(stream: IO[bytes]) -> Any:
    """Read an object that `send` wrote; `EOFError` if the other side is gone."""
    (count,) = struct.unpack("<Q", _exactly(stream, 8))
    sizes = struct.unpack(f"<{count}Q", _exactly(stream, 8 * count))
    head = _exactly(stream, sizes[0])
    return pickle.loads(head, buffers=[_exactly(stream, size) for size in sizes[1:]])


def _exactly(stream: IO[bytes], size: int) -> bytearray:
    """So many bytes, in memory that arrays may write to."""
    out = bytearray(size)
    view, got = memoryview(out), 0
    while got < size:
        more = stream.readinto(view[got:])  # type: ignore[attr-defined]
        if not more:
            raise EOFError("the stream ended")
        got += more
    return out


def _widen(stream: IO[bytes]) -> None:
    """Let a pipe hold more at once, where the system can: pictures take half the time."""
    with contextlib.suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(stream.fileno(), fcntl.F_SETPIPE_SZ, 1 << 20)


class Child:
    """A process that runs one of our functions, from now on.

    ``entry`` is ``"module:function"``; the function makes a `Pipe` first. What it prints goes to
    ``log``, by default where this process prints its errors; ``settings`` are environment variables
    of its own. With a process ``group`` of its own Ctrl-C in the terminal does not reach it, and it
    is paused and ended with all that it has started.
    """

    def __init__(self, entry: str, log: Path | None = None,
                 settings: Mapping[str, str] | None = None, *, group: bool = False) -> None:
        module, _, function = entry.partition(":")
        own: dict[str, Any] = {}
        if group:
            own = {"process_group": 0} if os.name == "posix" else {
                "creationflags": 0x200}  # CREATE_NEW_PROCESS_GROUP
        paths = os.pathsep.join(path for path in sys.path if path)
        with contextlib.ExitStack() as stack:
            if log is not None:
                log.parent.mkdir(parents=True, exist_ok=True)
                keep = log.is_file() and log.stat().st_size < _LOG
                own["stderr"] = stack.enter_context(open(log, "ab" if keep else "wb"))
            self._process = subprocess.Popen(
                [sys.executable, "-c", _BEGIN.format(module=module, function=function)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0,
                env={**os.environ, "PYTHONPATH": paths, **(settings or {})}, **own)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._stdin, self._stdout = self._process.stdin, self._process.stdout
        for stream in (self._stdin, self._stdout):
            _widen(stream)
        self._group, self._killed = group and hasattr(os, "killpg"), False
        self._listener: threading.Thread | None = None

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._process.poll() is None

    @property
    def number(self) -> int:
        """Of the process."""
        return self._process.pid

    def send(self, message: Any) -> None:
        """Send it a message; `OSError` if it has ended."""
        send(self._stdin, message)

    def receive(self) -> Any:
        """Its next message; `EOFError` when it has ended."""
        return receive(self._stdout)

    def listen(self, heard: Callable[[Any], None]) -> None:
        """Have a thread call ``heard`` with each message, and with None when it has ended."""
        def work() -> None:
            with contextlib.suppress(EOFError, OSError):
                while True:
                    heard(self.receive())
            heard(None)

        self._listener = threading.Thread(target=work, daemon=True)
        self._listener.start()

    def pause(self, paused: bool) -> None:
        """Stop it where it is, with its group, or let it go on; its memory stays."""
        if not CAN_PAUSE:
            raise UserError("this system can't pause a process; cancel the job instead: it goes on "
                            "where its last stage ended")
        self._signal(signal.SIGSTOP if paused else signal.SIGCONT)

    def kill(self) -> None:
        """Kill it, whatever it does, with its group."""
        if self._group and not self._killed:
            self._signal(signal.SIGKILL)
        self._killed = True
        self._process.kill()

    def close(self) -> None:
        """Kill it, and wait for its end."""
        self.kill()
        self._process.wait()
        if self._listener is not None:
            self._listener.join()
        for stream in (self._stdin, self._stdout):
            with contextlib.suppress(OSError):
                stream.close()

    def _signal(self, number: int) -> None:
        # Where the process itself is gone, the group may still have members.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, number)


class Pipe:
    """The pipe to the parent: ``requests`` are what it has sent.

    `tell` may be called from any thread. The process keeps freed memory from now on, as a command
    does.
    """

    def __init__(self) -> None:
        _end_with_parent()
        keep_memory()
        # Ctrl-C is for the parent, whose end is noticed here. What is started from here hears it.
        signal.signal(signal.SIGINT, lambda *_: None)
        incoming = os.fdopen(os.dup(0), "rb", buffering=0)
        self._outgoing = os.fdopen(os.dup(1), "wb", buffering=0)
        # Nobody else reads what is asked, or prints between the answers.
        with open(os.devnull, "rb") as nothing:
            os.dup2(nothing.fileno(), 0)
        os.dup2(2, 1)
        self._lock = threading.Lock()
        self.requests: queue.SimpleQueue[Any] = queue.SimpleQueue()
        threading.Thread(target=self._listen, args=(incoming,), daemon=True).start()

    def _listen(self, incoming: IO[bytes]) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                self.requests.put(receive(incoming))
        _end()

    def tell(self, *message: Any) -> None:
        """Send a message, a tuple."""
        with self._lock:
            try:
                send(self._outgoing, message)
            except OSError:
                _end()


def _end() -> None:
    """End this process and those that it started, at once."""
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _end_with_parent() -> None:
    """Linux: a process that is paused goes on when its parent has ended, and finds the pipe ended.

    Elsewhere the system itself wakes and ends paused processes that nobody could wake any more.
    """
    if sys.platform != "linux":
        return
    parent = os.getppid()
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_WOKEN_BY, signal.SIGCONT)
    if os.getppid() != parent:
        _end()


def serve(work: Callable[[Any, Callable[..., None]], Any],
          read: Callable[[BaseException], Failure] = failure_of) -> None:
    """Do what is asked for, one request after the other, until the parent ends.

    ``work`` is given a request, and what tells the parent a message in between; ``read`` reads an
    error.
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


@dataclass(frozen=True)
class Callbacks(Generic[AnyTask]):
    """What `Workers` calls while tasks run."""

    # With a task's messages, from `wait`.
    said: Callable[[AnyTask, Any], None] = lambda task, message: None
    # From any thread, when there is something for `wait` to take in.
    wake: Callable[[], None] = lambda: None
    # With an error of what is to be sent of a task: how the task ends.
    read: Callable[[BaseException], Failure] = failure_of


class Workers(Runner[AnyTask]):
    """Processes on this machine, one task at a time each.

    Parameters
    ----------
    slots : Processes.
    begin : Starts one, for its first task.
    ask : What is sent of a task; what it raises is how the task ends.
    died : Of a task whose process has died.
    attempts : How often a task is given out whose process dies.
    memory : Bytes that tasks may take together; None: any.
    stay : Whether a process goes on with other tasks.
    callbacks : What is called meanwhile.

    Attributes
    ----------
    children : The processes of the tasks that run, by the tasks' names.
    """

    def __init__(self, slots: int, begin: Callable[[AnyTask], Child],
                 ask: Callable[[AnyTask], Any], died: Failure, *, attempts: int = 1,
                 memory: float | None = None, stay: bool = True,
                 callbacks: Callbacks[AnyTask] | None = None) -> None:
        self.slots, self.children = slots, dict[str, Child]()
        self._begin, self._ask, self._died, self._attempts = begin, ask, died, attempts
        self._memory, self._stay, self._callbacks = memory, stay, callbacks or Callbacks()
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
            found = self._callbacks.read(error)
            self._hear(worker, worker.child, ("failed", found.code, found.message, found.trace))
            return
        self.children[task.name] = worker.child
        with contextlib.suppress(OSError):  # it has ended, which is heard
            worker.child.send(request)

    def _hear(self, worker: _Worker[AnyTask], child: Child | None, message: Any) -> None:
        self._heard.put((worker, child, message))
        self._callbacks.wake()

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
            self._callbacks.said(task, message)
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
