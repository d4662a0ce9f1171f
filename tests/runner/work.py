"""A process that does tasks as they say: add, tell on the way, fail, die."""

import os
import subprocess
import sys
import time
from pathlib import Path

from lfportrait.errors import UserError
from lfportrait.runner import serve as serve_tasks


def work(request, tell):
    word, path = request[0], Path(request[1])
    if word == "slow":
        with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]) as child:
            path.write_text(f"{os.getpid()} {child.pid}")
            tell("begun")
            time.sleep(600)
    if word == "die":
        with path.open("a") as stream:
            stream.write("x")
        if len(path.read_text()) < 3:
            os.kill(os.getpid(), 9)
    if word == "fail":
        raise UserError("no light")
    if word == "fault":
        raise KeyError("nothing")
    tell("half", 0.5)
    return {"process": os.getpid()}


def serve() -> None:
    serve_tasks(work)
