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

from ...arrays import Bool, Float32, Float64
from ..head_fit import ear_to_ear
from .parts import Parts
from .piece import METRES, Piece, filled, outside

BEARD = 4  # What a place of the surface belongs to, beside those of `solid`.

FACE = 160.0  # Pixels that a face is wide, at most, where a beard is looked for.
UNLIKE = 14.0
"""Difference in CIELAB from a cheek's skin, lightness counted by `LIGHTNESS`, of a beard."""
LIGHTNESS = 0.3
BEARDED, HALF = 0.40, 0.25
"""How much of the area of a chin is unlike skin if it has a beard, and of each half: one alone may
lie in shade."""
LENGTH, WAYS, STEPS = 0.8, 61, 60
"""How far below the jaw a beard ends, over the height of a face from eyes to chin; ways down from
the jaw that are followed; steps of each."""
COLORFUL, SMOOTH, WHITE = 5.0, 0.01, 0.1
"""A beard is less colorful than skin and not brighter, but for so much in CIELAB; and less even, by
octaves of lightness from place to place. One that is brighter is less even by so much, and like
the hair."""
SHADED = 0.13, 0.95
"""Nor is it shade: less even by the first, or less red by the second, or by a half of each."""
CAST = 1.3
"""What lies below a jaw and is darker than the chin's hairs by more octaves is the chin's shade."""
SPREAD = np.array([0.25, 0.08, 0.03])
"""Least deviations of lightness (octaves), redness (octaves) and fineness (octaves) of a beard and
of skin."""
EVEN_LIGHT = 0.8
"""Octaves by which a beard's lightness deviates at most: a chin's skin and lips may be among it."""
SHADE, GRAY, FINER = 0.1, 0.55, 0.3
"""Weights of a skin's lightness, of how much less red hairs are than others, and of how much finer.
"""
NEITHER = 8.0  # Square of deviations from which on something is neither skin nor beard.
TURN, EDGE, TALL, BESIDE = 0.8, 5.0, 0.5, 0.5
"""In steps: what it costs a beard's outline to change by a step from one way to the next, and what
it is worth to run along an edge of the photo; what steps cost at the far end, and beside the chin.
"""
WHISKERS = 0.15  # How far whiskers stand out beside a jaw, over the height of a face.
FRINGE = 1.0  # The last of its steps are hairs before what lies below.
CONTRAST = np.array([0.8, 0.25, 0.1])  # Differences of the three that make an edge.

MIXED = 0.003 / METRES
"""How far up from its end a beard's colors are mixed with what lies below, portrait units."""
LIP = 0.008 / METRES
"""A beard's front begins at the foremost depth of the lowest so much of a jaw, portrait units."""
INTO = 0.02 / METRES  # It goes on so far up within the head.
UNDER = 0.0015 / METRES  # And lies so far within it there.
EVEN = 0.004 / METRES  # Over how much its front is even, portrait units.
SLOPE = 0.12  # How far back it falls of its way down.
AHEAD, BEHIND = 0.012 / METRES, 0.035 / METRES  # Its thickness before and behind its middle.
ROUND = 0.012 / METRES  # How far from its outline it is thinner.
BEFORE = 0.008 / METRES  # How far before the chest it lies at least.


class Beard(NamedTuple):
    """Where a photo shows a beard."""

    below: Bool  # bool [H, W], below the landmarks of the jaw.
    whole: Float32  # float32 [H, W] in [0, 1], there and on the face.


def beard_of(image: NDArray[np.uint8], matte: NDArray[np.floating], landmarks: Float64,
             hair: NDArray[np.floating] | None = None) -> Beard | None:
    """The beard that a photo shows, or None if none goes on below the jaw, but shade.

    From every place of the jaw it is followed down as far as it is more like the chin's than like
    skin or something else, to where the photo has an edge, for all places together.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    matte : [H, W] in [0, 1].
    landmarks : float64 [68, 2] in pixels.
    hair : [H, W] in [0, 1]: what of it reaches up to the eyes hangs down beside the jaw.
    """
    factor = min(1.0, FACE / ear_to_ear(landmarks))
    size = (max(1, round(factor * matte.shape[1])), max(1, round(factor * matte.shape[0])))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    small /= np.float32(255)
    masks = [one > 0.5 for one in (
        cv2.resize(np.asarray(one, np.float32), size, interpolation=cv2.INTER_AREA)
        for one in (matte, np.zeros_like(matte) if hair is None else hair))]
    face = _Face.of(landmarks * factor, masks[0])
    looks = _looks(small)
    lab = np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2LAB), np.float32)
    covered = _covered(lab, face)
    if covered is None or _is_other(lab, looks, covered, face.cheeks, masks[1]):
        return None
    like = _like_a_beard(looks, covered, face.cheeks)
    like[~face.person | _hanging(masks[1], face)] = -1
    found = _followed(like, looks, face)
    hairs = face.chin & (like > 0)
    if found.any() and hairs.any() and (np.median(looks[found, 0])
                                        < np.median(looks[hairs, 0]) - CAST):
        return None
    whole = _one_piece(((face.lower | face.beside) & (like > 0)) | found, face.chin) & face.person
    shown = [cv2.resize(one.astype(np.float32), matte.shape[::-1], interpolation=cv2.INTER_LINEAR)
             for one in (found, whole)]
    if not (shown[0] > 0.5).any():
        return None
    return Beard(np.asarray(shown[0] > 0.5), np.asarray(np.clip(shown[1], 0, 1), np.float32))


class _Face(NamedTuple):
    """Where the parts of a face lie in a picture, bool [h, w]."""

    places: Float64  # float64 [68, 2], landmarks in pixels.
    person: Bool
    chin: Bool  # Between lower lip and jaw.
    cheeks: Bool
    lower: Bool  # Below the nose, without the lips.
    inner: Bool  # From the brows to the jaw.

    @staticmethod
    def of(places: Float64, person: Bool) -> _Face:
        """The parts by landmarks, of a ``person``."""
        def within(*outline: Float64) -> Bool:
            out = np.zeros(person.shape, np.uint8)
            cv2.fillPoly(out, [np.rint(np.vstack(outline)).astype(np.int32)], 1)
            return out > 0

        mouth = places[48:60].mean(axis=0)
        around = mouth + 1.25 * (places[[54, 55, 56, 57, 58, 59, 48]] - mouth)
        lips = within(mouth + 1.15 * (places[48:60] - mouth))
        return _Face(
            places, person, within(places[4:13], around) & person,
            (within(places[[31, 2, 41]]) | within(places[[35, 14, 46]])) & person,
            within(places[1:16], places[[35, 33, 31]]) & person & ~lips,
            within(places[:17], places[26:16:-1]))

    @property
    def tall(self) -> float:
        """From the eyes to the chin, pixels."""
        return max(float(np.linalg.norm(self.places[8] - self.places[27])), 1e-9)

    @property
    def down(self) -> Float64:
        """The direction (x, y) from the eyes to the chin, of length 1."""
        return np.asarray((self.places[8] - self.places[27]) / self.tall)

    @property
    def beside(self) -> Bool:
        """Outside of the jaw's landmarks, as far as whiskers stand out."""
        height = np.tensordot(np.indices(self.inner.shape)[::-1], self.down, axes=(0, 0))
        away = cv2.distanceTransform((~self.inner).astype(np.uint8), cv2.DIST_L2, 5)
        ears, chin = min(self.places[[2, 14]] @ self.down), float(self.places[8] @ self.down)
        return np.asarray(self.person & ~self.inner & (away < WHISKERS * self.tall)
                          & (height > ears) & (height < chin))


def _covered(lab: Float32, face: _Face) -> Bool | None:
    """What of a chin is unlike skin, bool [h, w]; None if that is not enough for a beard."""
    if not (face.chin.any() and face.cheeks.any()):
        return None
    unlike = np.linalg.norm((lab - np.median(lab[face.cheeks], axis=0))
                            * np.array([LIGHTNESS, 1, 1]), axis=2) > UNLIKE
    rows, columns = np.indices(unlike.shape)
    (x, y), down = face.places[8], face.down
    right = (columns - x) * down[1] - (rows - y) * down[0] > 0
    halves = [unlike[face.chin & side] for side in (right, ~right)]
    if unlike[face.chin].mean() < BEARDED or min(one.mean() for one in halves if len(one)) < HALF:
        return None
    return np.asarray(face.chin & unlike)


def _hanging(hair: Bool, face: _Face) -> Bool:
    """Hair [h, w] that reaches up to the eyes."""
    rows, columns = np.indices(hair.shape)
    (x, y), down = face.places[27], face.down
    pieces = ndimage.label(hair)[0]
    above = (rows - y) * down[1] + (columns - x) * down[0] < 0
    return hair & np.isin(pieces, np.setdiff1d(pieces[above], 0))


def _followed(like: Float32, looks: Float32, face: _Face) -> Bool:
    """A beard below the jaw, bool [h, w], followed down from it."""
    jaw, step = _along(face.places[3:14], WAYS), LENGTH * face.tall / STEPS
    steps = np.arange(STEPS)[None, :, None] + 0.5
    at = (jaw[:, None] + steps * step * face.down).astype(np.float32)
    along, *seen = (cv2.remap(np.ascontiguousarray(one), at[..., 0], at[..., 1], cv2.INTER_LINEAR,
                              borderMode=cv2.BORDER_REPLICATE)
                    for one in (like, *np.moveaxis(looks, 2, 0)))
    length = _lengths(np.asarray(along, np.float32), _edges(np.stack(seen, axis=2)))
    end = jaw + (length * step)[:, None] * face.down
    out = np.zeros(like.shape, np.uint8)
    cv2.fillPoly(out, [np.rint(np.vstack([jaw, end[::-1]])).astype(np.int32)], 1)
    return (out > 0) & ~face.inner & face.person


def _one_piece(shown: Bool, chin: Bool) -> Bool:
    """What of places [h, w] is one with those of the chin, without gaps and thin ends."""
    whole = shown.astype(np.uint8)
    for change, size in ((cv2.MORPH_CLOSE, 9), (cv2.MORPH_OPEN, 5)):
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
        whole = np.asarray(cv2.morphologyEx(whole, change, disc), np.uint8)
    pieces = ndimage.label(whole)[0]
    kept = np.unique(pieces[chin])
    return np.isin(pieces, kept[kept > 0])


def beneath(beard: Bool, unit: float) -> Float32:
    """How much a photo shows what lies below a beard, float32 [H, W]; ``unit`` is in pixels.

    Along its end the beard's own picture is mixed with that.
    """
    below = (np.maximum.accumulate(beard, axis=0) & ~beard).astype(np.float32)
    reach = max(1, round(MIXED * unit))
    wide = cv2.dilate(below, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    return np.asarray(cv2.GaussianBlur(wide, (0, 0), 0.5 * reach), np.float32)


def _is_other(lab: Float32, looks: Float32, chin: Bool, skin: Bool, hair: Bool) -> bool:
    """Whether what covers a chin is cloth or shade, not hair."""
    one, two = (np.median(lab[part], axis=0) for part in (chin, skin))
    colorful = np.hypot(*one[1:]) > np.hypot(*two[1:]) + COLORFUL or one[1:].min() < -COLORFUL
    _, grayer, finer = np.median(looks[chin], axis=0) - np.median(looks[skin], axis=0)
    bright = one[0] > two[0] + COLORFUL
    if bright and hair.any():
        bright = finer < WHITE or np.linalg.norm(one - np.median(lab[hair], axis=0)) > UNLIKE
    shade = finer / SHADED[0] - grayer / SHADED[1] < 1
    return bool(colorful or bright or finer < SMOOTH or shade)


def _looks(image: Float32) -> Float32:
    """Lightness, redness and fineness of a picture's places in octaves, float32 [h, w, 3]."""
    linear = image ** np.float32(2.2) + np.float32(0.01)
    light = np.log2(linear.mean(axis=2))
    fine = light - cv2.GaussianBlur(light, (0, 0), 2.5)
    fine = np.sqrt(cv2.GaussianBlur(fine * fine, (0, 0), 2.5))
    red, green, blue = np.moveaxis(cv2.GaussianBlur(linear, (0, 0), 1.5), 2, 0)
    redness = np.log2(red) - 0.5 * (np.log2(green) + np.log2(blue))
    return np.asarray(np.dstack([np.log2((red + green + blue) / 3), redness, fine]), np.float32)


def _like_a_beard(values: Float32, beard: Bool, skin: Bool) -> Float32:
    """How much more places [h, w] look like a beard's than like skin or anything else, -1 to 1."""
    def of(known: Bool) -> tuple[Float32, Float32]:
        middle = np.median(values[known], axis=0)
        return middle, 1.48 * np.median(np.abs(values[known] - middle), axis=0) + SPREAD

    middle, spread = of(beard)
    spread[0] = min(spread[0], EVEN_LIGHT)
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


def beard_piece(parts: Parts, beard: Bool, face: Float64, down: Float64, body: Piece | None,
                ) -> Piece | None:
    """A beard as a piece that hangs down from a jaw.

    Parameters
    ----------
    parts : Maps [h, w] of the person.
    beard : bool [h, w], where it shows.
    face : Depth [h, w] of the head's front down to the jaw, NaN where it is not.
    down : float64 [2], the direction (row, column) from the head's brows to its chin.
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


def _hung_from(face: Float64, beard: Bool, down: Float64) -> tuple[Float64, Float64]:
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
