"""Solids that know how far away they are: signed distances, one row of numbers a solid.

A row holds the kind, where and how the solid lies, its sizes and its material (`Model`).
`distance` never overestimates: where a surface is bent, as a leaf's or a vase's is, the distance to
the unbent one is divided by how much the bending stretches space at most (its Lipschitz constant).
"""

from __future__ import annotations

from itertools import pairwise
from math import cos, sin, sqrt

import numpy as np
from scipy.interpolate import PchipInterpolator

from lfportrait.simd.decorators import kernel, lean

__all__ = ["ACROSS", "ARC", "BLADE", "BOX", "CASE", "CLOTH", "CYLINDER", "LATHE", "LEAF", "ROD",
           "SPINDLE", "TUBE", "Model", "about_y", "about_z", "distance", "dot", "moved",
           "radius_at", "stretch", "upright"]

BOX, CYLINDER, TUBE, LEAF, LATHE, SPINDLE, ARC, BLADE, CLOTH, CASE, ROD = range(11)
CONTROLS = 24  # of the spline that is a turned vase's radius


@lean
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def radius_at(controls, share):
    """Radius of what a lathe turned, at a share of its height: a uniform cubic B-spline."""
    place = min(max(share, 0.0), 1.0) * (CONTROLS - 3)
    i = min(int(place), CONTROLS - 4)
    t = place - i
    return ((1.0 - t)**3 * controls[i] + (3.0 * t**3 - 6.0 * t * t + 4.0) * controls[i + 1]
            + (1.0 + 3.0 * t + 3.0 * t * t - 3.0 * t**3) * controls[i + 2]
            + t**3 * controls[i + 3]) / 6.0


@kernel
def wave(p, q, radius, height):
    """How far a cloth of that radius is lifted at (p, q): folds that grow towards the rim."""
    rim = min((p * p + q * q) / radius**2, 1.3)
    turn = np.arctan2(q, p)
    return height * (0.35 * sin(6.0 * p / radius + 1.3 * sin(2.6 * q / radius))
                     + 0.35 * sin(5.1 * q / radius + 2.0 + 1.7 * p / radius)
                     + rim * rim * sin(9.0 * turn + 1.5 * sin(2.0 * turn)))


@lean
def pointed(u, v, length, width):
    """Distance in the plane to the lens between two circles, from a point with u, v >= 0."""
    below = (length * length - width * width) / (2.0 * width)  # the circle's middle is at (0, -)
    if (u - length) * below > v * length:
        return sqrt((u - length)**2 + v * v)
    return sqrt(u * u + (v + below)**2) - below - width


@lean(inline="always")
def combined(u, v, w, rounding):
    """Distance to what has these distances along three axes."""
    u, v, w = u + rounding, v + rounding, w + rounding
    return (min(max(u, v, w), 0.0) + sqrt(max(u, 0.0)**2 + max(v, 0.0)**2 + max(w, 0.0)**2)
            - rounding)


@kernel
def distance(solids, s, profiles, x, y, z):
    """Signed distance to solid ``s``, or a lower bound."""
    kind = int(solids[s, 0])
    x, y, z = x - solids[s, 1], y - solids[s, 2], z - solids[s, 3]
    w = solids[s, 10] * x + solids[s, 11] * y + solids[s, 12] * z
    if kind == ROD:
        # Pythagoras: what is not along the rod is across it.
        across = max(x * x + y * y + z * z - w * w, 0.0)
        w = max(abs(w) - solids[s, 15], 0.0)
        return sqrt(across + w * w) - solids[s, 16]
    p = solids[s, 4] * x + solids[s, 5] * y + solids[s, 6] * z
    q = solids[s, 7] * x + solids[s, 8] * y + solids[s, 9] * z
    if kind > TUBE:
        return bent(solids, s, profiles, kind, p, q, w)
    w = abs(w) - solids[s, 15]
    if kind == BOX:
        return combined(abs(p) - solids[s, 13], abs(q) - solids[s, 14], w, solids[s, 16])
    u = sqrt(p * p + q * q) - solids[s, 13]
    if kind == TUBE:
        u = abs(u) - solids[s, 14]
    return combined(u, -1.0, w, solids[s, 16])


@lean
def bent(solids, s, profiles, kind, p, q, w):
    """The distance in the solid's own axes to a solid of the less simple kinds."""
    u, v = abs(p), abs(q)
    if kind == BLADE:
        # No steeper beyond the leaf's ends than at them.
        a, b = min(u, solids[s, 13]), min(v, solids[s, 14])
        w = abs(w + solids[s, 16] * a * a - solids[s, 18] * b) - solids[s, 15]
        return combined(pointed(u, v, solids[s, 13], solids[s, 14]), -1.0, w, 0.0) / solids[s, 19]
    if kind == ARC:
        if v * solids[s, 18] > p * solids[s, 15]:  # beyond the end of the arc, which is a ball
            return sqrt((p - solids[s, 13] * solids[s, 18])**2
                        + (v - solids[s, 13] * solids[s, 15])**2 + w * w) - solids[s, 14]
        return sqrt((sqrt(u * u + v * v) - solids[s, 13])**2 + w * w) - solids[s, 14]
    if kind == LEAF:
        w += solids[s, 16] * u * u
        outer = sqrt((u / solids[s, 13])**2 + (v / solids[s, 14])**2)
        inner = sqrt((u / solids[s, 13]**2)**2 + (v / solids[s, 14]**2)**2)
        edge = outer * (outer - 1.0) / inner if inner > 1e-6 else -solids[s, 14]
        return 0.7 * combined(edge, -1.0, abs(w) - solids[s, 15], 0.0)
    if kind == CASE:
        return abs(combined(u - solids[s, 13], v - solids[s, 14], abs(w) - solids[s, 15],
                            solids[s, 16])) - solids[s, 18]
    u = sqrt(u * u + v * v)
    if kind == CLOTH:
        w -= wave(p, q, solids[s, 13], solids[s, 18])
        u -= solids[s, 13]
    else:
        u -= radius_at(profiles[int(solids[s, 18])], 0.5 + 0.5 * w / solids[s, 15])
        if kind == LATHE:
            u = abs(u) - solids[s, 14]
    return combined(u, -1.0, abs(w) - solids[s, 15], solids[s, 16]) / solids[s, 19]


def stretch(slope: float) -> float:
    """How much (x, y) -> (x, y + f(x)) stretches space at most where f is no steeper than that.

    The largest singular value of [[1, 0], [slope, 1]].
    """
    return 0.5 * (slope + sqrt(slope * slope + 4.0))


def ball_about(row: np.ndarray) -> float:
    """Radius of a ball about a solid's centre that holds it."""
    kind, (a, b, c) = int(row[0]), row[13:16]
    if kind in (BOX, CASE):
        return float(np.linalg.norm(row[13:16]) + row[18])
    if kind == ROD:
        return float(c + row[16])
    if kind == BLADE:
        return float(sqrt(a * a + (abs(row[16]) * a * a + abs(row[18]) * b + c)**2))
    if kind in (CYLINDER, TUBE, LATHE, SPINDLE):
        return float(sqrt((a + (b if kind in (TUBE, LATHE) else 0.0))**2 + c * c))
    return float(a + b) if kind == ARC else 1e3


class Model:
    """Solids as rows: kind, centre [3], world-to-local rotation [9], sizes [3], rounding, material.

    Sizes are halves along the local x, y, z; a cylinder's are radius, unused, half length; a
    tube's are radius, half wall, half length; a leaf's rounding is how much it bends. Two more
    numbers are ``extra``, which depends on the kind, and what the distance is divided by.
    """

    def __init__(self) -> None:
        self.rows: list[np.ndarray] = []
        self.profiles: list[np.ndarray] = [np.zeros(CONTROLS)]

    def add(self, kind: int, center, size, material: int, rounding: float = 0.008,
            axes: np.ndarray | None = None, extra: float = 0.0, divisor: float = 1.0) -> None:
        """A solid of any kind."""
        axes = np.eye(3) if axes is None else axes
        self.rows.append(np.concatenate([[kind], center, axes.ravel(), size,
                                         [min(rounding, *size), material, extra, divisor]]))

    def arrays(self, scale: float = 1.0, lift: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Rows [S, 21], with the radius of a ball about each solid, and profiles [P, CONTROLS].

        All is scaled about the origin, then lifted, to be in the middle of the pictures.
        """
        rows = np.array(self.rows)
        kind = rows[:, 0]
        rows[:, 1:4] = scale * rows[:, 1:4] + (0.0, 0.0, lift)
        rows[:, 13:15] *= scale
        rows[:, 15] *= np.where(kind == ARC, 1.0, scale)
        # What a leaf bends by is one over a length.
        rows[:, 16] *= np.where(np.isin(kind, (LEAF, BLADE)), 1 / scale, scale)
        rows[:, 18] *= np.where(np.isin(kind, (CLOTH, CASE)), scale, 1.0)
        return (np.column_stack([rows, [ball_about(row) for row in rows]]),
                scale * np.array(self.profiles))

    def rod(self, start, end, radius: float, material: int) -> None:
        """A straight wire with round ends about two points."""
        start, end = np.asarray(start, float), np.asarray(end, float)
        length = float(np.linalg.norm(end - start))
        self.add(ROD, (start + end) / 2, (radius, radius, length / 2), material, radius,
                 upright((end - start) / length))
        self.rows[-1][16] = radius

    def chain(self, points, radius: float, material: int) -> None:
        """Rods from point to point: a bent wire."""
        for start, end in pairwise(points):
            self.rod(start, end, radius, material)

    def ball(self, center, radius: float, material: int) -> None:
        """A box that is all rounding."""
        self.add(BOX, center, (radius,) * 3, material, radius)

    def ring(self, center, radius: float, wire: float, material: int,
             axes: np.ndarray | None = None) -> None:
        """A tube that is all rounding."""
        self.add(TUBE, center, (radius, wire, wire), material, wire, axes)

    def arc(self, center, radius: float, wire: float, half_angle: float, material: int,
            axes: np.ndarray | None = None) -> None:
        """A piece of a ring, about its local x axis."""
        self.add(ARC, center, (radius, wire, sin(half_angle)), material, 0.0, axes,
                 cos(half_angle))

    def blade(self, center, size, material: int, axes: np.ndarray, bend: float,
              fold: float) -> None:
        """A leaf with two tips; it bends along its length and is folded along its middle."""
        self.add(BLADE, center, size, material, 0.0, axes, fold,
                 stretch(2.0 * abs(bend) * size[0] + abs(fold)))
        self.rows[-1][16] = bend

    def cloth(self, center, radius: float, half: float, height: float, material: int) -> None:
        """A round cloth with waves."""
        span = np.linspace(-1.02 * radius, 1.02 * radius, 401)
        lifted = np.array([[wave(p, q, radius, height) for q in span] for p in span])
        steep = np.hypot(*np.gradient(lifted, span[1] - span[0])).max()
        self.add(CLOTH, center, (radius, radius, half), material, half, None, height,
                 stretch(1.08 * steep))

    def lathe(self, center, heights, radii, material: int, wall: float = 0.0,
              axes: np.ndarray | None = None) -> None:
        """What a lathe turns about the local z: radii at heights; solid where the wall is 0."""
        heights, radii = np.asarray(heights, float), np.asarray(radii, float)
        half = 0.5 * (heights[-1] - heights[0])
        curve = PchipInterpolator(heights, radii)
        step = 2 * half / (CONTROLS - 3)
        controls = np.concatenate([[0.0], curve(heights[0] + step * np.arange(CONTROLS - 2)), [0]])
        controls[0], controls[-1] = (2 * controls[1] - controls[2], 2 * controls[-2] - controls[-3])
        # The spline's slope is a mean of its controls' steps.
        steep = float(np.abs(np.diff(controls)).max() / step)
        axes = np.eye(3) if axes is None else axes
        middle = np.asarray(center, float) + 0.5 * (heights[0] + heights[-1]) * axes[2]
        self.profiles.append(controls)
        size = (float(radii.max()), wall or float(radii.max()), half)
        self.add(LATHE if wall else SPINDLE, middle, size, material, 0.9 * wall or 0.01, axes,
                 len(self.profiles) - 1, stretch(steep))

    def studs(self, low, high, z: float, material: int, spacing: float = 0.14) -> None:
        """The knobs on a toy brick."""
        counts = [round((b - a) / spacing) for a, b in zip(low, high)]
        for i in range(counts[0]):
            for j in range(counts[1]):
                self.add(CYLINDER, (low[0] + (i + 0.5) * spacing, low[1] + (j + 0.5) * spacing, z),
                         (0.042, 0.042, 0.028), material, 0.006)


def moved(place, x: float, y: float, z: float) -> np.ndarray:
    return np.asarray(place, float) + np.array((x, y, z), float)


def upright(z: np.ndarray) -> np.ndarray:
    """World-to-local rotation whose third row is along ``z``."""
    z = np.asarray(z, float) / np.linalg.norm(z)
    aside = np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0, 1.0, 0])
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def about_y(angle: float) -> np.ndarray:
    """World-to-local rotation of a thing turned about y: its x axis goes down by ``angle``."""
    return np.array([[cos(angle), 0, -sin(angle)], [0, 1, 0], [sin(angle), 0, cos(angle)]])


def about_z(angle: float) -> np.ndarray:
    """World-to-local rotation of a thing turned about z by ``angle``."""
    return np.array([[cos(angle), sin(angle), 0], [-sin(angle), cos(angle), 0], [0, 0, 1.0]])


ACROSS = upright(np.array([0, 1.0, 0]))
