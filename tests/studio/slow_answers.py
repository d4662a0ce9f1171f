"""A resident process that answers when a file lies beside its log, for tests of the queue."""

import time
from pathlib import Path

from lfportrait.runner import Pipe


def serve() -> None:
    pipe = Pipe()
    while True:
        name, facts = pipe.requests.get()
        with open(facts["asked"], "a") as stream:
            stream.write(f"{name}\n")
        while not Path(facts["open"]).exists():
            time.sleep(0.005)
        pipe.tell("end", {"name": name})
