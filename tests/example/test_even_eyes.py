"""An eye that cannot be made out is painted as the other one is; others stay."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.example.gaze import EYE_LANDMARKS, eye_contrast, with_even_eyes
from tests.portraits import drawn_face

SIDE = 480


@pytest.fixture
def painted():
    """A function that draws a face whose irises lie right of the middle, with shade over eyes."""
    drawn = drawn_face(SIDE, SIDE, seed=4)
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5

    def draw(*shade):
        image = drawn.image.astype(np.float64)
        for eye, left in zip(EYE_LANDMARKS, shade):
            outline = drawn.landmarks[eye]
            middle, half = outline.mean(axis=0), 0.5 * (outline[3, 0] - outline[0, 0])
            away = np.hypot((x - middle[0]) / half, (y - middle[1]) / (0.6 * half))
            image[away < 1] = 235
            image[(np.hypot(x - middle[0] - 0.3 * half, y - middle[1]) < 0.4 * half)] = 30, 40, 90
            socket = np.hypot(x - middle[0], y - middle[1]) < 3.2 * half
            image[socket] = 70 + left * (image[socket] - 70)
        return replace(drawn, image=np.asarray(image, np.uint8))

    return draw


def contrasts(exemplar):
    return [eye_contrast(exemplar.image, exemplar.landmarks[eye]) for eye in EYE_LANDMARKS]


def iris(exemplar, eye):
    """How far right of the middle the dark part of an eye lies, over half its width."""
    outline = exemplar.landmarks[eye]
    middle, half = outline.mean(axis=0), 0.5 * (outline[3, 0] - outline[0, 0])
    row = exemplar.image[int(middle[1]), int(outline[0, 0]) + 2:int(outline[3, 0]) - 1].mean(axis=1)
    dark = np.flatnonzero(row < row.min() + 0.35 * np.ptp(row))
    return (int(outline[0, 0]) + 2.5 + dark.mean() - middle[0]) / half


@pytest.mark.parametrize("weak", [0, 1])
def test_an_eye_in_the_shade_becomes_as_clear_as_the_other(painted, weak):
    exemplar = painted(*(0.2 if n == weak else 1.0 for n in (0, 1)))
    before = contrasts(exemplar)
    assert before[weak] < 0.3 * before[1 - weak]
    even = with_even_eyes(exemplar)
    after = contrasts(even)
    assert after[weak] > 0.7 * after[1 - weak]
    assert after[1 - weak] == before[1 - weak]
    # It looks the same way, not the other.
    assert iris(even, EYE_LANDMARKS[weak]) > 0.1
    # What is around is the painter's, in his light.
    away = np.abs(even.image.astype(int) - exemplar.image).max(axis=2)
    middle = exemplar.landmarks[EYE_LANDMARKS[weak]].mean(axis=0)
    width = np.ptp(exemplar.landmarks[EYE_LANDMARKS[weak], 0])
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    assert away[np.hypot(x - middle[0], y - middle[1]) > 1.3 * width].max() == 0
    np.testing.assert_array_equal(even.landmarks, exemplar.landmarks)


@pytest.mark.parametrize("shade", [(1.0, 1.0), (1.0, 0.75), (0.02, 0.01)])
def test_eyes_that_are_alike_stay(painted, shade):
    exemplar = painted(*shade)
    assert with_even_eyes(exemplar) is exemplar


def test_the_contrast_of_an_eye_is_that_of_white_and_iris(painted):
    exemplar = painted(1.0, 0.5)
    one, other = contrasts(exemplar)
    assert one == pytest.approx((235 - 43) / 255, abs=0.15)
    assert other == pytest.approx(0.5 * one, rel=0.1)
    outline = exemplar.landmarks[EYE_LANDMARKS[0]]
    closed = outline.mean(axis=0) + (outline - outline.mean(axis=0)) * [1, 0.01]
    assert eye_contrast(exemplar.image, closed) == 0
