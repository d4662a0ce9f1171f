"""The run: every sitter in every style by every method, each step resumable.

It is a plan of tasks (`lfportrait.runner`), run in this process. A cell is two of them: its views
are painted, then measured. Those that are done are skipped, so a run that is killed is resumed, and
one that is asked for more sitters, styles or methods does only what is new. The measures are tasks
of their own: when weights of a network arrive, nothing is painted again.

Table 1 (the mask guide) and Fig. 6 (transfer by example) report speed, as the paper does.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lfportrait import models
from lfportrait.cache import StageFolder, check_writable, key_of
from lfportrait.capture import Capture
from lfportrait.errors import UserError
from lfportrait.example import Exemplar
from lfportrait.field import ReconstructConfig, VoxelField
from lfportrait.files import read_json, write_image
from lfportrait.measure import machine
from lfportrait.progress import Progress
from lfportrait.runner import (
    Costs,
    Here,
    Need,
    Outcome,
    Plan,
    Task,
    failure_of,
    finished,
    run_tasks,
)
from lfportrait.version import __version__

from ..baselines.config import NetworkConfig
from ..bench import METHODS as TRANSFERS
from ..bench import bench_masks, bench_transfer
from ..metrics.job import without_nan
from .documents import Cell, write_documents
from .figures import Target, agreement, measure, photo_agreement
from .methods import (
    METHODS,
    SHOWN,
    Opener,
    Sitter,
    Sizes,
    Source,
    TablesConfig,
    Views,
    field_config,
    field_of,
    linked,
    own_parameters,
    paint_views,
    real_views,
    view_config,
)

CellName = tuple[str, str, str]
"""Sitter, style, method."""


class Teller:
    """The progress of a run whose cells ``waiting`` are to be done; it may be silent."""

    def __init__(self, progress: Progress | None, waiting: Sequence[CellName]) -> None:
        self._progress, self._waiting = progress, list(waiting)
        self._total = len(self._waiting)
        self._costs = Costs()

    def say(self, text: str) -> None:
        """Show what is being done, behind what is left."""
        if self._progress is not None:
            self._progress.update(0, "; ".join(filter(None, [self._left(), text])))

    def _left(self) -> str:
        """How much is done and, once it can be estimated, how long the rest takes."""
        done, seconds = self._total - len(self._waiting), self.seconds_left()
        rest = f", about {max(seconds / 60, 1):.0f} min left" if seconds else ""
        return f"{done} of {self._total}{rest}" if self._total else ""

    def inside(self, title: str) -> Progress:
        """A progress line for a part: what it shows stands behind ``title`` on this one."""
        return _Inside(title, self)

    def done(self, cell: CellName, seconds: float) -> None:
        """A cell is done, in so many seconds."""
        self._costs.learn(cell[2], Need(seconds))
        self._finish(cell, f"{seconds:.0f} s")

    def failed(self, cell: CellName, reason: str) -> None:
        """A cell can't be done."""
        self._finish(cell, f"not measured: {reason}")

    def _finish(self, cell: CellName, text: str) -> None:
        self._waiting.remove(cell)
        if self._progress is not None:
            self._progress.say(f"{', '.join(cell)}: {text}; {self._left()}")

    def seconds_left(self) -> float:
        """Estimated time of the waiting cells: by the mean of their method, else of all."""
        return sum(self._costs.need(cell[2]).seconds for cell in self._waiting)


class _Inside(Progress):
    """A progress whose notes go to a teller."""

    def __init__(self, title: str, teller: Teller) -> None:
        super().__init__(title, enabled=False)
        self._teller = teller

    def update(self, done: int, note: str = "") -> None:
        """Pass the note on."""
        self.done = done
        self._teller.say(f"{self.title}: {note}" if note else self.title)


def speed_tables(sitter: Sitter, exemplar: Exemplar, sizes: Sizes, size: str,
                 progress: Progress | None) -> dict[str, Any]:
    """Measure the coding with and without the mask guide, and all methods of transfer.

    The photo is the embedded head, 768 x 1024, as the paper's pictures. The shortest of some runs
    counts: ``quick`` codes twice and transfers once.

    Returns
    -------
    figures : ``table_1``: a row by resolution. ``fig_6``: by method of transfer
        ``precalculation_seconds`` and ``synthesis_seconds`` (guides and synthesis of one picture),
        and ``whole_seconds``, both for all views that a field is fitted to; ``views``, how many.
    """
    repeats = 1 if size == "quick" else 3
    # Coding is fast; a single run would measure the machine's noise rather than the mask.
    masks = bench_masks(sitter.field, repeats=repeats + 1, progress=progress)
    found = bench_transfer(exemplar=exemplar, repeats=repeats, progress=progress,
                           network=NetworkConfig(pairs=sizes.network_pairs,
                                                 budget=sizes.network_seconds,
                                                 device=sitter.device))
    views = 3 * sizes.painted_views
    rows = {}
    for method in TRANSFERS:
        row = found[method]
        once = row.get("published_table_seconds", row["precalculation_seconds"])
        each = row["guides_seconds"] + row["synthesis_seconds"]
        rows[method] = {"precalculation_seconds": row["precalculation_seconds"],
                        "published_seconds": row.get("published_table_seconds"),
                        "synthesis_seconds": each, "patch_fidelity": row["patch_fidelity"],
                        "whole_seconds": once + views * each}
    return {"table_1": masks, "fig_6": rows, "fig_6_views": views}


def write_tables(sources: Sequence[Source], exemplars: Sequence[Exemplar], out: Path,
                 config: TablesConfig | None = None, *, open_capture: Opener = Capture.load,
                 seed: int = 0, progress: Progress | None = None,
                 device: str = "auto") -> dict[str, Any]:
    """Compare methods on sitters (`sources_of`) and styles as in the paper, and write the tables.

    Parameters
    ----------
    out : Folder for ``tables.md``, ``tables.csv``, ``tables.json``, ``index.html``; what was done
        is kept there, too.
    open_capture : Makes a capture of what a sitter's source names.

    Returns
    -------
    figures : Those of ``tables.json``: ``cells``, ``floors``, ``summary`` (mean, deviation and
        number by method and figure), ``not_measured`` with reasons, ``table_1``, ``fig_6``.
    """
    config = config or TablesConfig()
    config.check()
    names = [exemplar.name for exemplar in exemplars]
    if not names:
        raise UserError("name the styles: --styles PAINTING ...")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UserError(f"two styles are called {twice!r}; rename a file")
    check_writable(out)
    return _Run(sources, exemplars, out, config, open_capture, seed, progress, device).all()


def _networks(group: Sequence[str]) -> list[str]:
    """Which of these networks are at hand: what is computed with them depends on it."""
    return [name for name in group if models.available(name)]


@dataclass(frozen=True)
class Step(Task):
    """A task of the comparison, named as its record."""

    source: Source  # The sitter.
    # style, method: Names, of a cell's tasks.
    style: str = ""
    method: str = ""

    @property
    def cell(self) -> CellName:
        """The cell that it belongs to."""
        return self.source.name, self.style, self.method


class _Run:
    """One run of `write_tables`."""

    def __init__(self, sources: Sequence[Source], exemplars: Sequence[Exemplar], out: Path,
                 config: TablesConfig, open_capture: Opener, seed: int,
                 progress: Progress | None, device: str) -> None:
        self.sources, self.exemplars, self.out = sources, {one.name: one for one in exemplars}, out
        self.config, self.sizes, self.seed = config, config.all_sizes(), seed
        self.open_capture, self.progress, self.device = open_capture, progress, device
        self.folder = StageFolder(out)
        self.measuring = tuple(models.GROUPS["evaluate"])
        self.keys = {source.name: source.key() for source in sources}
        self.plan = Plan[Step]({step.name: step for step in self._steps()})
        self.figures: dict[str, dict[str, Any]] = {}
        self.failures: list[dict[str, str]] = []
        self.fault: Exception | None = None
        # The last ones alone: a sitter has views and surface in memory.
        self.sitter = functools.lru_cache(1)(self._sitter)
        self.target = functools.lru_cache(1)(self._target)

    def all(self) -> dict[str, Any]:
        """Do what is not done, and write the tables."""
        cells = [step for step in self.plan.tasks.values() if step.stage == "measure"]
        done = self.plan.done(self.out)
        left = [cell for cell in cells if not {cell.name, cell.needs[0]} <= done]
        done -= {cell.name for cell in left}  # one whose views are missing is painted again
        self.figures = {name: finished(self.plan.tasks[name], self.out) or {} for name in done}
        if self.config.done_only and len(left) == len(cells):
            raise UserError(f"nothing of this comparison is done in {self.out}; run it without "
                            "--done-only")
        self.teller = Teller(self.progress, [cell.cell for cell in left])
        if self.config.done_only:
            for cell in left:
                self._missing(cell, "not run yet")
        else:
            run_tasks(self.plan.to_do(done), Here(self._do), self._heard)
        figures = self._documents(pictures=True)
        if self.fault is not None:
            raise self.fault
        return figures

    def _do(self, step: Step) -> Outcome:
        """Do a task; a cell that fails leaves the others alone."""
        try:
            return Outcome(step.name, figures=self.folder.run(
                step.record, step.key, step.outputs,
                functools.partial(getattr(self, f"_{step.stage}"), step)))
        except Exception as error:
            if not step.method:
                raise
            failure = failure_of(error)
            if failure.code == "internal":
                # Hours of work don't end at one cell's fault; it is raised when all is written.
                self.fault = self.fault or error
            return Outcome.failed(step.name, failure)

    def _heard(self, step: Step, outcome: Outcome | None) -> None:
        """Note how a task ended."""
        if outcome is None:
            return
        if outcome.error:
            self._missing(step, outcome.error)
            self.teller.failed(step.cell, outcome.error)
            return
        self.figures[step.name] = outcome.figures
        if step.stage == "measure":
            self.teller.done(step.cell, sum(self.figures[name]["stage_seconds"]
                                            for name in (step.needs[0], step.name)))
            # What is done so far can be read while the rest goes on.
            self._documents(pictures=False)

    def _missing(self, step: Step, reason: str) -> None:
        self.failures.append(dict(zip(("sitter", "style", "method"), step.cell, strict=True),
                                  reason=reason))

    # -- the plan ---------------------------------------------------------------------------------

    def _steps(self) -> Iterator[Step]:
        """All tasks, each after those that it needs."""
        for source in self.sources:
            own, key = source.name, self.keys[source.name]
            capture, field = f"capture.{own}", f"field.{own}"
            yield Step(capture, "capture", "", (f"sitters/{own}/capture",), key, (), source)
            yield Step(field, "field", "", (f"sitters/{own}/field.npz",),
                       key_of(__name__, "field", key, self.seed), (capture,), source)
            yield Step(f"floor.{own}", "floor", "", (f"pictures/{own}/photo.png",),
                       key_of(__name__, "figures", "floor", self._base(source),
                              _networks(self.measuring)), (capture, field), source)
            for style in self.exemplars:
                # The other reference of Table 2 comes first.
                for method in sorted(self.config.chosen(), key=lambda name: name != "views"):
                    cell, name = (source, style, method), f"{own}.{style}.{method}"
                    place, painted = f"{own}/{style}/{method}", self._paint_key(*cell)
                    yield Step(f"paint.{name}", "paint", "",
                               (f"views/{place}.npz", f"pictures/{place}.png"), painted,
                               (capture, field), *cell)
                    yield Step(f"measure.{name}", "measure", "", (), key_of(
                        __name__, "figures", painted, "views" in self.config.chosen(),
                        self.sizes.crops, _networks([*self.measuring, "face-landmarker", "vgg16"]),
                    ), (f"paint.{name}", capture, field), *cell)
        if self.config.speed:
            source = self.sources[0]
            yield Step("speed", "speed", "", (), key_of(
                __name__, "speed", self._base(source), next(iter(self.exemplars.values())).image,
                self.config.size, machine()), (f"capture.{source.name}", f"field.{source.name}"),
                source)

    def _base(self, source: Source) -> str:
        """Key of all that depends on the sitter and on the views."""
        return key_of(__name__, "sitters", self.keys[source.name], self.sizes.pixels,
                      self.sizes.render_size, self.sizes.close_size, self.config.views,
                      self.config.cone, self.seed)

    def _paint_key(self, source: Source, style: str, method: str) -> str:
        chosen = (own_parameters(method, field_config(method, self.config.stylize, self.sizes,
                                                      self.seed))
                  if METHODS[method].kind == "field"
                  else view_config(method, self.sizes, self.seed))
        others = [name for name in models.REGISTRY if name not in self.measuring]
        exemplar = self.exemplars[style]
        return key_of(__name__, "painting", self._base(source), exemplar.image,
                      exemplar.landmarks, method, chosen, _networks(others))

    # -- the work ---------------------------------------------------------------------------------

    def _sitter(self, source: Source) -> Sitter:
        """A sitter's capture and field, which are there."""
        home = self.out / "sitters" / source.name
        file = home / "field.npz"
        return Sitter(source.name, VoxelField.load(file), Capture.load(home / "capture"), file,
                      pixels=self.sizes.pixels,
                      arc=(self.config.cone, self.config.views, self.sizes.render_size),
                      close_size=self.sizes.close_size, device=self.device)

    def _target(self, source: Source, style: str) -> Target:
        return Target(self.sitter(source), self.exemplars[style], self.sizes.crops, self.seed)

    def _capture(self, step: Step) -> dict[str, Any]:
        self.teller.say(f"{step.source.name}: capture and field")
        capture = self.open_capture(step.source.capture)
        capture.save(self.out / step.outputs[0])
        return {"photos": len(capture)}

    def _field(self, step: Step) -> dict[str, Any]:
        source, file = step.source, self.out / step.outputs[0]
        if source.field is not None:
            linked(source.field, file)
            return {}
        return field_of(Capture.load(file.with_name("capture")), file,
                        ReconstructConfig(resolution=256, seed=self.seed),
                        self.teller.inside(f"{source.name}: field"))

    def _floor(self, step: Step) -> dict[str, Any]:
        """What the real field and the photos reach by the measure of consistency."""
        one = self.sitter(step.source)
        self.teller.say(f"{step.source.name}: the field before style, the photos")
        start = time.perf_counter()
        skin = one.skin
        seconds = round(time.perf_counter() - start, 3)
        real = real_views(one)
        write_image(self.out / step.outputs[0], _strip(real))
        degrees = self.config.cone / (self.config.views - 1)
        return {"field": without_nan(agreement(real, one)),
                "photos": photo_agreement(one.field, one.capture, {
                    "short": degrees, "long": 7 * degrees}, self.sizes.render_size, self.device),
                "content_network": "vgg16" if models.available("vgg16") else "embedded",
                "skin_seconds": seconds, "skin_pixels": len(skin.index)}

    def _paint(self, step: Step) -> dict[str, Any]:
        views, figures = paint_views(
            step.method, self.sitter(step.source), self.exemplars[step.style], self.sizes,
            self.config.stylize, self.seed, self.teller.inside(", ".join(step.cell)))
        views.save(self.out / step.outputs[0])
        write_image(self.out / step.outputs[1], _strip(views))
        return figures

    def _measure(self, step: Step) -> dict[str, Any]:
        folder = self.out / "views" / step.source.name / step.style
        example = f"paint.{step.source.name}.{step.style}.views" in self.figures
        say = self.teller.inside(", ".join(step.cell))
        return measure(Views.load(folder / f"{step.method}.npz"),
                       self.target(step.source, step.style),
                       Views.load(folder / "views.npz") if example else None,
                       lambda text: say.update(0, text))

    def _speed(self, step: Step) -> dict[str, Any]:
        """Table 1 and Fig. 6, of the first sitter in the first style."""
        return speed_tables(self.sitter(step.source), next(iter(self.exemplars.values())),
                            self.sizes, self.config.size, self.teller.inside("speed"))

    # -- the tables -------------------------------------------------------------------------------

    def _cells(self) -> list[Cell]:
        """The cells that are done, in the order in which they were asked for."""
        names = [(source.name, style, method) for source in self.sources
                 for style in self.exemplars for method in self.config.chosen()]
        return [_cell(name, self.figures[f"measure.{'.'.join(name)}"],
                      self.figures[f"paint.{'.'.join(name)}"]) for name in names
                if f"measure.{'.'.join(name)}" in self.figures]

    def _documents(self, *, pictures: bool) -> dict[str, Any]:
        floors = {source.name: self.figures[f"floor.{source.name}"] for source in self.sources
                  if f"floor.{source.name}" in self.figures}
        facts = {"version": __version__, "machine": machine(), "seed": self.seed,
                 "sizes": self.sizes, "size": self.config.size, "views": self.config.views,
                 "cone": self.config.cone, "sitters": [source.name for source in self.sources],
                 "styles": [*self.exemplars],
                 "methods": {name: METHODS[name].what for name in self.config.chosen()},
                 "content_network": "vgg16" if models.available("vgg16") else "embedded",
                 "skin_seconds": {name: row["skin_seconds"] for name, row in floors.items()}}
        study = None
        if self.config.study is not None and pictures:
            study = read_json(self.config.study / "results.json")
        return write_documents(
            self.out, facts, self._cells(), floors, self.figures.get("speed", {}), study,
            self.failures, {name: one.image for name, one in self.exemplars.items()}
            if pictures else None)


def _strip(views: Views) -> Any:
    """The close views that are shown, side by side."""
    return np.concatenate([views.close[view] for view in SHOWN], axis=1)


def _cell(name: CellName, figures: dict[str, Any], facts: dict[str, Any]) -> Cell:
    """A cell of the tables from the records of its tasks."""
    values = {name: value for name, value in figures.items() if name != "stage_seconds"}
    values |= {"seconds_once": facts["seconds"]["once"], "seconds_view": facts["seconds"]["view"],
               "memory": facts["peak_memory_bytes"] / 2 ** 30}
    return Cell(*name, values, facts)
