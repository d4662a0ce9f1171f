"""Lay a fitted head over its photo: what the landmarks and the outline leave over.

Moved in the picture's plane alone, by a thin-plate spline; with one photo, depths stay the model's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ...arrays import Float64
from ..head_fit import (
    NEAR_JAW,
    Found,
    HeadFit,
    Picture,
    View,
    across_jaw,
    jaw_vertices,
    outline_errors,
    outline_vertices,
    run_alike,
)
from ..head_prior import EYES, HeadPrior, with_normals
from .ears import DEVIATIONS, ear_of, laid_on, moved, shows, upwards
from .solid import STANDS, standing_out

OUTLINES = 110  # Places of the outline, at most, that are moved to the matte's.
FARTHEST = 0.2  # They move at most this part of the distance of the eyes.
ALONG = 0.3
"""Cosine of the angle between the model's outline and the matte's from which on these are the same.
"""
STIFF = 0.3
"""Smoothing of the spline: landmarks that contradict their neighbours are not followed wholly."""
FLAT = 0.4  # An ear is made no flatter than this.
AROUND = 0.02  # So far around an ear the head moves with it, metres.
BESIDE = (0.045, 0.15)
"""Heights (metres, `HeadPrior.rest`) between which the outline is that of an ear, if so much of it
is seen, and not the head's."""
SHOWN = 0.25  # Of an ear.
CHEEKS = (0, 1, 2), (14, 15, 16)
"""Landmarks of the edges of cheeks before ears."""
EDGE = 0.2  # Cosine of incidence up to which a cheek ends there.
CHIN = slice(5, 12)  # Landmarks of the chin.
NEAR = 0.1  # The matte knows the outline so near to it, over the eyes' distance.
TURNS, HELD, LONGEST = 2, 0.05, 0.006
"""Rounds over all photos; how much a vertex that few photos see well is held; metres that it moves
at most in a round."""
SMOOTHED = 40  # How often vertices move as their neighbors do, or an ear would fold.


def warped(prior: HeadPrior, view: View, vertices: Float64, picture: Picture) -> Float64:
    """A head in the camera's frame, moved so that landmarks and outline meet.

    Parameters
    ----------
    vertices : float64 [N, 3] in the model's frame.

    Returns
    -------
    points : float64 [N, 3] in the camera's frame, metres.
    """
    out = view.to_camera(vertices)
    moved = view.project(vertices) + _moves(prior, view, vertices, picture, alone=True)
    out[:, :2] = (moved - view.center) / view.focal * out[:, 2:]
    return out


def warped_together(fit: HeadFit, pictures: list[Picture],
                    found: list[list[Found]] | None = None) -> Float64:
    """A head in the first camera's frame, moved so that it meets all photos.

    Every photo says how far a vertex moves in its own plane, and the more the more squarely it
    looks at it; together, by least squares, they also say how deep it lies.

    Parameters
    ----------
    found : For each photo what it shows of the first one's places (`found_again`): there its
        landmarks say nothing.

    Returns
    -------
    points : float64 [N, 3], metres, in the first photo's expression.
    """
    if len(pictures) == 1:
        return warped(fit.prior, fit.views[0], fit.vertices(0), pictures[0])
    start = fit.vertices(0)
    points = start.copy()
    mixing = _neighbors(fit.prior)
    for _ in range(TURNS):
        # Seen from the middle: around an ear the surface itself looks everywhere.
        outward = points - 0.5 * (points.min(axis=0) + points.max(axis=0))
        outward /= np.linalg.norm(outward, axis=1)[:, None]
        matrix = np.broadcast_to(HELD * np.eye(3), (len(points), 3, 3)).copy()
        right = np.zeros((len(points), 3))
        for number, (view, picture) in enumerate(zip(fit.views, pictures, strict=True)):
            shown = points + (fit.vertices(number) - start)
            local = view.to_camera(shown)
            seen = found[number] if found is not None and number else []
            move = (_moves(fit.prior, view, shown, picture, seen) * local[:, 2:] / view.focal)
            cosine = -(outward @ view.rotation.T)[:, 2]
            weight = np.clip((cosine + 0.3) / 0.8, 0.02, 1.0)[:, None]
            plane = view.rotation[:2]
            matrix += weight[:, :, None] * (plane.T @ plane)
            right += weight * (move @ plane)
        move = np.asarray(np.linalg.solve(matrix, right[:, :, None])[:, :, 0], np.float64)
        for _ in range(SMOOTHED):
            move = mixing @ move
        length = np.linalg.norm(move, axis=1)[:, None]
        points += move * np.minimum(1.0, LONGEST / np.maximum(length, 1e-9))
    for ball in _eyeballs(fit.prior, start):
        points[ball] = start[ball] + (points[ball] - start[ball]).mean(axis=0)
    return fit.views[0].to_camera(points)


def _neighbors(prior: HeadPrior) -> sparse.csr_array:
    """A matrix [N, N] that makes of values of vertices the means with their neighbors."""
    one, two = prior.triangles.ravel(), np.roll(prior.triangles, 1, axis=1).ravel()
    count = len(prior.mean)
    rows, columns = np.concatenate([one, two]), np.concatenate([two, one])
    links = sparse.coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    links.data[:] = 1.0
    links = links + sparse.eye_array(count)
    return sparse.csr_array(sparse.diags_array(1.0 / links.sum(axis=1)) @ links)


def _moves(prior: HeadPrior, view: View, vertices: Float64, picture: Picture,
           found: Sequence[Found] = (), alone: bool = False) -> Float64:
    """How far vertices [N, 3] are to move in a photo, which may be the only one, pixels [N, 2]."""
    from scipy.interpolate import RBFInterpolator

    seen = view.project(vertices)
    landmarks = prior.vertices_seen(picture.landmarks)
    normals = with_normals(vertices, prior.triangles)
    # Several photos show ears from more sides, and vertices move as their neighbors do.
    stands = standing_out(prior.rest) if alone else np.zeros(len(vertices))
    inner, ears = prior.landmarks[17:], stands > STANDS
    from_, by = [seen[inner]], [landmarks[17:] - seen[inner]]
    if found:
        from_ = [seen[one.vertices] for one in found]
        by = [one.places - places for one, places in zip(found, from_, strict=True)]
    beside = [alone and shows(prior, seen, side) > SHOWN for side in (-1, 1)]
    if picture.inside is not None:
        rim = outline_vertices(view, prior, vertices, normals, neck=True)
        away, slope, hair = outline_errors(picture, seen[rim], view)
        good = (np.abs(away) < FARTHEST * picture.eyes) & ~((hair > 0.5) & (away > 0))
        # Beside a jaw or a neck the matte's outline may be that of a collar or a shoulder.
        good &= run_alike(view, normals[rim], slope, ALONG)
        rim, away, slope = rim[good], away[good], slope[good]
        # At its height an ear is the outline.
        height, shown = prior.rest[rim, 1], np.where(prior.rest[rim, 0] < 0, *beside)
        head = np.flatnonzero(~ears[rim]
                              & ~(shown & (height > BESIDE[0]) & (height < BESIDE[1])))
        chosen = head[_spread(seen[rim[head]], OUTLINES)]
        from_.append(seen[rim[chosen]])
        by.append(-away[chosen, None] * slope[chosen])
    for side, shows_it in zip((-1, 1), beside, strict=True):
        if shows_it:
            cheek, move = _cheek(view, prior, vertices, normals, landmarks, side)
            from_.append(seen[cheek])
            by.append(move)
    if not found:
        chin, move = _chin(prior, view, vertices, normals, picture)
        from_.append(seen[chin])
        by.append(move)
    middle, size = seen.mean(axis=0), float(np.ptp(seen, axis=0).max())
    corners = middle + 1.5 * size * np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)
                                              if x or y])
    from_.append(corners)
    by.append(np.zeros((8, 2)))
    at, moves = np.concatenate(from_), np.concatenate(by)
    at, first = np.unique(np.round(at, 3), axis=0, return_index=True)
    spline = RBFInterpolator(at / size, moves[first], kernel="thin_plate_spline",
                             smoothing=STIFF / size)
    # Ears move as the places that they stand on.
    roots = vertices - np.stack([np.sign(vertices[:, 0]) * stands, 0 * stands, 0 * stands], axis=1)
    out = np.asarray(spline(view.project(roots) / size), np.float64)
    # An eyeball stays a ball: it moves as a whole.
    for ball in _eyeballs(prior, vertices):
        out[ball] = out[ball].mean(axis=0)
    if picture.inside is not None and alone:
        out += _ear_moves(prior, view, vertices, seen + out, picture)
    return out


def _ear_moves(prior: HeadPrior, view: View, vertices: Float64, seen: Float64, picture: Picture,
               ) -> Float64:
    """How far vertices [N, 3] of ears are to move besides, pixels [N, 2].

    An ear that is turned away, or smaller than the model's, would be folded by its own outline: it
    moves as a whole, and stands out more or less or elsewhere. One that is not seen does so as the
    other one, within `DEVIATIONS`.

    Parameters
    ----------
    seen : float64 [N, 2], where they lie in the photo by now.
    """
    rest, out = prior.rest, standing_out(prior.rest)
    local = view.to_camera(vertices)
    up = upwards(prior, seen)
    found: list[Float64 | None] = []
    bases, sizes = [], []
    for side in (-1, 1):
        ear = ear_of(prior, side)
        low, high = rest[ear].min(axis=0), rest[ear].max(axis=0)
        size, middle = high[1] - low[1], 0.5 * (low + high)
        away = np.linalg.norm(np.maximum(np.maximum(low - rest, rest - high), 0), axis=1)
        near = np.clip(1 - away / AROUND, 0, 1)
        near = near * near * (3 - 2 * near)
        height = (rest[:, 1] - middle[1]) / size
        stands = np.where(side * rest[:, 0] > 0, out, 0) / size
        bases.append(np.stack([near, stands, 2 * stands * height, near * height]))
        # Pixels to its length.
        sizes.append(size * view.focal / float(local[ear, 2].mean()))
        found.append(laid_on(prior, seen, bases[-1], sizes[-1], side, picture))
    # Mirrored in the model's plane: how deep it moves no photo shows.
    moves, turn = np.zeros((len(rest), 2)), view.rotation
    for k, side in enumerate((-1, 1)):
        own, other = found[k], found[1 - k]
        if own is None and other is None:
            continue
        if own is None:
            assert other is not None
            across = other[:6].reshape(3, 2)
            like = np.linalg.solve(turn[:2, :2], across.T) * [[-1.0], [1.0]]
            like = (turn[:2, :2] @ like).T
            # Of a head that is turned far the photo shows little of this.
            most, length = (np.linalg.norm(one, axis=1, keepdims=True) for one in (across, like))
            like *= np.minimum(1.0, most / np.maximum(length, 1e-9))
            # One that stands out very far may do so on its side alone.
            own = np.clip(np.append(like.ravel(), other[6]), -DEVIATIONS, DEVIATIONS)
        best = own[:6].reshape(3, 2).copy()
        flatter = -(best[1] @ turn[:2, 0]) * side + np.abs(best[2] @ turn[:2, 0])
        best[1:] *= min(1.0, (1 - FLAT) / max(float(flatter), 1e-9))
        moves += sizes[k] * moved(np.append(best.ravel(), own[6]), bases[k], up)
    return moves


def _chin(prior: HeadPrior, view: View, vertices: Float64, normals: Float64, picture: Picture,
          ) -> tuple[NDArray[np.int64], Float64]:
    """Vertices of the chin's edge and their moves across it: before a neck no matte shows it."""
    landmarks = prior.vertices_seen(picture.landmarks)
    if picture.jaw is not None:
        shown = np.flatnonzero(np.isfinite(picture.jaw[:, 0]))
        landmarks = landmarks.copy()
        landmarks[shown] = picture.jaw[shown]
    jaw = jaw_vertices(view, prior, vertices, normals, landmarks)[CHIN]
    seen, across = view.project(vertices[jaw]), across_jaw(landmarks)[CHIN]
    away = ((landmarks[CHIN] - seen) * across).sum(axis=1)
    good = np.abs(away) < FARTHEST * picture.eyes
    if picture.inside is not None:
        height, width = picture.inside.shape
        column, row = np.clip(seen.T.astype(int), 0, [[width - 1], [height - 1]])
        good &= picture.inside[row, column] > NEAR * picture.eyes
    return jaw[good], (away[:, None] * across)[good]


def _cheek(view: View, prior: HeadPrior, vertices: Float64, normals: Float64, landmarks: Float64,
           side: int) -> tuple[NDArray[np.int64], Float64]:
    """Vertices of a cheek's edge before its ear, and their moves across it.

    Of a face that is turned landmarks of the nearer cheek lie on no edge, and say less.
    """
    across = across_jaw(landmarks)
    local, turned = view.to_camera(vertices), normals @ view.rotation.T
    facing = np.abs((turned * local).sum(axis=1)) / np.linalg.norm(local, axis=1)
    rim = np.flatnonzero((facing < EDGE) & (prior.part != EYES) & (prior.rest[:, 2] > -0.01)
                         & (standing_out(prior.rest) <= 0))
    flat = turned[rim, :2] / np.maximum(np.linalg.norm(turned[rim, :2], axis=1), 1e-9)[:, None]
    seen, chosen, moves = view.project(vertices[rim]), [], []
    trust = 1 / (1 + NEAR_JAW * max(0.0, -float(view.rotation[2, 0]) * side))
    width = float(np.linalg.norm(landmarks[45] - landmarks[36]))
    for number in CHEEKS[int(side > 0)]:
        out = across[number]
        near = np.linalg.norm(vertices[rim] - vertices[prior.landmarks[number]], axis=1) < 0.03
        level = np.abs((seen - landmarks[number]) @ [-out[1], out[0]]) < 0.05 * width
        beside = np.flatnonzero(near & level & (flat @ out > 0.7))
        if len(beside):
            best = beside[int((seen[beside] @ out).argmax())]
            chosen.append(int(rim[best]))
            moves.append(trust * ((landmarks[number] - seen[best]) @ out) * out)
    return np.array(chosen, np.int64), np.reshape(moves, (-1, 2)).astype(np.float64)


def _eyeballs(prior: HeadPrior, vertices: Float64) -> list[NDArray[np.bool_]]:
    """Masks [N] of the two eyeballs."""
    balls = [(prior.part == EYES) & side for side in (vertices[:, 0] < 0, vertices[:, 0] >= 0)]
    return [ball for ball in balls if ball.any()]


def _spread(points: Float64, most: int) -> NDArray[np.int64]:
    """Indices of up to ``most`` of points [N, 2], evenly spread: one a cell of a grid."""
    if len(points) <= most:
        return np.arange(len(points), dtype=np.int64)
    size = float(np.ptp(points, axis=0).sum()) * 2 / most
    cells = np.floor(points / max(size, 1e-9)).astype(np.int64)
    return np.asarray(np.unique(cells, axis=0, return_index=True)[1], np.int64)
