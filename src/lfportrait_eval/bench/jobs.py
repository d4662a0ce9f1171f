"""Whole jobs: what a portrait costs from the command to the finished folder.

Each job is made in a process of its own, one after the other, into a folder that is removed
afterwards. So its peak memory and its seconds are those of a user who starts the command: the
imports count, and so do kernels where they are compiled for the first time.

`job_tables` shows the figures as Markdown: a row for each job, and the long steps of each.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from lfportrait.errors import UserError
from lfportrait.files import read_json
from lfportrait.measure import machine
from lfportrait.progress import Progress
from lfportrait.simd.host import vector_unit
from lfportrait.temporary import temporary_folder

from ..markdown import number, table
from .transfer import say

STAGES = ("capture", "reconstruct", "stylize", "encode", "share")
"""Stages of a job, in their order."""
_DEMO = "demo"
_ROOM = 256 << 20
"""Bytes that a job writes at the least."""
_COMPILING = "compiling kernels, once"
"""The step of a stage in which its kernels are compiled or waited for."""
_BEFORE = "please report it with the lines above"
"""Ends the line after a traceback; what went wrong is in the line before it."""


class Ended(NamedTuple):
    """How a process ended, and what it cost."""

    code: int
    """Exit code."""
    seconds: float
    """From its start to its end."""
    core_seconds: float
    """On the cores, with the processes that it started and waited for; 0 if unknown."""
    errors: str
    """What it wrote to standard error."""


def run_process(words: Sequence[str]) -> Ended:
    """Run a command to its end."""
    before, start = os.times(), time.perf_counter()
    done = subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                          encoding="utf-8", errors="replace", check=False)
    seconds, after = time.perf_counter() - start, os.times()
    on_cores = (after.children_user + after.children_system
                - before.children_user - before.children_system)
    return Ended(done.returncode, seconds, on_cores, done.stderr)


def bench_jobs(captures: Sequence[Path] = (), *, style: str = "fauve", display: str = "generic-4k",
               repeats: int = 1, device: str = "auto", seed: int = 0,
               progress: Progress | None = None,
               run: Callable[[Sequence[str]], Ended] = run_process) -> dict[str, Any]:
    """Make whole portraits and report what each of them cost.

    Parameters
    ----------
    captures : Folders of photos, videos or data sets; by default the demo's built-in head.
    repeats : Runs of each job; the one with the median of the total seconds is reported.
    run : Runs a command.

    Returns
    -------
    figures : ``jobs``: by name, the figures of each job that was made. ``seconds`` has its
        ``total`` (of the whole process), the stages', and those ``outside`` of the stages;
        ``core_seconds`` and ``cores_in_use`` (the former by the seconds) are of the process and
        those it started; ``stages`` has the same of each stage and each of its ``steps`` (of its
        process alone, None where unknown); ``first_look_seconds`` (None where the job tells none),
        ``peak_memory_bytes``, ``folder_bytes``, ``files`` (bytes of each file and folder, the
        largest first), ``photos``, ``given_photos`` (None for data sets), ``psnr`` of the held-out
        photos, ``compiled`` (whether a stage had to compile kernels), ``device``, ``totals`` (the
        total seconds of all runs). ``failed``: by name, why a job failed. Also ``repeats``,
        ``vectors``, ``machine``, and ``device`` and ``peak_memory_bytes`` of all jobs.
    """
    if repeats < 1:
        raise UserError(f"--repeat is {repeats}; it must be at least 1")
    options = ["--style", style, "--display", display, "--device", device, "--seed", str(seed)]
    jobs: dict[str, dict[str, Any]] = {}
    failed: dict[str, str] = {}
    for name, words in _commands(captures).items():
        say(progress, f"job {name}")
        try:
            jobs[name] = _median([_made([*words, *options], run) for _ in range(repeats)])
        except UserError as error:
            failed[name] = str(error)
    return {"jobs": jobs, "failed": failed, "repeats": repeats, "vectors": _vectors(),
            "machine": machine(), "device": next((job["device"] for job in jobs.values()), "cpu"),
            "peak_memory_bytes": max((job["peak_memory_bytes"] for job in jobs.values()),
                                     default=0)}


def _commands(captures: Sequence[Path]) -> dict[str, list[str]]:
    """The words after ``lfportrait`` that make each capture's portrait, by its name.

    Captures whose files have the same name are distinguished by their paths.
    """
    if not captures:
        return {_DEMO: ["demo"]}
    # A data set's pictures often lie in a folder of this name.
    names = [path.parent.name if path.name == "images" else path.name for path in captures]
    counts = Counter(names)
    return {(name if name and counts[name] == 1 else str(path)): ["make", str(path)]
            for name, path in zip(names, captures)}


def _made(words: Sequence[str], run: Callable[[Sequence[str]], Ended]) -> dict[str, Any]:
    """Make a portrait in a folder that is then removed; its figures."""
    with temporary_folder(_ROOM) as folder:
        out, figures = folder / "job", folder / "figures.json"
        ended = run([sys.executable, "-m", "lfportrait", *words, "--quiet", "--out", str(out),
                     "--json", str(figures)])
        if ended.code:
            raise UserError(_why(ended))
        return _job_figures(read_json(figures), ended, _sizes(out))


def _why(ended: Ended) -> str:
    """Why a job failed: its last line on standard error."""
    lines = [line.strip() for line in ended.errors.splitlines() if line.strip()]
    said = [line for line in lines if not line.endswith(_BEFORE)]
    return (said[-1].removeprefix("lfportrait: ") if said
            else f"ended with exit code {ended.code} and said nothing")


def _job_figures(run: dict[str, Any], ended: Ended, files: dict[str, int]) -> dict[str, Any]:
    """The figures of a job, from those that ``run.json`` has."""
    stages = {name: _stage_figures(run[name]) for name in STAGES if name in run}
    seconds = {name: stage["seconds"] for name, stage in stages.items()}
    calibration = run.get("capture", {}).get("calibration", {})
    return {
        "device": run["device"], "style": run["style"], "display": run["display"],
        "photos": run.get("capture", {}).get("views"), "given_photos": calibration.get("photos"),
        "psnr": run.get("reconstruct", {}).get("test", {}).get("psnr"),
        "seconds": {"total": round(ended.seconds, 3), **seconds,
                    "outside": round(ended.seconds - sum(seconds.values()), 3)},
        "first_look_seconds": (run.get("first_look") or {}).get("seconds"),
        "core_seconds": round(ended.core_seconds, 3),
        "cores_in_use": _cores(ended.seconds, ended.core_seconds or None), "stages": stages,
        "compiled": any(_COMPILING in stage["steps"] for stage in stages.values()),
        "peak_memory_bytes": run["peak_memory_bytes"],
        "folder_bytes": sum(files.values()), "files": files}


def _stage_figures(figures: dict[str, Any]) -> dict[str, Any]:
    """Seconds and cores of a stage and its steps."""
    steps = {name: {**step, "cores_in_use": _cores(step["seconds"], step["core_seconds"])}
             for name, step in figures.get("steps", {}).items()}
    on_cores = round(sum(step["core_seconds"] for step in steps.values()), 3) if steps else None
    seconds = figures["stage_seconds"]
    return {"seconds": seconds, "core_seconds": on_cores,
            "cores_in_use": _cores(seconds, on_cores), "steps": steps}


def _cores(seconds: float, core_seconds: float | None) -> float | None:
    """How many cores were busy on average; None where that is unknown."""
    return None if core_seconds is None or seconds <= 0.0 else round(core_seconds / seconds, 2)


def _sizes(folder: Path) -> dict[str, int]:
    """Bytes of each file and folder in a folder, the largest first; folders end with a slash."""
    sizes = {}
    for path in folder.iterdir():
        inner = [path] if path.is_file() else [one for one in path.rglob("*") if one.is_file()]
        sizes[path.name if path.is_file() else f"{path.name}/"] = sum(one.stat().st_size
                                                                      for one in inner)
    return dict(sorted(sizes.items(), key=lambda entry: (-entry[1], entry[0])))


def _median(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """The run with the median of the total seconds (the faster of two), and all of these."""
    totals = [one["seconds"]["total"] for one in runs]
    return {**runs[totals.index(statistics.median_low(totals))], "totals": totals}


def _vectors() -> dict[str, Any]:
    """Vector unit and lanes that kernels use, and what torch uses."""
    import torch  # only now: what this process holds would count as memory of the jobs

    from lfportrait.stylize import has_half_numbers

    unit, lanes = vector_unit()
    return {"unit": unit, "lanes": lanes, "torch": torch.backends.cpu.get_cpu_capability(),
            "bfloat16": has_half_numbers()}


_LONG = 1.0
"""Seconds from which a step is shown."""


def job_tables(figures: dict[str, Any]) -> str:
    """The figures of `bench_jobs` as Markdown tables."""
    parts = [_conditions(figures)]
    if figures["jobs"]:
        parts.append(table(
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
    facts = [f"cores in use: {number(job['cores_in_use'], 2)}", f"device: {job['device']}"]
    if job["psnr"] is not None:
        facts.append(f"held-out photos: {job['psnr']:.2f} dB")
    if job["compiled"]:
        facts.append("kernels were compiled in this run")
    return f"{name}: {'; '.join(facts)}. Steps of more than {_LONG:.0f} s:"


def _steps(job: dict[str, Any]) -> str:
    """A job's long steps, and what lies outside of its stages."""
    rows = [[stage, step, _seconds(cost["seconds"]), number(cost["cores_in_use"], 2)]
            for stage, found in job["stages"].items() for step, cost in found["steps"].items()
            if cost["seconds"] > _LONG]
    if job["seconds"]["outside"] > _LONG:
        rows.append(["-", "outside of the stages", _seconds(job["seconds"]["outside"]), "-"])
    return table(["stage", "step", "time", "cores in use"], rows)


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{number(value, 1)} s"
