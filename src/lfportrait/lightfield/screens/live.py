"""A light field shown live: its field, what the viewer changes, and the pictures that follow.

`Live` is driven by a screen: a window (`live_window`), or `OffscreenWindow`, which draws into
memory for tests and measurements. The window of a panel shows the picture pixel for pixel; an
ordinary one shows what an eye in the middle sees, by the same shaders without a lens.
"""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...field import Backdrop, VoxelField, head_points
from ...gpu.device import Device
from ..composition import composed
from ..display import Display
from ..gpu.blit import Blit, LivePicture, pixels_of
from ..gpu.live import LiveCoder
from ..ground import backdrop_of
from ..placement import EncodeConfig
from .live_controls import HELP, Controls

__all__ = ["Live", "OffscreenWindow", "check_pixels", "one_eyed"]

_KEPT = 10000
"""Pictures, the latest ones, whose times the figures are about."""


class Live:
    """A field on a device, and what the viewer makes of it.

    Parameters
    ----------
    device
        The device.
    field, config
        What is shown, and how it is placed at first.
    panel
        The display that it is composed for.
    display
        The one that it is coded for: the panel, or `one_eyed` of it.
    photo
        A field of the same points whose colors can be mixed in; or None.
    seconds
        When it is over; 0: when the viewer closes it.
    say
        Is given a line a second, and the help when the viewer asks for it.

    Attributes
    ----------
    controls
        What the viewer has set.
    coder
        Codes the pictures.
    frames
        How many pictures were coded.
    """

    def __init__(self, device: Device, field: VoxelField, config: EncodeConfig, panel: Display,
                 display: Display, photo: VoxelField | None = None, *, seconds: float = 0.0,
                 say: Callable[[str, bool], None] = lambda line, stays: None) -> None:
        if config.ground not in ("painted", "black"):
            # It is read once, not for every picture.
            field = replace(field, backdrop=backdrop_of(field, config))
            config = replace(config, ground="painted", background=0.0)
        self._config, self._compose = config, _Composer(field, panel)
        self.coder = LiveCoder(device, field, display, photo)
        self.controls = Controls(panel.distance, photo is not None)
        self._seconds, self._say, self._helped = seconds, say, False
        self._begun, self._last, self._told = -1.0, 0.0, 0.0
        self._marks: list[float] = []
        self._coding: deque[float] = deque(maxlen=_KEPT)
        self.frames = 0

    @property
    def picture(self) -> LivePicture:
        """The picture that is to be shown now."""
        return self.coder.picture

    @property
    def over(self) -> bool:
        """Whether the viewer closed it, or its time is up."""
        late = self._seconds > 0 and self._begun >= 0 and self._last - self._begun >= self._seconds
        return self.controls.closed or late

    @property
    def still(self) -> bool:
        """Whether the next picture would be the same, unless the viewer changes something."""
        return self.coder.exact and self.controls.still

    def wanted(self) -> tuple[EncodeConfig, float]:
        """The configuration, composed, and the photo's share, that the viewer asks for."""
        return self._compose(self.controls.applied(self._config)), self.controls.share

    def tick(self, now: float) -> bool:
        """Move on to a time in seconds; whether there is another picture."""
        if self._begun < 0:
            self._begun = self._last = self._told = now
        self.controls.advance(max(now - self._last, 0.0))
        self._last = now
        new = self.coder.step(*self.wanted())
        if new:
            self.frames += 1
            self._coding.append(self.coder.seconds)
            self._marks.append(now)
        if self.controls.help != self._helped:
            self._helped = self.controls.help
            if self._helped:
                self._say(HELP, True)
        return new

    def line(self) -> str | None:
        """A line for the viewer, once a second."""
        if self._last - self._told < 1.0:
            return None
        self._marks = [mark for mark in self._marks if mark > self._told]
        rate = len(self._marks) / (self._last - self._told)
        self._told = self._last
        line = f"{rate:.1f} pictures a second, {self.controls.summary()}"
        self._say(line, False)
        return line

    def figures(self) -> dict[str, Any]:
        """Pictures, their rate over the whole time, and what coding took, for ``--json``."""
        spent = self._last - self._begun
        out: dict[str, Any] = {"frames": self.frames, "frames_per_second": round(
            self.frames / spent, 2) if spent > 0 else 0.0}
        if self._coding:
            out["coding_ms"] = {
                name: round(1000.0 * float(np.quantile(self._coding, share)), 3)
                for name, share in (("median", 0.5), ("slowest", 1.0))}
        return out

    def close(self) -> None:
        """End what runs beside it."""
        self.coder.close()


class OffscreenWindow:
    """A panel's window in memory: runs a script of events, one picture after the other.

    Parameters
    ----------
    size
        Width and height in pixels.
    script
        Events and the pictures before which they happen, ``{3: [{"event_type": ...}]}``.
    frames
        How many pictures are shown, unless it is over before.
    rate
        Pictures a second, of the time that passes for what moves.
    keep
        Whether `pictures` keeps them.
    exact
        Whether each picture is gone on with until it is exact, however long that takes.

    Attributes
    ----------
    pictures
        What was shown, uint8 [H, W, 3] each.
    screen
        0: it stands for a panel's, not for an ordinary window.
    """

    screen = 0

    def __init__(self, size: tuple[int, int],
                 script: Mapping[int, Sequence[Mapping[str, Any]]] | None = None,
                 frames: int = 1, rate: float = 30.0, keep: bool = True,
                 exact: bool = False) -> None:
        self.size = size
        self._script, self._frames, self._rate, self._keep = script or {}, frames, rate, keep
        self._exact = exact
        self.pictures: list[NDArray[np.uint8]] = []

    def open(self) -> tuple[int, int]:
        """Its width and height in pixels."""
        return self.size

    def close(self) -> None:
        """Nothing is left open."""

    def run(self, device: Device, display: Display, live: Live) -> None:
        """Show pictures until it is over."""
        format = "rgba8unorm"
        blit = Blit(device, display, format)
        target = device.texture(self.size, format, drawn=True)
        for frame in range(self._frames):
            for event in self._script.get(frame, ()):
                live.controls.handle(event, self.size[0])
            live.tick(frame / self._rate)
            if live.over:
                break
            if self._exact:
                live.coder.settle(*live.wanted())
            blit.draw(live.picture, target.create_view())
            if frame == 0:
                check_pixels(device, target, display, live.picture)
            if self._keep:
                self.pictures.append(pixels_of(device, target))
            live.line()


class _Composer:
    """Compositions of a field on a panel; turning the head leaves them as they are."""

    def __init__(self, field: VoxelField, panel: Display) -> None:
        self._field, self._panel = field, panel
        self._known: tuple[EncodeConfig, EncodeConfig] | None = None

    def __call__(self, config: EncodeConfig) -> EncodeConfig:
        if not config.compose:
            return config
        plain = replace(config, turn=0.0)
        if self._known is None:
            if self._field.backdrop is None:
                # The head's places are looked for once; this ground is not shown.
                self._field = replace(self._field, backdrop=Backdrop(
                    np.zeros((2, 2, 3), np.uint8), 1.0, np.array([0.0, 0.0, 1.0]),
                    head_points(self._field)))
            self._known = plain, composed(self._field, self._panel, plain)
        elif self._known[0] != plain:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # it was said at the beginning
                self._known = plain, composed(self._field, self._panel, plain)
        return replace(self._known[1], turn=config.turn)


def one_eyed(panel: Display, width: int, height: int) -> Display:
    """What stands in for a panel where one eye, in the middle, is shown what it would see.

    All views are its own, a pixel's colors lie in one place, and nothing is mirrored.
    """
    return replace(panel, width=width, height=height, views=1, subpixels="RGB", flip_x=False,
                   flip_y=False, cells=((0.0,) * 6,), cell_pattern="single")


def check_pixels(device: Device, texture: Any, display: Display, picture: LivePicture) -> None:
    """Raise `UserError` unless a texture holds a picture's own pixels, as a panel is sent them."""
    want = display.to_panel(picture.read(device, display))
    if not np.array_equal(pixels_of(device, texture), want):
        raise UserError("the window does not show the picture's own pixels (fewer colors than 8 "
                        "bits each, or a filter): switch that off")
