"""Interlace quilts and folders of views for a panel.

Each sub-pixel takes its color from its view, at its own place on the panel. (A field is coded
directly, by `encode`, without pictures of views.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from ..media.folders import list_pictures, say_left_out
from ..media.kinds import kind_of
from ..media.pictures import read_image
from .display import Display
from .kernels.panel import interlace_views, lens_of
from .quilts import QuiltLayout, layout_for, warn_of_misfit

__all__ = ["InterlaceConfig", "assemble_quilt", "interlace", "quilt_tiles", "read_views"]


@dataclass(frozen=True)
class InterlaceConfig:
    """Parameters of coding pictures of views."""

    sample: Literal["linear", "nearest"] = "linear"
    """Interpolation within a view's picture: linear is smoother, nearest copies pixels exactly."""
    blend: Literal["nearest", "linear"] = "nearest"
    """nearest: a sub-pixel shows its nearest view; linear: its own place between two views, softer
    from view to view but less sharp off the panel."""
    fit: Literal["contain", "cover", "stretch"] = "contain"
    """If the views' aspect differs from the panel's: show all with bars, fill and crop, or
    stretch."""
    focus: float = 0.0
    """Shift the views so that content this far behind the panel (in half panel heights) moves onto
    it, where it is sharpest; negative: content in front."""


def quilt_tiles(quilt: NDArray[np.uint8], layout: QuiltLayout) -> NDArray[np.uint8]:
    """The views of a quilt, view 0 first: uint8 [columns * rows, h, w, 3].

    Raises
    ------
    UserError
        If the picture has fewer pixels than tiles.
    """
    height, width = quilt.shape[0] // layout.rows, quilt.shape[1] // layout.columns
    if height < 1 or width < 1:
        raise UserError(f"a picture of {quilt.shape[1]} x {quilt.shape[0]} pixels is no quilt of "
                        f"{layout.columns} x {layout.rows} views")
    tiles = [quilt[quilt.shape[0] - (row + 1) * height:quilt.shape[0] - row * height,
                   column * width:(column + 1) * width]
             for row in range(layout.rows) for column in range(layout.columns)]
    return np.stack(tiles)


def assemble_quilt(tiles: NDArray[np.uint8], layout: QuiltLayout,
                   size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """The inverse of `quilt_tiles`.

    Parameters
    ----------
    tiles
        uint8 [V, h, w, 3], view 0 first.
    layout
        Columns and rows.
    size
        Width and height of the quilt; what the tiles leave of it at the top and right stays black.

    Returns
    -------
    quilt
        uint8 [H, W, 3].
    """
    height, width = tiles.shape[1:3]
    full_width, full_height = size or (layout.columns * width, layout.rows * height)
    quilt = np.zeros((full_height, full_width, 3), np.uint8)
    for view, tile in enumerate(tiles):
        row, column = divmod(view, layout.columns)
        bottom = full_height - row * height
        quilt[bottom - height:bottom, column * width:(column + 1) * width] = tile
    return quilt


def read_views(source: str | Path, display: Display, *, layout: QuiltLayout | None = None,
               views: int = 0) -> tuple[NDArray[np.uint8], float]:
    """Pictures of views from a quilt or a folder.

    Parameters
    ----------
    source
        A quilt, or a folder with one picture for each view, the leftmost first by name.
    display
        The panel (`lfportrait.lightfield.quilts.layout_for`).
    layout
        Layout of the quilt; by default what its name, side file or metadata say.
    views
        Use only the first ``views`` views; 0 = all.

    Returns
    -------
    views, aspect
        uint8 [V, h, w, 3], and width over height of what they show.

    Raises
    ------
    UserError
        If there is no picture, nothing gives a quilt's layout, or the pictures of a folder differ
        in size.
    """
    source = Path(source)
    if not source.is_dir():
        if kind_of(source) == "video":
            raise UserError(f"{source.name} is a video: a picture is coded; quilts that move are "
                            "shown by `lfportrait cast`")
        layout = layout or layout_for(source, display)
        quilt = np.ascontiguousarray(read_image(source)[..., :3])
        tiles = quilt_tiles(quilt, layout)
        warn_of_misfit(source.name, quilt.shape[1], quilt.shape[0], layout)
        aspect = layout.aspect
    else:
        listing = list_pictures(source)
        say_left_out(listing, source)
        files = listing.files
        if not files:
            raise UserError(f"no pictures of views in {source}")
        pictures = [read_image(path)[..., :3] for path in files]
        for path, picture in zip(files, pictures):
            if picture.shape != pictures[0].shape:
                raise UserError(f"the views in {source} differ in size: {files[0].name} and "
                                f"{path.name}")
        tiles = np.stack(pictures)
        aspect = layout.aspect if layout else tiles.shape[2] / tiles.shape[1]
    if views < 0 or views > len(tiles):
        raise UserError(f"{source} has {len(tiles)} views, not {views}")
    return tiles[:views or len(tiles)], aspect


def interlace(views: NDArray[np.uint8], display: Display, config: InterlaceConfig | None = None, *,
              aspect: float = 0.0) -> NDArray[np.uint8]:
    """Code pictures of views for a panel: each sub-pixel from its view, at its own place.

    Parameters
    ----------
    views
        uint8 [V, h, w, 3], view 0 leftmost; V and the size need not be the panel's.
    display
        The panel.
    config
        Sampling.
    aspect
        Width over height of what the views show; the panel's by default.

    Returns
    -------
    image
        uint8 [H, W, 3].
    """
    config = config or InterlaceConfig()
    if aspect < 0 or not math.isfinite(aspect):
        raise UserError(f"the views' aspect must be above 0, not {aspect}")
    if not math.isfinite(config.focus) or config.focus <= -0.9 * display.distance:
        raise UserError(f"the focus must lie above {-0.9 * display.distance:g} half panel heights "
                        f"(the viewer is at {-display.distance:g}), not {config.focus}")
    wide, high = 1.0, 1.0
    ratio = (aspect or display.aspect) / display.aspect
    # Names give the aspect in a few digits.
    if config.fit != "stretch" and abs(ratio - 1) > 0.005:
        if (ratio > 1) == (config.fit == "contain"):
            high = 1.0 / ratio
        else:
            wide = ratio
    # A point behind the panel by f follows the eye by f / (distance + f) of its way.
    turn = (display.eye_reach * config.focus / (display.distance + config.focus)
            / (2.0 * display.aspect))
    order = np.array([display.channel(place) for place in range(3)])
    image = np.empty((display.height, display.width, 3), np.uint8)
    interlace_views(np.ascontiguousarray(views), display.steps(), display.places(), order,
                    lens_of(display), np.array([wide, high, turn]), config.sample == "linear",
                    config.blend == "linear", image)
    return image
