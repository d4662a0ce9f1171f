"""A process that does what it is asked: say it again, print, tell a setting, die."""

import gc
import os

import numpy as np

from lfportrait.runner import Pipe


def faults() -> int:
    """How often the system is asked for a page while arrays of 16 MiB come and go."""
    import resource

    np.ones(4 << 20, np.float32)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        np.ones(4 << 20, np.float32)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def serve() -> None:
    pipe = Pipe()
    while True:
        word, *more = pipe.requests.get()
        if word == "die":
            os._exit(3)
        if word == "print":
            print("printed", flush=True)
        if word == "garbage":
            more = [gc.isenabled(), gc.get_freeze_count()]
        if word == "faults":
            more = [faults()]
        pipe.tell(os.environ.get(more[0]) if word == "setting" else word, *more)
