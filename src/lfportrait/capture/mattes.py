"""Mattes of a person: sharp edges from the photo, and agreement between the views.

A segmentation network answers at 256x256: right in the large, blurred at the outline and now and
then wrong about a patch of wall. `refine_matte` decides the unsure band along the outline: near
every pixel the colors that are surely person and surely background are each a Gaussian, and the
likelier one wins; a guided filter (He et al. 2013, "Guided Image Filtering") then lays the edge
along the photo's. `consistent_mattes` lets the views vote: a patch that only one view calls person
has nothing behind it and goes; a hole where nearly all views see the person is filled.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from ..arrays import Array, Bool, Float32, Float64, Floats, UInt8
from ..simd.threads import side_by_side
from . import kernels
from .camera import Camera
from .capture import Capture


def _mean(plane: Float32, radius: int) -> Float32:
    side = 2 * radius + 1
    return np.asarray(cv2.blur(plane, (side, side), borderType=cv2.BORDER_REPLICATE), np.float32)


def color_likelihood(image: Float32, weight: Float32, cell: int,
                     wanted: Bool | None = None) -> tuple[Float32, Float32]:
    """Log-likelihood of each pixel's color under the Gaussian of the colors near it.

    Parameters
    ----------
    image : float32 [H, W, 3] in [0, 1].
    weight : float32 [H, W], by which the colors count.
    cell : The colors within 6 cells of so many pixels count. The Gaussians change slowly: they
        are found once for each block of ``cell`` x ``cell`` pixels, and interpolated.
    wanted : bool [H, W], the pixels that are asked; all by default. Others get zeros.

    Returns
    -------
    likelihood, near : float32 [H, W] each: without the constant, and the mean weight near a
        pixel.
    """
    blocks = tuple(-(-side // cell) for side in weight.shape)
    moments = np.empty((*blocks, kernels.MOMENTS), np.float32)
    image, weight = np.ascontiguousarray(image), np.ascontiguousarray(weight)
    kernels.block_moments(image, weight, cell, moments)
    terms = np.empty((*blocks, kernels.TERMS), np.float32)
    kernels.gaussians(_mean(moments, 6), terms)
    likelihood, near = np.zeros_like(weight), np.zeros_like(weight)
    asked = np.ones(weight.shape, np.uint8) if wanted is None else wanted.view(np.uint8)
    between = np.empty((weight.shape[0], blocks[1], kernels.TERMS), np.float32)
    kernels.pixel_likelihood(image, terms, cell, asked, between, likelihood, near)
    return likelihood, near


def guided_filter(image: Float32, plane: Float32, radius: int, epsilon: float,
                  step: int = 1, wanted: Bool | None = None) -> Float32:
    """He et al. 2013, Eq. 19-21: ``plane`` as a locally linear function of ``image``'s colors.

    Parameters
    ----------
    image : float32 [H, W, 3] in [0, 1], the guide.
    plane : float32 [H, W].
    radius : Half the window's side in pixels.
    epsilon : Variance of color that counts as an edge.
    step : Find the functions for each block of so many pixels a side and interpolate (He and Sun
        2015, "Fast Guided Filter").
    wanted : bool [H, W], the pixels that are asked; all by default. Others are not filtered
        rightly.
    """
    height, width = plane.shape
    blocks, radius = (-(-width // step), -(-height // step)), max(1, radius // step)

    def small(full: Array, how: int = cv2.INTER_AREA) -> Array:
        return full if step == 1 else cv2.resize(full, blocks, interpolation=how)

    asked, functioning = np.ones(plane.shape, np.uint8), np.ones(blocks[::-1], np.uint8)
    if wanted is not None:
        asked = wanted.astype(np.uint8)
        # Between blocks is interpolated: one more counts.
        side = 2 * (radius + (step > 1)) + 1
        functioning = cv2.dilate((small(255 * asked) > 0).astype(np.uint8),
                                 np.ones((side, side), np.uint8))
    functions = np.zeros((*functioning.shape, 4), np.float32)
    image = np.ascontiguousarray(image)
    kernels.window_functions(
        np.ascontiguousarray(small(image)), small(plane), functioning, radius, np.float32(epsilon),
        np.empty((*functioning.shape, 16), np.float32), functions)
    filtered = np.zeros(plane.shape, np.float32)
    kernels.apply_functions(image, _mean(functions, radius), asked, filtered)
    return filtered


def refine_matte(image: UInt8, soft: Floats, cell: int = 0, calm: bool = False) -> Float32:
    """Sharpen a coarse matte along the edges of its photo.

    Parameters
    ----------
    image : uint8 [H, W, 3], sRGB.
    soft : [H, W] in [0, 1], for instance a network's matte enlarged to the photo's size.
    cell : Pixels of the photo to one that the coarse matte resolves; by default a 256th of its
        size.
    calm : For a coarse matte that is right within a few cells, while the person resembles what
        is behind: it counts more beside the colors, and neighbouring pixels decide together.

    Returns
    -------
    matte : float32 [H, W] in [0, 1]. Pixels far from the outline keep their value, rounded to 0
        or 1 where it was nearly so.
    """
    coarse = np.asarray(soft, np.float32)
    cell = cell or max(2, round(max(coarse.shape) / 256))
    person = coarse > 0.5
    if person.all() or not person.any():
        return np.clip(coarse, 0, 1)
    # The band is two cells wide; colors are compared within six cells of what is asked.
    edge = cv2.morphologyEx(person.view(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    box = _box_about((edge > 0) | ((coarse > 0.1) & (coarse < 0.9)), 14 * cell, 2 * cell)
    matte = person.astype(np.float32)
    matte[box] = _decided(image[box], coarse[box], cell, calm)
    return matte


def _box_about(mask: Bool, margin: int, step: int) -> tuple[slice, slice]:
    """What encloses a mask with a margin in its picture, in whole blocks of ``step`` pixels."""
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    return np.s_[max(rows[0] - margin, 0) // step * step:-(-(rows[-1] + margin) // step) * step,
                 max(columns[0] - margin, 0) // step * step:
                 -(-(columns[-1] + margin) // step) * step]


def _decided(image: UInt8, coarse: Float32, cell: int, calm: bool) -> Float32:
    """`refine_matte` in a part of the picture that holds an outline."""
    guide = image[..., :3].astype(np.float32)
    guide /= np.float32(255)
    person, band = coarse > 0.5, _unsure_band(coarse, 2 * cell)
    asked = band
    if calm:  # a blur of the answers reaches 2.4 cells
        asked = cv2.dilate(band.astype(np.uint8), np.ones((3, 3), np.uint8),
                           iterations=3 * cell) > 0
    inside, near_person = color_likelihood(guide, (person & ~band).astype(np.float32), cell, asked)
    outside, near_behind = color_likelihood(guide, (~person & ~band).astype(np.float32), cell,
                                            asked)
    # The network's word counts as well: its log-odds, bounded so that colors can outvote them.
    there = asked.nonzero()
    share = np.clip(coarse[there], 0.02, 0.98)
    prior = np.log(share / (1 - share)) * np.float32(2.5 if calm else 1.0)
    known = (near_person[there] > 0.01) & (near_behind[there] > 0.01)
    bound = 6 if calm else 12
    odds = np.zeros_like(coarse)
    odds[there] = np.where(known, np.clip((inside - outside)[there], -bound, bound), prior)
    if calm:
        odds = np.asarray(cv2.GaussianBlur(odds, (0, 0), 0.6 * cell), np.float32)
    odds[there] += prior
    decided = person.astype(np.float32)
    decided[band] = 1 / (1 + np.exp(-np.clip(odds[band], -30, 30)))
    decided = np.asarray(cv2.medianBlur(decided, 5 if calm else 3), np.float32)
    diamond = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    wide = cv2.dilate(band.astype(np.uint8), diamond, iterations=cell) > 0
    matte = guided_filter(guide, decided, max(2, cell), 1e-4, 2 if cell >= 4 else 1, wide)
    # The filter leaves a faint veil on textures; a steeper slope removes it and keeps the edge.
    return np.where(wide, np.clip((matte - 0.1) / 0.8, 0, 1), decided).astype(np.float32)


def refine_changes(image: UInt8, before: Float32, after: Float32) -> Float32:
    """Lay a matte along the edges of its photo where it differs much from what it was.

    The photo is uint8 [H, W, 3], sRGB; mattes are float32 [H, W] in [0, 1], both along the edges
    where they are equal.
    """
    cell = max(2, round(max(after.shape) / 256))
    changed = np.abs(after - before) > 0.25
    if not changed.any():
        return after
    near = cv2.dilate(changed.astype(np.uint8), np.ones((8 * cell + 1, 8 * cell + 1), np.uint8))
    # Colors are compared within six cells, and bands are four wide.
    box = _box_about(near > 0, 12 * cell, 2 * cell)
    result = after.copy()
    result[box] = np.where(near[box] > 0, refine_matte(image[box], after[box], cell), after[box])
    return result


def _unsure_band(coarse: Float32, reach: int) -> Bool:
    """Pixels within ``reach`` of the outline, or about which the matte itself is unsure."""
    person = coarse > 0.5
    inside, outside = (cv2.distanceTransform(part.view(np.uint8), cv2.DIST_L2, 5)
                       for part in (person, ~person))
    away = np.maximum(inside, outside)
    unsure = (coarse > 0.1) & (coarse < 0.9) & (away < 6 * reach)
    return (away <= reach) | unsure


def _small(matte: Float32, factor: int) -> Float32:
    """A matte reduced by an integer factor (block means; the edge blocks are partial)."""
    height, width = (-(-size // factor) for size in matte.shape)
    padded = np.pad(matte, ((0, height * factor - matte.shape[0]),
                            (0, width * factor - matte.shape[1])), mode="edge")
    return padded.reshape(height, factor, width, factor).mean((1, 3)).astype(np.float32)


def consistent_mattes(capture: Capture, mattes: Sequence[Floats], size: int = 224) -> list[Float32]:
    """Make mattes agree with each other through the cameras.

    Every point of a lattice asks the views that have it in the picture. It is carved away when the
    background takes more than 6 % of all votes; what a view calls person must lie on the points
    that are left, and holes in it behind which the background takes less than 3 % are filled (but
    one vote alone decides nothing). What changes is not along the photo's edges (`refine_changes`).

    Parameters
    ----------
    mattes : V mattes, [H, W] in [0, 1].
    size : Points of the lattice along an edge.

    Returns
    -------
    mattes : V mattes, float32 [H, W] in [0, 1]. With fewer than 6 views there is too little to
        vote on, and the mattes come back as they are.
    """
    given = [np.asarray(matte, np.float32) for matte in mattes]
    if len(capture) < 6:
        return given
    votes = _Votes(capture.cameras, given, size)
    return side_by_side(lambda view: _corrected(votes, view, given[view]), range(len(given)))


def matte_agreement(cameras: Camera, mattes: Sequence[Floats]) -> Float64:
    """Agreement of each matte, [H, W] in [0, 1], with the visual hull of all, float64 [V].

    It is the intersection over union with the picture of the common solid on a lattice of 96
    points along an edge, as far as a quarter of the views show it; 0 where there is nothing in
    either.
    """
    size, given = 96, [np.asarray(matte, np.float32) for matte in mattes]
    votes = _Votes(cameras, given, size)
    # What few views show they easily agree about; every fourth point is enough to know.
    shown = views_share(cameras, 0.5 * votes.spacing * size, size // 4) > 0.25
    for axis in range(3):
        shown = np.repeat(shown, 4, axis)
    votes.kept &= shown

    def overlap(view: int) -> float:
        said, common = votes.small[view] > 0.5, _closed(votes.cover(view))
        either = (said | common).sum()
        return float((said & common).sum() / either) if either else 0.0

    return np.array(side_by_side(overlap, range(len(given))))


def views_share(cameras: Camera, reach: float, size: int) -> Float64:
    """The share of V views that have a point of a lattice in the picture, float64 [size] * 3.

    Half the lattice's edge is ``reach`` in world units, its middle the origin; (z, y, x).
    """
    seen, _ = lattice_votes(cameras, None, np.zeros(3), np.full(3, reach), (size,) * 3)
    return np.asarray(seen / np.float64(len(cameras)))


def lattice_votes(cameras: Camera, covered: Callable[[int], Bool] | None, center: Float64,
                  radius: Float64, size: tuple[int, ...], limit: float = np.inf,
                  asked: Bool | None = None) -> tuple[Float32, Float32]:
    """How many views have each point of a lattice in the picture, and how many show it empty.

    Parameters
    ----------
    cameras : V views.
    covered : Gives a view's picture, bool [H, W], of its camera's size, false where there is
        nothing; None where only ``seen`` is asked.
    center, radius : The box of the lattice, float64 [3] each (x, y, z), whose points are its
        cells' middles.
    size : Points along z, y and x.
    limit : A point that more views than this show empty is given up: more views are not asked.
    asked : Bool [Z, Y, X], the points that are asked, or all.

    Returns
    -------
    seen, against : float32 [Z, Y, X] each; of no meaning where nothing is asked.
    """
    # Neighbouring views err alike; in scattered order an empty point is found out sooner.
    order = np.argsort((np.arange(len(cameras)) * 0.6180339887) % 1.0, kind="stable")
    spacing = 2.0 * np.asarray(radius, np.float64) / np.array(size[::-1])
    sizes = [(int(height), int(width)) for height, width in zip(cameras.height, cameras.width)]

    def packed(view: int) -> UInt8:  # a bit a pixel: all pictures are there at once
        assert covered is not None
        picture = covered(view)
        if picture.shape != sizes[view]:
            raise ValueError(f"the picture of view {view} has another size than its camera")
        return np.packbits(picture, bitorder="little")

    seen, against = kernels.count_votes(
        cameras.rows[order],
        [] if covered is None else side_by_side(packed, order.tolist()),
        np.array([sizes[view] for view in order]), center - radius + 0.5 * spacing, spacing, size,
        limit, asked)
    return np.asarray(seen), np.asarray(against)


def mattes_share(cameras: Camera, mattes: list[Float32], reach: float, size: int) -> Float32:
    """The mean matte at each point of a lattice (`views_share`) over the views that show it.

    Of float32 [H, W] in [0, 1] for each of V views; float32 [size, size, size] (z, y, x), 1 where
    no picture shows the point.
    """
    spacing = 2.0 * reach / size
    return np.asarray(kernels.vote_lattice(
        cameras.rows, np.concatenate([matte.ravel() for matte in mattes]),
        np.array([matte.shape for matte in mattes]), np.full(3, -reach + 0.5 * spacing), spacing,
        size, np.float32(1.0)))


class _Votes:
    """What the views say of the points of a lattice (see `consistent_mattes`)."""

    def __init__(self, cameras: Camera, mattes: list[Float32], size: int) -> None:
        distance = np.maximum(np.linalg.norm(cameras.position, axis=1), 1e-6)
        # Shoulders reach beyond the cube of the head: the lattice spans 1.8 times of it, less where
        # the cameras stand closer.
        reach = min(1.8, 0.8 * float(distance.min()))
        self.first, self.spacing = np.full(3, -reach * (1 - 1 / size)), 2 * reach / size
        # Small pictures in which a step of the lattice is about one pixel.
        factors = np.maximum(1, np.floor(self.spacing * cameras.focal.min(1) / distance))
        self.factors = [int(factor) for factor in factors]
        self.small = side_by_side(lambda view: _small(mattes[view], self.factors[view]),
                                  range(len(mattes)))
        self.rows = np.concatenate([
            cameras.pose[:, :3].reshape(-1, 12), cameras.focal / factors[:, None],
            cameras.center / factors[:, None]], axis=1)
        # Neighbouring views err alike; in scattered order an empty point is found out sooner.
        order = np.argsort((np.arange(len(mattes)) * 0.6180339887) % 1.0, kind="stable")
        # Whatever the number of views, one of them that errs alone is outvoted.
        tolerance, doubt = (max(part, 1.5 / len(mattes)) for part in (0.06, 0.03))
        share = kernels.vote_lattice(
            self.rows[order], np.concatenate([self.small[view].ravel() for view in order]),
            np.array([self.small[view].shape for view in order]), self.first, self.spacing, size,
            np.float32(tolerance))
        # The points that few views call background, and those of which hardly any does.
        self.kept, self.certain = share > 1 - tolerance, share > 1 - doubt

    def cover(self, view: int, certain: bool = False) -> Bool:
        """The pixels of a view's small matte before the points that are left, or certain."""
        return np.asarray(kernels.cover_views(
            self.rows[view], self.certain if certain else self.kept, self.first, self.spacing,
            *self.small[view].shape))


def _corrected(votes: _Votes, view: int, matte: Float32) -> Float32:
    """One view's matte without what the others deny, its holes filled where that is certain."""
    factor = votes.factors[view]

    def full(mask: Bool) -> Float32:
        large = np.repeat(np.repeat(mask.astype(np.float32), factor, 0), factor, 1)
        return np.asarray(cv2.blur(large[:matte.shape[0], :matte.shape[1]], (2 * factor + 1,) * 2,
                                   borderType=cv2.BORDER_REFLECT), np.float32)

    # The lattice's points leave gaps between them; closing joins them, one more step is margin.
    left = cv2.dilate(_closed(votes.cover(view)).view(np.uint8), np.ones((3, 3), np.uint8))
    result = matte * full(left.view(bool))
    person = result > 0.5
    holes = holes_of(person)
    if holes.any():
        certain = full(_closed(votes.cover(view, certain=True)))
        result = np.where(holes, np.maximum(result, certain), result)
    return np.clip(result, 0, 1)


def holes_of(person: Bool) -> Bool:
    """Pixels of no ``person``, bool [H, W], that it surrounds: bool [H, W]."""
    _, pieces = cv2.connectedComponents((~person).astype(np.uint8), connectivity=4)
    border = np.zeros(pieces.max() + 1, bool)
    for rim in (pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]):
        border[rim] = True
    border[0] = True
    return np.asarray(~border[pieces])


def _closed(mask: Bool) -> Bool:
    """Gaps of up to two pixels closed, also along the picture's border."""
    padded = np.pad(mask, 4, mode="edge").view(np.uint8)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8), iterations=2)
    return np.asarray(closed[4:-4, 4:-4] > 0)
