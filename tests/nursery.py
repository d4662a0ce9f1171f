"""Children of this process that are forked from a warm one, without each importing everything anew.

A server imports the module of what a `lfportrait.runner.Child` runs, once, and forks: a process of
its own takes a second and more to get there. What is forked leaves the server at once and becomes a
child of this process, as it would be otherwise: it is waited for, and counted, in the same way. The
server has no threads, and must get none.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

ROOT = Path(__file__).resolve().parents[1]
_SUBREAPER = 36
"""Linux: prctl's number for a process that is the next parent of its descendants' orphans."""
_LONGEST = 1 << 16


class Nursery:
    """Stands where `lfportrait.runner.processes` has ``subprocess``."""

    PIPE = subprocess.PIPE

    def __init__(self) -> None:
        ctypes.CDLL(None).prctl(_SUBREAPER, 1)
        self._line, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with other:
            self._server = subprocess.Popen(
                [sys.executable, "-m", "tests.nursery", str(other.fileno())], cwd=ROOT,
                pass_fds=[other.fileno()],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))})

    def Popen(self, words: list[str], *, env: Mapping[str, str],
              stderr: IO[bytes] | None = None, process_group: int | None = None,
              **_: Any) -> _Adopted:
        """What `subprocess.Popen` gives for ``python -c "from module import function; ..."``."""
        theirs, stdin = os.pipe()
        stdout, answers = os.pipe()
        given = [theirs, answers, 2 if stderr is None else stderr.fileno()]
        order = {"code": words[-1], "group": process_group, "parent": os.getpid(),
                 "environment": dict(env)}
        socket.send_fds(self._line, [json.dumps(order).encode()], given)
        os.close(theirs)
        os.close(answers)
        return _Adopted(int(self._line.recv(_LONGEST)), os.fdopen(stdin, "wb", buffering=0),
                        os.fdopen(stdout, "rb", buffering=0))

    def close(self) -> None:
        """End the server."""
        self._line.close()
        self._server.wait()
        ctypes.CDLL(None).prctl(_SUBREAPER, 0)


class _Adopted:
    """A child that another process has started; what a `lfportrait.runner.Child` asks of it."""

    def __init__(self, number: int, stdin: IO[bytes], stdout: IO[bytes]) -> None:
        self.pid, self.stdin, self.stdout = number, stdin, stdout
        self.returncode: int | None = None
        self._lock = threading.Lock()

    def _ended(self, options: int) -> int | None:
        with self._lock:
            if self.returncode is None:
                number, status = os.waitpid(self.pid, options)
                if number:
                    self.returncode = os.waitstatus_to_exitcode(status)
            return self.returncode

    def poll(self) -> int | None:
        """Its exit code, None while it runs."""
        return self._ended(os.WNOHANG)

    def wait(self) -> int | None:
        """Its exit code, when it has ended."""
        return self._ended(0)

    def kill(self) -> None:
        """End it at once."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)


def _become(order: dict[str, Any], descriptors: list[int], line: socket.socket) -> None:
    """Be the process that was ordered; its number is told when it is that."""
    for place, descriptor in enumerate(descriptors):
        os.dup2(descriptor, place)
        os.close(descriptor)
    os.environ.clear()
    os.environ.update(order["environment"])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if order["group"] is not None:
        os.setpgid(0, order["group"])
    while os.getppid() != order["parent"]:  # until the one between has ended
        os.sched_yield()
    line.send(str(os.getpid()).encode())
    line.close()
    exec(order["code"], {})


def serve(line: socket.socket) -> None:
    """Fork as is ordered, until the other side is gone."""
    while True:
        message, descriptors, _, _ = socket.recv_fds(line, _LONGEST, 3)
        if not message:
            return
        order = json.loads(message)
        importlib.import_module(order["code"].split()[1])
        between = os.fork()
        if between:
            os.waitpid(between, 0)
            for descriptor in descriptors:
                os.close(descriptor)
            continue
        if os.fork():
            os._exit(0)
        try:
            _become(order, descriptors, line)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    serve(socket.socket(fileno=int(sys.argv[1])))
