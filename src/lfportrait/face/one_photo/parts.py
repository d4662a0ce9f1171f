"""What a photo shows of a person, as maps on one grid: the matte's distance, hair, colors.

The grid covers the photo and, where the person goes on beyond its border, a margin around it. Its
cells are about a millimetre and a half wide at the head: finer than a matte is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float32, Float64, box_about
from ...capture import Camera

CELL = 0.0075  # Width of a cell at the head, portrait units (1.6 mm).
MARGIN = 0.12  # Of the grid around the photo, over its width.
ON_TOP = 0.11  # How thick hair lies on a crown that no photo shows, portrait units.
TREND = 0.10
"""Below a photo's upper edge, how far an outline tells where it goes on, portrait units."""
FLATTEST, CIRCLE, ROUND = 0.2, 0.7, (1.7, 2.8)
"""How tall at least what was cut off is, over half its width, and over the circle as that its
outline goes on; powers of its outline: a parabola has 2."""
ASIDE = 0.25  # It is no highest so near to either side, parts of its width.
LEAST_HAIR = 0.06  # Hair covers at least this part of the area of a face, or there is none.
LINK = 0.06  # What hangs from hair by less than twice so much may be none, over a face's width.
OTHER_HAIR = 8.0  # Difference in CIELAB from which on that is not of the same hair.
UNLIKE = 14.0
"""Difference in CIELAB from which on what a network calls hair is not skin in the shade."""

INNER, OUTER = 0.7, 1.3
"""What is less than so many times as unlike the ground as the hair is ground; well within hair, and
at the outline."""
LONG = 0.1
"""Short hair, of which less than this part lies further within, is not seen through: what it is
like would be known from its hairline alone, where it is mixed with skin."""
COARSER = 3.0  # Pixels by which colors are blurred at most before they are halved.
FUZZ = 0.18
"""Hair is so thin up to here from the outline that ground may be seen through it, portrait units.
"""
BLUR_CELL, BLURS = 0.0025, (1.0, 2.5)
"""Cells that the blur of an outline is measured in, portrait units, or a pixel of a photo that has
larger ones; and how much more edges are blurred there to see how much they are, cells."""
SHARP, BLURRIEST = 1.3, 8.0
"""How blurred (standard deviation, cells) an outline is whose ground is seen in what lies within;
and at most."""
WITHIN = 2.0  # So many of these lie between an outline and what the ground does not reach.
BESIDE, STEP = 4, 0.01
"""An outline's edge is so near to it, cells; how strong it is at least, over a cell."""


@dataclass(frozen=True)
class Parts:
    """Maps [h, w] of a person."""

    camera: Camera  # One view, whose picture is the grid.
    cell: float  # Width of a cell at the head, portrait units.
    # float32, signed distance from the person's outline in cells, positive in the person.
    inside: Float32
    hair: Bool  # bool, hair in front.
    bottom: float  # Row at which the photo ends.
    beard: Bool | None = None  # bool, a beard below the jaw (`beard.beard_of`).

    def places(self, points: Float64) -> tuple[Float64, Float64]:
        """(row, column) of points [N, 3] for `at`, [2, N], and their depths [N]."""
        pixels, depth = self.camera.project(points)
        return np.stack([pixels[0, :, 1], pixels[0, :, 0]]) - 0.5, depth[0]

    def of_photo(self, values: NDArray[np.floating], camera: Camera) -> Float32:
        """Values [H, W] of a camera's photo on this grid, [h, w]; the border's beyond it."""
        height, width = self.inside.shape
        factor = float(camera.focal[0, 0] / self.camera.focal[0, 0])
        column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        middle, center = self.camera.center[0], camera.center[0]
        return Parts.at(values, np.stack([
            (row.ravel() - middle[1]) * factor + center[1] - 0.5,
            (column.ravel() - middle[0]) * factor + center[0] - 0.5])).reshape(height, width)

    @staticmethod
    def at(values: NDArray[np.floating], places: Float64) -> Float32:
        """Values [h, w] or [h, w, C] at places [2, N], between cells; the border's beyond it."""
        values, count = np.ascontiguousarray(values, np.float32), places.shape[1]
        rows = 16384  # OpenCV takes at most 32767
        padded = np.pad(places.astype(np.float32), ((0, 0), (0, -count % rows)))
        out = [cv2.remap(values, part[1][:, None], part[0][:, None], cv2.INTER_LINEAR,
                         borderMode=cv2.BORDER_REPLICATE)[:, 0]
               for part in np.split(padded, padded.shape[1] // rows, axis=1)] if count else []
        whole = np.concatenate(out)[:count] if out else np.zeros((0, *values.shape[2:]))
        return np.asarray(whole, np.float32)


def signed_distance(matte: NDArray[np.floating]) -> Float32:
    """Distance in pixels from the line where a matte [H, W] is one half, positive inside."""
    person = (np.asarray(matte) > 0.5).astype(np.uint8)
    inner, outer = (cv2.distanceTransform(part, cv2.DIST_L2, 5) for part in (person, 1 - person))
    # Next to the line the matte's own slope is finer than whole pixels.
    near = np.clip(np.asarray(matte, np.float32) - np.float32(0.5), -0.5, 0.5)
    whole = np.where(person > 0, inner - 0.5, 0.5 - outer)
    return np.where(np.abs(whole) <= 0.5, near, whole).astype(np.float32)


def clean_hair(image: NDArray[np.uint8], hair: NDArray[np.floating], matte: NDArray[np.floating],
               landmarks: Float64) -> Float32:
    """A mask of hair without what is none: specks, and the shaded rim of a bald head.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    hair, matte : [H, W] in [0, 1].
    landmarks : [68, 2] in pixels.
    """
    width = float(np.linalg.norm(landmarks[16] - landmarks[0]))
    mask = ((hair > 0.5) & (matte > 0.5)).astype(np.uint8)
    radius = max(1, round(0.02 * width))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, disc), np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    for one in range(1, count):
        if stats[one, cv2.CC_STAT_AREA] < 0.01 * width ** 2:
            mask[labels == one] = 0
    none = np.zeros(mask.shape, np.float32)
    if mask.sum() < LEAST_HAIR * width ** 2:
        return none
    lab = cv2.cvtColor(image.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    mask[_hung_on(mask, np.asarray(lab, np.float32), landmarks, width)] = 0
    cheeks = np.zeros(mask.shape, np.uint8)
    for corner in ((31, 2, 41), (35, 14, 46)):
        cv2.fillConvexPoly(cheeks, np.rint(landmarks[list(corner)]).astype(np.int32), 1)
    skin = lab[cheeks > 0]
    if len(skin):
        two = np.median(lab[mask > 0], axis=0), np.median(skin, axis=0)
        if np.linalg.norm(two[0] - two[1]) < UNLIKE:
            return none
        mask[_patches(mask > 0, np.asarray(matte) > 0.5, np.asarray(lab, np.float32), *two)] = 1
    return np.asarray(np.where(mask > 0, np.maximum(hair, 0.51), 0.0), np.float32)


def _patches(hair: Bool, person: Bool, lab: Float32, curls: Float32, skin: Float32) -> Bool:
    """Gaps in hair [H, W] that are more like it than like skin, by the colors of both."""
    part = box_about(hair)
    assert part is not None
    labels, count = ndimage.label(ndimage.binary_fill_holes(hair[part]) & ~hair[part])
    out = np.zeros(hair.shape, bool)
    means = np.stack([ndimage.mean(lab[part][..., one], labels, np.arange(count + 1))
                      for one in range(3)], axis=1)
    alike = np.linalg.norm(means - curls, axis=1) < np.linalg.norm(means - skin, axis=1)
    alike[0] = False
    out[part] = alike[labels] & person[part]
    return out


FACE = 240.0  # Pixels that a face is wide, at most, where earrings are looked for.


def _hung_on(mask: NDArray[np.uint8], lab: NDArray[np.floating], landmarks: Float64,
             width: float) -> Bool:
    """What of a mask of hair [H, W] hangs from an ear, and is unlike the hair: an earring."""
    factor = min(1.0, FACE / width)
    if factor < 0.99:  # its time grows with the fourth power of a photo's width
        size = (max(1, round(factor * mask.shape[1])), max(1, round(factor * mask.shape[0])))
        small, colors = (cv2.resize(one, size, interpolation=cv2.INTER_AREA)
                         for one in (mask, lab))
        found = _hung_on(np.asarray(small, np.uint8), np.asarray(colors, np.float32),
                         landmarks * factor, width * factor)
        whole = cv2.resize(found.astype(np.uint8), mask.shape[::-1],
                           interpolation=cv2.INTER_NEAREST)
        return np.asarray((whole > 0) & (mask > 0))
    radius = max(1, round(LINK * width))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    cores = cv2.morphologyEx(mask, cv2.MORPH_OPEN, disc)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(cores)
    out = np.zeros(mask.shape, bool)
    if count < 3:
        return out
    main = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    mean = lab[labels == main].mean(axis=0)
    nose = landmarks[33, 1]
    for one in range(1, count):
        top, tall, wide = stats[one, [cv2.CC_STAT_TOP, cv2.CC_STAT_HEIGHT, cv2.CC_STAT_WIDTH]]
        if not (top > nose + 0.1 * width and wide < 0.25 * width and wide < tall < 0.8 * width):
            continue
        within = (labels == one).astype(np.uint8)
        if np.linalg.norm(lab[within > 0].mean(axis=0) - mean) > OTHER_HAIR:
            out |= (cv2.dilate(within, disc) > 0) & (np.arange(len(mask))[:, None] >= top)
    return out & (mask > 0) & (labels != main)


def thin(rest: Bool, hair: Bool, reach: float) -> Bool:
    """What of the rest [h, w] lies beside hair and is less than twice ``reach`` cells wide."""
    return np.asarray(rest & ~opened(rest, reach) & (_away(hair) <= 2 * reach))


def opened(part: Bool, reach: float) -> Bool:
    """What of a part [h, w] is twice ``reach`` cells wide or more."""
    return np.asarray(part & (_away(_away(~part) > reach) <= reach + 1))


def _away(part: Bool) -> Float32:
    """How far cells [h, w] are from a part."""
    return np.asarray(cv2.distanceTransform((~part).astype(np.uint8), cv2.DIST_L2, 5), np.float32)


def ground_in_hair(image: NDArray[np.uint8], matte: NDArray[np.floating],
                   hair: NDArray[np.floating], width: float) -> Bool:
    """Where ground is seen through hair that a matte takes for the person's, bool [H, W].

    Parameters
    ----------
    image : uint8 [H, W, 3], with its ground.
    matte, hair : [H, W] in [0, 1].
    width : Pixels up to which hair is as thin as that, from the outline on.
    """
    curls = np.asarray(hair) > 0.5
    if not curls.any():
        return curls
    deep = signed_distance(matte) / np.float32(width)
    within = curls & ((deep <= 0) | (deep >= 1))
    if within.sum() < LONG * curls.sum():
        return np.zeros_like(curls)
    # A narrow strip between hair and the outline is hair, or ground; so is a small gap in hair.
    strips = thin((deep > 0) & ~curls, curls, 0.25 * width) & (deep < 0.5)
    near = (((curls | strips) & (deep < 1)) | _gaps(curls, width ** 2)) & (deep > 0)
    lab = cv2.cvtColor(image.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    size = tuple(max(2, round(side * min(1.0, 4.0 / width))) for side in near.shape[::-1])
    found: list[Float32] = []
    for part, sigma in ((curls & ~near, 6.0), (np.asarray(matte) < 0.02, 2.5)):
        known = part.astype(np.float32)
        small = cv2.resize(np.dstack([lab * known[..., None], known]), size,
                           interpolation=cv2.INTER_AREA)
        around = cv2.resize(cv2.GaussianBlur(small, (0, 0), sigma), near.shape[::-1],
                            interpolation=cv2.INTER_LINEAR)
        near &= around[..., 3] > 1e-3  # what either is like must be known
        found.append(np.linalg.norm(lab - around[..., :3] / np.maximum(around[..., 3:], 1e-3),
                                    axis=2))
    limit = INNER + (OUTER - INNER) * (1 - np.clip(deep, 0, 1))
    return np.asarray(near & (found[0] > UNLIKE) & (found[1] < limit * found[0]))


def _gaps(part: Bool, largest: float) -> Bool:
    """Gaps in a part [H, W] of fewer than so many pixels."""
    labels = ndimage.label(ndimage.binary_fill_holes(part) & ~part)[0]
    size = np.bincount(labels.ravel())
    return np.asarray((labels > 0) & (size < largest)[labels])


def ground_in_blur(image: NDArray[np.uint8], matte: NDArray[np.floating],
                   hair: NDArray[np.floating] | None, unit: float) -> Bool:
    """Where an outline out of focus mixes person and ground, bool [H, W]; not in hair.

    The less an edge weakens where it is blurred more, the more it was before (Zhuo and Sim 2011).

    Parameters
    ----------
    image : uint8 [H, W, 3], with its ground.
    matte, hair : [H, W] in [0, 1]; hair None if it is not known.
    unit : Pixels to a portrait unit.
    """
    factor = min(1.0, 1.0 / (BLUR_CELL * unit))
    size = tuple(max(2, round(side * factor)) for side in image.shape[1::-1])
    small, alpha = (np.asarray(cv2.resize(one, size, interpolation=cv2.INTER_AREA), np.float32)
                    for one in (image, np.asarray(matte, np.float32)))
    slopes = [_slopes(small / np.float32(255), sigma) for sigma in BLURS]
    deep = signed_distance(alpha)
    near = np.where(np.abs(deep) < BESIDE, slopes[1], np.float32(0))
    edges = (near >= cv2.dilate(near, np.ones((7, 7), np.uint8))) & (near > STEP)
    ratio = np.clip(slopes[0] / np.maximum(slopes[1], 1e-6), 1.02, BLURS[1] / BLURS[0])
    blur = np.sqrt((BLURS[1] ** 2 - (ratio * BLURS[0]) ** 2) / (ratio ** 2 - 1))
    weight = np.where(edges, np.minimum(near, 10 * STEP), np.float32(0))
    sums = cv2.GaussianBlur(np.dstack([weight * np.minimum(blur, BLURRIEST), weight]), (0, 0), 6.0)
    sigma = sums[..., 0] / np.maximum(sums[..., 1], 1e-9)
    mixed = ((sigma > SHARP) & (deep < WITHIN * sigma)).astype(np.uint8)
    whole = cv2.resize(mixed, image.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0
    return np.asarray(whole if hair is None else whole & (hair < 0.5))


def _slopes(colors: Float32, sigma: float) -> Float32:
    """How steep blurred colors [h, w, 3] are, over a cell, [h, w]."""
    blurred = cv2.GaussianBlur(colors, (0, 0), sigma)
    across, down = (cv2.Sobel(blurred, cv2.CV_32F, one, 1 - one) / 8 for one in (1, 0))
    return np.asarray(np.sqrt((across ** 2 + down ** 2).sum(axis=2)), np.float32)


def clean_colors(image: NDArray[np.uint8], matte: NDArray[np.floating],
                 fuzz: NDArray[np.bool_] | None = None) -> Float32:
    """The person's own colors, float32 [H, W, 3] in [0, 1], continued beyond the outline.

    At the outline a photo mixes person and ground, by a pixel or two more than a matte knows: what
    lies there gets the colors further inside; so does ``fuzz`` (`ground_in_hair`,
    `ground_in_blur`).
    """
    colors = np.asarray(image, np.float32) / np.float32(255)
    reach = 2 + max(image.shape[:2]) // 700
    sure = signed_distance(matte) > reach
    if fuzz is not None:
        sure &= ~fuzz
    if not sure.any():
        return colors
    sums, known = np.where(sure[..., None], colors, np.float32(0)), sure.copy()
    # From fine to coarse: each place takes the mean of the smallest window with anything in it.
    # The wider they are, the fewer cells they need.
    wide = np.dstack([sums, sure.astype(np.float32)])
    size, scale, sigma = sure.shape[::-1], 1, 1.0
    while not known.all() and sigma < min(max(size), 40):
        if sigma > COARSER * scale and min(wide.shape[:2]) > 1:
            wide = cv2.resize(wide, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            scale *= 2
        around = cv2.GaussianBlur(wide, (0, 0), sigma / scale)
        around = cv2.resize(around, size, interpolation=cv2.INTER_LINEAR)
        fresh = ~known & (around[..., 3] > 0.02)
        sums[fresh] = around[fresh, :3] / around[fresh, 3:]
        known |= fresh
        sigma *= 1.6
    if not known.all():
        sums[~known] = colors[sure].mean(axis=0)
    return np.asarray(sums, np.float32)


def parts_of(camera: Camera, matte: NDArray[np.floating], hair: NDArray[np.floating],
             distance: float, head: Float64 | None = None, beard: Bool | None = None) -> Parts:
    """The maps of a photo.

    Parameters
    ----------
    matte, hair : [H, W] in [0, 1].
    distance : Of the head from the camera, portrait units.
    head : Points [N, 3] of the fitted head: a crown that the photo's upper edge cuts off is closed
        round above them.
    beard : bool [H, W], or None.
    """
    factor = min(1.0, float(distance / camera.focal[0, 0]) / CELL)
    small = camera.scaled(factor)
    width, height = int(small.width[0]), int(small.height[0])
    size = (width, height)
    pad, cell = round(MARGIN * width), float(distance / small.focal[0, 0])
    soft, curls = (np.asarray(cv2.copyMakeBorder(
        cv2.resize(np.asarray(one, np.float32), size, interpolation=cv2.INTER_AREA),
        0, pad, pad, pad, cv2.BORDER_REPLICATE), np.float32) for one in (matte, hair))
    # What goes on beyond the sides ends there, round.
    if pad:
        soft[:, :pad] *= _fall(soft[:height, pad] > 0.5, pad, height + pad)[:, ::-1]
        soft[:, -pad:] *= _fall(soft[:height, -pad - 1] > 0.5, pad, height + pad)
    crown = None if head is None else _crown(soft[:, pad:-pad], curls[:, pad:-pad],
                                             small.project(head)[0][0], cell)
    top = 0 if crown is None else len(crown[0])
    if crown is not None:
        soft, curls = (np.vstack([np.pad(above, ((0, 0), (pad, pad))), below])
                       for above, below in zip(crown, (soft, curls), strict=True))
    inside = cv2.GaussianBlur(signed_distance(soft), (0, 0), 1.0)
    wide = Camera(small.pose, small.focal, small.center + np.array([pad, top]),
                  np.array(width + 2 * pad), np.array(height + pad + top))
    below = None
    if beard is not None:
        share = cv2.resize(beard.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        below = np.pad(share > 0.5, ((0, pad), (0, 0)), "edge")  # a photo may cut it off, too
        below = np.pad(below, ((top, 0), (pad, pad)))
    found = (curls > 0.5) & (inside > 0)
    return Parts(wide, cell, np.asarray(inside, np.float32),
                 found if below is None else found & ~below, float(height + top), below)


def _fall(edge: Bool, pad: int, rows: int) -> Float32:
    """How much of a person is left beyond a side of a photo, float32 [rows, pad], outwards.

    Hair that the side cuts off is closed round; what reaches the photo's lower end is shoulders.

    Parameters
    ----------
    edge : bool [h], where the person reaches the side.
    """
    reach = np.full(rows, 1.0)
    for first, last in _runs(edge):
        if last < len(edge):
            across = (2 * (np.arange(first, last) + 0.5) - first - last) / (last - first)
            reach[first:last] = np.sqrt(1 - across ** 2)
    out = np.arange(pad - 1, -1, -1) - (1 - reach[:, None]) * 0.7 * pad
    return np.asarray(np.clip(out / max(0.6 * pad, 1), 0, 1), np.float32)


def _crown(matte: Float32, hair: Float32, head: Float64, cell: float,
           ) -> tuple[Float32, Float32] | None:
    """Person and hair [t, w] above the upper edge of maps [h, w], which cuts a head off, or None.

    ``head`` are places (x, y) of the model's points in the maps.
    """
    if len(matte) < 2:
        return None
    skull = head[head[:, 1] < head[:, 1].mean()]
    highest, below = float(head[:, 1].min()), min(len(matte) - 1, max(1, round(TREND / cell)))
    # The crown of a head that leans lies beside its middle.
    cut = _widest(matte[0] > 0.5, float(skull[:, 0].min()), float(skull[:, 0].max()))
    if cut is None or cut[1] - cut[0] < 3:
        return None
    left, right = cut
    lower = _run(matte[below] > 0.5, 0.5 * (left + right))
    if lower is None:
        return None
    half, covered = 0.5 * (right - left), hair[0, left:right] > 0.5
    if highest > ON_TOP / cell and not covered.any():
        return None  # the photo shows the crown: it cuts something else off
    # The outline goes on as it comes, and ends above the skull.
    sides = np.maximum([left - lower[0], lower[1] - right], 0) / below
    inwards = float(sides.mean())
    tall = (ON_TOP if covered.any() else 0.0) / cell - highest
    # Big hair whose sides are seen ends higher than that above the skull.
    seen = covered.any() and left > 0 and right < matte.shape[1]
    circle = CIRCLE * (float(np.hypot(1, inwards)) - inwards) if seen else 0.0
    least = max(FLATTEST, circle) * half
    # Where it has almost closed, no more than its slope says is missing.
    tall = max(min(tall, half / (ROUND[0] * max(inwards, 1e-6))), least)
    power = np.clip(half / max(tall * inwards, 1e-6), *ROUND)
    rows = int(np.ceil(tall)) + round(ON_TOP / cell)
    height = np.arange(rows, 0, -1)[:, None] - 0.5
    # It is highest nearer to the side that is steeper.
    share = float(np.clip(sides[0] / max(sides.sum(), 1e-6), ASIDE, 1 - ASIDE)) if inwards else 0.5
    across = (np.arange(matte.shape[1]) + 0.5 - left) / (2 * half) - share
    across = np.abs(across) / np.where(across < 0, share, 1 - share)
    person = np.clip(tall * (1 - np.minimum(across, 1) ** power) - height + 0.5, 0, 1)
    person[:, across >= 1] = 0
    above = np.broadcast_to(hair[:1], person.shape)
    if covered.mean() > 0.5:
        above = np.ones_like(person)
    return np.asarray(person, np.float32), np.asarray(above, np.float32)


def _runs(row: Bool) -> NDArray[np.int64]:
    """Where each run of a row begins and ends, [R, 2]."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(int)))
    return ends.reshape(-1, 2)


def _widest(row: Bool, first: float, last: float) -> tuple[int, int] | None:
    """Where the widest run of a row that lies between two columns begins and ends, or None."""
    runs = _runs(row)
    runs = runs[(runs[:, 1] > first) & (runs[:, 0] < last)]
    if not len(runs):
        return None
    one, two = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return int(one), int(two)


def _run(row: Bool, column: float) -> tuple[int, int] | None:
    """Where what a row has at a column begins and ends, or None."""
    at = int(np.clip(column, 0, len(row) - 1))
    if not row[at]:
        return None
    gaps = np.flatnonzero(~row)
    left = gaps[gaps < at].max(initial=-1) + 1
    return int(left), int(gaps[gaps > at].min(initial=len(row)))
