"""Parameters of pictures for frames, stereo viewers and flat screens."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from ...errors import UserError

__all__ = ["FrameConfig"]


@dataclass(frozen=True)
class FrameConfig:
    """Parameters of quilts, pairs, RGB-D pictures, anaglyphs and flat videos."""

    display: str = ""
    """Quilts: the display, a preset or a file; by default the one that the name's columns, rows and
    aspect fit. Pairs, RGB-D, anaglyphs: the screen, for its size and viewing distance."""
    pixels: tuple[int, int] = (0, 0)
    """Width and height in pixels: of the quilt, of one eye's picture, of the color half, of the
    flat video. By default the quilt's tiles have the display's customary size, at most 8192 pixels
    a side; one eye's picture has 1536 x 2048, a flat video 2160 x 3840."""
    eye_distance: float = 63.0
    """Pairs and anaglyphs: distance between the eyes in millimetres; smaller is flatter."""
    view_distance: float = 550.0
    """Pairs and anaglyphs: distance of the eyes from the screen in millimetres, where no display of
    known size gives it."""
    backdrop: float | None = None
    """Grey level behind the head, 0 to 1, instead of a painted ground. Without either it is white
    in flat videos, as these panels add their own depth to what is bright, and that of the coding in
    all others."""
    frames: int = 0
    """Videos: number of frames of one loop; 0 = 120. A .hop file with frames holds a video."""
    fps: float = 30.0
    """Videos: frames per second."""
    sway: float = 12.0
    """Videos: how far the head turns to each side, in degrees."""
    codec: Literal["auto", "h264", "hevc", "vp9"] = "auto"
    """Videos: auto: H.264, or HEVC above 4096 pixels a side; VP9 in .webm files; HEVC for flat
    videos."""
    media_player: bool = False
    """Flat videos: turn the picture a quarter to the left, as the panel's own player wants it."""

    def __post_init__(self) -> None:
        def need(good: bool, text: str) -> None:
            if not good:
                raise UserError(text)

        need(self.pixels == (0, 0) or all(2 <= side <= 65536 for side in self.pixels),
             f"--pixels takes a width and a height of 2 to 65536, not {self.pixels[0]} "
             f"{self.pixels[1]}")
        need(0 <= self.eye_distance <= 1000,
             f"--eye-distance must be 0 to 1000 mm, not {self.eye_distance:g}")
        need(100 <= self.view_distance <= 1e5,
             f"--view-distance must be 100 to 100000 mm, not {self.view_distance:g}")
        need(self.backdrop is None or 0 <= self.backdrop <= 1,
             f"--backdrop must be 0 (black) to 1 (white), not {self.backdrop}")
        need(0 <= self.frames <= 100_000, f"--frames must be 0 to 100000, not {self.frames}")
        need(math.isfinite(self.fps) and 0 < self.fps <= 1000,
             f"--fps must be more than 0 and at most 1000, not {self.fps:g}")
        need(0 <= self.sway <= 90, f"--sway must be 0 to 90 degrees, not {self.sway:g}")
