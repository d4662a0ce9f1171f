"""The photo's light and shade on painted clothes."""

import numpy as np
import pytest

from lfportrait.example.painter.photo import with_folds

SIDE, FACE = 160, 60.0


def cloth(seed=0):
    """The luma of a photo with folds and a bright zip, and where it shows clothes."""
    y, x = np.mgrid[:SIDE, :SIDE]
    luma = np.float32(0.45 + 0.12 * np.sin(x / 7 + y / 19))
    luma[:, 78:82] = 0.92
    luma += np.random.default_rng(seed).normal(0, 0.01, luma.shape).astype(np.float32)
    worn = np.zeros(luma.shape, np.float32)
    worn[40:] = 1
    return np.clip(luma, 0, 1), worn


def grey(color):
    return color @ np.array([0.299, 0.587, 0.114], np.float32)


@pytest.mark.parametrize("paint", [(0.94, 0.95, 0.97), (0.06, 0.05, 0.05), (0.85, 0.3, 0.25)])
def test_flat_paint_gets_the_photos_folds_and_keeps_its_hue(paint):
    luma, worn = cloth()
    color = np.full((SIDE, SIDE, 3), paint, np.float32)
    made = with_folds(color, luma, worn, FACE)
    assert made.dtype == np.float32 and made.min() >= 0 and made.max() <= 1
    below = worn > 0
    assert np.corrcoef(grey(made)[below], luma[below])[0, 1] > 0.9
    assert grey(made)[80:, 78:82].mean() > grey(made)[80:, 86:150].mean() + 0.01
    assert (made[:40] == color[:40]).all()
    order = np.argsort(paint)
    assert (np.argsort(made[below].mean(axis=0)) == order).all()
    assert abs(np.median(grey(made)[below]) - grey(np.float32(paint))) < 0.05


def test_paint_that_has_them_already_stays():
    luma, worn = cloth()
    color = np.repeat(luma[..., None], 3, axis=-1)
    # Strong folds of the painter's own, in the same places.
    made = with_folds(color, np.float32(0.5) + (luma - np.float32(0.5)) * np.float32(0.3), worn,
                      FACE)
    assert np.abs(made - color)[50:].mean() < 0.01


def test_strokes_of_the_painter_stay_where_the_photo_is_plain():
    _, worn = cloth()
    strokes = np.random.default_rng(1).uniform(0.3, 0.7, (SIDE, SIDE, 3)).astype(np.float32)
    made = with_folds(strokes, np.full((SIDE, SIDE), 0.4, np.float32), worn, FACE)
    assert np.abs(made - strokes).max() < 1e-5


def test_nothing_is_worn():
    luma, _ = cloth()
    color = np.random.default_rng(2).uniform(0, 1, (SIDE, SIDE, 3)).astype(np.float32)
    assert with_folds(color, luma, np.zeros_like(luma), FACE) is color
