"""Heads from one photo are compared with the truth in whatever way its cameras are held."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lfportrait.capture import Camera, Capture
from measure_one_photo import aligned, aligned_by_camera, compared

WIDTH, HEIGHT = 60, 40


def face(random):
    """Landmarks of a face whose chin lies below its eyes."""
    points = random.uniform(-0.3, 0.3, (68, 3))
    points[27], points[8] = (0.02, 0.25, 0.3), (0.0, -0.2, 0.25)
    return points


def capture(camera, image, alpha, points):
    return Capture(camera, [image], [alpha], ["0.png"], np.zeros(1, bool), np.eye(4), points)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_rolled_photo_is_compared_down_to_the_chin_as_an_upright_one(turns):
    """By its rows, a chin at the side of a picture cut a face in two."""
    random = np.random.default_rng(3)
    camera = Camera.arc(np.zeros(1), distance=3.0, width=WIDTH, height=HEIGHT, focal=90.0)
    points = face(random)
    image = random.integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    alpha = np.uint8(255 * (random.random((HEIGHT, WIDTH)) < 0.8))
    color = random.random((HEIGHT, WIDTH, 3)).astype(np.float32)
    cover = (random.random((HEIGHT, WIDTH)) < 0.8).astype(np.float32)
    expected = compared(capture(camera, image, alpha, points), 0, (color, cover))

    roll = np.eye(4)
    roll[:3, :3] = Rotation.from_euler("z", 90 * turns, degrees=True).as_matrix()
    size = (WIDTH, HEIGHT) if turns == 2 else (HEIGHT, WIDTH)
    center = camera.center if turns == 2 else camera.center[:, ::-1]
    rolled = Camera(camera.pose @ roll, camera.focal, center, *(np.array([n]) for n in size))
    image, alpha, color, cover = (np.ascontiguousarray(np.rot90(one, turns))
                                  for one in (image, alpha, color, cover))
    found = compared(capture(rolled, image, alpha, points), 0, (color, cover))

    assert found == pytest.approx(expected, abs=1e-3)


def test_a_photos_own_camera_says_how_it_was_held_whatever_the_fitted_depth():
    random = np.random.default_rng(4)
    one = Camera.arc(np.zeros(1), distance=3.0, width=WIDTH, height=HEIGHT, focal=90.0)
    points = face(random)
    blank, solid = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.full((HEIGHT, WIDTH), 255, np.uint8)
    truth = capture(one, blank, solid, points)
    # The same in another frame, twice as large, its depth tilted along the rays.
    turn, scale, shift = Rotation.from_rotvec([0.2, -0.4, 0.1]).as_matrix(), 2.0, [1.0, 2.0, 3.0]
    pose = one.pose.copy()
    pose[0, :3, :3] = turn @ pose[0, :3, :3]
    pose[0, :3, 3] = scale * turn @ pose[0, :3, 3] + shift
    ray = points - one.position[0]
    tilted = one.position[0] + ray * (1 + 0.1 * (points[:, 1:2] - points[17:, 1].mean()))
    mine = capture(Camera(pose, one.focal, one.center, one.width, one.height), blank, solid,
                   scale * tilted @ turn.T + shift)

    rotation, moved, size = aligned_by_camera(truth, mine, 0)

    assert np.allclose(rotation, turn)
    assert size == pytest.approx(scale, rel=0.02)
    place = scale * turn @ points[17:].mean(axis=0) + shift
    assert np.allclose(size * rotation @ points[17:].mean(axis=0) + moved, place, atol=0.05)
    by_landmarks = aligned(truth, mine)[0] @ turn.T
    assert np.degrees(Rotation.from_matrix(by_landmarks).magnitude()) > 2
