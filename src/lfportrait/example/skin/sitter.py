"""The skin of a sitter: the head's visible surface with all that painting it needs.

A `Skin` is computed once from a field and its landmarks, and kept beside the field; it knows
nothing of any exemplar. Besides the atlas (`charts`) it holds, for every pixel that owns its
surface point, what the sitter shows there: light and shade, detail, `hair`, clothes (what lies
below the chin and differs in color from the face), `ears`, and how well the photos saw it.

Its soft regions are what `lfportrait restyle --region` and `--keep` name. Features are drawn from
the landmarks as the front sees them; hair, ears and clothes are the skin's own; the neck is what
lies below the jaw and is neither.

A `Canvas` is the atlas at a painting's resolution, with the lists that it shows. A preview paints
every second pixel: it needs a quarter of the lists.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...arrays import Bool, Float32, Float64, Int32, UInt8
from ...capture import Camera
from ...field import SurfaceGraph, VoxelField
from ...labels import FEATURES, PICTURE_LABELS, SURFACE_LABELS
from ...simd.threads import side_by_side
from ..exemplar import face_size
from ..guides.filters import broad_blur, grey, skin_distance
from ..guides.regions import FaceFrame, region_labels
from ..kernels.atlas import best_facing, exchange, spread
from ..kernels.patches import ACTIVE, FOREIGN, OUTSIDE
from ..painter.light import Cells
from ..painter.materials import BLUR, contours
from ..patches import at_middles, coarser_owner
from ..surface_guide import HeadPlane
from .charts import Atlas, draw_atlas
from .ears import ear_places
from .hair import (
    GRAPH,
    clothes_of_head,
    hair_behind,
    hair_by_color,
    hair_by_place,
    hair_by_relief,
    hair_of_head,
    network_hair,
    plausible_hair,
    settled_hair,
    without_bare_ears,
)

SIDE = 512  # Side in pixels of the picture that the features are drawn in.
RAISED, SIDES = 0.6, (0.42, 0.50)
"""Shoulders beside the head reach higher than the chin by so much; farther to the side than ears,
in portrait units."""
COLLAR = 1.4
"""Down to here (brows 0, chin 1) a chin throws its shade; what is worn there goes on below."""


def skin_regions(plane: HeadPlane, camera: Camera, points: Float32, normals: Float32, flat: Float32,
                 hair: Float32 | None, ears: Float32, clothes: Float32) -> UInt8:
    """Soft labels of a skin's places, uint8 [N, R] by `SURFACE_LABELS`.

    Of places and the large shape's normals there, float32 [N, 3], and unwrapped, [N, 2]; ``camera``
    sees the face from the front. ``hair`` (None: by place), ``ears`` and ``clothes`` are float32
    [N] in [0, 1].
    """
    features = _features(plane, camera, points, normals)
    hair = hair_by_place(plane, flat) if hair is None else hair
    depth = flat[:, 1] / np.float32(plane.height)
    # Behind the cheeks the jaw ends higher.
    angle = np.abs(flat[:, 0]) / np.float32(plane.radius)
    jaw = np.where(angle > 1.2, np.float32(0.75), np.float32(1.0))
    neck = np.clip((depth - jaw) / np.float32(0.1), 0, 1)
    out = np.zeros((len(points), len(SURFACE_LABELS)), np.float32)
    rest = np.ones(len(points), np.float32)
    for name, share in (*((name, features[:, n]) for n, name in enumerate(FEATURES)),
                        ("clothes", clothes), ("ears", ears * (1 - hair)), ("hair", hair),
                        ("neck", neck)):
        out[:, SURFACE_LABELS.index(name)] = rest * share
        rest = rest * (1 - share)
    out[:, SURFACE_LABELS.index("skin")] = rest
    return np.asarray(out * 255 + 0.5, np.uint8)


def _features(plane: HeadPlane, camera: Camera, points: Float32, normals: Float32) -> Float32:
    """Brows, eyes, nose and lips at points on the front, float32 [N, 4]."""
    marks = plane.landmarks.copy()
    marks[~plane.known] = marks[plane.known].mean(axis=0)
    pixels, _ = camera.project(marks)
    low, high = pixels[0].min(axis=0), pixels[0].max(axis=0)
    scale = 0.8 * SIDE / float((high - low).max())
    shift = SIDE / 2 - scale * (low + high) / 2
    drawn = pixels[0] * scale + shift
    flat = np.ones((SIDE, SIDE), np.float32)
    labels = region_labels(flat, None, drawn, FaceFrame.of(drawn))
    places, _ = camera.project(points.astype(np.float64))
    x, y = np.moveaxis((places[0] * scale + shift).astype(np.int64), -1, 0)
    inside = (x >= 0) & (y >= 0) & (x < SIDE) & (y < SIDE) & (normals[:, 2] > 0)
    inside &= points[:, 2] > float(np.nanmin(plane.landmarks[:, 2]))
    out = np.zeros((len(points), len(FEATURES)), np.float32)
    chosen = labels[y[inside], x[inside]][:, [PICTURE_LABELS.index(name) for name in FEATURES]]
    out[inside] = chosen / np.float32(255)
    return out


BEFORE, BEHIND, SOFT = 2.5, 7.0, 6.0
"""Lattice points up to so many voxels before a chart's surface, and under it, take its color; and
those that no chart has then, up to so many before it: a soft shell is seen before its surface."""

T = TypeVar("T")

SKIN_PIXELS = 384.0
"""Pixels of the charts per world unit: a head is about 600 high, as in most exemplars."""

SEEN, CLEAR = (0.1, 0.4), (0.35, 0.75)
"""Cosines to the best photo between which a place begins to be seen and is, and its detail does."""

_PIECE = 1 << 15
"""Places that are unwrapped at a time: what is computed of them stays in a core's cache."""


@dataclass(frozen=True)
class Skin:
    """The visible surface of one head: an atlas, and lists over the N pixels that own a point.

    Attributes
    ----------
    atlas : Charts side by side, [H, W].
    plane : The unwrapping of the head by its landmarks.
    pixels : Pixels of the charts per world unit.
    index : int32 [N], flat index in the atlas of each owning pixel.
    tone, detail, appearance : float32 [N]: luma blurred (`BLUR`); what that leaves out; the same
        without the photo's grain. The latter two are weaker where photos saw a place at a graze
        (`CLEAR`).
    contours : float32 [N] in [0, 1]: photo edge strength (edges, patterns) at a place.
    hair : float32 [N] in [0, 1], or None where it could not be found.
    clothes, ears : float32 [N] in [0, 1]; clothes are what lies below the chin and is not of the
        face's color.
    seen : float32 [N] in [0, 1]: how frontally the best photo saw a place; 1 where no cameras
        are known.
    outwards : bool [N], False where the large shape faces backwards: there is no face, and where
        a field is open at the back one looks at its inside.
    rows : float32 [R, 2], places in the atlas of the field's R lattice rows; NaN where no chart
        shows them.
    kept : What paintings share, by what it is (`cached`).
    """

    atlas: Atlas
    plane: HeadPlane
    pixels: float
    index: Int32
    tone: Float32
    detail: Float32
    appearance: Float32
    contours: Float32
    hair: Float32 | None
    clothes: Float32
    ears: Float32
    seen: Float32
    outwards: Bool
    rows: Float32
    kept: dict[Hashable, Any] = dataclass_field(default_factory=dict, repr=False, compare=False)

    @staticmethod
    def of(field: VoxelField, landmarks: NDArray[np.floating], cameras: Camera | None = None,
           pixels: float = SKIN_PIXELS, networks: bool = True) -> Skin:
        """The skin of a field.

        Parameters
        ----------
        field : In the portrait frame.
        landmarks : float64 [68, 3].
        cameras : Of the photos, to know which places they saw.
        pixels : Pixels of the charts per world unit.
        networks : Ask the segmentation network for hair, where its weights are at hand.

        Raises
        ------
        UserError : If the field shows no surface, or fewer than 20 landmarks are known.
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
        tone, detail, appearance, contours = _looks(atlas, index, _unit(plane) * pixels)
        ears = ear_places(plane, points, flat)
        hair = hair_of_head(field, points, normals)
        if hair is None:
            known = network_hair(atlas, index) if networks else None
            hair = _found_hair(plane, points, colors, flat, seen, ears, contours, known)
        depth = _depth(plane, points, field.hair is not None)
        clothes = clothes_of_head(field, points, normals)
        if clothes is None:
            clothes = _clothes(plane, colors, points, flat, seen, depth, hair)
        elif hair is not None:
            clothes = clothes * (1 - hair)
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
    def slots(self) -> Int32:
        """Number in the lists of each pixel's owner, int32 [H, W]; -1 where there is none."""
        return self.slots_of(self.atlas.owner)

    def slots_of(self, owner: Int32) -> Int32:
        """Numbers in the lists of owners, int32 of their shape; -1 where there is none."""
        return self._numbers[owner]

    @functools.cached_property
    def _numbers(self) -> Int32:
        """Number in the lists of each pixel of the atlas; the last one stands for no owner (-1)."""
        number = np.full(self.atlas.owner.size + 1, -1, np.int32)
        number[self.index] = np.arange(len(self.index), dtype=np.int32)
        return number

    def cached(self, key: Hashable, make: Callable[[], T]) -> T:
        """What is kept under ``key``; made if there is nothing yet."""
        if key not in self.kept:
            self.kept[key] = make()
        found: T = self.kept[key]
        return found

    @property
    def labels(self) -> tuple[UInt8, tuple[str, ...]]:
        """Soft regions of the owning pixels, uint8 [N, R], and the regions' names."""
        return self.cached("labels", self._labels)

    def _labels(self) -> tuple[UInt8, tuple[str, ...]]:
        points = self.atlas.points.reshape(-1, 3)[self.index]
        return skin_regions(self.plane, self.atlas.cameras[0], points, self.atlas.shape.at(points),
                            self.flat, self.hair, self.ears, self.clothes), SURFACE_LABELS

    @property
    def face(self) -> float:
        """Size of the face (`face_size` of the unwrapped landmarks) in pixels of the charts."""
        return _unit(self.plane) * self.pixels


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


def _looks(atlas: Atlas, index: Int32, size: float) -> tuple[Float32, Float32, Float32, Float32]:
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


def _found_hair(plane: HeadPlane, points: Float32, colors: Float32, flat: Float32, seen: Float32,
                ears: Float32, contours: Float32, known: Float32 | None) -> Float32 | None:
    """Hair [N] of a field that does not know it, by the network's ``known`` [N] or by its looks."""
    if known is not None and plausible_hair(plane, points, known * seen):
        hair: Float32 | None = hair_behind(plane, colors, flat, seen, ears, known)
    else:
        hair = hair_by_color(plane, colors, flat, seen, ears)
        if hair is None:
            hair = hair_by_relief(plane, flat, contours, seen, ears)
        if hair is None and known is not None and not (known > 0).any():
            return np.zeros(len(points), np.float32)  # a bald head
    if hair is None or seen.min() >= 1:
        return hair
    hair = settled_hair(SurfaceGraph.over(points, colors, GRAPH * plane.height), hair, seen)
    return without_bare_ears(plane, points, colors, flat, seen, ears, hair)


def _depth(plane: HeadPlane, points: Float32, shoulders: bool) -> Float64:
    """How far down points [N, 3] lie: 0 at the brows, 1 at the chin, [N].

    ``shoulders`` : Whether what is beside the ears is one; else it may be hair.
    """
    depth = (plane.origin[1] - points[:, 1]) / plane.height
    if shoulders:
        depth = depth + RAISED * _ramp(np.abs(points[:, 0]), SIDES)
    return np.asarray(depth, np.float64)


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
    out[chosen] = _unlike_skin(colors[chosen], face[chosen])
    cells = Cells.over(flat, 0.03 * plane.height)
    out = _without_shade(out, colors, face, depth, cells)
    # Of what no photo saw, as below a chin, colors say little: it is as what is around.
    known, unseen = below & (seen > 0.5), below & (seen <= 0.5)
    around = cells.extrapolated(4 * out - 2, known, 1.0, 20.0)
    out[unseen] = np.clip(out[unseen] + around[unseen], 0, 1)
    out *= np.clip((depth - 1.0) / 0.15, 0, 1).astype(np.float32)
    return out if hair is None else out * (1 - hair)


def _unlike_skin(colors: Float32, face: Bool) -> Float32:
    """How far colors [N, 3] are none of those of a face, bool [N], float32 [N] in [0, 1]."""
    away = skin_distance(colors, face)
    return np.asarray(1 / (1 + np.exp(np.clip((3.5 - away) / 0.5, -30, 30))), np.float32)


def _without_shade(clothes: Float32, colors: Float32, face: Bool, depth: Float64, cells: Cells,
                   ) -> Float32:
    """Clothes [N] without the shade below a chin.

    Shade has the skin's hue. A brown collar has, too, but it hangs together with what is worn
    further down.
    """
    asked = np.flatnonzero((clothes > 0.05) & (depth < COLLAR) & (depth > 1.0))
    if not face.any() or not len(asked):
        return clothes
    further_down = (clothes > 0.5) & (depth > COLLAR)
    if not further_down.any():
        return clothes
    worn = cells.joined(clothes, further_down)[asked]
    luma = grey(colors[None])[0]
    gain = np.maximum(float(np.median(luma[face])) / np.maximum(luma[asked], 1e-3), 1)
    some = np.flatnonzero(face)[::max(1, int(face.sum()) // 20000)]
    lit = np.concatenate([colors[asked] * gain[:, None], colors[some]])
    hue = _unlike_skin(lit, np.arange(len(lit)) >= len(asked))[:len(asked)]
    out = clothes.copy()
    out[asked] = np.minimum(clothes[asked], np.maximum(hue, worn))
    return out


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


_LISTS = ("index", "tone", "detail", "appearance", "contours", "hair", "clothes", "ears",
          "seen", "outwards")


@dataclass
class Canvas:
    """The atlas at the painting's resolution: owners, and where the skin's lists go."""

    step: int
    owner: Int32
    slots: Int32
    surface: Bool

    @staticmethod
    def of(skin: Skin, step: int) -> Canvas:
        """Every ``step``-th pixel (a power of two) of the atlas."""
        atlas = skin.atlas
        level = step.bit_length() - 1
        shape = atlas.depth.shape[0] // step, atlas.depth.shape[1] // step
        if step == 1:
            return Canvas(1, atlas.owner, skin.slots, np.isfinite(atlas.depth))
        owner = coarser_owner(atlas.owner, level, shape)
        # An owner shows what its middle shows, even if that is another's.
        slots = skin.slots_of(at_middles(atlas.owner, level, shape)).reshape(-1)
        filled = np.where(owner >= 0, slots[np.maximum(owner, 0)], -1)
        return Canvas(step, owner, np.ascontiguousarray(filled.reshape(shape)),
                       np.isfinite(at_middles(atlas.depth, level, shape)))

    @functools.cached_property
    def own(self) -> Bool:
        """Pixels that own their surface point, bool [H, W]."""
        index = np.arange(self.owner.size, dtype=np.int32).reshape(self.owner.shape)
        return np.asarray((self.owner == index) & (self.slots >= 0))

    def states(self, painted: Bool) -> UInt8:
        """What patches do with each pixel if places are ``painted``, bool [N]; uint8 [H, W].

        `ACTIVE` for owners, `FOREIGN` for others' copies, and `OUTSIDE`.
        """
        covered = np.append(painted, False)[self.slots]
        state = np.full(self.slots.shape, OUTSIDE, np.uint8)
        state[self.surface & (self.slots >= 0) & covered] = FOREIGN
        state[self.own & covered] = ACTIVE
        return state

    def spread(self, values: Float32, empty: float = 0.0) -> Float32:
        """Values [N, C] of a skin's lists as a picture [H, W, C]."""
        out = np.empty((*self.slots.shape, values.shape[1]), np.float32)
        spread(np.ascontiguousarray(values, np.float32), self.slots, np.float32(empty), out)
        return out

    def gathered(self, picture: Float32, count: int, empty: float = 0.0) -> Float32:
        """What owners show of a picture [H, W], for each of ``count`` places of the lists, [N]."""
        own = self.own
        out = np.full(count, empty, np.float32)
        out[self.slots[own]] = picture[own]
        return out


def canvas_of(skin: Skin, step: int) -> tuple[Canvas, Skin]:
    """The canvas at every ``step``-th pixel, and the skin with the lists that it shows alone.

    Both are made once and kept with the skin.
    """
    return skin.cached(("canvas", step), lambda: _canvas_of(skin, step))


def _canvas_of(skin: Skin, step: int) -> tuple[Canvas, Skin]:
    canvas = Canvas.of(skin, step)
    if step == 1:
        return canvas, skin
    shown = np.zeros(len(skin.index) + 1, bool)
    shown[canvas.slots] = True
    used = np.flatnonzero(shown[:-1])  # the last one stands for none, -1
    number = np.full(len(skin.index) + 1, -1, np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    lists = {name: value[used] for name in _LISTS if (value := getattr(skin, name)) is not None}
    return (replace(canvas, slots=number[canvas.slots]), replace(skin, kept={}, **lists))
