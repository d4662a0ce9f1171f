"""Tests of what two photos have in common."""

import numpy as np
import pytest

from lfportrait.capture.calibration.database import two_views

FOCAL, SIZE = 500.0, (600, 400)
TURN = np.array([[0.98, 0, 0.199], [0, 1, 0], [-0.199, 0, 0.98]])
SHIFT = np.array([0.6, 0.1, 0.0])


def seen(points):
    """Places of points [N, 3] in two photos, two times float32 [N, 2]."""
    return [np.float32(FOCAL * side[:, :2] / side[:, 2:] + np.array(SIZE) / 2)
            for side in (points, points @ TURN + SHIFT)]


def room(generator, count):
    """Points at all depths, float64 [count, 3]."""
    return generator.uniform((-1, -1, 3), (1, 1, 5), (count, 3))


def spoiled(generator, places, first):
    """The same with noise of a third of a pixel, and wrong from one match on."""
    one, other = (side + np.float32(0.3) * generator.standard_normal(side.shape, np.float32)
                  for side in places)
    other[first:] = generator.uniform((0, 0), SIZE, (len(other) - first, 2))
    return one, other


@pytest.mark.parametrize("seed", range(4))
def test_right_matches_stay_and_wrong_ones_go(seed):
    generator = np.random.default_rng(seed)
    one, other = spoiled(generator, seen(room(generator, 120)), 80)
    found = two_views(one, other, 15)
    assert found.kind == "UNCALIBRATED"
    assert found.inliers[:80].mean() > 0.95
    assert found.inliers[80:].mean() < 0.3
    again = two_views(one, other, 15)
    assert np.array_equal(found.inliers, again.inliers)
    assert np.array_equal(found.fundamental, again.fundamental)


def test_the_matrix_explains_right_matches_without_noise():
    one, other = (np.column_stack([side, np.ones(60)])
                  for side in seen(room(np.random.default_rng(0), 60)))
    found = two_views(np.float32(one[:, :2]), np.float32(other[:, :2]), 15)
    line = one @ found.fundamental.T
    distance = np.abs((line * other).sum(1)) / np.hypot(line[:, 0], line[:, 1])
    assert distance.max() < 0.05


def test_known_lenses_give_the_way_between_the_cameras():
    generator = np.random.default_rng(1)
    one, other = spoiled(generator, seen(room(generator, 120)), 90)
    found = two_views(one, other, 15, ((FOCAL, SIZE), (FOCAL, SIZE)))
    x, y, z = SHIFT / np.linalg.norm(SHIFT)
    wanted = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ TURN.T
    essential = found.essential / np.linalg.norm(found.essential) * np.sqrt(2)
    assert found.kind == "CALIBRATED"
    assert min(np.abs(essential - wanted).max(), np.abs(essential + wanted).max()) < 0.05


def test_lenses_that_are_not_as_noted_are_not_believed():
    generator = np.random.default_rng(2)
    one, other = spoiled(generator, seen(room(generator, 200)), 200)
    found = two_views(one, other, 15, ((4 * FOCAL, SIZE), (FOCAL / 4, SIZE)))
    assert found.kind == "UNCALIBRATED"
    assert not found.essential.any()
    assert found.inliers.mean() > 0.95


def test_a_wall_is_known_as_flat():
    generator = np.random.default_rng(3)
    points = room(generator, 120)
    points[:, 2] = 4.0
    one, other = spoiled(generator, seen(points), 90)
    found = two_views(one, other, 15)
    assert found.kind == "PLANAR_OR_PANORAMIC"
    assert found.homography.any()
    assert found.inliers[:90].mean() > 0.95


def test_too_few_right_matches_are_none():
    generator = np.random.default_rng(4)
    one, other = spoiled(generator, seen(room(generator, 100)), 12)
    assert two_views(one, other, 15) is None or two_views(one, other, 15).inliers.sum() >= 25
    assert two_views(one[:14], other[:14], 15) is None


@pytest.mark.parametrize("count", [0, 3, 15, 40])
def test_places_that_determine_nothing_are_no_error(count):
    still = np.zeros((count, 2), np.float32)
    line = np.float32(np.stack([np.arange(count), 2 * np.arange(count)], 1))
    for one, other in ((still, still), (line, line), (still, line)):
        found = two_views(one, other, 15)
        assert found is None or found.inliers.shape == (count,)
