"""Cameras of photos that share nothing but a face."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from PIL import Image

from lfportrait.capture import CalibrateConfig, Camera
from lfportrait.face import capture_from_faces
from lfportrait.face.face_cameras import cameras_from_faces
from lfportrait.face.landmarks import GENERIC_LANDMARKS
from tests.capture.test_calibrate import pose_errors

SIDE = 600
YAWS = np.array([-40.0, -25, -10, 0, 12, 28, 42, 0, 3, 20])
PITCHES = np.array([0.0, 5, -8, 2, 0, 10, -4, 25, -18, 15])


def person(seed):
    """Landmarks of somebody, not of the generic head."""
    random = np.random.default_rng(seed)
    stretched = GENERIC_LANDMARKS * random.uniform(0.9, 1.1, 3)
    return stretched + random.normal(0, 0.01, (68, 3))


def photographed(head, focal, noise=0.0, seed=0):
    """Cameras around a head, and its landmarks in their photos."""
    poses = np.concatenate([
        Camera.arc(np.array([yaw]), distance=3.5, width=SIDE, height=SIDE, focal=focal,
                   pitch=float(pitch)).pose for yaw, pitch in zip(YAWS, PITCHES)])
    count = len(poses)
    cameras = Camera(poses, np.full((count, 2), float(focal)), np.full((count, 2), SIDE / 2.0),
                     np.full(count, SIDE), np.full(count, SIDE))
    pixels, _ = cameras.project(head)
    return cameras, pixels + np.random.default_rng(seed).normal(0, noise, pixels.shape)


def found_from(pixels, focal=None):
    count = len(pixels)
    return cameras_from_faces(list(pixels), [(SIDE, SIDE)] * count, [focal] * count, [0] * count)


@settings(max_examples=5, deadline=None)
@given(some.integers(0, 10 ** 6), some.floats(700.0, 1100.0), some.booleans())
def test_cameras_are_found_by_the_face(seed, focal, noted):
    cameras, pixels = photographed(person(seed), focal, 1.0, seed)
    found = found_from(pixels, focal if noted else None)
    assert found.photos == list(range(len(pixels)))
    angle, _ = pose_errors(found.cameras.pose, cameras.pose)
    assert np.median(angle) < (1.2 if noted else 2.0) and angle.max() < 4
    assert len(np.unique(found.cameras.focal)) == 1
    assert abs(np.log(found.cameras.focal[0, 0] / focal)) < (0.05 if noted else 0.35)


def test_photos_of_somebody_else_and_without_a_face_are_left_out():
    pixels = photographed(person(1), 900.0, 0.5)[1][:6]
    random = np.random.default_rng(2)
    faces = [*pixels, None, random.uniform(200, 400, (68, 2))]
    count = len(faces)
    found = cameras_from_faces(faces, [(SIDE, SIDE)] * count, [None] * count, [0] * count)
    assert found.photos == list(range(len(pixels)))


def test_fewer_than_three_faces_tell_nothing():
    _, pixels = photographed(person(1), 900.0)
    assert found_from(pixels[:2]) is None
    assert cameras_from_faces([None] * 5, [(SIDE, SIDE)] * 5, [None] * 5, [0] * 5) is None
    assert found_from(pixels[:3]).photos == [0, 1, 2]


def test_each_lens_has_its_focal_length():
    head = person(3)
    _, seen = photographed(head, 800.0, 0.5)
    _, others = photographed(head, 1000.0, 0.5)
    count = len(seen)
    found = cameras_from_faces([*seen, *others], [(SIDE, SIDE)] * 2 * count,
                               [800.0] * count + [1000.0] * count, [0] * count + [7] * count)
    focal = found.cameras.focal[:, 0]
    assert np.ptp(focal[:count]) == np.ptp(focal[count:]) == 0
    assert focal[count] / focal[0] == pytest.approx(1.25, abs=0.08)


@pytest.mark.data
def test_a_real_head_before_ten_backgrounds(shared_data, shared_weights, monkeypatch, tmp_path):
    """Ten views of the scan, each before a part of another painting."""
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    from lfportrait.capture import Capture

    capture = Capture.load(shared_data / "lee")
    x, y, z = capture.cameras.position.T
    angles = np.degrees(np.stack([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))], axis=1))
    wanted = [(0, 0), (-20, 5), (22, 5), (-42, 0), (44, 0), (-60, 0), (58, 0), (0, 25), (0, -14),
              (30, 20)]
    views = [int(np.hypot(*(angles - place).T).argmin()) for place in wanted]
    paintings = sorted(Path(shared_data / "paintings").glob("*.jpg"))
    for number, view in enumerate(views):
        picture = Image.open(paintings[number % len(paintings)]).convert("RGB")
        part = min(picture.size) // 3
        left = (number // len(paintings)) * part
        behind = np.asarray(picture.crop((left, 0, left + part, part)).resize((512, 512)))
        alpha = capture.alphas[view][..., None] / 255.0
        image = alpha * capture.images[view] + (1 - alpha) * behind
        Image.fromarray(image.astype(np.uint8)).save(tmp_path / f"{number:02d}.png")
    found = capture_from_faces(tmp_path, CalibrateConfig())
    assert "features of the head" in found.figures["placed"]
    assert len(found) >= 9 and found.figures["photos"] == 10
    true = capture.cameras.pose[[views[int(name[:2])] for name in found.names]]
    angle, _ = pose_errors(found.cameras.pose, true)
    assert np.median(angle) < 1.0 and angle.max() < 4


@pytest.mark.data
def test_different_people_are_not_one(shared_data, shared_weights, monkeypatch, tmp_path):
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    for name in ("mona_lisa", "michelangelo_by_volterra", "vangogh_self_1887",
                 "jeanne_samary_by_renoir"):
        shutil.copy(shared_data / "paintings" / f"{name}.jpg", tmp_path)
    assert capture_from_faces(tmp_path, CalibrateConfig(max_side=700)) is None
