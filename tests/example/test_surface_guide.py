"""The unwrapping of a head, and the map to the exemplar on nodes of the unwrapped plane."""

import numpy as np
import pytest

from lfportrait.errors import UserError
from lfportrait.example import SurfaceGuide
from lfportrait.example.kernels.atlas import sample_nodes
from lfportrait.example.surface_guide import HeadPlane
from tests.portraits import HEAD_LANDMARKS, ball_head, drawn_face


@pytest.fixture(scope="module")
def plane():
    return HeadPlane(HEAD_LANDMARKS)


@pytest.fixture(scope="module")
def guide():
    return SurfaceGuide(HEAD_LANDMARKS, drawn_face(320, 240))


def around(plane, angle, height, reach=0.5):
    """Points at an angle from forward and a height over the brows."""
    angle, height = np.broadcast_arrays(angle, height)
    return plane.origin + np.stack([reach * np.sin(angle), height, reach * np.cos(angle)], axis=-1)


def test_a_head_is_measured_by_its_landmarks(plane):
    brows, chin = HEAD_LANDMARKS[17:27, 1].mean(), HEAD_LANDMARKS[:, 1].min()
    assert plane.height == pytest.approx(brows - chin)
    assert plane.origin[0] == pytest.approx(0, abs=1e-9) and plane.origin[1] == pytest.approx(brows)
    assert plane.origin[2] == pytest.approx(HEAD_LANDMARKS[[0, 16], 2].mean())
    assert plane.known.all() and 0.4 < plane.radius < 0.6


def test_below_the_brows_the_plane_is_a_cylinders(plane):
    angle, height = np.linspace(-3.1, 3.1, 41), np.linspace(-0.8, 0, 9)[:, None] * plane.height
    flat = plane.unwrap(around(plane, angle, height))
    assert np.allclose(flat[..., 0], plane.radius * angle)
    assert np.allclose(flat[..., 1], -height)
    # How far a point lies from the axis does not matter.
    assert np.allclose(plane.unwrap(around(plane, angle, height, 0.2)), flat)


def test_above_the_brows_it_is_a_domes(plane):
    random = np.random.default_rng(0)
    away = random.normal(0, 1, (200, 3))
    away[:, 1] = np.abs(away[:, 1])
    flat = plane.unwrap(plane.origin + away)
    angle = np.arccos(away[:, 2] / np.linalg.norm(away, axis=1))
    assert np.allclose(np.linalg.norm(flat, axis=1), plane.radius * angle)
    across = away[:, :2] * [1, -1]
    assert np.allclose(flat / np.linalg.norm(flat, axis=1)[:, None],
                       across / np.linalg.norm(across, axis=1)[:, None])


@pytest.mark.parametrize("squeezed", [False, True])
def test_both_agree_at_the_brows(plane, squeezed):
    angle = np.linspace(-3.1, 3.1, 41)
    over, under = (plane.unwrap(around(plane, angle, height), squeezed) for height in (1e-9, -1e-9))
    assert np.allclose(over, under, atol=1e-6)


def test_below_the_chin_the_axis_leans_back(plane):
    chest = plane.origin + np.array([0.0, -2 * plane.height, -0.1])
    assert plane.unwrap(chest)[0] == pytest.approx(0)
    behind = plane.origin + np.array([1e-6, -0.5 * plane.height, -0.1])
    assert plane.unwrap(behind)[0] == pytest.approx(plane.radius * np.pi, abs=1e-4)


def test_angles_beyond_the_cheeks_are_squeezed(plane):
    points = around(plane, np.linspace(-3.1, 3.1, 201), -0.1)
    flat, squeezed = plane.unwrap(points), plane.unwrap(points, squeezed=True)
    front = np.abs(flat[:, 0]) < plane.radius * np.radians(60)
    assert np.allclose(flat[front], squeezed[front])
    assert np.abs(squeezed[:, 0]).max() < plane.radius * np.radians(92)
    assert (np.diff(squeezed[:, 0]) > 0).all() and np.array_equal(flat[:, 1], squeezed[:, 1])


def test_landmarks_that_are_not_known_do_not_count():
    landmarks = HEAD_LANDMARKS.copy()
    landmarks[[0, 1, 2, 36, 48]] = np.nan
    plane = HeadPlane(landmarks)
    assert plane.known.sum() == 63 and np.isfinite(plane.origin).all()
    assert np.allclose(plane.origin, HeadPlane(HEAD_LANDMARKS).origin, atol=0.02)
    landmarks[:49] = np.nan
    with pytest.raises(UserError, match="only 19 of 68"):
        HeadPlane(landmarks)


def test_nodes_hold_the_guide_at_their_places(guide):
    low, high, spacing = np.array([-1.2, -0.7]), np.array([1.1, 0.9]), 0.06
    nodes = guide.nodes(low, high, spacing)
    assert nodes.dtype == np.float32 and nodes.shape[2] == 3
    rows, columns = nodes.shape[:2]
    assert low[0] + spacing * (columns - 1) >= high[0] and low[1] + spacing * (rows - 1) >= high[1]
    x, y = np.meshgrid(low[0] + spacing * np.arange(columns), low[1] + spacing * np.arange(rows))
    guided = guide._guided(np.stack([x.ravel(), y.ravel()], axis=1)).reshape(rows, columns, 2)
    same = np.abs(nodes[..., :2] - guided).max(axis=2) < 1e-4
    assert same.mean() > 0.5
    # What differs was led to the background, and is moved onto the person.
    person = guide.regions.person
    nearest = guide.regions.nearest[guided[..., 1].astype(int), guided[..., 0].astype(int)]
    assert np.allclose(nodes[~same][:, :2], nearest[~same])
    x, y = nodes[..., 0].astype(int), nodes[..., 1].astype(int)
    assert (person[y, x] > 0.5).mean() > 0.99


def test_nodes_tell_where_the_exemplar_is_stretched(guide):
    nodes = guide.nodes(np.array([-1.7, -0.5]), np.array([1.7, 0.4]), 0.02)
    ratio = nodes[..., 2]
    assert ratio.min() >= np.float32(0.1) and ratio.max() <= 1
    middle = nodes.shape[1] // 2
    assert np.median(ratio[20:, middle - 10:middle + 10]) > 0.8
    assert np.median(ratio[:, :5]) < 0.2 and np.median(ratio[:, -5:]) < 0.2


def test_between_nodes_the_face_gets_what_the_guide_gives_it(guide):
    points = ball_head(np.radians(np.linspace(-50, 50, 61)), np.linspace(-0.7, 0.4, 50))
    position, anchor = guide(points)
    flat = guide.unwrap(points).reshape(-1, 2).astype(np.float32)
    low = flat.min(axis=0).astype(np.float64)
    spacing = 2 / guide.scale
    found = np.empty((len(flat), 3), np.float32)
    sample_nodes(guide.nodes(low, flat.max(axis=0), spacing), low, spacing, flat, found)
    away = np.linalg.norm(found[:, :2] - position.reshape(-1, 2), axis=1)
    # Between landmarks that lie close together the map has kinks.
    assert np.median(away) < 0.1 and away.max() < 3
    assert np.allclose(guide.scale * flat + guide.shift, anchor.reshape(-1, 2), atol=1e-3)
