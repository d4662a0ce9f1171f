"""The painted face's light goes on beside it."""

from __future__ import annotations

import numpy as np
import pytest

from lfportrait.example.painter.light import DARKER_STEP, LIGHTER_STEP, evened_beside
from lfportrait.example.skin.painting import even_edge, extrapolated_light
from lfportrait.example.skin.sitter import canvas_of


@pytest.mark.parametrize("step", [1, 2])
def test_a_cheek_that_ends_in_shade_goes_on_in_shade(skin, step):
    canvas, places = canvas_of(skin, step)
    right, down = places.flat.T / places.plane.height
    core = (np.abs(right) < 0.5) & (down > 0) & (down < 1) & places.outwards
    tone = np.full(len(core), 0.5, np.float32)
    paint = np.where(right < 0, 0.3, 0.6).astype(np.float32)
    # What is not painted yet says nothing.
    paint[~core] = 0
    color = np.repeat(canvas.spread(paint[:, None]), 3, axis=2)
    light = extrapolated_light(places, canvas, core, color, tone, np.ones_like(core))
    assert light.shape == core.shape and not light[core].any()
    beside = (np.abs(np.abs(right) - 0.55) < 0.03) & (down > 0.2) & (down < 0.8) & ~core
    for side, wanted in ((right < 0, -0.2), (right > 0, 0.1)):
        assert (beside & side).sum() > 5
        assert np.allclose(light[beside & side], wanted, atol=0.25 * abs(wanted))
    far = (np.abs(right) > 1) | (down < -0.6) | (down > 1.6)
    assert np.abs(light[far]).max() < 0.01
    # A beard on one side says nothing of the light there.
    bare = extrapolated_light(places, canvas, core, color, tone, right > 0)
    assert np.abs(bare[beside & (right < 0)]).max() < 0.15
    np.testing.assert_allclose(bare[beside & (right > 0.5)], light[beside & (right > 0.5)],
                               atol=0.02)


def paint_beside(low, high, height=1.0):
    """Places of a face of one grey, and of what is beside of another, with strokes of their own."""
    x, y = (axis.ravel().astype(np.float32) for axis in np.meshgrid(
        np.arange(-1.2, 1.2, 0.01), np.arange(-0.6, 1.2, 0.01)))
    painted = np.hypot(x, y - 0.3) < 0.5
    strokes = np.random.default_rng(2).normal(0, 0.02, len(x)).astype(np.float32)
    grey = np.where(painted, np.float32(high), np.float32(low)) + strokes
    return height * np.stack([x, y], axis=1), painted, np.repeat(grey[:, None], 3, axis=1)


@pytest.mark.parametrize("low, high", [(0.3, 0.5), (0.6, 0.45)])
def test_patches_begin_in_the_colors_that_the_face_ends_in(low, high):
    flat, painted, color = paint_beside(low, high)
    out = evened_beside(flat, 1.0, painted, np.ones(len(flat), np.float32), color)
    away = np.hypot(flat[:, 0], flat[:, 1] - 0.3) - 0.5
    near, far = (away > 0) & (away < 0.03), away > 0.5
    np.testing.assert_array_equal(out[painted], color[painted])
    assert abs(out[near].mean() - high) < 0.25 * abs(high - low)
    np.testing.assert_allclose(out[far], color[far], atol=1e-3)
    # Nowhere is there another edge, and strokes stay.
    rings = [out[(away > edge) & (away < edge + 0.05)] for edge in np.arange(0, 0.55, 0.05)]
    assert np.abs(np.diff([ring.mean() for ring in rings])).max() < 0.35 * abs(high - low)
    assert out[far].std() > 0.019 and out[near, 0].std() > 0.018


def test_a_dark_stain_in_the_face_reaches_less_far_than_light():
    for low, high, most in ((0.8, 0.1, DARKER_STEP), (0.1, 0.8, LIGHTER_STEP)):
        flat, painted, color = paint_beside(low, high)
        out = evened_beside(flat, 1.0, painted, np.ones(len(flat), np.float32), color)
        assert np.abs(out - color).max() == pytest.approx(most, abs=1e-3)
    assert DARKER_STEP < LIGHTER_STEP


def test_what_is_no_skin_stays_as_it_is():
    flat, painted, color = paint_beside(0.3, 0.6)
    bare = (flat[:, 0] < 0).astype(np.float32)
    out = evened_beside(flat, 1.0, painted, bare, color)
    np.testing.assert_array_equal(out[bare == 0], color[bare == 0])
    none = evened_beside(flat, 1.0, painted, np.zeros(len(flat), np.float32), color)
    np.testing.assert_array_equal(none, color)


@pytest.mark.parametrize("step", [1, 2])
def test_a_cheek_goes_on_and_throat_and_ears_stay(skin, step):
    canvas, places = canvas_of(skin, step)
    right, down = places.flat.T / places.plane.height
    core = (np.abs(right) < 0.4) & (down > 0) & (down < 0.9) & places.outwards
    grey = np.where(core, 0.6, 0.4).astype(np.float32)
    color = np.repeat(canvas.spread(grey[:, None]), 3, axis=2)
    even_edge(places, canvas, core, np.ones(len(core), np.float32), color)
    now = canvas.gathered(np.ascontiguousarray(color[..., 0]), len(core), np.nan)
    cheek = (np.abs(np.abs(right) - 0.43) < 0.03) & (down > 0.2) & (down < 0.6) & ~core
    cheek &= places.outwards & (places.ears == 0)
    assert np.nanmean(now[cheek]) > 0.53
    for part in (down > 1.02, places.ears == 1, core):
        assert part.any()
        shown = part & np.isfinite(now)
        np.testing.assert_array_equal(now[shown], grey[shown])
