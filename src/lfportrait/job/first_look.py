"""A first look: a portrait to turn, in the painting's style, while its field is still made.

A field of a coarse level is finished as the whole one will be, its skin is drawn at a few pixels,
painted as previews are, and shown; then the training goes on. A look leaves no trace in what comes
after it: nothing of the training's state changes, and no random number is drawn.

A look is a courtesy. Where its kernels are not compiled yet it comes later, from a finer field, and
where it can't be made the job says so in a line and goes on. If nothing but the look is wanted, it
waits for the kernels and ends the job (`LookTaken`), which goes on from the training's checkpoint
when it is run again. A head that is fitted to one photo is looked at on a coarse lattice.

`FirstLook` decides when; `PageLook` writes it as ``portrait.html``, which the finished page
replaces at the end. The studio draws it as a picture.
"""

import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

from ..cache import StageFolder
from ..capture import Capture
from ..errors import UserError
from ..example import Exemplar, Skin, known_ground
from ..face import is_portrait
from ..field import Backdrop, VoxelField, head_points
from ..files import file_state, read_json, write_json
from ..gpu import GpuLostError
from ..lightfield import EncodeConfig
from ..progress import Progress
from ..share import PageConfig, write_page
from ..stylize import StylizeConfig, stylize_with_figures
from .warmup import Warmup

PAGE = "portrait.html"
KERNELS = "transfer", "stylize", "encode"
"""What of `Warmup` a look needs beside the training's own."""
PIXELS = 256.0  # Of the skin, per world unit, at most; a preview paints every second one.
SIZE = 2.0  # Of the page in MB, at most.


class LookTaken(Exception):
    """Ends a job of which only the first look was wanted."""


def painted_roughly(field: VoxelField, capture: Capture, exemplar: Exemplar,
                    config: StylizeConfig) -> VoxelField:
    """A field as a preview of its painting with its ground, by the finished portrait's config.

    It stays as it is if its skin isn't painted.
    """
    if capture.landmarks is None or not config.on_skin:
        return field
    rough = replace(config, preview=True, pixels=min(config.pixels, PIXELS))
    skin = Skin.of(field, capture.landmarks, capture.cameras, rough.pixels)
    styled, _ = stylize_with_figures(field, capture, exemplar, rough, device="cpu", skin=skin)
    if config.ground:  # it is kept for the finished portrait
        styled.backdrop = Backdrop(*known_ground(exemplar, seed=config.seed), head_points(styled))
    return styled


class FirstLook(ABC):
    """The first look of one job: taken once, of the first field that it can be taken of.

    Of the painting, or the name or file of one, and its parameters. The job began at ``begun``, by
    `time.perf_counter`, and ends with the look if that is the ``only`` thing that is wanted.
    """

    def __init__(self, exemplar: Exemplar | str, config: StylizeConfig, begun: float, *,
                 only: bool = False) -> None:
        self.exemplar, self.config, self.begun, self.only = exemplar, config, begun, only
        self.warmup: Warmup | None = None  # Kernels that are being compiled; None: all are there.
        self.rough: VoxelField | None = None  # What it will be taken of, if that is there by now.
        self.over = False  # Whether it was taken, or has failed.
        # ``seconds`` from the job's begin to the look, ``cost_seconds`` of these for it alone.
        self.figures: dict[str, float] = {}

    def wanted(self) -> bool:
        """Whether a look is wanted by now."""
        return True

    @abstractmethod
    def show(self, portrait: VoxelField) -> str:
        """Show the look; where it is, for a line that people see, or nothing."""

    def taken(self, seconds: float, cost: float) -> None:
        """Note the `figures` of the look that was shown."""
        self.figures = {"seconds": round(seconds, 3), "cost_seconds": round(cost, 3)}

    def offer(self, progress: Progress, capture: Capture, make: Callable[[], VoxelField], *,
              wait: bool = False) -> None:
        """Take the look, unless it was taken or its kernels are missing: ``wait`` waits for these.

        ``make`` gives the field, for the look alone; that of a head that is not trained is kept as
        ``rough`` where kernels are missing. Raises `LookTaken` if the job is to end with
        it, `UserError` if the job is to end with it and it can't be made.
        """
        if self.over or not self.wanted():
            return
        if self.warmup is not None:
            if not (wait or self.only or self.warmup.ready(KERNELS)):
                if is_portrait(capture):  # a moment's work, and so is a look of it
                    with suppress(Exception):
                        self.rough = make()
                return
            self.warmup.wait(KERNELS, progress)
        self.over = True
        progress.update(progress.done, "first look")
        start = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # what is to be said is said at the end
                exemplar = (self.exemplar if isinstance(self.exemplar, Exemplar)
                            else Exemplar.load(self.exemplar))
                where = self.show(painted_roughly(make(), capture, exemplar, self.config))
        except GpuLostError:
            raise  # the training goes on without it
        except Exception as error:  # a look must not end the job, whatever a rough field does to it
            self._fail(progress, error)
            return
        self.rough, end = None, time.perf_counter()
        self.taken(end - self.begun, end - start)
        if where:
            progress.say(f"a first look after {end - self.begun:.0f} s: {where}")
        if self.only:
            raise LookTaken

    def _fail(self, progress: Progress, error: Exception) -> None:
        why = str(error) if isinstance(error, UserError) else f"{type(error).__name__}: {error}"
        if self.only:
            raise UserError(f"there is no first look: {why}; leave out --quick") from error
        progress.say(f"no first look: {why}")


class PageLook(FirstLook):
    """The first look as the page, with the page's parameters, that the job will write.

    A record beside those of the job's stages says by its key which portrait the page shows.
    """

    def __init__(self, stages: StageFolder, key: str, exemplar: Exemplar, config: StylizeConfig,
                 page: PageConfig, ground: EncodeConfig, begun: float, *,
                 only: bool = False) -> None:
        super().__init__(exemplar, config, begun, only=only)
        self.page, self.ground = page, ground
        self._stages, self._key = stages, key
        self._file, self._record = stages.folder / PAGE, stages.records / "first-look.json"
        self.over = self._read()

    def show(self, portrait: VoxelField) -> str:
        """Write the page; where it is."""
        # A page of another portrait that was finished here before must not be believed again.
        self._stages.forget("share")
        date = f"{self.page.date}, a first look" if self.page.date else "a first look"
        rough = replace(self.page, date=date, sh=0, max_size=min(self.page.max_size, SIZE))
        write_page(portrait, self._file, rough, self.ground)
        return str(self._file)

    def taken(self, seconds: float, cost: float) -> None:
        """Write them into the record."""
        super().taken(seconds, cost)
        write_json(self._record, {"key": self._key, "page": file_state(self._file),
                                  "figures": self.figures})

    def _read(self) -> bool:
        """Whether the page is the look that an earlier run wrote; its figures in any case."""
        try:
            record: Any = read_json(self._record)
            if record["key"] != self._key:
                return False
            self.figures = dict(record["figures"])
            return list(file_state(self._file)) == record["page"]
        except (UserError, OSError, KeyError, TypeError, ValueError):
            return False
