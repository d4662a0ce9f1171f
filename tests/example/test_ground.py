"""The ground that goes on with a painting's background: what it is made of, and what never is."""

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from lfportrait.demo import demo_exemplar
from lfportrait.example import Exemplar, GroundSize, known_ground
from lfportrait.example.painter.ground import lit_side, painted_ground
from tests.portraits import drawn_face

SMALL = GroundSize(width=5.0, height=2.4, pixels=80.0)
GROUND = np.array([90, 130, 170])


def with_ground(picture):
    """A drawn face before another background, [h, w, 3]."""
    exemplar = drawn_face(320, 240)
    known = exemplar.mask[..., None]
    image = known * exemplar.image + (1 - known) * picture
    return dataclasses.replace(exemplar, image=image.astype(np.uint8))


def test_it_is_of_the_background_alone():
    exemplar = drawn_face(320, 240)
    picture, pixels = painted_ground(exemplar, SMALL)
    assert picture.shape == (round(2.4 * pixels / 2) * 2, round(5 * pixels / 2) * 2, 3)
    assert picture.dtype == np.uint8
    # Nothing of skin, hair or clothes: those are far from blue in one channel at least.
    assert np.abs(picture.astype(int) - GROUND).max() < 40
    assert np.abs(picture.reshape(-1, 3).mean(axis=0) - GROUND).max() < 4


def test_what_is_above_stays_above():
    rows = np.linspace(0, 1, 320)[:, None, None]
    sky = np.where(rows < 0.45, [150, 180, 220], [110, 140, 180]) * np.ones((320, 240, 1))
    picture, _ = painted_ground(with_ground(sky), SMALL)
    height = len(picture)
    luma = picture.mean(axis=-1)
    assert np.quantile(luma[:height // 3], 0.05) > 170
    assert np.quantile(luma[-height // 4:], 0.95) < 160


def test_left_and_right_keep_their_light_and_meet_softly():
    columns = np.linspace(60, 200, 240)[None, :, None] * np.ones((320, 1, 3))
    picture, _ = painted_ground(with_ground(columns), SMALL)
    luma = picture.mean(axis=(0, 2))
    assert luma[:20].mean() < 90 and luma[-20:].mean() > 160
    assert np.abs(np.diff(gaussian_filter(luma, 1))).max() < 8


def test_strokes_of_the_background_go_on():
    random = np.random.default_rng(3)
    strokes = gaussian_filter(random.standard_normal((320, 240)), 1.5)
    strokes = 128 + 40 * strokes[..., None] / strokes.std() * np.ones(3)
    picture, _ = painted_ground(with_ground(strokes), SMALL)
    fine = picture[..., 0] - gaussian_filter(picture[..., 0].astype(float), 6)
    # As rough as the painting, left, right and behind the head.
    for part in np.array_split(fine, 5, axis=1):
        assert part.std() > 12


@pytest.mark.parametrize("least", ["none", "a rim"])
def test_a_picture_with_hardly_any_background_gets_a_plain_one(least):
    exemplar = drawn_face(320, 240)
    mask = np.ones_like(exemplar.mask)
    if least == "a rim":
        mask[:2] = 0
    covered = dataclasses.replace(exemplar, mask=mask, hair=None)
    picture, _ = painted_ground(covered, SMALL)
    assert picture.std(axis=(0, 1)).max() < 12
    assert np.isfinite(picture).all()


# The other side is a mirror image.
@pytest.mark.parametrize("side", [-1, pytest.param(1, marks=pytest.mark.slow)])
def test_light_comes_from_the_lighter_side_of_the_face(side):
    exemplar = drawn_face(320, 240)
    shade = 1 - 0.5 * np.clip(np.linspace(-1, 1, 240) * -side * 2, 0, 1)
    image = (exemplar.image * shade[None, :, None]).astype(np.uint8)
    light = lit_side(dataclasses.replace(exemplar, image=image))
    assert np.linalg.norm(light) == pytest.approx(1)
    assert light[0] * side > 0.1 and light[1] > 0 and light[2] > 0
    assert abs(lit_side(exemplar)[0]) < 0.1


def test_the_demos_painting_has_one_and_it_is_kept():
    exemplar = demo_exemplar(width=192, height=256)
    assert isinstance(exemplar, Exemplar)
    picture, pixels, light = known_ground(exemplar, SMALL)
    again = known_ground(exemplar, SMALL)
    assert np.array_equal(picture, again[0]) and pixels == again[1]
    assert np.array_equal(light, again[2])
    other = known_ground(exemplar, SMALL, seed=1)[0]
    assert other.shape == picture.shape
