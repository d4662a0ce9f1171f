"""Let a bust that the photos cut off end in paint: a vignette.

Photos end somewhere below the chest, often at a shoulder, too, and a bust that was made of them
ends there in a straight cut. Painters let a bust end in strokes that thin out until the bare ground
is left. So does this: the densities of a field fall off towards each cut, along strokes.

What is a cut shows in the photos: a little beyond the end of the field they end themselves, or show
more of the person. Where they show the ground there instead, a bust ends by itself and stays as it
is. Nothing above the throat changes, and no color.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..capture import Camera, Capture
from ..field import VoxelField

__all__ = ["End", "cut_ends", "vignetted"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

OPAQUE = 8.0
"""Density from which on a point is surface."""
SAMPLES, BINS = 40_000, 72
"""Points that are looked at, at most; directions about an end's middle."""
STUB = 0.3
"""Faces' heights from a side's end up to which it is looked at."""
BEYOND = 0.12
"""Faces' heights beyond an end at which photos are asked what they show."""
CUT, MOST = 0.5, 0.5
"""Share of the photos that do not see a place's end, and of such places, in a cut."""
VIEWS = 24
"""Photos that are asked, at most."""
BELOW, BESIDE = 0.75, 0.55
"""Width of a vignette, in faces' heights, at the lower end and at the sides."""
REST = 0.7
"""It takes at most this part of what lies between a cut and the chin or the cheek."""
THROAT = 0.45, 0.1
"""Faces' heights below the chin from which on it has its full width, and where it begins."""
BEHIND = 0.5
"""The far side ends by so much of the width earlier: it is not seen between the strokes."""
STROKE = 0.4, 0.055
"""Length and width of a stroke in faces' heights."""
BRISTLE = 0.3
"""Width of a bristle's trace over that of a stroke."""
SLANT = 0.55
"""How far strokes lean: sideways over upwards."""
SOFT = 0.16
"""Softness of a stroke's edge, as part of the way from bare ground to paint."""
NOISE = 64
"""Edge of the lattice of random numbers."""
SHEET = 9
"""Lattice points, along each axis, in which a surface's thickness is measured."""


@dataclass(frozen=True)
class End:
    """A cut of a bust, and the width of the vignette at it.

    Attributes
    ----------
    name
        ``"below"``, ``"left"`` or ``"right"``, as seen from the front.
    normal, height
        Its plane: the bust lies where ``points @ normal > height``.
    width
        World units.
    """

    name: str
    normal: Float64
    height: float
    width: float


def vignetted(field: VoxelField, capture: Capture, seed: int = 0,
              ) -> tuple[VoxelField, dict[str, Any]]:
    """A field whose cuts end in strokes.

    Parameters
    ----------
    field
        In the portrait frame.
    capture
        What it was reconstructed from, with landmarks.
    seed
        Of the strokes.

    Returns
    -------
    field, figures
        With the same lattice points and colors and other densities; the same field where nothing
        is cut. ``ends`` names the cuts.
    """
    found = cut_ends(field, capture)
    figures = {"ends": [end.name for end in found]}
    if not found:
        return field, figures
    assert capture.landmarks is not None
    chin, tall = _face(capture.landmarks)
    points = field.lattice_points()
    low = points[:, 1] < chin - THROAT[1] * tall
    low &= np.min([points @ end.normal - end.height - end.width for end in found], axis=0) < (
        BEHIND * max(end.width for end in found))
    rows = np.flatnonzero(low)
    opacity = _opacity(points[rows], found, chin, tall, seed)
    changed = opacity < 0.995
    rows, opacity = rows[changed], opacity[changed]
    density = field.density.copy()
    wanted = -np.log1p(-opacity)
    density[rows] *= np.minimum(1.0, wanted / np.maximum(_thickness(field, rows), 1e-6))
    return replace(field, density=density), figures


def cut_ends(field: VoxelField, capture: Capture) -> list[End]:
    """Where a bust is cut off, below and at its sides.

    Parameters
    ----------
    field, capture
        As for `vignetted`.
    """
    if capture.landmarks is None:
        return []
    chin, tall = _face(capture.landmarks)
    points = field.lattice_points()[field.density > OPAQUE]
    points = points[points[:, 1] < chin - THROAT[1] * tall]
    if not np.isfinite(tall) or len(points) < 20 * BINS:
        return []
    points = points[:: max(1, len(points) // SAMPLES)]
    seen = capture.training()
    seen = seen[:: max(1, len(seen) // VIEWS)]
    face = np.asarray(capture.landmarks, np.float64)
    face = face[np.isfinite(face).all(axis=1)]
    ends = []
    for name, outward in (("below", (0, -1, 0)), ("left", (-1, 0, 0)), ("right", (1, 0, 0))):
        out = np.array(outward, np.float64)
        along = points @ out
        near = points if name == "below" else points[along > along.max() - STUB * tall]
        if name != "below" and along.max() < (face @ out).max() + 0.2 * tall:
            continue
        tips = _tips(near, out)
        cut = _cut(tips, out, BEYOND * tall, capture, seen)
        if len(tips) < BINS // 6 or cut.mean() < MOST:
            continue
        normal, height = _plane(tips[cut], out)
        room = float((face @ normal - height).min()) * REST
        width = min((BELOW if name == "below" else BESIDE) * tall, room)
        if width > 0.1 * tall:
            ends.append(End(name, normal, height, width))
    return ends


def _face(landmarks: NDArray[np.floating]) -> tuple[float, float]:
    """Height of the chin, and of the face from there to the brows."""
    chin = float(landmarks[8, 1])
    return chin, float(landmarks[17:27, 1].mean()) - chin


def _tips(points: Float64, out: Float64) -> Float64:
    """The outermost point in each direction about the middle of what ends, [K, 3]."""
    flat = points[:, out == 0]
    flat = flat - np.median(flat, axis=0)
    side = ((np.arctan2(flat[:, 1], flat[:, 0]) / (2 * np.pi) + 0.5) * BINS).astype(int) % BINS
    order = np.lexsort((points @ out, side))
    last = np.flatnonzero(np.diff(side[order], append=-1))
    return np.asarray(points[order[last]], np.float64)


def _cut(tips: Float64, out: Float64, beyond: float, capture: Capture,
         views: NDArray[np.int64]) -> Bools:
    """Whether the photos that look at each of points [K, 3] do not see the person end there."""
    cameras: Camera = capture.cameras[views]
    middle = np.median(tips, axis=0)
    facing = ((tips - middle)[None] * (cameras.position - middle)[:, None]).sum(axis=2) > 0
    pixels, depth = cameras.project(tips + beyond * out)
    asked = facing & (depth > 0)
    missed = np.zeros(asked.shape, bool)
    for row, view in enumerate(views):
        x, y = np.floor(np.clip(pixels[row].T, -1, 1e6)).astype(int)
        width, height = int(cameras.width[row]), int(cameras.height[row])
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        missed[row] = ~inside
        if capture.alphas is not None:
            matte = capture.alphas[int(view)]
            missed[row, inside] = matte[y[inside], x[inside]] > 127
    count = asked.sum(axis=0)
    return np.asarray((missed & asked).sum(axis=0) > CUT * np.maximum(count, 1))


def _plane(tips: Float64, out: Float64) -> tuple[Float64, float]:
    """A plane through points [K, 3], by their median deviation: normal inwards, and height."""
    flat, along = tips[:, out == 0], -(tips @ out)
    design = np.column_stack([flat, np.ones(len(flat))])
    weights, found = np.ones(len(flat)), np.zeros(3)
    for _ in range(12):
        scaled = design * weights[:, None]
        hold = np.diag([0.05 * weights.sum(), 0.05 * weights.sum(), 0.0])
        found = np.linalg.solve(scaled.T @ design + hold, scaled.T @ along)
        weights = 1.0 / np.maximum(np.abs(along - design @ found), 1e-3)
    normal = -out.copy()
    normal[out == 0] = -found[:2]
    length = float(np.linalg.norm(normal))
    return normal / length, float(found[2]) / length


def _opacity(points: Float64, ends: list[End], chin: float, tall: float, seed: int) -> Float64:
    """Opacity that is left of a surface at points [N, 3], [N] in [0, 1]."""
    share = np.ones(len(points))
    middle = float(np.median(points[:, 2]))
    back = np.clip((middle - points[:, 2]) / (0.35 * tall), 0, 1)
    for end in ends:
        away = (points @ end.normal - end.height) / end.width - BEHIND * back
        # Rounded where two cuts meet.
        share *= _smooth(away)
    throat = _smooth((chin - points[:, 1] - THROAT[1] * tall) / ((THROAT[0] - THROAT[1]) * tall))
    share = 1 - throat * (1 - share)
    grain = _strokes(points / tall, seed)
    return np.asarray(_smooth((share * (1 + 2 * SOFT) - SOFT - grain) / (2 * SOFT) + 0.5))


def _smooth(share: NDArray[np.floating]) -> Float64:
    """A smooth step from 0 to 1."""
    share = np.clip(share, 0, 1)
    return np.asarray(share * share * (3 - 2 * share), np.float64)


def _strokes(points: Float64, seed: int) -> Float64:
    """How soon strokes give out at points [N, 3], in faces' heights: [N], even in [0, 1]."""
    random = np.random.Generator(np.random.Philox(key=[58, seed]))
    noise = ndimage.gaussian_filter(random.standard_normal((NOISE,) * 3).astype(np.float32), 0.9,
                                    mode="wrap")
    noise /= noise.std()

    def at(scale: tuple[float, float, float], shift: float = 0.0) -> Float64:
        place = (lean / np.array(scale)).T * 2.0 + 17.0 * shift
        return np.asarray(ndimage.map_coordinates(noise, place, order=1, mode="grid-wrap"),
                          np.float64)

    length, width = STROKE
    lean = points.copy()
    broad = at((0.6, 0.6, 0.6))
    lean[:, 0] += SLANT * points[:, 1] + 0.05 * broad
    lean[:, 1] -= SLANT * points[:, 0]
    fine = BRISTLE * width
    total = (0.55 * broad + 0.9 * at((width, length, width), 1) + 0.45 * at((fine, length, fine), 2))
    order = np.empty(len(total))
    order[np.argsort(total, kind="stable")] = (np.arange(len(total)) + 0.5) / max(len(total), 1)
    return order


def _thickness(field: VoxelField, rows: NDArray[np.int64]) -> Float32:
    """Optical thickness of the surface around lattice rows, [K]."""
    asked = np.zeros(len(field.density), bool)
    asked[rows] = True
    filled = field.links >= 0
    place = np.zeros(filled.shape, bool)
    place[filled] = asked[field.links[filled]]
    box = ndimage.find_objects(place.astype(np.uint8))[0]
    box = tuple(slice(max(0, one.start - SHEET), one.stop + SHEET) for one in box)
    links = field.links[box]
    dense = np.where(links >= 0, np.maximum(field.density, 0)[links], np.float32(0))
    mean = ndimage.uniform_filter(dense, SHEET, mode="constant")
    out = np.zeros(len(field.density), np.float32)
    out[links[links >= 0]] = mean[links >= 0]
    return np.asarray(out[rows] * np.float32(SHEET * field.spacing.mean()), np.float32)
