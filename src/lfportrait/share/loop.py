"""A short loop for messengers: the head turns a little, so that it is seen to be solid.

A camera goes around an ellipse in front of the face. That shows parallax in both directions and
has no turning points, at which a sweep seems to stop. It stays where a head from one photo is good.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ..arrays import UInt8
from ..capture import Camera
from ..errors import UserError
from ..field import VoxelField
from ..files import atomic_path
from ..lightfield import eight_bit, render_views
from .kinds import ExportContext, LoopConfig
from .paths import good_cone, sweep_cameras, sweep_ground
from .video import write_video

__all__ = ["loop_cameras", "write_loop"]

_QUALITY = 80
"""Of WebP: strokes keep their edges, and a loop of 480 pixels has about half a megabyte."""
_TICK = 10
"""Milliseconds in which GIF files count; players show less than two of them as ten."""


def loop_cameras(config: LoopConfig, field: VoxelField) -> Camera:
    """The cameras of a loop, from above the middle to the head's left side and on.

    Parameters
    ----------
    config
        Frames, size and the ellipse's radii.
    field
        Whose extent to frame, and which may limit the turn (`VoxelField.cone`).
    """
    share = np.arange(config.frames) / config.frames
    wide = good_cone(field, 2 * config.sway)
    yaw = 0.5 * wide * np.sin(2 * np.pi * share)
    pitch = config.rise * np.cos(2 * np.pi * share)
    # One camera of a sweep frames the head for all of them.
    whole = sweep_cameras(0.0, 1, config.size, field)
    height, distance = float(whole.position[0, 1]), float(whole.position[0, 2])
    return Camera.concatenate([
        Camera.arc(np.array([turn]), distance=distance, width=config.size, height=config.size,
                   focal=float(whole.focal[0, 0]), target=(0.0, height, 0.0), pitch=float(up))
        for turn, up in zip(yaw, pitch)])


def _frames(field: VoxelField, config: LoopConfig, context: ExportContext,
            ) -> Iterator[UInt8]:
    """The pictures of a loop, uint8 [size, size, 3]."""
    cameras = loop_cameras(config, field)
    seen = render_views(field, cameras, background=context.encode.background,
                        ground=sweep_ground(field, context.encode, cameras))
    for number in range(len(cameras)):
        context.step(number, len(cameras))
        yield eight_bit(next(seen).color)


def write_loop(field: VoxelField, path: Path, config: LoopConfig,
               context: ExportContext) -> dict[str, Any]:
    """Write a loop as MP4, GIF or WebP, by the file's name.

    Parameters
    ----------
    field, path, config, context
        As `lfportrait.share.Export.write` has them.

    Returns
    -------
    figures
        ``frames``.

    Raises
    ------
    UserError
        If the file can't be written.
    """
    frames = _frames(field, config, context)
    if path.suffix.lower() == ".mp4":
        return {"frames": write_video(path, frames, config.fps, quality=20)}
    pictures = [Image.fromarray(frame) for frame in frames]
    wait = max(_TICK, round(1000 / config.fps / _TICK) * _TICK)
    options: dict[str, Any] = {"quality": _QUALITY, "method": 4}
    if path.suffix.lower() == ".gif":
        # One palette for all frames, and no dithering: that would shimmer.
        palette = _palette(pictures)
        pictures = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures]
        options = {"optimize": False, "disposal": 1}
    try:
        with atomic_path(path) as temporary:
            pictures[0].save(temporary, save_all=True, append_images=pictures[1:], loop=0,
                             duration=wait, format=path.suffix[1:].upper(), **options)
    except OSError as error:
        raise UserError(f"can't write {path}: {error.strerror or error}") from error
    return {"frames": len(pictures)}


def _palette(pictures: list[Image.Image]) -> Image.Image:
    """A palette of 256 colors that fits all frames, from a few of them side by side."""
    some = pictures[::max(1, len(pictures) // 6)]
    sheet = np.concatenate([np.asarray(one)[::2, ::2] for one in some], axis=1)
    return Image.fromarray(sheet).quantize(256, method=Image.Quantize.MEDIANCUT)
