"""The main job: photos and one painting in, a coded light field out, each stage resumable.

It is the graph of one portrait (`graph`), done in its own process. The stages in order, each of
which writes its files into the job's folder and is skipped when they are there from the same inputs
(`lfportrait.cache`):

==============  ==============================  ===================================
stage           reads                           writes
==============  ==============================  ===================================
capture         photos                          ``capture/``
reconstruct     ``capture/``                    ``field.npz``
stylize         field, capture, exemplar        ``styled.npz``
encode          styled field, display           ``lightfield.png``, ``quilt_*.png``
share           all of them                     ``portrait.html``, ``sweep.mp4``,
                                                ``report.html``
==============  ==============================  ===================================

The time that is left of a job is what its steps usually cost, by a table that was measured on one
machine (`usual_steps`): how long a step takes can't be seen from the ones before it. All that is to
come is scaled by what the steps that are done took over what they were to take. Kernels that are
being compiled beside count as a step of their own.
"""

from __future__ import annotations

import contextlib
import sys
import time
import warnings
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import models
from ..cache import StageFolder, check_writable, hash_of
from ..capture import Capture, data_set_facts, is_calibrated, is_video, picture_facts, picture_files
from ..device import gpu_adapter, used_device
from ..errors import UserError
from ..example import Exemplar
from ..face import is_portrait
from ..field import VoxelField
from ..files import read_json, write_json
from ..lightfield import Display
from ..measure import machine, peak_memory_bytes, usable_cores
from ..media.folders import folders_below, list_pictures
from ..media.pictures import read_image
from ..runner import Here, Outcome, finished, run_tasks
from ..simd.host import compiling_progress
from ..version import __version__
from . import graph
from .first_look import LookTaken, PageLook
from .graph import STAGES, MakeConfig, Task, fitted
from .made_from import head_way
from .warmup import Warmup, head_kernels, import_ahead
from .work import Tools, do_stage

_COSTS = {
    "capture": {
        "start": ("megapixels placed", 0.02, 0.03),
        "reading photos": ("megapixels", 0.02, 0.01),
        "features in photo": ("megapixels", 0.005, 0.15),
        "comparing photos": ("pairs", 0.00013, 0.0006),
        "comparing photos in full: pair": ("photos", 0.006, 0.03),
        "checking matches": ("photos", 0.005, 0.05),
        "placing photo": ("pairs", 0.0016, 0.0),
        "refining the cameras": ("pairs", 0.0014, 0.0),
        "looking for the face": ("searches", 1.6, 0.0),
        "fitting the head": ("fits", 0.7, 0.0),
        "cutting out the person": ("photos to cut", 0.01, 0.0),
        "checking whether the head moved": ("photos to place and cut", 0.01, 0.03),
        "cutting out the person: the room behind": ("photos to cut", 0.0, 0.15),
        "cutting out the person: edges": ("megapixels to cut", 0.003, 0.08),
        "cutting out the person: votes of the views": ("photos to cut", 0.004, 0.09),
        "cutting out the object: depth": ("photos to cut", 0.025, 0.2)},
    "reconstruct": {},
    "stylize": {"start": ("once", 3.2, 3.0), "paint after": ("paintings", 2.0, 13.0),
                "refine": ("refinements", 0.05, 0.8), "": ("once", 1.1, 0.0)},
    "encode": {"start": ("once", 0.3, 2.0)},
    "share": {"page, sweep and report": ("once", 0.6, 7.7), "report": ("once", 0.2, 0.0)},
}
"""Cost of each step by the stage's title and what its notes begin with: what it grows with
(`_amounts`), seconds on one core and core-seconds on all cores a unit of it. A step without a name
begins where the counts of the one before end."""
_TRAINING = {"start": (0.6, 0.6), "surface": (3.0, 5.5), "rays": (0.5, 3.0), "finer": (2.0, 4.0),
             "look": (2.5, 12.0), "end": (3.5, 8.0), "test": (0.5, 0.0)}
"""The same of the training; of a million rays at 256 points. Only narrow arcs have a surface."""
_FITTED = {"laying the head over its photo": 0.2, "hair and body from the outline": 0.15,
           "lattice": 3.6, "colors": 0.9}
"""Seconds of the steps of a head that is fitted to a face, which is not trained."""
COMPILE = 0.86  # Core-seconds to compile a function.


class Source(NamedTuple):
    """What is known of photos before they are read: ``megapixels`` are those of one photo.

    Those to which a head is ``fitted`` are not placed.
    """

    photos: int
    megapixels: float
    placed: bool = True
    matted: bool = True
    fitted: bool = False

    @classmethod
    def of(cls, photos: Path | Capture, config: MakeConfig) -> Source:
        """The facts of photos, of a video or of a calibrated data set, by the first picture."""
        if isinstance(photos, Capture):
            camera = photos.cameras
            return cls(len(photos), float(np.mean(camera.width * camera.height)) / 1e6,
                       matted=photos.alphas is not None, fitted=is_portrait(photos))
        side, placed, masks = config.calibrate.max_side or np.inf, is_calibrated(photos), 0
        if not placed and is_video(photos):
            return cls(config.calibrate.video_frames, 1.0, False, False, config.made_from == "face")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if placed:
                facts = data_set_facts(photos)
                pictures, masks, side = facts.pictures, facts.masks, np.inf
                count = len(pictures)
            else:
                files = picture_files(photos, say=False)
                pictures, count = [picture_facts(files[0])], len(files)
        first = pictures[0] if pictures and not pictures[0].fault else None
        width, height = first.stored if first is not None else (1000, 1000)
        size = width * height * min(1.0, side / max(width, height, 1)) ** 2 / 1e6
        return cls(count, size, placed, masks > 0 or (first is not None and "A" in first.mode),
                   fitted=head_way(photos, config.made_from) == "face")


@dataclass
class Step:
    """One step: the seconds that it is to take, and what is known of it so far."""

    stage: str
    name: str
    usual: float
    span: tuple[float, float] = (0.0, 1.0)  # of the stage's count; none of it: not counted
    spent: float = 0.0
    seen: float = 0.0  # when it was last done
    first: float = -1.0  # share at the first note
    share: float = 0.0
    over: bool = False

    def left(self, pace: float) -> float:
        """Seconds to go: by the table, and more and more by its own counts."""
        if self.over:
            return 0.0
        if self.first < 0.0 or self.share <= self.first:
            return max(pace * self.usual * (1.0 - self.share) - self.spent, 0.1 * self.spent)
        known = (self.share - self.first) / (1.0 - self.first)
        return (1.0 - self.share) * ((1.0 - known) * pace * self.usual
                                     + self.spent / (1.0 - self.first))


def usual_steps(config: MakeConfig, source: Source, look: bool, cores: int) -> list[Step]:
    """The steps of a job in their order, with a first look or not, on so many cores."""
    amounts, steps = _amounts(config, source), []
    for stage, costs in _COSTS.items():
        if not costs and source.fitted:
            fitted = [Step(stage, name, seconds) for name, seconds in _FITTED.items()]
            alone, shared = _TRAINING["look"]
            early = [Step(stage, "first look", alone + shared / cores)] if look else []
            steps += [*fitted[:-2], *early, *fitted[-2:]]  # before the lattice
        elif not costs:
            steps += _trained(stage, config, source, look, cores)
        steps += [Step(stage, name, amounts[unit] * (alone + shared / cores))
                  for name, (unit, alone, shared) in costs.items() if amounts[unit]]
    return steps


def _amounts(config: MakeConfig, source: Source) -> dict[str, float]:
    """What steps grow with; 0: there is no such step."""
    style, count, size = config.stylize, source.photos, source.photos * source.megapixels
    placing = not (source.placed or source.fitted)
    cut = not (source.matted or source.fitted or config.keep_background)
    return {
        "once": 1, "megapixels placed": source.placed * size, "megapixels": placing * size,
        "photos": placing * count,
        "pairs": placing * count * (count - 1) / 2, "searches": cut or placing or source.fitted,
        "fits": source.fitted * count,
        "photos to cut": cut * count,
        "photos to place and cut": placing * cut * count, "megapixels to cut": cut * size,
        "paintings": 0.4 + 0.6 * (style.pixels / 384.0) ** 2 if style.on_skin else 4.0,
        "refinements": (0.3 if style.content_network == "embedded" else 1.0) * style.refinements}


def _trained(stage: str, config: MakeConfig, source: Source, look: bool, cores: int) -> list[Step]:
    """The levels of the training, and what comes before, between and after them."""
    cost = {name: alone + shared / cores for name, (alone, shared) in _TRAINING.items()}
    narrow = not source.matted  # as hand-held photos mostly are
    # A head fills six tenths of a picture.
    plan = config.reconstruct.resolved(config.keep_background and not source.matted, 4.0,
                                       0.0033 / max(source.megapixels, 0.01) ** 0.5, narrow)
    levels, training = plan.resolutions, plan.training_seconds(True, True)
    steps = [Step(stage, "start", cost["start"] + narrow * cost["surface"], (0.0, 0.0))]
    before, last = 0.0, len(levels) - 1
    shown = next((level for level in range(last) if levels[level] >= 96), last - 1)
    for level, (points, share) in enumerate(zip(levels, plan.shares())):
        seconds = (training * share if plan.time_budget > 0
                   else plan.rays[level] * cost["rays"] * (points / 256) ** 1.5)
        steps.append(Step(stage, f"{points}^3", seconds, (before, before + share)))
        before += share
        if level == shown and look:
            steps.append(Step(stage, "first look", cost["look"], (0.0, 0.0)))
        elif level < last:
            steps.append(Step(stage, "", cost["finer"] * (points / 128) ** 2))
    return [*steps, Step(stage, "", cost["end"]),
            Step(stage, "held-out views", cost["test"], (0.0, 0.0))]


_COMPILING = "compiling kernels"
_KNOWN = 5.0  # Seconds of the table that count as measured from the first.
_FORGET = 20.0  # Seconds after which a step counts half for what this machine is like now.
_ODD = 2.0  # How many times slower than those before it a step may seem.
_MOST = 8.0  # How many times slower, or faster, than the table a machine may be.


class TimeLeft:
    """The steps of a job, as its progress lines name them (`progress.Outlook`).

    ``look`` and ``only``: a first look is taken, and the job ends with it; ``warmup`` compiles
    kernels beside; ``cores`` are those that it may use, by default those of this process.
    """

    def __init__(self, config: MakeConfig, source: Source, *, look: bool = True,
                 only: bool = False, warmup: Warmup | None = None, cores: int = 0) -> None:
        self._cores = min(cores or usable_cores(), 8)
        self._warmup, self._functions = warmup, 0 if warmup is None else warmup.left
        self._steps = usual_steps(config, source, look or only, self._cores)
        if only:
            names = [step.name for step in self._steps]
            del self._steps[names.index("first look") + 1:]
        self._compile = Step("", _COMPILING, COMPILE / self._cores * self._functions)
        self._now = self._steps[0]
        self._clock = self._begun = time.perf_counter()

    def skip(self, stage: str) -> None:
        """Leave out a stage that was done before."""
        for step in self._steps:
            step.over |= step.stage == stage

    def at(self, stage: str, note: str, share: float | None = None) -> None:
        """Hear which step is being done; one that is not in the table changes nothing."""
        self._book()
        if note.startswith(_COMPILING):
            if self._warmup is not None and self._warmup.left:
                self._now = self._compile
            return
        fitting = [number for number, step in enumerate(self._steps) if step.stage == stage
                   and (note.startswith(step.name) if step.name else step is self._now)]
        if fitting:
            number = max(fitting, key=lambda one: len(self._steps[one].name))
            self._begin(number if share is None else self._count(number, share))

    def _count(self, number: int, share: float) -> int:
        """Note a step's share; the step after it where all is counted that it counts."""
        step = self._steps[number]
        low, high = step.span
        if low == high:
            return number
        step.share = min(max((share - low) / (high - low), 0.0), 1.0)
        step.first = step.share if step.first < 0.0 else step.first
        follows = number + 1 < len(self._steps) and not self._steps[number + 1].name
        return number + 1 if follows and step.share >= 0.99 else number

    def _begin(self, number: int) -> None:
        for step in self._steps[:number]:
            step.over = True
        self._now = self._steps[number]
        self._now.over = False

    def _book(self) -> None:
        """Book the time since the last call on the step that is being done."""
        now = time.perf_counter()
        self._now.spent += now - self._clock
        self._now.seen = self._clock = now

    def left(self) -> float | None:
        """Seconds that the job will still take; None in its first seconds."""
        self._book()
        if self._clock - self._begun < _KNOWN:
            return None
        pace, compiled = self._pace(), self._compiled()
        return (sum(step.left(pace) for step in self._steps)
                + pace * self._compile.usual * (1.0 - compiled))

    def _compiled(self) -> float:
        """Share of the functions to compile that is there."""
        if not self._functions or self._warmup is None:
            return 1.0
        return 1.0 - self._warmup.left / self._functions

    def _pace(self) -> float:
        """What steps have taken over what they were to take; the latest ones count most."""
        whole = self._ratio(1.0, np.inf)
        return float(np.clip(self._ratio(whole, _FORGET), 1.0 / _MOST, _MOST))

    def _ratio(self, before: float, forget: float) -> float:
        """The same where it was ``before`` at first and steps count half after some seconds."""
        took, usual = _KNOWN * before, _KNOWN
        for step in (self._compile, *self._steps):
            pace = took / usual
            done = 1.0 if step.over else max(step.share - max(step.first, 0.0), 0.0)
            if step.spent and (done or step.spent > step.usual * pace):
                weight = 0.5 ** ((self._clock - step.seen) / forget)
                expected = weight * step.usual * (done or 1.0)
                # One step that is far off says more of itself than of the machine.
                took += min(weight * step.spent, _ODD * pace * expected)
                usual += expected
        return took / usual


def make(photos: Path | Capture, style: str | Path | Exemplar, out: Path,
         display: str | Path | Display = "generic-4k", config: MakeConfig | None = None, *,
         device: str = "auto", seed: int = 0, quiet: bool = True, offline: bool = False,
         first_look: bool = True, quick: bool = False) -> dict[str, Any]:
    """Run the whole job.

    While the field is made, a first look is written as ``portrait.html`` (`first_look`).

    Parameters
    ----------
    photos : Folder of photos, video, calibrated data set, or a capture in memory.
    style : Exemplar: a picture's path, a built-in style's name, or an `Exemplar`.
    out : Folder for all results; an interrupted job is resumed.
    display : Preset name, calibration or display file, or a `Display`.
    config : Parameters of the stages.
    device : Where to compute: ``"auto"``, ``"cpu"``, ``"gpu"`` or ``"gpu:NAME"``
        (`lfportrait.device`).
    seed : Seed of all random choices.
    quiet : Print no progress.
    offline : Download no networks: what is missing is an error, or done without and said so.
    first_look : Write the first look; all other files are the same without it.
    quick : End with the first look. The same call without this goes on from there.

    Returns
    -------
    run : The figures that ``run.json`` holds; ``first_look`` has the seconds to the first look,
        where there was one.

    Raises
    ------
    UserError : If an input can't be used; nothing half-written is left.
    """
    begun = time.perf_counter()
    config = config or MakeConfig()
    # Everything that can be wrong in the input is looked at before the first long stage starts.
    panel = display if isinstance(display, Display) else Display.resolve(display)
    if not isinstance(photos, Capture) and not Path(photos).exists():
        raise UserError(f"there is no folder or file {photos}; name the folder of your photos")
    if not isinstance(style, Exemplar) and not Path(style).is_file():
        style = Exemplar.load(style)  # a name: it needs no network
    check_writable(Path(out))
    gpu_adapter(device)  # a GPU that is not here is reported now, not when the picture is coded
    models.require(config.stylize.networks, download=not offline, quiet=quiet,
                   purpose=f"--method {config.stylize.method}")
    if not isinstance(photos, Capture):
        graph.look_at(Path(photos))
        get_networks(Path(photos), None if isinstance(style, Exemplar) else Path(style),
                     config.keep_background, offline=offline, quiet=quiet)
    exemplar = style if isinstance(style, Exemplar) else Exemplar.load(style)
    config = fitted(config, [(panel, config.encode)])
    job = _Job(Path(out), photos, exemplar, panel, config, device, seed, quiet)
    source = Source.of(photos, config)
    with Warmup(head_kernels(source.fitted, source.matted)) as job.tools.warmup:
        if not quiet:
            job.look_ahead(TimeLeft(config, source, look=first_look,
                                    only=quick, warmup=job.tools.warmup))
        if first_look or quick:
            job.look_early(begun, only=quick)
        if not (source.placed or finished(job.tasks["capture"], job.out)):
            # Not torch: memory between its own is not given back, up to 1 GB more at the peak.
            import_ahead("mediapipe.tasks.python")
        return job.run()


def _tasks(photos: Path | Capture, exemplar: Exemplar, display: Display, config: MakeConfig,
           seed: int) -> dict[str, Task]:
    keys = {"capture": graph.capture_key(graph.source_key(photos), config, seed)}
    keys["reconstruct"] = graph.field_key(keys["capture"], config)
    keys["stylize"] = graph.style_key(keys["reconstruct"], config, graph.painting_key(exemplar))
    keys["encode"] = graph.code_key(keys["stylize"], config, display)
    keys["share"] = graph.share_key(keys["encode"], config)
    tasks = graph.portrait_tasks(
        keys, config, seed, display=display,
        source="" if isinstance(photos, Capture) else str(photos),
        inputs={"capture": "capture", "field": "field.npz", "styled": "styled.npz"})
    return {task.name: task for task in tasks}


class _Job:
    """One run of the main job: the tasks of one portrait, one after the other, here."""

    def __init__(self, out: Path, photos: Path | Capture, exemplar: Exemplar, display: Display,
                 config: MakeConfig, device: str, seed: int, quiet: bool) -> None:
        self.out, self.exemplar, self.display, self.quiet = out, exemplar, display, quiet
        self.config, self.seed = config, seed
        self.tasks = _tasks(photos, exemplar, display, config, seed)
        self.stages = StageFolder(out, self._say)
        self.tools = Tools(shown=not quiet, device=device, exemplar=exemplar, report=True,
                           capture=photos if isinstance(photos, Capture) else None,
                           sheet=out.with_name(f"{out.name}-photos.jpg"))

    def _say(self, line: str) -> None:
        if not self.quiet:
            print(line, file=sys.stderr)

    def look_ahead(self, outlook: TimeLeft) -> None:
        """Show the time that is left of what is not done yet."""
        for task in self.tasks.values():
            if finished(task, self.out) is not None:
                outlook.skip(STAGES[task.stage].title)
        self.tools.outlook = outlook

    def look_early(self, begun: float, *, only: bool) -> None:
        """Take a first look as soon as that is possible; ``only``: and end the job with it."""
        tasks, config = self.tasks, self.config
        look = PageLook(self.stages, hash_of(tasks["stylize"].key, config.page), self.exemplar,
                        replace(config.stylize, seed=self.seed), config.page, config.encode, begun,
                        only=only)
        look.warmup = self.tools.warmup
        # The finished page is no worse.
        look.over = look.over or finished(tasks["share"], self.out) is not None
        self.tools.look = look

    def run(self) -> dict[str, Any]:
        with contextlib.suppress(LookTaken):
            run_tasks(self.tasks.values(), Here(self._do))
        run = self._figures()
        write_json(self.out / "run.json", run)
        return run

    def _do(self, task: Task) -> Outcome:
        """Do a task, unless it was done before or the job is to end with the first look."""
        look = self.tools.look
        if look is not None and finished(task, self.out) is None:
            if look.over and look.only:
                return Outcome(task.name)
            if task.stage == "stylize" and not look.over:
                self._late_look()
        return Outcome(task.name, figures=self.stages.run(
            task.record, task.key, task.outputs, partial(self._done, task)))

    def _late_look(self) -> None:
        """Take the first look after all: the painting is new, or kernels were late."""
        look, capture = self.tools.look, Capture.load(self.out / "capture")
        assert look is not None
        with compiling_progress("first look", enabled=not self.quiet) as progress:
            look.offer(progress, capture, lambda: look.rough or self.tools.kept.get("field")
                       or VoxelField.load(self.out / "field.npz"), wait=True)

    def _done(self, task: Task) -> dict[str, Any]:
        figures = do_stage(task, self.out, self.stages, self.tools, self.stages.figures)
        if task.stage == "field":
            self._compare_arcs(figures)
        return figures

    def _compare_arcs(self, figures: dict[str, Any]) -> None:
        """Say so where the display shows more than the photos do."""
        span = figures.get("geometry", {}).get("span_degrees", 360.0)
        if span < self.display.cone:
            warnings.warn(
                f"the photos cover {span:.0f} degrees around the head, {self.display.name} shows "
                f"{self.display.cone:.0f}: its outer views are partly extrapolated "
                "(report.html shows where); take photos from further left and right", stacklevel=2)

    def _figures(self) -> dict[str, Any]:
        run = run_figures(self.stages.figures, self.exemplar.name, self.display.name,
                          self.stages.resumed)
        look = self.tools.look
        return {**run, "first_look": look.figures} if look is not None and look.figures else run


def run_figures(figures: dict[str, dict[str, Any]], style: str, display: str,
                resumed: list[str]) -> dict[str, Any]:
    """What ``run.json`` says of a job by its stages' figures; ``resumed`` were done before."""
    seconds = {name: stage["stage_seconds"] for name, stage in figures.items()}
    peak = max([peak_memory_bytes(), *(int(stage.get("peak_memory_bytes", 0))
                                       for stage in figures.values())])
    return {"version": __version__, "device": used_device(figures), "machine": machine(),
            "style": style, "display": display,
            "seconds": {"total": round(sum(seconds.values()), 3), **seconds},
            "peak_memory_bytes": peak, "resumed": resumed, **figures}


def _described(photos: Path) -> dict[str, object]:
    """What a capture that lfportrait wrote says of itself; empty for anything else."""
    path = photos / "transforms.json" if photos.is_dir() else photos
    if path.name != "transforms.json" or not path.is_file():
        return {}
    data = read_json(path)
    return data if isinstance(data, dict) and data.get("generator") == "lfportrait" else {}


def _cut_out(photos: Path) -> bool:
    """Whether the photos of a data set have mattes, judged by its first picture."""
    if not photos.is_dir():
        return _matted(photos)
    folders = [photos, *folders_below(photos)]
    if any(folder.name == "masks" for folder in folders):
        return True
    for path in (path for folder in folders for path in list_pictures(folder).files):
        try:
            return _matted(path)
        except UserError:  # a damaged one is left out later, with a warning
            continue
    return False


def _matted(path: Path) -> bool:
    """Whether a picture has an alpha channel that cuts something out."""
    picture = read_image(path)
    return picture.shape[-1] == 4 and bool((picture[..., 3] < 255).any())


def _bare(painting: Path | None) -> bool:
    """Whether a painting has no landmarks beside it."""
    return painting is not None and not painting.with_suffix(".landmarks.txt").exists()


def networks_of(photos: Path, painting: Path | None, keep_background: bool,
                ) -> tuple[list[str], list[str]]:
    """A job's required networks, and the optional ones, by their names in `lfportrait.models`.

    ``painting`` is None where the exemplar is known already; if the background is kept, no mattes
    are wanted.
    """
    described = _described(photos)
    landmarks_given = described.get("landmarks") is not None and not _bare(painting)
    needed = [] if landmarks_given else ["face-landmarker"]
    cut_out = keep_background or (not is_video(photos) and _cut_out(photos))
    regions = ["person-segmentation", "hair-segmentation"]
    if cut_out:
        return needed, regions
    return [*needed, regions[0]], regions[1:]


def get_networks(photos: Path, painting: Path | None, keep_background: bool, *, offline: bool,
                 quiet: bool) -> None:
    """Check or download a job's networks, and report optional ones that are missing."""
    needed, better = networks_of(photos, painting, keep_background)
    if models.missing(needed):
        # All at once: what is only better is part of the same download.
        try:
            models.require([*needed, *better], download=not offline, purpose="this job",
                           quiet=quiet)
        except UserError as error:
            if not _bare(painting):
                raise
            assert painting is not None
            beside = painting.with_suffix(".landmarks.txt").name
            raise UserError(f"{error} (the landmarks of {painting} must be detected, too: there is "
                            f"no {beside} beside it)") from error
        return
    models.require(needed, download=False, quiet=quiet)
    if models.missing(better):
        try:
            models.require(better, download=not offline, purpose="a better outline", quiet=quiet)
        except UserError as error:
            if not quiet:
                print(f"continuing without segmentation networks; person and hair are found by "
                      f"color: {error}", file=sys.stderr)
