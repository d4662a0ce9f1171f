"""Triangulation under noise, and the face found in captures wherever it looks."""

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.capture import Camera, Capture
from lfportrait.face import face_yaw, frontal_order, landmarks_of_capture, triangulate
from tests.portraits import HEAD_LANDMARKS

SEEDS = st.integers(0, 2**32 - 1)


def _rig(views, seed, spread=45.0):
    """Cameras on an arc about the head, and a generator for whatever else is random."""
    rng = np.random.default_rng(seed)
    angles = np.linspace(-spread, spread, views) + rng.uniform(-3, 3, views)
    cameras = Camera.arc(angles, distance=rng.uniform(3, 6), width=640, height=480,
                         focal=rng.uniform(500, 1500), pitch=rng.uniform(-15, 15))
    return cameras, rng


def _points(rng, count=12):
    return rng.uniform(-0.5, 0.5, (count, 3))


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, noise=st.floats(0.1, 1.0))
def test_noise_is_averaged(seed, noise):
    cameras, rng = _rig(12, seed)
    points = _points(rng)
    observed, depth = cameras.project(points)
    observed += rng.normal(0, noise, observed.shape)
    found, errors, _ = triangulate(cameras, observed, tolerance=6.0)
    pixel = float(depth.mean() / cameras.focal.mean())
    # Twelve views over 90 degrees: across the views the mean error is a third of one
    # observation's, and along them less than as large again. Of 300 seeds the mean is 0.45, one in
    # a hundred has 0.62 and the largest 0.70: there are only 12 points.
    assert np.sqrt(np.mean((found - points) ** 2)) < 0.8 * noise * pixel
    assert 0.6 * noise < np.median(errors) / np.sqrt(2) < 1.3 * noise


def test_contradicting_views_give_no_point():
    cameras, _ = _rig(2, 3)
    observed, _ = cameras.project(np.zeros((1, 3)))
    observed[1, 0, 1] += 200.0  # off the epipolar line: the two rays pass each other
    found, _, inliers = triangulate(cameras, observed)
    assert np.isnan(found).all() and not inliers.any()


@pytest.mark.parametrize("degrees", [-40, -15, 15, 40])
def test_face_yaw_has_the_sign_and_order_of_the_turn(degrees):
    cameras = Camera.arc(np.array([0.0, degrees / 2, degrees]), distance=4.0, width=400,
                         height=400, focal=400.0)
    seen, _ = cameras.project(HEAD_LANDMARKS)
    front, half, full = (face_yaw(points) for points in seen)
    assert abs(front) < 0.02
    assert 0.04 < -half * np.sign(degrees) < -full * np.sign(degrees)


def _capture(cameras):
    images = [np.full((int(h), int(w), 3), 128, np.uint8)
              for w, h in zip(cameras.width, cameras.height)]
    return Capture(cameras, images, None, [f"{v}.png" for v in range(len(cameras))],
                   np.zeros(len(cameras), bool), np.eye(4))


class _Detector:
    """Answers with projected landmarks where the face is turned by less than 50 degrees."""

    def __init__(self, capture, landmarks, front, seed=0, noise=0.5, wrong=()):
        self.capture, self.wrong, self.overlooked = capture, wrong, ()
        rng = np.random.default_rng(seed)
        self.points, _ = capture.cameras.project(landmarks)
        self.points += rng.normal(0, noise, self.points.shape)
        away = capture.cameras.position / np.linalg.norm(capture.cameras.position, axis=1)[:, None]
        self.visible = away @ front > np.cos(np.radians(50))
        self.rng, self.calls = rng, []

    def __call__(self, capture, view, thorough):
        self.calls.append((view, thorough))
        if view in self.overlooked and not thorough:
            return None
        if view in self.wrong:
            return self.rng.uniform(0, 100, (68, 2))
        return self.points[view] if self.visible[view] else None


def _turned(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


# Ahead, and over the shoulder.
@pytest.mark.parametrize("degrees", [
    0, pytest.param(70, marks=pytest.mark.slow), 135, pytest.param(180, marks=pytest.mark.slow)])
def test_the_face_is_found_wherever_it_looks(monkeypatch, degrees):
    """The cameras go all around; the face need not look to +z."""
    cameras = Camera.arc(np.arange(0.0, 360.0, 2.0), distance=4.0, width=600, height=600,
                         focal=900.0)
    capture = _capture(cameras)
    turn = _turned(degrees)
    truth = HEAD_LANDMARKS @ turn.T
    detector = _Detector(capture, truth, turn @ [0.0, 0.0, 1.0], wrong=(90, 91))
    monkeypatch.setattr(sys.modules["lfportrait.face.detect"], "_detect", detector)
    found, figures = landmarks_of_capture(capture)
    assert found is not None
    assert np.linalg.norm(found - truth, axis=1).max() < 0.02
    assert figures["views"] >= 5 and figures["error_px"] < 1.5
    assert len(detector.calls) == len(set(detector.calls))


def test_too_few_faces_are_no_face(monkeypatch):
    cameras = Camera.arc(np.linspace(-30, 30, 7), distance=4.0, width=600, height=600, focal=900.0)
    capture = _capture(cameras)
    detector = _Detector(capture, HEAD_LANDMARKS, np.array([0.0, 0.0, 1.0]))
    detector.visible[2:] = False
    monkeypatch.setattr(sys.modules["lfportrait.face.detect"], "_detect", detector)
    found, figures = landmarks_of_capture(capture)
    assert found is None and figures["views"] == 2


def test_faces_that_a_first_look_misses_are_looked_for_again(monkeypatch):
    cameras = Camera.arc(np.linspace(-30, 30, 7), distance=4.0, width=600, height=600, focal=900.0)
    capture = _capture(cameras)
    detector = _Detector(capture, HEAD_LANDMARKS, np.array([0.0, 0.0, 1.0]))
    detector.overlooked = range(5)
    monkeypatch.setattr(sys.modules["lfportrait.face.detect"], "_detect", detector)
    found, figures = landmarks_of_capture(capture)
    assert figures["views"] == 7
    assert np.linalg.norm(found - HEAD_LANDMARKS, axis=1).max() < 0.02


@pytest.mark.data
def test_landmarks_of_a_real_head(shared_data, shared_weights, monkeypatch):
    """Found in every third view of the scan; they must meet the detections of the other views."""
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    from lfportrait.face import detect_landmarks

    capture = Capture.load(shared_data / "lee")
    order = frontal_order(capture.cameras)
    capture_part = Capture(capture.cameras[order[:36:3]],
                           [capture.images[v] for v in order[:36:3]],
                           [capture.alphas[v] for v in order[:36:3]],
                           [capture.names[v] for v in order[:36:3]],
                           capture.held_out[order[:36:3]], capture.frame)
    points, figures = landmarks_of_capture(capture_part)
    assert points is not None and np.isfinite(points).all()
    assert figures["error_px"] < 4.0
    other = int(order[1])
    image = np.uint8(255 * capture.image_float(other, background=0.6))
    seen = detect_landmarks(image)
    pixels, _ = capture.cameras[other].project(points)
    eye = np.linalg.norm(seen[36] - seen[45])
    assert np.linalg.norm(pixels[0] - seen, axis=1)[17:].mean() < 0.04 * eye
    # +y up, +z out of the face: the brows over the mouth, the nose in front of the eyes.
    assert points[19:25, 1].min() > points[48:60, 1].max()
    assert points[30, 2] > points[36:48, 2].max()
