"""A job's process that works as long as a file lies in the project's folder, for tests."""

import os
import subprocess
import sys
import time
from pathlib import Path

from lfportrait.runner import Pipe


def serve() -> None:
    pipe = Pipe()
    order = pipe.requests.get()
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    (order.folder / "pids.txt").write_text(f"{os.getpid()} {child.pid}")
    pipe.tell("stages", [("capture", 10.0), ("reconstruct", 30.0)])
    pipe.tell("begin", "capture")
    count = 0
    while (order.folder / "wait").exists():
        count += 1
        pipe.tell("progress", "capture", min(0.9, 0.01 * count), f"step {count}")
        (order.folder / "steps.txt").write_text(str(count))
        time.sleep(0.01)
    for word in ("die", "fail", "full"):
        if (order.folder / word).exists():
            (order.folder / word).unlink()
            if word == "die":
                os.kill(os.getpid(), 9)
            pipe.tell("failed", "disk_full" if word == "full" else "user_error", f"it is {word}")
            time.sleep(600)
    pipe.tell("note", "a warning")
    order.pictures.mkdir(parents=True, exist_ok=True)
    (order.pictures / "capture.jpg").write_bytes(b"\xff\xd8")
    pipe.tell("picture", "capture")
    (order.pictures / "capture.html").write_text("<p>a head</p><script>1</script>")
    pipe.tell("page", "capture")
    pipe.tell("done", "capture", 0.5)
    pipe.tell("skipped", "reconstruct")
    result = {"kind": order.kind}
    if order.kind == "export":
        target = Path(order.more["target"])
        target.write_text("styled" if "styled" in order.more["look"] else "preview")
        result |= {"file": target.name, "fine": "styled" in order.more["look"]}
    pipe.tell("end", result)
    child.kill()
    time.sleep(600)  # it is ended from outside
