"""Do one task in any process: its stage's files from the files of the stages before.

Nothing but the task and the folder of the results is known here. A task that is done from the same
inputs is not done again, so one that is given out twice, because word of it was lost, is no harm.
"""

from __future__ import annotations

import errno
import os
import socket
import traceback
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...errors import UserError
from ...measure import cost_of
from ...stages import StageFolder
from ..graph import Task, finished
from ..work import Tools, do_stage

__all__ = ["Outcome", "do_task"]


@dataclass(frozen=True)
class Outcome:
    """How a task ended.

    Attributes
    ----------
    task
        Its name.
    error
        Cause of the failure, on one line; empty if it is done.
    figures
        Of the stage, with ``cost``: seconds, core-seconds, peak memory, bytes written.
    fault
        The traceback of an internal error; empty for errors of the user.
    worker
        Machine and process that did it.
    again
        Whether it had been done before.
    """

    task: str
    error: str = ""
    figures: dict[str, Any] | None = None
    fault: str = ""
    worker: str = ""
    again: bool = False


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
    try:
        figures = _done(task, results)
    except UserError as error:
        return Outcome(task.name, " ".join(str(error).split()), worker=worker)
    except MemoryError:
        return Outcome(task.name, "out of memory: let fewer tasks run at once (--workers), or make "
                       "the field smaller (reconstruct.max_voxels)", worker=worker)
    except Exception as error:
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            return Outcome(task.name, f"no space left on the disk of {results}; free some and run "
                           "the same command again", worker=worker)
        return Outcome(task.name, f"internal error: {type(error).__name__}: "
                       f"{' '.join(str(error).split())}", fault=traceback.format_exc(),
                       worker=worker)
    return Outcome(task.name, figures=figures, worker=worker)


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
