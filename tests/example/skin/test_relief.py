"""Hair that only its relief tells."""

from __future__ import annotations

import numpy as np
import pytest

from lfportrait.example.skin.hair import around_face, hair_by_relief
from lfportrait.example.surface_guide import HeadPlane
from tests.portraits import HEAD_LANDMARKS

PLANE = HeadPlane(HEAD_LANDMARKS)


@pytest.fixture(scope="module")
def flat():
    """Places all around, from the crown to below the chin."""
    half = np.pi * PLANE.radius
    return np.random.default_rng(5).uniform(
        (-half, -1.6 * PLANE.height), (half, 1.6 * PLANE.height), (60000, 2)).astype(np.float32)


@pytest.fixture(scope="module")
def curls(flat):
    """A cap of curls: above a hairline, and behind down to the neck; bool [N]."""
    up, angle = -flat[:, 1] / PLANE.height, np.abs(flat[:, 0]) / PLANE.radius
    return (up > 0.55) | (angle > 1.7) & (up > -0.8)


def _told(flat, curls, rough, plain, seen=None, ears=None):
    random = np.random.default_rng(6)
    contours = np.clip(np.where(curls, rough, plain) + random.normal(0, 0.15, len(flat)), 0, 1)
    nothing = np.zeros(len(flat), np.float32)
    return hair_by_relief(PLANE, flat, contours.astype(np.float32),
                          nothing + 1 if seen is None else seen, nothing if ears is None else ears)


def test_what_is_as_rough_as_the_crown_is_hair(flat, curls):
    hair = _told(flat, curls, 0.75, 0.3)
    assert hair.min() >= 0 and hair.max() <= 1
    assert ((hair > 0.5) == curls).mean() > 0.97
    # A rough mouth or collar does not hang together with it, nor is what hangs low hair.
    up, angle = -flat[:, 1] / PLANE.height, np.abs(flat[:, 0]) / PLANE.radius
    mouth, robe = (np.abs(up + 0.6) < 0.15) & (angle < 0.4), up < -1.2
    more = _told(flat, curls | mouth | robe, 0.75, 0.3)
    assert not more[mouth].any() and not more[robe].any()


@pytest.mark.parametrize(("rough", "plain"), [(0.05, 0.05), (0.05, 0.3), (0.45, 0.1), (0.7, 0.5)])
def test_a_smooth_crown_or_a_rough_face_tells_nothing(flat, curls, rough, plain):
    assert _told(flat, curls, rough, plain) is None


def test_ears_are_none_and_what_no_photo_saw_goes_on(flat, curls):
    up, angle = -flat[:, 1] / PLANE.height, flat[:, 0] / PLANE.radius
    ears = ((np.abs(up + 0.2) < 0.3) & (np.abs(np.abs(angle) - 1.8) < 0.2)).astype(np.float32)
    seen = (np.abs(angle) < 2.8).astype(np.float32)
    hair = _told(flat, curls & (seen > 0), 0.75, 0.3, seen, ears)
    assert not hair[ears > 0].any()
    assert hair[(seen == 0) & (up > -0.6)].mean() > 0.9
    # Of a head that no photo saw nothing can be told.
    assert _told(flat, curls, 0.75, 0.3, 0 * seen, ears) is None


def test_hair_lies_around_the_face(flat):
    up, angle = -flat[:, 1] / PLANE.height, np.abs(flat[:, 0]) / PLANE.radius
    around = around_face(PLANE, flat, -0.7)
    assert around[up > 0.36].all() and not around[(angle < 0.4) & (up < 0.3)].any()
    assert around[(angle > 1) & (up > -0.65)].all() and not around[up < -0.75].any()
