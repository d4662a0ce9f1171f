"""Signed distances from samples of a mesh."""

import numpy as np

from lfportrait.face.one_photo.samples import MeshSamples, _turned_over

HALF = np.array([0.3, 0.2, 0.008])
SHEAR = 0.6


def _lens():
    """A sheared ellipsoid as thin as an ear: vertices and triangles."""
    around, up = np.linspace(0, 2 * np.pi, 24, endpoint=False), np.linspace(-1, 1, 13)[1:-1]
    turn, rise = np.meshgrid(around, 0.5 * np.pi * up)
    ball = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], -1)
    points = HALF * np.concatenate([ball.reshape(-1, 3), [(0, 0, -1), (0, 0, 1)]])
    points[:, 2] += SHEAR * points[:, 0]
    rows = np.arange(len(up) * 24).reshape(-1, 24)
    after = np.roll(rows, -1, axis=1)
    low, high = np.full(24, points.shape[0] - 2), np.full(24, points.shape[0] - 1)
    triangles = [(rows[:-1], after[:-1], after[1:]), (rows[:-1], after[1:], rows[1:]),
                 (low, after[0], rows[0]), (high, rows[-1], after[-1])]
    return points, np.concatenate([np.stack([one.ravel() for one in part], 1)
                                   for part in triangles]).astype(np.int32)


def test_nothing_beside_a_thin_edge_is_inside():
    points, triangles = _lens()
    places = np.random.default_rng(0).uniform(-0.45, 0.45, (20000, 3)) * [1, 0.7, 0.2]
    outside = np.linalg.norm(places / HALF, axis=1) > 1
    places[:, 2] += SHEAR * places[:, 0]
    away = MeshSamples.of(points, triangles, points).distance(places, 0.1)
    far = outside & np.isfinite(away) & (np.abs(away) > 0.015)
    assert far.sum() > 5000
    assert (away[far] > 0).all()


def test_samples_that_face_away_from_all_around_are_found():
    points, triangles = _lens()
    whole = MeshSamples.of(points, triangles, points)
    normals, some = whole.normals.copy(), np.arange(50, len(whole.points), 400)
    some = some[np.abs(whole.rest[some, 2] - SHEAR * whole.rest[some, 0]) > 0.5 * HALF[2]]
    normals[some] *= -1
    found = np.flatnonzero(_turned_over(normals, whole.points, whole.tree))
    assert len(some) > 10 and np.isin(some, found).all()
    assert len(found) < 0.02 * len(normals)  # some along the thin edge
