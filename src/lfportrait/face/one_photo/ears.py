"""Where a photo shows ears: a model's ear is laid on what is bare beside the head.

What of the person is no hair, beside the fitted head and at the height of its ear, is the photo's
ear, be it before ground or before hair: the model's is shifted, stretched and made to stand out so
that it covers that and nothing else.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float64, Int64
from ..head_fit import Picture
from ..head_prior import HeadPrior
from .solid import STANDS, standing_out

LENGTH = 40.0  # Cells to an ear's length in which it is looked for.
MARGIN, ABOVE, BELOW = 0.5, 0.35, 0.3
"""How far beside, above and below the model's ear one is looked for, over its length."""
LEAST = 0.12
"""Where less of a model's ear is beside the head, or not behind hair, the photo shows none."""
GROUND, HIDDEN = 1.0, 0.35
"""What of an ear would lie on ground, or on hair, counts so much as bare places that it lacks: hair
may hang over it."""
FAR, FADE = 0.2, 0.15
"""What is bare higher or lower than the model's ear counts so much, from so far on, over its
length: there the head goes on, and may be wider than the model's."""
DEVIATIONS = np.array([0.1, 0.1, 0.4, 0.4, 0.4, 0.4, 0.2])
"""Deviations of how an ear moves, and of how it stands out at its middle and changes that up to its
ends, along and across, over its length; and of that."""
HELD = 0.02  # How much the square of a deviation counts, over an ear's area.
STEPS = (1.0, 0.5, 0.25, 0.1)  # Deviations by which a better place is looked for.
ENOUGH = 1e-4  # What a step gains at least, over an ear's area.


def ear_of(prior: HeadPrior, side: int) -> Bool:
    """The vertices, bool [N], of the ear where x is negative or positive."""
    return np.asarray((standing_out(prior.rest) > STANDS) & (side * prior.rest[:, 0] > 0))


def shows(prior: HeadPrior, seen: Float64, side: int) -> float:
    """How much of an ear is not hidden by its head, whose vertices lie at [N, 2] in a photo."""
    ear = ear_of(prior, side)
    low, high = seen[ear].min(axis=0), seen[ear].max(axis=0)
    scale = LENGTH / float((high - low).max())
    columns, rows = np.ceil((high - low) * scale).astype(int) + 1
    own, head = _drawn(prior, (seen - low) * scale, ear, (rows, columns))
    return float((own & ~head).sum() / max(own.sum(), 1))


def laid_on(prior: HeadPrior, seen: Float64, bases: Float64, size: float, side: int,
            picture: Picture) -> Float64 | None:
    """How an ear moves to where the photo shows it, float64 [7] (`DEVIATIONS`); None: not seen.

    Parameters
    ----------
    seen : float64 [N, 2], where the head's vertices lie in the photo.
    bases : float64 [4, N], how much they move as its ear does, as it stands out, as it does so
        above its middle more than below, and as it becomes longer.
    size : Pixels to its length.
    """
    assert picture.inside is not None
    ear, scale = ear_of(prior, side), LENGTH / size
    low = seen[ear].min(axis=0) - size * np.array([MARGIN, ABOVE])
    high = seen[ear].max(axis=0) + size * np.array([MARGIN, BELOW])
    columns, rows = np.ceil((high - low) * scale).astype(int) + 1
    turn = np.array([[scale, 0, -low[0] * scale], [0, scale, -low[1] * scale]])

    def cells(values: NDArray[np.generic], beyond: float) -> NDArray[np.floating]:
        return np.asarray(cv2.warpAffine(np.asarray(values, np.float32), turn,
                                         (int(columns), int(rows)), flags=cv2.INTER_LINEAR,
                                         borderMode=cv2.BORDER_CONSTANT, borderValue=beyond))

    person = cells(picture.inside, -1.0) > 0
    # Beyond the photo nothing is known.
    within = cells(np.ones_like(picture.inside), 0.0) > 0.5
    hidden = np.zeros(person.shape, bool)
    for over in (picture.hair, picture.clothes):
        if over is not None:
            hidden |= person & (cells(over, 0.0) > 0.5)
    small = (seen - low) * scale
    own, head = _drawn(prior, small, ear, person.shape)
    area = float(own.sum())
    bare = person & ~hidden & ~head
    pieces = ndimage.label(bare)[0]
    bare = np.isin(pieces, np.setdiff1d(pieces[own], 0))
    seen_of_it = own & ~head & within
    known = (seen_of_it & ~hidden) | bare
    if min(seen_of_it.sum(), known.sum()) <= LEAST * area:
        return None
    row = np.arange(len(own))
    ends = np.flatnonzero(own.any(axis=1))[[0, -1]]
    beyond = np.maximum(np.maximum(ends[0] - row, row - ends[1]), 0) / (FADE * LENGTH)
    lacking = bare * np.maximum(1 - (1 - FAR) * beyond, FAR)[:, None]
    wrong = np.where(hidden, HIDDEN, np.where(person, 0.0, GROUND)) * (~head & within)
    outline = _outline(own, small, np.flatnonzero(ear))
    corners, local, up = small[outline], bases[:, outline], upwards(prior, seen)

    def cost(moves: Float64) -> float:
        places = corners + LENGTH * moved(moves, local, up)
        drawn = np.zeros(person.shape, np.uint8)
        cv2.fillPoly(drawn, [np.rint(places * 16).astype(np.int32)], 1, shift=4)
        covered = drawn > 0
        return (float(wrong[covered].sum() + lacking[~covered].sum()) / area
                + HELD * float(((moves / DEVIATIONS) ** 2).sum()))

    best, least = np.zeros(7), np.inf
    for start in ((0, 0), (2, 0), (-2, 0), (0, 2), (0, -2)):
        moves = np.zeros(7)
        moves[:2] = np.array(start) * DEVIATIONS[:2]
        now = cost(moves)
        for step in STEPS:
            before = np.inf
            while now < before:
                before = now
                for k, way in ((k, way) for k in range(7) for way in (-step, step)):
                    other = moves.copy()
                    other[k] += way * DEVIATIONS[k]
                    value = cost(other)
                    if value < now - ENOUGH:
                        moves, now = other, value
        if now < least:
            best, least = moves, now
    return best


def moved(moves: Float64, bases: Float64, up: Float64) -> Float64:
    """How vertices [N] move with an ear, over its length, [N, 2] (`laid_on`)."""
    return np.asarray(bases[:3].T @ moves[:6].reshape(3, 2) + moves[6] * bases[3][:, None] * up,
                      np.float64)


def upwards(prior: HeadPrior, seen: Float64) -> Float64:
    """The direction [2] up a face whose vertices lie at [N, 2]."""
    up = seen[prior.landmarks[27]] - seen[prior.landmarks[8]]
    return np.asarray(up / np.linalg.norm(up), np.float64)


def _drawn(prior: HeadPrior, places: Float64, ear: Bool, shape: tuple[int, ...],
           ) -> tuple[Bool, Bool]:
    """What an ear and what the rest of its head covers, bool [h, w], of vertices at [N, 2]."""
    corners = np.rint(places[prior.triangles] * 16).astype(np.int32)
    limit = 16 * np.array(shape[::-1])
    near = ((corners.max(axis=1) >= 0) & (corners.min(axis=1) <= limit)).all(axis=1)
    of_ear = ear[prior.triangles]
    out = []
    for part in (of_ear.all(axis=1), ~of_ear.any(axis=1)):
        cover = np.zeros(shape, np.uint8)
        for one in corners[near & part]:
            cv2.fillConvexPoly(cover, one, 1, shift=4)
        out.append(cover > 0)
    return out[0], out[1]


def _outline(mask: Bool, places: Float64, numbers: Int64) -> Int64:
    """Those of vertices that lie along the outline of a mask, in order."""
    lines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    line = max(lines, key=len)[:, 0].astype(np.float64)
    away = np.linalg.norm(line[:, None] - places[numbers][None], axis=2)
    nearest = numbers[away.argmin(axis=1)]
    return np.asarray(nearest[np.append(True, nearest[1:] != nearest[:-1])], np.int64)
