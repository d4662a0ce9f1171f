"""Irises are found as dark discs between the lids, and nothing else is taken for one."""

import cv2
import numpy as np
import pytest

from lfportrait.example.gaze import irises_found

SIDE = 400
WIDTH = 90.0


def face(right, tilt=0.0, radius=0.2, iris=(60, 45, 40), white=(225, 220, 215), seed=0,
         open_by=0.22):
    """A picture of two almond eyes with lashes and glints, its landmarks, and where irises are.

    ``right``: for each eye, how far its iris is from the middle, over the width.
    """
    random = np.random.default_rng(seed)
    angle = np.radians(tilt)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    image = np.full((SIDE, SIDE, 3), (205, 160, 135), np.float64)
    landmarks = random.uniform(0, SIDE, (68, 2))
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5
    irises = []
    for number, share in enumerate(right):
        middle = np.array([SIDE / 2, 170.0]) + np.array([(-90, 90)[number], 0.0]) @ turn
        x, y = np.moveaxis((np.stack([columns, rows], axis=-1) - middle) @ turn.T / WIDTH, -1, 0)
        # Lids are parabolas between the corners.
        lid = open_by * (1 - (2 * x) ** 2)
        between = (np.abs(y) < lid) & (np.abs(x) < 0.5)
        image[(np.abs(y + lid) < 0.03) & (np.abs(x) < 0.5)] = (50, 35, 30)
        image[between] = white
        image[between & (np.hypot(x - share, y) < radius)] = iris
        image[between & (np.hypot(x - share + 0.06, y + 0.06) < 0.04)] = 255
        outline = np.array([[-0.5, 0], [-0.2, -0.84 * open_by], [0.2, -0.84 * open_by], [0.5, 0],
                            [0.2, 0.84 * open_by], [-0.2, 0.84 * open_by]])
        landmarks[36 + 6 * number:42 + 6 * number] = middle + WIDTH * outline @ turn
        irises.append(middle + WIDTH * np.array([share, 0.0]) @ turn)
    image = cv2.GaussianBlur(image, (0, 0), 1.0) + random.normal(0, 6, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8), landmarks, np.array(irises)


# Each tilt and each size once.
@pytest.mark.parametrize("right", [(0.0, 0.0), (-0.15, 0.2), (0.2, 0.05), (-0.22, -0.1)])
@pytest.mark.parametrize(("tilt", "radius"), [
    (-18.0, 0.17), (0.0, 0.23), *(pytest.param(*one, marks=pytest.mark.slow) for one in (
        (0.0, 0.17), (-18.0, 0.23)))])
def test_irises_are_found_wherever_they_look(right, tilt, radius):
    image, landmarks, irises = face(right, tilt, radius)
    found = irises_found(image, landmarks)
    assert found is not None
    # 0.03 of an eye's width are 2.7 degrees.
    assert np.linalg.norm(found - irises, axis=1).max() < 0.03 * WIDTH


def test_irises_stay_in_place_at_other_scales():
    image, landmarks, _ = face((-0.1, 0.1), seed=3)
    small = cv2.resize(image, None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA)
    found, less = irises_found(image, landmarks), irises_found(small, 0.4 * landmarks)
    assert found is not None and less is not None
    assert np.abs(less / 0.4 - found).max() < 0.03 * WIDTH


def test_no_iris_is_found_where_none_is():
    plain, landmarks, _ = face((0.0, 0.0), iris=(225, 220, 215))
    assert irises_found(plain, landmarks) is None
    closed, landmarks, _ = face((0.0, 0.0), open_by=0.03)
    assert irises_found(closed, landmarks) is None
    image, landmarks, _ = face((0.0, 0.0))
    assert irises_found(image, landmarks + 5 * SIDE) is None
    assert irises_found(image[:40, :40], landmarks * 0.05) is None
