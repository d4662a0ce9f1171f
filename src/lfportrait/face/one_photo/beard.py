"""A beard that goes on below the jaw: where a photo shows it, and its shape.

No statistical head has a beard: what hangs below the jaw would lie on the throat, and the chin's
lower side would have a beard's color in front alone. Here it hangs down from the chin. Where it
grows on the face it is as thin as the model's skin, but hair to a painter.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..head_fit import ear_to_ear
from .parts import Parts
from .piece import METRES, Piece, filled, outside

__all__ = ["BEARD", "Beard", "beard_of", "beard_piece", "beneath"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

BEARD = 4
"""What a place of the surface belongs to, beside those of `solid`."""

FACE = 160.0
"""Pixels that a face is wide, at most, where a beard is looked for."""
UNLIKE = 14.0
"""Difference in CIELAB from a cheek's skin, lightness counted by `LIGHTNESS`, of a beard."""
LIGHTNESS = 0.3
BEARDED, HALF = 0.40, 0.25
"""How much of the area of a chin is unlike skin if it has a beard, and of each half: one alone may
lie in shade."""
LENGTH, WAYS, STEPS = 0.8, 61, 60
"""How far below the jaw a beard ends, over the height of a face from eyes to chin; ways down from
the jaw that are followed; steps of each."""
COLORFUL, SMOOTH = 5.0, 0.01
"""A beard is less colorful than skin and not brighter, but for so much in CIELAB; and less even, by
octaves of lightness from place to place."""
SPREAD = np.array([0.25, 0.08, 0.03])
"""Least deviations of lightness (octaves), redness (octaves) and fineness (octaves) of a beard and
of skin."""
SHADE, GRAY, FINER = 0.1, 0.55, 0.3
"""Weights of a skin's lightness, of how much less red hairs are than others, and of how much finer.
"""
NEITHER = 8.0
"""Square of deviations from which on something is neither skin nor beard."""
TURN, EDGE, TALL, BESIDE = 0.8, 5.0, 0.5, 0.5
"""In steps: what it costs a beard's outline to change by a step from one way to the next, and what
it is worth to run along an edge of the photo; what steps cost at the far end, and beside the chin.
"""
FRINGE = 1.0
"""The last of its steps are hairs before what lies below."""
CONTRAST = np.array([0.8, 0.25, 0.1])
"""Differences of the three that make an edge."""

MIXED = 0.003 / METRES
"""How far up from its end a beard's colors are mixed with what lies below, portrait units."""
LIP = 0.008 / METRES
"""A beard's front begins at the foremost depth of the lowest so much of a jaw, portrait units."""
INTO = 0.02 / METRES
"""It goes on so far up within the head."""
UNDER = 0.0015 / METRES
"""And lies so far within it there."""
EVEN = 0.004 / METRES
"""Over how much its front is even, portrait units."""
SLOPE = 0.12
"""How far back it falls of its way down."""
AHEAD, BEHIND = 0.012 / METRES, 0.035 / METRES
"""Its thickness before and behind its middle."""
ROUND = 0.012 / METRES
"""How far from its outline it is thinner."""
BEFORE = 0.008 / METRES
"""How far before the chest it lies at least."""


class Beard(NamedTuple):
    """Where a photo shows a beard."""

    below: Bools  # bool [H, W], below the landmarks of the jaw.
    whole: Float32  # float32 [H, W] in [0, 1], there and on the face.


def beard_of(image: NDArray[np.uint8], matte: NDArray[np.floating], landmarks: Float64,
             hair: NDArray[np.floating] | None = None) -> Beard | None:
    """The beard that a photo shows, or None if none goes on below the jaw.

    From every place of the jaw it is followed down as far as it is more like the chin's than like
    skin or something else, to where the photo has an edge, for all places together.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    matte : [H, W] in [0, 1].
    landmarks : float64 [68, 2] in pixels.
    hair : [H, W] in [0, 1]: what of it reaches up to the brows hangs down beside the jaw.
    """
    factor = min(1.0, FACE / ear_to_ear(landmarks))
    size = (max(1, round(factor * matte.shape[1])), max(1, round(factor * matte.shape[0])))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    small /= np.float32(255)
    person = cv2.resize(np.asarray(matte, np.float32), size, interpolation=cv2.INTER_AREA) > 0.5
    places = landmarks * factor

    def within(outline: Float64) -> Bools:
        out = np.zeros(size[::-1], np.uint8)
        cv2.fillPoly(out, [np.rint(outline).astype(np.int32)], 1)
        return out > 0

    mouth = places[48:60].mean(axis=0)
    lips = mouth + 1.25 * (places[[54, 55, 56, 57, 58, 59, 48]] - mouth)
    chin = within(np.vstack([places[4:13], lips])) & person
    cheeks = (within(places[[31, 2, 41]]) | within(places[[35, 14, 46]])) & person
    if not (chin.any() and cheeks.any()):
        return None
    lab = np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2LAB), np.float32)
    unlike = np.linalg.norm((lab - np.median(lab[cheeks], axis=0))
                            * np.array([LIGHTNESS, 1, 1]), axis=2) > UNLIKE
    down = places[8] - places[27]
    tall = float(np.linalg.norm(down))
    down = down / max(tall, 1e-9)
    rows, columns = np.indices(chin.shape)
    right = (columns - places[8, 0]) * down[1] - (rows - places[8, 1]) * down[0] > 0
    halves = [unlike[chin & side] for side in (right, ~right)]
    if unlike[chin].mean() < BEARDED or min(one.mean() for one in halves if len(one)) < HALF:
        return None
    values = _looks(small)
    bearded = chin & unlike
    if _is_cloth(lab, values[..., 2], bearded, cheeks):
        return None
    like = _like_a_beard(values, bearded, cheeks)
    like[~person] = -1
    if hair is not None:
        curls = cv2.resize(np.asarray(hair, np.float32), size, interpolation=cv2.INTER_AREA) > 0.5
        above = (rows - places[27, 1]) * down[1] + (columns - places[27, 0]) * down[0] < 0
        pieces = ndimage.label(curls)[0]
        like[curls & np.isin(pieces, np.setdiff1d(pieces[above], 0))] = -1
    jaw = _along(places[3:14], WAYS)
    step = LENGTH * tall / STEPS
    at = (jaw[:, None] + (np.arange(STEPS)[None, :, None] + 0.5) * step * down).astype(np.float32)
    shown = within(np.vstack([places[1:16], places[[35, 33, 31]]])) & person & (like > 0)
    shown &= ~within(mouth + 1.15 * (places[48:60] - mouth))
    along, *looks = (cv2.remap(np.ascontiguousarray(one), at[..., 0], at[..., 1], cv2.INTER_LINEAR,
                              borderMode=cv2.BORDER_REPLICATE)
                    for one in (like, *np.moveaxis(values, 2, 0)))
    length = _lengths(np.asarray(along, np.float32), _edges(np.stack(looks, axis=2)))
    outline = np.vstack([jaw, (jaw + (length * step)[:, None] * down)[::-1]])
    face = within(np.vstack([places[:17], places[26:16:-1]]))
    found = (within(outline) & ~face & person).astype(np.float32)
    grown = _one_piece(shown | (found > 0), chin) & person
    below, whole = (cv2.resize(one, matte.shape[::-1], interpolation=cv2.INTER_LINEAR)
                    for one in (found, grown.astype(np.float32)))
    if not (below > 0.5).any():
        return None
    return Beard(np.asarray(below > 0.5), np.asarray(np.clip(whole, 0, 1), np.float32))


def _one_piece(shown: Bools, chin: Bools) -> Bools:
    """What of places [h, w] is one with those of the chin, without gaps and thin ends."""
    whole = shown.astype(np.uint8)
    for change, size in ((cv2.MORPH_CLOSE, 9), (cv2.MORPH_OPEN, 5)):
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
        whole = np.asarray(cv2.morphologyEx(whole, change, disc), np.uint8)
    pieces = ndimage.label(whole)[0]
    kept = np.unique(pieces[chin])
    return np.isin(pieces, kept[kept > 0])


def beneath(beard: Bools, unit: float) -> Float32:
    """How much a photo shows what lies below a beard, float32 [H, W]; ``unit`` is in pixels.

    Along its end the beard's own picture is mixed with that.
    """
    below = (np.maximum.accumulate(beard, axis=0) & ~beard).astype(np.float32)
    reach = max(1, round(MIXED * unit))
    wide = cv2.dilate(below, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    return np.asarray(cv2.GaussianBlur(wide, (0, 0), 0.5 * reach), np.float32)


def _is_cloth(lab: Float32, fine: Float32, chin: Bools, skin: Bools) -> bool:
    """Whether what covers a chin is no hair: blue, green, bright, more colorful, or smooth."""
    one, two = (np.median(lab[part], axis=0) for part in (chin, skin))
    colorful = np.hypot(*one[1:]) > np.hypot(*two[1:]) + COLORFUL or one[1:].min() < -COLORFUL
    smooth = np.median(fine[chin]) < np.median(fine[skin]) + SMOOTH
    return bool(colorful or one[0] > two[0] + COLORFUL or smooth)


def _looks(image: Float32) -> Float32:
    """Lightness, redness and fineness of a picture's places in octaves, float32 [h, w, 3]."""
    linear = image ** np.float32(2.2) + np.float32(0.01)
    light = np.log2(linear.mean(axis=2))
    fine = light - cv2.GaussianBlur(light, (0, 0), 2.5)
    fine = np.sqrt(cv2.GaussianBlur(fine * fine, (0, 0), 2.5))
    red, green, blue = np.moveaxis(cv2.GaussianBlur(linear, (0, 0), 1.5), 2, 0)
    redness = np.log2(red) - 0.5 * (np.log2(green) + np.log2(blue))
    return np.asarray(np.dstack([np.log2((red + green + blue) / 3), redness, fine]), np.float32)


def _like_a_beard(values: Float32, beard: Bools, skin: Bools) -> Float32:
    """How much more places [h, w] look like a beard's than like skin or anything else, -1 to 1."""
    def of(known: Bools) -> tuple[Float32, Float32]:
        middle = np.median(values[known], axis=0)
        return middle, 1.48 * np.median(np.abs(values[known] - middle), axis=0) + SPREAD

    middle, spread = of(beard)
    away = (values - middle) / spread
    # Single hairs may be gray, and finer where the photo is sharper; nothing is less than gray.
    gray = min(float(middle[1]), -0.05)
    less = (values[..., 1] - gray) / spread[1]
    away[..., 1] = np.where(away[..., 1] >= 0, away[..., 1],
                            np.where(less < 0, less, GRAY * away[..., 1]))
    away[..., 2] *= np.where(away[..., 2] > 0, FINER, 1.0)
    far = (np.minimum(np.abs(away), 4.0) ** 2) @ np.array([0.5, 1, 1])
    middle, spread = of(skin)
    other = (np.minimum(np.abs((values - middle) / spread), 4.0) ** 2) @ np.array([SHADE, 1, 1])
    return np.asarray(np.clip((np.minimum(other, NEITHER) - far) / 8, -1, 1), np.float32)


def _along(points: Float64, count: int) -> Float64:
    """Places [count, 2], evenly along a line through points."""
    way = np.append(0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    at = np.linspace(0, way[-1], count)
    return np.stack([np.interp(at, way, points[:, k]) for k in range(2)], axis=1)


def _edges(looks: Float32) -> Float64:
    """How much of an edge [W, T + 1] lies before each of steps [W, T, 3] down: 0 to 1."""
    count = looks.shape[1]
    sums = np.pad(np.cumsum(looks, axis=1, dtype=np.float64), ((0, 0), (1, 0), (0, 0)))
    out = np.zeros((len(looks), count + 1))
    for step in range(1, count):
        first, last = max(step - 3, 0), min(step + 3, count)
        change = ((sums[:, step] - sums[:, first]) / (step - first)
                  - (sums[:, last] - sums[:, step]) / (last - step))
        out[:, step] = np.clip(np.linalg.norm(change / CONTRAST, axis=1) - 0.3, 0, 1)
    return out


def _lengths(like: Float32, edges: Float64) -> Float64:
    """How many steps [W] a beard is long, by dynamic programming along the jaw."""
    ways, steps = like.shape
    down = np.arange(steps) / steps
    beside = np.linspace(-1, 1, ways)[:, None] ** 2
    gain = like - 0.05 - TALL * down - BESIDE * beside * np.sqrt(down)
    gains = np.pad(np.cumsum(gain, axis=1), ((0, 0), (1, 0))) + EDGE * edges
    ends = np.arange(steps + 1)
    cost = TURN * np.abs(ends[:, None] - ends)
    best, came = gains[0], np.zeros((ways, steps + 1), np.int64)
    for way in range(1, ways):
        through = best - cost
        came[way] = through.argmax(axis=1)
        best = gains[way] + through.max(axis=1)
    out = np.zeros(ways)
    end = int(best.argmax())
    for way in range(ways - 1, -1, -1):
        out[way], end = end, int(came[way, end])
    even = ndimage.gaussian_filter1d(ndimage.median_filter(out, 9, mode="nearest"), 1.5,
                                     mode="nearest")
    return np.maximum(even - FRINGE, 0)


def beard_piece(parts: Parts, beard: Bools, face: Float64, down: Float64, body: Piece | None,
                ) -> Piece | None:
    """A beard as a piece that hangs down from a jaw.

    Parameters
    ----------
    parts : Maps [h, w] of the person.
    beard : bool [h, w], where it shows.
    face : Depth [h, w] of the head's front down to the jaw, NaN where it is not.
    down : float64 [2], the direction (row, column) from the head's brows to its chin.
    body : What lies behind it.
    """
    cell, shown = parts.cell, np.isfinite(face)
    beard = beard & ~shown & (parts.inside > 0)
    start, length = _hung_from(_foremost(face, LIP / cell), beard, down)
    if not np.isfinite(start).any():
        return None
    even = np.asarray(cv2.GaussianBlur(filled(start, 2.0), (0, 0), EVEN / cell), np.float64)
    front = even + SLOPE * length * cell
    if body is not None:
        chest = body.middle - np.sqrt(np.maximum(body.front, 0)) - BEFORE
        front = np.where(body.front > 0, np.minimum(front, chest), front)
    reach = max(1, round(INTO / cell))
    near = ndimage.binary_dilation(beard, iterations=reach)
    domain = beard | (shown & near)
    # Within the head it is hidden.
    front = np.where(shown, np.maximum(front, face + UNDER), front)
    smooth = cv2.GaussianBlur(filled(np.where(domain, front, np.nan), 2.0), (0, 0), 2.0)
    edge = ndimage.distance_transform_edt(beard | shown) * cell
    edge = np.minimum(edge, np.maximum(parts.inside * cell, 0))
    way = np.clip(edge / ROUND, 0, 1)
    thin = np.sqrt(1 - (1 - way) ** 2)
    deep = np.clip(edge / BEHIND, 0, 1)
    squares = ((AHEAD * thin) ** 2, (BEHIND * np.sqrt(1 - (1 - deep) ** 2)) ** 2)
    ahead, behind = (outside(np.where(domain, one, 0.0), parts, domain, 1.0) for one in squares)
    return Piece(ahead, behind, np.asarray(smooth + AHEAD, np.float64), domain, domain)


def _foremost(face: Float64, reach: float) -> Float64:
    """A face's depth [h, w], of each place the foremost one up to ``reach`` cells from it."""
    size = 2 * max(1, round(reach)) + 1
    near = ndimage.minimum_filter(np.where(np.isfinite(face), face, np.inf), size)
    return np.where(np.isfinite(face), near, np.nan)


def _hung_from(face: Float64, beard: Bools, down: Float64) -> tuple[Float64, Float64]:
    """Depths [h, w] of the jaw that a beard hangs from, and how many cells down from it places lie.

    The depths are known (not NaN) where going up from a beard meets the face.
    """
    start, length = np.full(face.shape, np.nan), np.zeros(face.shape)
    height, width = face.shape
    rows, columns = np.nonzero(beard)
    for step in range(1, height + width):
        row = np.rint(rows - step * down[0]).astype(int)
        column = np.rint(columns - step * down[1]).astype(int)
        within = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        if not within.any():
            break
        rows, columns, row, column = rows[within], columns[within], row[within], column[within]
        length[rows, columns] = step
        met = np.isfinite(face[row, column])
        start[rows[met], columns[met]] = face[row[met], column[met]]
        rows, columns = rows[~met], columns[~met]
    # What no jaw lies above is as far down as what is beside it.
    unmet = beard & np.isnan(start)
    if unmet.any() and not unmet[beard].all():
        nearest = ndimage.distance_transform_edt(np.isnan(start), return_distances=False,
                                                 return_indices=True)
        length[unmet] = length[tuple(nearest)][unmet]
    return start, length
