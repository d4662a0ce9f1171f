"""Maps of a person: what lies beyond a photo's upper edge, and what is no hair."""

import cv2
import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.face.one_photo.parts import (
    ON_TOP,
    Parts,
    clean_colors,
    clean_hair,
    ground_in_blur,
    parts_of,
)

SIDE, SKULL = 240, 0.6


def maps(down: float, thick: float, closed: bool = True) -> Parts:
    """A ball of a skull in hair, seen by a camera that looks so far below its middle."""
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=500.0,
                        target=(0, -down, 0), pitch=0.0)
    column, row = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5)
    middle = camera.project(np.zeros((1, 3)))[0][0, 0]
    away = np.hypot(column - middle[0], row - middle[1]) / (500.0 / 4.0)
    matte = (away < SKULL + thick).astype(np.float32)
    angle = np.linspace(0, 2 * np.pi, 200)
    skull = SKULL * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(200)])
    return parts_of(camera, matte, matte if thick else np.zeros_like(matte), 4.0,
                    skull if closed else None)


def within(parts: Parts, points: np.ndarray) -> np.ndarray:
    return Parts.at(parts.inside, parts.places(points)[0]) > 0


@pytest.mark.parametrize("thick", [0.0, ON_TOP])
def test_a_crown_that_the_photo_cuts_off_is_closed_round(thick):
    parts = maps(0.7, thick)  # the photo ends at 0.26
    angle = np.linspace(0.15, np.pi - 0.15, 40)
    around = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(40)])
    assert within(parts, (SKULL + thick - 0.05) * around).all()
    assert not within(parts, (SKULL + thick + 0.09) * around).any()
    places = parts.places(0.4 * around)[0]
    assert Parts.at(parts.hair.astype(np.float32), places).min() == float(thick > 0)
    # The photo's own cells are as before.
    cut = maps(0.7, thick, False)
    more = len(parts.inside) - len(cut.inside)
    assert more > 0 and parts.bottom == cut.bottom + more
    np.testing.assert_array_equal(parts.hair[more + 1:], cut.hair[1:])


def test_a_crown_that_has_almost_closed_becomes_no_cone():
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=500.0,
                        target=(0, 0, 0), pitch=0.0)
    column, row = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5)
    matte = (np.hypot(column - 120, row - 85) < 86).astype(np.float32)  # a pixel is cut off
    skull = np.column_stack([np.linspace(-0.3, 0.3, 9), np.full(9, 1.5), np.zeros(9)])
    skull = np.vstack([skull, skull * [1, -1, 1]])  # fitted too high by far
    parts = parts_of(camera, matte, matte, 4.0, skull)
    cut = parts_of(camera, matte, matte, 4.0)
    more = len(parts.inside) - len(cut.inside)
    assert 0 < int((parts.inside[:more] > 0).any(axis=1).sum()) < 12


def leaning(lean: float, steep: tuple[float, float], high: float = 0.5) -> tuple[Parts, int]:
    """A head whose outline comes in so fast to both sides, cut off beside its middle.

    And how many rows there are above the photo. ``high`` is the middle of its skull.
    """
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=500.0,
                        target=(0, 0, 0), pitch=0.0)
    column, row = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5)
    middle = 120 + lean
    matte = ((column > middle - 15 - row * steep[0]) & (column < middle + 15 + row * steep[1])
             ).astype(np.float32)
    angle = np.linspace(0, 2 * np.pi, 90)
    skull = np.column_stack([0.5 * np.cos(angle), high + 0.5 * np.sin(angle), np.zeros(90)])
    parts = parts_of(camera, matte, matte, 4.0, skull)
    return parts, len(parts.inside) - len(parts_of(camera, matte, matte, 4.0).inside)


def test_the_crown_of_a_head_that_leans_is_closed_too():
    parts, more = leaning(-40.0, (1.0, 1.0))
    assert (parts.inside[:more] > 0).any(axis=1).sum() > 3
    # It is highest nearer to the steeper side.
    places = []
    for steep in ((2.0, 0.5), (1.0, 1.0), (0.5, 2.0)):
        parts, more = leaning(-40.0, steep)
        above = parts.inside[:more] > 0
        columns = np.flatnonzero(above[np.argmax(above.any(axis=1))])
        places.append(columns.mean())
    assert places[0] > places[1] + 2 and places[2] < places[1] - 2


def test_big_hair_ends_round():
    parts, more = leaning(0.0, (0.0, 0.0), -0.2)
    wide = (parts.inside[more + 2] > 0).sum()
    tall = (parts.inside[:more] > 0).any(axis=1).sum()
    assert tall > 0.3 * wide, "most of a circle's height"


def test_a_hand_above_a_head_is_no_crown():
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=500.0,
                        target=(0, 0, 0), pitch=0.0)
    column, row = np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5)
    hand = np.abs(column - 150) < 12
    matte = ((np.hypot(column - 120, row - 140) < 60) | hand & (row < 140)).astype(np.float32)
    angle = np.linspace(0, 2 * np.pi, 90)
    skull = np.column_stack([0.48 * np.cos(angle), 0.48 * np.sin(angle) - 0.16, np.zeros(90)])
    bald = np.zeros_like(matte)
    cut = parts_of(camera, matte, bald, 4.0)
    assert len(parts_of(camera, matte, bald, 4.0, skull).inside) == len(cut.inside)


def test_a_crown_that_the_photo_shows_stays():
    one, two = maps(0.1, ON_TOP), maps(0.1, ON_TOP, False)
    np.testing.assert_array_equal(one.inside, two.inside)
    assert one.bottom == two.bottom


def face():
    """Landmarks as far as hair is cleaned by them."""
    landmarks = np.zeros((68, 2))
    landmarks[[0, 16, 33, 8]] = (70, 110), (170, 110), (120, 140), (120, 200)
    for corner, place in zip((31, 2, 41, 35, 14, 46), ((110, 140), (80, 150), (100, 120),
                                                      (130, 140), (160, 150), (140, 120)),
                             strict=True):
        landmarks[corner] = place
    return landmarks


@pytest.mark.parametrize(("color", "kept"), [((0.85, 0.75, 0.45), False), ((0.3, 0.2, 0.1), True)])
def test_an_earring_is_no_hair_and_a_lock_is(color, kept):
    landmarks = face()
    image = np.tile(np.uint8([210, 160, 135]), (SIDE, SIDE, 1))
    hair = np.zeros((SIDE, SIDE), np.float32)
    hair[30:160, 50:70] = hair[30:60, 50:190] = hair[30:230, 170:190] = 1.0
    hanging = np.zeros((SIDE, SIDE), bool)
    hanging[165:205, 52:68] = True
    image[hair > 0] = np.rint(255 * np.array([0.3, 0.2, 0.1]))
    hair[160:165, 58:62] = hair[hanging] = 1.0  # a link that is narrow
    image[hanging] = np.rint(255 * np.array(color))
    found = clean_hair(image, hair, np.ones_like(hair), landmarks) > 0.5
    assert found[170:200, 55:65].all() == kept and found[170:200, 55:65].any() == kept
    assert found[40:150, 55:65].all() and found[40:220, 175:185].all()


@pytest.mark.parametrize(("color", "hair_there"), [((70, 50, 30), True), ((210, 160, 135), False)])
def test_a_gap_in_hair_is_hair_by_its_color(color, hair_there):
    landmarks = face()
    image = np.tile(np.uint8([210, 160, 135]), (SIDE, SIDE, 1))
    image[20:80, 50:190] = (60, 40, 25)
    image[45:60, 100:120] = color
    hair = np.zeros((SIDE, SIDE), np.float32)
    hair[20:80, 50:190] = 1.0
    hair[45:60, 100:120] = 0.0
    found = clean_hair(image, hair, np.ones_like(hair), landmarks) > 0.5
    assert found[25:40, 55:185].all() and (found[46:59, 101:119] == hair_there).all()


def test_hair_that_a_side_cuts_off_is_closed_round_and_shoulders_go_on():
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=500.0,
                        target=(0, 0, 0), pitch=0.0)
    matte = np.zeros((SIDE, SIDE), np.float32)
    matte[40:120, 100:] = matte[160:, 100:] = 1
    parts = parts_of(camera, matte, np.zeros_like(matte), 4.0)
    factor = parts.inside.shape[0] / SIDE / 1.12
    long = (parts.inside > 0).sum(axis=1)
    hair, shoulder = (long[round(factor * row)] for row in (80, 200))
    assert abs(hair - shoulder) <= 2
    assert long[round(factor * 45)] < hair - 0.04 * SIDE * factor, "no box"
    assert abs(long[round(factor * 170)] - shoulder) <= 2


@pytest.mark.parametrize(("blur", "mixed"), [(0.5, False), (6.0, True)])
def test_ground_is_found_in_an_outline_out_of_focus(blur, mixed):
    shown = np.zeros((300, 300), np.float32)
    cv2.circle(shown, (150, 150), 100, 1.0, -1)
    shares = cv2.GaussianBlur(shown, (0, 0), blur)[..., None]
    image = np.uint8(shares * [190, 140, 120] + (1 - shares) * [240, 240, 250])
    found = ground_in_blur(image, shown, None, 300.0)
    row, column = np.mgrid[:300, :300]
    inner = 100 - np.hypot(row - 150, column - 150)
    if mixed:
        assert found[(inner > 2) & (inner < 1.5 * blur)].all()
        assert not found[inner > 3.5 * blur].any()
        hair = np.zeros_like(shown)
        hair[:150] = 1
        assert not ground_in_blur(image, shown, hair, 300.0)[:150].any()
        # The person's colors are its own up to the outline.
        clean = clean_colors(image, shown, found)[(inner > 0) & (inner < 20)]
        assert np.abs(clean * 255 - [190, 140, 120]).max() < 6
        assert np.abs(clean_colors(image, shown)[inner > 0] * 255 - [190, 140, 120]).max() > 10
    else:
        assert not found[inner > 3].any()
