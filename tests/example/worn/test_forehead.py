"""Foreheads under linen and hats are bared; bare ones stay as they are."""

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest
from skimage.color import rgb2lab

from lfportrait.demo import demo_exemplar
from lfportrait.example import Exemplar, bared
from lfportrait.example.guides.filters import grey
from lfportrait.example.guides.regions import FaceFrame
from lfportrait.example.painter.picture_materials import FEATURES, GROUND, HAIR, SKIN, known_shares

LINEN = np.array([238, 236, 226], np.uint8)
HAT = np.array([25, 35, 110], np.uint8)


@lru_cache(maxsize=3)
def painted(name):
    return demo_exemplar(name, 480, 640)


def places(exemplar):
    """Right and down of all pixels in the face's frame, in half widths and heights."""
    frame = FaceFrame.of(exemplar.landmarks)
    right, down = frame.local(exemplar.image.shape)
    return right / (0.5 * frame.width / frame.height), down


def forehead(exemplar):
    """The middle of the forehead."""
    right, down = places(exemplar)
    return (np.abs(right) < 0.5) & (down < -0.12) & (down > -0.35)


def changed(exemplar, where, color):
    image = exemplar.image.copy()
    soft = cv2.GaussianBlur(where.astype(np.float32), (0, 0), 1.0)[..., None]
    return replace(exemplar, image=(image + soft * (color - image.astype(float))).astype(np.uint8))


def under_linen(exemplar):
    """With a band of linen from above the brows to the crown."""
    right, down = places(exemplar)
    return changed(exemplar, (np.abs(right) < 1.05) & (down < -0.07) & (down > -0.75), LINEN)


def away(exemplar, other, where):
    """How far the mean colors of two paintings are from each other, grey levels."""
    return np.abs(exemplar.image[where].mean(axis=0, dtype=float)
                  - other.image[where].mean(axis=0, dtype=float)).max()


def hue(exemplar, where):
    """How far the mean hue is from that of the cheeks, in a and b of Lab."""
    right, down = places(exemplar)
    cheeks = (np.abs(right) > 0.25) & (np.abs(right) < 0.6) & (down > 0.3) & (down < 0.55)
    colors = [rgb2lab(exemplar.image[part][None]).mean(axis=1)[0, 1:] for part in (cheeks, where)]
    return float(np.linalg.norm(colors[0] - colors[1]))


# One painting with a bare forehead goes the way of all.
@pytest.mark.parametrize("name", [
    "fauve", pytest.param("charcoal", marks=pytest.mark.slow),
    pytest.param("impression", marks=pytest.mark.slow)])
def test_a_bare_forehead_is_left_alone(name):
    assert bared(painted(name)) is painted(name)


def test_linen_gives_way_to_skin_in_the_colors_of_the_face():
    exemplar = painted("impression")
    covered = under_linen(exemplar)
    found = bared(covered)
    where = forehead(exemplar)
    assert away(covered, exemplar, where) > 20
    # Nobody knows how light it was under the linen: it is of the face's hue, lit as the face is.
    assert hue(found, where) < 0.35 * hue(covered, where)
    _, down = places(exemplar)
    face = exemplar.regions().person * (down > 0.1) * (down < 0.55) > 0.9
    low, high = np.quantile(grey(exemplar.image)[face], (0.4, 0.99))
    assert low < grey(found.image)[where].mean() < high
    # Strokes, not a flat fill.
    assert found.image[where].std(axis=0).mean() > 0.25 * exemplar.image[where].std(axis=0).mean()


def test_the_rest_of_the_face_keeps_its_bytes():
    covered = under_linen(painted("impression"))
    found = bared(covered)
    _, down = places(covered)
    assert (found.image[down > 0.1] == covered.image[down > 0.1]).all()


def test_what_was_linen_is_skin_to_the_painter_and_hair_above():
    covered = under_linen(painted("impression"))
    found = bared(covered)
    shares = known_shares(found, found.regions(), found.regions().labels())
    right, down = places(covered)
    assert shares[forehead(covered)][:, SKIN].mean() > 0.9
    crown = (np.abs(right) < 0.3) & (down < -0.7) & (down > -0.74)
    assert shares[crown][:, HAIR].mean() > 0.8


@pytest.mark.slow  # linen gives way, too
def test_a_hat_and_its_shade_give_way_too():
    exemplar = painted("impression")
    right, down = places(exemplar)
    covered = changed(exemplar, (np.abs(right) < 1.6) & (down < -0.3) & (down > -0.9), HAT)
    shade = (np.abs(right) < 1) & (down < -0.06) & (down >= -0.3)
    covered.image[shade] = (covered.image[shade] * 0.35).astype(np.uint8)
    found = bared(covered)
    assert away(found, exemplar, forehead(exemplar)) < 0.4 * away(covered, exemplar,
                                                                  forehead(exemplar))


@pytest.mark.slow  # linen gives way, too
def test_a_fringe_is_taken_off_only_if_that_is_asked_for():
    exemplar = painted("impression")
    right, down = places(exemplar)
    hair = exemplar.regions().hair
    assert hair is not None
    color = exemplar.image[hair > 0.9].mean(axis=0)
    # One side of the forehead, down to the brow.
    fringe = (right > -0.1) & (right < 1) & (down < -0.05) & (down > -0.6)
    mask = np.ones(exemplar.image.shape[:2], np.float32) * exemplar.regions().person
    covered = changed(replace(exemplar, mask=mask, hair=np.maximum(hair, fringe * mask)), fringe,
                      color)
    assert bared(covered) is covered
    found = bared(covered, fringe=True)
    assert away(found, exemplar, fringe & forehead(exemplar)) < 0.4 * away(covered, exemplar, fringe
                                                                           & forehead(exemplar))


@pytest.mark.slow  # linen gives way, too
def test_a_hat_beyond_the_head_is_no_background():
    exemplar = painted("impression")
    right, down = places(exemplar)
    hat = (np.abs(right) < 1.4) & (down < -0.2) & (down > -0.95)
    hat &= (exemplar.regions().person < 0.1) | (down < -0.5)
    covered = changed(exemplar, hat, HAT)
    # A network that knows no hats.
    covered = Exemplar(covered.image, covered.landmarks, "hat", exemplar.regions().person * ~hat)
    shares = known_shares(covered, covered.regions(), covered.regions().labels())
    beyond = hat & (exemplar.regions().person < 0.1)
    assert beyond.sum() > 500
    assert shares[beyond][:, GROUND].mean() < 0.15
    assert shares[beyond][:, FEATURES].mean() > 0.6


def test_a_ribbon_on_a_cap_is_no_hair():
    exemplar = painted("impression")
    hair = exemplar.regions().hair
    assert hair is not None
    _, down = places(exemplar)
    cap = hair > 0.5
    ribbon = cap & (down < -0.72)
    image = exemplar.image.copy()
    image[cap], image[ribbon] = (235, 232, 222), (30, 90, 190)
    covered = replace(exemplar, image=image, mask=exemplar.regions().person, hair=hair)
    shares = known_shares(covered, covered.regions(), covered.regions().labels())
    inner = cv2.erode(ribbon.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert inner.sum() > 200
    assert shares[inner][:, HAIR].mean() < 0.2
    assert shares[cap & (down > -0.6) & (down < -0.5)][:, HAIR].mean() > 0.5
