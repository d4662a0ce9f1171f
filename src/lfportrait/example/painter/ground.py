"""The ground behind a portrait, painted on from the exemplar's own background.

A panel shows much more of what is behind a head than a painting does. So the background is gone on
with by patches of its own (`lfportrait.example.patches`), whose search begins with whole pieces of
it: what lies at a height comes from that height, where the painting has background there, so that a
sky stays above its hills; how light and dark lie in it is kept by its blurred colors. Patches hold
nothing but background: no hat, no hair, no clothes. Where a painting has too little of it for
patches, its mean color is laid in its grain.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import distance_transform_edt, gaussian_filter

from ... import models
from ...arrays import Array, Bool, Float32, Float64, Floats, Int32, Int64, UInt8
from ...cache import kept_arrays, key_of
from ...color import to_uint8
from ...labels import MATERIALS
from ..exemplar import Exemplar
from ..guides.filters import grey
from ..kernels.patches import ACTIVE, MARGIN, finer_places, vote_patches
from ..patches import SCALE, PatchSearch, PatchSource, PatchTarget, halved, synthesise_patches
from .picture_materials import EARS, GROUND, SKIN, known_shares

PART = 8  # Above and below a background goes on as this part of its height does.


def first_places(there: Bool, inside: Bool, middle: Float64, shape: tuple[int, int],
                 side: int, rng: np.random.Generator,
                 ) -> tuple[Float32, Int64]:
    """Places of the exemplar where the search begins, and each row's own height in it.

    Where the exemplar has background it stays where it is. Beyond, whole pieces of it lie side by
    side, each from about its own height; what is not background in them comes from smaller pieces.
    Returns float32 [H, W, 2], (x, y), and int64 [H], the row of the exemplar that is as high.

    Parameters
    ----------
    there, inside : bool [h, w], where the exemplar is background, and where a patch is as a whole.
    middle : Place (x, y) between its eyes, which the ground's middle lies behind.
    shape, side : Of the ground, and of a piece.
    """
    rows, columns = np.nonzero(inside if inside.any() else there)
    left, top = (round(float(v)) for v in middle - np.array(shape[::-1]) / 2)
    level = _folded(np.arange(shape[0]) + top, int(rows.min()), int(rows.max()))
    y, x = np.indices(shape)
    u, v = x + left, y + top
    order = np.argsort(rows, kind="stable")
    for piece in (side, max(side // 3, 6), 6):
        missing = ~_within(there, u, v)
        moved = _pieces(rows[order], columns[order], level, piece, shape, rng)
        u, v = np.where(missing, moved[0], u), np.where(missing, moved[1], v)
    missing = ~_within(there, u, v)
    _, nearest = distance_transform_edt(~there, return_indices=True)
    at = np.clip(v, 0, len(nearest[0]) - 1), np.clip(u, 0, nearest.shape[2] - 1)
    u, v = np.where(missing, nearest[1][at], u), np.where(missing, nearest[0][at], v)
    return np.asarray(np.stack([u, v], axis=-1) + 0.5, np.float32), level


def _folded(rows: Int64, first: int, last: int) -> Int64:
    """Rows of the picture that stand for rows above and below its background, int64 [H].

    There the nearest part of it is gone up and down: one row again and again would be stripes.
    """
    part = max((last - first) // PART, 1)

    def fold(beyond: Int64) -> Int64:
        turned = beyond % (2 * part)
        return np.minimum(turned, 2 * part - turned)

    out = np.where(rows < first, first + fold(first - rows), rows)
    return np.asarray(np.where(rows > last, last - fold(rows - last), out), np.int64)


def _within(there: Bool, u: Int64, v: Int64) -> Bool:
    """Whether places (column u, row v) lie in the picture and in a mask."""
    height, width = there.shape
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    inside[inside] = there[v[inside], u[inside]]
    return inside


def _pieces(rows: Int64, columns: Int64, level: Int64,
            side: int, shape: tuple[int, int], rng: np.random.Generator,
            ) -> tuple[Int64, Int64]:
    """Columns and rows [H, W] of a ground of square pieces, each from about its height.

    ``rows`` and ``columns`` are the places that pieces may have their middles at, from above; every
    second line of pieces is half a piece aside.
    """
    y, x = np.indices(shape)
    line = y // side
    count = int(line.max()) + 1, -(-shape[1] // side) + 1
    middle = level[np.minimum(np.arange(count[0]) * side + side // 2, shape[0] - 1)]
    # One of those that are at most half a piece, or a twentieth of them all, above or below.
    few = len(rows) // 20
    at = np.searchsorted(rows, middle)
    first = np.minimum(np.searchsorted(rows, middle - side // 2), np.maximum(at - few, 0))
    last = np.maximum(np.searchsorted(rows, middle + side // 2), np.minimum(at + few, len(rows)))
    chosen = first[:, None] + (rng.random(count) * (last - first)[:, None]).astype(np.int64)
    chosen = np.minimum(chosen, len(rows) - 1)
    aside = x + line % 2 * (side // 2)
    one = chosen[line, aside // side]
    return (columns[one] + aside % side - side // 2, rows[one] + y % side - side // 2)


MOST = 30  # Grounds that are kept: six megabytes each.
SURE = 0.97  # Share of background from which a place is background.
AWAY = 0.15
"""Background begins so far away from the person, over the face's size: hair ends in single strands,
and painters draw outlines."""
LEAST = 0.02  # Less of a picture than this is too little to lay patches from.
NARROW = 6  # A background must be so many pixels wide somewhere, on each level of the patches.
STRAY = 0.1
"""So far around a stroke of the person's, over the face's size, is no background either."""
USUAL, MUCH, LEAST_STRAY = 0.9, 4.0, 0.12
"""A stroke is so many times farther off the background's colors than this share of it, and at least
so far."""
FORBIDDEN = 8 * 255 * SCALE  # Guide of what is not background: no agreement of colors outweighs it.
FACE = 0.3  # Size of a usual face (`face_size`) in world units: all sitters get one ground.
BLOCK = 0.4  # Side in world units of the pieces that the search begins from.
TURN = 1.5  # Slope of the light per share by which one side of a face is lighter than the other.

TONE, HEIGHT = 1.0, 0.5
"""Weights of the background's lights and darks, and of staying at one's height, in the search."""
SEARCH = PatchSearch(uniformity=4000.0, votes=2, last_votes=1, final_3x3=False)
"""How patches are searched: a ground is blurred on most panels."""


@dataclass(frozen=True)
class GroundSize:
    """Size of a painted ground."""

    width: float = 6.6
    """Width in world units (a head is about 1.5 high); what is beyond is its mirror image."""
    height: float = 3.6
    """Height in world units; the eyes lie in its middle."""
    pixels: float = 300.0
    """Pixels per world unit, at most; no more than the exemplar has."""


def painted_ground(exemplar: Exemplar, size: GroundSize | None = None, seed: int = 0,
                   ) -> tuple[UInt8, float]:
    """The ground behind a head, uint8 [h, w, 3], and its pixels per world unit.

    Its middle is level with the eyes.
    """
    size = size or GroundSize()
    regions = exemplar.regions()
    shares = known_shares(exemplar, regions, regions.labels())
    pixels = min(size.pixels, exemplar.size / FACE)
    whole = _Source.of(exemplar, shares, pixels * FACE / exemplar.size)
    shape = round(size.height * pixels / 2), round(size.width * pixels / 2)
    source = whole.half()
    if source.levels < 1:
        return _plain(whole, (2 * shape[0], 2 * shape[1]), seed), pixels
    rng = np.random.Generator(np.random.Philox(key=[seed, 45]))
    side = max(int(BLOCK * pixels / 2), 8)
    start, level = first_places(source.there, source.inside, source.middle, shape, side, rng)
    tones = _asked(source, shape, level, side)
    guides = source.guides()
    target = PatchTarget(source.asked(tones, level), start, start, even=source.even(shape))
    search = replace(SEARCH, levels=min(SEARCH.levels, source.levels))
    _, places = synthesise_patches(target, PatchSource.of(source.strokes, guides), search, seed)
    return to_uint8(_finer(places, source, whole) + _twice(tones)), pixels


def known_ground(exemplar: Exemplar, size: GroundSize | None = None, seed: int = 0,
                 ) -> tuple[UInt8, float, Float64]:
    """`painted_ground` and `lit_side`, from the user's cache where they have been found before."""
    size = size or GroundSize()

    def find() -> dict[str, Array]:
        picture, pixels = painted_ground(exemplar, size, seed)
        return {"picture": picture, "pixels": np.array(pixels), "light": lit_side(exemplar)}

    key = key_of(__name__, exemplar.image, exemplar.landmarks, exemplar.mask,
                 exemplar.hair, models.in_use(["person-segmentation", "hair-segmentation"]), size,
                 seed)
    kept = kept_arrays("grounds", key, find, most=MOST)
    return kept["picture"], float(kept["pixels"]), kept["light"]


def lit_side(exemplar: Exemplar) -> Float64:
    """Where a painting's light comes from: a direction in the portrait frame, float64 [3].

    It falls from above on the side of the face that is lighter. Both sides are compared by the
    medians of their skin, so that the nose's shadow and spots of light don't count.
    """
    regions = exemplar.regions()
    shares = known_shares(exemplar, regions, regions.labels())
    skin = shares[..., [SKIN, EARS]].sum(axis=-1) > 0.6
    luma = grey(exemplar.image.astype(np.float32) / np.float32(255))
    nose = exemplar.landmarks[27:31].mean(axis=0)
    down = exemplar.landmarks[8] - exemplar.landmarks[27]
    across = np.array([down[1], -down[0]]) / max(float(np.linalg.norm(down)), 1e-6)
    y, x = np.nonzero(skin)
    side = (np.stack([x, y], axis=1) - nose) @ across / exemplar.size
    sides = [luma[y, x][(side * sign > 0.3) & (side * sign < 2.0)] for sign in (-1, 1)]
    aside = 0.0
    if min(len(part) for part in sides) >= 50:
        left, right = (float(np.median(part)) for part in sides)
        aside = float(np.clip(TURN * (right - left) / max(right + left, 0.1) * 2, -0.8, 0.8))
    light = np.array([aside, 0.55, 1.0])
    return np.asarray(light / np.linalg.norm(light), np.float64)


@dataclass
class _Source:
    """An exemplar's background at the ground's scale."""

    picture: Float32  # float32 [h, w, 3] in [0, 1], of the whole exemplar.
    there: Bool  # bool [h, w], where it is background.
    middle: Float64  # Place (x, y) between the eyes.

    @staticmethod
    def of(exemplar: Exemplar, shares: Float32, size: float) -> _Source:
        height, width = exemplar.image.shape[:2]
        shape = max(round(size * width), 16), max(round(size * height), 16)
        picture = np.asarray(Image.fromarray(exemplar.image).resize(
            shape, Image.Resampling.LANCZOS), np.float32) / np.float32(255)
        ground = np.asarray(Image.fromarray(np.ascontiguousarray(shares[..., GROUND])).resize(
            shape, Image.Resampling.BILINEAR))
        away = _depth(np.pad(ground > SURE, 1, mode="edge"))[1:-1, 1:-1]
        there = away > max(AWAY * exemplar.size * size, 1.5)
        if there.mean() < LEAST:
            # Better too near to the person than nothing.
            there = away > 1.5
        scale = np.divide(shape, (width, height))
        whole = _Source(picture, there, exemplar.landmarks[36:48].mean(axis=0) * scale)
        return replace(whole, there=there & ~whole.strays(STRAY * exemplar.size * size))

    def strays(self, reach: float) -> Bool:
        """Strokes of the person's on the background, and what is within ``reach`` pixels, [H, W].

        They are much farther from the background's blurred colors than nearly all of it is.
        """
        if not self.there.any():
            return np.zeros_like(self.there)
        apart = np.linalg.norm(self.picture - self.tones, axis=-1)
        usual = np.quantile(apart[self.there], USUAL)
        stray = self.there & (apart > max(MUCH * float(usual), LEAST_STRAY))
        return np.asarray(_depth(~stray) <= reach) if stray.any() else stray

    def half(self) -> _Source:
        """The same at half the size."""
        there = halved(self.there.astype(np.float32)[..., None])[..., 0] > 0.99
        return _Source(halved(self.picture), there, self.middle / 2)

    @functools.cached_property
    def inside(self) -> Bool:
        """Where a patch is background as a whole, bool [h, w]."""
        return np.asarray(_depth(np.pad(self.there, 1))[1:-1, 1:-1] > MARGIN + 1)

    @functools.cached_property
    def levels(self) -> int:
        """Levels of a pyramid on which patches fit into it; 0: none."""
        widest = float(_depth(np.pad(self.there, 1)).max(initial=0.0))
        if self.there.mean() < LEAST or widest < NARROW:
            return 0
        return 1 + int(np.log2(widest / NARROW))

    @functools.cached_property
    def tones(self) -> Float32:
        """The background's blurred colors, carried on softly where it is not; float32 [h, w, 3]."""
        height, width = self.there.shape
        factor = max(self.spread / 3, 1.0)
        size = max(round(width / factor), 4), max(round(height / factor), 4)
        weight = self.there.astype(np.float32)
        planes = np.concatenate([self.picture * weight[..., None], weight[..., None]], axis=-1)
        small = cv2.resize(planes, size, interpolation=cv2.INTER_AREA)
        total = np.zeros_like(small)
        # Where it is near it counts alone; farther off the mean is ever wider.
        for turn in range(5):
            total += 0.01 ** turn * gaussian_filter(small, (3.0 * 2 ** turn, 3.0 * 2 ** turn, 0),
                                                    mode="nearest")
        means = total[..., :3] / np.maximum(total[..., 3:], 1e-20)
        return np.asarray(cv2.resize(means, (width, height), interpolation=cv2.INTER_LINEAR))

    @property
    def strokes(self) -> Float32:
        """What the blurred colors leave out, float32 [h, w, 3]."""
        return self.picture - self.tones

    def guides(self) -> Float32:
        """Guides of patches, float32 [h, w, 5]: blurred colors (3), height, and what is barred."""
        out = _guides(self.tones, self.height(np.arange(len(self.there))))
        out[..., 4] = np.where(self.there, 0, FORBIDDEN)
        return out

    def asked(self, tones: Float32, level: Int64) -> Float32:
        """Guides of a ground with blurred colors [H, W, 3] and rows as high as its own."""
        return _guides(tones, self.height(level))

    @property
    def spread(self) -> float:
        """Sigma of the blur that tells lights and darks from strokes, in pixels."""
        return 0.06 * max(self.there.shape)

    def height(self, rows: Floats | NDArray[np.integer]) -> Float32:
        """How high rows are, as a share of the picture's size."""
        return np.asarray(rows / max(self.there.shape), np.float32)

    def even(self, shape: tuple[int, int]) -> Float32:
        """How often each pixel is used if the background is used alike, float32 [h, w]."""
        often = shape[0] * shape[1] / max(float(self.there.sum()), 1.0)
        return np.where(self.there, np.float32(often), np.float32(0))


def _depth(inside: Bool) -> Float32:
    """Distance of places inside a mask from what is outside, in pixels, float32 [h, w]."""
    return np.asarray(cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2,
                                            cv2.DIST_MASK_PRECISE), np.float32)


def _finer(places: Int32, source: _Source, whole: _Source) -> Float32:
    """The strokes that patches make at twice the size at which they were found, [2 H, 2 W, 3].

    Their middles go on to the finer pixels; colors are voted from the finer exemplar. A search
    there would cost four times as much as all before, and find nearly the same.
    """
    shape = 2 * places.shape[0], 2 * places.shape[1]
    state = np.full(shape, ACTIVE, np.uint8)
    finer = np.empty(shape, np.int32)
    size = whole.picture.shape[0], whole.picture.shape[1]
    finer_places(places, source.picture.shape[1], state, np.zeros(shape, np.int32), size, finer)
    strokes = np.ascontiguousarray(whole.picture - cv2.resize(
        source.tones, size[::-1], interpolation=cv2.INTER_LINEAR))
    out = np.zeros((*shape, 3), np.float32)
    vote_patches(finer, np.zeros(shape, np.float32), state, strokes, 1, np.float32(1), out)
    return out


def _guides(tones: Float32, height: Float32) -> Float32:
    """Guides of patches by blurred colors [H, W, 3] and heights [H]; float32 [H, W, 5]."""
    roots = SCALE * 255 * np.sqrt([TONE / 3] * 3 + [HEIGHT, 0.0])
    planes = np.zeros((*tones.shape[:2], 5), np.float32)
    planes[..., :3], planes[..., 3] = tones, height[:, None]
    return planes * roots.astype(np.float32)


def _asked(source: _Source, shape: tuple[int, int], level: Int64, blur: float,
           ) -> Float32:
    """Blurred colors of the ground, float32 [H, W, 3]: those of the exemplar, gone on with."""
    left = source.middle[0] - shape[1] / 2
    column = np.clip(np.rint(np.arange(shape[1]) + left), 0,
                     source.there.shape[1] - 1).astype(np.int64)
    return np.asarray(cv2.GaussianBlur(source.tones[np.ix_(level, column)], (0, 0), blur / 4,
                                       borderType=cv2.BORDER_REPLICATE), np.float32)


def _twice(tones: Float32) -> Float32:
    """Blurred colors at twice the size."""
    return np.asarray(cv2.resize(tones, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR))


def _plain(source: _Source, shape: tuple[int, int], seed: int) -> UInt8:
    """A ground in the mean color of what background there is, in the grain of the painting."""
    picture = source.picture
    border = np.zeros(source.there.shape, bool)
    border[:len(border) // 3] = border[:, :2] = border[:, -2:] = True
    chosen = source.there if source.there.any() else border
    luma = grey(picture)
    fine = luma - gaussian_filter(luma, 2.0)
    grain = 1.4826 * float(np.median(np.abs(fine)))
    rng = np.random.Generator(np.random.Philox(key=[seed, 46]))
    noise = gaussian_filter(rng.standard_normal(shape).astype(np.float32), 1.0)
    noise *= grain / max(float(noise.std()), 1e-6)
    return to_uint8(np.median(picture[chosen], axis=0).astype(np.float32) + noise[..., None])


assert MATERIALS[GROUND] == "background"
