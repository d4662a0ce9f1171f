"""``index.html`` of a batch: all portraits, failures and their causes.

The pictures are small files beside it, so that a page of thousands stays light; the folder can be
copied or served as it is, and nothing is loaded from elsewhere.
"""

from __future__ import annotations

import html
from importlib import resources
from string import Template
from typing import Any
from urllib.parse import quote

from ...runner import finished
from ...version import __version__
from ..graph import Task
from .plan import Batch

__all__ = ["write_index"]


def write_index(batch: Batch) -> str:
    """The page of a batch.

    Parameters
    ----------
    batch
        The batch as it is now.

    Returns
    -------
    text
        HTML.
    """
    template = Template((resources.files(__package__) / "index.html").read_text("utf-8"))
    failures = batch.failures()
    sitters = [_sitter(batch, name) for name in batch.jobs.sitters if name not in
               batch.plan.refused]
    made = sum(row["state"] == "done" for row in batch.jobs_table())
    return template.substitute(
        made=made, wanted=len(batch.jobs_table()), failed=len(failures), version=__version__,
        failures=_failures(failures), sitters="\n".join(sitters))


def _failures(failures: dict[str, str]) -> str:
    """The list of what failed."""
    rows = "".join(f"<li><b>{html.escape(name)}</b> {html.escape(why)}</li>"
                   for name, why in failures.items())
    return f'<section class="failed"><h2>Failed</h2><ul>{rows}</ul></section>' if rows else ""


def _sitter(batch: Batch, name: str) -> str:
    """A sitter: a photo, figures, and the portraits."""
    tasks = [task for task in batch.plan.tasks.values() if task.sitter == name]
    notes: list[str] = []
    figures = []
    for task in tasks:
        found = (finished(task, batch.results) or {}) if task.name in batch.done else {}
        if task.stage == "capture" and found:
            figures.append(f"{found.get('views', 0)} photos")
            notes += found.get("notes", [])
        if task.stage == "field" and found.get("test"):
            figures.append(f"held-out views {found['test']['psnr']:.1f} dB")
        if task.stage == "field" and "voxels" in found:
            figures.append(f"{found['voxels'] / 1e6:.2f} M voxels")
    photo = _picture(f"{name}/photo.jpg", name) if f"{name}/capture" in batch.done else ""
    styles = dict.fromkeys(task.folder for task in tasks if "/" in task.folder)
    cards = "".join(_card(batch, folder, [task for task in tasks if task.folder == folder])
                    for folder in styles)
    remarks = "".join(f'<p class="note">{html.escape(note)}</p>' for note in notes)
    return (f'<section><h2>{html.escape(name)}</h2><p class="figures">'
            f'{html.escape(", ".join(figures))}</p>{remarks}'
            f'<div class="cards"><figure>{photo}<figcaption>photo</figcaption></figure>'
            f'{cards}</div></section>')


def _card(batch: Batch, folder: str, tasks: list[Task]) -> str:
    """A portrait: what it looks like and where its files are."""
    style = folder.partition("/")[2]
    page = next((task for task in tasks if task.stage == "page"), None)
    styled = next(task for task in tasks if task.stage == "stylize")
    picture = _picture(f"{folder}/thumbnail.jpg", style) if styled.name in batch.done else ""
    if page is not None and page.name in batch.done and picture:
        picture = f'<a href="{quote(folder)}/portrait.html">{picture}</a>'
    links = [_link(batch, task) for task in tasks if task.stage in ("encode", "page", "sweep")]
    return (f"<figure>{picture}<figcaption><b>{html.escape(style)}</b>"
            f"<ul>{''.join(links)}</ul></figcaption></figure>")


def _link(batch: Batch, task: Task) -> str:
    """A file, or why it is not there."""
    label = html.escape(task.label)
    if task.name not in batch.done:
        cause = batch.lost.get(task.name, task.name)
        why = batch.failed.get(cause, "not made yet")
        return f'<li class="failed">{label}: {html.escape(why)}</li>'
    found: dict[str, Any] = finished(task, batch.results) or {}
    size = found.get("cost", {}).get("bytes", 0) / 1e6
    return (f'<li><a href="{quote(f"{task.folder}/{task.outputs[0]}")}">{label}</a> '
            f"{size:.1f} MB</li>")


def _picture(path: str, words: str) -> str:
    return f'<img src="{quote(path)}" alt="{html.escape(words)}" loading="lazy" height="192">'
