"""Measure fits to random heads: drawn by one model, fitted with another, from one photo each.

Heads of the installed statistical head (random identities, a smile, yaw up to 20 and pitch up to 12
degrees, 0.6 to 1.1 metres away) are seen as landmarks with a pixel of noise and as an outline, no
focal length noted. They are fitted with the generic head and laid over their outlines; what another
model than the truth's makes of them is what a stranger's head gets. Nothing is rendered: depth is
known. Sizes and distances are those of the eyes: a photo knows none.

Run: python scripts/measure_random_heads.py [HEADS] [PRIOR]
         PRIOR: generic (the default), or own: the very model that the heads are of
"""

from __future__ import annotations

import sys

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from lfportrait.face.head_fit import Picture, View, fit_head
from lfportrait.face.head_prior import (
    EYES,
    FACE,
    SOCKETS,
    HeadPrior,
    generic_prior,
    head_prior,
    with_normals,
)
from lfportrait.face.one_photo.parts import signed_distance
from lfportrait.face.one_photo.warp import warped

Float64 = NDArray[np.float64]

SIZE, WIDE = 512, 110.0
"""Side of a picture; pixels between the outer corners of the eyes."""
SEEN = 0.3
"""Cosine of incidence from which on a place of a face counts."""
CELL = 0.004
"""Of the picture, over the distance, in which the nearest place hides others."""
FLIP = np.diag([1.0, -1.0, -1.0])


def random_view(true: HeadPrior, random: np.random.Generator) -> tuple[View, Float64]:
    """A camera before a random head, and the head's identity."""
    yaw, pitch = random.uniform(-20, 20), random.uniform(-12, 12)
    turn = FLIP @ Rotation.from_euler("yx", [yaw, pitch], degrees=True).as_matrix()
    expression = np.zeros(len(true.expression))
    for name in ("mouthSmile_L", "mouthSmile_R"):
        expression[true.expressions.index(name)] = random.uniform(0, 0.5)
    away = random.uniform(0.6, 1.1)
    identity = random.normal(size=len(true.identity))
    shape = true.shape(identity, expression)
    eyes = float(np.linalg.norm(np.subtract(*shape[true.landmarks[[36, 45]]])))
    shift = np.array([0, 0, away]) - turn @ shape[true.landmarks].mean(axis=0)
    return View(turn, shift, WIDE * away / eyes, np.full(2, SIZE / 2), expression), identity


def pictured(true: HeadPrior, view: View, shape: Float64, random: np.random.Generator) -> Picture:
    """What a photo shows: landmarks and an outline."""
    pixels = view.project(shape)
    matte = np.zeros((SIZE, SIZE), np.uint8)
    for corners in np.rint(pixels[true.triangles]).astype(np.int32):
        cv2.fillConvexPoly(matte, corners, 1)
    # Shoulders: below the neck's end all is person.
    rows = np.arange(SIZE)[:, None]
    matte[np.broadcast_to(rows > pixels[:, 1].max() - 6, matte.shape)] = 1
    landmarks = pixels[true.landmarks]
    landmarks = 2 * landmarks - true.vertices_seen(landmarks)  # where detectors put them
    landmarks += random.normal(size=(68, 2))
    return Picture((SIZE, SIZE), landmarks, None, signed_distance(matte.astype(np.float32)),
                   np.zeros((SIZE, SIZE), np.float32))


def turned_back(points: Float64, one: Float64, two: Float64) -> Float64:
    """Points moved and turned as ``one`` is to lie on ``two``, [N, 3] (Umeyama 1991)."""
    left, right = one - one.mean(axis=0), two - two.mean(axis=0)
    u, _, v = np.linalg.svd(right.T @ left)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    return np.asarray((points - one.mean(axis=0)) @ turn.T + two.mean(axis=0), np.float64)


def nearest(points: Float64, cosine: Float64) -> NDArray[np.bool_]:
    """Which points [N, 3] of a surface nothing lies before: a mouth is hollow."""
    cells = np.floor(points[:, :2] / points[:, 2:] / CELL).astype(int)
    cells -= cells.min(axis=0)
    flat = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    front = np.full(flat.max() + 1, np.inf)
    np.minimum.at(front, flat, points[:, 2])
    slope = 2 * CELL * points[:, 2] * np.sqrt(1 / np.clip(cosine, 0.1, 1) ** 2 - 1)
    return np.asarray((cosine > 0.1) & (points[:, 2] < front[flat] + 0.003 + slope))


def off(true: HeadPrior, view: View, shape: Float64, mine: HeadPrior, points: Float64,
        ) -> tuple[float, float]:
    """Millimetres (root mean square) by which a head is off: the face's depth; skull and ears.

    ``points`` lie in the camera's frame and have the truth's size.
    """
    local = view.to_camera(shape)
    normals = with_normals(points, mine.triangles)
    facing = -(normals * points).sum(axis=1) / np.linalg.norm(points, axis=1)
    front = nearest(points, facing) & ~np.isin(mine.part, (SOCKETS, EYES))
    depth = LinearNDInterpolator(points[front, :2] / points[front, 2:], points[front, 2])
    cosine = -(with_normals(shape, true.triangles) @ view.rotation.T * local).sum(axis=1)
    cosine /= np.linalg.norm(local, axis=1)
    face = (true.part == FACE) & (cosine > SEEN) & nearest(local, cosine)
    row = view.project(shape)[:, 1]
    chin, brows = (float(row[true.landmarks[numbers]].mean()) for numbers in ([8], [19, 24]))
    face &= (row < chin) & (row > brows - 0.3 * (chin - brows))
    away = depth(local[face, :2] / local[face, 2:]) - local[face, 2]
    away = away[np.isfinite(away)]
    away -= np.median(away)
    skull = (true.part != FACE) & ~np.isin(true.part, (SOCKETS, EYES))
    skull &= shape[:, 1] > shape[true.landmarks[8], 1] + 0.04  # neither neck nor jaw
    length, close = cKDTree(points).query(local[skull])
    along = ((local[skull] - points[close]) * normals[close]).sum(axis=1)
    length = np.where(length < 0.01, np.abs(along), length)
    return (1000 * float(np.sqrt((away ** 2).mean())),
            1000 * float(np.sqrt((length ** 2).mean())))


def main(heads: int, name: str) -> None:
    """Print a line a head, then the means."""
    true = head_prior()
    mine = generic_prior() if name == "generic" else true
    found = []
    for number in range(heads):
        random = np.random.default_rng(number)
        view, identity = random_view(true, random)
        shape = true.shape(identity, view.expression)
        picture = pictured(true, view, shape, random)
        fit = fit_head(mine, [picture])
        points = warped(mine, fit.views[0], fit.vertices(0), picture)
        local = view.to_camera(shape)
        # At the size that eyes have; a photo knows no other.
        eyes = [np.linalg.norm(np.subtract(*one[model.landmarks[[36, 45]]]))
                for one, model in ((local, true), (points, mine))]
        points *= eyes[0] / eyes[1]
        points += (local[true.landmarks[17:]] - points[mine.landmarks[17:]]).mean(axis=0)
        straight = turned_back(points, points[mine.landmarks[17:]], local[true.landmarks[17:]])
        turned = [fit.views[0].angles[one] - view.angles[one] for one in ("yaw", "pitch")]
        found.append((*off(true, view, shape, mine, points),
                      *off(true, view, shape, mine, straight), *np.abs(turned)))
        print(f"{number}: " + " ".join(f"{one:.1f}" for one in found[-1]), flush=True)
    means, worst = np.mean(found, axis=0), np.max(found, axis=0)
    print(f"{heads} heads, {mine.name}; millimetres, the worst head in brackets:")
    for what, at in (("as fitted", 0), ("turned onto the truth's landmarks", 2)):
        print(f"{what}: face {means[at]:.1f} ({worst[at]:.1f}), skull and ears "
              f"{means[at + 1]:.1f} ({worst[at + 1]:.1f})")
    print(f"yaw is off by {means[4]:.1f} degrees, pitch by {means[5]:.1f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50,
         sys.argv[2] if len(sys.argv) > 2 else "generic")
