"""The task graph of a job: stages with their inputs, outputs, costs and completion.

There is one definition of each stage (`STAGES`): its name, the line that people see, the kernels
that it waits for, and what it takes.
`lfportrait make` is one portrait's tasks in its own process (`pipeline`), a batch is those of many
on many processes or machines (`batch`); an app that shows how far a portrait is asks the same plan.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .. import models
from ..cache import key_of
from ..lightfield import Display
from ..runner import Need, graph
from .steps import MakeConfig

__all__ = ["STAGES", "Stage", "Task", "capture_key", "code_key", "field_key", "page_key",
           "portrait_tasks", "share_key", "skin_key", "stage_key", "style_key", "sweep_key"]

_MB = 1_000_000


@dataclass(frozen=True)
class Stage:
    """A kind of tasks.

    Attributes
    ----------
    title
        What people see while it runs.
    need
        What it takes on one core, before any task of it was measured: on the demo's head at its
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
class Task(graph.Task):
    """One stage of one portrait; named ``STAGE``, ``SITTER/STAGE`` or ``SITTER/STYLE/STAGE``.

    Attributes
    ----------
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

    config: MakeConfig
    seed: int
    inputs: dict[str, str] = field(default_factory=dict)
    source: str = ""
    display: Display | None = None
    skin_key: str = ""
    label: str = ""
    device: str = "auto"

    @property
    def sitter(self) -> str:
        """Whose portrait it is."""
        return self.name.partition("/")[0]


_WORK = {"capture": ("capture", ("capture",)), "reconstruct": ("field", ("field.npz",)),
         "stylize": ("stylize", ("styled.npz",)), "encode": ("encode", ("lightfield.png",)),
         "share": ("share", ("portrait.html", "sweep.mp4", "report.html"))}
"""The tasks of one portrait, in order: the stage and the files of each."""


def portrait_tasks(keys: Mapping[str, str], config: MakeConfig, seed: int = 0, *,
                   folders: Mapping[str, str] | None = None, **more: Any) -> list[Task]:
    """The tasks of one portrait, as `lfportrait make` and the studio do them.

    Parameters
    ----------
    keys
        Of the tasks that are wanted: of some of capture, reconstruct, stylize, encode and share.
    config, seed
        Parameters.
    folders
        Where each writes, relative to the results, where that is not the results' folder itself.
    more
        Further arguments of all tasks.
    """
    names = [name for name in _WORK if name in keys]
    return [Task(name, _WORK[name][0], (folders or {}).get(name, ""), _WORK[name][1], keys[name],
                 tuple(names[:place]), config, seed, **more) for place, name in enumerate(names)]
