"""A process that does what it is asked: say it again, print, tell a setting, die."""

import gc
import os

from lfportrait.runner import Pipe


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
        pipe.tell(os.environ.get(more[0]) if word == "setting" else word, *more)
