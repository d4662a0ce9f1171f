"""The painted face's light goes on beside it."""

from __future__ import annotations

import numpy as np
import pytest

from lfportrait.example.skin.painting import extrapolated_light
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
    light = extrapolated_light(places, canvas, core, color, tone)
    assert light.shape == core.shape and not light[core].any()
    beside = (np.abs(np.abs(right) - 0.55) < 0.03) & (down > 0.2) & (down < 0.8) & ~core
    for side, wanted in ((right < 0, -0.2), (right > 0, 0.1)):
        assert (beside & side).sum() > 5
        assert np.allclose(light[beside & side], wanted, atol=0.25 * abs(wanted))
    far = (np.abs(right) > 1) | (down < -0.6) | (down > 1.6)
    assert np.abs(light[far]).max() < 0.01
