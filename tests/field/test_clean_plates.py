"""What is behind a person is composed from other photos, and the person stands out against it."""

import functools
from dataclasses import replace

import cv2
import numpy as np
import pytest

from lfportrait.capture import Camera, Capture
from lfportrait.field.geometry.clean_plates import CleanPlates, _one_piece, plate_mattes
from lfportrait.field.kernels.depth_maps import compose_plate
from tests.reference import plates as reference

WALL, RADIUS, VIEWS = -3.0, 0.6, 11


def texture(points, seed, pitch):
    """Colors of points in space, [N, 3] in [0.1, 0.9]: many waves, so that matches are unique."""
    random = np.random.default_rng(seed)
    waves = random.standard_normal((20, 3)) * pitch
    phase = random.uniform(0, 2 * np.pi, (20, 3))
    total = np.sin((points @ waves.T)[..., None] + phase).sum(axis=1)
    return np.clip(0.5 + 0.13 * total, 0.1, 0.9)


def photo(cameras, view, plain=False):
    """A skin-colored ball before a wall; the picture and the ball's mask."""
    origins, directions = cameras.rays(view)
    middle = np.einsum("ij,ij->i", origins, directions)
    inner = middle**2 - (origins**2).sum(axis=1) + RADIUS**2
    ball = inner > 0
    away = (WALL - origins[:, 2]) / directions[:, 2]
    wall = origins + away[:, None] * directions
    image = np.full((len(ball), 3), [0.75, 0.76, 0.72]) if plain else texture(wall, 1, 3.0)
    near = (origins - (middle + np.sqrt(np.maximum(inner, 0)))[:, None] * directions)[ball]
    image[ball] = np.array([0.8, 0.55, 0.4]) * (0.7 + 0.5 * texture(near, 2, 12.0)[:, :1])
    shape = int(cameras.height[view]), int(cameras.width[view])
    noise = np.random.default_rng(view).normal(0, 0.008, (len(ball), 3))
    levels = np.uint8(np.clip(image + noise, 0, 1) * 255 + 0.5)
    return levels.reshape(*shape, 3), ball.reshape(shape)


@functools.cache
def photographed(plain, degrees):
    """Cameras on an arc about the ball, and what each sees. Not to be changed."""
    cameras = Camera.arc(np.linspace(-degrees, degrees, VIEWS), distance=2.5, width=144,
                         height=192, focal=170)
    return cameras, [photo(cameras, view, plain) for view in range(VIEWS)]


def filmed(plain=False, degrees=14.0, gains=None):
    """An arc about the ball and the true masks."""
    cameras, shots = photographed(plain, degrees)
    images = [np.uint8(np.clip(image * (1.0 if gains is None else gains[view]), 0, 255))
              for view, (image, _) in enumerate(shots)]
    capture = Capture(cameras, images, None, [f"{view}.png" for view in range(VIEWS)],
                      np.zeros(VIEWS, bool))
    return capture, [mask for _, mask in shots]


def said(masks):
    """A network's mattes: the wall beside the ball is the person, and a piece of the ball is not.

    In all photos at the same place of the ball.
    """
    result = []
    for mask in masks:
        rows, columns = np.nonzero(mask)
        top, left, right = rows.min(), columns.min(), columns.max()
        matte = mask.astype(np.float32)
        matte[top + 30:top + 50, left - 8:left + 12] = 1
        matte[top + 20:top + 45, right - 10:right + 1] = 0
        result.append(matte)
    return result


def wrong(mattes, masks):
    return float(np.mean([np.abs(matte - mask).mean() for matte, mask in zip(mattes, masks)]))


@pytest.fixture(scope="module")
def scene():
    return filmed()


def test_a_plate_shows_the_wall_behind_the_person(scene):
    capture, masks = scene
    plates = CleanPlates.of(capture, said(masks))
    _, _, plate = plates.plate(5)
    # The wall as a photo without the person has it.
    origins, directions = capture.cameras.rays(5)
    away = (WALL - origins[:, 2]) / directions[:, 2]
    wall = texture(origins + away[:, None] * directions, 1, 3.0).reshape(192, 144, 3)
    hidden = masks[5] & plate.known
    assert hidden.sum() > 0.5 * masks[5].sum()
    error = np.abs(plate.color - wall).mean(axis=-1)
    assert np.median(error[hidden]) < 0.025
    assert np.median(np.abs(capture.images[5] / 255 - wall).mean(axis=-1)[hidden]) > 0.1


@pytest.mark.slow  # makes plates once more
@pytest.mark.parametrize("plain", [False, True])
def test_mattes_wrong_in_all_photos_are_corrected(plain):
    # Each photo is exposed by itself.
    capture, masks = filmed(plain, gains=1 + 0.06 * np.sin(np.arange(VIEWS)))
    given = said(masks)
    result = plate_mattes(capture, given)
    assert all(matte.dtype == np.float32 and matte.shape == (192, 144) for matte in result)
    assert min(matte.min() for matte in result) >= 0 and max(m.max() for m in result) <= 1
    # Of a plain wall a color alone does not outweigh the network where that is sure.
    assert wrong(result, masks) < (0.5 if plain else 0.25) * wrong(given, masks)


@pytest.mark.slow  # makes plates once more
def test_linen_of_the_walls_color_stays():
    capture, masks = filmed(plain=True)
    mattes = [mask.astype(np.float32) for mask in masks]
    images = []
    for image, mask in zip(capture.images, masks):
        rows, columns = np.nonzero(mask)
        y, x = int(rows.mean()), int(columns.mean())
        image = image.copy()
        image[y - 16:y + 16, x - 14:x + 14] = image[2:34, 2:30]
        images.append(image)
    result = plate_mattes(replace(capture, images=images), mattes)
    assert wrong(result, masks) < 0.01
    assert min(matte[mask].min() for matte, mask in zip(
        result, [cv2.erode(mask.astype(np.uint8), np.ones((9, 9))) > 0 for mask in masks])) > 0.5


@pytest.mark.slow  # makes all plates once more
def test_a_photo_tells_nothing_of_its_own_plate(scene):
    capture, masks = scene
    given = said(masks)
    held_out = np.arange(VIEWS) == 5
    images = [image[::-1].copy() if out else image
              for image, out in zip(capture.images, held_out)]
    before, after = (CleanPlates.of(replace(capture, images=shots, held_out=held_out), given)
                     for shots in (capture.images, images))
    for view in (4, 6):
        assert np.array_equal(before.plate(view)[2].color, after.plate(view)[2].color)


@pytest.mark.slow  # makes plates once more
def test_there_are_no_plates_where_nothing_tells_the_room_apart(scene):
    capture, masks = scene
    mattes = [mask.astype(np.float32) for mask in masks]
    few = np.arange(VIEWS) >= 5
    assert plate_mattes(replace(capture, held_out=few), mattes) is None
    grey = replace(capture, images=[np.full_like(image, 90) for image in capture.images])
    assert plate_mattes(grey, mattes) is None
    # All around the person there is no one wall behind.
    around = Camera.arc(np.linspace(-90, 90, VIEWS), distance=2.5, width=144, height=192, focal=170)
    assert plate_mattes(replace(capture, cameras=around), mattes) is None


def test_pieces_go_and_pinholes_are_filled():
    matte = np.zeros((60, 80), np.float32)
    matte[10:50, 20:60] = 0.9
    matte[30:33, 30:33] = 0.1
    matte[15:30, 40:50] = 0.2
    matte[5:8, 70:74] = 1.0
    result = _one_piece(matte)
    assert result[31, 31] == 1 and result[6, 72] == 0
    assert np.array_equal(result[15:30, 40:50], matte[15:30, 40:50])
    empty = np.zeros((20, 20), np.float32)
    assert np.array_equal(_one_piece(empty), empty)


def test_composed_plates_equal_the_plain_ones():
    random = np.random.default_rng(3)
    cameras = Camera.arc(np.linspace(-20, 20, 6), distance=3.0, width=30, height=24, focal=30.0)
    rows = np.array([cameras.row(view) for view in range(6)])
    inverse = random.uniform(0.2, 0.3, (24, 30)).astype(np.float32)
    pictures = random.integers(0, 256, (5, 24, 30, 4)).astype(np.uint8)
    pictures[..., 3][random.random((5, 24, 30)) < 0.4] = 0
    gains = random.uniform(0.8, 1.2, (5, 3)).astype(np.float32)
    wanted = (random.random((24, 30)) < 0.8).astype(np.uint8)
    order = np.array([3, 0, 4, 1])
    color, noise, known = compose_plate(inverse, wanted, rows[0], rows[1:], pictures, order, gains,
                                        np.float32(1.5), np.float32(0.2))
    plain = reference.compose_plate(inverse, wanted, rows[0], rows[1:][order], pictures[order],
                                    gains[order], 1.5, 0.2)
    assert 0.3 < (known > 0).mean() < 0.9
    # Between pixels OpenCV blends in steps of a 32nd.
    for value, expected in zip((color, noise, known), plain):
        assert np.quantile(np.abs(value - expected), 0.95) < 0.03
        assert np.abs(value - expected).mean() < 0.01
