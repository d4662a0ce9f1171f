"""Fit a statistical head to the landmarks and the surface of a capture, in space.

Regularised least squares by Gauss-Newton steps over a similarity and the coefficients of identity
and expression: landmarks as they were triangulated, and vertices drawn to the planes of the surface
that lies nearest (Chen and Medioni 1992), both with Huber's weights (1964). Under hair the skull is
free to lie deeper.

Photos of a narrow arc show how wide a head is, and next to nothing of how long. There the model's
mean decides, and ICT-FaceKit's is 1.22 times as long as wide. Before it is fitted it is lengthened
behind the ears to what the generic head has, an average adult's.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from .. import models
from ..arrays import Bool, Float64, Int64
from ..capture import laid_over
from ..field.closing import FittedHead
from .head_fit import EXPRESSION, MOST_DEVIATIONS
from .head_prior import EYES, SOCKETS, HeadPrior, head_prior, with_normals

METRES = 0.207  # Of a unit of the portrait frame.
_LANDMARK, _SURFACE = 0.003 / METRES, 0.0025 / METRES  # Deviations of a landmark and of a surface.
_BROWS = 0.15  # Weight of the brows' landmarks: they are where one has hair.
_COUNT = 150.0
"""The surface's places, which err alike where they are neighbours, count together as so many."""
_REACH = (0.030 / METRES, 0.010 / METRES)
"""How far a vertex looks for the surface, at first and at last."""
_ALIKE = 0.6  # Cosine between the normals of a vertex and of the surface that it may be drawn to.
_APART = 0.006  # Metres between the vertices that are drawn.
_HAIRY = 0.1  # Weight of a surface before the skull where hair may be.
_HIGH, _BEHIND, _NAPE = 0.075, 0.010, -0.04
"""Heights and depth in the model, metres, beyond which hair grows."""
_LOWEST = -0.105  # Height in the model below which a neck is not looked at.
_EAR = ((0.060, 0.120), (-0.0225, 0.0365), (-0.0185, 0.0175))
"""Where ICT-FaceKit's mean head has its ears: |x|, y and z in metres."""
LONG = 1.27
"""Length of a skull over its breadth, that of the generic head (`lfportrait.face.head_prior`)."""
_BROW, _ABOVE_BROWS = slice(19, 25), 0.005
"""Landmarks of the brows, and metres above them from which on a skull is measured."""
ROUNDS = 12


def fit_to_surface(landmarks: Float64, points: Float64, normals: Float64, trust: Float64,
                   ) -> FittedHead | None:
    """The head that is installed, fitted to a capture (`lfportrait.field.closing.FitHead`).

    None where no statistical head is installed: the generic one has no ears, and what a narrow arc
    shows bends it less well than the bust that a capture starts from.
    """
    if not models.available("head"):
        return None
    prior = lengthened(head_prior())
    return FittedHead(fit_in_space(prior, landmarks, points, normals, trust), prior.triangles,
                      _ears(prior))


def proportion(prior: HeadPrior, points: Float64) -> tuple[float, float]:
    """Length and breadth of a skull above its brows, without ears, in the unit of the points.

    ``points`` are the model's vertices, float64 [N, 3], in its own frame, or moved and scaled.
    """
    breadth, _, length = np.ptp(points[_skull(prior)], axis=0)
    return float(length), float(breadth)


def lengthened(prior: HeadPrior) -> HeadPrior:
    """A model whose mean is as long for its breadth as usual (`LONG`); a longer one stays.

    What lies behind the ears is drawn backwards, in proportion to how far behind it lies.
    """
    mean = prior.mean.astype(np.float64)
    length, breadth = proportion(prior, mean)
    behind = np.minimum(mean[:, 2] - _EAR[2][0], 0.0)
    more = max(LONG * breadth - length, 0.0) / max(-float(behind[_skull(prior)].min()), 1e-9)
    mean[:, 2] += more * behind
    return replace(prior, mean=mean.astype(np.float32))


def _skull(prior: HeadPrior) -> Bool:
    """Which of a model's vertices are its skull's above the brows, [N]."""
    above = float(prior.mean[prior.landmarks[_BROW], 1].mean()) + _ABOVE_BROWS
    return np.asarray(prior.mean[:, 1] > above) & ~_ears(prior)


def _ears(prior: HeadPrior) -> Bool:
    """Which of a model's vertices are its ears', [N]."""
    inside = np.ones(len(prior.mean), bool)
    for values, (low, high) in zip((np.abs(prior.mean[:, 0]), *prior.mean.T[1:]), _EAR,
                                   strict=True):
        inside &= (values > low) & (values < high)
    return inside


def fit_in_space(prior: HeadPrior, landmarks: Float64, points: Float64, normals: Float64,
                 trust: Float64) -> Float64:
    """Fit a model to landmarks and a surface; its vertices, float64 [N, 3], in the portrait frame.

    The landmarks are float64 [68, 3] in iBUG order there, NaN where unknown; the jaw's are not
    used. Places of the surface and its outward unit normals are float64 [P, 3], ``trust`` [P] is
    how far each is to be trusted, 0 to 1.
    """
    solver = _Solver(prior, landmarks, points, normals, trust)
    for turn in range(ROUNDS):
        solver.step(float(np.interp(turn, (0, ROUNDS - 1), _REACH)))
    return solver.placed()


class _Solver:
    """The state of one fit."""

    def __init__(self, prior: HeadPrior, landmarks: Float64, points: Float64, normals: Float64,
                 trust: Float64) -> None:
        self.prior, self.points, self.normals, self.trust = prior, points, normals, trust
        self.tree = cKDTree(points) if len(points) else None
        seen = _without_lean(prior, landmarks)
        self.used = 17 + np.flatnonzero(np.isfinite(seen[17:]).all(axis=1))
        self.landmarks = seen[self.used]
        self.identity = np.zeros(len(prior.identity))
        self.expression = np.zeros(len(prior.expression))
        self.scale, self.rotation, middle = laid_over(
            prior.mean[prior.landmarks[self.used]].astype(np.float64), self.landmarks)
        self.shift = self.landmarks.mean(axis=0) - self.scale * self.rotation @ middle
        self.drawn = _spread(prior)
        y, z = prior.mean.T[1:]
        self.hairy = (y > _HIGH) | ((z < _BEHIND) & (y > _NAPE))

    def placed(self) -> Float64:
        """The vertices, float64 [N, 3]."""
        shape = self.prior.shape(self.identity, self.expression)
        return np.asarray(self.scale * shape @ self.rotation.T + self.shift, np.float64)

    def step(self, reach: float) -> None:
        """One regularised least-squares step of all unknowns."""
        placed = self.placed()
        vertices = np.repeat(self.prior.landmarks[self.used], 3)
        along = np.tile(np.eye(3), (len(self.used), 1))
        error = (placed[self.prior.landmarks[self.used]] - self.landmarks).ravel()
        weight = _huber(error, _LANDMARK) * np.repeat(np.where(self.used < 27, _BROWS, 1.0), 3)
        rows, errors, weights = [self._rows(placed, vertices, along)], [error], [weight]
        if self.tree is not None:
            vertices, along, error, weight = self._surface(placed, reach)
            rows.append(self._rows(placed, vertices, along))
            errors.append(error)
            weights.append(weight)
        matrix, weighted = np.concatenate(rows), np.concatenate(weights)
        normal = matrix.T @ (weighted[:, None] * matrix)
        right = -matrix.T @ (weighted * np.concatenate(errors))
        count = len(self.identity)
        held = np.concatenate([np.full(7, 1e-6), np.ones(count),
                               np.full(len(self.expression), EXPRESSION ** -2)])
        normal[np.diag_indices(len(normal))] += held
        right -= held * np.concatenate([np.zeros(7), self.identity, self.expression])
        change = np.linalg.solve(normal, right)
        self.rotation = Rotation.from_rotvec(change[:3]).as_matrix() @ self.rotation
        self.shift = self.shift + change[3:6]
        self.scale *= float(np.exp(change[6]))
        self.identity = np.clip(self.identity + change[7:7 + count], -MOST_DEVIATIONS,
                                MOST_DEVIATIONS)
        self.expression = np.clip(self.expression + change[7 + count:], -0.2, 1.2)

    def _surface(self, placed: Float64, reach: float) -> tuple[Int64, Float64, Float64, Float64]:
        """Vertices that a surface is near to, its normals, their distances before it, weights."""
        assert self.tree is not None
        normals = with_normals(placed, self.prior.triangles)[self.drawn]
        length, nearest = self.tree.query(placed[self.drawn], distance_upper_bound=reach)
        found = np.flatnonzero(np.isfinite(length))
        nearest = nearest[found]
        alike = (normals[found] * self.normals[nearest]).sum(axis=1) > _ALIKE
        vertices, nearest = self.drawn[found][alike], nearest[alike]
        along = self.normals[nearest]
        error = ((placed[vertices] - self.points[nearest]) * along).sum(axis=1)
        weight = self.trust[nearest] * _huber(error, _SURFACE) / max(len(error) / _COUNT, 1.0)
        weight *= np.where(self.hairy[vertices] & (error < 0), _HAIRY, 1.0)
        return vertices, along, error, weight

    def _rows(self, placed: Float64, vertices: Int64, along: Float64) -> Float64:
        """Derivatives [R, 7 + K + M] of vertices [R] along directions [R, 3]."""
        away = placed[vertices] - self.shift
        back = self.scale * along @ self.rotation
        return np.concatenate([
            np.cross(away, along), along, (away * along).sum(axis=1)[:, None],
            *(np.einsum("kni,ni->nk", modes[:, vertices], back)
              for modes in (self.prior.identity, self.prior.expression))], axis=1)


def _huber(error: Float64, deviation: float) -> Float64:
    """Weights of errors: from two deviations on they count linearly."""
    return np.asarray(np.minimum(1.0, 2 * deviation / np.maximum(np.abs(error), 1e-12))
                      / deviation ** 2, np.float64)


def _without_lean(prior: HeadPrior, landmarks: Float64) -> Float64:
    """Where the vertices lie whose landmarks were triangulated at [68, 3]."""
    if prior.lean is None:
        return landmarks
    across = landmarks[45] - landmarks[36]
    eyes = float(np.linalg.norm(across))
    across = across / eyes
    up = landmarks[27] - landmarks[57]
    up = up - (up @ across) * across
    up /= np.linalg.norm(up)
    axes = np.stack([across, -up, np.cross(across, up)])
    return np.asarray(landmarks - eyes * prior.lean @ axes, np.float64)


def _spread(prior: HeadPrior) -> Int64:
    """Vertices of a model that are drawn to a surface, evenly spread."""
    chosen = np.flatnonzero((prior.part != EYES) & (prior.part != SOCKETS) & ~_ears(prior)
                            & (prior.mean[:, 1] > _LOWEST))
    cells = np.floor(prior.mean[chosen] / _APART).astype(np.int64)
    return np.asarray(chosen[np.unique(cells, axis=0, return_index=True)[1]], np.int64)
