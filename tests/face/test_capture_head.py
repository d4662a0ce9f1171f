"""A head is fitted to landmarks and a surface in space."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lfportrait import models
from lfportrait.face.capture_head import (
    LONG,
    METRES,
    _ears,
    _without_lean,
    fit_in_space,
    fit_to_surface,
    lengthened,
    proportion,
)
from lfportrait.face.head_prior import generic_prior, head_prior, with_normals
from lfportrait.field.closing import FittedHead


@pytest.fixture(scope="module")
def prior():
    return generic_prior()


@pytest.fixture(scope="module")
def sitter(prior):
    """A head of the generic model in the portrait frame, turned and larger than the mean."""
    identity = np.zeros(len(prior.identity))
    identity[[1, 4, 9]] = 1.5, -2.0, 1.0
    turn = Rotation.from_euler("yx", [6, -4], degrees=True).as_matrix()
    return 1.1 / METRES * prior.shape(identity, np.zeros(0)) @ turn.T + [0.02, -0.05, 0.1]


def _seen(prior, points, depth=0.15):
    """What a narrow arc shows of it: places before a depth, and their normals."""
    normals = with_normals(points, prior.triangles)
    shown = (normals[:, 2] > 0.4) & (points[:, 2] > depth)
    return points[shown][::3], normals[shown][::3]


def test_a_head_is_found_from_its_front(prior, sitter):
    points, normals = _seen(prior, sitter)
    found = fit_in_space(prior, sitter[prior.landmarks], points, normals, np.ones(len(points)))
    away = np.linalg.norm(found - sitter, axis=1) * METRES
    sides = (np.abs(sitter[:, 0]) > 0.3) & (sitter[:, 1] > -0.5)
    assert np.median(away[sides]) < 0.005
    mean = fit_in_space(prior, sitter[prior.landmarks], np.zeros((0, 3)), np.zeros((0, 3)),
                        np.zeros(0))
    alone = np.linalg.norm(mean - sitter, axis=1) * METRES
    front = sitter[:, 2] > 0.3
    assert away[front].mean() < 0.7 * alone[front].mean()


def test_landmarks_that_are_not_known_do_not_matter(prior, sitter):
    points, normals = _seen(prior, sitter)
    landmarks = sitter[prior.landmarks].copy()
    landmarks[:17] = np.nan  # the jaw's are not used
    landmarks[50] = np.nan
    found = fit_in_space(prior, landmarks, points, normals, np.ones(len(points)))
    front = sitter[:, 2] > 0.3
    assert np.linalg.norm(found - sitter, axis=1)[front].mean() * METRES < 0.004


def test_thick_hair_does_not_lift_the_skull(prior, sitter):
    points, normals = _seen(prior, sitter)
    bald = fit_in_space(prior, sitter[prior.landmarks], points, normals, np.ones(len(points)))
    high = points[:, 1] > 0.40
    assert high.sum() > 50
    hair = points + 0.1 * high[:, None] * normals
    found = fit_in_space(prior, sitter[prior.landmarks], hair, normals, np.ones(len(points)))
    crown = sitter[:, 1] > 0.45
    assert np.abs(found - bald)[crown].mean() * METRES < 0.008


def test_a_short_skull_is_lengthened_behind_the_ears(prior):
    mean = prior.mean.astype(np.float64)
    mean[:, 2] = np.where(mean[:, 2] < -0.02, -0.02 + 0.85 * (mean[:, 2] + 0.02), mean[:, 2])
    short = replace(prior, mean=mean.astype(np.float32))
    length, breadth = proportion(short, mean)
    assert length < 1.22 * breadth
    found = lengthened(short)
    length, width = proportion(found, found.mean.astype(np.float64))
    assert length / width == pytest.approx(LONG, abs=0.01) and width == breadth
    front = (mean[:, 2] > -0.018) | _ears(short)
    assert np.array_equal(found.mean[front], short.mean[front])
    assert found.mean[:, 2].min() < mean[:, 2].min() - 0.008
    # A skull that is long by itself stays.
    mean[:, 2] *= 1.3
    long = replace(prior, mean=mean.astype(np.float32))
    assert np.array_equal(lengthened(long).mean, long.mean)


def test_without_a_statistical_head_nothing_is_fitted(monkeypatch, prior, sitter):
    monkeypatch.setattr(models, "available", lambda name: False)
    nothing = np.zeros((0, 3))
    assert fit_to_surface(sitter[prior.landmarks], nothing, nothing, np.zeros(0)) is None


def fitted_mean() -> tuple[np.ndarray, FittedHead]:
    """The landmarks of the installed head's mean, and the head that is fitted to them alone."""
    head, nothing = head_prior(), np.zeros((0, 3))
    landmarks = head.mean[head.landmarks].astype(np.float64) / METRES
    found = fit_to_surface(landmarks, nothing, nothing, np.zeros(0))
    assert found is not None
    return landmarks, found


@pytest.mark.skipif(not models.available("head"), reason="no statistical head is installed")
def test_the_installed_head_has_its_ears_where_ears_are():
    landmarks, found = fitted_mean()
    assert 200 < found.ears.sum() < 0.3 * len(found.ears)
    ears = found.points[found.ears]
    # Between the brows and the nose's tip, behind the jaw's ends, as many on each side.
    assert landmarks[33, 1] - 0.1 < ears[:, 1].mean() < landmarks[19, 1]
    assert ears[:, 2].mean() < landmarks[[0, 16], 2].mean()
    assert (ears[:, 0] > 0).mean() == pytest.approx(0.5, abs=0.02)
    assert np.abs(ears[:, 0]).max() == pytest.approx(np.abs(found.points[:, 0]).max(), abs=0.01)


@pytest.mark.skipif(not models.available("head"), reason="no statistical head is installed")
def test_the_installed_head_is_as_long_as_heads_are():
    length, breadth = proportion(head_prior(), fitted_mean()[1].points)
    assert 1.24 < length / breadth < 1.32


@pytest.mark.skipif(not models.available("head"), reason="no statistical head is installed")
def test_what_detectors_lean_by_is_taken_off():
    head = head_prior()
    placed = head.mean[head.landmarks].astype(np.float64)
    eyes = np.linalg.norm(placed[45] - placed[36])
    turn = Rotation.from_euler("yxz", [20, 10, -15], degrees=True).as_matrix()
    # Across the eyes, down, and out of the face.
    leaning = placed + eyes * head.lean * [1, -1, 1]
    back = _without_lean(head, leaning @ turn.T) @ turn
    assert np.abs(back - placed).max() < 0.15 * eyes * np.abs(head.lean).max()
