"""The portrait frame from cameras and from landmarks."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.capture import (
    Camera,
    Capture,
    looks_normalised,
    portrait_frame_from_cameras,
    portrait_frame_from_landmarks,
)
from lfportrait.demo import demo_capture

from .test_camera import random_similarity, rig


def rotation_angle(similarity: np.ndarray) -> float:
    turn = similarity[:3, :3] / np.cbrt(np.linalg.det(similarity[:3, :3]))
    return float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))))


def rolled(cameras: Camera, turns: np.ndarray) -> Camera:
    """The cameras turned about their optical axes by quarters."""
    pose = cameras.pose.copy()
    for view, turn in enumerate(turns):
        c, s = [(1, 0), (0, 1), (-1, 0), (0, -1)][turn]
        pose[view, :3, :3] = pose[view, :3, :3] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return Camera(pose, cameras.focal, cameras.center, cameras.width, cameras.height)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_a_rig_in_any_world_comes_to_the_same_frame(seed: int) -> None:
    cameras = rig(seed)
    normal = cameras.transformed(portrait_frame_from_cameras(cameras))
    other = cameras.transformed(random_similarity(seed + 1))
    again = other.transformed(portrait_frame_from_cameras(other))
    assert np.allclose(normal.pose, again.pose, atol=1e-7)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_cameras_frame_has_the_head_in_the_middle_upright_and_facing(seed: int) -> None:
    cameras = rig(seed, 24).transformed(random_similarity(seed))
    normal = cameras.transformed(portrait_frame_from_cameras(cameras))
    assert np.allclose(normal.project(np.zeros((1, 3)))[0][:, 0], [40, 30], atol=1e-6)
    up = -normal.pose[:, :3, 1].mean(0)
    assert up[1] > 0.9
    assert np.allclose(up[[0, 2]], 0, atol=1e-9)
    mean = normal.position.mean(0)
    assert mean[2] > 1
    assert abs(mean[0]) < 1e-9
    # The nearest cameras have about the cube's front in their pictures.
    distance = np.linalg.norm(normal.position, axis=1)
    assert np.quantile(distance, 0.25) * 30 / 110 == pytest.approx(1.0, abs=1e-9)


def test_photos_rolled_by_quarters_do_not_mislead_the_up_direction() -> None:
    cameras = rig(5, 24)
    turned = rolled(cameras, np.arange(24) % 4)
    plain, mixed = (portrait_frame_from_cameras(c) for c in (cameras, turned))
    relative = mixed @ np.linalg.inv(plain)
    # Up is then known up to quarters only; the frame must agree with one of them.
    angle = rotation_angle(relative) % 90
    assert min(angle, 90 - angle) < 12


def test_what_counts_as_normalised() -> None:
    cameras = rig(2, 24)
    assert looks_normalised(cameras)
    turned = np.eye(4)
    turned[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # z up, as Blender has it
    assert not looks_normalised(cameras.transformed(turned))
    moved = np.eye(4)
    moved[:3, 3] = [0, 1, 0]
    assert not looks_normalised(cameras.transformed(moved))
    assert not looks_normalised(cameras.transformed(np.diag([9.0, 9, 9, 1])))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_frame_from_landmarks_ignores_the_world_they_come_in(seed: int) -> None:
    landmarks = _demo_landmarks()
    expected = portrait_frame_from_landmarks(landmarks, rig(1))
    similarity = random_similarity(seed)
    moved = landmarks @ similarity[:3, :3].T + similarity[:3, 3]
    frame = portrait_frame_from_landmarks(moved, rig(1))
    assert np.allclose(frame @ similarity, expected, atol=1e-7)


_cache: list[np.ndarray] = []


def _demo_landmarks() -> np.ndarray:
    if not _cache:
        landmarks = demo_capture(size=32, views=8).landmarks
        assert landmarks is not None
        _cache.append(landmarks)
    return _cache[0]


def test_frame_from_landmarks_of_a_head_that_is_in_its_frame_changes_little() -> None:
    landmarks = _demo_landmarks()
    frame = portrait_frame_from_landmarks(landmarks, rig(1))
    assert rotation_angle(frame) < 12
    assert np.linalg.norm(frame[:3, 3]) < 0.15
    assert 0.75 < np.cbrt(np.linalg.det(frame[:3, :3])) < 1.2


def test_frame_from_half_the_landmarks() -> None:
    landmarks = _demo_landmarks().copy()
    whole = portrait_frame_from_landmarks(landmarks, rig(1))
    landmarks[::3] = np.nan
    assert np.allclose(portrait_frame_from_landmarks(landmarks, rig(1)), whole, atol=0.08)
    landmarks[:] = np.nan
    assert np.allclose(portrait_frame_from_landmarks(landmarks, rig(1)),
                       portrait_frame_from_cameras(rig(1)))


# One is enough: to read a capture's photos takes seconds.
@pytest.mark.data
@pytest.mark.parametrize(("name", "near", "far"), [
    pytest.param("lee", 3.4, 4.2, marks=pytest.mark.slow), ("buddha_head", 1.4, 4.3),
    pytest.param("lee_photos", 3.2, 4.0, marks=pytest.mark.slow)])
def test_normalised_captures_keep_their_frame(shared_data: Path, name: str, near: float,
                                              far: float) -> None:
    capture = Capture.load(shared_data / name)
    assert np.array_equal(capture.frame, np.eye(4))
    distance = np.linalg.norm(capture.cameras.position, axis=1)
    assert near < distance.min() < distance.max() < far


@pytest.mark.data
def test_the_fox_comes_into_the_portrait_frame(shared_data: Path) -> None:
    capture = Capture.load(shared_data / "fox")
    assert len(capture) == 50
    assert capture.held_out.sum() == 6
    up = -capture.cameras.pose[:, :3, 1].mean(0)
    assert up[1] > 0.9
    assert capture.cameras.position.mean(0)[2] > 2
    # Its snout (just in front of the origin) is in every picture.
    pixels, depth = capture.cameras.project(np.array([[0.0, 0.2, 0.3]]))
    size = np.stack([capture.cameras.width, capture.cameras.height], 1)
    assert (depth > 0).all()
    assert ((pixels[:, 0] > 0) & (pixels[:, 0] < size)).all()
