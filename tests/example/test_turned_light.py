"""Light carried over to a mirrored side: what a strip of the painter's own paint tells of it."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.example.frontal_light import DARK, Sides, blurred, relit

SHAPE = 120, 160
SKIN = np.array([220.0, 170.0, 110.0])
SHADE = np.array([-0.5, 0.0, 0.4])
"""Another hue, in logarithms of the channels."""


def sides(change, seen=130, hair=None):
    """Stripes on the left, mirrored to the right, where the painter's own are in another light.

    What he showed of the right ends at column ``seen``.
    """
    columns = np.indices(SHAPE)[1]
    strokes = 1 + 0.1 * np.sin(0.9 * columns)
    left = SKIN * strokes[..., None]
    theirs = np.where((columns < 80)[..., None], left, left[:, ::-1])
    lit = np.exp(np.log(theirs + DARK) + change) - DARK
    ours = np.where((columns < 80)[..., None], left, lit)
    share = blurred((columns < 90).astype(np.float32), 3.0)
    both = (columns < seen).astype(np.float32)
    face, features = np.ones(SHAPE, np.float32), np.zeros(SHAPE, np.float32)
    return Sides(np.asarray(ours, np.float32), np.asarray(theirs, np.float32), share, both,
                 face, face, hair, features, 100.0)


def difference(one, two):
    """Of broad colors in logarithms, at a mirrored place, [3]."""
    parts = [np.log(blurred(np.asarray(each, np.float32), 6.0) + DARK)[60, 110]
             for each in (one, two)]
    return parts[0] - parts[1]


@pytest.mark.parametrize("hair", [None, np.zeros(SHAPE, np.float32)])
def test_shade_of_another_hue_comes_to_the_mirrored_side(hair):
    given = sides(SHADE, hair=hair)
    found = relit(given)
    assert np.abs(difference(found, given.ours)).max() < 0.08
    assert np.abs(difference(given.theirs, given.ours)).max() > 0.3
    # Strokes stay: light changes broad colors alone.
    contrast = [each[60, 100:120].std(axis=0) / each[60, 100:120].mean(axis=0)
                for each in (found, given.theirs)]
    assert np.allclose(*contrast, atol=0.02)


def test_light_goes_on_behind_what_was_seen():
    given = sides(SHADE, seen=105, hair=np.zeros(SHAPE, np.float32))
    assert np.abs(difference(relit(given), given.ours)).max() < 0.2


def test_dark_hair_over_the_far_cheek_is_no_shade():
    dark = np.full(3, -1.4)
    given = sides(dark, hair=np.zeros(SHAPE, np.float32))
    assert np.abs(difference(relit(given), given.theirs)).max() < 0.3
    # Brown hair differs less; there the mask tells.
    hair = np.zeros(SHAPE, np.float32)
    hair[:, 80:] = 1
    given = sides(np.full(3, -0.6), hair=hair)
    assert np.abs(difference(relit(given), given.theirs)).max() < 0.05


def test_light_makes_a_highlight_no_brighter_than_all_paint():
    given = sides(np.full(3, 0.3), seen=95, hair=np.zeros(SHAPE, np.float32))
    given = replace(given, ours=0.6 * given.ours, theirs=0.6 * given.theirs)
    given.theirs[:, 105:116] = 230
    found = blurred(relit(given), 4.0)[60]
    assert (found[110] < 236).all()
    assert (found[98] > 1.15 * blurred(given.theirs, 4.0)[60, 98]).all()


def test_where_nothing_was_seen_twice_the_mirror_image_stays():
    given = sides(SHADE)
    assert relit(replace(given, both=np.zeros(SHAPE, np.float32))) is given.theirs


def test_dark_paint_between_brows_and_mouth_is_shade():
    given = sides(np.full(3, -1.4), hair=np.zeros(SHAPE, np.float32))
    found = relit(replace(given, features=np.ones(SHAPE, np.float32)))
    assert np.abs(difference(found, given.ours)).max() < 0.25


def test_half_tones_keep_their_warmth_beside_cold_shade():
    # The painter's half-tones are as warm as his lights; only his deep shade, above, is grey.
    rows, columns = np.indices(SHAPE)
    lit = SKIN + DARK
    left = lit * np.exp(-0.4 * np.abs(80 - columns) / 80)[..., None]
    shade = np.where(rows < 60, 1.0, 0.0)[..., None] * [-1.2, -0.9, -0.3]
    ours = np.where((columns < 80)[..., None], left, left * np.exp(shade)) - DARK
    given = replace(sides(0.0, seen=105, hair=np.zeros(SHAPE, np.float32)),
                    ours=np.asarray(ours, np.float32), theirs=np.asarray(left - DARK, np.float32),
                    features=np.ones(SHAPE, np.float32))
    change = (np.log(relit(given) + DARK) - np.log(lit))[:, 120]
    bright = change.mean(axis=-1)
    half = (bright > -0.44) & (bright < -0.3)
    assert half.sum() > 5
    assert (change[half, 0] - change[half, 2] > -0.1).all()
    assert change[bright < -0.8][:, 0].mean() < change[bright < -0.8][:, 2].mean() - 0.4


@pytest.mark.parametrize("pale", [True, False])
def test_a_pale_stroke_is_warm_in_shade_as_half_tones_are(pale):
    # His lights are pale, his half-tones warm; narrow lights on half-tones come into shade.
    rows, columns = np.indices(SHAPE)
    light, tone = np.array([235.0, 225.0, 205.0]), np.array([170.0, 120.0, 70.0])
    strokes = (columns % 16 < 5)[..., None] & (rows > 30)[..., None]
    left = np.where(strokes | (rows <= 30)[..., None], light, tone) if pale else (
        np.broadcast_to(tone, (*SHAPE, 3)))
    theirs = np.where((columns < 80)[..., None], left, left[:, ::-1])
    shaded = np.exp(np.log(theirs + DARK) - 0.45) - DARK
    ours = np.where((columns < 80)[..., None], left, shaded)
    given = replace(sides(0.0, hair=np.zeros(SHAPE, np.float32)),
                    ours=np.asarray(ours, np.float32), theirs=np.asarray(theirs, np.float32),
                    features=np.ones(SHAPE, np.float32))
    found = np.log(relit(given) + DARK)
    there = strokes[:, ::-1, 0] & (columns > 100) & (columns < 130) & (rows > 60) & (rows < 110)
    warm = (found[..., 0] - found[..., 2])[there].mean()
    before = np.log(theirs + DARK)[there]
    before = (before[:, 0] - before[:, 2]).mean()
    if pale:
        assert before < 0.15 and warm > 0.3
    else:
        assert abs(warm - before) < 0.05


def test_shade_goes_on_to_the_end_of_the_face():
    given = sides(np.full(3, -0.5), seen=105, hair=np.zeros(SHAPE, np.float32))
    given = replace(given, scale=60.0)
    change = np.log(relit(given) + DARK) - np.log(given.theirs + DARK)
    assert (change[60, 110:145] < -0.35).all()
