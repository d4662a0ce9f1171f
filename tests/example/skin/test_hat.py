"""A painted cap on the surface of a head: around its crown, with an edge, and only when asked."""

import numpy as np
import pytest

from lfportrait.example.skin.painting import SkinPainter
from tests.example.worn.test_hat import GREEN, capped
from tests.portraits import HEAD_LANDMARKS, drawn_face


@pytest.fixture(scope="module")
def greens(skin):
    """Where the skin's lists have the cap's color, without it and with it."""
    exemplar, _ = capped(drawn_face(200, 160, seed=3), 1.8)
    out = {}
    for wear in ((), ("hat",)):
        painting = SkinPainter(exemplar, wear=wear).paint(skin)
        color = painting.color.reshape(-1, 3)[skin.index]
        assert np.isfinite(color).all()
        out[wear] = np.abs(color - GREEN / 255).max(axis=1) < 0.12
    return out[()], out["hat",]


def heights(points):
    """Heights above the brows, over the face's height."""
    brows, chin = HEAD_LANDMARKS[17:27, 1].mean(), np.nanmin(HEAD_LANDMARKS[:, 1])
    return (points[:, 1] - brows) / (brows - chin)


def test_it_lies_on_the_whole_crown(greens, points):
    up = heights(points)
    back = points[:, 2] < np.quantile(points[:, 2], 0.3)
    for part in (back, ~back):
        assert greens[1][part & (up > 0.65)].mean() > 0.95


def test_it_ends_above_the_face(greens, points):
    up = heights(points)
    front = points[:, 2] > np.quantile(points[:, 2], 0.6)
    assert greens[1][front & (up < 0.05)].mean() < 0.01
    assert greens[0][front & (up < 0.2)].mean() < 0.01


def test_its_edge_is_clear(greens, points):
    """In every direction there is a height that parts cap and head."""
    up, turn = heights(points), np.arctan2(points[:, 0], points[:, 2])
    for start in np.radians(np.arange(-180, 180, 30)):
        near = (turn > start) & (turn < start + np.radians(30)) & (up > -0.3)
        levels = np.linspace(-0.1, 0.7, 41)
        wrong = [np.mean(greens[1][near] != (up[near] > level)) for level in levels]
        assert min(wrong) < 0.06


@pytest.mark.slow  # paints a head
def test_spectacles_change_nothing_yet(skin):
    face = drawn_face(160, 120)
    plain, worn = (SkinPainter(face, wear=wear).paint(skin, step=2).color
                   for wear in ((), ("spectacles",)))
    np.testing.assert_array_equal(plain, worn)
