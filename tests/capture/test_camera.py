"""Cameras: projection, rays, similarity transforms and resizing agree with each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lfportrait.capture import Camera


def random_similarity(seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    similarity = np.eye(4)
    scale = np.exp(random.uniform(-2, 2))
    similarity[:3, :3] = scale * Rotation.random(rng=random).as_matrix()
    similarity[:3, 3] = random.normal(size=3) * 5
    return similarity


def rig(seed: int, count: int = 12) -> Camera:
    """Cameras in front of a head, upright, about 4 away, with some scatter in all of that."""
    random = np.random.default_rng(seed)
    yaw, pitch = random.uniform(-1.2, 1.2, count), random.uniform(-0.3, 0.4, count)
    away = np.stack([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)], 1)
    return Camera.look_at(away * random.uniform(3.5, 4.5, (count, 1)), np.zeros(3), width=80,
                          height=60, focal=110)


def test_a_known_point_lands_where_it_must() -> None:
    camera = Camera.look_at(np.array([[0.0, 0.0, 4.0]]), np.zeros(3), width=100, height=80,
                            focal=200.0)
    pixels, depth = camera.project(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    # World x is right and y is up in a frontal picture, whose rows run down.
    assert np.allclose(pixels[0], [[50, 40], [100, 40], [50, -10], [50, 40]])
    assert np.allclose(depth[0], [4, 4, 4, 3])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_rays_go_through_the_points_that_project_to_their_pixels(seed: int) -> None:
    random = np.random.default_rng(seed)
    cameras = rig(seed)
    points = random.uniform(-1, 1, (7, 3))
    pixels, depth = cameras.project(points)
    for view in range(len(cameras)):
        origins, directions = cameras.rays(view, pixels[view])
        along = np.einsum("ni,ni->n", points - origins, directions)
        assert (depth[view] > 0).all()
        assert np.allclose(origins + along[:, None] * directions, points, atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_a_change_of_world_changes_no_picture(seed: int) -> None:
    cameras, similarity = rig(seed), random_similarity(seed)
    points = np.random.default_rng(seed).uniform(-1, 1, (7, 3))
    moved = points @ similarity[:3, :3].T + similarity[:3, 3]
    before, depth = cameras.project(points)
    after, far = cameras.transformed(similarity).project(moved)
    assert np.allclose(before, after, atol=1e-6)
    assert np.allclose(far / depth, np.cbrt(np.linalg.det(similarity[:3, :3])))
    turn = cameras.transformed(similarity).pose[:, :3, :3]
    assert np.allclose(turn @ turn.transpose(0, 2, 1), np.eye(3), atol=1e-9)


@pytest.mark.parametrize("factor", [0.25, 0.333, 1.7])
def test_resized_cameras_keep_relative_image_positions(factor: float) -> None:
    cameras = rig(3)
    small = cameras.scaled(factor)
    points = np.random.default_rng(0).uniform(-1, 1, (9, 3))
    size = np.stack([cameras.width, cameras.height], 1)[:, None]
    reduced = np.stack([small.width, small.height], 1)[:, None]
    assert np.allclose(cameras.project(points)[0] / size, small.project(points)[0] / reduced)


def test_arc_turns_towards_positive_x() -> None:
    cameras = Camera.arc(np.array([0.0, 90.0, -90.0]), distance=3, width=10, height=10, focal=9)
    assert np.allclose(cameras.position, [[0, 0, 3], [3, 0, 0], [-3, 0, 0]], atol=1e-12)
    assert np.allclose(cameras.project(np.zeros((1, 3)))[0], 5.0)


def test_views_show_what_is_before_them_and_in_their_picture() -> None:
    # At (0, 0, 4), looking at the origin; the picture is 2 wide and 1 high there.
    camera = Camera.arc([0.0, 90.0], distance=4.0, width=80, height=40, focal=160.0)
    points = np.array([[0, 0, 0], [0.99, 0, 0], [1.01, 0, 0], [0, -0.49, 0], [0, 0.51, 0],
                       [0, 0, 5]])
    assert camera.shows(points)[0].tolist() == [True, True, False, True, False, False]
    assert camera.shows(points)[1].tolist() == [True, True, True, True, False, False]


def test_selection_and_concatenation() -> None:
    cameras = rig(1)
    joined = Camera.concatenate([cameras[:5], cameras[5], cameras[np.arange(6, len(cameras))]])
    assert np.array_equal(joined.pose, cameras.pose)
    with pytest.raises(ValueError, match="pose"):
        Camera(np.eye(4), np.ones(2), np.ones(2), np.array(4), np.array(4))
