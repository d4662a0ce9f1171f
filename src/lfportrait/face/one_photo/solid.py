"""The solid of a person behind one photo: head, hair and body, each inflated apart and joined.

The head is the fitted model. Hair, a knot of it and body are pieces of the matte, inflated to both
sides of a middle depth (`piece`); the distance from such a piece is that of q - (z - middle)^2 to
zero, which is smooth across its outline. Hair begins flush with the skin at the hairline and stays
clear of the skull; a knot stands behind the crown; the body begins at the model's neck.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.morphology import convex_hull_image

from ...arrays import Bool, Float64
from .beard import BEARD, beard_piece
from .collar import NECK_END
from .depth import Sensed, hair_before, middle_behind, smoothed
from .hair import Neck, grown_out, hair_piece, knot_of, knot_piece, with_rims, without_knot
from .parts import Parts, opened
from .piece import METRES, Piece, inflated, outside
from .samples import MeshSamples, depth_maps

HEAD, HAIR, BODY, WORN = range(4)
"""What a place of the surface belongs to."""
CHEST = 0.10 / METRES  # Half the thickness of a body at most.
BACK = 0.05  # How much farther behind than a scalp ears and a neck may lie, portrait units.
NECK_TOP = -0.006  # Height above the model's chin (metres) below which there is neck alone.
JOINT, AROUND = 0.018, 0.25
"""How far down from there (metres) the model's neck goes over into the body, which it does within
this height of the joint's upper end, portrait units."""
ALIKE = 0.10
"""How far apart, at most, the two are where one goes over into the other; what lies twice so far
from the model's neck is no neck, but a collar or a shoulder beside it, portrait units."""
SOFT_HAIR = 0.008  # Width of the joint of head and hair, portrait units.
SOFT_BEARD = 0.04  # And of head and beard.
WITHIN = 0.12  # How far within the outline of hair a body under it ends, portrait units.
BAND = 0.06  # How far from the outline the model says how thick the neck is, portrait units.
SHOULDERS, SLOPE = 0.30, 0.35
"""How far behind the neck's middle the shoulders' lies, and how far from it it does, portrait
units: a neck leans forward, and runs out to the shoulders behind."""
BROAD = 0.07  # What is twice so broad beside a head is a shoulder, portrait units.
LOWEST = -1.35  # Nothing lies lower.
HAIRLINE = np.array([(-0.12, 0.055), (-0.09, 0.055), (-0.065, 0.08), (-0.05, 0.105),
                     (-0.04, 0.113), (-0.02, 0.113), (-0.005, 0.098), (0.004, 0.094),
                     (0.012, 0.110), (0.025, 0.150), (0.045, 0.172), (0.07, 0.190), (0.12, 0.20)])
"""Depths and heights (metres, `HeadPrior.rest`) of the line above which a head has hair: from the
nape behind and close over the ears to the temples and the forehead."""
JAW = np.array([[0.002, 0.060], [0.010, 0.037], [0.027, 0.020], [0.042, 0.013], [0.061, 0.003]])
"""Depths (forward) and heights of the jaw's edge on the mean head, metres."""
SKULL = np.array([(0.05, 0.064), (0.07, 0.0695), (0.09, 0.0735), (0.11, 0.0767), (0.13, 0.079)])
"""Heights, and how far from the middle a head's sides lie there below its ears (metres,
`HeadPrior.rest`)."""
DARK, HOLLOW = 0.04, 17
"""Metres deep in an ear at which a third of the light is left; what is no wider than so many
millimeters is hollow."""
EVEN = 0.015  # Over so much a neck's thickness is smoothed, portrait units.
ROUNDED = 0.015  # Over so much the edges of raised shoulders are smoothed, portrait units.
LEANING = 0.2  # How much lower a neck may end on one side, portrait units.
STANDS = 0.0025  # What stands out by more is ear, metres.


@dataclass(frozen=True)
class Solid:
    """A person as a signed distance."""

    parts: Parts  # The maps.
    head: MeshSamples  # Samples of the head.
    # hair, body: Inflated pieces, or None.
    hair: Piece | None
    body: Piece | None
    neck: Float64  # float64 [4]: a plane (normal, height) below which the head's model ends.
    lowest: float  # Height of the plane that ends the bust.
    # float64 [h, w], depth before which nothing of the head lies (`hair_before`), or None.
    before: Float64 | None = None
    beard: Piece | None = None  # Below the jaw.
    knot: Piece | None = None  # Of hair, above the head.
    # float64 [h, w], how far beside shoulders that reach higher than the neck, portrait units.
    raised: Float64 | None = None

    def distance(self, points: Float64, reach: float, near: Bool | None = None,
                 ) -> tuple[Float64, NDArray[np.uint8]]:
        """Signed distances of points [N, 3], positive outside, and what is nearest, uint8 [N].

        Distances from the head of ``reach`` or more are infinite, as those of points that are not
        ``near``, bool [N].
        """
        head = np.full(len(points), np.inf)
        asked = np.ones(len(points), bool) if near is None else near
        places, depth = self.parts.places(points)
        above = points @ self.neck[:3] - self.neck[3]
        nearest = np.zeros(len(points), np.int64)
        head[asked], nearest[asked] = self.head.nearest(points[asked], reach)
        owner = np.full(len(points), HEAD, np.uint8)
        if self.body is None:
            head = np.maximum(head, -above)
        else:
            joint = asked & (np.abs(above) < AROUND)
            wider = joint & ~np.isfinite(head)
            head[wider], nearest[wider] = self.head.nearest(points[wider], 2 * ALIKE)
            joint &= np.abs(head) < 2 * ALIKE
            # How far down the model's own neck a place lies, from 0 to 1.
            way = (above < 0).astype(np.float64)
            rest = self.head.rest[nearest[joint], 1]
            way[joint] = np.clip((NECK_END - rest) / JOINT, 0, 1)
            body = self.body.distance(self.parts, places, depth)
            head, of_body = _one_neck(head, body, way, above)
            owner[of_body] = BODY
            if self.raised is not None:
                raised = np.maximum(body, Parts.at(self.raised, places))
                high = raised < head
                head[high], owner[high] = raised[high], BODY
        if self.before is not None:
            head = np.maximum(head, Parts.at(self.before, places) - depth)
        out = head
        for piece in (self.hair, self.knot):
            if piece is not None:
                hair = piece.distance(self.parts, places, depth)
                owner[(hair < out) & piece.covers(places, depth)] = HAIR
                out = _joined(out, hair, SOFT_HAIR)
        if self.beard is not None:
            beard = self.beard.distance(self.parts, places, depth)
            owner[(beard < out) & self.beard.covers(places, depth)] = BEARD
            out = _joined(out, beard, SOFT_BEARD)
        return np.maximum(out, self.lowest - points[:, 1]), owner


def _joined(one: Float64, two: Float64, width: float) -> Float64:
    """The union of two signed distances, rounded where they meet (a polynomial minimum)."""
    both = np.isfinite(one) & np.isfinite(two)
    out = np.minimum(one, two)
    share = np.clip(1 - np.abs(one[both] - two[both]) / width, 0, 1)
    out[both] -= 0.25 * width * share ** 2
    return out


def _one_neck(head: Float64, body: Float64, way: Float64, above: Float64) -> tuple[Float64, Bool]:
    """The distance of a head whose neck goes over into a body's, and what is body's, [N].

    Each would end there with a ledge, as both are only about as thick as a neck: over a joint the
    surface goes over from one to the other instead. A collar or a shoulder beside it stays, up to
    the joint's upper end.

    Parameters
    ----------
    head, body : Signed distances.
    way : 0 where the head is all there is, 1 where the body is, in the joint in between.
    above : Heights over the joint's upper end.
    """
    share = way * way * (3 - 2 * way)
    beside = np.maximum(body, above)
    out = beside.copy()
    both = np.isfinite(head) & np.isfinite(body)
    one, two, apart = head[both], body[both], beside[both]
    alike = np.clip(2 - np.abs(one - two) / ALIKE, 0, 1)
    out[both] += alike * (one + share[both] * (two - one) - apart)
    # Of the head nothing goes where it is all there is, and what is beside it ends smoothly.
    whole = way == 0
    out[whole] = np.minimum(head[whole], out[whole])
    return out, (way >= 0.5) | (beside < head - np.where(whole, 0.2, 1.0) * ALIKE)


def solid_of(parts: Parts, samples: MeshSamples, sensed: Sensed | None = None,
             clothes: Bool | None = None) -> Solid:
    """The solid of a person.

    Parameters
    ----------
    samples : Of the head, warped to the photo.
    sensed : The photo's own depth, where it has one.
    clothes : bool [h, w], where the photo shows any, if that is known.
    """
    near, far = depth_maps(samples, parts)
    knot = None
    if parts.hair.any():
        parts = with_rims(parts, near)
        found = knot_of(parts, near)
        if found is not None:
            knot = knot_piece(parts, found, samples)
            parts = without_knot(parts, found)
    height = samples.rest[:, 1]
    band = (height < NECK_TOP) & (height > NECK_END - 1.2 * JOINT)
    end = samples.points[np.abs(height - NECK_END) < 0.0015]
    neck = _plane(end)
    place = Neck.of(parts, samples)
    raised = _raised(parts, near, place, clothes)
    front = np.isfinite(depth_maps(samples, parts, height > NECK_TOP)[0])
    body = _body(parts, near, raised, front, depth_maps(samples, parts, band), end, sensed)
    hair = None
    if parts.hair.any():
        grown = depth_maps(samples, parts, scalp(samples.rest))[1]
        ears = np.isfinite(depth_maps(samples, parts, _ears(samples.rest))[0])
        outer = depth_maps(grown_out(parts, samples, near, scalp(samples.rest)), parts)
        # Where the back of the head, or what lies just before it, is scalp.
        hair = hair_piece(parts, (near, far), (grown > far - BACK) & ~ears,
                          place, body, sensed, outer)
    beard = None
    if parts.beard is not None:
        # Below a chin that is held up the nape is as high as the jaw, and no part of it.
        face = depth_maps(samples, parts, above_jaw(samples.rest))[0]
        beard = beard_piece(parts, parts.beard, face, _down(parts, samples), body)
    before = None if sensed is None else hair_before(sensed, parts.hair)
    return Solid(parts, samples, hair, body, neck, _end(parts, body), before, beard,
                 knot, _beside(raised, parts.cell) if raised.any() else None)


def _down(parts: Parts, samples: MeshSamples) -> Float64:
    """The direction (row, column) from a face's brows to its chin in the maps, of length 1."""
    front = (np.abs(samples.rest[:, 0]) < 0.01) & (samples.rest[:, 2] > 0.05)
    ends = []
    for low, high in ((0.0, 0.01), (0.09, 0.10)):
        chosen = front & (samples.rest[:, 1] > low) & (samples.rest[:, 1] < high)
        ends.append(parts.places(samples.points[chosen])[0].mean(axis=1))
    down = ends[0] - ends[1]
    return np.asarray(down / np.linalg.norm(down))


def scalp(rest: Float64) -> Bool:
    """Where hair grows, bool [N], of places [N, 3] on the mean head (`HeadPrior.rest`)."""
    return np.asarray((rest[:, 1] > np.interp(rest[:, 2], *HAIRLINE.T)) & ~_ears(rest))


def above_jaw(rest: Float64, lower: float = 0.0) -> Bool:
    """What lies above the jaw's edge, or so much ``lower``, of places [N, 3] on the mean head."""
    return np.asarray(rest[:, 1] > np.interp(rest[:, 2], *JAW.T) - lower)


def standing_out(rest: Float64) -> Float64:
    """How far ears stand out at places [N, 3] on the mean head, metres [N]; 0 elsewhere."""
    out = np.maximum(np.abs(rest[:, 0]) - np.interp(rest[:, 1], *SKULL.T), 0)
    within = (rest[:, 1] > 0.05) & (rest[:, 1] < 0.14) & (rest[:, 2] > -0.055)
    front = np.clip((0.002 - rest[:, 2]) / 0.008, 0, 1)
    return np.asarray(np.where(within, out * front, 0.0))


def _ears(rest: Float64) -> Bool:
    """What is ear, bool [N], of places [N, 3] on the mean head."""
    return standing_out(rest) > STANDS


def ear_light(rest: Float64, places: Float64) -> Float64:
    """How bright places [N, 3] of the mean head are beside a mean over its ears, [N].

    The deeper a place lies between what stands out around it, the less light reaches it. Beside
    ears it is 1. ``rest`` are samples [M, 3] of the head.
    """
    low, step, size = np.array([0.04, -0.07]), 0.001, (111, 91)
    hull = np.zeros((2, *size))

    def cells(points: Float64) -> tuple[NDArray[np.int64], ...]:
        row, column = np.rint((points[:, 1:] - low) / step).astype(np.int64).T
        return ((points[:, 0] > 0).astype(np.int64), np.clip(row, 0, size[0] - 1),
                np.clip(column, 0, size[1] - 1))

    def reaching(points: Float64) -> Float64:
        height, depth = points[:, 1], points[:, 2]
        border = np.minimum(np.minimum(height - 0.048, 0.145 - height),
                            np.minimum(depth + 0.052, 0.004 - depth))
        # On the head itself light fades in.
        border = np.minimum(border, np.abs(points[:, 0]) - np.interp(height, *SKULL.T) + 0.012)
        deep = np.maximum(hull[cells(points)] - np.abs(points[:, 0]), 0)
        return np.asarray(np.exp(-deep * np.clip(border / 0.008, 0, 1) / DARK))

    np.maximum.at(hull, cells(rest), np.abs(rest[:, 0]))
    for side in hull:
        side[:] = cv2.morphologyEx(side, cv2.MORPH_CLOSE, np.ones((HOLLOW, HOLLOW), np.uint8))
    ears = reaching(rest[_ears(rest)])
    if not len(ears):
        return np.ones(len(places))
    share = np.clip(standing_out(places) / (2 * STANDS), 0, 1)
    return np.asarray(reaching(places) * float(ears.mean()) ** -share)


def _plane(points: Float64) -> Float64:
    """A plane through points, upwards: normal and height [4]."""
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    normal = normal * (1.0 if normal[1] > 0 else -1.0)
    return np.append(normal, normal @ middle)


def _beside(part: Bool, cell: float) -> Float64:
    """How far cells [h, w] are beside a part, portrait units, less than 0 within; smoothed."""
    away = ndimage.distance_transform_edt(~part) - ndimage.distance_transform_edt(part)
    return np.asarray(cell * cv2.GaussianBlur(away, (0, 0), ROUNDED / cell), np.float64)


def _raised(parts: Parts, near: Float64, neck: Neck, clothes: Bool | None = None) -> Bool:
    """Where shoulders beside a head [h, w] reach higher than its neck, at most to its ears.

    Where most of one is clothed, what is not is neck.
    """
    beside = (parts.inside > 0) & ~parts.hair & ~np.isfinite(near)
    ears, end = (int(np.clip(row, 0, len(near) - 1)) for row in (neck.ears, neck.end))
    high = opened(beside, BROAD / parts.cell)
    high[:ears], high[end + 1:] = False, False
    pieces = ndimage.label(high)[0]
    # What is higher than ears is no shoulder, but somebody else's, or a chair.
    held = np.setdiff1d(pieces[end], np.append(pieces[ears], 0))
    high &= np.isin(pieces, held)
    if clothes is not None:
        worn = ndimage.mean(clothes, pieces, np.arange(pieces.max() + 1))
        high &= clothes | ~(np.asarray(worn) > 0.5)[pieces]
    # The neck of a head that leans ends lower on one side.
    lower = slice(end + 1, end + 1 + round(LEANING / parts.cell))
    high[lower] = beside[lower] & high[end]
    return high


def _body(parts: Parts, near: Float64, raised: Bool, front: Bool, band: tuple[Float64, Float64],
          end: Float64, sensed: Sensed | None) -> Piece | None:
    """Neck and shoulders as a piece that begins at the model's neck; ``front`` is the head's."""
    cell = parts.cell
    known = np.isfinite(band[0])
    if not known.any():
        return None
    top = int(np.flatnonzero(known.any(axis=1))[0])
    person = parts.inside > 0
    rows = np.arange(person.shape[0])[:, None]
    shoulders = person & ~parts.hair & ~np.isfinite(near) & (raised | (rows > top))
    # Below the band, the model's neck gives way.
    columns = known.any(axis=0)
    last = np.where(columns, known.shape[0] - 1 - np.argmax(known[::-1], axis=0), 10 ** 6)
    domain = shoulders | known | (person & ~parts.hair & (rows >= last[None]))
    if shoulders.any():
        covered = parts.hair & (parts.inside * cell > WITHIN) & (rows > top)
        domain |= convex_hull_image(shoulders | known) & covered
    # Seen along the neck its band is a ring.
    domain = ndimage.binary_opening(domain, np.ones((3, 3))) | known
    domain |= convex_hull_image(known) & person & ~parts.hair
    # From the model's nape on it recedes: downwards and to both sides.
    places, depths = parts.places(end)
    middle = 0.5 * float(depths.min() + depths.max())
    row, column = np.rint(places[:, depths > middle]).astype(int)
    height, width = person.shape
    nape = np.zeros(person.shape, bool)
    nape[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] = True
    away = ndimage.distance_transform_edt(~convex_hull_image(nape)) * cell / SLOPE
    away = np.clip(away, 0, 1)
    middles = middle + SHOULDERS * away * (2 - away)
    inside = np.where(known, np.maximum(parts.inside, 0.5), parts.inside)
    squares = []
    for side in range(2):
        # Seen from above or below, a cell may show one side of the neck alone.
        thickness = (middles - band[0], band[1] - middles)[side]
        thickness = smoothed(np.where(thickness > 0, thickness, np.nan), EVEN / cell)
        sure = (thickness > 0) & (parts.inside * cell > BAND)
        # The neck stays as thick as it is when all is bounded below.
        share = np.minimum(np.where(sure, thickness, 0.0) / CHEST, 0.95)
        given = np.where(sure, (CHEST * share) ** 2 * (1 - share ** 4) ** -0.5, np.nan)
        q = inflated(domain, inside, cell, source=2.0, given=given,
                     free=person & ~domain & ~parts.hair)
        thick = np.sqrt(np.maximum(q, 0))
        q = (thick * (1 + (thick / CHEST) ** 4) ** -0.25) ** 2
        squares.append(outside(q, parts, domain, 0.0))
    if sensed is not None:
        middles = middle_behind(sensed, np.where(domain, squares[0], 0), middles, known, cell)
    # There is none where hair alone hangs down, nor in a head: it would be torn beside a jaw.
    nearest = ndimage.distance_transform_edt(~person, return_distances=False, return_indices=True)
    there = ~((parts.hair | front) & person & ~domain)[tuple(nearest)]
    return Piece(squares[0], squares[1], middles, there, there)


def _end(parts: Parts, body: Piece | None) -> float:
    """The height of the photo's lower border, at the depth of the body's front there."""
    camera = parts.camera
    pixel = np.array([[camera.center[0, 0], parts.bottom - 1.0]])
    origin, ray = camera.rays(0, pixel)
    depth = float(np.linalg.norm(origin[0]))
    if body is not None:
        depth = float(np.nanmean(body.middle))
        row = int(np.clip(parts.bottom - 2, 0, len(body.front) - 1))
        front, middle = body.front[row], body.middle[row]
        if (front > 0).any():
            depth = float(np.median((middle - np.sqrt(np.maximum(front, 0)))[front > 0]))
    forward = camera.pose[0, :3, 2]
    end = origin[0] + ray[0] * depth / float(ray[0] @ forward)
    return max(float(end[1]), LOWEST)
