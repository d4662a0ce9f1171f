"""Do one task in any process: its stage's files from the files of the stages before.

Nothing but the task and the folder of the results is known here. A task that is done from the same
inputs is not done again, so one that is given out twice, because word of it was lost, is no harm.
"""

from __future__ import annotations

import os
import socket
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...measure import cost_of
from ...runner import Outcome, finished, outcome_of
from ...stages import StageFolder
from ..graph import Task
from ..work import Tools, do_stage

__all__ = ["do_task"]


def do_task(task: Task, results: Path) -> Outcome:
    """Do a task.

    Parameters
    ----------
    task
        What to do.
    results
        Folder of all results.

    Returns
    -------
    outcome
        Failures of any kind are stored in it; none is raised.
    """
    worker = f"{socket.gethostname()}:{os.getpid()}"
    before = finished(task, results)
    if before is not None:
        return Outcome(task.name, figures=before, worker=worker, again=True)
    return outcome_of(task, lambda: _done(task, results), worker)


def _done(task: Task, results: Path) -> dict[str, Any]:
    """Do the stage's work; its figures, notes, cost and bytes written."""
    folder = StageFolder(results / task.folder)

    def work() -> dict[str, Any]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("ignore")
            warnings.filterwarnings("always", category=UserWarning, module=r"lfportrait\w*\.")
            tools = Tools(device=task.device)
            cost, figures = cost_of(lambda: do_stage(task, results, folder, tools))
        written = sum(_size(folder.folder / name)
                      for name in (*task.outputs, *figures.get("more", ())))
        notes = list(dict.fromkeys(" ".join(str(one.message).split()) for one in caught))
        return {**figures, "notes": notes, "cost": {**asdict(cost), "bytes": written}}

    return folder.run(task.record, task.key, task.outputs, work)


def _size(path: Path) -> int:
    """Bytes of a file, or of a folder's files."""
    if path.is_dir():
        return sum(one.stat().st_size for one in path.rglob("*") if one.is_file())
    return path.stat().st_size
