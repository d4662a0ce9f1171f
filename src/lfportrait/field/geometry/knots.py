"""What stands out behind a head and shows only above it: a knot of hair.

A surface that follows a head (`lfportrait.field.geometry.head_surface`) has no knot, and a sweep
along it finds none: of a knot at the back photos show no more than an edge above the crown. A
field that has no room there smears that edge over the crown.

Outlines tell where it is. The space that most mattes show beside the surface, and none rules out,
is a spindle along the middle direction of the arc; photos from the left and from the right cut it
off before and behind the knot, so it is widest where that is. What is seen of it is taken for the
top of a ball, whose rows tell its radius.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from scipy import ndimage

from ...arrays import Bool, Float64, Int64, UInt8
from ...capture import Camera, lattice_votes
from .chart import Chart, at_places

_BESIDE = 0.015
"""Mattes show something else where they reach further than this beyond a surface's outline,
portrait units (3 mm)."""
_MIDDLE, _REACH = np.array([0.0, 0.5, -0.15]), np.array([0.6, 0.8, 0.9])
"""Box in which it is looked for: its middle, and how far it reaches along the axes of the arc."""
_LOW = 0.1
"""Height from which on it is looked for: above the brows."""
_CELL = 0.01
_TOLD, _AGAINST = 0.5, 0.1
"""Share of the photos that must show a place of it beside the surface, and that may show nothing
there: some look at it over the crown's other side."""
_MATTER = 63
"""Value from which on a matte does not rule a place out."""
_WIDEST = 0.8
"""Share of the widest section from which on a section counts as that."""
_LEAST, _MOST = (0.06, 0.025), 0.52
"""Width and height, portrait units, from which on it is a knot: a tuft is none; and the largest
width: a hat, and much hair, are none either."""
_FLAT = 2.0
"""How much larger a ball's radius may be than half of the width that is seen of it."""


def knots_behind(chart: Chart, distance: Float64, limit: Float64, cameras: Camera,
                 mattes: Sequence[UInt8]) -> Float64:
    """Distances of knots along a chart's rays, float64 [V, U], world units; 0 where there is none.

    Parameters
    ----------
    chart, distance : The surface that has none, float64 [V, U], world units.
    limit : Distances up to which mattes rule nothing out, [V, U].
    cameras, mattes : The photos', uint8 [H, W] each.
    """
    none = np.zeros(distance.shape)
    if chart.frame is not None:
        cameras = cameras.transformed(chart.frame)
    local = replace(chart, frame=None)
    others = _beside(local, distance * chart.scale, cameras, mattes)
    views = len(mattes)
    if sum(other.any() for other in others) < _TOLD * views:
        return none
    # Along the arc's middle direction what hides a place does so however far behind it is.
    axes = _axes(cameras.position.mean(axis=0) - _MIDDLE)
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = axes, -axes @ _MIDDLE
    cameras = cameras.transformed(turned)
    shape = tuple(np.round(2 * _REACH / _CELL).astype(int)[::-1].tolist())

    def votes(covered: Callable[[int], Bool], share: float) -> Bool:
        seen, against = lattice_votes(cameras, covered, np.zeros(3), _REACH, shape, share * views)
        return np.asarray((against <= share * seen) & (seen >= _TOLD * views))

    hull = votes(lambda view: np.asarray(mattes[view] > _MATTER), _AGAINST)
    pieces, _ = ndimage.label(hull & votes(lambda view: others[view], 1 - _TOLD),
                              np.ones((3, 3, 3), np.int8))
    found = none.ravel()
    # The shreds of a matte are thousands of pieces, too small for a section of a knot.
    large = np.bincount(pieces.ravel())[1:] > _LEAST[0] / _CELL
    for piece in np.flatnonzero(large) + 1:
        ball = _ball(pieces == piece, hull)
        if ball is None:
            continue
        middle = _MIDDLE + ball[0] @ axes
        if middle[1] < _LOW:
            continue
        # So many that there are some in each cell of the chart.
        places = middle + ball[1] * _directions(int(16 * (ball[1] / _CELL) ** 2))
        (row, column), far = local.places(places)
        cell = (np.clip(np.rint(row), 0, len(distance) - 1).astype(np.int64) * distance.shape[1]
                + np.rint(column).astype(np.int64) % distance.shape[1])
        np.maximum.at(found, cell, far / chart.scale)
    raised = np.minimum(found.reshape(distance.shape), limit)
    return np.where(raised > distance, raised, 0.0)


def _axes(ahead: Float64) -> Float64:
    """Unit vectors to the right, upwards and ahead, one a row, [3, 3]."""
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross([0.0, 1.0, 0.0], ahead)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def _beside(chart: Chart, distance: Float64, cameras: Camera, mattes: Sequence[UInt8],
            ) -> list[Bool]:
    """Where mattes show something beside a surface's outline, bool [H, W] a photo."""
    halves = chart.halves
    points = chart.finer().points(at_places(distance, halves.reshape(2, -1))
                                  .reshape(halves.shape[1:])).reshape(-1, 3)
    found = []
    for view, matte in enumerate(mattes):
        height, width = matte.shape
        pixels = np.floor(cameras[view].project(points)[0][0]).astype(np.int64)
        inside = ((pixels >= 0) & (pixels < (width, height))).all(axis=1)
        outline = np.zeros(matte.shape, np.uint8)
        outline[pixels[inside, 1], pixels[inside, 0]] = 1
        unit = float(cameras.focal[view, 0] / np.linalg.norm(cameras.position[view]))
        wide = max(2, int(np.ceil(_BESIDE * unit)))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * wide + 1, 2 * wide + 1))
        found.append(np.asarray((matte > 127) & (cv2.dilate(outline, disc) == 0)))
    return found


def _ball(piece: Bool, hull: Bool) -> tuple[Float64, float] | None:
    """Middle [3] and radius of a ball whose top is ``piece`` [Z, Y, X], within a hull, or None."""
    areas = piece.sum(axis=(1, 2))
    widest = areas >= _WIDEST * areas.max()
    # Where the spindle's end is not seen, nothing says how far behind it is.
    if widest[0] or widest[-1]:
        return None
    depth = float(np.average(np.flatnonzero(widest), weights=areas[widest]))
    _, rows, columns = np.nonzero(piece[widest])
    low, high = rows.min(), rows.max()
    width = _CELL * float(np.ptp(columns) + 1)
    if not _LEAST[0] <= width <= _MOST or _CELL * (high - low + 1) + _BESIDE < _LEAST[1]:
        return None
    # What is nearer to the head's outline is part of it as well.
    low = max(low - int(_BESIDE / _CELL), 0)
    up, left, right = _run(hull[round(depth), low:high + 1],
                           round(0.5 * float(columns.min() + columns.max())))
    if not len(up):
        return None
    # From the middles of this section's rows to its own top: another's, one row higher, would make
    # the ball up to a quarter too small.
    drop, half = _CELL * (up.max() - up + 0.5), 0.5 * _CELL * (right - left + 1)
    # Of a ball half^2 = drop (2 radius - drop).
    radius = float(drop @ (half ** 2 + drop ** 2) / (2 * (drop @ drop)))
    radius = float(np.clip(radius, 0.5 * width, 0.5 * _FLAT * width))
    at = 0.5 * (left + right).mean(), low + up.max() + 0.5 - radius / _CELL, depth
    return _CELL * (np.array(at) + 0.5) - _REACH, radius


def _run(section: Bool, middle: int) -> tuple[Int64, Int64, Int64]:
    """Of rows that hold column ``middle`` of a section [Y, X]: first and last column beside it."""
    rows = np.flatnonzero(section[:, middle])
    left = np.array([middle - np.argmin(np.append(section[row, middle::-1], False)) + 1
                     for row in rows], np.int64)
    right = np.array([middle + np.argmin(np.append(section[row, middle:], False)) - 1
                      for row in rows], np.int64)
    return rows, left, right


def _directions(count: int) -> Float64:
    """Unit vectors all around, nearly evenly, float64 [N, 3] (a spiral of the golden angle)."""
    number = np.arange(count) + 0.5
    up, turn = 1 - 2 * number / count, np.pi * (1 + 5 ** 0.5) * number
    flat = np.sqrt(1 - up ** 2)
    return np.stack([flat * np.cos(turn), up, flat * np.sin(turn)], axis=1)
