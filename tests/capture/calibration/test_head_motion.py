"""Cameras follow what moved against the room, and leave the others alone."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lfportrait.capture import Camera, Capture, follow_head, place_by_head
from lfportrait.capture.calibration import head_motion
from lfportrait.capture.calibration.head_motion import epipolar_distance
from tests.capture.test_calibrate import pose_errors, room_cameras, room_picture

COUNT = 8


def photos(degrees: float, side: int = 360) -> tuple[Capture, list[np.ndarray], Camera]:
    """Photos of a box that turns by some degrees between them; its mattes and true cameras."""
    capture, mattes, boxes = _photographed(degrees, side)
    return replace(capture), [*mattes], boxes


@functools.cache  # seconds, and tests of whatever takes photos ask for them
def _photographed(degrees: float, side: int) -> tuple[Capture, list[np.ndarray], Camera]:
    cameras = room_cameras(COUNT, side, side)
    cameras = replace(cameras, focal=1.8 * cameras.focal)
    random = np.random.default_rng(0)
    motion = np.tile(np.eye(4), (COUNT, 1, 1))
    away = random.standard_normal((COUNT, 3))
    motion[:, :3, :3] = Rotation.from_rotvec(
        np.radians(degrees) * away / np.linalg.norm(away, axis=1, keepdims=True)).as_matrix()
    motion[:, :3, 3] = 0.003 * degrees * random.standard_normal((COUNT, 3))
    boxes = replace(cameras, pose=np.linalg.inv(motion) @ cameras.pose)
    images, mattes = [], []
    for view in range(COUNT):
        box = room_picture(boxes, view, walls=False)
        inside = box.any(-1)
        images.append(np.where(inside[..., None], box, room_picture(cameras, view)))
        mattes.append(inside.astype(np.float32))
    capture = Capture(cameras, images, None, [f"{view}.png" for view in range(COUNT)],
                      np.arange(COUNT) == 3)
    return capture, mattes, boxes


@pytest.fixture(scope="module")
def moved():
    return photos(3.0)


@pytest.fixture(scope="module")
def followed(moved):
    """Its cameras that follow, how it moved, and what was said of it."""
    said = []
    return *follow_head(*moved[:2], tell=said.append), said


def test_cameras_follow_what_moved(moved, followed):
    capture, _, boxes = moved
    result, motion, said = followed
    assert motion.moved and motion.followed == list(range(COUNT))
    assert "the head moved against the room" in said[0] and len(said) == 1
    assert motion.pixels > 3 * motion.own
    assert motion.after < 3 * motion.own
    assert 1.5 < motion.degrees < 4
    before, _ = pose_errors(capture.cameras.pose, boxes.pose)
    angle, position = pose_errors(result.cameras.pose, boxes.pose)
    assert np.median(before) > 2
    assert np.median(angle) < 0.3 and angle.max() < 1
    assert np.median(position) < 0.01
    assert result.names == capture.names and (result.held_out == capture.held_out).all()
    # As near to the given ones as can be: the portrait frame holds.
    assert np.abs(result.cameras.position.mean(0) - capture.cameras.position.mean(0)).max() < 0.15


@pytest.mark.slow  # followed once more
def test_a_lens_that_is_not_in_the_middle(moved):
    capture, mattes, boxes = moved
    cut = replace(capture, images=[image[20:, 30:] for image in capture.images],
                  cameras=replace(capture.cameras, center=capture.cameras.center - (30, 20),
                                  width=capture.cameras.width - 30,
                                  height=capture.cameras.height - 20))
    result, motion = follow_head(cut, [matte[20:, 30:] for matte in mattes])
    assert motion.moved and len(motion.followed) == COUNT
    assert np.median(pose_errors(result.cameras.pose, boxes.pose)[0]) < 0.3


@pytest.mark.slow  # what moved is followed above
def test_some_photos_are_enough_to_say_that_it_held_still(moved, followed, monkeypatch):
    looked_at = []
    seen = head_motion._seen
    monkeypatch.setattr(head_motion, "_SAMPLE", 4)
    monkeypatch.setattr(head_motion, "_seen",
                        lambda *given: looked_at.append(given[1]) or seen(*given))
    capture, mattes, _ = photos(0.0)
    result, motion = follow_head(capture, mattes, tell=lambda line: pytest.fail(line))
    assert result is capture and not motion.followed
    assert not motion.moved and motion.pixels < 0.5 and len(looked_at) == 4
    looked_at.clear()
    result, motion = follow_head(*moved[:2])
    assert motion.moved and motion.followed and len(looked_at) == 4 + COUNT
    assert np.array_equal(result.cameras.pose, followed[0].cameras.pose), "the same once more"


@pytest.mark.slow  # follows once more
def test_photos_that_hardly_show_it_are_left_out_or_nothing_is_followed(moved):
    capture, mattes, _ = moved
    blind = [matte if view else np.zeros_like(matte) for view, matte in enumerate(mattes)]
    result, motion = follow_head(capture, blind)
    assert motion.followed == list(range(1, COUNT))
    assert result.names == capture.names[1:] and len(result.images) == COUNT - 1
    assert (result.held_out == capture.held_out[1:]).all()
    said = []
    blind = [matte if view % 3 else np.zeros_like(matte) for view, matte in enumerate(mattes)]
    result, motion = follow_head(capture, blind, tell=said.append)
    assert result is capture and motion.moved and not motion.followed
    assert "too few of its features" in said[0]
    result, motion = follow_head(capture, [np.zeros_like(matte) for matte in mattes])
    assert result is capture and not motion.moved and np.isnan(motion.pixels)


@pytest.mark.slow  # followed once more
def test_what_is_not_rigid_is_not_followed(moved, monkeypatch):
    capture, mattes, _ = moved
    # Cameras that explain the person no better than the room's.
    monkeypatch.setattr(head_motion, "_placed_by_head", lambda *_: (
        list(range(COUNT)), capture.cameras))
    result, motion = follow_head(capture, mattes)
    assert result is capture and motion.moved and not motion.followed


def test_distances_from_an_epipolar_geometry():
    random = np.random.default_rng(2)
    points = random.uniform(-1, 1, (50, 3)) + np.array([0, 0, 5])
    turn = Rotation.from_rotvec([0.1, -0.3, 0.05]).as_matrix()
    move = np.array([1.0, 0.2, -0.1])
    seen = points @ turn.T + move
    one, other = points[:, :2] / points[:, 2:], seen[:, :2] / seen[:, 2:]
    x, y, z = move
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn
    assert epipolar_distance(essential, one, other).max() < 1e-12
    # To first order, the smallest change of both places that fulfils the geometry.
    off = other + 1e-3 * random.standard_normal(other.shape)
    distance = epipolar_distance(essential, one, off)
    for k in range(5):
        def left(change, k=k):
            a, b = np.append(one[k] + change[:2], 1), np.append(off[k] + change[2:], 1)
            return b @ essential @ a
        slope = np.array([(left(step) - left(-step)) / 2e-6 for step in 1e-6 * np.eye(4)])
        assert distance[k] == pytest.approx(abs(left(np.zeros(4))) / np.linalg.norm(slope),
                                            rel=1e-6)


def test_only_the_head_counts_where_the_face_is_known():
    cameras = Camera.arc([-40.0, 30.0], distance=4.0, width=200, height=240, focal=300.0)
    capture = Capture(cameras, [np.zeros((240, 200, 3), np.uint8)] * 2, None, ["a", "b"],
                      np.zeros(2, bool))
    matte = np.ones((240, 200), np.float32)
    matte[:, :20] = 0.3
    whole = head_motion._head(capture, 0, matte)
    assert whole[5:-5, 30:-5].all() and not whole[:, :20].any()
    known = replace(capture, landmarks=np.zeros((68, 3)))
    crown_chin_ears = np.array([[0, 0.7, 0], [0, -0.55, 0.45], [0.5, 0, 0], [-0.5, 0, 0]])
    shoulders = np.array([[0.7, -1.0, 0], [-0.7, -1.0, 0]])
    for view in range(2):
        head = head_motion._head(known, view, matte)
        for points, inside in ((crown_chin_ears, 1), (shoulders, 0)):
            pixels = cameras.project(points)[0][view].astype(int)
            assert (head[pixels[:, 1], pixels[:, 0]] == inside).all()


@pytest.mark.slow  # followed once more
def test_what_moved_places_the_photos_from_rough_cameras(moved):
    capture, mattes, boxes = moved
    random = np.random.default_rng(5)
    rough = capture.cameras.pose.copy()
    rough[:, :3, :3] = Rotation.from_rotvec(random.normal(0, np.radians(3), (COUNT, 3))
                                            ).as_matrix() @ rough[:, :3, :3]
    cameras = replace(capture.cameras, pose=rough, focal=0.9 * capture.cameras.focal)
    found = place_by_head(replace(capture, cameras=cameras), mattes)
    assert found.names == capture.names
    assert np.median(pose_errors(found.cameras.pose, boxes.pose)[0]) < 0.5
    assert abs(found.cameras.focal[0, 0] / capture.cameras.focal[0, 0] - 1) < 0.05
