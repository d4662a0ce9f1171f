"""Pairs of rims: closed curves of like size around or below both eyes, and their exact course.

A generalised Hough transform: every place votes for a curve around it by the lines that lie along
the curve. Curves are round, oval, square with round corners, or half-moons, in the plane of the
face; the pose foreshortens them. Both eyes must agree. The best curves are then followed by
dynamic programming, as a painted rim wobbles.

A line is a ridge where the picture is darker (or lighter) than on *both* sides of it, a line's
width away: an edge between two tones, which is no line, does not answer.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..arrays import Bool, Float32, Float64, UInt8
from .landmarks import FacePose

UNIT = 200.0
"""Pixels a unit of the generic head, whose eyes are 0.36 apart: a rim is 2 to 6 pixels wide."""
SHAPE = 170, 260  # Height and width of the upright picture.
ORIGIN = np.array([130.0, 62.0])  # Where the middle between the eyes lies in it, (x, y).
DIRECTIONS = 16  # Of lines, over half a turn.
WIDTHS = ((2.6, 0.8), (4.5, 1.3))
"""Pixels from a line to what lies beside it, and the blur before they are compared."""
AROUND = 14.0  # Sigma in pixels of the neighbourhood whose lines a line is compared with.
STANDS_OUT = 2.5  # A line that is this many times stronger than its neighbourhood answers in full.
FAINT = 0.012  # Lines of less contrast than this, of 1, are the grain of canvas and paper.
LIDS = 0.022  # Lines nearer to an eye than this, in the head's units, may be its lids.
UNKNOWN = 0.5  # What a place that may be a lid answers.


@dataclass(frozen=True)
class UprightFace:
    """A face without its roll, `UNIT` pixels a unit of the head."""

    pose: FacePose  # Of the face in the picture.
    rotation: Float64  # float64 [3, 3], of the pose, without its roll.
    matrix: Float64  # float64 [2, 3], from the picture's pixels to the upright ones.
    grey: Float32  # float32 `SHAPE` in [0, 1].
    eyes: Bool  # bool `SHAPE`: eyes and lids.
    eye_middles: Float64  # float64 [2, 2], (x, y) of the left and the right one in the picture.

    def places(self, points: Float64) -> Float64:
        """Upright pixels [..., 2] of points [..., 3] of the generic head."""
        return self.moved(self.pose.project(points))

    def moved(self, pixels: Float64) -> Float64:
        """Upright pixels [..., 2] of the picture's [..., 2]."""
        return np.asarray(pixels @ self.matrix[:, :2].T + self.matrix[:, 2], np.float64)

    def back(self, places: Float64) -> Float64:
        """The picture's pixels [..., 2] of upright ones [..., 2]."""
        inverse = np.linalg.inv(self.matrix[:, :2])
        return np.asarray((places - self.matrix[:, 2]) @ inverse.T, np.float64)

    def seen(self, offsets: Float64) -> Float64:
        """Upright pixels [..., 2] of offsets [..., 2] in the plane of the face."""
        return np.asarray(UNIT * (offsets @ self.rotation[:2, :2].T) * [1.0, -1.0], np.float64)


def upright(image: UInt8, landmarks: Float64, pose: FacePose) -> UprightFace:
    """The upright face of a picture, uint8 [H, W, 3], with its landmarks, [68, 2], and pose."""
    factor = UNIT / pose.scale
    angle = np.radians(pose.roll)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = factor * np.array([[cos, -sin], [sin, cos]])
    middle = landmarks[36:48].mean(axis=0)
    matrix = np.c_[turn, ORIGIN - turn @ middle]
    rotation = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) @ pose.rotation
    height, width = SHAPE
    # What is reduced is averaged first: a thin line would fall between the pixels that are read.
    corners = (np.array([[0, 0], [width, 0], [0, height], [width, height]])
               - matrix[:, 2]) @ np.linalg.inv(turn).T
    low = np.clip(np.floor(corners.min(axis=0)).astype(int) - 2, 0,
                  np.array(image.shape[1::-1]) - 1)
    high = np.maximum(np.ceil(corners.max(axis=0)).astype(int) + 2, low + 1)
    part = cv2.cvtColor(np.ascontiguousarray(image[low[1]:high[1], low[0]:high[0]]),
                        cv2.COLOR_RGB2GRAY)
    to = matrix.copy()
    to[:, 2] += turn @ low
    if factor < 0.8:
        size = tuple(max(round(n * factor / 0.95), 1) for n in part.shape[::-1])
        to[:, :2] /= np.divide(size, part.shape[::-1])
        part = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
    grey = cv2.warpAffine(part.astype(np.float32) / 255, to, (width, height),
                          flags=cv2.INTER_LINEAR if factor < 1 else cv2.INTER_CUBIC,
                          borderMode=cv2.BORDER_REPLICATE)
    eyes = np.zeros(SHAPE, np.uint8)
    points = landmarks @ turn.T + matrix[:, 2]
    for one in (points[36:42], points[42:48]):
        cv2.fillPoly(eyes, [np.round(one * 16).astype(np.int32)], 1, shift=4)
    side = 2 * round(LIDS * UNIT) + 1
    near = cv2.dilate(eyes, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
    return UprightFace(pose, rotation, matrix, np.asarray(grey, np.float32), near > 0,
                       np.stack([points[36:42].mean(axis=0), points[42:48].mean(axis=0)]))


def ridges(face: UprightFace) -> Float32:
    """How much a place is a thin line across each direction.

    float32 [2, DIRECTIONS, h, w] in [0, 1]: Dark lines and light ones, by the direction of their
    normal (n / DIRECTIONS of half a turn from x towards y), against the lines around them.
    """
    found = np.zeros((2, DIRECTIONS, *SHAPE), np.float32)
    for away, sigma in WIDTHS:
        grey = np.asarray(cv2.GaussianBlur(face.grey, (0, 0), sigma), np.float32)
        for number in range(DIRECTIONS):
            angle = np.pi * number / DIRECTIONS
            step = away * np.cos(angle), away * np.sin(angle)
            sides = [_shifted(grey, sign * step[0], sign * step[1]) for sign in (1, -1)]
            dark = np.minimum(*sides) - grey
            light = grey - np.maximum(*sides)
            np.maximum(found[0, number], dark, out=found[0, number])
            np.maximum(found[1, number], light, out=found[1, number])
    around = cv2.GaussianBlur(found.sum(axis=0).mean(axis=0), (0, 0), AROUND)
    found /= STANDS_OUT * around + np.float32(FAINT)
    np.minimum(found, 1, out=found)
    found[..., face.eyes] = UNKNOWN
    return found


def _shifted(grey: Float32, x: float, y: float) -> Float32:
    """A picture moved by a part of pixels, its edge repeated."""
    return np.asarray(cv2.warpAffine(grey, np.array([[1, 0, -x], [0, 1, -y]]), grey.shape[::-1],
                                     borderMode=cv2.BORDER_REPLICATE), np.float32)


Curve = tuple[float, float, float, float]
"""Half width and half height in the head's units, exponent (2 an ellipse, 4 nearly a rectangle),
and the height, of the half height, above which it is flat."""

SIZES = 0.085 * 1.1 ** np.arange(9)
"""Half widths: lenses are 0.5 to 1.0 times the distance of the eyes wide."""
KINDS = ((1.2, 2.0, 1.0), (1.03, 2.0, 1.0), (0.78, 2.0, 1.0), (0.8, 4.0, 1.0), (0.85, 2.0, 0.1))
"""Half height over half width, exponent and cut."""
CURVES: list[Curve] = [(float(size), float(size * ratio), power, cut)
                       for ratio, power, cut in KINDS for size in SIZES]
EYE = 0.13, 0.1
"""Half width and half height of what surrounds an eye: folds of its lids, and bags. A curve around
an eye that is not larger is no rim."""
TURNED = 12.0
"""Yaw in degrees from which on the far rim may be narrower: lenses are bent round the face."""
STRIDE = 2  # Votes are counted at every Nth pixel.
BOX = slice(38, 126), slice(46, 216)
"""Rows and columns of the upright picture where a rim's middle may lie."""
POINTS = 40  # Of a curve, for votes.
SECTORS = 8  # Of a curve: lines in all of them count more than many in one.
FINE = 96  # Points of a curve that is followed.
ROOM = np.linspace(0.84, 1.16, 21)
"""How far a rim may be from the curve: times its distance from the middle."""
NARROW = np.linspace(0.9, 1.1, 17)  # The same once it is known better.
STIFF = 0.15  # What a step of ``ROOM`` costs, against 1 for a full answer of a line.


@dataclass(frozen=True)
class Rim:
    """A rim that was followed, in upright pixels."""

    points: Float64  # float64 [FINE, 2], closed.
    normals: Float64  # float64 [FINE, 2].
    answers: Float64  # float64 [FINE] in [0, 1]: how much it is a line there.
    known: Bool  # bool [FINE]: what no lid hides.

    @property
    def middle(self) -> Float64:
        """Its middle [2]."""
        return np.asarray(self.points.mean(axis=0), np.float64)

    @property
    def clear(self) -> float:
        """Mean answer of what is known, in [0, 1]; 0 where that is less than half of it."""
        return float(self.answers[self.known].mean()) if self.known.mean() > 0.5 else 0.0


@dataclass(frozen=True)
class RimPair:
    """Where two rims may be: votes in [0, 1], curves and middles [2] of the left and right one."""

    votes: float
    curves: tuple[Curve, Curve]
    middles: tuple[Float64, Float64]


def find_pairs(face: UprightFace, lines: Float32, count: int) -> list[RimPair]:
    """The pairs of curves with the most votes, of all sizes and forms, best first.

    ``lines`` are float32 [DIRECTIONS, h, w], `ridges` of one tone.
    """
    wide = np.stack([_widened(one) for one in lines])
    votes = [_widened(_votes(face, wide, curve) * _no_lids(face, curve)) for curve in CURVES]
    likely = _likely(face)
    found = (_best(face, votes, number, likely) for number in range(len(CURVES)))
    return sorted((one for one in found if one is not None), key=lambda one: -one.votes)[:count]


def _widened(plane: Float32) -> Float32:
    """The largest of a place and its eight neighbours."""
    return np.asarray(cv2.dilate(plane, np.ones((3, 3), np.uint8)), np.float32)


@functools.lru_cache(maxsize=2 * len(CURVES))
def _curve(curve: Curve, count: int) -> tuple[Float64, Float64]:
    """Points [count, 2] at equal distances on a curve around 0, and unit tangents; read only."""
    wide, high, power, cut = curve
    angle = np.linspace(0, 2 * np.pi, 361)
    away = (np.abs(np.cos(angle)) ** power + np.abs(np.sin(angle)) ** power) ** (-1 / power)
    line = np.stack([wide * away * np.cos(angle),
                     np.minimum(high * away * np.sin(angle), cut * high)], axis=1)
    length = np.r_[0, np.cumsum(np.hypot(*np.diff(line, axis=0).T))]

    def at(places: Float64) -> Float64:
        return np.stack([np.interp(places % length[-1], length, line[:, axis])
                         for axis in (0, 1)], axis=1)

    places = np.linspace(0, length[-1], count, endpoint=False)
    step = length[-1] / count / 3
    tangents = at(places + step) - at(places - step)
    found = at(places), tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    for one in found:
        one.setflags(write=False)
    return found


def _votes(face: UprightFace, lines: Float32, curve: Curve) -> Float32:
    """Votes in [0, 1] for a curve around each place of `BOX`, every `STRIDE` pixels."""
    points, tangents = _curve(curve, POINTS)
    steps = np.round(face.seen(points)).astype(int)
    seen = face.seen(tangents)
    normals = np.stack([-seen[:, 1], seen[:, 0]], axis=1)
    numbers = np.round(_directions(normals)).astype(int) % DIRECTIONS
    rows, columns = BOX
    _, height, width = lines.shape
    shape = (len(range(rows.start, rows.stop, STRIDE)),
             len(range(columns.start, columns.stop, STRIDE)))
    sectors = np.zeros((SECTORS, *shape), np.float32)
    for n, ((x, y), number) in enumerate(zip(steps, numbers)):
        sector = sectors[n * SECTORS // POINTS]
        if (min(rows.start + y, columns.start + x) >= 0 and rows.stop + y <= height
                and columns.stop + x <= width):
            sector += lines[number, rows.start + y:rows.stop + y:STRIDE,
                            columns.start + x:columns.stop + x:STRIDE]
        else:
            down = np.clip(np.arange(rows.start, rows.stop, STRIDE) + y, 0, height - 1)
            across = np.clip(np.arange(columns.start, columns.stop, STRIDE) + x, 0, width - 1)
            sector += lines[number][np.ix_(down, across)]
    return np.asarray(np.sqrt(sectors * (SECTORS / POINTS)).mean(axis=0) ** 2, np.float32)


def _no_lids(face: UprightFace, curve: Curve) -> Float32:
    """0 at the places of `BOX` around which a curve would be the surroundings of an eye, else 1."""
    wide, high = curve[:2]
    rows, columns = (np.arange(one.start, one.stop, STRIDE) for one in BOX)
    free = np.ones((len(rows), len(columns)), np.float32)
    if wide >= EYE[0] and high >= EYE[1]:
        return free
    across, down = np.abs(face.seen(np.array([[wide, 0], [0, high]]))).max(axis=0)
    for x, y in face.eye_middles:
        free[((columns - x) / across) ** 2 + ((rows[:, None] - y) / down) ** 2 < 0.9] = 0
    return free


def _likely(face: UprightFace) -> Float32:
    """How likely the middle between two rims lies at each place of `BOX`, in [0, 1]: on the nose.

    Spectacles stand further from the face the lower they are on the nose.
    """
    rows, columns = (np.arange(one.start, one.stop, STRIDE) for one in BOX)
    down = np.linspace(-0.05, 0.24, 60)
    places = face.places(np.stack([0 * down, -down, 0.555 + 0.6 * np.maximum(down, 0)], axis=1))
    middle = np.interp(rows, places[:, 1], places[:, 0])
    inside = (rows >= places[0, 1]) & (rows <= places[-1, 1])
    away = np.abs(columns - middle[:, None]) / UNIT
    return np.where(inside[:, None], np.clip((0.09 - away) / 0.04, 0, 1), 0).astype(np.float32)


def _partners(number: int, yaw: float) -> list[int]:
    """Curves that the rim on the other side may have."""
    wide, high, *form = CURVES[number]
    least = 0.77 if abs(yaw) > TURNED else 0.9
    return [other for other, one in enumerate(CURVES)
            if list(one[2:]) == form and abs(np.log(one[1] / high)) < 0.12
            and least <= one[0] / wide <= 1.11]


def _best(face: UprightFace, votes: list[Float32], number: int, likely: Float32) -> RimPair | None:
    """The best pair whose near rim has a curve, or None."""
    wide = CURVES[number][0]
    partners = _partners(number, face.pose.yaw)
    near = votes[number]
    far = np.max([votes[one] for one in partners], axis=0)
    # The right one of a picture is far where the face is turned to the right.
    swap = face.pose.yaw < 0
    left, right = (far, near) if swap else (near, far)
    # Nowhere else: the nose is narrow.
    tall, broad = (np.flatnonzero(likely.any(axis=axis)).tolist() for axis in (1, 0))
    if not tall:
        return None
    apart = np.arange(2 * wide + 0.02, min(2 * wide + 0.21, 0.56), 0.03)[:, None, None]
    tilt = np.radians((-6, -2, 2, 6))
    halves = face.seen(apart / 2 * np.stack([np.cos(tilt), np.sin(tilt)], axis=1)) / STRIDE
    height, width = near.shape
    best, found = 0.0, None
    for x, y in np.round(halves).astype(int).reshape(-1, 2).tolist():
        top, bottom = max(abs(y), tall[0]), min(height - abs(y), tall[-1] + 1)
        start, stop = max(abs(x), broad[0]), min(width - abs(x), broad[-1] + 1)
        if top >= bottom or start >= stop:
            continue
        both = likely[top:bottom, start:stop] * np.sqrt(
            left[top - y:bottom - y, start - x:stop - x]
            * right[top + y:bottom + y, start + x:stop + x])
        place = int(both.argmax())
        value = float(both.item(place))
        if value > best:
            row, column = divmod(place, stop - start)
            best, found = value, (row + top, column + start, y, x)
    if found is None:
        return None
    row, column, y, x = found
    side = -1 if swap else 1
    partner = partners[int(np.argmax([votes[one][row + side * y, column + side * x]
                                      for one in partners]))]
    curves = CURVES[number], CURVES[partner]
    middle = np.array([BOX[1].start, BOX[0].start]) + STRIDE * np.array([column, row])
    half = STRIDE * np.array([x, y], np.float64)
    return RimPair(best, curves[::-1] if swap else curves, (middle - half, middle + half))


def followed(face: UprightFace, lines: Sequence[Float32], pairs: Sequence[RimPair],
             ) -> list[list[Rim]]:
    """The rims near the curves of each pair: the left one and the right one.

    ``lines`` are those of each pair, as in `find_pairs`. Rims are followed side by side: a step
    along twelve curves takes hardly longer than one along a single one.
    """
    planes = [one for one, _ in zip(lines, pairs) for _ in range(2)]
    middle = np.array([one for pair in pairs for one in pair.middles]).reshape(-1, 1, 2)
    points = np.array([face.seen(_curve(one, FINE)[0]) for pair in pairs for one in pair.curves]
                      ).reshape(-1, FINE, 2)
    away = _courses(planes, middle, points, ROOM)
    # What the course has in common with a smooth curve is where the rim is; it is followed again
    # from there, and less freely.
    places = np.array([_smooth(one) for one in points * away[..., None]]).reshape(points.shape)
    means = places.mean(axis=1, keepdims=True)
    middle, points = middle + means, places - means
    normals = normals_of(points)
    points = middle + points * _courses(planes, middle, points, NARROW)[..., None]
    rims = [_rim(face, *one) for one in zip(planes, points, normals)]
    return [rims[n:n + 2] for n in range(0, len(rims), 2)]


def _rim(face: UprightFace, lines: Float32, points: Float64, normals: Float64) -> Rim:
    """A rim of known course."""
    row, column = (np.clip(np.round(points[:, axis]).astype(int), 0, size - 1)
                   for axis, size in ((1, lines.shape[1]), (0, lines.shape[2])))
    return Rim(points, normals, sampled(lines, points, normals), ~face.eyes[row, column])


def followed_arc(lines: Float32, points: Float64, room: float) -> Float64:
    """The line near an open curve [n, 2], at most ``room`` pixels beside it."""
    normals = normals_of(points, closed=False)
    aside = np.linspace(-room, room, 2 * round(2 * room) + 1)
    places = points[:, None] + normals[:, None] * aside[:, None]
    way = ways(sampled(lines, places, np.broadcast_to(normals[:, None], places.shape))[None])[0]
    return points + normals * aside[way, None]


def normals_of(points: Float64, closed: bool = True) -> Float64:
    """Unit normals [..., n, 2] of curves [..., n, 2]."""
    if closed:
        tangents = np.roll(points, -1, axis=-2) - np.roll(points, 1, axis=-2)
    else:
        tangents = np.gradient(points, axis=-2)
    normals = np.stack([-tangents[..., 1], tangents[..., 0]], axis=-1)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9))


def sampled(lines: Float32, places: Float64, normals: Float64) -> Float64:
    """Answers [...] of lines, [DIRECTIONS, h, w], at places and across normals, [..., 2]."""
    _, height, width = lines.shape
    x = np.clip(places[..., 0], 0, width - 1.001)
    y = np.clip(places[..., 1], 0, height - 1.001)
    directions = _directions(normals)
    column, row, first = x.astype(int), y.astype(int), np.floor(directions).astype(int)
    x, y, share = x - column, y - row, directions - first

    def at(number: NDArray[np.int_]) -> Float64:
        plane = number % DIRECTIONS
        above = (1 - x) * lines[plane, row, column] + x * lines[plane, row, column + 1]
        below = (1 - x) * lines[plane, row + 1, column] + x * lines[plane, row + 1, column + 1]
        return np.asarray((1 - y) * above + y * below, np.float64)

    return np.asarray((1 - share) * at(first) + share * at(first + 1), np.float64)


def _directions(normals: Float64) -> Float64:
    """Directions [...] of normals [..., 2], in steps of `ridges`."""
    return np.asarray(np.arctan2(normals[..., 1], normals[..., 0]) / np.pi * DIRECTIONS)


def _smooth(points: Float64) -> Float64:
    """A closed curve [n, 2] without its short waves."""
    waves = np.fft.fft(points[:, 0] + 1j * points[:, 1])
    number = np.abs(np.fft.fftfreq(len(points), 1 / len(points)))
    # A few waves make round corners; more are the painter's hand.
    smooth = np.fft.ifft(waves * np.exp(-(number / 6) ** 4))
    return np.stack([smooth.real, smooth.imag], axis=1)


def _courses(lines: Sequence[Float32], middles: Float64, points: Float64, room: Float64) -> Float64:
    """Where the best lines run along closed curves: times the distance from the middle, [K, n]."""
    places = middles[:, :, None] + points[:, :, None] * room[:, None]
    normals = np.broadcast_to(normals_of(points)[:, :, None], places.shape)
    gain = np.array([sampled(*one) for one in zip(lines, places, normals)]).reshape(
        places.shape[:-1])
    count = points.shape[1]
    # Twice round: the middle of the way is closed.
    found = ways(np.concatenate([gain, gain], axis=1))
    return np.asarray(room[np.concatenate([found[:, count:count + count // 2],
                                           found[:, count // 2:count]], axis=1)])


def ways(gain: Float64) -> NDArray[np.int_]:
    """The ways with the most gain through several tables [K, n, m] at once: columns, int [K, n].

    At most one aside of the row before, which costs `STIFF`. Of equal ways the straight one.
    """
    tables, rows, width = gain.shape
    came = np.zeros(gain.shape, np.int8)
    total = np.full((tables, width + 2), -np.inf)
    total[:, 1:-1] = gain[:, 0]
    for row in range(1, rows):
        aside = total - STIFF
        before, after = aside[:, :-2], aside[:, 2:]
        best = total[:, 1:-1].copy()
        for other, step in ((before, -1), (after, 1)):
            better = other > best
            came[:, row][better] = step
            np.copyto(best, other, where=better)
        total[:, 1:-1] = best + gain[:, row]
    every = np.arange(tables)
    out = np.empty((tables, rows), np.int_)
    out[:, -1] = total[:, 1:-1].argmax(axis=1)
    for row in range(rows - 1, 0, -1):
        here = out[:, row]
        out[:, row - 1] = here + came[every, row, here]
    return out
