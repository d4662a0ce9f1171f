"""Processes that can be killed, without each importing everything anew.

A server imports a module and then forks, once for each call: what is forked begins where a process
of its own would have its imports done. The server has no threads, and must get none.
"""

import importlib
import os
import signal
import subprocess
import sys
import traceback
from pathlib import Path

import lfportrait

ROOT = Path(__file__).resolve().parents[2]


class Forked:
    """One call in a process of its own."""

    def __init__(self, server: "Forker", pid: int) -> None:
        self.server, self.pid = server, pid

    def running(self) -> bool:
        """Whether it has not ended yet; a process that ended stays a zombie until `wait`."""
        state = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()[0]
        return state != "Z"

    def kill(self) -> None:
        """End it at once."""
        os.kill(self.pid, signal.SIGKILL)

    def wait(self) -> int:
        """Its exit code, negative where a signal ended it."""
        return int(self.server.ask("wait"))


class Forker:
    """Calls a module's function in processes that are forked from a warm one."""

    def __init__(self, module: str, function: str) -> None:
        # The package that is tested here, wherever it lies: another's kernels would be compiled.
        paths = os.pathsep.join([str(ROOT), str(Path(lfportrait.__file__).parents[1])])
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.job.forking", module, function], cwd=ROOT, text=True,
            env={**os.environ, "PYTHONPATH": paths}, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, bufsize=1)

    def ask(self, line: str) -> str:
        """Say a line to the server; its answer."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self._process.stdout.readline()

    def start(self, *words: str) -> Forked:
        """Call the function with words, without tabs, in a new process; one at a time."""
        return Forked(self, int(self.ask("\t".join(["start", *words]))))

    def close(self) -> None:
        """End the server."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


def serve(module: str, function: str) -> None:
    """Fork and wait as the lines of the standard input say."""
    call, pid = getattr(importlib.import_module(module), function), 0
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # What is forked prints elsewhere.
    for line in sys.stdin:
        order, *words = line.rstrip("\n").split("\t")
        if order == "wait":
            print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), file=answers)
            continue
        pid = os.fork()
        if pid == 0:
            try:
                call(*words)
            except BaseException:
                traceback.print_exc()
                os._exit(1)
            os._exit(0)
        print(pid, file=answers)


if __name__ == "__main__":
    serve(*sys.argv[1:])
