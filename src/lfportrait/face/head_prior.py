"""A statistical head: a mean, modes of identity with their deviations, expressions, 68 landmarks.

One neutral form for heads of any origin. Where no statistical head is installed there is a generic
one (`generic_prior`), with a few hand-made modes.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import models
from ..arrays import Float32, Float64, Int32, Int64, UInt8
from ..errors import UserError
from ..files import UNREADABLE_ARRAYS
from .generic_head import FACE_MODES, generic_surface
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
BELIEVED = 0.5
"""Share of the lean in the picture that is corrected."""
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
    return HeadPrior(head.name, head.mean[used], number[kept].astype(np.int32), head.part[used],
                     number[head.landmarks], head.identity[:, used], head.expression[:, used],
                     head.expressions, head.lean)


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
    identity, expression = (np.ascontiguousarray(modes) for modes in (identity, expression))
    return HeadPrior(head.name, mean, np.concatenate([head.triangles, *fans]).astype(np.int32),
                     part, head.landmarks, identity, expression, head.expressions, head.lean)


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
    a, b, c = (points[triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    out = np.stack([np.bincount(triangles.ravel(), np.repeat(face[:, k], 3), len(points))
                    for k in range(3)], axis=1)
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)


@functools.lru_cache(1)
def generic_prior() -> HeadPrior:
    """The generic head as a `HeadPrior`, with modes of proportion instead of statistics."""
    points, triangles, landmarks, face = generic_surface()
    mean = np.asarray(points, np.float32)
    identity = np.stack([mode(points) for mode in FACE_MODES]).astype(np.float32)
    return HeadPrior("a generic head", mean, triangles, np.where(face, FACE, HEAD).astype(np.uint8),
                     landmarks, identity, np.zeros((0, len(mean), 3), np.float32), ())
