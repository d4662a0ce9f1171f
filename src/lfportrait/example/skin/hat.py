"""A painted hat on the surface of a head.

Where the guide leads into the painter's hat, and on the whole crown above its edge, lies the hat's
paint: in front as it was painted, elsewhere patches of it. Beyond what the painter saw, the edge
goes on at the height of its ends around the back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.ndimage import (
    distance_transform_edt,
    gaussian_filter,
    gaussian_filter1d,
    map_coordinates,
)

from ...arrays import Bool, Float32, Float64
from ...labels import MATERIALS
from ..exemplar import Exemplar
from ..guides.position import sample_labels
from ..guides.regions import Regions
from ..painter.materials import nearest_of_material
from ..painter.patch_painter import PatchPainter, PatchRequest
from ..painter.picture_materials import FEATURES, HAIR
from ..patches import PatchSearch
from ..worn.hat import Hat
from .hair import hair_by_place
from .sitter import Canvas, Skin

BINS, STEPS, COLUMNS = 72, 100, 40
"""Directions around the head, and heights, at which the edge is looked for; directions at which
its front is known."""
LOWEST, HIGHEST = -0.6, 1.2
"""It lies between these heights above the brows, over the face's height."""
SEEN = np.radians(75.0)  # The painter's edge is that within this angle from the forward direction.
NEAR = 0.15
"""Its own outline is kept where it is no further from the smooth edge, over the face's height."""
SMOOTH = 1.5  # Sigma of the smooth edge, in directions.
EDGE, SHADE = 0.012, 0.07
"""Breadth of its soft edge, and sigma of the shade below it, over the face's height."""
COPIED, REPEATED = 8.0, 0.15
"""Weight of the place where it is as the painter saw it, and where it goes on around the back."""
PERIOD = np.radians(100.0)  # There its middle part, so broad, is repeated.
NAPE = -1.0
"""Hair that grows on a head ends above this, over the face's height (brows 0); below it hangs."""
OWN_HAIR, BESIDE = 0.05, 0.12
"""A painter's sitter shows hair of her own if this much, over the face's squared height, lies
further from the hat than this over the height."""


@dataclass(frozen=True)
class _Places:
    """Where a hat lies on a skin's N places: float32 [N] each, in [0, 1].

    ``front`` is where the guide leads into the painter's hat, ``light`` what its shade leaves;
    ``turn`` and ``above`` are directions, and heights above its edge over the face's height.
    """

    cover: Float32
    front: Bool
    light: Float32
    turn: Float32
    above: Float32


class HatPainter:
    """The hat of one exemplar, bared or not, prepared for painting skins."""

    def __init__(self, exemplar: Exemplar, hat: Hat, search: PatchSearch, seed: int) -> None:
        worn = exemplar.covered or exemplar
        side = 2 * max(1, round(0.01 * hat.frame.height)) + 1
        # Its outermost pixels are half background.
        inner = cv2.erode((hat.mask > 0.5).astype(np.uint8), np.ones((side, side), np.uint8)) > 0
        one = np.eye(len(MATERIALS), dtype=np.float32)
        self._hat = hat
        self._beside_hair = _shows_hair(worn.regions(), hat)
        self._painter = PatchPainter(worn, one[np.where(inner, HAIR, FEATURES)], search, seed,
                                     sharp=False)

    @staticmethod
    def of(exemplar: Exemplar, regions: Regions, search: PatchSearch, seed: int,
           ) -> HatPainter | None:
        """For a painting, if its sitter wears a hat."""
        hat = Hat.of(exemplar, regions)
        return None if hat is None else HatPainter(exemplar, hat, search, seed)

    def take_from(self, shares: Float32) -> None:
        """Let it be no hair among a painting's `MATERIALS`, [h, w, 7], in place.

        It is left there if its painter shows no other hair.
        """
        if self._beside_hair:
            taken = shares[..., HAIR] * self._hat.mask
            shares[..., FEATURES] += taken
            shares[..., HAIR] -= taken

    def paint(self, skin: Skin, canvas: Canvas, position: Float32, size: float,
              color: Float32) -> None:
        """Paint it over a painting, float32 [H, W, 3] in [0, 1], in place.

        ``position`` is float32 [N, 2], where the guide leads, in the exemplar's pixels; ``size`` is
        the canvas's pixels per pixel of the exemplar.
        """
        places = self._places(skin, position)
        if not self._beside_hair:
            # Under a bonnet whose painter shows no hair there is none but what hangs down.
            high = np.clip((-skin.flat[:, 1] / skin.plane.height - NAPE) / SHADE, 0, 1)
            hair = np.asarray(_hair(skin) * (1 - skin.ears) * high, np.float32)
            places = replace(places, cover=np.maximum(places.cover, hair))
        paint = self._laid(canvas, places, position, size, color)
        shown = canvas.spread(np.stack([places.cover, places.light], axis=1))
        own = canvas.own
        cover, light = shown[own, 0, None], shown[own, 1, None]
        shaded = color[own] * light
        color[own] = shaded + cover * (paint[own] - shaded)

    def _places(self, skin: Skin, position: Float32) -> _Places:
        """Where it lies."""
        points = skin.atlas.points.reshape(-1, 3)[skin.index]
        plane = skin.plane
        away = points - plane.origin.astype(np.float32)
        up = np.asarray(away[:, 1] / plane.height, np.float32)
        turn = np.arctan2(away[:, 0], away[:, 2])
        worn = self._worn(position)
        edge = _edge(turn, up, worn > 0.5, skin.ears)
        above = up - np.interp(turn, *_around(edge)).astype(np.float32)
        smooth = np.clip(above / EDGE + 0.5, 0, 1)
        near = (np.abs(above) < NEAR) & (np.abs(turn) < SEEN)
        # In front the outline is the painter's, elsewhere the smooth edge.
        cover = np.where(near, np.where(above > 0, np.maximum(worn, np.clip(
            above / NEAR * 4 - 3, 0, 1)), worn), smooth) * (1 - skin.ears)
        cover = np.asarray(cover, np.float32)
        front = (worn > 0.5) & (np.abs(turn) < SEEN)
        below = np.exp(-0.5 * (np.minimum(above, 0) / SHADE) ** 2) * (np.abs(turn) < np.pi / 2)
        light = np.asarray(1 - self._hat.shade * below, np.float32)
        return _Places(cover, np.asarray(front), light, turn, above)

    def _worn(self, position: Float32) -> Float32:
        """The painter's hat where the guide leads, float32 [N]."""
        mask = np.asarray(255 * self._hat.mask + 0.5, np.uint8)[..., None]
        found = sample_labels(mask, np.ascontiguousarray(position[None]))
        return np.asarray(found[0, :, 0], np.float32) / np.float32(255)

    def _laid(self, canvas: Canvas, places: _Places, position: Float32, size: float,
              color: Float32) -> Float32:
        """Patches of it, float32 [H, W, 3]."""
        painter = self._painter
        _, theirs = painter.source(size)
        shares = np.broadcast_to(np.eye(len(MATERIALS), dtype=np.float32)[HAIR],
                                 (len(position), len(MATERIALS)))
        material = np.full(len(position), HAIR, np.int64)
        guided = np.where(places.front[:, None], position, _repeated(places, position))
        wanted = nearest_of_material(material, theirs, guided * np.float32(size))
        row, column = (np.clip(wanted[:, axis].astype(np.int64), 0, theirs.tone.shape[1 - axis] - 1)
                       for axis in (1, 0))
        tone = np.ascontiguousarray(theirs.tone[row, column])
        weight = np.where(places.front, COPIED, REPEATED) / painter.unit(size) ** 2
        sure = np.tile(np.array([0, 1], np.float32), (len(position), 1))
        return painter.paint(canvas, size, PatchRequest(
            np.ascontiguousarray(shares), tone, np.zeros(len(tone), np.float32), wanted, wanted,
            weight.astype(np.float32), sure, canvas.states(places.cover > 0), color.copy()))


def _repeated(places: _Places, position: Float32) -> Float32:
    """Exemplar places [N, 2] that go on around the back as the hat's front does.

    At each height above the edge the front's middle part is repeated: bands and ribbons go around.
    """
    folded = (places.turn + PERIOD / 2) % PERIOD - PERIOD / 2
    column = np.clip(((folded / PERIOD + 0.5) * COLUMNS).astype(int), 0, COLUMNS - 1)
    row = np.clip((places.above / HIGHEST * STEPS).astype(int), 0, STEPS - 1)
    cell = column * STEPS + row
    known = places.front & (np.abs(places.turn) < PERIOD / 2) & (places.above > 0)
    count = np.bincount(cell[known], minlength=COLUMNS * STEPS)
    if not known.any():
        return position
    mean = np.stack([np.bincount(cell[known], position[known, axis], COLUMNS * STEPS)
                     for axis in range(2)], axis=-1) / np.maximum(count, 1)[:, None]
    nearest = distance_transform_edt(count.reshape(COLUMNS, STEPS) == 0, return_distances=False,
                                     return_indices=True)
    filled = mean.reshape(COLUMNS, STEPS, 2)[nearest[0], nearest[1]]
    smooth = [gaussian_filter(filled[..., axis], 1.0, mode="nearest") for axis in range(2)]
    at = np.stack([(folded / PERIOD + 0.5) * COLUMNS - 0.5, places.above / HIGHEST * STEPS - 0.5])
    return np.stack([map_coordinates(plane, at, order=1, mode="nearest") for plane in smooth],
                    axis=-1).astype(np.float32)


def _edge(turn: Float32, up: Float32, worn: Bool, ears: Float32) -> Float64:
    """Height of its edge in each of `BINS` directions around the head, from the back on.

    That which parts best what is worn, bool [N] where the guide leads into the hat, from what is
    not; where the painter saw none, between. ``turn`` and ``up`` are directions of places (0
    forward) and their heights, [N]; ``ears``, [N] in [0, 1], stand out, and say nothing.
    """
    column = np.clip(((turn / (2 * np.pi) + 0.5) * BINS).astype(int), 0, BINS - 1)
    row = ((up - LOWEST) / (HIGHEST - LOWEST) * STEPS).astype(int)
    known = (row >= 0) & (row < STEPS) & (ears < 0.5) & (np.abs(turn) < SEEN)
    cells = column[known] * STEPS + row[known]
    hat, bare = (np.bincount(cells, part[known], BINS * STEPS).reshape(BINS, STEPS)
                 for part in (worn, ~worn))
    # Below each height hats are wrong, above it bare places.
    wrong = np.pad(np.cumsum(hat, axis=1), ((0, 0), (1, 0))) + np.pad(
        np.cumsum(bare[:, ::-1], axis=1)[:, ::-1], ((0, 0), (0, 1)))
    edge = LOWEST + wrong.argmin(axis=1) / STEPS * (HIGHEST - LOWEST)
    found = hat.sum(axis=1) > 0.1 * np.maximum((hat + bare).sum(axis=1), 1)
    if not found.any():
        return np.full(BINS, HIGHEST)
    numbers = np.arange(BINS)
    edge = np.interp(numbers, numbers[found], edge[found], period=BINS)
    return np.asarray(gaussian_filter1d(edge, SMOOTH, mode="wrap"), np.float64)


def _around(edge: Float64) -> tuple[Float64, Float64]:
    """Directions of `_edge`'s values, and these, with one more at each end."""
    turn = ((np.arange(-1, BINS + 1) + 0.5) / BINS - 0.5) * 2 * np.pi
    return turn, np.concatenate([edge[-1:], edge, edge[:1]])


def _hair(skin: Skin) -> Float32:
    """Where a sitter's head has hair, or would have some, float32 [N]."""
    if skin.hair is not None:
        return skin.hair
    return skin.cached("hair by place", lambda: hair_by_place(skin.plane, skin.flat))


def _shows_hair(regions: Regions, hat: Hat) -> bool:
    """Whether a painting's sitter shows hair under the hat."""
    if regions.hair is None:
        return False
    side = 2 * max(1, round(BESIDE * hat.frame.height)) + 1
    near = cv2.dilate((hat.mask > 0.1).astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    return bool(regions.hair[~near].sum() > OWN_HAIR * hat.frame.height ** 2)
