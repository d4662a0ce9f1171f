"""The skin of a sitter: the head's visible surface with all that painting it needs.

A `Skin` is computed once from a field and its landmarks, and kept beside the field; it knows
nothing of any exemplar. Besides the atlas (`charts`) it holds, for every pixel that owns its
surface point, what the sitter shows there: light and shade, detail, hair (by the segmentation
network, asked about the charts that stand upright, else by its color or its `relief`), clothes
(what lies below the chin and differs in color from the face), ears, and how well the photos saw
it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...capture import Camera
from ...field import SurfaceGraph, VoxelField
from ...labels import SURFACE_LABELS
from ...simd.threads import side_by_side
from ..exemplar import face_size
from ..guides.filters import broad_blur, grey, skin_distance
from ..kernels.atlas import best_facing, exchange
from ..painter.light import Cells
from ..painter.materials import BLUR, contours
from ..surface_guide import HeadPlane
from .charts import Atlas, draw_atlas
from .ear_places import ear_places
from .regions import hair_by_place, skin_regions, with_strands
from .relief import around_face, hair_by_relief

BEFORE, BEHIND, SOFT = 2.5, 7.0, 6.0
"""Lattice points up to so many voxels before a chart's surface, and under it, take its color; and
those that no chart has then, up to so many before it: a soft shell is seen before its surface."""

__all__ = ["PIXELS", "Skin", "face_pixels"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
T = TypeVar("T")

PIXELS = 384.0
"""Pixels of the charts per world unit: a head is about 600 high, as in most exemplars."""
UPRIGHT, TURNED = 30.0, 75.0
"""Charts of this pitch and yaw (degrees) at most are shown to the network of the hair."""
ROOM, GROUND = 1.4, 0.35
"""Side of the picture it is shown over that of the chart, and the grey around the head."""
AGREED = 0.35
"""Share of its hair (intersection over union) that charts which show the same places must agree on.
A real head's: 0.72; statues and shaven heads: 0.1 at most."""
LOWEST = -0.75
"""Hair hangs at least this far below the brows (up, in the face's heights)."""
BESIDE_NECK, HANGS, LONGEST = (-1.15, -0.85), 0.5, -1.6
"""Where long hair hangs beside the neck (up, in the face's heights), if this share of it there is
of the crown's color; and how far down it is looked for then."""
BEARD = -0.45, -1.5
"""A beard lies between these (up, in the face's heights)."""
OTHER = 2.3
"""A crown of hair is further than this from the face's colors, in standard deviations."""

SEEN, CLEAR = (0.1, 0.4), (0.35, 0.75)
"""Cosines to the best photo between which a place begins to be seen and is, and its detail does."""
GRAPH = 0.025
"""Side of the cells that regions are decided in as a whole, over the face's height."""
UNSURE = 0.01
"""Trust in what is said of places that no photo saw, over that in those that photos saw well."""


_PIECE = 1 << 15
"""Places that are unwrapped at a time: what is computed of them stays in a core's cache."""


@dataclass(frozen=True)
class Skin:
    """The visible surface of one head: an atlas, and lists over the N pixels that own a point.

    Attributes
    ----------
    atlas
        Charts side by side, [H, W].
    plane
        The unwrapping of the head by its landmarks.
    pixels
        Pixels of the charts per world unit.
    index
        int32 [N], flat index in the atlas of each owning pixel.
    tone, detail, appearance
        float32 [N]: luma blurred (`BLUR`); what that leaves out; the same without the photo's
        grain. The latter two are weaker where photos saw a place at a graze (`CLEAR`).
    contours
        float32 [N] in [0, 1]: photo edge strength (edges, patterns) at a place.
    hair
        float32 [N] in [0, 1], or None where it could not be found.
    clothes, ears
        float32 [N] in [0, 1]; clothes are what lies below the chin and is not of the face's color.
    seen
        float32 [N] in [0, 1]: how frontally the best photo saw a place; 1 where no cameras are
        known.
    outwards
        bool [N], False where the large shape faces backwards: there is no face, and where a field
        is open at the back one looks at its inside.
    rows
        float32 [R, 2], places in the atlas of the field's R lattice rows; NaN where no chart shows
        them.
    kept
        What paintings share, by what it is (`once`).
    """

    atlas: Atlas
    plane: HeadPlane
    pixels: float
    index: NDArray[np.int32]
    tone: Float32
    detail: Float32
    appearance: Float32
    contours: Float32
    hair: Float32 | None
    clothes: Float32
    ears: Float32
    seen: Float32
    outwards: NDArray[np.bool_]
    rows: Float32
    kept: dict[Hashable, Any] = dataclass_field(default_factory=dict, repr=False, compare=False)

    @staticmethod
    def of(field: VoxelField, landmarks: NDArray[np.floating], cameras: Camera | None = None,
           pixels: float = PIXELS, networks: bool = True) -> Skin:
        """The skin of a field.

        Parameters
        ----------
        field
            In the portrait frame.
        landmarks
            float64 [68, 3].
        cameras
            Of the photos, to know which places they saw.
        pixels
            Pixels of the charts per world unit.
        networks
            Ask the segmentation network for hair, where its weights are at hand.

        Raises
        ------
        UserError
            If the field shows no surface, or fewer than 20 landmarks are known.
        """
        plane = HeadPlane(landmarks)
        atlas = draw_atlas(field, pixels)
        index = np.flatnonzero(atlas.own).astype(np.int32)
        points = atlas.points.reshape(-1, 3)[index]
        normals = atlas.shape.at(points)
        facing = _facing(points, normals, cameras)
        seen, clear = _ramp(facing, SEEN), _ramp(facing, CLEAR)
        flat = plane.unwrap(points).astype(np.float32)
        colors = atlas.color.reshape(-1, 3)[index]
        known = _hair_in_front(atlas, index) if networks else None
        tone, detail, appearance, contours = _looks(atlas, index, _unit(plane) * pixels)
        ears = ear_places(plane, points, flat)
        if known is not None and _plausible(plane, points, known * seen):
            hair: Float32 | None = _hair_behind(plane, colors, flat, seen, ears, known)
        else:
            hair = _hair_by_color(plane, colors, flat, seen, ears)
            if hair is None:
                hair = hair_by_relief(plane, flat, contours, seen, ears)
        if hair is not None and seen.min() < 1:
            hair = _as_a_whole(SurfaceGraph.over(points, colors, GRAPH * plane.height), hair, seen)
        depth = (plane.origin[1] - points[:, 1]) / plane.height
        clothes = _clothes(plane, colors, points, flat, seen, depth, hair)
        # What photos saw at a graze is grain and smears: painted it would be stipple.
        return Skin(atlas, plane, pixels, index, tone, detail * clear, appearance * clear,
                    contours * np.minimum(seen, clear), hair, clothes, ears, seen,
                    normals[:, 2] > -0.2, _row_places(field, atlas))

    @functools.cached_property
    def flat(self) -> Float32:
        """Unwrapped places, float32 [N, 2], world units."""
        # Of a copy: the points of all pixels, which the atlas would keep, are a hundred MB.
        points = replace(self.atlas).points.reshape(-1, 3)
        parts = [self.index[since:since + _PIECE] for since in range(0, len(self.index), _PIECE)]
        return np.concatenate([np.empty((0, 2), np.float32), *side_by_side(
            lambda part: self.plane.unwrap(points[part]).astype(np.float32), parts)])

    @functools.cached_property
    def slots(self) -> NDArray[np.int32]:
        """Number in the lists of each pixel's owner, int32 [H, W]; -1 where there is none."""
        return self.slots_of(self.atlas.owner)

    def slots_of(self, owner: NDArray[np.int32]) -> NDArray[np.int32]:
        """Numbers in the lists of owners, int32 of their shape; -1 where there is none."""
        return self._numbers[owner]

    @functools.cached_property
    def _numbers(self) -> NDArray[np.int32]:
        """Number in the lists of each pixel of the atlas; the last one stands for no owner (-1)."""
        number = np.full(self.atlas.owner.size + 1, -1, np.int32)
        number[self.index] = np.arange(len(self.index), dtype=np.int32)
        return number

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What is kept under ``key``; made if there is nothing yet."""
        if key not in self.kept:
            self.kept[key] = make()
        found: T = self.kept[key]
        return found

    @property
    def labels(self) -> tuple[NDArray[np.uint8], tuple[str, ...]]:
        """Soft regions of the owning pixels, uint8 [N, R], and the regions' names."""
        return self.once("labels", self._labels)

    def _labels(self) -> tuple[NDArray[np.uint8], tuple[str, ...]]:
        points = self.atlas.points.reshape(-1, 3)[self.index]
        return skin_regions(self.plane, self.atlas.cameras[0], points, self.atlas.shape.at(points),
                            self.flat, self.hair, self.ears, self.clothes), SURFACE_LABELS

    @property
    def face(self) -> float:
        """Size of the face (`face_size` of the unwrapped landmarks) in pixels of the charts."""
        return _unit(self.plane) * self.pixels


def face_pixels(landmarks: NDArray[np.floating], pixels: float) -> float:
    """`Skin.face` of a head with these landmarks, float64 [68, 3], before there is a skin."""
    return _unit(HeadPlane(landmarks)) * pixels


def _row_places(field: VoxelField, atlas: Atlas) -> Float32:
    """Place in the atlas of each lattice row, float32 [R, 2]; NaN where there is none."""
    points = np.asarray(field.lattice_points(), np.float32)
    voxel = float(field.spacing.mean())
    places = atlas.locate(points, BEFORE * voxel, BEHIND * voxel)[0]
    nowhere = np.flatnonzero(np.isnan(places[:, 0]))
    places[nowhere] = atlas.locate(points[nowhere], SOFT * voxel, BEHIND * voxel)[0]
    return places


def _unit(plane: HeadPlane) -> float:
    """Size of the face in world units."""
    return face_size(plane.unwrap(plane.landmarks[plane.known]))


def _looks(atlas: Atlas, index: NDArray[np.int32], size: float,
           ) -> tuple[Float32, Float32, Float32, Float32]:
    """Tone, detail, appearance, contours of the owning pixels; ``size`` of the face in pixels."""
    luma = grey(atlas.color)[..., None].copy()
    exchange(atlas.owner, luma)
    inside = (atlas.owner >= 0).astype(np.float32)
    values = luma[..., 0] * inside
    sigma = BLUR * size
    broad = broad_blur(values, sigma) / np.maximum(broad_blur(inside, sigma), np.float32(1e-3))
    soft, strong = contours(values, inside, size)
    appearance = (soft - broad) * inside
    planes = (broad, values - broad, appearance, strong)
    tone, detail, looks, strength = (np.asarray(plane.reshape(-1)[index], np.float32)
                                     for plane in planes)
    return tone, detail, looks, strength


def _hair_in_front(atlas: Atlas, index: NDArray[np.int32]) -> Float32 | None:
    """Hair by the network on the charts that show a face, [N]; NaN on others. None without it.

    It has learnt from selfies: large, on a dark ground with room around it a head is found; from
    behind a shaven one is called hair. Nor is it believed where it calls one place hair in one
    chart and not in the next: the curls of a statue.
    """
    from ... import models
    from ...face import hair_mask

    if models.missing(["hair-segmentation"]):
        return None
    out = np.full(atlas.depth.shape, np.nan, np.float32)
    away = -atlas.cameras.pose[:, :3, 2]  # towards each chart's eye, in the portrait frame
    for n, (x0, y0, x1, y1, dx, dy) in enumerate(atlas.boxes.tolist()):
        if abs(away[n, 1]) > np.sin(np.radians(UPRIGHT)) or away[n, 2] < np.cos(np.radians(TURNED)):
            continue
        part = slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)
        there = np.isfinite(atlas.depth[part])[..., None]
        picture = np.where(there, atlas.color[part], np.float32(GROUND))
        rows, columns = picture.shape[:2]
        side = int(ROOM * max(rows, columns))
        square = np.full((side, side, 3), np.uint8(GROUND * 255), np.uint8)
        top, left = (side - rows) // 2, (side - columns) // 2
        square[top:top + rows, left:left + columns] = np.uint8(picture * 255 + 0.5)
        out[part] = hair_mask(square, size=512)[top:top + rows, left:left + columns]
    return out.reshape(-1)[index] if _agreed(atlas, out.reshape(-1)) else None


def _agreed(atlas: Atlas, hair: Float32) -> bool:
    """Whether charts that show the same places call the same ones hair, [H x W]."""
    owner = atlas.owner.reshape(-1)
    copies = np.flatnonzero((owner >= 0) & ~atlas.own.reshape(-1))
    here, there = hair[copies], hair[owner[copies]]
    known = np.isfinite(here) & np.isfinite(there)
    either, both = (float(part(here[known], there[known]).sum())
                    for part in (np.maximum, np.minimum))
    return both >= AGREED * either


def _hair_behind(plane: HeadPlane, colors: Float32, flat: Float32, seen: Float32,
                 ears: Float32, known: Float32) -> Float32:
    """Hair [N] where it is not ``known`` (NaN): what looks like the hair that is, not like skin."""
    up = -flat[:, 1] / plane.height
    hairy, bare = known > 0.7, (known < 0.2) & (up < 0.3) & (up > -0.9)
    # Down to where hair hangs at the sides.
    lowest = min(LOWEST, float(np.percentile(up[hairy], 2))) if hairy.any() else LOWEST
    parted = _told_apart(plane, colors, flat, seen, ears, hairy & (seen > 0.5),
                         bare & (seen > 0.5), lowest)
    return np.asarray(np.where(np.isnan(known), parted, known), np.float32)


def _hair_by_color(plane: HeadPlane, colors: Float32, flat: Float32, seen: Float32,
                   ears: Float32) -> Float32 | None:
    """Hair as what lies around the face, above the chin, in another color, [N]; None if alike."""
    up, angle = -flat[:, 1] / plane.height, np.abs(flat[:, 0]) / plane.radius
    crown = (up > 0.7) & (seen > 0.5)
    face, bearded = _bare_face(colors, up, (angle < 0.7) & (seen > 0.5), crown)
    if crown.sum() < 100 or face.sum() < 100:
        return None
    if np.median(skin_distance(colors[crown | face], face[crown | face], 1.0)[
            crown[crown | face]]) < OTHER:
        return None
    lowest = LOWEST
    # Long hair: beside the neck is its color, too.
    beside = (angle > 0.9) & (up > BESIDE_NECK[0]) & (up < BESIDE_NECK[1]) & (seen > 0.5)
    if beside.sum() >= 100:
        chosen = beside | crown | face
        hairy, bare = (skin_distance(colors[chosen], part[chosen], 1.0)[beside[chosen]]
                       for part in (crown, face))
        if np.mean((hairy < bare) & (hairy < OTHER)) > HANGS:
            lowest = LONGEST
    return _told_apart(plane, colors, flat, seen, ears, crown, face, lowest, bearded)


def _bare_face(colors: Float32, up: Float32, front: NDArray[np.bool_], crown: NDArray[np.bool_],
               ) -> tuple[NDArray[np.bool_], bool]:
    """Skin of the face among places in ``front``, bool [N], and whether there is a beard.

    A forehead under a fringe and a bearded chin are more like the crown than like the cheeks.
    ``up`` [N] is 0 at the brows and -1 at the chin.
    """
    out = front & (up < 0.3) & (up > -0.9)
    cheeks = front & (up < -0.1) & (up > -0.45)
    hairy = []
    for part in (front & (up > 0) & (up < 0.3), front & (up < -0.6) & (up > -0.9)):
        away = [np.median(skin_distance(colors[part | other], other[part | other], 1.0)[
            part[part | other]]) if min(part.sum(), other.sum()) > 100 else 0.0
            for other in (cheeks, crown)]
        hairy.append(bool(away[1] < away[0]))
        if hairy[-1]:
            out &= ~part
    return out, hairy[1]


def _as_a_whole(graph: SurfaceGraph, hair: Float32, seen: Float32) -> Float32:
    """Hair [N] as the surface has it on the whole, where photos do not show it for sure.

    Where photos end, they and the network see neither hair nor skin: a seam of skin would run
    through the hair, and streaks of hair over a neck.
    """
    sure = (2 * hair - 1) ** 2
    whole = graph.decided(hair, seen * sure + UNSURE * sure)
    firm = seen * sure
    return np.asarray(firm * hair + (1 - firm) * np.clip(3 * whole - 1, 0, 1), np.float32)


def _told_apart(plane: HeadPlane, colors: Float32, flat: Float32, seen: Float32, ears: Float32,
                hairy: NDArray[np.bool_], bare: NDArray[np.bool_], lowest: float,
                bearded: bool = False) -> Float32:
    """Hair around the face by its color, [N], from samples [N] of hair and of skin.

    ``lowest`` is how far it hangs below the brows, in units of the face's height upwards;
    ``bearded`` lets it be on chin and upper lip, too. Strands close over no ``ears`` [N].
    """
    around = around_face(plane, flat, lowest)
    if bearded:
        up = -flat[:, 1] / plane.height
        around |= (up < BEARD[0]) & (up > BEARD[1])
    chosen = (around | hairy | bare) & (seen > 0.5)
    # A neck in the shade is not of the face's color, but of the hair's even less.
    from_face = skin_distance(colors[chosen], bare[chosen], 1.0)
    from_hair = skin_distance(colors[chosen], hairy[chosen], 1.0)
    hair = np.zeros(len(colors), np.float32)
    hair[chosen] = 1 / (1 + np.exp(np.clip((from_hair - from_face) / 0.5, -30, 30)))
    hair[~around] = 0
    hair = with_strands(plane, flat, hair, around & (seen > 0.5) & (ears < 0.5))
    # What no photo saw goes on as it begins, and further on as hair goes on.
    unseen, parted = around & (seen <= 0.5), around & (seen > 0.5)
    beside = Cells.over(flat, 0.03 * plane.height).carried(3 * hair - 1.5, parted, 1.0, 20.0)
    hair[unseen] = np.clip(hair_by_place(plane, flat[unseen]) + beside[unseen], 0, 1)
    return np.asarray(hair, np.float32)


def _plausible(plane: HeadPlane, points: Float32, hair: Float32) -> bool:
    """Whether a good part of the head above the brows is hair: else it is shaven, or a statue.

    Where it is not known, ``hair`` is NaN.
    """
    above = (points[:, 1] > plane.origin[1]) & np.isfinite(hair)
    return bool(above.any() and hair[above].mean() > 0.2)


def _clothes(plane: HeadPlane, colors: Float32, points: Float32, flat: Float32, seen: Float32,
             depth: Float64, hair: Float32 | None) -> Float32:
    """What lies below the chin, is no hair, and is not of the color of the cheeks, [N].

    ``colors`` [N, 3] in [0, 1], ``points`` [N, 3] in the world and ``flat`` [N, 2] unwrapped;
    ``seen``, ``hair`` [N] in [0, 1]; ``depth`` [N] is 0 at the brows and 1 at the chin.
    """
    out = np.zeros(len(colors), np.float32)
    below = depth > 1.0
    face = (depth > 0.3) & (depth < 0.95) & (points[:, 2] > 0)
    face &= np.abs(points[:, 0]) < np.ptp(points[face, 0]) * 0.25 if face.any() else face
    chosen = below | face
    away = skin_distance(colors[chosen], face[chosen])
    out[chosen] = 1 / (1 + np.exp(np.clip((3.5 - away) / 0.5, -30, 30)))
    # Of what no photo saw, as below a chin, colors say little: it is as what is around.
    known, unseen = below & (seen > 0.5), below & (seen <= 0.5)
    around = Cells.over(flat, 0.03 * plane.height).carried(4 * out - 2, known, 1.0, 20.0)
    out[unseen] = np.clip(out[unseen] + around[unseen], 0, 1)
    out *= np.clip((depth - 1.0) / 0.15, 0, 1).astype(np.float32)
    return out if hair is None else out * (1 - hair)


def _facing(points: Float32, normals: Float32, cameras: Camera | None) -> Float32:
    """Cosine at which the best of the cameras saw each place, by the large shape alone, [N]."""
    if cameras is None or not len(cameras):
        return np.ones(len(points), np.float32)
    out = np.empty(len(points), np.float32)
    best_facing(points, normals, cameras.position[::max(1, len(cameras) // 40)], out)
    return out


def _ramp(values: Float32, ends: tuple[float, float]) -> Float32:
    """0 up to the first of the ends, 1 from the second on, float32 [N]."""
    return np.asarray(np.clip((values - ends[0]) / (ends[1] - ends[0]), 0, 1), np.float32)
