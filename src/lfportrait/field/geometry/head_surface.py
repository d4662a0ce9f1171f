"""The surface of a head and bust from photos that do not go around it (docs/reconstruction.md).

Photos of a narrow arc leave depth open: a field that starts from their visual hull explains them by
a relief of any depth. So the surface is found first, as distances along the rays of a chart
(`lfportrait.field.geometry.chart`) around the middle of the bust:

1. a generic bust, scaled to the face's landmarks;
2. where the outlines of the mattes touch it, the visual hull;
3. in front, surface sweeps (`SurfaceSweep`): the surface is moved outwards and inwards step by
   step, the photos are looked up at each place, and where they agree best it stays; what counts is
   their normalised cross-correlation with their mean, as a likelihood. This is a plane sweep
   (Collins 1996) along the surface instead of along planes, with all photos at once.

What is looked for is the logarithm of the ratio to the generic bust, as a plate that bends as
little as the data allows: where no photo shows anything, the bust goes on in proportion.

The bust is a stack of superellipses, one a height, with an ellipsoid above the brows, in the
portrait frame, whose unit is 1.8 times the height from the eyes to the chin (about 0.21 m). The
sizes are an average adult's (head 0.155 m wide, 0.197 m long; neck 0.38 m around; shoulders 0.48
m).

A knot of hair behind a head shows only above it, and a sweep finds none. The space that most mattes
show beside the surface, and none rules out, is a spindle along the middle direction of the arc,
widest where the knot is. What is seen of it is taken for the top of a ball, whose rows tell its
radius roughly; then rays at all outlines are made to touch the ball.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy import ndimage
from scipy.optimize import least_squares

from ...arrays import Bool, Float32, Float64, Int64, UInt8, box_about
from ...capture import Camera, Capture, lattice_votes, portrait_frame_from_landmarks
from ...simd.threads import side_by_side
from ..kernels.depth_maps import facing_cosines, hull_along_rays, surface_agreement
from .chart import (
    Chart,
    at_places,
    fitted_plate,
    normals_of,
    rays_around,
    roughly_fitted_plate,
    smoothed,
)
from .sweep import stacked

_BLOCKS = 200  # Of pixels in a row and in a column, at most, when what hides what is looked for.
BROWS = 0.10  # Height of the brows: above it lies the skull's ellipsoid.
CHIN = -0.60  # Height of the chin's lowest point.
LOWEST = -1.8  # Height at which the bust ends.

_SECTIONS = np.array([
    # height, half width, front, back
    (-1.80, 1.15, 0.36, -0.66),
    (-1.40, 1.15, 0.30, -0.66),
    (-1.15, 1.08, 0.20, -0.64),
    (-1.00, 0.92, 0.10, -0.60),
    (-0.90, 0.66, 0.06, -0.54),
    (-0.80, 0.42, 0.08, -0.47),
    (-0.70, 0.30, 0.16, -0.43),
    (-0.60, 0.29, 0.38, -0.42),
    (-0.56, 0.29, 0.47, -0.42),
    (-0.50, 0.31, 0.50, -0.42),
    (-0.35, 0.35, 0.51, -0.46),
    (-0.20, 0.38, 0.49, -0.51),
    (0.00, 0.39, 0.44, -0.54),
    (0.10, 0.39, 0.46, -0.54),
])
_CROWN = 0.57  # Height of the crown.
_ROUND, _SQUARE = 2.0, 2.6  # Exponents of the superellipses of a head and of a chest.


def bust_chart(cell: float, middle: float = 0.0, frame: Float64 | None = None,
               lowest: float = LOWEST) -> Chart:
    """Rays around the middle of the bust (`Chart`): rows ``cell`` apart from ``lowest`` on.

    In portrait units, about x = ``middle``; ``frame`` float64 [4, 4] is the similarity from the
    world to the portrait frame.
    """
    heights = np.arange(lowest, BROWS, cell)
    heights += BROWS - heights[-1]
    # A shelf such as a chin must not move the axis forwards and back again.
    depth = np.interp(heights, (-1.2, -0.8, -0.3, BROWS), (-0.22, -0.18, -0.07, -0.04))
    return rays_around(middle, heights, depth, float(_SECTIONS[-1, 1]), cell,
                       int(2 * np.pi * 0.45 / cell), frame)


def bust_distance(chart: Chart, chin: float = CHIN) -> Float64:
    """Distances of the generic bust's surface along a chart's rays, world units, float64 [V, U].

    ``chin`` is the height of the lowest point of the face: all below is moved up or down with it.
    """
    rays = replace(chart, frame=None).rays
    height = chart.axis[:, 1] + np.interp(chart.axis[:, 1], (chin, -0.2), (CHIN - chin, 0.0))
    half, front, back = (np.interp(height, _SECTIONS[:, 0], _SECTIONS[:, k])[:, None]
                         for k in (1, 2, 3))
    depth = chart.axis[:, 2][:, None]
    along = np.where(rays[..., 2] > 0, front - depth, depth - back)
    power = np.interp(height, (-1.1, -0.8), (_SQUARE, _ROUND))[:, None]
    up = np.maximum(rays[..., 1] / (_CROWN - BROWS), 0.0)
    return np.asarray((np.abs(rays[..., 0] / half) ** power + np.abs(rays[..., 2] / along) ** power
                       + up ** power) ** (-1.0 / power) / chart.scale, np.float64)


def cosines_of(chart: Chart, distance: Float64, cameras: Camera) -> list[Float64]:
    """How squarely each camera looks at a surface, float64 [V, U] in world units.

    One a camera, float64 [V, U]: the cosine between the normal and the way to the camera, -1 where
    the surface hides itself.
    """
    points = chart.points(distance).reshape(-1, 3)
    normals = normals_of(chart, distance).reshape(-1, 3)

    def of(view: int) -> Float64:
        cosines = np.empty(len(points))
        facing_cosines(points, normals, cameras.row(view), chart.cell / chart.scale,
                       np.empty((3, len(points))), np.empty((_BLOCKS, _BLOCKS)), cosines)
        return cosines.reshape(distance.shape)

    return side_by_side(of, range(len(cameras)))


class SurfaceSweep:
    """Grey photos, reduced to pixels as wide as a cell, that a surface is looked up in."""

    def __init__(self, images: Sequence[UInt8], cameras: Camera, cell: float) -> None:
        factor = float(np.clip(2.0 * cameras.pixel / cell, 0.1, 1.0))
        self.cameras = cameras.scaled(factor)
        greys = [cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255,
                            (int(self.cameras.width[k]), int(self.cameras.height[k])),
                            interpolation=cv2.INTER_AREA) for k, image in enumerate(images)]
        self._pictures, self._sizes = stacked(greys)
        self._rows = self.cameras.rows

    def sweep(self, chart: Chart, distance: Float64, limit: Float64, reach: float, steps: int,
              window: int) -> tuple[Float64, Float64]:
        """Where around a surface the photos agree best.

        Parameters
        ----------
        chart, distance : The surface, float64 [V, U], world units.
        limit : Distances beyond which nothing is looked for, float64 [V, U].
        reach, steps : How far outwards and inwards is looked, world units, and at how many
            places.
        window : Width of the correlation's window in cells.

        Returns
        -------
        offset, trust : float64 [V, U] each: outwards from the surface, and the photos'
            confidence in [0, 1].
        """
        weights = np.stack([np.clip((cosine - 0.15) / 0.3, 0, 1).astype(np.float32)
                            for cosine in cosines_of(chart, distance, self.cameras)])
        offsets = np.linspace(-reach, reach, steps)
        parts = side_by_side(
            lambda by: self._agreement(chart.points(distance + by), weights, window),
            offsets.tolist())
        scores = np.stack([part[0] for part in parts])
        texture = parts[len(parts) // 2][1]
        scores[(distance + offsets[:, None, None]) > limit + 0.2 * reach] = 0.0
        scores = np.stack([cv2.GaussianBlur(score, (0, 0), window / 5) for score in scores])
        best = scores.argmax(axis=0)
        inner = np.clip(best, 1, steps - 2)
        below, top, above = (np.take_along_axis(scores, (inner + by)[None], 0)[0]
                             for by in (-1, 0, 1))
        bend = np.minimum(below + above - 2 * top, -1e-6)
        shift = np.clip(0.5 * (below - above) / bend, -0.5, 0.5)
        offset = (inner + shift - (steps - 1) / 2) * (offsets[1] - offsets[0])
        # If the photos agree as well elsewhere, or at the end of the range, they do not determine
        # it.
        spread = top - np.median(scores, axis=0)
        sure = (best == inner) & (top > 1.0)
        trust = np.where(sure, np.clip(spread / 1.5, 0, 1) * texture / (texture + 1.5e-5), 0.0)
        return offset, trust

    def _agreement(self, points: Float64, weights: Float32, window: int) -> tuple[Float32, Float32]:
        """Mean correlation of the photos with their mean, and the mean's variance, [V, U] each."""
        shape = points.shape[:2]
        score, total, own = np.empty((3, *shape), np.float32)
        surface_agreement(
            points, self._rows, self._pictures, self._sizes, weights, window // 2,
            (np.empty(shape, np.float32), np.empty((2, shape[1] + 8), np.float32),
             np.empty((2, shape[1]), np.float32)),
            np.empty((2, *weights.shape), np.float32), score, total, own)
        share = np.clip(score / np.maximum(total, 1e-6), 0.0, 1.0)
        # The likelihood of an agreement, but for a factor: what misfits is noise.
        logarithm = np.where(total > 0.25 * len(weights), -np.log(1.003 - share), 0.0)
        return logarithm.astype(np.float32), own


_BESIDE = 0.015
"""Mattes show something else where they reach further than this beyond a surface's outline,
portrait units (3 mm)."""
_MIDDLE, _REACH = np.array([0.0, 0.5, -0.15]), np.array([0.6, 0.8, 0.9])
"""Box in which it is looked for: its middle, and how far it reaches along the axes of the arc."""
_LOW = 0.1  # Height from which on it is looked for: above the brows.
_KNOT_CELL = 0.01
_KNOT_TOLD, _AGAINST = 0.5, 0.1
"""Share of the photos that must show a place of it beside the surface, and that may show nothing
there: some look at it over the crown's other side."""
_MATTER = 63  # Value from which on a matte does not rule a place out.
_WIDEST = 0.8  # Share of the widest section from which on a section counts as that.
_LEAST, _KNOT_MOST = (0.06, 0.025), 0.52
"""Width and height, portrait units, from which on it is a knot: a tuft is none; and the largest
width: a hat, and much hair, are none either."""
_FLAT = 2.0  # How much larger a ball's radius may be than half of the width that is seen of it.
_AROUND, _WAYS = (0.6, 1.4), 128
"""Radii of a ball between which its outline is looked for, along so many ways from its middle."""
_EDGE = 1.5  # Pixels inside of an outline at which a knot must stand out of the head.
_FEW = 40  # Places of outlines below which a ball is left as it is.


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
    if sum(other.any() for other in others) < _KNOT_TOLD * views:
        return none
    # Along the arc's middle direction what hides a place does so however far behind it is.
    axes = _axes(cameras.position.mean(axis=0) - _MIDDLE)
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = axes, -axes @ _MIDDLE
    given, cameras = cameras, cameras.transformed(turned)
    shape = tuple(np.round(2 * _REACH / _KNOT_CELL).astype(int)[::-1].tolist())

    def votes(covered: Callable[[int], Bool], share: float) -> Bool:
        seen, against = lattice_votes(cameras, covered, np.zeros(3), _REACH, shape, share * views)
        return np.asarray((against <= share * seen) & (seen >= _KNOT_TOLD * views))

    hull = votes(lambda view: np.asarray(mattes[view] > _MATTER), _AGAINST)
    pieces, _ = ndimage.label(hull & votes(lambda view: others[view], 1 - _KNOT_TOLD),
                              np.ones((3, 3, 3), np.int8))
    found = none.ravel()
    # The shreds of a matte are thousands of pieces, too small for a section of a knot.
    large = np.bincount(pieces.ravel())[1:] > _LEAST[0] / _KNOT_CELL
    for piece in np.flatnonzero(large) + 1:
        ball = _ball(pieces == piece, hull)
        if ball is None:
            continue
        middle = _MIDDLE + ball[0] @ axes
        if middle[1] < _LOW:
            continue
        middle, radius = _touching(middle, ball[1], given, mattes, others)
        # So many that there are some in each cell of the chart.
        places = middle + radius * _directions(int(16 * (radius / _KNOT_CELL) ** 2))
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
    width = _KNOT_CELL * float(np.ptp(columns) + 1)
    if not _LEAST[0] <= width <= _KNOT_MOST or _KNOT_CELL * (high - low + 1) + _BESIDE < _LEAST[1]:
        return None
    # What is nearer to the head's outline is part of it as well.
    low = max(low - int(_BESIDE / _KNOT_CELL), 0)
    up, left, right = _run(hull[round(depth), low:high + 1],
                           round(0.5 * float(columns.min() + columns.max())))
    if not len(up):
        return None
    # From the middles of this section's rows to its own top: another's, one row higher, would make
    # the ball up to a quarter too small.
    drop, half = _KNOT_CELL * (up.max() - up + 0.5), 0.5 * _KNOT_CELL * (right - left + 1)
    # Of a ball half^2 = drop (2 radius - drop).
    radius = float(drop @ (half ** 2 + drop ** 2) / (2 * (drop @ drop)))
    radius = float(np.clip(radius, 0.5 * width, 0.5 * _FLAT * width))
    at = 0.5 * (left + right).mean(), low + up.max() + 0.5 - radius / _KNOT_CELL, depth
    return _KNOT_CELL * (np.array(at) + 0.5) - _REACH, radius


def _touching(middle: Float64, radius: float, cameras: Camera, mattes: Sequence[UInt8],
              others: Sequence[Bool]) -> tuple[Float64, float]:
    """A ball, its middle [3] and radius, that rays at the outlines of mattes touch.

    ``others`` : Where mattes show something beside the head, bool [H, W] a photo.
    """
    rays = [_outline(middle, radius, cameras, view, *shown)
            for view, shown in enumerate(zip(mattes, others))]
    origins, ways = (np.concatenate(part) for part in zip(*rays))
    if len(origins) < _FEW:
        return middle, radius

    def apart(ball: Float64) -> Float64:
        away = np.cross(ball[:3] - origins, ways)
        return np.asarray(np.linalg.norm(away, axis=1) - ball[3], np.float64)

    # Strands stand out, and knots are no balls: what is half a cell off counts less.
    found = least_squares(apart, np.append(middle, radius), loss="soft_l1",
                          f_scale=0.5 * _KNOT_CELL).x
    moved = np.abs(found - np.append(middle, radius)).max()
    # Something else has that outline.
    if moved > (_FLAT - 1.0) * 0.5 * radius or not found[3] < 0.5 * _KNOT_MOST:
        return middle, radius
    return found[:3], float(found[3])


def _outline(middle: Float64, radius: float, cameras: Camera, view: int, matte: UInt8,
             other: Bool) -> tuple[Float64, Float64]:
    """Rays of a view at the outline around a ball, where that is not the head's: [N, 3] each."""
    (place,), (depth,) = (part[0] for part in cameras[view].project(middle[None]))
    if depth <= radius:  # The camera is in it, or looks away.
        return np.zeros((0, 3)), np.zeros((0, 3))
    pixels = float(cameras.focal[view, 0]) * radius / float(depth)
    turn = np.arange(_WAYS) * 2 * np.pi / _WAYS
    way = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    step = np.arange(_AROUND[0] * pixels, _AROUND[1] * pixels, 0.5)
    at = (place + step[:, None, None] * way).astype(np.float32)
    shown = cv2.remap(matte, at[..., 0] - 0.5, at[..., 1] - 0.5, cv2.INTER_LINEAR,
                      borderValue=255).astype(np.float64) - 127.5
    inside = shown > 0
    last = len(step) - 1 - np.argmax(inside[::-1], axis=0)
    # Where the matte goes on, or never begins, there is no outline.
    ends = np.flatnonzero(inside.any(axis=0) & (last < len(step) - 1))
    here, next_to = shown[last[ends], ends], shown[last[ends] + 1, ends]
    edge = step[last[ends]] + 0.5 * here / (here - next_to)
    column, row = np.floor(place[:, None] + (edge - _EDGE) * way[ends].T).astype(np.int64)
    height, width = other.shape
    beside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    beside[beside] = other[row[beside], column[beside]]
    return cameras.rays(view, place + (edge[:, None] * way[ends])[beside])


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


WIDE = 140.0
"""Cameras that are spread over more degrees than this about the vertical axis see both sides."""
CLEARANCE, GRAZING = 0.06, 0.04
"""Matter may lie this far before the surface, in portrait units: 12 mm where photos see it well, 8
mm where they look along it or do not see it."""
_RIM = 0.3  # Cosine from which on photos locate a surface better than the hull that touches it.
_TAPER = 1.012  # Most growth of a lower face from one row to the row below.
_ASIDE = 72.0, 88.0
"""Degrees from the front over which that ends, for what lies behind as well: beside a neck outlines
show how it widens."""
_SLOPE = 0.3  # Logarithm of the growth from row to row that is not too much there.
_HULL = np.linspace(0.22, 1.0, 42)
"""Parts of the way along a ray at which mattes are asked whether they rule a place out."""
_FAR = 2.2  # Distance, over that of the bust, up to which they are: shoulders differ most.
_TOLD = 0.5  # Trust from which on photos are believed that a face goes on below its chin.
_ALONG = 0.2  # Cosine up to which photos look along a surface.
_MOST = 0.3  # Logarithm of the ratio by which a face differs from the generic one at most.
_SLAB = 32  # Planes of a lattice whose distances are found together.
_CELL = 0.016
_VIEWS = 16
_SWEEPS = ((0.12, 25, 9, 1.0), (0.06, 21, 7, 0.3), (0.03, 17, 5, 0.1))
"""Reach of each sweep in world units, its steps, the window in cells, the plate's stiffness."""


@dataclass(frozen=True)
class HeadSurface:
    """A closed surface around a head, down to the bust."""

    chart: Chart  # Its frame is the portrait frame.
    distance: Float64  # float64 [V, U], of the surface from the chart's axis, world units.
    trust: Float64  # float64 [V, U] in [0, 1], confidence of the photos in it.
    # float64 [V, U], cosine between the normal and the way to the cameras, that of the photo after
    # the fifth of the photos that see it best.
    facing: Float64
    span: float  # Degrees about the vertical axis that the cameras are spread over.
    knots: Float64  # float64 [V, U], what stands out of the head (`knots_behind`); 0 elsewhere.

    def shown_of_head(self) -> float:
        """Share of the head's surface (from the chin upwards) that photos see well, 0 to 1."""
        head = self.chart.axis[:, 1] > CHIN
        area = (self.distance ** 2 * np.cos(self.chart.elevation)[:, None])[head]
        return float(area[self.facing[head] > _ALONG].sum() / area.sum())


def span_of(cameras: Camera) -> float:
    """Degrees about the vertical axis that the cameras leave least room beside."""
    angle = np.sort(np.degrees(np.arctan2(cameras.position[:, 0], cameras.position[:, 2])))
    return float(360.0 - np.diff(angle, append=angle[0] + 360.0).max())


def is_narrow(capture: Capture) -> bool:
    """Whether the photos of a face with mattes are an arc too narrow to carve its depth."""
    landmarks = capture.landmarks
    if landmarks is None or capture.alphas is None:
        return False
    if not np.isfinite(landmarks[17:]).all():
        return False
    local = capture.cameras[capture.training()].transformed(
        portrait_frame_from_landmarks(np.asarray(landmarks, np.float64), capture.cameras))
    return span_of(local) < WIDE


def find_surface(capture: Capture) -> HeadSurface:
    """The surface of the person of a capture with mattes and landmarks (`is_narrow`)."""
    landmarks = np.asarray(capture.landmarks, np.float64)
    frame = portrait_frame_from_landmarks(landmarks, capture.cameras)
    views = capture.training()
    views = views[np.linspace(0, len(views) - 1, min(_VIEWS, len(views))).astype(int)]
    assert capture.alphas is not None
    cameras, mattes = capture.cameras[views], [capture.alphas[view] for view in views]
    local = landmarks @ frame[:3, :3].T + frame[:3, 3]
    chart = bust_chart(_CELL, float(np.nanmean(local[[27, 28, 29, 30, 33, 51, 57, 8], 0])), frame)
    chin = float(np.nan_to_num(local[8, 1], nan=CHIN))
    generic = bust_distance(chart, chin)
    prior, limit, rim = _scaled_bust(chart, generic, local, cameras, mattes)
    photos = SurfaceSweep([capture.images[view] for view in views], cameras,
                          chart.cell / chart.scale)
    shown = _shown_below_chin(chart, np.minimum(prior, limit), limit, chin, photos)
    prior = np.maximum(prior, shown)
    # Of a body's skin or clothes the photos say little: it is smoother than a face.
    body = np.interp(chart.axis[:, 1], (-0.9, -0.6), (0.1, 1.0))[:, None]
    distance = _tapered(chart, np.minimum(prior, limit), generic, chin, shown)
    for part, steps, window, stiff in _SWEEPS:
        reach = part / chart.scale
        offset, trust = photos.sweep(chart, distance, limit, reach, steps, window)
        # At the rims, outlines give the surface's position.
        along = 1.5 * np.clip(1.0 - _facing(chart, distance, cameras) / _RIM, 0, 1)
        along = np.where(rim & (along > trust), along, 0.0)
        offset = np.where(along > 0, np.where(rim, limit, 0.0) - distance, offset)
        trust = np.maximum(trust, along)
        target = np.log(np.maximum(distance + offset, 0.05 * generic) / prior)
        outlier = np.ones(trust.shape)
        # Reweighted: outliers lose their say. Which these are a rough plate tells as well.
        for fit in (roughly_fitted_plate, roughly_fitted_plate, fitted_plate):
            found = prior * np.exp(fit(target, trust * outlier * body, stiff, 0.02 * stiff, 1e-5))
            outlier = 1.0 / (1.0 + ((found - distance - offset) / (0.15 * reach)) ** 2)
        distance = _tapered(chart, np.minimum(found, limit), generic, chin, shown)
    knots = knots_behind(chart, distance, limit, cameras, mattes)
    distance = np.maximum(distance, knots)
    return HeadSurface(chart, distance, trust * outlier, _facing(chart, distance, cameras),
                       span_of(capture.cameras[capture.training()].transformed(frame)), knots)


def _shown_below_chin(chart: Chart, start: Float64, limit: Float64, chin: float,
                      photos: SurfaceSweep) -> Float64:
    """Distances where a face goes on below the chin's landmark, by the photos; 0 elsewhere, [V, U].

    Beards, double chins and misplaced landmarks: the lower face is continued downwards, and what
    photos agree on there is no throat.
    """
    height, front = chart.axis[:, 1], np.abs(chart.angle) < np.radians(80.0)
    reach, on = _SWEEPS[0][0] / chart.scale, start.copy()
    rows = np.flatnonzero((height < chin + 0.05) & (height > chin - 0.3))
    for row in rows[::-1]:
        on[row, front] = np.minimum(np.maximum(on[row, front], on[row + 1, front] / _TAPER),
                                    limit[row, front])
    offset, trust = photos.sweep(chart, on, limit, reach, *_SWEEPS[0][1:3])
    trusted_part = ndimage.gaussian_filter(trust, 2.0) > _TOLD
    trusted_part &= ((height < chin + 0.1) & (height > chin - 0.3))[:, None] & front
    found = np.minimum(on + smoothed(offset, trusted_part, 1.5), limit)
    # It hangs together with the face, has a middle, and goes no further out than the face.
    middle = np.abs(chart.angle) < np.radians(20.0)
    for row in rows[::-1]:
        trusted_part[row] &= trusted_part[row + 1] & (trusted_part[row, middle].mean() > 0.9)
        found[row] = np.minimum(found[row], found[row + 1])
    return np.where(trusted_part & (height < chin + 0.05)[:, None], found, 0.0)


def _tapered(chart: Chart, distance: Float64, generic: Float64, chin: float, shown: Float64,
             ) -> Float64:
    """The surface without shelves below the mouth: no throat stands before the chin that hides it.

    From the mouth down each row is at most a little further out than the one above, and the throat
    not much further than the generic one, unless photos show it there (``shown``). At its sides no
    chin hides a neck, and it may slope to the shoulders from the jaw on.
    """
    aside = np.interp(np.degrees(np.abs(chart.angle)), _ASIDE, (0.0, 1.0))
    below = np.interp(chart.axis[:, 1], (chin - 0.3, chin - 0.25, chin - 0.01, chin + 0.04),
                      (1.0, 0.1, 0.1, 1.0))[:, None]
    out = np.minimum(distance, generic * np.exp(below + aside * (1.0 - below)))
    growth = _TAPER * np.exp(_SLOPE * aside)
    rows = np.flatnonzero((chart.axis[:, 1] < chin + 0.12) & (chart.axis[:, 1] > chin - 0.15))
    for row in rows[::-1]:
        out[row] = np.minimum(out[row], growth * out[row + 1])
    return np.maximum(out, np.minimum(distance, shown * _TAPER))


def _scaled_bust(chart: Chart, generic: Float64, landmarks: Float64, cameras: Camera,
                 mattes: Sequence[UInt8]) -> tuple[Float64, Float64, Bool]:
    """The bust scaled to the landmarks and outlines, the hull, and its rims, [V, U] each."""
    # Of the body landmarks say nothing.
    loose = np.interp(chart.axis[:, 1], (-0.95, -0.6), (3e-3, 1e-6))[:, None]
    ratio, weight = _ratio_of_landmarks(chart, generic, landmarks)
    rough = generic * np.exp(roughly_fitted_plate(ratio, weight, 0.5, 0.01, loose))
    limit = _hull_distance(chart, cameras, mattes, _FAR * rough)
    rim = _rim(chart, np.fmin(rough, limit), cameras) & np.isfinite(limit)
    rim &= (weight == 0) & (_facing(chart, np.fmin(rough, limit), cameras) < _RIM)
    ratio = np.where(rim, np.log(np.where(rim, limit, 1.0) / generic), ratio)
    weight = np.where(rim, 2.0, weight)
    prior = generic * np.exp(fitted_plate(ratio, weight, 0.5, 0.01, loose))
    return prior, np.where(np.isfinite(limit), limit, np.inf), rim


def _ratio_of_landmarks(chart: Chart, generic: Float64, landmarks: Float64,
                        ) -> tuple[Float64, Float64]:
    """Logarithm of the face's distances over the generic ones, and weights, [V, U] each."""
    from scipy.interpolate import RBFInterpolator

    points = landmarks[np.isfinite(landmarks).all(axis=1)]
    depth = RBFInterpolator(points[:, :2], points[:, 2], kernel="linear", smoothing=1e-4)
    outline = cv2.convexHull((1000 * points[:, :2]).astype(np.float32))
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    x, y = (part.ravel() for part in np.meshgrid(*(np.arange(low[k], high[k], 0.4 * chart.cell)
                                                   for k in (0, 1))))
    # The jaw's line lies where the surface turns under: what is below it is no face.
    y_least = points[:, 1].min() + chart.cell
    inside = np.array([b > y_least
                       and cv2.pointPolygonTest(outline, (1000.0 * a, 1000.0 * b), False) >= 0
                       for a, b in zip(x, y)])
    flat = np.stack([x, y], axis=1)[inside]
    face = np.column_stack([flat, depth(flat)])
    places, away = replace(chart, frame=None).places(face)
    row = np.clip(np.rint(places[0]).astype(int), 0, len(generic) - 1)
    column = np.rint(places[1]).astype(int) % generic.shape[1]
    ratio, weight = np.zeros(generic.shape), np.zeros(generic.shape)
    np.add.at(ratio, (row, column), np.clip(np.log(away / chart.scale / generic[row, column]),
                                            -_MOST, _MOST))
    np.add.at(weight, (row, column), 1.0)
    return ratio / np.maximum(weight, 1.0), (weight > 0).astype(np.float64)


def _hull_distance(chart: Chart, cameras: Camera, mattes: Sequence[UInt8],
                   reach: Float64) -> Float64:
    """Distances up to which no matte rules a ray's points out; NaN where none is known."""
    grown, sizes = stacked([cv2.dilate(matte, np.ones((3, 3), np.uint8)) for matte in mattes])
    found = np.empty(reach.shape)
    hull_along_rays(chart.origins, np.ascontiguousarray(chart.rays), np.ascontiguousarray(reach),
                    _HULL, cameras.rows, grown, sizes, 3, found)
    return np.asarray(ndimage.median_filter(found, 3), np.float64)


def _rim(chart: Chart, distance: Float64, cameras: Camera) -> Bool:
    """Where some camera looks along the surface: there the hull touches it, bool [V, U]."""
    points, normal = chart.points(distance), normals_of(chart, distance)
    low, high = np.full(distance.shape, np.inf), np.full(distance.shape, -np.inf)
    for position in cameras.position:
        away = position - points
        cosine = (away * normal).sum(axis=-1) / np.linalg.norm(away, axis=-1)
        low, high = np.minimum(low, cosine), np.maximum(high, cosine)
    return np.asarray((low < 0.05) & (high > -0.05))


def _facing(chart: Chart, distance: Float64, cameras: Camera) -> Float64:
    """How squarely a fifth of the cameras look at the surface, cosines [V, U]."""
    return np.asarray(np.quantile(cosines_of(chart, distance, cameras), 0.8, axis=0), np.float64)


def distance_outside(surface: HeadSurface, shape: tuple[int, int, int], center: Float64,
                     radius: Float64) -> tuple[Float32, Float32]:
    """How far the points of a lattice lie outside of a surface, and how far they may.

    Parameters
    ----------
    shape : Lattice points along z, y, x.
    center, radius : The box of the lattice, float64 [3] each (x, y, z).

    Returns
    -------
    distance, clearance : float32 [Z, Y, X] each, world units. The distance is that along the
        chart's rays, below zero inside; near the surface, outside, that through space where it
        is shorter. The clearance is less where photos look along the surface or do not see it:
        only guesses could fill it there.
    """
    share = np.clip((surface.facing - _ALONG) / _ALONG, 0, 1)
    margin = (GRAZING + (CLEARANCE - GRAZING) * share) / surface.chart.scale
    along, clearance = surface.chart.outside(surface.distance, margin, shape, center, radius)
    spacing = (2.0 * radius / np.array(shape[::-1]))[::-1]
    inside = along < 0
    box = box_about(inside)
    if box is None:
        return along, clearance
    # Space further away is empty whatever its distance.
    margin_points = np.ceil(float(margin.max()) / spacing).astype(int) + 2
    near = tuple(slice(max(0, side.start - more), side.stop + more)
                 for side, more in zip(box, margin_points))
    outside, more = ~inside[near], int(margin_points[0])

    def through_space(first: int) -> None:
        since = max(first - more, 0)
        if outside[since:first + _SLAB + more].all():
            return
        out = ndimage.distance_transform_edt(outside[since:first + _SLAB + more], spacing)
        own, here = np.s_[first - since:first - since + _SLAB], np.s_[first:first + _SLAB]
        np.minimum(along[near][here], out[own].astype(np.float32), out=along[near][here],
                   where=outside[here])

    side_by_side(through_space, range(0, len(outside), _SLAB))
    return along, clearance
