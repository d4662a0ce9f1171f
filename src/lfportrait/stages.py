"""Resumable stages: finished work of a long job is not repeated.

A job is a chain of stages in one folder. A stage is done when its outputs lie under their final
names and a small record beside them says from which inputs they were made: the stage's key, a hash
of the package, the stage's parameters and the keys of the stages it reads (`lfportrait.cache`).
Outputs are written under temporary names and renamed, and the record is written last; so a job that
is killed at any moment finds, when it is run again, either a finished stage or none, and continues
from there to the same files as an undisturbed run.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from .errors import UserError
from .files import read_json, write_json
from .temporary import sweep_once

_RECORDS = ".stages"


def fingerprint_files(paths: Iterable[Path]) -> str:
    """Hash of files' names and contents, in the order of their names."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.name.encode() + b"\0")
        try:
            with open(path, "rb") as stream:
                digest.update(hashlib.file_digest(stream, "sha256").digest())
        except OSError as error:
            raise UserError(f"can't read {path}: {error.strerror}") from error
    return digest.hexdigest()[:32]


def check_writable(folder: Path) -> None:
    """Raise `UserError` where a folder can't be made or written to; nothing is made."""
    above = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    if not above.is_dir() or not os.access(above, os.W_OK):
        raise UserError(f"can't write to {folder}: {above} is "
                        f"{'not writable' if above.is_dir() else 'no folder'}; "
                        "choose another folder with --out")


def finished_record(folder: Path, name: str, key: str, outputs: Iterable[str],
                    ) -> dict[str, Any] | None:
    """The figures of a stage that was done from the same inputs; None where it is to be done."""
    try:
        data = json.loads((folder / _RECORDS / f"{name}.json").read_text("utf-8"))
        figures, same = dict(data["figures"]), data["key"] == key
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return figures if same and all((folder / output).exists() for output in outputs) else None


class StageFolder:
    """The folder of one job and the records of its finished stages.

    Parameters
    ----------
    folder : Where the outputs go; made if it does not exist.
    report : Called with one line of text when a stage is skipped because it is done.

    Attributes
    ----------
    figures : Per stage: the figures that its function returned, with ``"seconds"``; those of a
        stage that was finished in an earlier run come from its record.
    resumed : Names of the stages that an earlier run had finished.
    """

    def __init__(self, folder: Path, report: Callable[[str], None] = lambda line: None) -> None:
        self.folder = Path(folder)
        self.records = self.folder / _RECORDS
        self.figures: dict[str, dict[str, Any]] = {}
        self.resumed: list[str] = []
        self._report = report
        sweep_once(self.folder)
        sweep_once(self.records)
        try:
            self.records.mkdir(parents=True, exist_ok=True)
            # Without a name of its own: others may begin in the same folder at this moment.
            with tempfile.TemporaryFile(dir=self.records) as probe:
                probe.write(b"x")
        except OSError as error:
            raise UserError(f"can't write to {self.folder}: {error.strerror}; "
                            "choose another folder with --out") from error

    def run(self, name: str, key: str, outputs: Sequence[str],
            function: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Do a stage, or nothing if it was done from the same inputs before.

        ``key`` is the hash of everything that the outputs depend on (`key_of`); these are files or
        folders relative to the job's folder, which ``function`` writes; it gives the figures for
        ``--json``.
        """
        record = self.records / f"{name}.json"
        done = finished_record(self.folder, name, key, outputs)
        if done is not None:
            self._report(f"{name}: done before, skipped")
            self.resumed.append(name)
            self.figures[name] = done
            return done
        record.unlink(missing_ok=True)
        start = time.perf_counter()
        figures = dict(function())
        figures["stage_seconds"] = round(time.perf_counter() - start, 3)
        write_json(record, {"key": key, "outputs": list(outputs), "figures": figures})
        # Read back so that a resumed run sees exactly what this one does.
        self.figures[name] = read_json(record)["figures"]
        return self.figures[name]

    def forget(self, name: str) -> None:
        """Have a stage done again the next time, whatever its record says."""
        (self.records / f"{name}.json").unlink(missing_ok=True)

    def scratch(self, name: str) -> Path:
        """A path inside the record folder for a stage's checkpoints."""
        return self.records / name

    def remove_scratch(self, *names: str) -> None:
        """Delete checkpoints that a finished stage no longer needs."""
        for name in names:
            path = self.records / name
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
