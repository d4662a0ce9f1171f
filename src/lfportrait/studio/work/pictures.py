"""What a job's process shows while it works: stages, progress, notes, pictures, a first look.

The messages, each a tuple: ``("stages", [(name, seconds)])``, ``("begin", stage)``,
``("progress", stage, share, note)``, ``("note", text)``, ``("picture", stage)``,
``("page", stage)``, ``("done", stage, seconds)``, ``("skipped", stage)``, ``("end", result)``, and
``("failed", code, text)``.
"""

import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ...arrays import UInt8
from ...capture import Camera, Capture
from ...color import to_uint8
from ...field import VoxelField
from ...files import write_image
from ...job import STAGES, FirstLook, Tools
from ...lightfield import eight_bit, render_views
from ...progress import Progress
from ...share import PageConfig, sweep_cameras, write_page
from ...simd.host import watched_compilations
from ..jobs import Order
from ..projects import Project

_SIZE = 2.0  # Of a page in MB, at most.
_TOLD_EVERY = 0.25  # Seconds between two messages of progress at least.
_SHOWN = 3.0  # Seconds between two intermediate pictures at least; or ten times what one takes.


@dataclass
class Teller:
    """What a job tells the server."""

    tell: Callable[..., None]  # Sends a message.
    pictures: Path  # Folder for the stages' pictures.

    def picture(self, stage: str, image: UInt8) -> None:
        """A stage's picture, uint8 [H, W, 3]."""
        self.pictures.mkdir(parents=True, exist_ok=True)
        write_image(self.pictures / f"{stage}.jpg", image, quality=88)
        self.tell("picture", stage)

    def page(self, stage: str, field: VoxelField) -> None:
        """A page that turns the head as far as a stage has made it."""
        self.pictures.mkdir(parents=True, exist_ok=True)
        write_page(field, self.pictures / f"{stage}.html", PageConfig(sh=0, max_size=_SIZE))
        self.tell("page", stage)

    @contextmanager
    def stage(self, name: str, draw: Callable[[Any], UInt8] | None = None) -> Iterator[Progress]:
        """A stage of the work, with its progress, its warnings and its time.

        ``draw`` draws an intermediate result.
        """
        begun = time.perf_counter()
        self.tell("begin", name)
        progress = SentProgress(self, name, draw)

        def compiled(_: str) -> None:
            progress.compiled += 1
            progress.update(progress.done, f"compiling kernels, once: {progress.compiled}")

        with warnings.catch_warnings(), watched_compilations(compiled):
            warnings.simplefilter("ignore")
            warnings.filterwarnings("always", category=UserWarning, module=r"lfportrait\w*\.")
            warnings.showwarning = lambda message, *_, **__: self.tell(
                "note", " ".join(str(message).split()))
            yield progress
        self.tell("done", name, round(time.perf_counter() - begun, 3))

    def tools(self, stage: str, draw: Callable[[Any], UInt8] | None = None, **more: Any) -> Tools:
        """Tools whose progress is a stage's (`lfportrait.job.do_stage`)."""
        teller = self

        class Own(Tools):
            @contextmanager
            def progress(self, name: str) -> Iterator[Progress]:
                with teller.stage(stage, draw) as progress:
                    if self.warmup is not None:
                        self.warmup.wait(STAGES[name].kernels, progress)
                    yield progress

        return Own(shown=True, **more)


class SentProgress(Progress):
    """Progress that goes to the server."""

    def __init__(self, teller: Teller, stage: str,
                 draw: Callable[[Any], UInt8] | None = None) -> None:
        super().__init__(stage, enabled=False)
        self.compiled = 0
        self._teller, self._stage, self._draw = teller, stage, draw
        self._last = -1e9
        self._shown, self._took = time.perf_counter(), 0.0

    def update(self, done: int, note: str = "") -> None:
        """Tell how much is done."""
        self.done = done
        if self._due(note, _TOLD_EVERY):
            share = min(1.0, done / self.total) if self.total else None
            self._teller.tell("progress", self._stage, share, note)

    def say(self, line: str) -> None:
        """Tell a line that stays."""
        self._teller.tell("note", line)

    def show(self, make: Callable[[], object], *, at_once: bool = False) -> None:
        """Draw an intermediate result now and then, or at once."""
        now = time.perf_counter()
        soon = now - self._shown < max(_SHOWN, 10 * self._took)
        if self._draw is None or (soon and not at_once):
            return
        self._teller.picture(self._stage, self._draw(make()))
        self._shown = time.perf_counter()
        self._took = self._shown - now

    def close(self, note: str = "") -> None:
        """Nothing is written at the end."""


_PAPER, _INK, _BLUE = (250, 250, 248), (40, 40, 44), (30, 110, 200)
_MARGIN = 1.12  # Of a head in its picture.
_DISTANCE = 4.0


def views_of(field: VoxelField, cameras: Sequence[tuple[float, float, float]], size: int) -> Camera:
    """Square cameras on a head, framed so that all of it shows.

    Each is (yaw, pitch, zoom): degrees to its left side and up, and how much nearer than all of the
    head.
    """
    plain = sweep_cameras(0.0, 1, size, field)
    target_y = float(plain.position[0, 1])
    focal = float(plain.focal[0, 0]) / _MARGIN * 1.04
    return Camera.concatenate([
        Camera.arc(np.array([yaw]), distance=_DISTANCE, width=size, height=size,
                   focal=focal * zoom, target=(0.0, target_y, 0.0), pitch=pitch)
        for yaw, pitch, zoom in cameras])


def head_picture(field: VoxelField, size: int = 320, yaws: Sequence[float] = (-40.0, 0.0, 40.0),
                 ) -> UInt8:
    """A head from some sides, side by side: uint8 [size, size * views, 3].

    From no further aside than it can be looked at.
    """
    most = field.cone / 2 or 360.0
    cameras = views_of(field, [(min(max(yaw, -most), most), 0.0, 1.0) for yaw in yaws], size)
    return np.concatenate([eight_bit(seen.color) for seen in render_views(
        field, cameras, background=1.0)], axis=1)


def cameras_picture(capture: Capture, size: int = 480) -> UInt8:
    """The placed cameras from above, beside photos of some of them: uint8 [size, 2 * size, 3]."""
    sheet = Image.new("RGB", (2 * size, size), _PAPER)
    draw = ImageDraw.Draw(sheet)
    places = capture.cameras.position
    reach = 1.12 * float(np.abs(places[:, [0, 2]]).max(initial=1.0))
    middle = 0.5 * size

    def spot(x: float, z: float) -> tuple[float, float]:
        return middle + x / reach * middle, middle + z / reach * middle

    head = max(0.6 / reach * middle, 6.0)
    draw.ellipse((middle - head, middle - head, middle + head, middle + head), outline=_INK,
                 width=2)
    draw.line((middle, middle + head, middle, middle + 1.35 * head), fill=_INK, width=2)
    for place, pose in zip(places, capture.cameras.pose, strict=True):
        x, y = spot(float(place[0]), float(place[2]))
        ahead = pose[[0, 2], 2]
        ahead = ahead / max(float(np.hypot(*ahead)), 1e-9)
        side = np.array([-ahead[1], ahead[0]])
        length = 0.05 * size
        wedge = [(x, y), *((x + length * (ahead[0] + s * 0.4 * side[0]),
                            y + length * (ahead[1] + s * 0.4 * side[1])) for s in (-1, 1))]
        draw.polygon(wedge, outline=_BLUE)
        draw.ellipse((x - 2, y - 2, x + 2, y + 2), fill=_BLUE)
    draw.text((10, size - 24), f"{len(capture)} cameras, from above", fill=_INK,
              font=ImageFont.load_default(14))
    _photos(sheet, capture, size)
    return np.asarray(sheet, np.uint8)


def photo_picture(capture: Capture, size: int = 480) -> UInt8:
    """The photos that a head was fitted to, cut out, side by side: uint8 [size, W, 3]."""
    photos = [Image.fromarray(to_uint8(capture.image_float(view))) for view in range(len(capture))]
    return np.concatenate([np.asarray(photo.resize(
        (max(1, round(photo.width * size / photo.height)), size), Image.Resampling.LANCZOS))
        for photo in photos], axis=1)


def _photos(sheet: Image.Image, capture: Capture, size: int) -> None:
    """Photos from left to right in the right half of a sheet."""
    places = capture.cameras.position
    order = np.argsort(np.arctan2(places[:, 0], places[:, 2]))
    columns = 4
    chosen = order[np.unique(np.linspace(0, len(order) - 1, min(len(order), 16)).astype(int))]
    cell = size // columns
    for number, view in enumerate(chosen):
        image = to_uint8(capture.image_float(int(view)))
        small = Image.fromarray(image)
        small.thumbnail((cell - 6, cell - 6))
        column, row = number % columns, number // columns
        sheet.paste(small, (size + column * cell + 3, row * cell + 3))


def coded_picture(coded: UInt8, size: int = 320) -> UInt8:
    """The whole coded picture, small, beside a piece of it enlarged four times."""
    height, width = coded.shape[:2]
    wide = round(size * width / height)
    whole = Image.fromarray(coded).resize((wide, size), Image.Resampling.BOX)
    side = size // 4
    y, x = int(0.42 * height), int(0.5 * width)
    piece = Image.fromarray(np.ascontiguousarray(coded[y:y + side, x:x + side])).resize(
        (size, size), Image.Resampling.NEAREST)
    return np.concatenate([np.asarray(whole), np.asarray(piece)], axis=1)


def turned(number: int) -> float:
    """Yaw in degrees of a head that turns slowly from one picture to the next."""
    return 35.0 * math.sin(0.7 * number)


_EVERY = 1.0  # Seconds after which it is looked again whether a painting was chosen.


class EarlyPicture(FirstLook):
    """The first look as a page, and as the picture of the stage to come until that has its own.

    A painting is often chosen while the head is being made: the look waits for that.
    """

    STAGE = "surface"

    def __init__(self, order: Order, teller: Teller) -> None:
        # A picture shows no ground.
        super().__init__("", replace(order.config().stylize, ground=False), time.perf_counter())
        self._project, self._teller = Project(order.folder), teller
        self._asked = -_EVERY

    def wanted(self) -> bool:
        """Whether a painting is chosen."""
        now = time.perf_counter()
        if now - self._asked < _EVERY:
            return False
        self._asked = now
        self.exemplar = str(self._project.settings().get("painting") or "")
        return bool(self.exemplar)

    def show(self, portrait: VoxelField) -> str:
        """Draw it; there is no line to be said."""
        self._teller.picture(self.STAGE, head_picture(portrait))
        self._teller.page(self.STAGE, portrait)
        return ""
