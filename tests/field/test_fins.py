"""What is thin and stands out of a mouth goes, and nothing else."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from lfportrait.field import VoxelField
from lfportrait.field.closing.fins import CHIN, CORNERS, MOUTH, NOSE, mouth_of, without_fins
from tests.portraits import HEAD_LANDMARKS

SIZE = 160
VOXEL = 2 / SIZE
TALL = HEAD_LANDMARKS[NOSE, 1] - HEAD_LANDMARKS[CHIN, 1]
LIPS = HEAD_LANDMARKS[MOUTH].mean(axis=0)


@dataclass(frozen=True)
class Space:
    """A full lattice, and places in it.

    Attributes
    ----------
    face : In a wall at the lips.
    out : How many voxels before the lips.
    before : In front of the wall.
    """

    full: VoxelField
    y: np.ndarray
    face: np.ndarray
    out: np.ndarray
    before: np.ndarray

    def of(self, *solids):
        """A field that is solid in all of some parts."""
        return replace(self.full, density=np.where(
            np.any(solids, axis=0), 500, -50).astype(np.float32))

    def bar(self, height, tall):
        """A bar before the face."""
        return self.before & (np.abs(self.y - height) < tall / 2)


@pytest.fixture(scope="module")
def space():
    """Hundreds of megabytes: made where its tests run, not wherever they are collected."""
    full = VoxelField(np.arange(SIZE ** 3, dtype=np.int32).reshape(SIZE, SIZE, SIZE),
                      np.zeros(SIZE ** 3, np.float32), np.zeros((SIZE ** 3, 3, 1), np.float32))
    x, y, z = full.lattice_points().T
    out = (z - LIPS[2]) / VOXEL
    return Space(full, y, np.abs(z - LIPS[2] + 0.1) < 0.1, out,
                 (out > 0) & (out < 5) & (np.abs(x - LIPS[0]) < 0.1))


def test_a_sheet_that_stands_out_of_the_lips_goes(space):
    sheet = space.bar(LIPS[1], 0.06 * TALL)
    field = without_fins(space.of(space.face, sheet), HEAD_LANDMARKS)
    assert sheet.sum() > 10
    assert field.density[sheet & (space.out > 2)].max() < 0
    # The face itself and the lattice are as they were.
    assert np.array_equal(field.density[space.face], space.of(space.face).density[space.face])
    assert field.links is space.full.links


@pytest.mark.parametrize("height, tall", [
    (LIPS[1], 0.25 * TALL),  # lips
    (HEAD_LANDMARKS[NOSE, 1] + 0.3 * TALL, 0.06 * TALL),  # a rim of spectacles
    (HEAD_LANDMARKS[CHIN, 1] - 0.3 * TALL, 0.06 * TALL),  # a collar's edge
    (HEAD_LANDMARKS[NOSE, 1] + 0.24 * TALL, 0.6 * TALL),  # a nose that hangs below its landmark
    (HEAD_LANDMARKS[CHIN, 1] - 0.25 * TALL, 0.6 * TALL),  # a beard
])
def test_what_is_thick_or_elsewhere_stays(height, tall, space):
    field = space.of(space.face, space.bar(height, tall))
    assert np.array_equal(without_fins(field, HEAD_LANDMARKS).density, field.density)


def test_a_head_whose_mouth_is_not_known_stays(space):
    field = space.of(space.face, space.bar(LIPS[1], 0.06 * TALL))
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
