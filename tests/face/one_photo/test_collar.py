"""What a body wears goes round its neck."""

import numpy as np
import pytest

from lfportrait.face.one_photo.collar import ROW, Collar, spread_around

COLLAR = Collar(np.array([0.1, -0.5, 0.0]), 0.3, np.array([0.0, 1.0, 0.0]))


def ring(turn: np.ndarray, radius: float, height: float) -> np.ndarray:
    """Points around the neck, 0 in front."""
    return COLLAR.middle + np.stack([radius * np.sin(turn), np.full(len(turn), height),
                                     radius * np.cos(turn)], axis=1)


def test_places_lie_as_far_down_as_from_the_ring_and_around_it():
    turn = np.linspace(-3, 3, 7)
    for radius, height, down in ((0.3, 0.1, -0.1), (0.3, -0.2, 0.2), (0.7, 0.0, 0.4),
                                 (0.6, -0.4, 0.5), (0.1, -0.2, 0.2)):
        found = COLLAR.around(ring(turn, radius, height))
        assert found[:, 0] == pytest.approx(np.full(7, down))
        assert found[:, 1] == pytest.approx(turn / (2 * np.pi))


def test_around_a_neck_that_leans_the_same_ring_is_as_far_down():
    leaning = Collar(COLLAR.middle, 0.3, np.array([0.0, np.cos(0.4), np.sin(0.4)]))
    turn = np.linspace(-3, 3, 9)
    points = ring(turn, 0.5, -0.1) - COLLAR.middle
    cos, sin = np.cos(0.4), np.sin(0.4)
    turned = points @ np.array([[1, 0, 0], [0, cos, sin], [0, -sin, cos]])
    assert leaning.around(COLLAR.middle + turned) == pytest.approx(
        COLLAR.around(COLLAR.middle + points))


def test_a_collar_goes_on_around_the_neck_with_its_edge():
    """It is three centimeters high, and known from the sides and in front alone."""
    down, turn = (part.ravel() for part in np.meshgrid(
        np.arange(-0.2, 0.6, 0.5 * ROW), np.linspace(-0.5, 0.5, 200, endpoint=False)))
    collar = (down > 0) & (down < 0.15)
    values = np.stack([collar, down > 0.3], axis=1).astype(float)
    known = (np.abs(turn) < 0.2).astype(float)
    values[known == 0] = 0.5  # nobody looks there
    found = spread_around(np.stack([down, turn], axis=1), values, known)
    behind = np.abs(turn) > 0.45
    for high, low, worn in ((-0.2, -0.08, 0.0), (0.05, 0.1, 1.0), (0.23, 0.6, 0.0)):
        rows = behind & (down > high) & (down < low)
        assert np.abs(found[rows, 0] - worn).max() < 0.35
    assert found[behind & (down > 0.4), 1].min() > 0.85
    # Both ends of the picture are one place.
    first, last = (found[turn == end, 0] for end in (turn.min(), turn.max()))
    assert np.abs(first - last).max() < 0.02


def test_what_one_side_hides_is_as_on_the_other():
    """A shirt is seen at the throat; the jacket beside it is seen on one side alone."""
    down, turn = (part.ravel() for part in np.meshgrid(
        np.arange(0, 0.2, 0.5 * ROW), np.linspace(-0.5, 0.5, 200, endpoint=False)))
    known = ((turn > -0.3) & (turn < 0.1)).astype(float)
    jacket = (np.abs(turn) > 0.1).astype(float)
    found = spread_around(np.stack([down, turn], axis=1), jacket[:, None], known)[:, 0]
    assert found[np.abs(turn) > 0.3].min() > 0.8 and found[np.abs(turn) < 0.05].max() < 0.2


def test_what_is_hardly_known_says_nothing():
    places = np.stack([np.linspace(0, 1, 50), np.zeros(50)], axis=1)
    values = np.where(np.arange(50) < 25, 1.0, 0.0)[:, None]
    found = spread_around(places, values, np.where(np.arange(50) < 25, 1.0, 0.15))
    assert found.min() > 0.99
    # Where all is hardly known, that is what there is.
    found = spread_around(places, np.full((50, 1), 0.8), np.full(50, 0.1))
    assert found == pytest.approx(np.full((50, 1), 0.8))
