"""The task graph of a job: stages with their inputs, outputs, costs and completion.

There is one definition of each stage (`STAGES`): its name, the line that people see, the kernels
that it waits for, and what it takes.
`lfportrait make` is one portrait's tasks in its own process (`pipeline`), a batch is those of many
on many processes or machines (`batch`); an app that shows how far a portrait is asks the same plan.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import models
from ..cache import key_of
from ..lightfield import Display
from ..stages import finished_record
from .steps import MakeConfig

__all__ = ["STAGES", "Need", "Plan", "Stage", "Task", "capture_key", "code_key", "field_key",
           "finished", "page_key", "share_key", "skin_key", "stage_key", "style_key", "sweep_key"]

_MB = 1_000_000


@dataclass(frozen=True)
class Need:
    """Resources of a stage's task.

    Attributes
    ----------
    core_seconds
        Time on one core; a task on several is taken to be done sooner in proportion.
    memory
        Peak of its process in bytes.
    disk
        Bytes that it writes.
    """

    core_seconds: float
    memory: int
    disk: int


@dataclass(frozen=True)
class Stage:
    """A kind of tasks.

    Attributes
    ----------
    title
        What people see while it runs.
    need
        What it takes, before any task of it was measured: on one core on the demo's head at its
        full size, on a 4K panel, and rounded up.
    kernels
        What of `Warmup` it waits for.
    """

    title: str
    need: Need
    kernels: tuple[str, ...] = ()


STAGES = {
    "capture": Stage("capture", Need(2.0, 300 * _MB, 7 * _MB)),
    "field": Stage("reconstruct", Need(68.0, 1200 * _MB, 54 * _MB),
                   ("reconstruct",)),
    "skin": Stage("surface", Need(12.0, 1100 * _MB, 17 * _MB),
                  ("transfer",)),
    "stylize": Stage("stylize", Need(39.0, 2100 * _MB, 27 * _MB),
                     ("transfer", "stylize")),
    "encode": Stage("encode", Need(12.0, 1600 * _MB, 6 * _MB),
                    ("encode",)),
    "page": Stage("page", Need(6.0, 1600 * _MB, 5 * _MB)),
    "sweep": Stage("sweep", Need(29.0, 1600 * _MB, 1 * _MB)),
    "share": Stage("share", Need(40.0, 2000 * _MB, 12 * _MB)),
}
"""By name, in the order of the work; ``share`` is page, sweep and report together."""


def stage_key(stage: str, *parts: Any) -> str:
    """Key of what a stage makes from ``parts``: parameters and the keys of what it reads."""
    return key_of(__name__, stage, *parts)


def capture_key(source: str, config: MakeConfig, seed: int) -> str:
    """Key of a capture made from files with the hash ``source``."""
    return stage_key("capture", source, config.calibrate, config.keep_background,
                     config.made_from, seed)


def field_key(capture: str, config: MakeConfig) -> str:
    """Key of the field of a capture with the key ``capture``."""
    return stage_key("field", capture, config.reconstruct, models.in_use(["head"]))


def skin_key(field: str, pixels: float) -> str:
    """Key of the surface of the field with the key ``field``, at a resolution."""
    return stage_key("skin", field, pixels)


def style_key(field: str, config: MakeConfig, painting: tuple[str, str]) -> str:
    """Key of the field with the key ``field``, stylised by an exemplar (`painting_key`)."""
    return key_of(config.stylize.maker, field, config.stylize, *painting)


def code_key(style: str, config: MakeConfig, display: Display) -> str:
    """Key of the styled field with the key ``style``, coded for a display."""
    return stage_key("encode", style, config.encode, display)


def _ground(config: MakeConfig) -> tuple[object, ...]:
    """What the ground of page and sweep depends on."""
    shown = config.encode
    return shown.background, shown.ground, shown.ground_depth, shown.shadow


def page_key(style: str, config: MakeConfig) -> str:
    """Key of its page."""
    return stage_key("page", style, config.page, *_ground(config))


def sweep_key(style: str, config: MakeConfig, display: Display | None) -> str:
    """Key of its sweep over a display's cone."""
    return stage_key("sweep", style, config.sweep_size, display and display.cone,
                     *_ground(config))


def share_key(code: str, config: MakeConfig) -> str:
    """Key of page, sweep and report of what is coded with the key ``code``."""
    return stage_key("share", code, config.sweep_size, config.page)


@dataclass(frozen=True)
class Task:
    """One stage of one portrait: files in, files out.

    Attributes
    ----------
    name
        Its place in the plan: ``STAGE``, ``SITTER/STAGE`` or ``SITTER/STYLE/STAGE``.
    stage
        One of `STAGES`.
    folder
        Where it writes, relative to the results.
    outputs
        What it writes there.
    key
        Hash of all that the outputs depend on.
    needs
        Names of the tasks whose outputs it reads.
    config, seed
        Parameters.
    inputs
        What it reads, by kind (capture, field, skin, styled), relative to the results.
    source
        What it reads that no task makes: photos, painting.
    display
        What is coded for; the sweep's angle is its, too.
    skin_key
        Key of the skin that is painted; empty where none is.
    label
        What the file calls it: style, display, file name.
    device
        Where to compute, a choice of ``--device``; no part of the key.
    """

    name: str
    stage: str
    folder: str
    outputs: tuple[str, ...]
    key: str
    needs: tuple[str, ...]
    config: MakeConfig
    seed: int
    inputs: dict[str, str] = field(default_factory=dict)
    source: str = ""
    display: Display | None = None
    skin_key: str = ""
    label: str = ""
    device: str = "auto"

    @property
    def record(self) -> str:
        """Name of its record in the folder."""
        return self.name.rpartition("/")[2]

    @property
    def sitter(self) -> str:
        """Whose portrait it is."""
        return self.name.partition("/")[0]


@dataclass
class Plan:
    """Tasks, each after those that it needs.

    Attributes
    ----------
    tasks
        By name.
    refused
        Sitters whose photos can't be used at all, and why.
    """

    tasks: dict[str, Task] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)

    def wanted(self) -> list[Task]:
        """The tasks that nothing else needs: what the user gets."""
        needed = {need for task in self.tasks.values() for need in task.needs}
        return [task for task in self.tasks.values() if task.name not in needed]

    def before(self, names: Iterable[str]) -> set[str]:
        """These tasks and all that they need."""
        found: set[str] = set()
        left = list(names)
        while left:
            name = left.pop()
            if name not in found:
                found.add(name)
                left += self.tasks[name].needs
        return found

    def done(self, results: Path) -> set[str]:
        """Names of the tasks that were done before, from the same inputs."""
        return {name for name, task in self.tasks.items() if finished(task, results) is not None}

    def to_do(self, done: set[str]) -> list[Task]:
        """The tasks that are left, where these are done: what leads to something missing."""
        lacking: set[str] = set()
        left = [task.name for task in self.wanted() if task.name not in done]
        while left:
            name = left.pop()
            if name not in lacking:
                lacking.add(name)
                left += [need for need in self.tasks[name].needs if need not in done]
        return [task for name, task in self.tasks.items() if name in lacking]


def finished(task: Task, results: Path) -> dict[str, Any] | None:
    """The figures of a task whose outputs are there, made from the same inputs; else None."""
    return finished_record(results / task.folder, task.record, task.key, task.outputs)
