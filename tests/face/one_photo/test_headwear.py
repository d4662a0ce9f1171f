"""What covers a head beyond the fitted skull is found, and the rest stays as it is."""

import cv2
import numpy as np
import pytest

from lfportrait.face import GENERIC_LANDMARKS
from lfportrait.face.head_fit import HeadFit, View, ear_to_ear
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo import portrait
from lfportrait.face.one_photo.headwear import headwear, skull_in

SIZE = (360, 320)
WALL, SKIN, HAT, SUIT = (200, 205, 210), (205, 160, 135), (60, 90, 60), (40, 45, 60)


def landmarks():
    flat = GENERIC_LANDMARKS[:, :2] * [1.0, -1.0]
    flat = flat / ear_to_ear(flat) * 110
    return flat - flat[36:48].mean(axis=0) + [160, 170]


FACE = landmarks()
ROWS, COLUMNS = np.mgrid[:SIZE[0], :SIZE[1]]


def disc(x, y, wide, high):
    return ((COLUMNS - x) / wide) ** 2 + ((ROWS - y) / high) ** 2 < 1


HEAD = disc(160, 165, 56, 78)
SKULL = (np.argwhere(HEAD & (ROWS < 185))[:, ::-1].astype(float), np.array([160.0, 185.0]))
BODY = disc(160, 360, 130, 110) | disc(160, 250, 28, 50)
BONNET = disc(160, 140, 84, 84) & ((ROWS < 130) | ~HEAD) & (ROWS < 190)


def found(layers, hair=None, person=None):
    """What is found of a picture of layers (mask, color), the lowest first."""
    image, matte = np.full((*SIZE, 3), WALL, np.float64), np.zeros(SIZE, bool)
    for mask, color in layers:
        image[mask], matte = color, matte | mask
    image += np.random.default_rng(1).normal(0, 4, image.shape)
    matte = matte if person is None else person
    hair = np.zeros(SIZE, np.float32) if hair is None else hair.astype(np.float32)
    return headwear(np.clip(image, 0, 255).astype(np.uint8), matte.astype(np.float32), hair, FACE,
                    SKULL)


def overlap(one, two):
    return (one & two).sum() / (one | two).sum()


SITTER = [(BODY, SUIT), (HEAD, SKIN)]


def test_a_bare_head_has_none():
    assert found(SITTER) is None


def test_a_hat_is_found_down_to_the_forehead_and_beside_the_face():
    worn = found([*SITTER, (BONNET, HAT)])
    assert overlap(worn, BONNET) > 0.9
    assert not worn[disc(160, 190, 40, 50)].any(), "the face stays skin"
    assert not worn[ROWS > 300].any(), "and the suit a suit"


CAP = HEAD & (ROWS < 132)


def test_a_cap_that_the_skull_was_fitted_to_is_found():
    worn = found([*SITTER, (CAP, HAT)])
    assert overlap(worn, CAP) > 0.9
    assert found([*SITTER, (CAP, (225, 185, 165))]) is None, "a bald head shines"
    assert found([*SITTER, (CAP & (COLUMNS < 130), HAT)]) is None, "one side lies in shade"


TURBAN = disc(160, 140, 80, 90) & ~disc(160, 180, 44, 60) & (ROWS < 215)


def test_a_turban_is_found_down_to_the_jaw_in_all_its_folds():
    folds = TURBAN & (np.sin(COLUMNS / 6) > 0.3)
    layers = [*SITTER, (TURBAN, (170, 30, 40)), (folds, (110, 15, 25))]
    worn = found(layers)
    assert overlap(worn, TURBAN) > 0.9
    # The network is not sure of hair there: it takes nothing from the turban.
    specks = disc(205, 110, 16, 20) & TURBAN
    image, matte = np.full((*SIZE, 3), WALL, np.uint8), BODY | HEAD | TURBAN
    for mask, color in layers:
        image[mask] = color
    worn = headwear(image, matte.astype(np.float32), 0.6 * specks.astype(np.float32), FACE, SKULL)
    assert overlap(worn | specks, TURBAN) > 0.9


def test_no_part_beyond_the_skull_is_lost_between_hat_and_outline():
    jewel = disc(160, 70, 9, 9)
    worn = found([*SITTER, (BONNET, HAT), (jewel, SKIN)])
    assert worn[jewel].mean() > 0.9


def test_it_is_the_same_in_a_picture_three_times_as_large():
    image = np.full((*SIZE, 3), WALL, np.uint8)
    for mask, color in [*SITTER, (BONNET, HAT)]:
        image[mask] = color
    matte = (BODY | HEAD | BONNET).astype(np.float32)
    large = cv2.resize(image, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    matte = cv2.resize(matte, None, fx=3, fy=3)
    worn = headwear(large, matte, np.zeros_like(matte), 3 * FACE, (3 * SKULL[0], 3 * SKULL[1]))
    bonnet = cv2.resize(BONNET.astype(np.uint8), None, fx=3, fy=3) > 0
    assert overlap(worn, bonnet) > 0.9


def test_a_photo_that_came_cut_out_has_no_ground():
    image, halo = np.full((*SIZE, 3), 153, np.uint8), BONNET & ~HEAD
    for mask, color in [(BODY, SUIT), (HEAD, SKIN), (halo, (150, 154, 152))]:
        image[mask] = color
    matte, none = (BODY | HEAD | halo).astype(np.float32), np.zeros(SIZE, np.float32)
    assert headwear(image, matte, none, FACE, SKULL) is None
    assert overlap(headwear(image, matte, none, FACE, SKULL, True), halo) > 0.9


def test_hair_that_was_seen_goes_no_further_over_the_forehead():
    hair = BONNET & (ROWS > 105)
    curls = [*SITTER, (BONNET, HAT), (HEAD & (ROWS > 105) & (ROWS < 140), SKIN)]
    worn = found(curls, hair=hair)
    assert worn[BONNET & (ROWS < 90)].mean() > 0.9, "what stands above it is found"
    brow = HEAD & (ROWS > 132) & (ROWS < 140)
    assert not (worn & ~hair)[brow].any()


@pytest.mark.parametrize("dirt", [
    pytest.param(BONNET, id="a wall that a matte kept"),
    pytest.param(disc(80, 150, 40, 30) & ~HEAD, id="beside the head"),
    pytest.param(disc(160, 80, 10, 12) & ~HEAD, id="a small tuft")])
def test_what_is_no_headwear_is_left(dirt):
    color = WALL if dirt is BONNET else HAT
    layers = SITTER if dirt is BONNET else [*SITTER, (dirt, color)]
    assert found(layers, person=dirt | HEAD | BODY) is None


def test_the_skull_is_the_model_above_its_ears():
    prior = generic_prior()
    view = View(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.8]), 800.0,
                np.array([200.0, 200.0]), np.zeros(len(prior.expression)))
    fit = HeadFit(prior, np.zeros(len(prior.identity)), [view], [0.0], 0.0)
    skull, middle = skull_in(fit, 0)
    assert skull[:, 1].max() < middle[1] + 8
    places = view.project(prior.mean.astype(np.float64))
    assert skull[:, 1].min() == places[:, 1].min()
    assert abs(middle[0] - places[:, 0].mean()) < 8


def test_a_hat_counts_as_hair_and_the_beard_below_it_does_not():
    image, matte = np.full((60, 40, 3), 90, np.uint8), np.ones((60, 40), np.float32)
    face = GENERIC_LANDMARKS[:, :2] * [1.0, -1.0]
    face = face / np.linalg.norm(face[16] - face[0]) * 24
    face += [20, 26] - face[27]
    hat, none = np.zeros((60, 40), bool), np.zeros((60, 40), np.float32)
    hat[:40] = True
    whole = none.copy()
    whole[34:50] = 1
    beard = portrait.Beard(whole > 2, whole)
    picture = portrait._pictured(image, matte, none, face, None, beard, hat)
    assert (picture.hair[:34] == 1).all() and (picture.hair[34:] == 0).all()
    assert picture.clothes[34:50].all(), "a beard hides the head's outline"


def test_hair_is_looked_for_from_near(monkeypatch):
    seen = []

    def mask(image):
        seen.append(image.shape)
        return np.full(image.shape[:2], 0.0 if image.shape[1] == 600 else 1.0, np.float32)

    monkeypatch.setattr(portrait, "hair_mask", mask)
    face = GENERIC_LANDMARKS[:, :2] * [1.0, -1.0]
    face = face / np.linalg.norm(face[16] - face[0]) * 60
    face += [40, 300] - face[27]
    hair = portrait._hair_seen(np.zeros((500, 600, 3), np.uint8), face)
    assert len(seen) == 2 and hair.shape == (500, 600)
    assert hair[300, 40] == 1 and hair[300, 0] == 1, "at the picture's own edge it is known"
    assert hair[300, 400] == 0 and hair[100, 40] == 0
    assert 0 < hair[300, 155] < 1, "and fades out between"
    # A picture of little but a head is looked at once.
    portrait._hair_seen(np.zeros((200, 200, 3), np.uint8), face + np.array([60, -200]))
    assert len(seen) == 3
