"""The edge of a jaw before its neck: landmarks move to where a photo shows it."""

import itertools

import cv2
import numpy as np
import pytest

from lfportrait.face.one_photo.jaw import FIRST, LAST, cheapest_path, on_jaw_edge

EYES = 200.0  # Distance of the eyes' outer corners in the drawn photo, pixels.
MIDDLE = np.array([300.0, 260.0])


def jaw(size: float) -> np.ndarray:
    """Landmarks [68, 2] of a face whose jaw is half an ellipse; ``size`` 1 is the drawn one."""
    out = np.tile(MIDDLE, (68, 1))
    turn = np.pi * (1 - np.arange(17) / 16)
    out[:17] = MIDDLE + size * np.stack([180 * np.cos(turn), 230 * np.sin(turn)], axis=1)
    out[36], out[45] = MIDDLE - [EYES / 2, 40], MIDDLE - [-EYES / 2, 40]
    return out


def drawn(neck: int) -> np.ndarray:
    """A face before a neck of some grey, uint8 [600, 600, 3]."""
    image = np.full((600, 600, 3), neck, np.uint8)
    cv2.ellipse(image, (300, 260), (180, 230), 0, 0, 360, (200, 160, 140), -1)
    cv2.rectangle(image, (0, 0), (599, 259), (200, 160, 140), -1)
    return cv2.GaussianBlur(image, (0, 0), 1.5)


@pytest.mark.parametrize("size", [0.94, 1.05])
def test_a_chin_moves_to_the_edge_that_a_photo_shows(size):
    given, true = jaw(size), jaw(1.0)
    found = on_jaw_edge(drawn(110), given)
    off = [np.linalg.norm(one - true, axis=1)[FIRST:LAST] / EYES for one in (given, found)]
    assert off[0].min() > 0.04
    assert off[1].max() < 0.015
    others = np.r_[0:FIRST, LAST:68]
    np.testing.assert_array_equal(found[others], given[others])


def test_a_chin_stays_where_a_photo_shows_no_edge():
    given = jaw(0.94)
    plain = np.full((600, 600, 3), 150, np.uint8)
    np.testing.assert_allclose(on_jaw_edge(plain, given), given, atol=1e-9)
    # Nor does one move that the photo cuts off.
    np.testing.assert_allclose(on_jaw_edge(drawn(110)[:280], given), given, atol=1e-9)


def test_the_cheapest_path_is_the_cheapest():
    cost = np.random.default_rng(3).uniform(0, 1, (5, 4))
    bend, step = 0.15, 2

    def total(path):
        turns = np.diff(path)
        if np.abs(turns).max() > step:
            return np.inf
        return cost[np.arange(5), path].sum() + bend * (turns ** 2).sum()

    best = min(itertools.product(range(4), repeat=5), key=total)
    np.testing.assert_array_equal(cheapest_path(cost, bend, step), best)
