"""The solid of a person behind one photo: head, hair and body, each inflated apart and joined.

The head is the fitted model. Hair and body are pieces of the matte, inflated to both sides of a
middle depth (`relief`); the distance from such a piece is that of q - (z - middle)^2 to zero, which
is smooth across its outline. Hair begins flush with the skin at the hairline and stays clear of the
skull; the body begins at the model's neck.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.morphology import convex_hull_image

from .depth import Sensed, hair_before, hair_squares, middle_behind
from .parts import Parts
from .relief import inflated
from .samples import MeshSamples, depth_maps

__all__ = ["BODY", "HAIR", "HEAD", "WORN", "Piece", "Solid", "ear_light", "scalp",
           "solid_of", "standing_out"]

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

HEAD, HAIR, BODY, WORN = range(4)
"""What a place of the surface belongs to."""
METRES = 0.207
"""Of a unit of the portrait frame."""
CLEAR, RAMP = 0.010 / METRES, 0.025 / METRES
"""Hair stays so far outside of the skull, from so far behind the hairline on."""
CHEST = 0.10 / METRES
"""Half the thickness of a body at most."""
NAPE, BACK = -0.36, 0.05
"""Height below which hair that hangs down on both sides hangs down behind, too; how much farther
behind than a scalp ears and a neck may lie."""
NECK_TOP, NECK_END = -0.006, -0.015
"""Heights above the model's chin (metres) between which its neck goes over into the body's."""
JOINT, AROUND = 0.018, 0.25
"""How far down from there (metres) the model's neck goes over into the body, which it does within
this height of the joint's upper end, portrait units."""
ALIKE = 0.10
"""How far apart, at most, the two are where one goes over into the other; what lies twice so far
from the model's neck is no neck, but a collar or a shoulder beside it, portrait units."""
SOFT_HAIR = 0.008
"""Width of the joint of head and hair, portrait units."""
BAND = 0.06
"""How far from the outline the model says how thick the neck is, portrait units."""
SHOULDERS, SLOPE = 0.30, 0.35
"""How far behind the neck's middle the shoulders' lies, and how far from it it does, portrait
units: a neck leans forward, and runs out to the shoulders behind."""
LOWEST = -1.35
"""Nothing lies lower."""
HAIRLINE = np.array([(-0.12, 0.055), (-0.09, 0.055), (-0.065, 0.08), (-0.05, 0.105),
                     (-0.04, 0.113), (-0.02, 0.113), (-0.005, 0.098), (0.004, 0.094),
                     (0.012, 0.110), (0.025, 0.150), (0.045, 0.172), (0.07, 0.190), (0.12, 0.20)])
"""Depths and heights (metres, `HeadPrior.rest`) of the line above which a head has hair: from the
nape behind and close over the ears to the temples and the forehead."""
EDGE = 4
"""Cells beyond its part of the picture in which a surface may be a piece's: it is that thick."""
BESIDE = 1.5
"""Cells beyond its part of the picture up to which a piece goes on."""
SKULL = np.array([(0.05, 0.064), (0.07, 0.0695), (0.09, 0.0735), (0.11, 0.0767), (0.13, 0.079)])
"""Heights, and how far from the middle a head's sides lie there below its ears (metres,
`HeadPrior.rest`)."""
DARK, HOLLOW = 0.04, 17
"""Metres deep in an ear at which a third of the light is left; what is no wider than so many
millimeters is hollow."""
STANDS = 0.0025
"""What stands out by more is ear, metres."""


@dataclass(frozen=True)
class Piece:
    """An inflated piece of the picture."""

    # front, back: float64 [h, w], squares of its half thicknesses; negative outside.
    front: Float64
    back: Float64
    middle: Float64  # float64 [h, w], depth.
    # ahead, behind: bool [h, w], where it lies before the middle and behind it; None: wherever its
    # squares are positive. Elsewhere the squares only lead its surface out of sight.
    ahead: Bools | None = None
    behind: Bools | None = None

    def covers(self, places: Float64, depth: Float64) -> Bools:
        """Whether points may belong to it, [N]: by their places, with `EDGE` cells around."""
        if self.ahead is None or self.behind is None:
            return np.ones(len(depth), bool)
        size = np.array(self.middle.shape)[:, None] - 1
        row, column = np.clip(np.rint(places), 0, size).astype(int)
        ahead, behind = (ndimage.binary_dilation(part, np.ones((2 * EDGE + 1,) * 2))
                         for part in (self.ahead, self.behind))
        return np.asarray(np.where(depth < self.middle[row, column], ahead[row, column],
                                   behind[row, column]))

    def distance(self, parts: Parts, places: Float64, depth: Float64) -> Float64:
        """About how far points lie outside, [N], portrait units."""
        out = np.full(len(depth), np.inf)
        rows, columns = self.front.shape
        within = ((places > 2) & (places < np.array([[rows - 3], [columns - 3]]))).all(axis=0)
        at, z = places[:, within], depth[within]
        away = z - Parts.at(self.middle, at)
        ahead = away < 0
        value, slope = np.empty(len(z)), np.zeros((len(z), 2))
        for side, squares in ((ahead, self.front), (~ahead, self.back)):
            value[side] = Parts.at(squares, at[:, side])
            for k, part in enumerate(np.gradient(squares)):
                slope[side, k] = Parts.at(part, at[:, side]) / parts.cell
        value = value - away ** 2
        length = np.sqrt((slope ** 2).sum(axis=1) + 4 * away ** 2)
        found = -value / np.maximum(length, 0.02)
        # It would else fill what lies beside it, as the space behind an ear.
        for side, part in ((ahead, self.ahead), (~ahead, self.behind)):
            if part is not None:
                beyond = ndimage.distance_transform_edt(~part) - BESIDE
                found[side] = np.maximum(found[side],
                                         Parts.at(beyond, at[:, side]) * parts.cell)
        out[within] = found
        return out


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

    def distance(self, points: Float64, reach: float, near: Bools | None = None,
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
        if self.before is not None:
            head = np.maximum(head, Parts.at(self.before, places) - depth)
        out = head
        if self.hair is not None:
            hair = self.hair.distance(self.parts, places, depth)
            owner[(hair < out) & self.hair.covers(places, depth)] = HAIR
            out = _joined(out, hair, SOFT_HAIR)
        return np.maximum(out, self.lowest - points[:, 1]), owner


def _joined(one: Float64, two: Float64, width: float) -> Float64:
    """The union of two signed distances, rounded where they meet (a polynomial minimum)."""
    both = np.isfinite(one) & np.isfinite(two)
    out = np.minimum(one, two)
    share = np.clip(1 - np.abs(one[both] - two[both]) / width, 0, 1)
    out[both] -= 0.25 * width * share ** 2
    return out


def _one_neck(head: Float64, body: Float64, way: Float64, above: Float64) -> tuple[Float64, Bools]:
    """The distance of a head whose neck goes over into a body's, and what is body's, [N].

    Each would end there with a ledge, as both are only about as thick as a neck: over a joint the
    surface goes over from one to the other instead. A collar or a shoulder beside it stays.

    Parameters
    ----------
    head, body : Signed distances.
    way : 0 where the head is all there is, 1 where the body is, in the joint in between.
    above : Heights over the joint's upper end.
    """
    out = np.where(way > 0, body, head)
    within = (way > 0) & (way < 1)
    one, two, share = head[within], body[within], way[within]
    share = share * share * (3 - 2 * share)
    apart = np.maximum(two, above[within])
    both = np.isfinite(one) & np.isfinite(two)
    alike = np.clip(2 - np.abs(one[both] - two[both]) / ALIKE, 0, 1)
    apart[both] += alike * (one[both] + share[both] * (two[both] - one[both]) - apart[both])
    out[within] = apart
    return out, (way >= 0.5) | (within & (body < head - ALIKE))


def solid_of(parts: Parts, samples: MeshSamples, sensed: Sensed | None = None) -> Solid:
    """The solid of a person.

    Parameters
    ----------
    samples : Of the head, warped to the photo.
    sensed : The photo's own depth, where it has one.
    """
    near, far = depth_maps(samples, parts)
    height = samples.rest[:, 1]
    band = (height < NECK_TOP) & (height > NECK_END - 1.2 * JOINT)
    end = samples.points[np.abs(height - NECK_END) < 0.0015]
    neck = _plane(end)
    hair = None
    if parts.hair.any():
        grown = depth_maps(samples, parts, scalp(samples.rest))[1]
        ears = np.isfinite(depth_maps(samples, parts, _ears(samples.rest))[0])
        # Where the back of the head, or what lies just before it, is scalp.
        hair = _hair(parts, near, far, (grown > far - BACK) & ~ears, sensed)
    body = _body(parts, near, depth_maps(samples, parts, band), end, sensed)
    before = None if sensed is None else hair_before(sensed, parts.hair)
    return Solid(parts, samples, hair, body, neck, _end(parts, body), before)


def scalp(rest: Float64) -> Bools:
    """Where hair grows, bool [N], of places [N, 3] on the mean head (`HeadPrior.rest`)."""
    return np.asarray((rest[:, 1] > np.interp(rest[:, 2], *HAIRLINE.T)) & ~_ears(rest))


def standing_out(rest: Float64) -> Float64:
    """How far ears stand out at places [N, 3] on the mean head, metres [N]; 0 elsewhere."""
    out = np.maximum(np.abs(rest[:, 0]) - np.interp(rest[:, 1], *SKULL.T), 0)
    within = (rest[:, 1] > 0.05) & (rest[:, 1] < 0.14) & (rest[:, 2] > -0.055)
    front = np.clip((0.002 - rest[:, 2]) / 0.008, 0, 1)
    return np.asarray(np.where(within, out * front, 0.0))


def _ears(rest: Float64) -> Bools:
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


def _filled(values: Float64, sigma: float) -> Float64:
    """A map [h, w] with its unknown (NaN) places filled smoothly from those around them."""
    known = np.isfinite(values)
    out = np.where(known, values, 0.0)
    total = known.astype(np.float64)
    result, done = values.copy(), known
    while not done.all() and sigma < 4 * max(values.shape):
        up, weight = (cv2.GaussianBlur(one, (0, 0), sigma) for one in (out, total))
        fresh = ~done & (weight > 1e-3)
        result[fresh] = up[fresh] / weight[fresh]
        done = done | fresh
        sigma *= 2
    result[~done] = np.nanmean(values)
    return np.asarray(result)


def _outside(squares: Float64, parts: Parts, domain: Bools, dip: float) -> Float64:
    """Squares continued beyond their domain, so that their slopes stay those of a surface.

    Outside of the person they are negative, as steep as within: those of the place's mirror image
    across the outline. Elsewhere the half thickness goes on, less by ``dip`` times the way.
    """
    distance, nearest = ndimage.distance_transform_edt(~domain, return_indices=True)
    thick = np.sqrt(np.maximum(squares, 0))[tuple(nearest)] - dip * distance * parts.cell
    out = np.where(domain, squares, np.sign(thick) * thick ** 2)
    row, column = np.mgrid[:squares.shape[0], :squares.shape[1]].astype(np.float32)
    outline = parts.inside
    down, across = np.gradient(outline)
    length = np.maximum(np.hypot(down, across), 0.3)
    way = np.minimum(-2 * outline, 40.0)
    x, y = column + across / length * way, row + down / length * way
    mirrored = cv2.remap(out.astype(np.float32), x.astype(np.float32), y.astype(np.float32),
                         cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    beyond = ~domain & (outline <= 0)
    out[beyond] = np.minimum(-np.abs(mirrored[beyond]), -1e-7)
    return np.asarray(out, np.float64)


def _hair(parts: Parts, near: Float64, far: Float64, grown: Bools, sensed: Sensed | None) -> Piece:
    """Hair as a piece: in front what the photo shows, behind the back of the head."""
    cell = parts.cell
    middle = np.asarray(cv2.GaussianBlur(_filled(0.5 * (near + far), 6.0), (0, 0), 8.0), np.float64)
    person, skull = parts.inside > 0, np.isfinite(near)
    hair = parts.hair & person
    # At the hairline it begins on the skin; further in it lies clear of the skull.
    skin = person & ~hair
    given = np.where(skin & skull, np.maximum(middle - near, 0) ** 2, np.nan)
    ramp = np.clip(ndimage.distance_transform_edt(~skin) * cell / RAMP, 0, 1) * CLEAR
    least = np.where(skull, np.maximum(middle - near, 0) + ramp, 0.0) ** 2
    rim = np.clip(parts.inside * cell / CLEAR, 0, 1)
    least *= rim ** 2
    if sensed is not None:
        given = hair_squares(sensed, middle, hair, given, cell)
        least[hair & np.isfinite(sensed.depth)] = 0.0  # the skull under it is a guess
    front = inflated(hair, parts.inside, cell, source=4.0, given=given, least=least,
                     free=skin & ~skull)
    behind = _behind(parts, hair, grown)
    rim = np.clip(ndimage.distance_transform_edt(behind) * cell / RAMP, 0, 1)
    deep = np.where(skull, np.maximum(far - middle, 0) + rim * CLEAR, 0.0)
    deep *= np.clip(parts.inside * cell / CLEAR, 0, 1)
    back = inflated(behind, parts.inside, cell, source=4.0, least=np.nan_to_num(deep) ** 2)
    return Piece(_outside(front, parts, hair, 1.0), _outside(back, parts, behind, 1.0), middle,
                 hair, behind)


def _behind(parts: Parts, hair: Bools, grown: Bools) -> Bools:
    """Where hair covers the back of the head: where it grows, and between long strands."""
    height = hair.shape[0]
    rows = np.arange(height)
    middle = parts.camera.center[0, 0]
    # The height of each row at the head's depth, by the camera.
    rays = parts.camera.rays(0, np.stack([np.full(height, middle), rows + 0.5], axis=1))
    depth = -rays[0][:, 2] / rays[1][:, 2]
    level = rays[0][:, 1] + depth * rays[1][:, 1]
    out = hair | (grown & (parts.inside > 0))
    for row in np.flatnonzero(level <= NAPE):
        columns = np.flatnonzero(hair[row])
        if len(columns) and columns[0] < middle < columns[-1]:
            out[row, columns[0]:columns[-1] + 1] |= parts.inside[row, columns[0]:
                                                                 columns[-1] + 1] > 0
    return np.asarray(out)


def _body(parts: Parts, near: Float64, band: tuple[Float64, Float64], end: Float64,
          sensed: Sensed | None) -> Piece | None:
    """Neck and shoulders as a piece that begins at the model's neck."""
    cell = parts.cell
    known = np.isfinite(band[0])
    if not known.any():
        return None
    top = int(np.flatnonzero(known.any(axis=1))[0])
    person = parts.inside > 0
    rows = np.arange(person.shape[0])[:, None]
    shoulders = person & ~parts.hair & ~np.isfinite(near) & (rows > top)
    # Below the band, the model's neck gives way.
    columns = known.any(axis=0)
    last = np.where(columns, known.shape[0] - 1 - np.argmax(known[::-1], axis=0), 10 ** 6)
    domain = shoulders | known | (person & ~parts.hair & (rows >= last[None]))
    if shoulders.any():
        domain |= convex_hull_image(shoulders | known) & person & parts.hair & (rows > top)
    domain = ndimage.binary_opening(domain, np.ones((3, 3))) | known
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
        sure = (thickness > 0) & (parts.inside * cell > BAND)
        # The neck stays as thick as it is when all is bounded below.
        share = np.minimum(np.where(sure, thickness, 0.0) / CHEST, 0.95)
        given = np.where(sure, (CHEST * share) ** 2 * (1 - share ** 4) ** -0.5, np.nan)
        q = inflated(domain, inside, cell, source=2.0, given=given, free=person & ~domain)
        thick = np.sqrt(np.maximum(q, 0))
        q = (thick * (1 + (thick / CHEST) ** 4) ** -0.25) ** 2
        squares.append(_outside(q, parts, domain, 0.0))
    if sensed is not None:
        middles = middle_behind(sensed, np.where(domain, squares[0], 0), middles, known, cell)
    return Piece(squares[0], squares[1], middles)


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
