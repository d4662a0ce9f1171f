"""What is thin and stands out of a mouth or a head goes, and nothing else."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from lfportrait.field import VoxelField
from lfportrait.field.closing.fins import (
    CHIN,
    CORNERS,
    MOUTH,
    NOSE,
    mouth_of,
    without_beaks,
    without_fins,
)
from lfportrait.field.geometry.head_surface import HeadSurface, bust_chart, bust_distance
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


FOREHEAD = 0.05
WIDE, HIGH = 112, 26
"""Voxels of a slab of a head: sheets are found there as well as in a lattice of `SIZE`."""


class Bust:
    """A bust that photos see from the front, and a lattice about its eyes.

    Attributes
    ----------
    above : Voxels before the bust.
    head : Within it.
    """

    def __init__(self) -> None:
        chart = bust_chart(0.016)
        front = np.abs(chart.angle) < np.radians(80)
        bust = bust_distance(chart)
        level = (chart.axis[:, 1] > -0.15) & (np.arange(len(chart.axis)) < chart.level)
        self.seen = HeadSurface(chart, bust, np.ones_like(bust),
                                np.where(level[:, None] & front, 1.0, 0.0), 28.0,
                                np.zeros_like(bust))
        count = HIGH * WIDE ** 2
        self.slab = VoxelField(np.arange(count, dtype=np.int32).reshape(WIDE, HIGH, WIDE),
                               np.zeros(count, np.float32), np.zeros((count, 3, 1), np.float32),
                               radius=np.array([1.0, HIGH / WIDE, 1.0]))
        slab = self.slab
        self.points = slab.lattice_points().T
        self.above = chart.outside(bust, bust, slab.links.shape, slab.center,
                                   slab.radius)[0].ravel() * WIDE / 2
        self.head = self.above < 0

    def of(self, *solids):
        """A field that is solid in all of some parts."""
        return replace(self.slab, density=np.where(
            np.any(solids, axis=0), 500, -50).astype(np.float32))

    def level(self, tall, low=0.0, high=5.0, side=1.0):
        """A bar that stands out of the bust in front, or behind (``side`` -1)."""
        x, y, z = self.points
        return ((high > self.above) & (low <= self.above) & (np.abs(y - FOREHEAD) < tall / 2)
                & (np.abs(x) < 0.15) & (side * z > 0))


@pytest.fixture(scope="module")
def bust():
    """Takes a second: made where its tests run, not wherever they are collected."""
    return Bust()


def test_a_level_sheet_that_stands_out_of_a_head_goes(bust):
    sheet, out = bust.level(0.03), bust.above > 3
    field, places, normals = without_beaks(bust.of(bust.head, sheet), bust.seen)
    assert (sheet & out).sum() > 10
    assert field.density[sheet & out].max() < 0
    # The head is as it was, and photos are asked for it where it lies bare now.
    assert np.array_equal(field.density[bust.head], bust.of(bust.head).density[bust.head])
    assert len(places) > 10
    assert np.abs(places[:, 1] - FOREHEAD).max() < 0.1
    assert normals[:, 2].min() > 0.5


@pytest.mark.parametrize("stays", [
    {"tall": 0.2},  # a nose
    {"tall": 0.03, "low": 3.0, "high": 5.0},  # a rim of spectacles
    {"tall": 0.03, "side": -1.0},  # what no photo sees
], ids=["tall", "apart", "behind"])
def test_what_is_tall_or_apart_or_unseen_stays(bust, stays):
    stays = bust.level(**stays)
    assert stays.sum() > 10
    field = without_beaks(bust.of(bust.head, stays), bust.seen)[0]
    # An edge is rounded.
    assert (field.density[stays] > 0).mean() > 0.9


def test_nothing_is_asked_of_a_field_without_a_surface(bust):
    empty = bust.of(np.zeros(len(bust.above), bool))
    field, places, normals = without_beaks(empty, bust.seen)
    assert field is empty
    assert places.shape == normals.shape == (0, 3)
