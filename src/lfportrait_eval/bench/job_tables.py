"""The figures of whole jobs as Markdown: a row for each job, and the long steps of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .jobs import STAGES

__all__ = ["job_tables"]

_LONG = 1.0
"""Seconds from which a step is shown."""


def job_tables(figures: dict[str, Any]) -> str:
    """The figures of `bench_jobs` as Markdown tables."""
    parts = [_conditions(figures)]
    if figures["jobs"]:
        parts.append(_table(
            ["job", "captured photos", "total", *STAGES, "first look", "peak memory", "folder"],
            [_row(name, job) for name, job in figures["jobs"].items()]))
    for name, job in figures["jobs"].items():
        parts += [_about(name, job), _steps(job)]
    return "\n\n".join(parts)


def _conditions(figures: dict[str, Any]) -> str:
    """The machine, and how often each job was run."""
    machine, vectors, repeats = figures["machine"], figures["vectors"], figures["repeats"]
    half = ", bfloat16" if vectors["bfloat16"] else ""
    runs = "a single run of each job" if repeats == 1 else (
        f"the median of {repeats} runs of each job, by total seconds")
    return (f"{machine['processor']}, cores: {machine['cores']}; kernels: {vectors['unit']}, "
            f"{vectors['lanes']} lanes; torch: {vectors['torch']}{half}; {runs}.")


def _row(name: str, job: dict[str, Any]) -> list[str]:
    """A job's row."""
    seconds = job["seconds"]
    return [name, _photos(job), _seconds(seconds["total"]),
            *(_seconds(seconds.get(stage)) for stage in STAGES),
            _seconds(job["first_look_seconds"]), f"{job['peak_memory_bytes'] / 2**30:.2f} GiB",
            f"{job['folder_bytes'] / 1e6:.0f} MB"]


def _photos(job: dict[str, Any]) -> str:
    """Photos in the capture, and of how many where some were left out."""
    photos, given = job["photos"], job["given_photos"]
    if photos is None:
        return "-"
    return f"{photos}" if given in (None, photos) else f"{photos} of {given}"


def _about(name: str, job: dict[str, Any]) -> str:
    """What the table has no column for, over the steps of a job."""
    facts = [f"cores in use: {_number(job['cores_in_use'], 2)}", f"device: {job['device']}"]
    if job["psnr"] is not None:
        facts.append(f"held-out photos: {job['psnr']:.2f} dB")
    if job["compiled"]:
        facts.append("kernels were compiled in this run")
    return f"{name}: {'; '.join(facts)}. Steps of more than {_LONG:.0f} s:"


def _steps(job: dict[str, Any]) -> str:
    """A job's long steps, and what lies outside of its stages."""
    rows = [[stage, step, _seconds(cost["seconds"]), _number(cost["cores_in_use"], 2)]
            for stage, found in job["stages"].items() for step, cost in found["steps"].items()
            if cost["seconds"] > _LONG]
    if job["seconds"]["outside"] > _LONG:
        rows.append(["-", "outside of the stages", _seconds(job["seconds"]["outside"]), "-"])
    return _table(["stage", "step", "time", "cores in use"], rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |"
                     for line in lines)


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{_number(value, 1)} s"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
