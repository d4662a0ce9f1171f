"""Coded pictures: made of quilts and views, taken apart, and seen by an eye.

Each sub-pixel takes its color from its view, at its own place on the panel. A view owns but few
sub-pixels of each row, one in V_n at most; the rest of its picture is filled in from its own
sub-pixels nearby, coarse to fine: sums over blocks of 2, 4, 8, ... pixels stand in wherever a block
of the next finer size holds nothing.

An eye sees, at each place of the panel, the view whose eye point lies on its line of sight through
that place: a picture sampled once per lens along each row, which is then filled in along the row.
Outside of its cone a panel repeats its views.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ..arrays import Bool, Float32, UInt8
from ..errors import UserError
from ..media.folders import list_pictures, say_left_out
from ..media.kinds import kind_of
from ..media.pictures import read_image
from .display import Display, check_size
from .kernels.panel import gather_views, interlace_views, lens_of, see_panel
from .placement import InterlaceConfig
from .quilts import QuiltLayout, layout_for, warn_of_misfit


def quilt_tiles(quilt: UInt8, layout: QuiltLayout) -> UInt8:
    """The views of a quilt, view 0 first: uint8 [columns * rows, h, w, 3]."""
    height, width = quilt.shape[0] // layout.rows, quilt.shape[1] // layout.columns
    if height < 1 or width < 1:
        raise UserError(f"a picture of {quilt.shape[1]} x {quilt.shape[0]} pixels is no quilt of "
                        f"{layout.columns} x {layout.rows} views")
    tiles = [quilt[quilt.shape[0] - (row + 1) * height:quilt.shape[0] - row * height,
                   column * width:(column + 1) * width]
             for row in range(layout.rows) for column in range(layout.columns)]
    return np.stack(tiles)


def assemble_quilt(tiles: UInt8, layout: QuiltLayout, size: tuple[int, int] | None = None) -> UInt8:
    """The inverse of `quilt_tiles`: uint8 [H, W, 3] of ``tiles`` uint8 [V, h, w, 3], view 0 first.

    What the tiles leave of a ``size`` (width and height) at the top and right stays black.
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
               views: int = 0) -> tuple[UInt8, float]:
    """Pictures of views, uint8 [V, h, w, 3], and width over height of what they show.

    Parameters
    ----------
    source : A quilt, or a folder with one picture for each view, the leftmost first by name.
    display : The panel (`lfportrait.lightfield.quilts.layout_for`).
    layout : Layout of the quilt; by default what its name, side file or metadata say.
    views : Use only the first ``views`` views; 0 = all.
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


def interlace(views: UInt8, display: Display, config: InterlaceConfig | None = None, *,
              aspect: float = 0.0) -> UInt8:
    """Code pictures of views for a panel, uint8 [H, W, 3].

    Each sub-pixel comes from its view, at its own place.

    Parameters
    ----------
    views : uint8 [V, h, w, 3], view 0 leftmost; V and the size need not be the panel's.
    aspect : Width over height of what the views show; the panel's by default.
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
    image = np.empty((display.height, display.width, 3), np.uint8)
    interlace_views(np.ascontiguousarray(views), display.steps(), display.places(), display.order(),
                    lens_of(display), np.array([wide, high, turn]), config.sample == "linear",
                    config.blend == "linear", image)
    return image


_MEMORY = 400_000_000  # Bytes that the sums of one pass may take.


def deinterlace(image: UInt8, display: Display, view: int) -> tuple[UInt8, Bool]:
    """The sub-pixels of a coded picture that one view owns.

    Parameters
    ----------
    image : uint8 [H, W, 3], coded for ``display``.
    display : The panel.
    view : 0 to V_n - 1.

    Returns
    -------
    picture, owned : uint8 [H, W, 3], zero where the view owns nothing, and bool [H, W, 3].
    """
    check_size(image, display)
    if not 0 <= view < display.views:
        raise UserError(f"the display has views 0 to {display.views - 1}, not {view}")
    rows, columns = np.ogrid[:display.height, :display.width]
    owned = np.zeros(image.shape, bool)
    for place in range(3):
        index = display.view_of(rows, columns, place).astype(np.int64)
        owned[..., display.channel(place)] = index == view
    return np.where(owned, image, 0).astype(np.uint8), owned


def _half(plane: Float32) -> Float32:
    """Sums over blocks of 2 x 2; [h, w, c] -> [ceil(h / 2), ceil(w / 2), c]."""
    padded = np.pad(plane, ((0, plane.shape[0] % 2), (0, plane.shape[1] % 2), (0, 0)))
    summed: Float32 = (padded[::2, ::2] + padded[1::2, ::2] + padded[::2, 1::2]
                                   + padded[1::2, 1::2])
    return summed


def _double(plane: Float32, height: int, width: int) -> Float32:
    """Twice the size, interpolated linearly between the middles of the pixels."""
    for axis, size in ((0, height), (1, width)):
        before = np.concatenate([plane.take([0], axis), plane], axis)
        after = np.concatenate([plane, plane.take([-1], axis)], axis)
        first = 0.25 * before.take(range(plane.shape[axis]), axis) + 0.75 * plane
        second = 0.75 * plane + 0.25 * after.take(range(1, plane.shape[axis] + 1), axis)
        both = np.stack([first, second], axis + 1)
        shape = list(plane.shape)
        shape[axis] *= 2
        plane = both.reshape(shape).take(range(size), axis)
    return plane


def _filled(value: Float32, weight: Float32) -> Float32:
    """The weighted mean where there is weight, else what the coarser picture says."""
    known = weight > 0
    mean = np.where(known, value / np.where(known, weight, 1), 0).astype(np.float32)
    if known.all() or max(value.shape[:2]) == 1:
        return mean
    sure = known.astype(np.float32)
    coarse = _filled(_half(mean * sure), _half(sure))
    return np.where(known, mean, _double(coarse, *value.shape[:2]))


def each_view(image: UInt8, display: Display, *, count: int = 0, width: int = 0,
              height: int = 0) -> Iterator[UInt8]:
    """Whole pictures of the views of a coded picture, uint8 [height, width, 3], the leftmost first.

    Sub-pixels that a view owns come through exactly where its picture has the panel's size, and are
    averaged where it is smaller; the rest is filled in.

    Parameters
    ----------
    image : uint8 [H, W, 3], coded for ``display``.
    count : Number of views; the panel's by default. Others are spread over the same cone.
    width, height : Size of the pictures; the panel's by default.
    """
    check_size(image, display)
    count, width, height = count or display.views, width or display.width, height or display.height
    if not 1 <= count <= 4096 or width < 1 or height < 1:
        raise UserError(f"{count} views of {width} x {height} pixels can't be made")
    # Pictures finer than the panel gain nothing but holes.
    inner_width, inner_height = min(width, display.width), min(height, display.height)
    at_once = max(1, min(count, _MEMORY // (24 * inner_width * inner_height)))
    image = np.ascontiguousarray(image).view()
    # As those of files are; for others the kernel would be compiled once more.
    image.flags.writeable = False
    for first in range(0, count, at_once):
        shape = (min(at_once, count - first), inner_height, inner_width, 3)
        value, weight = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        gather_views(image, display.steps(), display.places(), display.order(), lens_of(display),
                     count, first, value, weight)
        for index in range(shape[0]):
            picture = np.clip(_filled(value[index], weight[index]) + 0.5, 0, 255).astype(np.uint8)
            if (inner_width, inner_height) != (width, height):
                from PIL import Image

                picture = np.asarray(Image.fromarray(picture).resize(
                    (width, height), Image.Resampling.BICUBIC))
            yield picture


def simulate(image: UInt8, display: Display, eye: Sequence[float] = (0.0,), *,
             crosstalk: float = 0.0, distance: float | None = None, block: int = 1,
             ) -> Float32:
    """Simulate an eye's view of a coded picture.

    Parameters
    ----------
    image : uint8 [H, W, 3], coded for ``display``.
    display : The panel.
    eye : (x,) or (x, y) of the eye in half panel heights; lenses have no vertical parallax, so
        only x matters.
    crosstalk : Sigma in views of the Gaussian lobe with which other views leak in, as light; 0 =
        none. At the cone's edges the views of its other edge leak in, too, as through real
        lenses.
    distance : Distance of the eye; the viewing distance by default.
    block : A pixel of the picture is the mean light of a square of so many pixels of the panel,
        as eyes see those that are too fine for them.

    Returns
    -------
    picture : float32 [H // block, W // block, 3] in [0, 1].
    """
    check_size(image, display)
    far = display.distance if distance is None else distance
    x = display.aspect * (2.0 * (np.arange(display.width * 3) + 0.5) / (3 * display.width) - 1.0)
    # Where the line from each place through the eye meets the eye line, as a view.
    received = x + (float(eye[0]) - x) * display.distance / far
    wanted = np.mod(0.5 * (received / display.eye_reach + 1.0) * display.views, display.views)
    picture = np.empty((display.height // block, display.width // block, 3), np.float32)
    # Views mix as light, not as stored values.
    light = ((np.arange(256) / 255.0) ** display.gamma).astype(np.float32)
    # Of arrays that can be written to, the kernel would be compiled once more.
    panel = np.ascontiguousarray(image).view()
    panel.flags.writeable = False
    see_panel(panel, light, wanted, display.order(), display.steps(), lens_of(display),
              float(crosstalk), block, picture)
    np.clip(picture, 0, 1, out=picture)
    return np.power(picture, np.float32(1.0 / display.gamma), out=picture)
