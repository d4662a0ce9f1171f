"""Pictures and videos of a field for frames, stereo viewers and flat panels.

The head is as large in a picture's frame as it may be in all views that are shown. Two eyes get
side-by-side pairs, anaglyphs, or a picture with its depth beside it; frames get moving quilts, and
the maker's newer panels flat videos.

Quilts larger than 4096 pixels a side are more than H.264's decoders take: they are coded as HEVC,
or, where the installed FFmpeg can't, as VP9. Both are read by Looking Glass's own programs.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ... import lightfield
from ...arrays import Array, Float64, UInt8
from ...color import linear_light, to_uint8
from ...errors import UserError
from ...field import Rendering, VoxelField
from ...files import write_json
from ...lightfield import Display, EncodeConfig, Ground, Placement
from ...temporary import temporary_folder
from ..kinds import ExportContext
from ..video import ENCODERS, Codec, has_encoder, write_video
from . import files
from .files import VIDEOS, FrameConfig
from .quilts import QuiltPlan, write_quilt

_SOLID = 10.0  # Densities below this are fog, which nobody sees at the border.
_FLOATING = 5e-4
"""Share of the solid points that may stand out at each side: what floats about the head."""
_MOST_POINTS = 20_000
_NEAREST = 0.9  # How near the head may come to the eyes, as a share of their distance.


@dataclass(frozen=True)
class Margins:
    """What is left free around a head, as shares of the picture's height (top, bottom) and width.

    ``stands``: the head stands on the lower margin; otherwise it is in the middle.
    """

    top: float = 0.04
    bottom: float = 0.04
    side: float = 0.04
    stands: bool = False


def framed(field: VoxelField, window: Display, encode: EncodeConfig, margins: Margins, *,
           turns: Sequence[float] = (0.0,), eyes: Sequence[float] = (0.0,)) -> EncodeConfig:
    """The placement whose head fills the frame, a window with the eyes' distance, in its margins.

    Size and shifts of ``encode`` away from their defaults change the framing in proportion; the
    rest is kept. ``turns`` are degrees by which the head is turned besides that, ``eyes`` the x of
    the eyes in half heights of the frame.
    """
    points, voxel = _outline(field)
    views = []
    for turn in turns:
        angle = np.radians(encode.turn + turn)
        x, z = points[:, 0], points[:, 2]
        # As `Placement.to_world` turns it, backwards.
        views.append(np.stack([np.cos(angle) * x + np.sin(angle) * z, points[:, 1],
                               np.cos(angle) * z - np.sin(angle) * x], axis=1))
    seen = np.concatenate(views)
    low, high = 0.0, 4.0
    for _ in range(40):
        scale = (low + high) / 2
        shifts = _room(seen, scale, voxel, window, encode, margins, eyes)
        low, high = (scale, high) if shifts else (low, scale)
    shifts = _room(seen, low, voxel, window, encode, margins, eyes)
    if shifts is None or low < 0.005:
        raise UserError("the head does not fit between the eyes and the picture: lower "
                        "--encode.focus")
    usual = EncodeConfig()
    shift = shifts[0] if margins.stands else (shifts[0] + shifts[1]) / 2
    return replace(
        # `Placement.of` makes heads smaller on narrow panels; here the frame does.
        encode, size=low / min(1.0, window.aspect * 1.15) * encode.size / usual.size,
        shift_x=encode.shift_x - usual.shift_x, shift_y=shift + encode.shift_y - usual.shift_y)


def _outline(field: VoxelField) -> tuple[Float64, float]:
    """Solid points of a field, float64 [N, 3], and the size of its voxels."""
    solid = field.density > _SOLID
    points: Array = field.lattice_points()[solid] if solid.any() else field.bounds
    low, high = np.quantile(points, [_FLOATING, 1 - _FLOATING], axis=0)
    points = points[((points >= low) & (points <= high)).all(axis=1)] if len(points) > 2 else points
    voxel = float((2.0 * field.radius / field.links.shape[::-1]).max())
    return np.asarray(points[::len(points) // _MOST_POINTS + 1], np.float64), voxel


def _room(points: Float64, scale: float, voxel: float, window: Display,
          encode: EncodeConfig, margins: Margins, eyes: Sequence[float],
          ) -> tuple[float, float] | None:
    """Lowest and highest shift upwards with which a head of this scale lies within the margins."""
    distance = window.distance
    depth = encode.depth_scale * scale * points[:, 2] + encode.focus
    if depth.max() > _NEAREST * distance:
        return None
    larger = distance / (distance - depth)
    pad = 2 * scale * voxel
    across = window.aspect * (1 - 2 * margins.side)
    for eye in eyes:
        place = eye + (scale * points[:, 0] - eye) * larger
        if np.abs(place).max() + pad > across:
            return None
    low = float(((-1 + 2 * margins.bottom) / larger - scale * points[:, 1]).max()) + pad
    high = float(((1 - 2 * margins.top) / larger - scale * points[:, 1]).min()) - pad
    return (low, high) if low <= high else None


_PIXELS = (1536, 2048)
_OUTERMOST = 1e-3
"""Share of a surface's pixels that are left out at the near and at the far end of its depth."""
_CYAN = np.array([[-0.0434706, -0.0879388, -0.00155529], [0.378476, 0.73364, -0.0184503],
                  [-0.0721527, -0.112961, 1.2264]])
_RED = np.array([[0.4561, 0.500484, 0.176381], [-0.0400822, -0.0378246, -0.0157589],
                 [-0.0152161, -0.0205971, -0.00546856]])
"""What each eye's picture gives to red, green and blue (rows), for red and cyan glasses: Dubois's
least-squares projection (2001), in linear light. White stays white."""


@dataclass(frozen=True)
class TwoEyes:
    """A window, and two eyes before it."""

    window: Display  # The picture's frame: its pixels and the distance of the eyes.
    baseline: float  # Distance between the eyes in half heights of the window.

    @staticmethod
    def of(config: FrameConfig) -> TwoEyes:
        """The window and the eyes that the parameters ask for."""
        panel = Display.resolve(config.display) if config.display else None
        distance, millimetres = (panel.distance, panel.panel_height * 500) if panel else (4.0, 0.0)
        pixels = (config.pixels if config.pixels[0]
                  else (panel.width, panel.height) if panel else _PIXELS)
        # Where the screen's size is unknown, only the angle between the eyes is right.
        unit = millimetres or config.view_distance / distance
        return TwoEyes(Display(*pixels, views=1, pitch=3.0, distance=distance),
                       config.eye_distance / unit)

    def look(self, field: VoxelField, encode: EncodeConfig, eye: float,
             ground: Ground | None = None) -> Rendering:
        """What an eye at ``eye``, from -1 (left) to 1 (right), sees in the window.

        Where it sees the ground, the depth is the ground's.
        """
        camera = lightfield.view_camera(self.window, encode, eye * self.baseline / 2,
                                        width=self.window.width, height=self.window.height)
        if ground is None:
            return field.render(camera, 0, background=encode.background)
        shot = field.render(camera, 0, background=ground.seen(camera))
        # The window's axis is upright on the ground: all of it is equally far.
        place = ground.placement
        plane = (place.deep_distance(self.window) + ground.depth / place.depth) / place.scale
        return replace(shot, depth=np.minimum(shot.depth, np.float32(plane)))

    def parallax(self, shot: Rendering, encode: EncodeConfig) -> list[float]:
        """How far apart the eyes see the farthest and the nearest point, in % of the width.

        Positive: in front of the window. Zero both where nothing is seen.
        """
        depth = shot.depth[np.isfinite(shot.depth)]
        if not depth.size:
            return [0.0, 0.0]
        placement = Placement.of(self.window, encode)
        plane = placement.deep_distance(self.window) / placement.scale
        ends = np.quantile(depth, [1 - _OUTERMOST, _OUTERMOST])
        shift = self.baseline * (plane / ends - 1) / (2 * self.window.aspect)
        return [round(100 * float(value), 2) for value in shift]

    def both(self, field: VoxelField, encode: EncodeConfig,
             ) -> tuple[UInt8, UInt8, list[float]]:
        """The left and the right picture, uint8 [H, W, 3], and their `parallax`."""
        ground = window_ground(field, self.window, encode)
        left, right = (self.look(field, encode, eye, ground) for eye in (-1.0, 1.0))
        return to_uint8(left.color), to_uint8(right.color), self.parallax(left, encode)

    def with_depth(self, field: VoxelField, encode: EncodeConfig,
                   ) -> tuple[UInt8, dict[str, Any]]:
        """A picture, and its depth right of it: white is near; uint8 [H, 2 W, 3].

        The nearest point is 255, the farthest 1, where there is nothing 0. ``covered`` of the
        figures is the share of the picture where there is something.
        """
        shot = self.look(field, encode, 0.0, window_ground(field, self.window, encode))
        seen = np.isfinite(shot.depth)
        depth = np.zeros(shot.depth.shape, np.uint8)
        if seen.any():
            near, far = np.quantile(shot.depth[seen], [_OUTERMOST, 1 - _OUTERMOST])
            share = (far - shot.depth[seen]) / max(far - near, 1e-6)
            depth[seen] = 1.5 + 254 * np.clip(share, 0, 1)
        return np.hstack([to_uint8(shot.color), np.repeat(depth[..., None], 3, axis=2)]), {
            "covered": round(float(seen.mean()), 4)}


def window_ground(field: VoxelField, window: Display, encode: EncodeConfig) -> Ground | None:
    """The ground behind a head in a window, as sharp as it is: there are no lenses to blur it."""
    return lightfield.ground_of(field, window, replace(encode, ground_blur=0.0))


def anaglyph_of(left: UInt8, right: UInt8) -> UInt8:
    """Two pictures as one for glasses with a red left and a cyan right side: uint8 [H, W, 3]."""
    light = linear_light(np.arange(256) / 255.0).astype(np.float32)
    mixed = light[left] @ _RED.T.astype(np.float32) + light[right] @ _CYAN.T.astype(np.float32)
    # The inverse of the curve: the nearest of the 256 values, by a table of the light.
    table = np.searchsorted((light[1:] + light[:-1]) / 2, np.linspace(0, 1, 65536)).astype(np.uint8)
    return np.asarray(table[(np.clip(mixed, 0, 1) * 65535 + 0.5).astype(np.uint16)])


FLAT = (2160, 3840)
_SAFE = Margins(355 / 3840, 100 / 3840, 108 / 2160, stands=True)
"""What the maker asks to leave free. The head stands, as things stand in the panel's box."""
_LARGEST_H264 = 4096
_FRAMES = 120
_QUALITY = {"h264": 18, "hevc": 20, "vp9": 24}  # Rate factors; the maker's advice for HEVC.
_FLAT_QUALITY = 18


def codec_for(path: Path, size: tuple[int, int], asked: Literal["auto", "h264", "hevc", "vp9"],
              flat: bool = False) -> Codec:
    """The codec of a video by its name, its size and what is asked for.

    Where the installed FFmpeg lacks HEVC, quilts are coded as VP9, with a warning.
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


def write_moving(path: Path, picture: Callable[[EncodeConfig], UInt8],
                 size: tuple[int, int], encode: EncodeConfig, config: FrameConfig, *,
                 flat: bool = False, comment: str = "",
                 step: Callable[[int, int], None] = lambda at, count: None) -> dict[str, Any]:
    """Write a video of a head that sways about ``encode``; returns ``frames`` and ``codec``.

    ``picture`` makes a frame, uint8 [H, W, 3], by its placement; ``size`` is their width and
    height; ``comment`` goes into the file's metadata; ``step`` is called before each frame with its
    number and their count.
    """
    codec = codec_for(path, size, config.codec, flat)
    # A loop without a seam.
    steps = config.frames or _FRAMES
    turns = config.sway * np.sin(2 * math.pi * np.arange(steps) / steps)

    def frames() -> Iterator[UInt8]:
        for number, turn in enumerate(turns):
            step(number, len(turns))
            yield picture(replace(encode, turn=encode.turn + float(turn)))

    count = write_video(path, frames(), config.fps, codec=codec,
                        quality=_FLAT_QUALITY if flat else _QUALITY[codec], comment=comment)
    return {"frames": count, "codec": codec}


@dataclass(frozen=True)
class Flat:
    """The head on a flat panel, inside its safe areas in every frame."""

    window: Display  # The panel.
    encode: EncodeConfig  # Placement of the head, filling the safe areas.
    turned: bool = False  # Whether the picture lies on its side for the panel's own player.

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

    def picture(self, field: VoxelField, encode: EncodeConfig) -> UInt8:
        """A frame, uint8 [H, W, 3]."""
        camera = lightfield.view_camera(self.window, encode, 0.0, width=self.window.width,
                                        height=self.window.height)
        ground = window_ground(field, self.window, encode)
        behind = encode.background if ground is None else ground.seen(camera)
        frame = to_uint8(field.render(camera, 0, background=behind).color)
        return np.ascontiguousarray(np.rot90(frame)) if self.turned else frame


_WHITE = 1.0


def _placed(config: FrameConfig, encode: EncodeConfig) -> EncodeConfig:
    """The placement with the ground that is asked for."""
    if config.backdrop is None:
        return encode
    # Who asks for a grey level, be it black, gets no painting.
    ground = "black" if encode.ground == "painted" else encode.ground
    return replace(encode, background=config.backdrop, ground=ground)


def _on_panel(config: FrameConfig, context: ExportContext) -> FrameConfig:
    """The parameters with a display, where one is named at all."""
    return config if config.display else replace(config, display=context.display)


def write_quilt_of(field: VoxelField, path: Path, config: FrameConfig,
                   context: ExportContext) -> dict[str, Any]:
    """A quilt, a picture or a video; it is composed as `lfportrait.lightfield.quilt_of` does."""
    encode = _placed(config, context.encode)
    plan = QuiltPlan.of(path.name, _on_panel(config, context))
    out = files.QuiltName.completed(path, plan.layout)
    figures = {"size": plan.size, "views": plan.layout.count, "display": plan.display.name,
               "out": out}
    if path.suffix.lower() in VIDEOS:
        figures |= write_moving(out, lambda place: plan.picture(field, place), plan.size, encode,
                                config, comment=files.quilt_block(plan.layout), step=context.step)
        write_json(out.with_name(f"{out.name}.json"), files.quilt_settings(plan.layout, movie=True))
        return figures
    files.check_picture(out, *plan.size)
    return figures | write_quilt(out, plan.picture(field, encode), plan.layout)


def write_package(field: VoxelField, path: Path, config: FrameConfig,
                  context: ExportContext) -> dict[str, Any]:
    """A quilt packed for Looking Glass Studio."""
    encode = _placed(config, context.encode)
    plan = QuiltPlan.of(path.stem, _on_panel(config, context))
    safe = Path(f"{files.safe_names([path.stem])[0]}.png")
    name = files.QuiltName.completed(safe, plan.layout).name
    figures = {"size": plan.size, "views": plan.layout.count, "display": plan.display.name}
    if not config.frames:
        contents = files.picture_bytes(".png", plan.picture(field, encode),
                                       files.quilt_exif(plan.layout))
        return figures | files.write_hop(path, name, contents, plan.layout)
    with temporary_folder() as folder:
        movie = folder / f"{name[:-4]}.mp4"
        figures |= write_moving(movie, lambda place: plan.picture(field, place), plan.size, encode,
                                config, comment=files.quilt_block(plan.layout), step=context.step)
        return figures | files.write_hop(path, movie.name, movie, plan.layout, movie=True)


def write_flat(field: VoxelField, path: Path, config: FrameConfig,
               context: ExportContext) -> dict[str, Any]:
    """A video for a flat panel, white behind where nothing else is asked for."""
    encode = _placed(config, context.encode)
    if (config.backdrop is None and lightfield.backdrop_of(field, encode) is None
            and encode.ground != "black"):
        encode = replace(encode, background=_WHITE)
    codec_for(path, (0, 0), config.codec, flat=True)
    flat = Flat.of(field, encode, config)
    return {"size": flat.size, **write_moving(
        path, lambda place: flat.picture(field, place), flat.size, flat.encode, config, flat=True,
        step=context.step)}


def write_pair(field: VoxelField, path: Path, config: FrameConfig,
               context: ExportContext) -> dict[str, Any]:
    """A stereo pair, left eye left; a picture or a video."""
    return _two_eyes(field, path, config, context, lambda left, right: np.hstack([left, right]), 2)


def write_anaglyph(field: VoxelField, path: Path, config: FrameConfig,
                   context: ExportContext) -> dict[str, Any]:
    """Both eyes in one picture or video, for red and cyan glasses."""
    return _two_eyes(field, path, config, context, anaglyph_of, 1)


def write_with_depth(field: VoxelField, path: Path, config: FrameConfig,
                     context: ExportContext) -> dict[str, Any]:
    """Color and depth, side by side."""
    if path.suffix.lower() in VIDEOS:
        raise UserError("color and depth are written as a picture: end the name in _rgbd.png")
    eyes = TwoEyes.of(config)
    size = 2 * eyes.window.width, eyes.window.height
    encode = _framed(field, eyes, config, context)
    files.check_picture(path, *size)
    image, figures = eyes.with_depth(field, encode)
    files.write_picture(path, image)
    return {"size": size, **figures}


def _two_eyes(field: VoxelField, path: Path, config: FrameConfig, context: ExportContext,
              joined: Callable[[UInt8, UInt8], UInt8], wide: int) -> dict[str, Any]:
    """Pictures of both eyes, joined to one that is so many times as wide."""
    eyes = TwoEyes.of(config)
    moving = path.suffix.lower() in VIDEOS
    encode = _framed(field, eyes, config, context,
                     (-config.sway, 0.0, config.sway) if moving else (0.0,))
    size = wide * eyes.window.width, eyes.window.height
    seen: list[list[float]] = []

    def picture(place: EncodeConfig) -> UInt8:
        left, right, parallax = eyes.both(field, place)
        seen.append(parallax)
        return joined(left, right)

    figures: dict[str, Any] = {"size": size}
    if moving:
        figures |= write_moving(path, picture, size, encode, config, step=context.step)
    else:
        files.check_picture(path, *size)
        files.write_picture(path, picture(encode))
    return {**figures, "parallax_percent": [min(far for far, _ in seen),
                                            max(near for _, near in seen)]}


def _framed(field: VoxelField, eyes: TwoEyes, config: FrameConfig, context: ExportContext,
            turns: tuple[float, ...] = (0.0,)) -> EncodeConfig:
    """The head as large as both eyes can see it."""
    return framed(field, eyes.window, _placed(config, context.encode), Margins(), turns=turns,
                  eyes=(-eyes.baseline / 2, eyes.baseline / 2))
