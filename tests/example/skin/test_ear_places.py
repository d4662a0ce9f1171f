"""Ears are what stands out from the head beside it, hollows included."""

import numpy as np
import pytest

from lfportrait.example.skin.ears import _ellipsoids, ear_places
from lfportrait.example.surface_guide import HeadPlane
from tests.portraits import HEAD_LANDMARKS

PLANE = HeadPlane(HEAD_LANDMARKS)


@pytest.fixture(scope="module")
def head():
    """Places of a cylinder around the head's axis, [N, 3]."""
    turn, rise = np.meshgrid(np.radians(np.arange(-180, 180, 1.0)),
                             np.linspace(-1.4, 0.8, 300) * PLANE.height)
    # As wide as the jaw's ends.
    radius = np.hypot(*(HEAD_LANDMARKS[16] - PLANE.origin)[[0, 2]])
    points = np.stack([radius * np.sin(turn), rise, radius * np.cos(turn)], -1)
    return (points.reshape(-1, 3) + PLANE.origin).astype(np.float32)


def _flat(points):
    return PLANE.unwrap(points).astype(np.float32)


def _with_ear(head, side):
    """The head with a ring that stands out, the places of its disk, and those around it."""
    near = _ellipsoids(PLANE, head) > 0.9
    near &= side * (head[:, 0] - PLANE.origin[0]) > 0
    middle = head[near].mean(axis=0)
    away = np.hypot(head[:, 1] - middle[1], head[:, 2] - middle[2]) / PLANE.height
    away[side * (head[:, 0] - PLANE.origin[0]) < 0] = np.inf
    out = head.copy()
    out[(away > 0.05) & (away < 0.12), 0] += np.float32(side * 0.1 * PLANE.height)
    return out, away < 0.1, (away > 0.16) & (away < 0.2)


@pytest.mark.parametrize("side", [-1, 1])
def test_an_ear_has_its_own_outline_and_its_hollow(head, side):
    points, ear, around = _with_ear(head, side)
    found = ear_places(PLANE, points, _flat(points))
    assert found.shape == (len(points),) and found.min() >= 0 and found.max() <= 1
    assert found[ear].mean() > 0.9
    assert found[around].mean() < 0.1
    assert _ellipsoids(PLANE, points)[around].mean() > 0.5


def test_where_nothing_stands_out_an_ear_lies_under_hair(head):
    assert np.allclose(ear_places(PLANE, head, _flat(head)), _ellipsoids(PLANE, head))


def test_of_a_head_without_jaw_ends_nothing_is_an_ear(head):
    marks = HEAD_LANDMARKS.copy()
    marks[[0, 16]] = np.nan
    assert not ear_places(HeadPlane(marks), head, _flat(head)).any()
