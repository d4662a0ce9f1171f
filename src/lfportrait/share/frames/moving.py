"""Videos for frames: moving quilts and pairs, and the flat video of the maker's newer panels.

Quilts larger than 4096 pixels a side are more than H.264's decoders take: they are coded as HEVC,
or, where the installed FFmpeg can't, as VP9. Both are read by Looking Glass's own programs.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...field import VoxelField
from ...lightfield import Display, EncodeConfig, view_camera
from ..video import ENCODERS, Codec, has_encoder, write_video
from .config import FrameConfig
from .eyes import window_ground
from .framing import Margins, framed

__all__ = ["FLAT", "Flat", "codec_for", "write_moving"]

FLAT = (2160, 3840)
_SAFE = Margins(355 / 3840, 100 / 3840, 108 / 2160, stands=True)
"""What the maker asks to leave free. The head stands, as things stand in the panel's box."""
_LARGEST_H264 = 4096
_FRAMES = 120
_QUALITY = {"h264": 18, "hevc": 20, "vp9": 24}
"""Rate factors; the maker's advice for HEVC."""
_FLAT_QUALITY = 18


def codec_for(path: Path, size: tuple[int, int], asked: Literal["auto", "h264", "hevc", "vp9"],
              flat: bool = False) -> Codec:
    """The codec of a video by its name, its size and what is asked for.

    Where the installed FFmpeg lacks HEVC, quilts are coded as VP9, with a warning.

    Raises
    ------
    UserError
        If the file's format or the codec can't hold it, or there is no encoder.
    """
    webm = path.suffix.lower() == ".webm"
    if flat and (webm or asked in ("h264", "vp9")):
        raise UserError("flat panels play HEVC alone: end the name in .mp4, and leave out --codec")
    if webm and asked not in ("auto", "vp9"):
        raise UserError(f"a .webm file holds VP9, not {asked}: end the name in .mp4")
    large = max(size) > _LARGEST_H264
    if asked == "h264" and large:
        raise UserError(f"H.264 goes up to {_LARGEST_H264} pixels a side, not {size[0]} x "
                        f"{size[1]}: leave out --codec, or make it smaller with --pixels")
    wanted: Codec = asked if asked != "auto" else (
        "vp9" if webm else "hevc" if large or flat else "h264")
    if has_encoder(wanted):
        return wanted
    if asked == "auto" and wanted == "hevc" and not flat and has_encoder("vp9"):
        warnings.warn("this installation can't code HEVC: the video is VP9, which Looking Glass "
                      "Bridge plays, too", UserWarning, stacklevel=2)
        return "vp9"
    raise UserError(f"this installation can't code {wanted.upper()} ({ENCODERS[wanted]} is missing "
                    "in PyAV): install the av package from PyPI, or choose another --codec")


def _turns(config: FrameConfig) -> NDArray[np.float64]:
    """Turn of the head in each frame of a loop without a seam, in degrees."""
    count = config.frames or _FRAMES
    return config.sway * np.sin(2 * math.pi * np.arange(count) / count)


def write_moving(path: Path, picture: Callable[[EncodeConfig], NDArray[np.uint8]],
                 size: tuple[int, int], encode: EncodeConfig, config: FrameConfig, *,
                 flat: bool = False, comment: str = "",
                 step: Callable[[int, int], None] = lambda at, count: None) -> dict[str, Any]:
    """Write a video of a head that sways.

    Parameters
    ----------
    path
        The file.
    picture
        Makes a frame, uint8 [H, W, 3], by its placement.
    size
        Width and height of the frames.
    encode
        Placement of the head in the middle of the motion.
    config
        Number of frames, sway and codec.
    flat
        Whether it is a flat panel's video.
    comment
        Written into the file's metadata.
    step
        Called before each frame with its number and their count.

    Returns
    -------
    figures
        ``frames`` and ``codec``.
    """
    codec = codec_for(path, size, config.codec, flat)
    turns = _turns(config)

    def frames() -> Iterator[NDArray[np.uint8]]:
        for number, turn in enumerate(turns):
            step(number, len(turns))
            yield picture(dataclasses.replace(encode, turn=encode.turn + float(turn)))

    count = write_video(path, frames(), config.fps, codec=codec,
                        quality=_FLAT_QUALITY if flat else _QUALITY[codec], comment=comment)
    return {"frames": count, "codec": codec}


@dataclasses.dataclass(frozen=True)
class Flat:
    """The head on a flat panel, inside its safe areas in every frame.

    Attributes
    ----------
    window
        The panel.
    encode
        Placement of the head, filling the safe areas.
    turned
        Whether the picture lies on its side for the panel's own player.
    """

    window: Display
    encode: EncodeConfig
    turned: bool = False

    @staticmethod
    def of(field: VoxelField, encode: EncodeConfig, config: FrameConfig) -> Flat:
        """The placement whose head is as large as the safe areas allow."""
        width, height = config.pixels if config.pixels[0] else FLAT
        window = Display(width, height, views=1, pitch=3.0)
        placed = framed(field, window, encode, _SAFE, turns=(-config.sway, 0.0, config.sway))
        return Flat(window, placed, config.media_player)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the frames."""
        size = self.window.width, self.window.height
        return size[::-1] if self.turned else size

    def picture(self, field: VoxelField, encode: EncodeConfig) -> NDArray[np.uint8]:
        """A frame, uint8 [H, W, 3]."""
        camera = view_camera(self.window, encode, 0.0, width=self.window.width,
                             height=self.window.height)
        ground = window_ground(field, self.window, encode)
        behind = encode.background if ground is None else ground.seen(camera)
        color = field.render(camera, 0, background=behind).color
        frame = (np.clip(color, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
        return np.ascontiguousarray(np.rot90(frame)) if self.turned else frame
