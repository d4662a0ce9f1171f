"""Pieces of a person's solid: where they are, and where their surfaces only lead out of sight."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo import lattice
from lfportrait.face.one_photo.hair import Neck
from lfportrait.face.one_photo.parts import parts_of
from lfportrait.face.one_photo.piece import EDGE, METRES, Piece
from lfportrait.face.one_photo.samples import MeshSamples, depth_maps
from lfportrait.face.one_photo.solid import BODY, LEANING, _beside, _one_neck, _raised, solid_of


def test_hair_is_only_a_little_beyond_where_it_grows():
    ahead, behind = np.zeros((2, 20, 30), bool)
    ahead[6:9, 6:20], behind[6:14, 6:20] = True, True
    piece = Piece(np.ones((20, 30)), np.ones((20, 30)), np.full((20, 30), 3.0), ahead, behind)
    around = range(-EDGE, EDGE + 1)
    row, column = (part.ravel() for part in np.mgrid[-6:26, -6:36])
    places = np.stack([row, column]).astype(float)
    for depth, part in ((2.9, ahead), (3.1, behind)):
        found = piece.covers(places, np.full(len(row), depth))
        grown = {(y + dy, x + dx) for y, x in np.argwhere(part) for dy in around
                 for dx in around}
        assert {(y, x) for y, x, yes in zip(row, column, found, strict=True) if yes} == grown


def test_without_parts_a_piece_is_anywhere():
    piece = Piece(*(np.ones((4, 4)) for _ in range(3)))
    assert piece.covers(np.zeros((2, 3)), np.array([0.5, 1.0, 2.0])).all()


@pytest.fixture(scope="module")
def bust():
    """The generic head, with a thick neck, on drawn shoulders."""
    prior = generic_prior()
    points = prior.mean.astype(float) / METRES
    points[:, 2] = 1.5 * (points[:, 2] - points[:, 2].mean())
    camera = Camera.arc(np.zeros(1), distance=4.0, width=320, height=320, focal=560.0,
                        target=(0, -0.25, 0), pitch=0.0)
    matte = np.zeros((320, 320), np.uint8)
    for corners in np.rint(camera.project(points)[0][0][prior.triangles]).astype(np.int32):
        cv2.fillConvexPoly(matte, corners, 1)
    shoulders = np.array([(-0.24, -0.62, 0), (0.24, -0.62, 0), (0.9, -0.95, 0), (0.95, -2, 0),
                          (-0.95, -2, 0), (-0.9, -0.95, 0)])
    cv2.fillPoly(matte, [np.rint(camera.project(shoulders)[0][0]).astype(np.int32)], 1)
    parts = parts_of(camera, matte.astype(np.float32), np.zeros(matte.shape, np.float32), 4.0)
    return solid_of(parts, MeshSamples.of(points, prior.outer, prior.rest))


# Each side and each lean once.
@pytest.mark.parametrize(("across", "side"), [
    (-0.2, 1), (0.2, -1), *(pytest.param(*one, marks=pytest.mark.slow) for one in (
        (-0.2, -1), (0.0, -1), (0.0, 1), (0.2, 1)))])
def test_a_neck_runs_into_the_shoulders_without_a_ledge(bust, across, side):
    heights = np.arange(-0.6, -1.0, -0.02)
    depths = np.arange(0.0, 1.2, 0.005)
    found = []
    for height in heights:
        points = np.stack([np.full(len(depths), across), np.full(len(depths), height),
                           side * depths[::-1]], axis=1)
        distance = bust.distance(points, 0.1)[0]
        assert (distance < 0).any()
        found.append(depths[::-1][int(np.argmax(distance < 0))])  # from outside, the first within
    steps = np.diff(found)
    assert np.abs(steps).max() < 0.05  # at most two and a half times as far as down
    assert np.abs(np.diff(steps)).max() < 0.025  # and round


def test_shoulders_lie_behind_a_neck(bust):
    middle = bust.body.middle
    row, column = np.unravel_index(np.argmin(middle), middle.shape)
    assert middle[-1, column] > middle[row, column] + 0.25
    assert min(middle[row, 0], middle[row, -1]) > middle[row, column] + 0.25


def test_what_lies_beside_a_neck_stays():
    way = np.array([0.0, 0.01, 0.5, 0.99, 1.0])
    above = -0.1 * way
    head, body = np.full(5, 0.5), np.full(5, -0.05)
    joined, of_body = _one_neck(head, body, way, above)
    assert (joined[2:] < 0).all() and of_body[2:].all()
    # The neck itself goes over from one to the other.
    joined, _ = _one_neck(np.full(5, 0.02), np.full(5, -0.02), way, above)
    assert joined == pytest.approx([0.02, 0.02, 0.0, -0.02, -0.02], abs=1e-3)


def test_shoulders_may_reach_to_the_ears(bust):
    parts, near = bust.parts, depth_maps(bust.head, bust.parts)[0]
    place = Neck.of(parts, bust.head)
    assert not _raised(parts, near, place)[:int(place.jaw)].any(), "these hang down"
    row, column = int(0.5 * (place.ears + place.jaw)), int(place.right)
    inside = parts.inside.copy()
    inside[row:, column:column + 60] = 9.0
    found = _raised(replace(parts, inside=inside), near, place)
    assert found[row + 12, column + 20:column + 40].all()
    assert found[int(place.end) + 10, column + 20:column + 40].all(), "without a gap above the body"
    assert not found[int(place.end) + round(LEANING / parts.cell) + 3:].any()
    assert not found[int(place.end) + 2:, :column].any(), "nor where it is not raised"
    assert not found[:int(place.ears)].any() and not (found & np.isfinite(near)).any()
    higher = inside.copy()
    higher[int(place.ears) - 60:, column + 20:column + 80] = 9.0
    assert not _raised(replace(parts, inside=higher), near, place)[:, column:].any(), "a chair"
    # What is bare above a collar is neck; bare shoulders stay.
    collar = np.zeros(inside.shape, bool)
    collar[row + 20:] = True
    worn = _raised(replace(parts, inside=inside), near, place, collar)
    assert np.array_equal(worn, found & collar) and (found & ~collar).any()
    bare = _raised(replace(parts, inside=inside), near, place, np.zeros_like(collar))
    assert np.array_equal(bare, found)
    inside[int(place.jaw):] = -9.0
    assert not _raised(replace(parts, inside=inside), near, place).any(), "no body holds them"


def test_raised_shoulders_end_smoothly(bust):
    """Not in steps of the cells of their mask."""
    shown = np.zeros((60, 60), bool)
    rows, columns = np.mgrid[:60, :60]
    shown[rows > 20 + 0.37 * columns] = True
    away = _beside(shown, 0.0075) / 0.0075
    true = (20 + 0.37 * columns - rows) / np.hypot(1, 0.37)
    near = (np.abs(true) < 6) & (np.abs(columns - 30) < 15)
    assert np.abs(away - true)[near].max() < 1.0
    assert np.std((away - true)[near]) < 0.25
    parts = bust.parts
    row, column = (int(one) for one in Neck.of(parts, bust.head)[2:4])
    high = np.zeros(parts.inside.shape, bool)
    high[row - 30:row + 10, column - 60:column - 10] = True
    block = Piece(*(np.full(high.shape, one) for one in (0.04, 0.04, bust.body.middle.mean())))
    solid = replace(bust, body=block, raised=_beside(high, parts.cell))
    eye, rays = parts.camera.rays(0, np.array([[column - 35.0, r + 0.5] for r in
                                               np.arange(row - 40.0, row - 20, 0.1)]))
    forward = parts.camera.pose[0, :3, 2]
    points = eye + rays * (bust.body.middle.mean() / (rays @ forward))[:, None]
    distance, owner = solid.distance(points, 0.1)
    edge = int(np.argmax(distance < 0))
    assert (distance[edge:edge + 20] < 0).all() and (owner[edge:edge + 20] == BODY).all()
    assert np.abs(np.diff(distance[edge - 20:edge + 20])).max() < 0.003, "no jump at the edge"


def test_a_body_ends_smoothly_beside_a_neck():
    """At the joint's upper end distances do not jump from within to far outside."""
    above = np.linspace(-0.1, 0.1, 201)
    head, body = np.full(201, 0.5), np.full(201, -0.2)
    found, of_body = _one_neck(head, body, (above < 0).astype(float), above)
    assert np.abs(np.diff(found)).max() < 0.005 and of_body[:100].all()
    assert (found[:100] < 0).all() and (found[101:] > 0).all()
    # What is head stays where the body is far.
    found, _ = _one_neck(np.full(9, -0.1), np.full(9, 0.5), np.zeros(9), np.linspace(-0.1, 0.1, 9))
    assert found == pytest.approx(np.full(9, -0.1))


def test_a_body_is_not_in_the_head_that_hides_it(bust):
    """There it would be torn where a jaw meets a shoulder."""
    near = depth_maps(bust.head, bust.parts)[0]
    place = Neck.of(bust.parts, bust.head)
    face = np.isfinite(near)
    face[int(place.jaw):] = False
    assert face.any() and bust.body.ahead is not None and not bust.body.ahead[face].any()


def test_shoulders_without_a_collar_lose_nothing(bust, monkeypatch):
    taken = []

    def counted(distance, *rest):
        out = without_blades(distance, *rest)
        taken.append(int((out != distance).sum()))
        return out

    without_blades = lattice._without_blades
    monkeypatch.setattr(lattice, "_without_blades", counted)
    lattice.shell_of(bust, 96)
    assert taken == [0]
