"""Landmarks in space from one picture: the symmetric head whose pictures are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from scipy.spatial.transform import Rotation

from lfportrait.face import FacePose, symmetric_landmarks
from lfportrait.face.landmarks import GENERIC_LANDMARKS, MIRRORED


def posed(yaw, pitch=0.0, scale=200.0):
    turn = Rotation.from_euler("zxy", [0.0, -pitch, yaw], degrees=True).as_matrix()
    return FacePose(turn, scale, np.array([300.0, 260.0]), 0.0)


def person(seed, across=0.02, deep=0.03):
    """A symmetric head with proportions of its own."""
    change = np.random.default_rng(seed).normal(0, 1, (68, 3)) * [across, across, deep]
    change = (change + change[MIRRORED] * [-1, 1, 1]) / 2
    even = (GENERIC_LANDMARKS + GENERIC_LANDMARKS[MIRRORED] * [-1, 1, 1]) / 2
    return even + change


@settings(max_examples=30, deadline=None)
@given(some.floats(15, 60), some.floats(-15, 15), some.sampled_from([-1, 1]), some.integers(0, 99))
def test_proportions_of_a_person_are_told_by_symmetry(yaw, pitch, side, seed):
    head, pose = person(seed), posed(side * yaw, pitch)
    found = symmetric_landmarks(pose.project(head), pose)
    inner = np.arange(68) >= 17
    away = np.abs(found - head)[inner]
    before = np.abs(GENERIC_LANDMARKS - head)[inner]
    assert away[:, 0].max() < 0.005 and away[:, 1].mean() < 0.4 * before[:, 1].mean()
    assert away[:, 2].mean() < 0.4 * before[:, 2].mean()


@settings(max_examples=20, deadline=None)
@given(some.floats(-60, 60), some.integers(0, 99))
def test_they_are_symmetric_and_a_mirrored_picture_gives_the_same(yaw, seed):
    random = np.random.default_rng(seed)
    pose = posed(yaw)
    seen = pose.project(person(seed)) + random.normal(0, 2, (68, 2))
    found = symmetric_landmarks(seen, pose)
    even = (GENERIC_LANDMARKS + GENERIC_LANDMARKS[MIRRORED] * [-1, 1, 1]) / 2
    slack = 2 * np.abs(GENERIC_LANDMARKS - even).max() + 1e-9
    assert np.abs(found[MIRRORED] * [-1, 1, 1] - found).max() < slack
    other = symmetric_landmarks((seen * [-1, 1] + [600, 0])[MIRRORED], posed(-yaw))
    assert np.abs(other - found).max() < slack


def test_from_the_front_depth_is_the_generic_heads():
    head, pose = person(3), posed(0.0)
    found = symmetric_landmarks(pose.project(head), pose)
    assert np.abs(found[:, :2] - head[:, :2]).max() < 1e-6
    assert np.allclose(found[:, 2], GENERIC_LANDMARKS[:, 2], atol=1e-6)


@pytest.mark.parametrize("yaw", [-35.0, 35.0])
def test_unknown_landmarks_are_told_by_their_twins_or_generic(yaw):
    head, pose = person(4, deep=0.0), posed(yaw)
    seen = pose.project(head)
    seen[[38, 30]] = np.nan
    # On the far side the jaw's may be anywhere.
    far = np.flatnonzero((np.arange(68) < 17) & (head[:, 0] * np.sign(yaw) > 0))
    seen[far] += 40
    found = symmetric_landmarks(seen, pose)
    assert np.abs(found[38] - head[38]).max() < 0.01
    assert np.array_equal(found[30], GENERIC_LANDMARKS[30])
    assert np.abs(found[far, :2] - head[far, :2]).max() < 0.02
