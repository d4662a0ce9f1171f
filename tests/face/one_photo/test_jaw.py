"""The edge of a jaw before its neck: it is found beside the landmarks where a photo shows it."""

import itertools

import cv2
import numpy as np
import pytest

from lfportrait.face.one_photo.jaw import FIRST, LAST, cheapest_path, jaw_edge

EYES = 200.0  # Distance of the eyes' outer corners in the drawn photo, pixels.
MIDDLE = np.array([300.0, 260.0])
SKIN = (200, 160, 140)


def jaw(size: float) -> np.ndarray:
    """Landmarks [68, 2] of a face whose jaw is half an ellipse; ``size`` 1 is the drawn one."""
    out = np.tile(MIDDLE, (68, 1))
    turn = np.pi * (1 - np.arange(17) / 16)
    out[:17] = MIDDLE + size * np.stack([180 * np.cos(turn), 230 * np.sin(turn)], axis=1)
    out[36], out[45] = MIDDLE - [EYES / 2, 40], MIDDLE - [-EYES / 2, 40]
    return out


def drawn(neck: tuple[int, int, int], cloth: float | None = None) -> np.ndarray:
    """A face before a neck, uint8 [600, 600, 3]; a dark ``cloth`` ends so far below the jaw."""
    image = np.full((600, 600, 3), neck, np.uint8)
    if cloth is not None:
        image[:] = (25, 25, 35)
        more = round(cloth * EYES)
        cv2.ellipse(image, (300, 260), (180 + more, 230 + more), 0, 0, 360, neck, -1)
    cv2.ellipse(image, (300, 260), (180, 230), 0, 0, 360, SKIN, -1)
    cv2.rectangle(image, (0, 0), (599, 259), SKIN, -1)
    return cv2.GaussianBlur(image, (0, 0), 1.5)


def off(found: np.ndarray) -> np.ndarray:
    """How far places are from the drawn jaw, over the eyes' distance."""
    return np.linalg.norm(found[:17] - jaw(1.0)[:17], axis=1)[FIRST:LAST] / EYES


@pytest.mark.parametrize("size", [0.96, 1.04])
def test_the_edge_that_a_photo_shows_is_found(size):
    given = jaw(size)
    found = jaw_edge(drawn((110, 110, 110)), given)
    assert off(given).min() > 0.04 and off(found).max() < 0.022
    assert np.isnan(found[np.r_[0:FIRST, LAST:17]]).all()


@pytest.mark.parametrize("cloth", [0.05, 0.07])
def test_a_collar_close_below_a_jaw_is_not_its_edge(cloth):
    neck = (165, 128, 110)
    assert off(jaw_edge(drawn(neck, cloth), jaw(1.0))).max() < 0.01


def test_there_is_no_edge_where_a_photo_shows_none():
    plain = np.full((600, 600, 3), 150, np.uint8)
    noise = np.random.default_rng(2).normal(0, 8, plain.shape)
    for photo in (plain, np.uint8(plain + noise), drawn((110, 110, 110))[:280]):
        assert np.isnan(jaw_edge(photo, jaw(0.94))).all()


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
