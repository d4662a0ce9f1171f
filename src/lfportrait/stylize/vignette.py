"""Let a bust that the photos cut off end in paint: a vignette.

Photos end somewhere below the chest, often at a shoulder, too, and a bust that was made of them
ends there in a straight cut. Painters let a bust end in strokes that thin out until the bare ground
is left. So does this: the densities of a field fall off towards each cut, along strokes.

What is a cut, the photos tell: a little beyond the end of the field they end themselves, or show
more of the person. Where they show the ground there instead, a bust ends by itself and stays as it
is. Nothing above the throat changes, and no color.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, special

from ..arrays import Bool, Float32, Float64, Floats, Int32, Int64
from ..capture import Capture
from ..field import VoxelField, median_plane

OPAQUE = 8.0  # Density from which on a point is surface.
SAMPLES, BINS = 40_000, 72  # Points that are looked at, at most; directions about an end's middle.
STUB = 0.3  # Faces' heights from a side's end up to which it is looked at.
BEFORE, BEYOND = 0.35, 0.12
"""Faces' heights before an end at which photos must show it, and beyond it, where they are asked
what they show."""
ASLANT = 0.6
"""Cosine between the way out at an end and the way to a photo up to which that is asked."""
CUT, MOST = 0.5, 0.75
"""Share of the photos that do not see a place's end, and of such places, in a cut."""
VIEWS = 10  # Photos that are asked, at most.
BELOW, BESIDE = 0.68, 0.4
"""Width of a vignette, in faces' heights, at the lower end and at the sides."""
REST, LEAST = 0.6, 0.1
"""It takes at most this part of what lies between a cut and the face; the width, in faces' heights,
below which there is none."""
CLEAR = 0.2  # A side that reaches less far beyond the face, in faces' heights, is no shoulder.
THROAT = 0.45, 0.1
"""Faces' heights below the chin from which on it has its full effect, and where that begins."""
BARE = 0.2  # Part of the width, next to the cut, where nothing is left.
BEHIND, ROUND = 0.35, 0.35
"""The far side ends by so much of the width earlier, so that it is not seen between the strokes;
depth, in faces' heights, over which that comes to its full."""
STROKE = 0.5, 0.07  # Length and width of a stroke in faces' heights.
BRISTLE = 0.3  # Width of a bristle's trace over that of a stroke.
BROAD = 0.6  # Size in faces' heights of the places where strokes reach further or less far.
SHARES = 0.6, 0.7, 0.8  # What such places, strokes and bristles count.
SLANT, WAVE = 0.45, 0.05
"""How far strokes lean, sideways over upwards, and how far they are bent, in faces' heights."""
SOFT = 0.5  # Softness of a stroke's edge, as part of the way from bare ground to paint.
LAYERS = 0.6  # Of the optical thickness of one surface: rays often pass two, or one aslant.
NOISE, CELLS = 64, 2.0
"""Edge of the lattice of random numbers; its cells in the size of what they make."""
SHEET = 9  # Lattice points along each axis in which a surface's thickness is measured.


@dataclass(frozen=True)
class End:
    """A cut of a bust, and the width of the vignette at it."""

    name: str  # ``"below"``, ``"left"`` or ``"right"``, as seen from the front.
    # normal, height: Its plane: the bust lies where ``points @ normal > height``.
    normal: Float64
    height: float
    width: float  # World units.


def vignetted(field: VoxelField, capture: Capture, seed: int = 0) -> tuple[VoxelField, list[End]]:
    """A field in the portrait frame whose cuts end in strokes, and its cuts.

    It has the same lattice points and colors and other densities; it is the same field where
    nothing is cut, or the capture that it was reconstructed from has no landmarks.
    """
    if capture.landmarks is None:
        return field, []
    low = _Low.of(field, capture.landmarks)
    ends = _ends(low, capture)
    if not ends:
        return field, []
    away = np.min([low.points @ end.normal - end.height - end.width for end in ends], axis=0)
    near = np.flatnonzero(away < BEHIND * max(end.width for end in ends))
    opacity = _opacity(low.points[near], ends, low, seed)
    near, opacity = near[opacity < 0.995], opacity[opacity < 0.995]
    thick = _thickness(field, low)[near]
    # Crumbs are thin; they fade with the surface around them.
    thick = np.maximum(thick, max(float(np.median(thick)), 1e-6) if len(thick) else 1.0)
    density = field.density.copy()
    density[low.rows[near]] *= np.minimum(1.0, -LAYERS * np.log1p(-opacity) / thick)
    return replace(field, density=density), ends


@dataclass(frozen=True)
class _Low:
    """The part of a field below the chin."""

    links: Int32  # int32 [Z, Y, X], the lower part of the lattice.
    # rows, points: Lattice rows in it, int32 [N], and their places, float32 [N, 3].
    rows: Int32
    points: Float32
    solid: Bool  # bool [N], the surface.
    face: Float64  # float64 [L, 3], landmarks.
    # chin, tall: Height of the chin, and of the face from there to the brows.
    chin: float
    tall: float

    @staticmethod
    def of(field: VoxelField, landmarks: Floats) -> _Low:
        """That of a field with a face."""
        face = np.asarray(landmarks, np.float64)
        chin = float(face[8, 1])
        tall = float(face[17:27, 1].mean()) - chin
        size = np.array(field.links.shape[::-1], np.float64)
        scale, first = 2 * field.radius / size, field.center + field.radius * (1 / size - 1)
        top = (chin - THROAT[1] * tall - first[1]) / scale[1]
        links = field.links[:, :max(0, int(np.ceil(np.nan_to_num(top))))]
        z, y, x = np.nonzero(links >= 0)
        rows = links[z, y, x]
        points = np.empty((len(rows), 3), np.float32)
        for axis, place in enumerate((x, y, z)):
            points[:, axis] = place * scale[axis] + first[axis]
        return _Low(links, rows, points, field.density[rows] > OPAQUE,
                    face[np.isfinite(face).all(axis=1)], chin, tall)


def _ends(low: _Low, capture: Capture) -> list[End]:
    """The cuts of a bust."""
    points, tall = low.points[low.solid], low.tall
    if not np.isfinite(tall) or len(points) < 20 * BINS:
        return []
    points = points[:: max(1, len(points) // SAMPLES)].astype(np.float64)
    seen = capture.training()
    seen = seen[:: max(1, len(seen) // VIEWS)]
    ends = []
    for name, outward in (("below", (0, -1, 0)), ("left", (-1, 0, 0)), ("right", (1, 0, 0))):
        out, beside = np.array(outward, np.float64), name != "below"
        along = points @ out
        if beside and along.max() < (low.face @ out).max() + CLEAR * tall:
            continue
        ending = points[along > along.max() - STUB * tall] if beside else points
        tips = _tips(np.asarray(ending, np.float64), out)
        cut, asked = _cut(tips, out, tall, capture, seen)
        if asked.sum() < BINS // 6 or cut.sum() < MOST * asked.sum():
            continue
        normal, height = _plane(tips[cut], out)
        room = REST * float((low.face @ normal - height).min())
        width = min((BESIDE if beside else BELOW) * tall, room)
        if width > LEAST * tall:
            ends.append(End(name, normal, height, width))
    return ends


def _tips(points: Float64, out: Float64) -> Float64:
    """The outermost point in each direction about the middle of what ends, [K, 3]."""
    flat = points[:, out == 0]
    flat = flat - np.median(flat, axis=0)
    side = ((np.arctan2(flat[:, 1], flat[:, 0]) / (2 * np.pi) + 0.5) * BINS).astype(int) % BINS
    order = np.lexsort((points @ out, side))
    last = np.flatnonzero(np.diff(side[order], append=-1))
    return np.asarray(points[order[last]], np.float64)


def _cut(tips: Float64, out: Float64, tall: float, capture: Capture, views: Int64,
         ) -> tuple[Bool, Bool]:
    """Whether photos of points [K, 3] do not show the person's end there, and whether any can."""
    cameras = capture.cameras[views]
    middle = np.median(tips, axis=0)
    eyes = (cameras.position - middle)[:, None]
    facing = ((tips - middle)[None] * eyes).sum(axis=2) > 0
    # What lies beyond is seen beside the end, not before it.
    facing &= np.abs(eyes @ out) < ASLANT * np.linalg.norm(eyes, axis=2)
    # A photo that does not even show what comes before the end says nothing of it.
    asked = facing & cameras.shows(tips - BEFORE * tall * out)
    beyond = tips + BEYOND * tall * out
    missed = ~cameras.shows(beyond)
    pixels = cameras.project(beyond)[0]
    if capture.alphas is not None:
        for row, view in enumerate(views.tolist()):
            within = asked[row] & ~missed[row]
            if within.any():  # reading a matte may take a while
                x, y = pixels[row, within].astype(int).T
                missed[row, within] = capture.alphas[view][y, x] > 127
    count = asked.sum(axis=0)
    return np.asarray((missed & asked).sum(axis=0) > CUT * count), np.asarray(count > 0)


def _plane(tips: Float64, out: Float64) -> tuple[Float64, float]:
    """A plane through points [K, 3] by their median deviation: normal inwards, and height."""
    found = median_plane(tips[:, out == 0], -(tips @ out))
    normal = -out
    normal[out == 0] = -found[:2]
    length = float(np.linalg.norm(normal))
    return normal / length, float(found[2]) / length


def _opacity(points: Float32, ends: list[End], low: _Low, seed: int) -> Float64:
    """Opacity that is left of a surface at points [N, 3], [N] in [0, 1]."""
    share = np.ones(len(points))
    behind = np.clip((np.median(points[:, 2]) - points[:, 2]) / (ROUND * low.tall), 0, 1)
    for end in ends:
        away = (points @ end.normal - end.height) / end.width - BEHIND * behind
        # As a product: rounded where two cuts meet.
        share *= _smooth((away - BARE) / (1 - BARE))
    full, none = THROAT
    throat = _smooth(((low.chin - points[:, 1]) / low.tall - none) / (full - none))
    share = 1 - throat * (1 - share)
    ends_at = _strokes(points / np.float32(low.tall), seed)
    return _smooth((share * (1 + 2 * SOFT) - SOFT - ends_at) / (2 * SOFT) + 0.5)


def _smooth(share: Floats) -> Float64:
    """A smooth step from 0 to 1."""
    share = np.clip(share, 0, 1)
    return np.asarray(share * share * (3 - 2 * share), np.float64)


def _strokes(points: Float32, seed: int) -> Float64:
    """How soon strokes give out at points [N, 3], in faces' heights: [N], even in [0, 1].

    Solid noise, as a few octaves that are long along the strokes: it fits any surface.
    """
    random = np.random.Generator(np.random.Philox(key=[58, seed]))
    noise = ndimage.gaussian_filter(random.standard_normal((NOISE,) * 3).astype(np.float32), 0.9,
                                    mode="wrap")
    noise /= noise.std()
    lean = points.copy()

    def at(across: float, along: float, shift: float) -> Float64:
        place = lean.T * (CELLS / np.array([[across], [along], [across]])) + shift
        return np.asarray(ndimage.map_coordinates(noise, place, order=1, mode="grid-wrap"),
                          np.float64)

    broad = at(BROAD, BROAD, 0.0)
    lean[:, 0] += SLANT * points[:, 1] + WAVE * broad
    lean[:, 1] -= SLANT * points[:, 0]
    length, width = STROKE
    total = (SHARES[0] * broad + SHARES[1] * at(width, length, 17.0)
             + SHARES[2] * at(BRISTLE * width, length, 34.0))
    return np.asarray(special.ndtr(total / max(float(total.std()), 1e-9)), np.float64)


def _thickness(field: VoxelField, low: _Low) -> Float32:
    """Optical thickness of the surface around the lower part's rows, [N]."""
    dense = np.zeros(low.links.shape, np.float32)
    filled = low.links >= 0
    dense[filled] = np.maximum(field.density[low.rows], 0)
    # A sheet that crosses the window gives its density times its thickness, whatever these are.
    mean = ndimage.uniform_filter(dense, SHEET, mode="nearest")
    return np.asarray(mean[filled] * np.float32(SHEET * field.spacing.mean()), np.float32)
