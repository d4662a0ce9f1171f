"""The patchwork behind the cheeks: pieces of hair and neck, alike in every view."""

import numpy as np

from lfportrait.example import SurfaceGuide
from lfportrait.example.guides.regions import find_regions
from lfportrait.example.surface_guide import HAIR, NECK, Patchwork, Sites
from tests.portraits import HEAD_LANDMARKS, ball_head, drawn_face


def test_the_nearest_site_is_the_nearest_of_all():
    random = np.random.default_rng(0)
    places = np.float32(random.uniform(-300, 400, (500, 2)))
    face = drawn_face(320, 240)
    patchwork = Patchwork(face, find_regions(face.image, face.landmarks, face.mask))
    sites = Sites.around(places, patchwork.side)
    flat = sites.points.reshape(-1, 2)
    away = np.linalg.norm(places[:, None] - flat, axis=2)
    found = patchwork.nearest(places, sites)
    # Beyond the neighbouring cells a site can be nearer by a part of a cell, rarely.
    assert (found == away.argmin(axis=1)).mean() > 0.97
    assert (away[np.arange(500), found] < 1.5 * patchwork.side).all()
    assert sites.chances.min() >= 0 and sites.chances.max() < 1


def test_sites_do_not_depend_on_what_is_seen():
    places = np.float32([[10, 20], [300, 250]])
    few, many = Sites.around(places[:1], 40.0), Sites.around(places, 40.0)
    column, row = few.first[0] - many.first[0], few.first[1] - many.first[1]
    part = slice(row, row + few.points.shape[0]), slice(column, column + few.points.shape[1])
    assert np.array_equal(few.points, many.points[part])
    assert np.array_equal(few.chances, many.chances[part])


def test_pieces_of_hair_come_from_the_hair():
    face = drawn_face(320, 240)
    regions = find_regions(face.image, face.landmarks, face.mask)
    patchwork = Patchwork(face, regions)
    random = np.random.default_rng(1)
    wanted = np.float32(random.uniform(-50, 300, (200, 2)))
    pieces = patchwork.pieces(wanted, np.float32(random.random((200, 2))), np.full(200, HAIR))
    assert regions.hair is not None
    assert (regions.hair[pieces[:, 1].astype(int), pieces[:, 0].astype(int)] > 0.5).all()


def test_what_the_exemplar_shows_is_no_patchwork():
    face = drawn_face(320, 240)
    patchwork = Patchwork(face, find_regions(face.image, face.landmarks, face.mask))
    # The last but one is an ear, the last a neck's back.
    angle = np.radians([0.0, 40.0, 120.0, 130.0, 110.0, 120.0])
    depth = np.array([0.3, -0.3, -0.3, 0.3, 0.3, 1.05])
    found = patchwork.materials(angle, depth, np.zeros(6, bool))
    assert found[:5].tolist() == [-1, -1, HAIR, HAIR, -1]
    assert found[5] in (-1, NECK)


def test_clothes_that_a_short_exemplar_shows_go_on():
    face = drawn_face(320, 240)
    patchwork = Patchwork(face, find_regions(face.image, face.landmarks, face.mask))
    patchwork.short, patchwork.known = True, np.array([True, True])
    angle, depth = np.radians([60.0, 60.0]), np.array([1.3, 1.3])
    assert patchwork.materials(angle, depth, np.array([False, True])).tolist() == [-1, NECK]


def test_pieces_are_rigid():
    """Behind the head most neighbours keep their distance, as in a copy."""
    guide = SurfaceGuide(HEAD_LANDMARKS, drawn_face(320, 240))
    points = ball_head(np.linspace(2.0, 2.8, 120), np.linspace(0.2, 0.5, 50))
    position, anchor = guide(points)
    moved = np.abs(np.diff(position - anchor, axis=1)).max(axis=-1)
    assert (moved < 1e-3).mean() > 0.8
