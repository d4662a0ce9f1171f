"""Pictures and videos of a field by what the name of the file asks for."""

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
from .config import FrameConfig
from .eyes import TwoEyes, anaglyph_of
from .framing import Margins, framed
from .hop import write_hop
from .metadata import quilt_block, quilt_exif, quilt_settings
from .moving import Flat, codec_for, write_moving
from .names import VIDEOS, Kind, QuiltName, kind_of, safe_names
from .pictures import check_picture, picture_bytes, write_picture
from .quilts import QuiltPlan, write_quilt

__all__ = ["export_frame"]

_WHITE = 1.0


def export_frame(field: VoxelField, path: Path, config: FrameConfig | None = None,
                 encode: EncodeConfig | None = None, *,
                 step: Callable[[int, int], None] = lambda at, count: None) -> dict[str, Any]:
    """Write a field as a picture or a video for a frame, a stereo viewer or a flat panel.

    Parameters
    ----------
    field
        The field.
    path
        ``NAME_qsCxRaA.png``, ``.jpg``, ``.webp``: a quilt; ``NAME.hop``: one packed for Looking
        Glass Studio; ``NAME_2x1``: a stereo pair, left eye left; ``NAME_rgbd``: color and depth;
        ``NAME_anaglyph``: for red and cyan glasses. Quilts, pairs and anaglyphs may be videos; any
        other video is a flat panel's.
    config
        Size, eyes, motion.
    encode
        Placement of the head.
    step
        Called before each frame of a video with its number and their count.

    Returns
    -------
    figures
        ``kind``, ``size``, ``bytes``, ``out`` and what belongs to the kind: ``views``, ``display``,
        ``parallax_percent``, ``frames``, ``codec``.

    Raises
    ------
    UserError
        If the name asks for nothing known, or its format can't hold the picture.
    """
    kind = kind_of(path)
    if kind is None:
        raise UserError(f"{path.name} is no name of a picture, a video or a package")
    config = config or FrameConfig()
    encode = encode or EncodeConfig()
    if config.backdrop is not None:
        # Who asks for a grey level, be it black, gets no painting.
        ground = "black" if encode.ground == "painted" else encode.ground
        encode = dataclasses.replace(encode, background=config.backdrop, ground=ground)
    elif kind == "flat" and backdrop_of(field, encode) is None and encode.ground != "black":
        encode = dataclasses.replace(encode, background=_WHITE)
    make = {"quilt": _quilt, "hop": _hop, "flat": _flat}.get(kind, _two_eyes)
    figures = make(field, path, config, encode, step, kind)
    out = figures.setdefault("out", path)
    return {"kind": kind, **figures, "bytes": figures.get("bytes", out.stat().st_size)}


Step = Callable[[int, int], None]


def _quilt(field: VoxelField, path: Path, config: FrameConfig, encode: EncodeConfig, step: Step,
           kind: Kind) -> dict[str, Any]:
    plan = QuiltPlan.of(path.name, config)
    out = QuiltName.completed(path, plan.layout)
    figures = {"size": plan.size, "views": plan.layout.count, "display": plan.display.name,
               "out": out}
    if path.suffix.lower() in VIDEOS:
        figures |= write_moving(out, lambda place: plan.picture(field, place), plan.size, encode,
                                config, comment=quilt_block(plan.layout), step=step)
        write_json(out.with_name(f"{out.name}.json"), quilt_settings(plan.layout, movie=True))
        return figures
    check_picture(out, *plan.size)
    return figures | write_quilt(out, plan.picture(field, encode), plan.layout)


def _hop(field: VoxelField, path: Path, config: FrameConfig, encode: EncodeConfig, step: Step,
         kind: Kind) -> dict[str, Any]:
    plan = QuiltPlan.of(path.stem, config)
    name = QuiltName.completed(Path(f"{safe_names([path.stem])[0]}.png"), plan.layout).name
    figures = {"size": plan.size, "views": plan.layout.count, "display": plan.display.name}
    if not config.frames:
        contents = picture_bytes(".png", plan.picture(field, encode), quilt_exif(plan.layout))
        return figures | write_hop(path, name, contents, plan.layout)
    with temporary_folder() as folder:
        movie = folder / f"{name[:-4]}.mp4"
        figures |= write_moving(movie, lambda place: plan.picture(field, place), plan.size, encode,
                                config, comment=quilt_block(plan.layout), step=step)
        return figures | write_hop(path, movie.name, movie, plan.layout, movie=True)


def _flat(field: VoxelField, path: Path, config: FrameConfig, encode: EncodeConfig, step: Step,
          kind: Kind) -> dict[str, Any]:
    codec_for(path, (0, 0), config.codec, flat=True)
    flat = Flat.of(field, encode, config)
    return {"size": flat.size, **write_moving(
        path, lambda place: flat.picture(field, place), flat.size, flat.encode, config, flat=True,
        step=step)}


def _two_eyes(field: VoxelField, path: Path, config: FrameConfig, encode: EncodeConfig, step: Step,
              kind: Kind) -> dict[str, Any]:
    eyes = TwoEyes.of(config)
    moving = path.suffix.lower() in VIDEOS
    encode = framed(field, eyes.window, encode, Margins(),
                    turns=(-config.sway, 0.0, config.sway) if moving else (0.0,),
                    eyes=(-eyes.baseline / 2, eyes.baseline / 2))
    size = eyes.window.width, eyes.window.height
    if kind != "anaglyph":
        size = 2 * size[0], size[1]
    seen: list[list[float]] = []

    def picture(place: EncodeConfig) -> NDArray[np.uint8]:
        left, right, parallax = eyes.both(field, place)
        seen.append(parallax)
        return anaglyph_of(left, right) if kind == "anaglyph" else np.hstack([left, right])

    if moving:
        if kind == "rgbd":
            raise UserError("color and depth are written as a picture: end the name in _rgbd.png")
        figures = write_moving(path, picture, size, encode, config, step=step)
    else:
        check_picture(path, *size)
        figures = {}
        if kind == "rgbd":
            image, figures = eyes.with_depth(field, encode)
        else:
            image = picture(encode)
        write_picture(path, image)
    if seen:
        figures["parallax_percent"] = [min(far for far, _ in seen), max(near for _, near in seen)]
    return {"size": size, **figures}
