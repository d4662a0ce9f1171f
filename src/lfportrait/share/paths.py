"""Camera paths about a head: the sweep over a display's cone, the orbit, a loop, and their frames.

The loop for messengers is short: a camera goes around an ellipse in front of the face. That shows
parallax in both directions and has no turning points, at which a sweep seems to stop. It stays
where a head from one photo is good.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..arrays import Float64, UInt8
from ..capture import Camera
from ..errors import UserError
from ..field import VoxelField
from ..files import atomic_path
from ..lightfield import EncodeConfig, Ground, eight_bit, render_views, world_ground
from .kinds import ExportContext, LoopConfig
from .video import write_video

DISTANCE = 4.0  # Of the cameras from what they look at, in world units.
_MARGIN = 1.04


def head_extent(field: VoxelField | None) -> tuple[float, float, float]:
    """Extent that a picture must show: half width, lowest and highest point about the axis.

    The head lies in [-1, 1]^3; of the shoulders, only what is as wide and as low as that is shown.
    """
    if field is None:
        return 1.0, -1.0, 1.0
    reach, low, high = field.solid_extent
    # The lattice points' own reach: interpolation fades to nothing one voxel further out.
    voxel = float((2.0 * field.radius / field.links.shape[::-1]).max())
    reach, low, high = reach + voxel, low - voxel, high + voxel
    return min(max(reach, 0.5), 0.9), max(low, -1.0), min(high, 1.2)


def _arc(degrees: Float64, size: int, field: VoxelField | None, pitch: float = 0.0) -> Camera:
    """Cameras on an arc that see the whole head, framed the same in all of them."""
    reach, low, high = head_extent(field)
    half = _MARGIN * max(reach, (high - low) / 2)
    # The nearest point of the head's cylinder is the one that must fit.
    focal = 0.5 * size * np.sqrt(DISTANCE ** 2 - reach ** 2) / half
    target = (0.0, (low + high) / 2, 0.0)
    return Camera.arc(degrees, distance=DISTANCE, width=size, height=size, focal=focal,
                      target=target, pitch=pitch)


def good_cone(field: VoxelField, cone: float) -> float:
    """A cone in degrees, as far as the field can be looked at (`VoxelField.cone`)."""
    return min(cone, field.cone) if field.cone else cone


def sweep_degrees(frames: int, cone: float) -> Float64:
    """Yaw of each frame of a sweep there and back: slow at the ends, without a seam in a loop.

    Over the full width ``cone`` in degrees it runs 0, +cone/2, 0, -cone/2, 0.
    """
    return 0.5 * cone * np.sin(2.0 * np.pi * np.arange(frames) / frames)


def sweep_cameras(cone: float = 40.0, frames: int = 60, size: int = 512,
                  field: VoxelField | None = None) -> Camera:
    """Cameras of a horizontal sweep there and back over a view cone.

    Parameters
    ----------
    cone : Full width in degrees.
    frames : Number of frames of one loop.
    size : Width and height of the pictures in pixels.
    field : Whose extent to frame; by default the cube [-1, 1]^3 that holds a head.
    """
    return _arc(sweep_degrees(frames, cone), size, field)


def orbit_cameras(frames: int = 90, size: int = 512, field: VoxelField | None = None,
                  pitch: float = 0.0) -> Camera:
    """Cameras once around the head, from the front to its left side and on.

    Parameters
    ----------
    frames : Number of cameras.
    size : Width and height of the pictures in pixels.
    field : Whose extent to frame; by default the cube [-1, 1]^3 that holds a head.
    pitch : Degrees above the horizon.
    """
    return _arc(360.0 * np.arange(frames) / frames, size, field, pitch)


def path_cameras(path: Literal["sweep", "orbit"], *, frames: int = 60, cone: float = 40.0,
                 size: int = 512, field: VoxelField | None = None) -> Camera:
    """Cameras of a path by its name (`sweep_cameras`, `orbit_cameras`)."""
    if frames < 1 or size < 2:
        raise UserError("a path needs at least one frame of at least 2 pixels")
    if path == "sweep":
        return sweep_cameras(cone, frames, size, field)
    if path == "orbit":
        return orbit_cameras(frames, size, field)
    raise UserError(f"there is no path {path!r}; choose sweep or orbit")


def sweep_ground(field: VoxelField, config: EncodeConfig, cameras: Camera) -> Ground | None:
    """The ground behind a field for cameras of `sweep_cameras`, or None where there is none."""
    return world_ground(field, config, DISTANCE / float(cameras.focal[0].mean()))


def sweep_frames(field: VoxelField, cone: float = 40.0, frames: int = 60, size: int = 512, *,
                 background: float | NDArray[Any] = 1.0, ground: EncodeConfig | None = None,
                 ) -> Iterator[UInt8]:
    """Frames of a sweep, rendered one at a time.

    Parameters
    ----------
    cone, frames, size : See `sweep_cameras`.
    background : Grey level or RGB behind the head, in [0, 1].
    ground : What panels show behind the head is shown instead, where there is such a ground.

    Yields
    ------
    frame : uint8 [size, size, 3].
    """
    cameras = sweep_cameras(cone, frames, size, field)
    plane = None if ground is None else sweep_ground(field, ground, cameras)
    # There and back pass the same places: each is rendered once.
    yaw, first, places = np.unique(np.round(sweep_degrees(frames, cone), 9), return_index=True,
                                   return_inverse=True)
    last = np.array([np.flatnonzero(places == place)[-1] for place in range(len(yaw))])
    fresh = render_views(field, cameras, np.sort(first).tolist(), background=background,
                         ground=plane)
    kept: dict[int, UInt8] = {}
    for frame, place in enumerate(places.ravel().tolist()):
        if frame == first[place]:
            kept[place] = eight_bit(next(fresh).color)
        yield kept[place] if frame < last[place] else kept.pop(place)


_QUALITY = 80
"""Of WebP: strokes keep their edges, and a loop of 480 pixels has about half a megabyte."""
_TICK = 10  # Milliseconds in which GIF files count; players show less than two of them as ten.


def loop_cameras(config: LoopConfig, field: VoxelField) -> Camera:
    """The cameras of a loop, from above the middle to the head's left side and on.

    The field's extent is framed, and it may limit the turn (`VoxelField.cone`).
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
    """Write a loop as MP4, GIF or WebP, by the file's name (`lfportrait.share.Export.write`)."""
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
