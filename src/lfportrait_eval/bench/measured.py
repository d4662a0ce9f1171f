"""A file of measured figures: what was measured, on which machine, from which commit, and when.

``docs/measured.json`` of the repository is such a file; the page of benchmarks, and the tables of
other documents, are written from it (``scripts/make_benchmarks.py``). It has two parts:

- ``runs``: by name, the conditions of one measurement: ``command``, ``machine`` (`measure.machine`:
  ``processor``, ``cores``, ...), ``vectors`` (the instructions that kernels were compiled for),
  ``commit`` and ``date``.
- ``figures``: by name, such as ``encode.4k.seconds``, ``[value, run]``. The name's last part is the
  quantity, from which its unit follows: ``seconds``, ``psnr`` (dB), ``ssim``, ``peak_memory_bytes``
  and other numbers.

`record` adds a run's figures to a file, and drops runs that no figure comes from any more.
"""

from __future__ import annotations

import datetime
import json
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lfportrait import __version__
from lfportrait.errors import UserError
from lfportrait.files import atomic_write, read_json
from lfportrait.simd.host import vector_unit

_CONDITIONS = ("machine", "vectors", "device", "failed", "repeats", "files", "stages", "totals")
"""Entries of a run's figures that are no figures of what was measured."""


def flat_figures(figures: Mapping[str, Any], prefix: str = "") -> dict[str, int | float]:
    """Numbers of nested figures by dotted names; lists and texts are left out."""
    rows: dict[str, int | float] = {}
    for name, value in figures.items():
        if name in _CONDITIONS:
            continue
        if isinstance(value, Mapping):
            rows.update(flat_figures(value, f"{prefix}{name}."))
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            rows[prefix + name] = value
    return rows


def commit_of_checkout() -> str:
    """The commit of the checkout that this package runs from; a package's version elsewhere."""
    try:
        done = subprocess.run(["git", "-C", str(Path(__file__).parent), "rev-parse", "--short=7",
                               "HEAD"], capture_output=True, text=True, check=True, timeout=20)
    except (OSError, subprocess.SubprocessError):
        return __version__
    return done.stdout.strip()


def read_measured(path: Path) -> dict[str, Any]:
    """The file's content, or an empty one where there is none.

    Raises
    ------
    UserError
        If it is no such file.
    """
    if not path.exists():
        return {"runs": {}, "figures": {}}
    found = read_json(path)
    if not isinstance(found, dict) or not {"runs", "figures"} <= found.keys():
        raise UserError(f"{path} is no file of measured figures: it has no runs and figures")
    return found


def record(path: Path, what: str, figures: Mapping[str, Any], command: str, *,
           date: datetime.date | None = None, commit: str | None = None) -> None:
    """Add a run's figures to a file; those of the same names are replaced.

    Parameters
    ----------
    path
        The file; made where there is none.
    what
        What was measured, a choice of ``lfportrait bench``; before the figures' names, but for
        ``all`` and ``job``, whose names begin with what they are.
    figures
        As the command's ``--json`` has them, with ``machine``.
    command
        The command.
    date, commit
        By default today's, and that of the checkout.

    Raises
    ------
    UserError
        If the file exists and is none of measured figures.
    """
    known = read_measured(path)
    commit = commit or commit_of_checkout()
    date = date or datetime.date.today()
    run = f"{date:%Y-%m-%d} {what} {commit}"
    unit = figures["vectors"]["unit"] if "vectors" in figures else vector_unit()[0]
    known["runs"][run] = {"command": command, "machine": figures["machine"],
                          "vectors": unit, "commit": commit, "date": f"{date:%Y-%m-%d}"}
    prefix = "" if what in ("all", "job") else f"{what}."
    known["figures"].update({name: [value, run]
                             for name, value in flat_figures(figures, prefix).items()})
    used = {source for _, source in known["figures"].values()}
    known["runs"] = {name: one for name, one in known["runs"].items() if name in used}
    with atomic_write(path) as stream:
        stream.write(_text(known).encode())


def _text(known: Mapping[str, Any]) -> str:
    """JSON with a line for each figure, so that a change shows what changed."""
    figures = ",\n".join(f'    {json.dumps(name)}: {json.dumps(value)}'
                         for name, value in sorted(known["figures"].items()))
    rest = {name: value for name, value in known.items() if name != "figures"}
    head = json.dumps(rest, indent=2, ensure_ascii=False).removesuffix("\n}")
    return f'{head},\n  "figures": {{\n{figures}\n  }}\n}}\n'
