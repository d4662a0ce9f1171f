"""Measure fits to random heads: drawn by one model, fitted with another, from one photo each.

Heads of the installed statistical head (random identities, a smile, yaw up to 20 and pitch up to 12
degrees, 0.6 to 1.1 metres away) are seen as landmarks with a pixel of noise and as an outline, no
focal length noted. They are fitted with the generic head and laid over their outlines; what another
model than the truth's makes of them is what a stranger's head gets. Nothing is rendered: depth is
known. Sizes and distances are those of the eyes: a photo knows none.

Run: python scripts/measure_random_heads.py [HEADS] [PRIOR]
         PRIOR: generic (the default); own: the very model that the heads are of; or mean: that
         model's mean alone
"""

from __future__ import annotations

import sys
from dataclasses import replace

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
SQUARE = 0.6
"""Cosine from which on it is seen squarely: along the rays a cheek's edge is far off at once."""
CELL = 0.004
"""Of the picture, over the distance, in which the nearest place hides others."""
ROUNDS = 12
"""Of laying a surface on places."""
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


def seen_face(true: HeadPrior, view: View, shape: Float64, least: float = SEEN,
              ) -> NDArray[np.bool_]:
    """Which of a head's vertices are face, between chin and brows and a little above, and seen.

    ``least`` is their cosine of incidence.
    """
    local = view.to_camera(shape)
    cosine = -(with_normals(shape, true.triangles) @ view.rotation.T * local).sum(axis=1)
    cosine /= np.linalg.norm(local, axis=1)
    face = (true.part == FACE) & (cosine > least) & nearest(local, cosine)
    row = view.project(shape)[:, 1]
    chin, brows = (float(row[true.landmarks[numbers]].mean()) for numbers in ([8], [19, 24]))
    return np.asarray(face & (row < chin) & (row > brows - 0.3 * (chin - brows)))


def laid_on(points: Float64, triangles: NDArray[np.int32], places: Float64) -> Float64:
    """Points moved, turned and scaled so that their surface lies best on places (planes' ICP)."""
    for _ in range(ROUNDS):
        normals = with_normals(points, triangles)
        close = cKDTree(points).query(places)[1]
        one, normal = points[close], normals[close]
        middle = one.mean(axis=0)
        rows = np.column_stack([np.cross(one - middle, normal), normal,
                                ((one - middle) * normal).sum(axis=1)])
        step = np.linalg.lstsq(rows, ((places - one) * normal).sum(axis=1), rcond=None)[0]
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        points = (1 + step[6]) * (points - middle) @ turn.T + middle + step[3:6]
    return points


def off(true: HeadPrior, view: View, shape: Float64, mine: HeadPrior, points: Float64,
        ) -> tuple[float, float, float, float]:
    """Millimetres (root mean square) by which a head is off.

    The face's depth along the camera's rays; that of its places seen squarely; how far the face
    lies from the surface; the same of skull and ears. ``points`` lie in the camera's frame and
    have the truth's size.
    """
    local = view.to_camera(shape)
    normals = with_normals(points, mine.triangles)
    facing = -(normals * points).sum(axis=1) / np.linalg.norm(points, axis=1)
    front = nearest(points, facing) & ~np.isin(mine.part, (SOCKETS, EYES))
    depth = LinearNDInterpolator(points[front, :2] / points[front, 2:], points[front, 2])
    face, square = (seen_face(true, view, shape, least) for least in (SEEN, SQUARE))
    away = depth(local[face, :2] / local[face, 2:]) - local[face, 2]
    away -= np.nanmedian(away)
    squarely = away[square[face]]
    skull = (true.part != FACE) & ~np.isin(true.part, (SOCKETS, EYES))
    skull &= shape[:, 1] > shape[true.landmarks[8], 1] + 0.04  # neither neck nor jaw
    tree = cKDTree(points)

    def from_surface(places: Float64) -> Float64:
        length, close = tree.query(places)
        along = ((places - points[close]) * normals[close]).sum(axis=1)
        return np.where(length < 0.01, np.abs(along), length)

    one, two, three, four = (
        1000 * float(np.sqrt(np.nanmean(each ** 2)))
        for each in (away, squarely, from_surface(local[face]), from_surface(local[skull])))
    return one, two, three, four


def main(heads: int, name: str) -> None:
    """Print a line a head, then the means."""
    true = head_prior()
    mine = generic_prior() if name == "generic" else true
    if name == "mean":
        mine = replace(true, identity=true.identity[:0])
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
        best = laid_on(points, mine.triangles, local[seen_face(true, view, shape)])
        turned = [fit.views[0].angles[one] - view.angles[one] for one in ("yaw", "pitch")]
        focal = 100 * np.log(fit.views[0].focal / view.focal)
        found.append((*off(true, view, shape, mine, points),
                      *off(true, view, shape, mine, straight),
                      *off(true, view, shape, mine, best), *np.abs(turned), focal))
        print(f"{number}: " + " ".join(f"{one:.1f}" for one in found[-1]), flush=True)
    means, worst = np.mean(found, axis=0), np.max(found, axis=0)
    print(f"{heads} heads, {mine.name}; millimetres, the worst head in brackets:")
    for what, at in (("as fitted", 0), ("turned onto the truth's landmarks", 4),
                     ("turned and scaled onto the truth's face", 8)):
        each = [f"{means[at + k]:.1f} ({worst[at + k]:.1f})" for k in range(4)]
        print(f"{what}: depth of the face {each[0]}, where it is seen squarely {each[1]}, from its "
              f"surface {each[2]}; skull and ears {each[3]}")
    print(f"yaw is off by {means[12]:.1f} degrees, pitch by {means[13]:.1f}")
    lengths = np.array(found)[:, 14]
    print(f"the focal length is off by {lengths.mean():+.0f} % in the mean, root mean square "
          f"{np.sqrt((lengths ** 2).mean()):.0f} %")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50,
         sys.argv[2] if len(sys.argv) > 2 else "generic")
