"""Hair as an inflated piece: on the head, before the body, and down the back.

Hair begins flush with the skin at the hairline and stays clear of the skull: in front by as much as
the outline shows it to stand off in the same direction. Below the jaw it lies
on the neck and on the body, in front as thick as a lock is. Behind it covers what is scalp; where
it hangs down beside the neck, also what lies between its strands, which no photo shows.

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
from .depth import Sensed, hair_squares
from .parts import Parts, opened, signed_distance, thin
from .piece import METRES, Piece, filled, inflated, outside
from .samples import MeshSamples

CLEAR, RAMP = 0.010 / METRES, 0.025 / METRES
"""Hair stays so far outside of the skull, from so far behind the hairline on."""
LOCK = 0.030 / METRES  # How far before neck and body hair lies at most.
JAW, END = 0.045, -0.015
"""Heights (metres, `HeadPrior.rest`) between which hair of the head becomes hair of the neck."""
EARS = 0.095
"""Height (metres, `HeadPrior.rest`) below which a head says nothing of where hair hangs: the middle
of its jaw lies in front of the skull's and of the neck's."""
NAPE = -0.36  # Height below which hair that hangs down beside the neck hangs down behind, too.
RIM = 0.045
"""What is not hair beside the head, between strands or along their outline, and less than twice so
wide is, portrait units."""
GAP = 4  # Rows without hair that do not end a strand.
HANGING = 0.05 / METRES  # Bends of less than twice this height are bridged by hair that hangs down.
EVEN = 0.08  # Over how much hair behind the neck and the body is even, portrait units.
FALL = 0.45  # How much farther back, of the way down, hair hangs at most.
CURVE = 0.10  # How much farther down the middle hair behind ends than at the sides, portrait units.
FRONT = 0.03  # What lies no farther behind the nearest place is in front, portrait units.
RISE = 0.2  # From so far behind its line on hair is as thick as it gets, portrait units.
CROWN = 0.13
"""Height (metres, `HeadPrior.rest`) from which on hair is as thick as the outline says."""
SECTORS, EVENLY = 36, 1.5  # Of the half circle above that; how many of them share a thickness.
MOST = 0.25  # Hair stands off the skull by no more, portrait units.

NARROW = 0.3
"""Half of the width below which what stands above a head may be a knot, portrait units."""
SMALLEST, LARGEST = 0.08, 0.26  # Radii of knots, portrait units.
STANDS = 0.4  # How far one stands out of the head's outline at least, over its radius.
ROUND = 0.2  # How far off a circle its outline is in the mean at most, over its radius.
ASIDE = 0.35  # How far from the middle of the head it may be, portrait units.
ROOT = 0.06  # How thick the hair is that it rests on, portrait units.
STEPS = 120  # Places behind the crown that are tried.


class Neck(NamedTuple):
    """Where the neck is in the picture."""

    ears: float  # Row of the middle of the ears.
    jaw: float  # Row of the jaw's corners.
    end: float  # Row of the neck's end.
    left: float  # Its outermost columns.
    right: float
    depth: float  # Of its middle.

    @staticmethod
    def of(parts: Parts, samples: MeshSamples) -> Neck:
        """The neck of a head."""
        rings = []
        for height in (EARS, JAW, END):
            ring = samples.points[np.abs(samples.rest[:, 1] - height) < 0.0015]
            rings.append(parts.places(ring))
        (ears, _), (jaw, _), (end, depth) = rings
        return Neck(float(ears[0].mean()), float(jaw[0].mean()), float(end[0].mean()),
                    float(end[1].min()), float(end[1].max()),
                    0.5 * float(depth.min() + depth.max()))

    def share(self, rows: int, start: float | None = None) -> Float64:
        """How much each row is the neck's, or the body's, [rows, 1]: 0 to 1.

        ``start`` is the last row that is the head's alone, the jaw's without it.
        """
        first = self.jaw if start is None else start
        way = np.clip((np.arange(rows) - first) / max(self.end - first, 1.0), 0, 1)
        return np.asarray((way * way * (3 - 2 * way))[:, None])

    def middle(self, near: Float64, far: Float64) -> Float64:
        """The depth [h, w] around which hair lies: the skull's, and from there down the neck's."""
        rows, known = np.arange(len(near))[:, None], 0.5 * (near + far)
        skull = np.where(rows <= self.ears, known, np.nan)
        if np.isfinite(skull).any():  # else the photo begins below the ears
            known = skull
        out = cv2.GaussianBlur(filled(known, 6.0), (0, 0), 8.0)
        return np.asarray(out + self.share(len(near), self.ears) * (self.depth - out), np.float64)


def hair_piece(parts: Parts, head: tuple[Float64, Float64], grown: Bool, neck: Neck,
               body: Piece | None, sensed: Sensed | None,
               outer: tuple[Float64, Float64]) -> Piece:
    """Hair as a piece.

    Parameters
    ----------
    parts : Maps [h, w] of the person, with rims (`with_rims`).
    head : Nearest and farthest depth [h, w] of the head, portrait units; NaN where it is not.
    grown : bool [h, w], where the back of the head is scalp.
    neck : Where it is in the maps.
    body : What hair lies on below the neck.
    sensed : The photo's own depth, where it has one.
    outer : The same depths of the head with its hair (`grown_out`).
    """
    near, far = head
    share = neck.share(len(near))
    # Hair that stands up in front must not draw the middle behind the skull's.
    middle = np.minimum(neck.middle(near, far), neck.middle(*outer))
    person = parts.inside > 0
    hair = parts.hair & person
    before, behind = _under(head, share, body)
    front = _front(parts, hair, middle, before, share, sensed, outer[0])
    domain = _behind(parts, hair, grown, neck)
    back = _back(parts, domain, middle, behind, float(np.nanmax(far)), share)
    return Piece(outside(front, parts, hair, 1.0), outside(back, parts, domain, 1.0), middle,
                 hair, domain)


def grown_out(parts: Parts, samples: MeshSamples, near: Float64, scalp: Bool) -> MeshSamples:
    """Samples of a head with its hair, as thick everywhere as the photo's outline shows it.

    Seen from the front the outline tells how far hair stands off the skull at the top and at the
    sides.

    Parameters
    ----------
    parts : Maps [h, w] of the person.
    near : float64 [h, w], the head's depth, NaN where it is not.
    scalp : bool [N], where hair grows: it has all of its thickness where no photo shows it.
    """
    places, depth = parts.places(samples.points)
    row, column = np.rint(places).astype(int)
    row, column = (np.clip(one, 0, end - 1) for one, end in zip((row, column), near.shape,
                                                               strict=True))
    ahead = depth < near[row, column] + FRONT
    skin = (parts.inside > 0) & ~parts.hair
    # From its line hair rises steeply at first.
    way = np.clip(ndimage.distance_transform_edt(~skin) * parts.cell / RISE, 0, 1)
    shown = np.where(parts.hair, way * (2 - way), 0.0)
    share = np.where(ahead, shown[row, column], scalp)
    share *= np.clip((samples.rest[:, 1] - EARS) / (CROWN - EARS), 0, 1)
    thick = share * _stands_off(parts, samples, places)
    return replace(samples, points=samples.points + thick[:, None] * samples.normals)


def _stands_off(parts: Parts, samples: MeshSamples, places: Float64) -> Float64:
    """How far hair stands off the skull in the direction of each sample in the picture, [N]."""
    level = np.abs(samples.rest[:, 1] - CROWN) < 0.002
    middle = 0.5 * (places[:, level].min(axis=1) + places[:, level].max(axis=1))
    up, right = middle[0] - places[0], places[1] - middle[1]
    sector = np.clip(np.rint(np.arctan2(up, right) / np.pi * SECTORS), 0, SECTORS).astype(int)
    high = np.flatnonzero(up > 0)
    high = high[np.argsort(np.hypot(up, right)[high])]
    outer = np.full(SECTORS + 1, -1)
    outer[sector[high]] = high  # the outermost one stays
    known = np.flatnonzero(outer >= 0)
    found = np.clip(parts.at(parts.inside, places[:, outer[known]]) * parts.cell, 0, MOST)
    even = ndimage.gaussian_filter1d(np.interp(np.arange(SECTORS + 1), known, found), EVENLY,
                                     mode="nearest")
    angle = np.clip(np.arctan2(np.maximum(up, 0), right) / np.pi * SECTORS, 0, SECTORS)
    return np.interp(angle, np.arange(SECTORS + 1), even)


def with_rims(parts: Parts, near: Float64) -> Parts:
    """The maps of a person whose hair goes on to the outline, and between strands.

    ``near`` [h, w] is the head's depth, NaN where it is not.
    """
    loose = (parts.inside > 0) & ~parts.hair & ~np.isfinite(near)
    return replace(parts, hair=parts.hair | thin(loose, parts.hair, RIM / parts.cell))


def _under(head: tuple[Float64, Float64], share: Float64, body: Piece | None,
           ) -> tuple[Float64, Float64]:
    """Depths [h, w] of what hair lies on, in front and behind; NaN where it hangs freely."""
    near, far = head
    if body is None:
        return near, far
    low = np.broadcast_to(share >= 1, near.shape)
    found = []
    for sign, squares, skull in ((-1, body.front, near), (1, body.back, far)):
        there = low & (squares > 0) & (True if body.ahead is None else body.ahead)
        surface = np.where(there, body.middle + sign * np.sqrt(np.maximum(squares, 0)),
                           np.nan)
        join = np.fmin if sign < 0 else np.fmax
        found.append(np.asarray(join(skull, surface), np.float64))
    return found[0], found[1]


def _front(parts: Parts, hair: Bool, middle: Float64, before: Float64, share: Float64,
           sensed: Sensed | None, outer: Float64) -> Float64:
    """Squares of the half thicknesses before the hair's ``outer`` depth: what the photo shows."""
    cell, person, solid = parts.cell, parts.inside > 0, np.isfinite(before)
    # At the hairline it begins on the skin; further in it lies clear of the skull.
    skin = person & ~hair
    low = np.maximum(middle - before, 0)
    given = np.where(skin & solid, low ** 2, np.nan)
    ramp = np.clip(ndimage.distance_transform_edt(~skin) * cell / RAMP, 0, 1) * CLEAR
    least = np.where(solid, low + ramp, 0.0)
    least = np.fmax(least, middle - outer) ** 2
    least *= np.clip(parts.inside * cell / CLEAR, 0, 1) ** 2
    if sensed is not None:
        given = hair_squares(sensed, middle, hair, given, cell)
        least[hair & np.isfinite(sensed.depth)] = 0.0  # the skull under it is a guess
    found = inflated(hair, parts.inside, cell, source=4.0, given=given, least=least,
                     free=skin & ~solid)
    # Before neck and body it is no thicker than locks are.
    thick = np.sqrt(np.maximum(found, 0))
    base = cv2.GaussianBlur(filled(np.where(solid, low, np.nan), 3.0), (0, 0), 3.0)
    more = np.maximum(thick - base, 0)
    bounded = np.minimum(thick, base) + more / np.sqrt(1 + (more / LOCK) ** 2)
    bounded = thick + share * (bounded - thick)
    hung = _hung(parts, hair, middle, bounded)
    if sensed is None:
        return np.asarray(hung ** 2)
    return np.asarray(np.where(np.isfinite(sensed.depth), thick, hung) ** 2)


def _hung(parts: Parts, hair: Bool, middle: Float64, thick: Float64) -> Float64:
    """Half thicknesses [h, w] in front of strands that hang down straight.

    What lies flush with cheeks and chin alone would follow each of their bends.
    """
    reach = round(HANGING / parts.cell)
    ahead = np.where(hair, thick - middle, -1e3)
    straight = ndimage.grey_closing(ahead, (2 * reach + 1, 1))
    known = hair.astype(np.float64)
    even = ndimage.gaussian_filter1d(np.where(hair, straight, 0.0), 0.25 * reach, axis=0)
    even /= np.maximum(ndimage.gaussian_filter1d(known, 0.25 * reach, axis=0), 1e-6)
    even = np.maximum(even, _falling(np.maximum(even, ahead), hair, FALL * parts.cell))
    more = np.maximum(np.maximum(even, ahead) - ahead, 0)
    way = np.clip(parts.inside * parts.cell / (2 * RAMP), 0, 1)
    return np.where(hair, thick + way * way * (3 - 2 * way) * more, thick)


def _falling(ahead: Float64, hair: Bool, slope: float) -> Float64:
    """How far ahead [h, w] hair is at least that falls from what lies above, row by row."""
    out = np.where(hair, ahead, -1e3)
    for row in range(1, len(out)):
        # A lock is a few cells wide: what falls beside its edge goes on there.
        above = ndimage.maximum_filter1d(out[row - 1], 3)
        out[row] = np.where(hair[row], np.maximum(out[row], above - slope), -1e3)
    return out


def _back(parts: Parts, domain: Bool, middle: Float64, behind: Float64, last: float,
          share: Float64) -> Float64:
    """Squares of the half thicknesses behind; ``last`` is the depth of the skull's back."""
    cell, solid = parts.cell, np.isfinite(behind)
    ramp = np.clip(ndimage.distance_transform_edt(domain) * cell / RAMP, 0, 1) * CLEAR
    least = np.where(solid, np.maximum(behind - middle, 0) + ramp, 0.0)
    least *= np.clip(parts.inside * cell / CLEAR, 0, 1)
    found = inflated(domain, parts.inside, cell, source=4.0, least=least ** 2)
    # Below the skull it falls straight down.
    thick = np.sqrt(np.maximum(found, 0))
    most = np.maximum(last - middle, 0.05)
    straight = thick * (1 + (thick / most) ** 4) ** -0.25
    thick = np.maximum(thick + share * (straight - thick), least)
    # Where the body begins there is no step.
    known = domain.astype(np.float64)
    wide = [cv2.GaussianBlur(one, (0, 0), EVEN / cell) for one in (known * thick, known)]
    even = np.maximum(wide[0] / np.maximum(wide[1], 1e-6), least)
    even *= np.clip(parts.inside * cell / RAMP, 0, 1) ** 0.5
    return np.where(domain, (thick + share * (np.maximum(even, least) - thick)) ** 2, 0.0)


def _behind(parts: Parts, hair: Bool, grown: Bool, neck: Neck) -> Bool:
    """Where hair covers the back: where it grows, and where long hair hangs down from there."""
    person = parts.inside > 0
    scalp = grown & person
    rows, columns = np.indices(hair.shape)
    middle = 0.5 * (neck.left + neck.right)
    first = _row_of(parts, NAPE)
    ends, edges = [], []
    for right in (False, True):
        side = columns > middle if right else columns < middle
        beyond = columns > neck.right if right else columns < neck.left
        strand = hair & side & (rows >= first) & (rows < parts.bottom)
        end = _end(strand.sum(axis=1) > 2, first) if (strand & beyond).any() else first
        shown = np.flatnonzero((strand & (rows <= end)).any(axis=0)) if end > first else (
            np.flatnonzero((scalp & side).any(axis=0)))
        ends.append(end)
        edges.append(middle if not len(shown) else float(shown[-1 if right else 0]))
    if max(ends) <= first:
        return hair | scalp
    # Between the strands of both sides, down to a line from one's end to the other's.
    start = int(np.argmax(scalp.any(axis=1)))
    grows = hair | scalp
    left = _edge(grows & (columns < middle), start, ends[0], edges[0], False)
    right_edge = _edge(grows & (columns > middle), start, ends[1], edges[1], True)
    way = np.clip((np.arange(hair.shape[1]) - edges[0]) / max(edges[1] - edges[0], 1.0), 0, 1)
    last = ends[0] + way * (ends[1] - ends[0]) + 4 * way * (1 - way) * CURVE / parts.cell
    mane = (columns >= left[:, None]) & (columns <= right_edge[:, None]) & (rows <= last[None])
    mane &= (rows >= start) & person
    out = np.where(rows > neck.end, mane, grows | mane)
    return np.asarray(cv2.GaussianBlur(out.astype(np.float32), (0, 0), 2.0) > 0.5) & person


def _edge(shown: Bool, start: int, end: int, last: float, right: bool) -> Float64:
    """A side's outermost column of hair in each row: straight on, or ``last`` below ``end``."""
    rows = np.arange(len(shown))
    found = np.flatnonzero(shown.any(axis=1) & (rows >= start) & (rows <= end))
    outer = np.argmax(shown[found], axis=1)
    if right:
        outer = shown.shape[1] - 1 - np.argmax(shown[found, ::-1], axis=1)
    return np.asarray(np.interp(rows, np.append(found, end + 1), np.append(outer, last)))


def _end(shown: Bool, first: int) -> int:
    """The last row of a strand that begins about a row, of rows that show it."""
    last = first
    for row in np.flatnonzero(shown):
        if row - last > GAP + 1:
            break
        last = int(row)
    return last


def _row_of(parts: Parts, height: float) -> int:
    """The row of a height at the head's depth."""
    rows = np.arange(len(parts.inside))
    middle = np.full(len(rows), parts.camera.center[0, 0])
    rays = parts.camera.rays(0, np.stack([middle, rows + 0.5], axis=1))
    level = rays[0][:, 1] - rays[0][:, 2] / rays[1][:, 2] * rays[1][:, 1]
    return int(np.argmax(level <= height)) if (level <= height).any() else len(rows)


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
    good = (SMALLEST < radius * parts.cell < LARGEST and off < ROUND * radius
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
    return Piece(found, found, np.full(domain.shape, _knot_depth(parts, knot, samples)))


def _knot_depth(parts: Parts, knot: Knot, samples: MeshSamples) -> float:
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
