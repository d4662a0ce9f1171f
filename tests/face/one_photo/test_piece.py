"""Inflated outlines."""

import numpy as np

from lfportrait.face.one_photo.parts import signed_distance
from lfportrait.face.one_photo.piece import inflated


def _disc(radius: float, size: int = 61) -> np.ndarray:
    y, x = np.mgrid[:size, :size] - size // 2
    return np.asarray(radius - np.hypot(x, y), np.float32)


def test_a_disc_becomes_a_ball():
    inside = _disc(20.3)
    domain = inside > 0
    squares = inflated(domain, inside, 0.1, source=4.0)
    ball = np.where(domain, 2.03 ** 2 - (0.1 * (20.3 - inside)) ** 2, 0)
    assert np.abs(squares - ball).max() < 0.05 * 2.03 ** 2


def test_given_values_are_met_and_bounds_are_kept():
    inside = _disc(20.0)
    domain = (inside > 0) & (np.arange(61) > 30)[:, None]
    given = np.where((inside > 0) & ~domain, 7.0, np.nan)
    squares = inflated(domain, inside, 0.1, source=4.0, given=given)
    assert abs(squares[31, 30] - 7.0) < 1.0
    least = np.where(inside > 5, 9.0, 0.0)
    high = inflated(domain, inside, 0.1, source=4.0, least=least)
    assert (high[domain] >= least[domain] - 1e-9).all()


def test_a_cut_has_no_slope():
    inside = np.full((9, 40), 100.0, np.float32)
    inside[:, :5] = np.arange(5) - 4.5
    inside[:, 35:] = 4.5 - np.arange(5) - 4.0
    domain = inside > 0
    domain[0] = False
    squares = inflated(domain, inside, 1.0, source=2.0, free=~domain & (inside > 0))
    assert np.ptp(squares[1:, 20]) < 1e-6 and squares[4, 20] > squares[4, 6]


def test_signed_distance_is_finer_than_pixels_at_the_outline():
    matte = np.zeros((20, 20), np.float32)
    matte[:, 10:] = 1.0
    matte[:, 9] = 0.3
    away = signed_distance(matte)
    assert abs(away[5, 9] + 0.2) < 1e-6 and away[5, 12] > 2 and away[5, 4] < -4
