"""The run: every sitter in every style by every method, each step resumable.

A cell is two stages: its views are painted, then measured. Cells that are done are skipped, so a
run that is killed is resumed, and one that is asked for more sitters, styles or
methods does only what is new. The measures are a stage of their own: when weights of a network
arrive, nothing is painted again.

Table 1 (the mask guide) and Fig. 6 (transfer by example) report speed, as the paper does.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lfportrait import models
from lfportrait.cache import key_of
from lfportrait.capture import Capture
from lfportrait.errors import UserError
from lfportrait.example import Exemplar
from lfportrait.field import ReconstructConfig, VoxelField
from lfportrait.files import read_json, write_image
from lfportrait.measure import machine
from lfportrait.progress import Progress
from lfportrait.runner import Costs, Need, failure_of
from lfportrait.stages import StageFolder, check_writable, finished_record
from lfportrait.version import __version__

from ..baselines.config import NetworkConfig
from ..bench import METHODS as TRANSFERS
from ..bench import bench_masks, bench_transfer
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
    """The progress of a run.

    Parameters
    ----------
    progress : The line that is drawn; None for silence.
    waiting : Cells that are to be done.
    """

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
        """A cell is done, in so many seconds; one that was done before does not count."""
        if cell in self._waiting:
            self._costs.learn(cell[2], Need(seconds))
            self._finish(cell, f"{seconds:.0f} s")

    def failed(self, cell: CellName, reason: str) -> None:
        """A cell can't be done."""
        if cell in self._waiting:
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

    Parameters
    ----------
    sitter : Whose field is coded.
    exemplar : The style of the transfers; their photo is the embedded head, 768 x 1024, as the
        paper's pictures.
    sizes, size : Of this run; the shortest of some runs counts: ``quick`` codes twice and transfers
        once.
    progress : Updated with what is being measured.

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
    """Compare methods as in the paper, and write the tables.

    Parameters
    ----------
    sources
        The sitters (`sources_of`).
    exemplars
        The styles.
    out
        Folder for ``tables.md``, ``tables.csv``, ``tables.json``, ``index.html``; what was done is
        kept there, too.
    config
        Methods and sizes.
    open_capture
        Makes a capture of what a sitter's source names.
    seed
        Of all random choices.
    progress
        Progress line.
    device
        Where networks compute, a choice of ``--device``.

    Returns
    -------
    figures
        Those of ``tables.json``: ``cells``, ``floors``, ``summary`` (mean, deviation and number by
        method and figure), ``not_measured`` with reasons, ``table_1``, ``fig_6``.

    Raises
    ------
    UserError
        If parameters make no sense, or a sitter has no landmarks.
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


class _Run:
    """One run of `write_tables`."""

    def __init__(self, sources: Sequence[Source], exemplars: Sequence[Exemplar], out: Path,
                 config: TablesConfig, open_capture: Opener, seed: int,
                 progress: Progress | None, device: str) -> None:
        self.sources, self.exemplars, self.out = sources, exemplars, out
        self.config, self.sizes, self.seed = config, config.all_sizes(), seed
        self.open_capture, self.progress, self.device = open_capture, progress, device
        self.folder = StageFolder(out)
        self.measuring = tuple(models.GROUPS["evaluate"])
        self.keys: dict[str, str] = {}
        self.failures: list[dict[str, str]] = []
        self.fault: Exception | None = None

    def all(self) -> dict[str, Any]:
        """Do what is not done, and write the tables."""
        methods = self.config.chosen()
        self.keys = {source.name: source.key() for source in self.sources}
        steps = [(source, exemplar) for source in self.sources for exemplar in self.exemplars]
        if self.config.done_only and not any(
                self._record(*step, method) for step in steps for method in methods):
            raise UserError(f"nothing of this comparison is done in {self.out}; run it without "
                            "--done-only")
        self.teller = Teller(self.progress, [
            (source.name, exemplar.name, method) for source, exemplar in steps
            for method in methods if not self.config.done_only
            and self._record(source, exemplar, method) is None])
        floors: dict[str, dict[str, Any]] = {}
        cells: list[Cell] = []
        for source in self.sources:
            sitter = functools.cache(functools.partial(self._sitter, source))
            floor = self._floor(source, sitter)
            if floor is not None:
                floors[source.name] = floor
            for exemplar in self.exemplars:
                cells += self._style(source, sitter, exemplar, methods)
                # What is done so far can be read while the rest goes on.
                self._documents(cells, floors, {}, pictures=False)
        speed = self._speed() if self.config.speed else {}
        figures = self._documents(cells, floors, speed, pictures=True)
        if self.fault is not None:
            raise self.fault
        return figures

    def _base(self, source: Source) -> str:
        """Key of all that depends on the sitter and on the views."""
        return key_of(__name__, "sitters", self.keys[source.name], self.sizes.pixels,
                      self.sizes.render_size, self.sizes.close_size, self.config.views,
                      self.config.cone, self.seed)

    def _paint_key(self, source: Source, exemplar: Exemplar, method: str) -> str:
        chosen = (own_parameters(method, field_config(method, self.config.stylize, self.sizes,
                                                      self.seed))
                  if METHODS[method].kind == "field"
                  else view_config(method, self.sizes, self.seed))
        others = [name for name in models.registry() if name not in self.measuring]
        return key_of(__name__, "painting", self._base(source), exemplar.image,
                      exemplar.landmarks, method, chosen, _networks(others))

    def _measure_key(self, source: Source, exemplar: Exemplar, method: str) -> str:
        return key_of(__name__, "figures", self._paint_key(source, exemplar, method),
                      "views" in self.config.chosen(), self.sizes.crops,
                      _networks([*self.measuring, "face-landmarker", "vgg16"]))

    def _record(self, source: Source, exemplar: Exemplar, method: str) -> dict[str, Any] | None:
        """The figures of a finished cell, or None."""
        return finished_record(self.out, f"measure.{source.name}.{exemplar.name}.{method}",
                               self._measure_key(source, exemplar, method), [])

    def _sitter(self, source: Source) -> Sitter:
        """Open capture and field, once; both are kept."""
        home = f"sitters/{source.name}"
        self.teller.say(f"{source.name}: capture and field")
        self.folder.run(f"capture.{source.name}", self.keys[source.name], [f"{home}/capture"],
                        lambda: self._keep_capture(source, self.out / home / "capture"))
        capture = Capture.load(self.out / home / "capture")
        file = self.out / home / "field.npz"

        def field() -> dict[str, Any]:
            if source.field is not None:
                linked(source.field, file)
                return {}
            return field_of(capture, file, ReconstructConfig(resolution=256, seed=self.seed),
                            self.teller.inside(f"{source.name}: field"))

        key = key_of(__name__, "field", self.keys[source.name], self.seed)
        self.folder.run(f"field.{source.name}", key, [f"{home}/field.npz"], field)
        return Sitter(source.name, VoxelField.load(file), capture, file, pixels=self.sizes.pixels,
                      arc=(self.config.cone, self.config.views, self.sizes.render_size),
                      close_size=self.sizes.close_size, device=self.device)

    def _keep_capture(self, source: Source, target: Path) -> dict[str, Any]:
        capture = self.open_capture(source.capture)
        capture.save(target)
        return {"photos": len(capture)}

    def _floor(self, source: Source, sitter: Callable[[], Sitter]) -> dict[str, Any] | None:
        """What the real field and the photos reach by the measure of consistency.

        None where that is not done and nothing new is to be started.
        """
        def found() -> dict[str, Any]:
            one = sitter()
            self.teller.say(f"{source.name}: the field before style, the photos")
            start = time.perf_counter()
            skin = one.skin
            seconds = round(time.perf_counter() - start, 3)
            real = real_views(one)
            write_image(self.out / "pictures" / source.name / "photo.png", _strip(real))
            step = self.config.cone / (self.config.views - 1)
            return {"field": _plain(agreement(real, one)),
                    "photos": photo_agreement(one.field, one.capture, {
                        "short": step, "long": 7 * step}, self.sizes.render_size,
                        self.device),
                    "content_network": "vgg16" if models.available("vgg16") else "embedded",
                 "skin_seconds": seconds, "skin_pixels": len(skin.index)}

        key = key_of(__name__, "figures", "floor", self._base(source),
                     _networks(self.measuring))
        name, picture = f"floor.{source.name}", f"pictures/{source.name}/photo.png"
        if self.config.done_only:
            return finished_record(self.out, name, key, [picture])
        return self.folder.run(name, key, [picture], found)

    def _style(self, source: Source, sitter: Callable[[], Sitter], exemplar: Exemplar,
               methods: Sequence[str]) -> list[Cell]:
        """All methods for one sitter in one style."""
        target = functools.cache(lambda: Target(sitter(), exemplar, self.sizes.crops,
                                                self.seed))
        cells = {}
        # The other reference of Table 2 comes first.
        example = False
        for method in sorted(methods, key=lambda name: name != "views"):
            if self.config.done_only and self._record(source, exemplar, method) is None:
                self._missing(source, exemplar, method, "not run yet")
                continue
            facts = self._attempt(source, exemplar, method, functools.partial(
                self._painted, source, sitter, exemplar, method))
            example = example or (method == "views" and facts is not None)
            figures = None if facts is None else self._attempt(
                source, exemplar, method, functools.partial(
                    self._measured, source, exemplar, method, target, example))
            if facts is not None and figures is not None:
                cells[method] = _cell(source, exemplar, method, figures, facts)
                self.teller.done((source.name, exemplar.name, method),
                                 facts["stage_seconds"] + figures["stage_seconds"])
        return [cells[method] for method in methods if method in cells]

    def _attempt(self, source: Source, exemplar: Exemplar, method: str,
                 function: Callable[[], dict[str, Any]]) -> dict[str, Any] | None:
        """Do a stage of a cell; if it fails, report why and continue with the others."""
        cell = source.name, exemplar.name, method
        try:
            return function()
        except Exception as error:
            failure = failure_of(error)
            if failure.code == "internal":
                # Hours of work don't end at one cell's fault; it is raised when all is written.
                self.fault = self.fault or error
            reason = failure.message
        self._missing(source, exemplar, method, reason)
        self.teller.failed(cell, reason)
        return None

    def _missing(self, source: Source, exemplar: Exemplar, method: str, reason: str) -> None:
        self.failures.append({"sitter": source.name, "style": exemplar.name, "method": method,
                              "reason": reason})

    def _painted(self, source: Source, sitter: Callable[[], Sitter], exemplar: Exemplar,
                 method: str) -> dict[str, Any]:
        name = f"{source.name}/{exemplar.name}/{method}"

        def paint() -> dict[str, Any]:
            views, figures = paint_views(
                method, sitter(), exemplar, self.sizes, self.config.stylize, self.seed,
                self.teller.inside(f"{source.name}, {exemplar.name}, {method}"))
            views.save(self.out / "views" / f"{name}.npz")
            write_image(self.out / "pictures" / f"{name}.png", _strip(views))
            return figures

        return self.folder.run(f"paint.{name.replace('/', '.')}",
                               self._paint_key(source, exemplar, method),
                               [f"views/{name}.npz", f"pictures/{name}.png"], paint)

    def _measured(self, source: Source, exemplar: Exemplar, method: str,
                  target: Callable[[], Target], example: bool) -> dict[str, Any]:
        views = self.out / "views" / source.name / exemplar.name

        def found() -> dict[str, Any]:
            say = self.teller.inside(f"{source.name}, {exemplar.name}, {method}")
            return measure(Views.load(views / f"{method}.npz"), target(),
                           Views.load(views / "views.npz") if example else None,
                           lambda text: say.update(0, text))

        return self.folder.run(f"measure.{source.name}.{exemplar.name}.{method}",
                               self._measure_key(source, exemplar, method), [], found)

    def _speed(self) -> dict[str, Any]:
        """Table 1 and Fig. 6, of the first sitter in the first style."""
        source, exemplar = self.sources[0], self.exemplars[0]
        key = key_of(__name__, "speed", self._base(source), exemplar.image,
                     self.config.size, machine())

        def found() -> dict[str, Any]:
            return speed_tables(self._sitter(source), exemplar, self.sizes, self.config.size,
                                self.teller.inside("speed"))

        return self.folder.run("speed", key, [], found)

    def _documents(self, cells: list[Cell], floors: dict[str, dict[str, Any]],
                   speed: dict[str, Any], *, pictures: bool) -> dict[str, Any]:
        facts = {"version": __version__, "machine": machine(), "seed": self.seed,
                 "sizes": self.sizes, "size": self.config.size, "views": self.config.views,
                 "cone": self.config.cone, "sitters": [source.name for source in self.sources],
                 "styles": [exemplar.name for exemplar in self.exemplars],
                 "methods": {name: METHODS[name].what for name in self.config.chosen()},
                 "content_network": "vgg16" if models.available("vgg16") else "embedded",
                 "skin_seconds": {name: row["skin_seconds"] for name, row in floors.items()}}
        study = None
        if self.config.study is not None and pictures:
            study = read_json(self.config.study / "results.json")
        return write_documents(self.out, facts, cells, floors, speed, study, self.failures,
                               {one.name: one.image for one in self.exemplars} if pictures
                               else None)


def _plain(figures: dict[str, float | None]) -> dict[str, float | None]:
    return {name: None if value is None or not np.isfinite(value) else float(value)
            for name, value in figures.items()}


def _strip(views: Views) -> Any:
    """The close views that are shown, side by side."""
    return np.concatenate([views.close[view] for view in SHOWN], axis=1)


def _cell(source: Source, exemplar: Exemplar, method: str, figures: dict[str, Any],
          facts: dict[str, Any]) -> Cell:
    """A cell of the tables from the records of its stages."""
    values = {name: value for name, value in figures.items() if name != "stage_seconds"}
    values |= {"seconds_once": facts["seconds"]["once"], "seconds_view": facts["seconds"]["view"],
               "memory": facts["peak_memory_bytes"] / 2 ** 30}
    return Cell(source.name, exemplar.name, method, values, facts)
