"""Pictures and videos of a field for frames, stereo viewers and flat panels."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...field import VoxelField
from ...files import write_json
from ...lightfield import EncodeConfig, backdrop_of
from ...temporary import temporary_folder
from ..exporter import ExportContext
from .config import FrameConfig
from .eyes import TwoEyes, anaglyph_of
from .framing import Margins, framed
from .hop import write_hop
from .metadata import quilt_block, quilt_exif, quilt_settings
from .moving import Flat, codec_for, write_moving
from .names import VIDEOS, QuiltName, safe_names
from .pictures import check_picture, picture_bytes, write_picture
from .quilts import QuiltPlan, write_quilt

__all__ = ["write_anaglyph", "write_flat", "write_package", "write_pair", "write_quilt_of",
           "write_with_depth"]

Bytes = NDArray[np.uint8]

_WHITE = 1.0


def _placed(config: FrameConfig, encode: EncodeConfig) -> EncodeConfig:
    """The placement with the ground that is asked for."""
    if config.backdrop is None:
        return encode
    # Who asks for a grey level, be it black, gets no painting.
    ground = "black" if encode.ground == "painted" else encode.ground
    return dataclasses.replace(encode, background=config.backdrop, ground=ground)


def _on_panel(config: FrameConfig, context: ExportContext) -> FrameConfig:
    """The parameters with a display, where one is named at all."""
    return config if config.display else dataclasses.replace(config, display=context.display)


def write_quilt_of(field: VoxelField, path: Path, config: FrameConfig,
                   context: ExportContext) -> dict[str, Any]:
    """A quilt, a picture or a video; it is composed as `lfportrait.lightfield.quilt_of` does."""
    encode = _placed(config, context.encode)
    plan = QuiltPlan.of(path.name, _on_panel(config, context))
    out = QuiltName.completed(path, plan.layout)
    figures = {"size": plan.size, "views": plan.layout.count, "display": plan.display.name,
               "out": out}
    if path.suffix.lower() in VIDEOS:
        figures |= write_moving(out, lambda place: plan.picture(field, place), plan.size, encode,
                                config, comment=quilt_block(plan.layout), step=context.step)
        write_json(out.with_name(f"{out.name}.json"), quilt_settings(plan.layout, movie=True))
        return figures
    check_picture(out, *plan.size)
    return figures | write_quilt(out, plan.picture(field, encode), plan.layout)


def write_package(field: VoxelField, path: Path, config: FrameConfig,
                  context: ExportContext) -> dict[str, Any]:
    """A quilt packed for Looking Glass Studio."""
    encode = _placed(config, context.encode)
    plan = QuiltPlan.of(path.stem, _on_panel(config, context))
    name = QuiltName.completed(Path(f"{safe_names([path.stem])[0]}.png"), plan.layout).name
    figures = {"size": plan.size, "views": plan.layout.count, "display": plan.display.name}
    if not config.frames:
        contents = picture_bytes(".png", plan.picture(field, encode), quilt_exif(plan.layout))
        return figures | write_hop(path, name, contents, plan.layout)
    with temporary_folder() as folder:
        movie = folder / f"{name[:-4]}.mp4"
        figures |= write_moving(movie, lambda place: plan.picture(field, place), plan.size, encode,
                                config, comment=quilt_block(plan.layout), step=context.step)
        return figures | write_hop(path, movie.name, movie, plan.layout, movie=True)


def write_flat(field: VoxelField, path: Path, config: FrameConfig,
               context: ExportContext) -> dict[str, Any]:
    """A video for a flat panel, white behind where nothing else is asked for."""
    encode = _placed(config, context.encode)
    if (config.backdrop is None and backdrop_of(field, encode) is None
            and encode.ground != "black"):
        encode = dataclasses.replace(encode, background=_WHITE)
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
    check_picture(path, *size)
    image, figures = eyes.with_depth(field, encode)
    write_picture(path, image)
    return {"size": size, **figures}


def _two_eyes(field: VoxelField, path: Path, config: FrameConfig, context: ExportContext,
              joined: Callable[[Bytes, Bytes], Bytes], wide: int) -> dict[str, Any]:
    """Pictures of both eyes, joined to one that is so many times as wide."""
    eyes = TwoEyes.of(config)
    moving = path.suffix.lower() in VIDEOS
    encode = _framed(field, eyes, config, context,
                     (-config.sway, 0.0, config.sway) if moving else (0.0,))
    size = wide * eyes.window.width, eyes.window.height
    seen: list[list[float]] = []

    def picture(place: EncodeConfig) -> Bytes:
        left, right, parallax = eyes.both(field, place)
        seen.append(parallax)
        return joined(left, right)

    figures: dict[str, Any] = {"size": size}
    if moving:
        figures |= write_moving(path, picture, size, encode, config, step=context.step)
    else:
        check_picture(path, *size)
        write_picture(path, picture(encode))
    return {**figures, "parallax_percent": [min(far for far, _ in seen),
                                            max(near for _, near in seen)]}


def _framed(field: VoxelField, eyes: TwoEyes, config: FrameConfig, context: ExportContext,
            turns: tuple[float, ...] = (0.0,)) -> EncodeConfig:
    """The head as large as both eyes can see it."""
    return framed(field, eyes.window, _placed(config, context.encode), Margins(), turns=turns,
                  eyes=(-eyes.baseline / 2, eyes.baseline / 2))
