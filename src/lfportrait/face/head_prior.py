"""A statistical head: a mean, modes of identity with their deviations, expressions, 68 landmarks.

One neutral form for heads of any origin. Where no statistical head is installed there is a generic
one (`generic_prior`), with a few hand-made modes: the generic bust
(`lfportrait.field.geometry.bust_distance`), drawn to places of a face by a plate over the chart of
its surface that bends as little as it can. The places have the proportions of an average adult:
breadths, heights and the arcs from the ears are means of both sexes as published (Farkas,
Anthropometry of the Head and Face, 1994), rounded; in between, cheeks, temples and forehead were
set by hand.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .. import models
from ..arrays import Float32, Float64, Int32, Int64, UInt8
from ..errors import UserError
from ..files import UNREADABLE_ARRAYS
from .landmarks import MIRRORED

FACE, HEAD, SOCKETS, EYES = range(4)
"""Parts of a head's vertices: face; skull, ears and neck; eye sockets; eyeballs."""
IDENTITIES = 48
"""Modes of identity that are used: four fifths of the variance of ICT-FaceKit's heads."""
NECK = -0.115
"""Height in metres, from the landmarks' level of ICT-FaceKit, below which its bust is left out:
shoulders differ too much from person to person, and from pose to pose."""
_LEAN = {
    0: (-2.4, -3.8, 0.0), 1: (-3.0, -8.6, 0.0), 2: (-2.5, -4.4, 0.0), 3: (-3.6, -9.8, 0.0),
    4: (-5.7, -10.2, 0.0), 5: (-5.1, -6.1, 0.0), 6: (-4.0, -1.0, 0.0), 7: (-2.6, 3.6, 0.0),
    8: (0.0, 3.3, 0.0), 17: (-2.5, 1.6, 0.3), 18: (-2.9, -1.9, -1.5), 19: (-0.7, -2.8, -3.1),
    20: (-1.8, -1.9, -4.3), 21: (-1.6, 0.8, -3.6), 27: (0.0, -1.4, -1.8), 28: (0.0, -0.1, -0.4),
    29: (0.0, 1.7, 2.2), 30: (0.0, 2.1, -2.5), 31: (0.5, -4.0, 3.8), 32: (-1.2, -1.6, 1.4),
    33: (0.0, -1.4, 1.7), 36: (-2.4, -1.3, 1.6), 37: (1.1, -1.3, 0.0), 38: (-0.2, -0.6, -1.3),
    39: (0.0, -2.5, 1.8), 40: (-0.9, 0.6, 0.3), 41: (0.5, 0.5, 0.6), 48: (-1.9, -0.3, -1.6),
    49: (-0.8, 0.5, -3.0), 50: (0.6, -2.1, -0.8), 51: (0.0, -1.1, -0.6), 55: (-0.8, 1.4, -2.4),
    56: (-2.6, 1.9, -0.9), 57: (0.0, 2.0, -0.8), 60: (-2.9, -0.3, -1.6), 61: (3.3, -1.4, 1.5),
    62: (0.0, -1.7, 1.7), 65: (-4.1, 0.0, 2.0), 66: (0.0, 0.0, 1.6),
}
"""Where detectors put landmarks, from where ICT-FaceKit's vertices for them are, in hundredths of
the distance of the outer corners of the eyes: along their line, across (down), and in depth (out of
the face), as triangulated from several sides, where a landmark slides over the surface. Of one of
each pair. Medians over 16 random heads of that model (6 for depth), drawn with brows, lips and
irises. Uncorrected, a nose's tip seen 2 mm too low tilts the whole head by five degrees.
"""
BELIEVED = 0.5  # Share of the lean in the picture that is corrected.
_USED = ("browDown_L", "browDown_R", "browInnerUp_L", "browInnerUp_R", "browOuterUp_L",
         "browOuterUp_R", "cheekPuff_L", "cheekPuff_R", "eyeBlink_L", "eyeBlink_R", "eyeWide_L",
         "eyeWide_R", "jawLeft", "jawRight", "jawOpen", "mouthClose", "mouthFrown_L",
         "mouthFrown_R", "mouthFunnel", "mouthPucker", "mouthSmile_L", "mouthSmile_R",
         "mouthStretch_L", "mouthStretch_R", "mouthUpperUp_L", "mouthUpperUp_R",
         "mouthLowerDown_L", "mouthLowerDown_R")
"""Expressions (ARKit's names) that 68 landmarks can tell apart."""


@dataclass(frozen=True)
class HeadPrior:
    """Heads as a mean and modes; metres, +x to the sitter's left, +y up, +z out of the face."""

    name: str  # Of the model.
    mean: Float32  # float32 [N, 3].
    # int32 [T, 3], a surface that is open at the neck alone; seen from outside, vertices run
    # counter-clockwise.
    triangles: Int32
    part: UInt8  # uint8 [N]: `FACE`, `HEAD`, `SOCKETS`, `EYES`.
    # int64 [68], vertices in iBUG order; the jaw's lie on the outline seen from the front.
    landmarks: Int64
    identity: Float32  # float32 [K, N, 3], one standard deviation each, the most important first.
    expression: Float32  # float32 [M, N, 3], full expressions.
    expressions: tuple[str, ...]  # Their names.
    # float64 [68, 3] or None: how far detectors put landmarks from these vertices, over the
    # distance of the outer corners of the eyes, along their line, across (down), and outwards.
    lean: Float64 | None = None

    @property
    def rest(self) -> Float64:
        """The mean, float64 [N, 3], from the height of the chin and the depth of the jaw's ends.

        There heads of any model are alike: the ears' upper ends lie some 12 cm high. Eyes and their
        sockets are drawn to the front, away from the skull behind them.
        """
        chin, ends = self.mean[self.landmarks[8]], self.mean[self.landmarks[[0, 16]]]
        origin = [0.0, float(chin[1]), float(ends[:, 2].mean())]
        out = self.mean.astype(np.float64) - origin
        within = np.isin(self.part, (SOCKETS, EYES))
        out[within, 2] = np.maximum(out[within, 2], 0.05)
        return out

    @property
    def outer(self) -> Int32:
        """The triangles [T, 3] of the surface that is seen: without sockets and the eyes' backs.

        Sockets and the backs of eyeballs lie a millimetre from other surfaces and look the other
        way: no distance from such a surface has a sure sign.
        """
        kinds = self.part[self.triangles]
        normals = with_normals(self.mean.astype(np.float64), self.triangles)
        behind = (self.part == EYES) & (normals[:, 2] < 0.1)
        hidden = (kinds == SOCKETS).any(axis=1) | behind[self.triangles].any(axis=1)
        return np.ascontiguousarray(self.triangles[~hidden])

    def vertices_seen(self, landmarks: Float64) -> Float64:
        """Where the vertices lie whose landmarks detectors put at [68, 2] pixels."""
        return landmarks if self.lean is None else landmarks - _turned(self.lean[:, :2], landmarks)

    def shape(self, identity: Float64, expression: Float64) -> Float64:
        """Vertices float64 [N, 3] for coefficients [K] in deviations and [M] from 0 to 1.

        Fewer coefficients than there are modes leave the others at zero.
        """
        out = self.mean.astype(np.float64)
        for modes, values in ((self.identity, identity), (self.expression, expression)):
            values = np.asarray(values, np.float32)
            if len(values):
                out += (values @ modes[:len(values)].reshape(len(values), -1)).reshape(-1, 3)
        return out


def _turned(lean: Float64, landmarks: Float64) -> Float64:
    """Offsets [68, 2] in pixels, turned with the eyes of landmarks [68, 2]."""
    x, y = landmarks[45] - landmarks[36]
    return np.asarray(lean @ np.array([[x, y], [-y, x]]), np.float64)


def _lean() -> Float64:
    """`_LEAN` of all landmarks, [68, 3], as shares."""
    out = np.zeros((68, 3))
    for number, (along, across, outwards) in _LEAN.items():
        out[MIRRORED[number]] = -along, across, outwards
        out[number] = along, across, outwards
    # On photos detectors lean less than on drawn heads.
    return 0.01 * out * [BELIEVED, BELIEVED, 1.0]


def head_prior() -> HeadPrior:
    """The statistical head that is installed, else the generic one."""
    if models.available("head"):
        return _read(str(models.fetch("head")))
    return generic_prior()


@functools.lru_cache(1)
def _read(path: str) -> HeadPrior:
    return read_ict(Path(path))


def read_ict(path: Path) -> HeadPrior:
    """Read ICT-FaceKit Light (MIT licence, USC Institute for Creative Technologies), repacked.

    ``.npz``: ``mean`` float32 [N, 3] in centimetres, ``triangles``, ``part``, ``landmarks68``;
    ``identity`` and ``expression`` int16 with a float32 scale a mode, ``expression_names``. Raises
    `UserError` if the file is damaged or another.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            mean = data["mean"] * np.float32(0.01)
            names = [str(name) for name in data["expression_names"]]
            used = [names.index(name) for name in _USED]

            def modes(kind: str, which: list[int]) -> Float32:
                scale = 0.01 * data[f"{kind}_scale"][which]
                return np.asarray(data[kind][which] * scale[:, None, None], np.float32)

            head = HeadPrior(
                "ICT-FaceKit Light", mean, data["triangles"].astype(np.int32), data["part"],
                data["landmarks68"].astype(np.int64),
                modes("identity", list(range(min(IDENTITIES, len(data["identity"]))))),
                modes("expression", used), _USED, _lean())
    except (*UNREADABLE_ARRAYS, KeyError, ValueError, OSError) as error:
        raise UserError(f"{path} is not the repacked ICT-FaceKit Light, or it is damaged: "
                        f"{error}") from error
    return _closed(_without_bust(head, NECK))


def _without_bust(head: HeadPrior, lowest: float) -> HeadPrior:
    """The head without the triangles below a height; vertices that are not used any more go."""
    kept = head.triangles[(head.mean[head.triangles, 1] > lowest).all(axis=1)]
    used = np.zeros(len(head.mean), bool)
    used[kept] = True
    number = np.cumsum(used) - 1
    return replace(head, mean=head.mean[used], triangles=number[kept].astype(np.int32),
                   part=head.part[used], landmarks=number[head.landmarks],
                   identity=head.identity[:, used], expression=head.expression[:, used])


def _closed(head: HeadPrior) -> HeadPrior:
    """The head with a fan over the mouth, which lies a little deeper; the neck stays open."""
    mean, part = head.mean, head.part
    identity, expression, fans = head.identity, head.expression, []
    for loop in _holes(head.triangles):
        if mean[loop, 1].mean() < NECK + 0.02:
            continue
        middle = len(mean)
        mean = np.concatenate([mean, mean[loop].mean(axis=0, keepdims=True)])
        mean[middle, 2] -= 0.008  # teeth lie behind the lips
        part = np.append(part, part[loop[0]])
        identity, expression = (
            np.concatenate([modes, modes[:, loop].mean(axis=1, keepdims=True)], axis=1)
            for modes in (identity, expression))
        fans.append(np.stack([np.full(len(loop), middle), np.roll(loop, -1), loop], axis=1))
    # In one piece: shapes are sums over all modes.
    return replace(head, mean=mean, part=part, identity=np.ascontiguousarray(identity),
                   triangles=np.concatenate([head.triangles, *fans]).astype(np.int32),
                   expression=np.ascontiguousarray(expression))


def _holes(triangles: Int32) -> list[Int64]:
    """The open edges of a mesh as loops of vertices, along the triangles' own direction."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    count = int(triangles.max()) + 1
    numbers, turned = (np.asarray(a, np.int64) * count + b for a, b in (edges.T, edges.T[::-1]))
    after = {int(a): int(b) for a, b in edges[~np.isin(numbers, turned)]}
    loops = []
    while after:
        start, at = next(iter(after.items()))
        del after[start]
        loop = [start]
        while at != start and at in after:
            loop.append(at)
            at = after.pop(at)
        if at == start and len(loop) > 2:
            loops.append(np.array(loop))
    return loops


def with_normals(points: Float64, triangles: Int32) -> Float64:
    """Outward unit normals [N, 3] of a mesh's vertices, weighted by the triangles' areas."""
    # Coordinate by coordinate: to pick whole points of three numbers takes five times as long.
    along = np.ascontiguousarray(points.T)
    a, b, c = (np.take(along, corner, axis=1) for corner in triangles.T)
    out = np.stack([np.bincount(triangles.ravel(), np.repeat(one, 3), len(points))
                    for one in np.cross(b - a, c - a, axis=0)], axis=1)
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)


@functools.lru_cache(1)
def generic_prior() -> HeadPrior:
    """The generic head as a `HeadPrior`, with modes of proportion instead of statistics."""
    points, triangles, landmarks, face = generic_surface()
    mean = np.asarray(points, np.float32)
    identity = np.stack([mode(points) for mode in FACE_MODES]).astype(np.float32)
    return HeadPrior("a generic head", mean, triangles, np.where(face, FACE, HEAD).astype(np.uint8),
                     landmarks, identity, np.zeros((0, len(mean), 3), np.float32), ())


UNIT = 0.207  # Metres of a unit of the portrait frame, about.
CELL = 0.012  # Distance of the surface's rows, portrait units.
LOWEST = -0.95  # Height at which the generic head's neck ends, portrait units.
CHIN = -0.56  # Height at which its chin ends, portrait units.
SMOOTH = 1e-3  # Smoothing of the plate.
RADIUS = 0.08  # Metres that a radian around the head counts as.

_LANDMARKS = {
    0: (-72, 0, 4), 1: (-72, -16, 8), 2: (-71, -34, 13), 3: (-68, -52, 20), 4: (-62, -70, 31),
    5: (-52, -86, 46), 6: (-38, -98, 63), 7: (-20, -107, 78), 8: (0, -111, 86),
    17: (-56, 17, 68), 18: (-48, 25, 78), 19: (-37, 28, 85), 20: (-24, 27, 91), 21: (-12, 23, 94),
    27: (0, 4, 92), 28: (0, -8, 99), 29: (0, -19, 108), 30: (0, -30, 116),
    31: (-12, -43, 94), 32: (-6, -44, 98), 33: (0, -45, 100),
    36: (-44, 1, 71), 37: (-37, 5, 78), 38: (-25, 6, 80), 39: (-17, -1, 78), 40: (-25, -4, 80),
    41: (-37, -4, 77),
    48: (-26, -67, 86), 49: (-15, -61, 97), 50: (-6, -58, 102), 51: (0, -59, 103),
    57: (0, -77, 99), 58: (-8, -76, 98), 59: (-17, -73, 94),
    60: (-23, -67, 88), 61: (-9, -66, 97), 62: (0, -66, 98), 66: (0, -67, 98), 67: (-9, -67, 97),
}
"""Landmarks of iBUG's scheme on the sitter's right and in the middle, millimetres: from the middle
(to the sitter's left), the eyes' height (up) and the depth of the ears' tragi (out of the face)."""

_PLACES = np.array([
    # bridge and sides of the nose
    (9, -8, 86), (11, -19, 92), (15, -30, 96), (18, -37, 92), (22, -38, 88),
    # forehead and temples
    (0, 20, 97), (0, 45, 94), (0, 65, 86), (0, 85, 70), (30, 45, 87), (30, 70, 75), (50, 45, 71),
    (50, 68, 56), (64, 38, 42), (66, 15, 46), (71, 5, 26),
    # cheeks
    (30, -18, 83), (46, -20, 76), (57, -20, 65), (66, -25, 42), (71, -25, 22), (32, -38, 85),
    (46, -40, 75), (60, -42, 51), (25, -50, 90), (38, -58, 82), (50, -60, 65), (60, -60, 42),
    (36, -76, 78), (48, -76, 60),
    # upper lip and chin
    (0, -52, 101), (14, -52, 96), (0, -86, 94), (0, -98, 96), (15, -92, 91), (22, -82, 88),
    (30, -90, 76),
    # below the chin
    (0, -113, 68), (0, -117, 46), (30, -107, 50), (45, -102, 28), (54, -96, 8), (60, -84, -2),
    # skull
    (74, 30, 0), (77, 35, -25), (66, 40, -65), (40, 38, -90), (0, 35, -99), (0, 0, -93),
    (40, 0, -82), (66, 0, -50), (0, -40, -80), (55, -40, -50), (0, 75, -85), (0, 112, -10),
], np.float64)
"""Further places of the surface, likewise, of the sitter's left."""
_NECK = (-0.75, -0.85, -0.95)  # Heights at which the bust's neck stays as it is, portrait units.

# Ears stand out from the head: middle of the flap (up, out of the face), half its height, its ends
# in front and behind, and how far it stands out there; millimetres.
_EAR_HEIGHT, _EAR_HALF, _EAR_FRONT, _EAR_BACK, _EAR_OUT = -8.0, 32.0, 2.0, -33.0, 17.0


def generic_face() -> Float64:
    """The landmarks of the generic head, [68, 3], metres, in the portrait frame's directions."""
    out = np.zeros((68, 3))
    for number, place in _LANDMARKS.items():
        out[MIRRORED[number]] = np.multiply(place, (-1, 1, 1))
        out[number] = place
    return 0.001 * out


def generic_surface() -> tuple[Float64, Int32, Int64, UInt8]:
    """The generic head: vertices [N, 3] in metres, triangles [T, 3], landmarks [68], face or not.

    The surface is closed; seen from outside, its triangles run counter-clockwise.
    """
    points = _chart_points()
    rows, columns = points.shape[:2]
    flat = points.reshape(-1, 3)
    mesh = np.arange(rows * columns).reshape(rows, columns)
    right = np.roll(mesh, -1, axis=1)
    top, bottom = flat[mesh[-1]].mean(axis=0), flat[mesh[0]].mean(axis=0)
    count = rows * columns
    triangles = np.concatenate([
        np.stack([mesh[:-1], right[:-1], right[1:]], -1).reshape(-1, 3),
        np.stack([mesh[:-1], right[1:], mesh[1:]], -1).reshape(-1, 3),
        np.stack([mesh[-1], right[-1], np.full(columns, count)], -1),
        np.stack([right[0], mesh[0], np.full(columns, count + 1)], -1)]).astype(np.int32)
    flat = np.concatenate([flat, top[None], bottom[None]])
    normal = np.cross(flat[triangles[:, 1]] - flat[triangles[:, 0]],
                      flat[triangles[:, 2]] - flat[triangles[:, 0]])
    if (normal * (flat[triangles].mean(axis=1) - flat.mean(axis=0))).sum() < 0:
        triangles = np.ascontiguousarray(triangles[:, ::-1])
    face = generic_face()
    landmarks = np.array([np.argmin(((flat - place) ** 2).sum(axis=1)) for place in face])
    front = ((flat[:, 2] > 0.02) & (flat[:, 1] > face[8, 1] - 0.01)
             & (flat[:, 1] < face[19, 1] + 0.05))
    return flat, triangles, landmarks, front.astype(np.uint8)


def _chart_points() -> Float64:
    """Rings of vertices [V, U, 3], metres: the bust, drawn to the places."""
    from scipy.interpolate import RBFInterpolator

    from ..field.geometry import bust_chart, bust_distance

    chart = bust_chart(CELL, lowest=LOWEST)
    bust = bust_distance(chart, CHIN)
    places = np.concatenate([generic_face(), 0.001 * _PLACES,
                             0.001 * _PLACES[_PLACES[:, 0] > 0] * [-1, 1, 1]])
    at, distance = chart.places(places / UNIT)
    row, column = np.clip(np.rint(at), 0, np.array([[len(bust) - 1], [bust.shape[1] - 1]])
                          ).astype(int)
    value = np.log(distance / bust[row, column])
    height = chart.cell * UNIT * np.arange(len(bust))  # along the surface, nearly
    knots = np.stack([height[row], RADIUS * chart.angle[column]], axis=1)
    level = np.searchsorted(chart.axis[:chart.level, 1], _NECK)
    neck = np.array([(height[k], RADIUS * angle) for k in np.clip(level, 0, None)
                     for angle in np.arange(-3, 4)])
    knots, value = np.concatenate([knots, neck]), np.append(value, np.zeros(len(neck)))
    around = np.array([0.0, 2 * np.pi * RADIUS])
    knots = np.concatenate([knots - around, knots, knots + around])
    value = np.tile(value, 3)
    near = np.abs(knots[:, 1]) < 1.5 * np.pi * RADIUS
    knots, first = np.unique(np.round(knots[near], 5), axis=0, return_index=True)
    plate = RBFInterpolator(knots / RADIUS, value[near][first], kernel="thin_plate_spline",
                            smoothing=SMOOTH)
    grid = np.stack(np.meshgrid(height / RADIUS, chart.angle, indexing="ij"), axis=-1)
    ratio = plate(grid.reshape(-1, 2)).reshape(bust.shape)
    points = UNIT * chart.points(bust * np.exp(ratio))
    points[..., 0] += np.sign(points[..., 0]) * _ear(points)
    return np.asarray(points, np.float64)


def _ear(points: Float64) -> Float64:
    """How far ears stand out at places [..., 3], metres."""
    up = (1000 * points[..., 1] - _EAR_HEIGHT) / _EAR_HALF
    back = (_EAR_FRONT - 1000 * points[..., 2]) / (_EAR_FRONT - _EAR_BACK)
    ellipse = up ** 2 + ((back - 0.5) / 0.55) ** 2
    flap = np.clip((1.15 - ellipse) / 0.3, 0, 1) * np.clip(back, 0, 1) ** 0.8
    return np.asarray(np.where(np.abs(points[..., 0]) > 0.04, 0.001 * _EAR_OUT * flap, 0.0))


def _bump(points: Float64, middle: tuple[float, float, float], width: float) -> Float64:
    """A hill of height 1 around a place and its mirror image, millimetres."""
    both = [np.exp(-((points - 0.001 * np.multiply(middle, (side, 1, 1))) ** 2).sum(axis=1)
                   / (2 * (0.001 * width) ** 2)) for side in (-1.0, 1.0)]
    return np.asarray(both[0] if middle[0] == 0 else both[0] + both[1])


def _below(points: Float64, height: float, over: float) -> Float64:
    """From 1 below a height to 0 above it, millimetres."""
    return np.asarray(1 / (1 + np.exp((points[:, 1] - 0.001 * height) / (0.001 * over))))


def _front(points: Float64) -> Float64:
    """From 1 in the face to 0 at the ears."""
    return np.clip(points[:, 2] / 0.07, 0, 1)


def _moved(points: Float64, axis: int, by: Float64 | float) -> Float64:
    out = np.zeros_like(points)
    out[:, axis] = by
    return out


FACE_MODES: tuple[Callable[[Float64], Float64], ...] = (
    lambda p: 0.045 * p,  # size
    lambda p: _moved(p, 0, 0.04 * p[:, 0]),  # width
    lambda p: _moved(p, 1, 0.04 * p[:, 1]),  # height
    lambda p: _moved(p, 2, 0.04 * p[:, 2]),  # depth
    lambda p: _moved(p, 0, 0.06 * p[:, 0] * _below(p, -60, 15)),  # jaw's width
    lambda p: _moved(p, 1, -0.005 * _below(p, -84, 10)),  # chin's height
    lambda p: _moved(p, 2, 0.005 * _bump(p, (0, -105, 85), 26)),  # chin forward
    lambda p: _moved(p, 2, 0.004 * _bump(p, (0, -27, 110), 14)),  # nose
    lambda p: _moved(p, 1, -0.003 * _bump(p, (0, -35, 105), 16)),  # nose's length
    lambda p: _moved(p, 0, 0.10 * p[:, 0] * _bump(p, (0, -37, 98), 16)),  # nose's width
    lambda p: _moved(p, 1, 0.003 * _bump(p, (0, -67, 95), 22)),  # mouth's height
    lambda p: _moved(p, 0, 0.08 * p[:, 0] * _bump(p, (0, -67, 95), 28)),  # mouth's width
    lambda p: _moved(p, 2, 0.003 * _bump(p, (0, -66, 98), 18)),  # lips forward
    lambda p: _moved(p, 1, 0.003 * _bump(p, (30, 26, 85), 22)),  # brows' height
    lambda p: _moved(p, 0, 0.05 * p[:, 0] * _bump(p, (0, 1, 80), 45)),  # eyes' distance
    lambda p: _moved(p, 2, 0.003 * _bump(p, (32, 0, 78), 18)),  # eyes' depth
    lambda p: _moved(p, 2, 0.003 * _bump(p, (48, -25, 68), 24)),  # cheeks forward
    lambda p: _moved(p, 2, _front(p) * 0.004 * _bump(p, (0, 55, 92), 40)),  # forehead forward
    lambda p: _moved(p, 1, 0.008 * (1 - _below(p, 40, 15))),  # forehead's height
)
"""How heads differ: one standard deviation each, [N, 3] of vertices [N, 3] in metres."""
