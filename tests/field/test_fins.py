"""What is thin and stands out of a mouth goes, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.field import VoxelField
from lfportrait.field.closing.fins import CHIN, CORNERS, MOUTH, NOSE, mouth_of, without_fins
from tests.portraits import HEAD_LANDMARKS

SIZE = 160
FULL = VoxelField(np.arange(SIZE ** 3, dtype=np.int32).reshape(SIZE, SIZE, SIZE),
                  np.zeros(SIZE ** 3, np.float32), np.zeros((SIZE ** 3, 3, 1), np.float32))
X, Y, Z = FULL.lattice_points().T
VOXEL = 2 / SIZE
TALL = HEAD_LANDMARKS[NOSE, 1] - HEAD_LANDMARKS[CHIN, 1]
LIPS = HEAD_LANDMARKS[MOUTH].mean(axis=0)
FACE = np.abs(Z - LIPS[2] + 0.1) < 0.1
OUT = (Z - LIPS[2]) / VOXEL
BEFORE = (OUT > 0) & (OUT < 5) & (np.abs(X - LIPS[0]) < 0.1)
"""In front of a wall at the lips."""


def of(*solids):
    """A field that is solid in all of some parts."""
    return replace(FULL, density=np.where(np.any(solids, axis=0), 500, -50).astype(np.float32))


def bar(height, tall):
    """A bar before the face."""
    return BEFORE & (np.abs(Y - height) < tall / 2)


def test_a_sheet_that_stands_out_of_the_lips_goes():
    sheet = bar(LIPS[1], 0.06 * TALL)
    field = without_fins(of(FACE, sheet), HEAD_LANDMARKS)
    assert sheet.sum() > 10
    assert field.density[sheet & (OUT > 2)].max() < 0
    # The face itself and the lattice are as they were.
    assert np.array_equal(field.density[FACE], of(FACE).density[FACE])
    assert field.links is FULL.links


@pytest.mark.parametrize("height, tall", [
    (LIPS[1], 0.25 * TALL),  # lips
    (HEAD_LANDMARKS[NOSE, 1] + 0.3 * TALL, 0.06 * TALL),  # a rim of spectacles
    (HEAD_LANDMARKS[CHIN, 1] - 0.3 * TALL, 0.06 * TALL),  # a collar's edge
    (HEAD_LANDMARKS[NOSE, 1] + 0.24 * TALL, 0.6 * TALL),  # a nose that hangs below its landmark
    (HEAD_LANDMARKS[CHIN, 1] - 0.25 * TALL, 0.6 * TALL),  # a beard
])
def test_what_is_thick_or_elsewhere_stays(height, tall):
    field = of(FACE, bar(height, tall))
    assert np.array_equal(without_fins(field, HEAD_LANDMARKS).density, field.density)


def test_a_head_whose_mouth_is_not_known_stays():
    field = of(FACE, bar(LIPS[1], 0.06 * TALL))
    for missing in ([NOSE], CORNERS):
        landmarks = HEAD_LANDMARKS.copy()
        landmarks[missing] = np.nan
        assert without_fins(field, landmarks) is field


def test_places_of_a_mouth_are_between_its_corners():
    landmarks = np.full((68, 3), np.nan)
    assert not len(mouth_of(landmarks))
    landmarks[[48, 54, 57]] = (-0.2, -0.3, 0.5), (0.2, -0.3, 0.5), (0, -0.4, 0.6)
    places = mouth_of(landmarks)
    assert np.allclose(places.min(axis=0)[:2], (-0.2, -0.4))
    assert np.allclose(places.max(axis=0)[:2], (0.2, -0.3))
    assert np.allclose(places[:, 2], 1.6 / 3)
