"""Spectacles in a portrait, painted or photographed: their lines, and a soft mask of these.

Whatever lies around an eye makes rings: folds of the lids, bags, sockets, hatching. Rims differ
from them by three measures: how well a smooth curve of one size fits around both eyes, how much of
its course is a line, and how alike the line's cross-section is all along.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ..arrays import Bool, Float32, Float64, Floats, UInt8
from ..color import linear_light
from .landmarks import face_pose
from .rims import (
    UNIT,
    Rim,
    UprightFace,
    find_pairs,
    followed,
    followed_arc,
    normals_of,
    ridges,
    sampled,
    upright,
)

SURE = 0.46  # Product of the three measures from which on a pair of rings is a pair of rims.
IN_PHOTOS = 0.42
"""The same in photos, in which fewer lines mislead: of 59 faces without spectacles none has more
than 0.38, of 53 with some 31 have more."""
DARK = 0.45  # Light below an eye over that of the cheek, both linear, below which a lens is dark.
TRIED = 3  # Pairs of curves that are followed, of each tone.
MOST_TURNED = 65.0
"""Yaw in degrees; of faces turned further the far rim isn't seen."""
ACROSS = np.linspace(-6, 6, 25)  # Pixels from a line, where its cross-section is read.
LINE = np.exp(-((ACROSS / 4) ** 2))  # What of it is the line, rather than what lies beside it.
GRAIN = 0.01  # Cross-sections with less contrast than this, of 1, are alike by chance.
BESIDE, UNSURE = 1.0, 0.01
"""Width of the highlight and the shadow beside a line, in its own widths, on either side; and how
far off a line that was found may be, in the head's units."""
LEAST_WIDTH = 0.01  # Of a line, in the head's units.
BRIDGE = 0.6  # Least mean answer of the line of a bridge.
RISES = (-0.01, 0.0, 0.01, 0.02), (0.03, 0.04, 0.05), (0.06, 0.075, 0.09, 0.105, 0.12)
"""Heights of bars, of arcs and of the springs of pince-nez over their ends, in the head's units."""
OUTSIDE = 0.15, 0.4, 0.5  # Least shares of them that lie outside of the rims.
TEMPLE = 0.7  # The same of a temple; hair and wrinkles make short lines, too.
SHORT = 0.13  # Temples that are seen for less than this, in the head's units, are wrinkles.
STEPS = 32  # Points of a bridge and of a temple.


@dataclass(frozen=True)
class Spectacles:
    """The lines of a pair of spectacles, in the picture's pixels."""

    # float64 [n, 2] each: the rims (closed), then bridge and temples where they are seen (open).
    curves: tuple[Float64, ...]
    # width, unsure: Of the lines, and how far off they may be.
    width: float
    unsure: float


def drawn_spectacles(found: Spectacles, shape: tuple[int, int], beside: float | None = None,
                     ) -> Float32:
    """The lines of spectacles, with highlight and shadow beside them; float32 [H, W] in [0, 1].

    ``beside`` is how much of that on either side, in pixels; None: as wide as the lines shine.
    """
    beside = BESIDE * found.width if beside is None else beside
    mask = np.zeros(shape, np.float32)
    points = np.concatenate(found.curves)
    room = 4 * found.width + 4
    low = np.maximum(np.floor(points.min(axis=0) - room).astype(int), 0)
    high = np.minimum(np.ceil(points.max(axis=0) + room).astype(int), mask.shape[::-1])
    part = np.zeros((high - low)[::-1], np.uint8)
    thick = max(round(found.width + 2 * beside), 2)
    for number, curve in enumerate(found.curves):
        places = np.round((curve - low) * 16).astype(np.int32)
        cv2.polylines(part, [places], number < 2, 255, thick, cv2.LINE_AA, 4)
    soft = cv2.GaussianBlur(part.astype(np.float32) / 255, (0, 0), max(0.3 * found.width, 0.5))
    mask[low[1]:high[1], low[0]:high[0]] = np.minimum(soft, 1)  # sums of rounded weights
    return mask


def spectacle_lenses(found: Spectacles, shape: tuple[int, int], landmarks: Floats) -> Float32:
    """What lies behind lenses that are worn below the eyes, float32 [H, W], 0 or 1.

    There they show a cheek, lighter or larger than it is.
    """
    mask = np.zeros(shape, np.uint8)
    for rim in found.curves[:2]:
        line = np.asarray(rim, np.float32)
        eyes = [landmarks[first:first + 6].mean(axis=0) for first in (36, 42)]
        if all(cv2.pointPolygonTest(line, (float(x), float(y)), False) < 0 for x, y in eyes):
            cv2.fillPoly(mask, [np.round(line).astype(np.int32)], 1)
    return mask.astype(np.float32)


def find_spectacles(image: UInt8, landmarks: Floats, sure: float = SURE) -> Spectacles | None:
    """The lines of the spectacles in a portrait uint8 [H, W, 3] by its landmarks [68, 2], or None.

    ``sure`` is how sure they must be.
    """
    points = np.asarray(landmarks, np.float64)
    pose = face_pose(points)
    if abs(pose.yaw) > MOST_TURNED:
        return None
    face = upright(image, points, pose)
    best, found = sure, None
    both = ridges(face)
    tried = [(tone, lines, pair) for tone, lines in zip((-1.0, 1.0), both)
             for pair in find_pairs(face, lines, TRIED)]
    both_rims = followed(face, [lines for _, lines, _ in tried], [pair for *_, pair in tried])
    for (tone, lines, pair), rims in zip(tried, both_rims):
        alike, width = _cross_sections(tone * face.grey, rims)
        score = pair.votes * float(np.sqrt(rims[0].clear * rims[1].clear)) * alike
        if score > best:
            best, found = score, (lines, rims, width)
    if found is None:
        return None
    lines, rims, width = found
    temples = [_temple(face, lines, rims, side) for side in (0, 1)]
    curves = [*(rim.points for rim in rims), *_bridges(both.max(axis=0), rims),
              *(one for one in temples if one is not None)]
    scale = pose.scale / UNIT
    width = max(width * scale, LEAST_WIDTH * pose.scale)
    return Spectacles(tuple(face.back(one) for one in curves), width,
                      UNSURE * pose.scale)


def dark_glasses(image: UInt8, landmarks: Floats) -> bool:
    """Whether dark lenses hide both eyes: right below these it is much darker than on the cheeks.

    Arguments are those of `find_spectacles`.
    """
    points = np.asarray(landmarks, np.float64)
    light = linear_light(image / 255.0).mean(axis=-1)
    below = (points[33] - points[27]) / 3
    for eye, cheek in ((points[36:42], points[[2, 48, 31]]), (points[42:48], points[[14, 54, 35]])):
        width = np.linalg.norm(eye[3] - eye[0])
        lens = np.zeros(light.shape, np.uint8)
        cv2.ellipse(lens, np.rint(eye.mean(axis=0) + below).astype(int).tolist(),
                    (max(int(0.45 * width), 1), max(int(0.1 * width), 1)), 0, 0, 360, 1, -1)
        skin = np.zeros(light.shape, np.uint8)
        inner = 0.5 * (cheek + cheek.mean(axis=0))
        cv2.fillPoly(skin, [np.round(inner).astype(np.int32)], 1)
        if not (lens.any() and skin.any()) or (np.median(light[lens > 0])
                                               >= DARK * np.median(light[skin > 0])):
            return False
    return True


def _cross_sections(grey: Float32, rims: list[Rim]) -> tuple[float, float]:
    """How alike two light rims' cross-sections are, in [0, 1], and the width of their lines."""
    found = []
    for rim in rims:
        places = (rim.points[:, None] + rim.normals[:, None] * ACROSS[:, None]).astype(np.float32)
        found.append(cv2.remap(grey, places[..., 0], places[..., 1], cv2.INTER_LINEAR,
                               borderMode=cv2.BORDER_REPLICATE))
    known = [rim.known for rim in rims]
    if min(one.sum() for one in known) < 8:
        return 0.0, 0.0
    # Light that grows from one side of a line to the other is no part of it.
    weight = np.sqrt(LINE)
    trend = np.stack([weight, weight * ACROSS])
    lines = [weight * one for one in found]
    lines = [one - one @ np.linalg.pinv(trend) @ trend for one in lines]
    common = np.median(np.concatenate([one[which] for one, which in zip(lines, known)]), axis=0)
    common /= np.linalg.norm(common) + 1e-9
    alike = [float(((one[which] @ common)
                    / (np.linalg.norm(one[which], axis=1) + GRAIN)).mean())
             for one, which in zip(lines, known)]
    return float(np.sqrt(max(alike[0], 0) * max(alike[1], 0))), _width(common / weight)


def _width(section: Float64) -> float:
    """Pixels over which a cross-section, as ``ACROSS``, is nearer to its line than its ground."""
    middle = len(section) // 2
    near = slice(middle - 4, middle + 5)
    top = near.start + int(section[near].argmax())
    half = (section[top] + np.median(section)) / 2
    ends = [top, top]
    for side, step in enumerate((-1, 1)):
        while 0 <= ends[side] + step < len(section) and section[ends[side] + step] > half:
            ends[side] += step
    return float(ACROSS[1] - ACROSS[0]) * (ends[1] - ends[0] + 1)


def _bridges(lines: Float32, rims: list[Rim]) -> list[Float64]:
    """The bridges between two rims, [STEPS, 2] each: a bar, arcs over the nose, or both."""
    between = rims[1].middle - rims[0].middle
    between /= np.linalg.norm(between)
    up = np.array([between[1], -between[0]])
    ends = []
    for rim, side in zip(rims, (1, -1)):
        away = rim.points - rim.middle
        angle = np.degrees(np.arctan2(away @ up, side * (away @ between)))
        ends.append(np.stack([rim.points[np.abs(angle - one).argmin()]
                              for one in range(-20, 90, 10)]))
    pairs = [(ends[0][first], ends[1][second]) for first in range(len(ends[0]))
             for second in range(max(first - 3, 0), min(first + 4, len(ends[1])))]
    free = _free(rims, lines.shape[1:])
    found = []
    share = (1 - np.cos(np.linspace(0, np.pi, STEPS))) / 2
    for rises, least in zip(RISES, OUTSIDE):
        arcs = np.stack([first + share[:, None] * (second - first)
                         + rise * UNIT * (4 * share * (1 - share))[:, None] ** power * up
                         for first, second in pairs for rise in rises for power in (0.5, 1.0)])
        answers = sampled(lines, arcs, normals_of(arcs, closed=False))
        places = np.clip(np.round(arcs).astype(int), 0, np.array(free.shape[::-1]) - 1)
        clear = free[places[..., 1], places[..., 0]]
        answers = (answers * clear).sum(axis=1) / np.maximum(clear.sum(axis=1), least * STEPS)
        if answers.max() > BRIDGE:
            found.append(followed_arc(lines, arcs[int(answers.argmax())], 0.012 * UNIT))
    return found


def _free(rims: list[Rim], shape: tuple[int, ...]) -> Bool:
    """Where an upright picture of a shape (h, w) shows neither a rim nor what is within it."""
    within = np.zeros(shape, np.uint8)
    for rim in rims:
        places = np.round(rim.points * 16).astype(np.int32)
        cv2.fillPoly(within, [places], 1, shift=4)
        cv2.polylines(within, [places], True, 1, 5, shift=4)
    return within == 0


def _temple(face: UprightFace, lines: Float32, rims: list[Rim], side: int) -> Float64 | None:
    """The temple from the rim at a picture's left (0) or right (1), [n, 2], as far as it is seen.

    It is straight, from the outer half of the rim to the ear.
    """
    sign = (-1, 1)[side]
    if face.rotation[2, 0] * sign < -0.2:
        return None  # that side of the head is turned away
    rim = rims[side]
    away = rim.points - rim.middle
    angle = np.degrees(np.arctan2(-away[:, 1], sign * away[:, 0]))
    starts = np.stack([rim.points[np.abs(angle - one).argmin()] for one in range(-20, 71, 10)])
    ends = face.places(np.array([(0.42 * sign, y, z) for y in np.linspace(-0.05, 0.13, 7)
                                 for z in (0.1, 0.2)]))
    share = np.linspace(0, 1, 2 * STEPS)[:, None]
    ways = np.stack([start + share * (end - start) for start in starts for end in ends])
    normals = normals_of(ways, closed=False)
    answers = np.max([sampled(lines, ways + aside * normals, normals) for aside in (-1, 0, 1)],
                     axis=0)
    lengths = np.linalg.norm(ways[:, -1] - ways[:, 0], axis=1)[:, None] * share[:, 0]
    # Hair may hide the rest: the best beginning of the best way.
    worth = np.cumsum(answers - TEMPLE, axis=1) * lengths[:, 1:2]
    which, last = np.unravel_index(int(worth.argmax()), worth.shape)
    if lengths[which, last] < SHORT * UNIT or worth[which, last] <= 0.05 * lengths[which, last]:
        return None
    return followed_arc(lines, ways[which, :last + 1], 0.012 * UNIT)
