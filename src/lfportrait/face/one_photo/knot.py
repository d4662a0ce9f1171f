"""A knot of hair that a photo shows above the head: where it is, and its shape.

Hair is tied at the back of the crown. Inflated with the head, a knot would draw that up to a cone:
it stands behind the crown instead, as far as its height above the skull says.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy import ndimage

from ...arrays import Bool, Float64
from .parts import Parts, opened, signed_distance
from .piece import Piece, inflated, outside
from .samples import MeshSamples

NARROW = 0.3
"""Half of the width below which what stands above a head may be a knot, portrait units."""
LEAST, MOST = 0.08, 0.26  # Radii of knots, portrait units.
STANDS = 0.4  # How far one stands out of the head's outline at least, over its radius.
ROUND = 0.2  # How far off a circle its outline is in the mean at most, over its radius.
ASIDE = 0.35  # How far from the middle of the head it may be, portrait units.
ROOT = 0.06  # How thick the hair is that it rests on, portrait units.
STEPS = 120  # Places behind the crown that are tried.


class Knot(NamedTuple):
    """A knot in the maps of a photo."""

    shown: Bool  # bool [h, w], what of it stands out above the head.
    row: float  # Of its middle.
    column: float
    radius: float  # In cells.


def knot_of(parts: Parts, near: Float64) -> Knot | None:
    """The knot of hair that stands out above a head, or None.

    ``near`` [h, w] is the head's depth, NaN where it is not.
    """
    head = np.isfinite(near)
    if not head.any():
        return None
    rows, columns = np.nonzero(head)
    highest, middle = int(rows.min()), 0.5 * (columns.min() + columns.max())
    low = min(highest + round(NARROW / parts.cell), len(near))  # far above the ears
    person = parts.inside > 0
    out = person & parts.hair & ~opened(person, NARROW / parts.cell)
    out[low:] = False
    pieces, count = ndimage.label(ndimage.binary_opening(out, np.ones((3, 3))))
    if not count:
        return None
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    shown = pieces == int(sizes.argmax())
    edge = shown & ~ndimage.binary_erosion(person)
    if edge.sum() < 8:
        return None
    row, column = np.nonzero(edge)
    # The circle through its outline, by least squares.
    design = np.stack([2 * row, 2 * column, np.ones(len(row))], axis=1)
    y, x, rest = np.linalg.lstsq(design, row ** 2.0 + column ** 2.0, rcond=None)[0]
    radius = float(np.sqrt(max(rest + y * y + x * x, 0.0)))
    off = float(np.abs(np.hypot(row - y, column - x) - radius).mean())
    rows = np.flatnonzero(shown.any(axis=1))
    rest = np.flatnonzero((person & ~ndimage.binary_dilation(shown, iterations=3)).any(axis=1))
    good = (LEAST < radius * parts.cell < MOST and off < ROUND * radius
            and rows[-1] - rows[0] > STANDS * radius
            and 1 < rows[0] < rest.min(initial=len(near))  # not a tuft at a side
            and abs(x - middle) * parts.cell < ASIDE)
    return Knot(shown, float(y), float(x), radius) if good else None


def without_knot(parts: Parts, knot: Knot) -> Parts:
    """The maps of a person without a knot."""
    rest = signed_distance(((parts.inside > 0) & ~knot.shown).astype(np.float32))
    inside = np.minimum(parts.inside, cv2.GaussianBlur(rest, (0, 0), 1.0))
    around = ndimage.binary_dilation(knot.shown, iterations=round(knot.radius))
    inside = np.where(around, inside, parts.inside)  # which is finer than whole cells
    return replace(parts, inside=inside, hair=parts.hair & ~knot.shown)


def knot_piece(parts: Parts, knot: Knot, samples: MeshSamples) -> Piece:
    """A knot as a piece behind the crown of a head, whose samples are given."""
    row, column = np.indices(knot.shown.shape)
    away = np.hypot(row - knot.row, column - knot.column)
    person = parts.inside > 0
    domain = knot.shown | ((away < knot.radius) & person)
    rest = np.minimum(knot.radius - away, np.where(person, np.inf, parts.inside))
    inside = np.where(knot.shown, np.maximum(parts.inside, knot.radius - away), rest)
    maps = replace(parts, inside=np.asarray(inside, np.float32))
    squares = inflated(domain, maps.inside, parts.cell, source=4.0)
    found = outside(squares, maps, domain, 0.0)
    return Piece(found, found, np.full(domain.shape, _depth(parts, knot, samples)))


def _depth(parts: Parts, knot: Knot, samples: MeshSamples) -> float:
    """How deep the middle of a knot lies: from the crown backwards, where it rests on the hair."""
    origin, ray = parts.camera.rays(0, np.array([[knot.column + 0.5, knot.row + 0.5]]))
    ray = ray / (ray @ parts.camera.pose[0, :3, 2])[:, None]
    depth = parts.places(samples.points)[1]
    crown = float(depth[samples.points[:, 1].argmax()])
    tried = np.linspace(crown, float(depth.max()), STEPS)
    length = samples.tree.query(origin + ray * tried[:, None])[0]
    # The first place, seen from the front, where it does not lie deeper in the hair than that.
    rests = np.flatnonzero(length > ROOT)
    return float(tried[rests[0] if len(rests) else -1])
