"""A local worker process, which gets tasks through its pipes.

Pickled tasks come on standard input, pickled outcomes go to standard output; only a batch's own
processes talk this way. When the batch is gone, standard input ends, and so does the worker,
whatever it does at that moment.
"""

from __future__ import annotations

import os
import pickle
import queue
import sys
import threading
from pathlib import Path

from ..graph import Task
from .work import do_task

__all__ = ["serve"]


def serve() -> None:
    """Do tasks until standard input ends."""
    # What libraries print goes to the log, where standard error is already.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    tasks: queue.Queue[tuple[Task, Path]] = queue.Queue()

    def listen() -> None:
        while True:
            try:
                tasks.put(pickle.load(sys.stdin.buffer))
            except (EOFError, OSError, pickle.UnpicklingError):
                os._exit(1)

    threading.Thread(target=listen, daemon=True).start()
    while True:
        pickle.dump(do_task(*tasks.get()), answers)
        answers.flush()
