"""Ears that the painting lacks keep the sitter's relief, and those that it has are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.example.guides.filters import grey
from lfportrait.example.skin.painting import shade_ears
from lfportrait.example.skin.sitter import canvas_of


@pytest.fixture
def eared(skin):
    """The small head with two ears, whose light and shade are stripes."""
    side = np.abs(skin.flat[:, 0])
    place = (side > np.quantile(side, 0.3)) & (side < np.quantile(side, 0.6))
    relief = np.float32(0.1) * np.sin(25 * skin.flat[:, 1]).astype(np.float32)
    shown = np.full((*skin.atlas.depth.shape, 3), 0.5, np.float32)
    shown.reshape(-1, 3)[skin.index] += relief[:, None]
    return replace(skin, atlas=replace(skin.atlas, shown=shown), hair=None,
                   ears=place.astype(np.float32), seen=np.ones_like(skin.seen),
                   tone=np.full_like(skin.tone, 0.5), detail=relief, kept={})


def _painted(eared, values):
    """A grey painting of values [N], and its canvas."""
    canvas, places = canvas_of(eared, 1)
    return canvas, places, np.ascontiguousarray(
        np.repeat(canvas.spread(values[:, None], 0.5), 3, axis=2))


def _seen(canvas, picture, count):
    out = np.full(count, np.nan)
    out[canvas.slots[canvas.own]] = picture[canvas.own]
    return out


def test_a_plain_ear_gets_the_sitters_relief(eared):
    random = np.random.default_rng(0)
    values = (0.5 + 0.02 * random.standard_normal(len(eared.flat))).astype(np.float32)
    canvas, places, color = _painted(eared, values)
    before = color.copy()
    shade_ears(places, canvas, color)
    luma = _seen(canvas, grey(color), len(values))
    for side in (eared.flat[:, 0] < 0, eared.flat[:, 0] >= 0):
        here = (eared.ears > 0.5) & side & np.isfinite(luma)
        assert np.corrcoef(luma[here], eared.detail[here])[0, 1] > 0.9
        assert luma[here].std() > 0.9 * eared.detail[here].std()
    other = canvas.own & (eared.ears[np.maximum(canvas.slots, 0)] == 0)
    assert np.array_equal(color[other], before[other])


def test_an_ear_that_is_painted_stays(eared):
    canvas, places, color = _painted(eared, np.float32(0.5) + np.float32(1.5) * eared.detail)
    before = color.copy()
    shade_ears(places, canvas, color)
    assert np.abs(color - before).max() < 0.03


def test_hair_over_an_ear_stays(eared):
    values = np.full(len(eared.flat), 0.5, np.float32)
    canvas, places, color = _painted(replace(eared, hair=np.ones(len(values), np.float32)), values)
    before = color.copy()
    shade_ears(places, canvas, color)
    assert np.array_equal(color, before)


def test_an_ear_that_no_photo_saw_well_has_its_relief_too(eared):
    values = np.full(len(eared.flat), 0.5, np.float32)
    grazed = replace(eared, seen=np.where(eared.ears > 0, 0, eared.seen).astype(np.float32),
                     detail=np.where(eared.ears > 0, 0, eared.detail).astype(np.float32))
    canvas, places, color = _painted(grazed, values)
    shade_ears(places, canvas, color)
    luma = _seen(canvas, grey(color), len(values))
    here = (eared.ears > 0.5) & np.isfinite(luma)
    assert np.corrcoef(luma[here], eared.detail[here])[0, 1] > 0.9
