"""Guided patch synthesis: kernels against their plain forms, invariants, whole transfers."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from lfportrait.evaluate import patch_fidelity
from lfportrait.example import METHODS, FaceStyle, FaceStyleConfig, paint
from lfportrait.example.kernels.patches import (
    CELL,
    CHANNELS,
    MARGIN,
    patch_errors,
    search_pass,
    vote_patches,
)
from lfportrait.example.rivals.facestyle import doubled, halved, occupancy
from tests.portraits import drawn_face
from tests.reference import patches as plain

QUICK = FaceStyleConfig(votes=2, passes=1, coarsest=24)


def _problem(seed, height=26, width=22, rows=40, across=28):
    random = np.random.default_rng(seed)
    source = random.integers(-300, 300, (rows, across, CHANNELS)).astype(np.int16)
    target = random.integers(
        -300, 300, (height + 2 * MARGIN, width + 2 * MARGIN, CHANNELS)).astype(np.int16)
    # Half of the target is a piece of the source, so that propagation has something to find.
    target[:, :14] = source[2:2 + len(target), 5:19][:len(target)]

    def places():
        return (random.integers(MARGIN, rows - MARGIN, (height, width)) * across
                + random.integers(MARGIN, across - MARGIN, (height, width))).astype(np.int32)

    return target, source, places(), places()


def _rows(picture):
    return np.ascontiguousarray(picture).reshape(len(picture), -1)


@pytest.mark.parametrize("radius", [1, 2])
@pytest.mark.parametrize("forward", [True, False])
def test_search_equals_the_plain_form(radius, forward):
    target, source, guided, field = _problem(0)
    wanted = plain.search(target, source, guided, field, radius, MARGIN, forward)
    error = np.empty(field.shape, np.float32)
    patch_errors(radius)(_rows(target), _rows(source), field, error)
    assert error[3, 4] == pytest.approx(plain.error(
        target, 3, 4, source, *divmod(int(field[3, 4]), source.shape[1]), radius, MARGIN))
    made = field.copy()
    search_pass(radius)(_rows(target), _rows(source), occupancy(field, source.shape[:2]),
                        np.float32(0), guided, field, made, error, 0, forward, 1)
    assert (made == wanted).mean() > 0.999
    assert (made != field).mean() > 0.3
    again = np.empty_like(error)
    patch_errors(radius)(_rows(target), _rows(source), made, again)
    assert np.allclose(error, again)


def test_votes_equal_the_plain_form():
    _, _, _, field = _problem(1)
    random = np.random.default_rng(2)
    picture = random.random((40, 28, 3)).astype(np.float32)
    error = (100 * random.random(field.shape)).astype(np.float32)
    out = np.empty((*field.shape, 3), np.float32)
    vote_patches(field, error, picture, 2, np.float32(5), out)
    assert np.allclose(out, plain.vote(field, error, picture, 2, 5), atol=1e-5)


def test_random_steps_find_better_patches_whatever_the_number_of_threads():
    # Four bands.
    target, source, guided, field = _problem(3, height=120, width=40, rows=130, across=50)
    results, before = [], np.empty(field.shape, np.float32)
    patch_errors(2)(_rows(target), _rows(source), field, before)
    threads = numba.get_num_threads()
    try:
        for count in (1, threads):
            numba.set_num_threads(count)
            made, error = field.copy(), before.copy()
            search_pass(2)(_rows(target), _rows(source), occupancy(field, source.shape[:2]),
                           np.float32(10), guided, field, made, error, 16, True, 7)
            results.append(made)
    finally:
        numba.set_num_threads(threads)
    assert np.array_equal(*results)
    assert error.mean() < 0.9 * before.mean()


def test_a_crowd_is_dissolved_by_the_penalty():
    """All patches fit everywhere: with a penalty they spread, without one they stay."""
    source = np.zeros((48, 48, CHANNELS), np.int16)
    target = np.zeros((40 + 2 * MARGIN, 40 + 2 * MARGIN, CHANNELS), np.int16)
    crowd = np.full((40, 40), 24 * 48 + 24, np.int32)
    most = {}
    for penalty in (0, 10):
        field, error = crowd.copy(), np.zeros((40, 40), np.float32)
        for turn in range(6):
            search_pass(2)(_rows(target), _rows(source), occupancy(field, (48, 48)),
                           np.float32(penalty), crowd, field.copy(), field, error, 16,
                           turn % 2 == 0, turn)
        uses = occupancy(field, (48, 48))
        assert uses.sum() == 40 * 40 and uses.shape == (48 // CELL, 48 // CELL)
        most[penalty] = uses.max()
    assert most[0] == 40 * 40
    assert most[10] < 40


def test_levels_of_the_pyramid_fit_together():
    planes = np.random.default_rng(4).random((7, 6, 2)).astype(np.float32)
    small = halved(planes)
    assert small.shape == (4, 3, 2)
    assert np.allclose(small[1, 2], planes[2:4, 4:6].mean(axis=(0, 1)))
    assert np.allclose(small[3, 0], planes[6, :2].mean(axis=0))
    identity = (np.arange(20)[:, None] * 16 + np.arange(16)).astype(np.int32)
    fine = doubled(identity, (40, 32), 16, (40, 32))
    inside = fine[MARGIN:-MARGIN, MARGIN:-MARGIN]
    assert np.array_equal(inside, np.arange(40 * 32).reshape(40, 32)[2:-2, 2:-2])


def test_the_exemplar_s_own_photo_comes_back():
    face = drawn_face(128, 96)
    made = FaceStyle(face, QUICK).apply(face.image, face.landmarks)
    assert np.abs(made.image * 255 - face.image).mean() < 4


def test_a_photo_is_painted_with_the_exemplar_s_patches(tmp_path):
    style = drawn_face(160, 120, skin=(120, 90, 200), hair=(20, 90, 40), ground=(230, 220, 120))
    photo = drawn_face(120, 100, seed=1)
    made = paint(photo.image, style, QUICK, photo.landmarks)
    assert made.image.shape == photo.image.shape
    assert patch_fidelity(made.image, style.image, samples=200) < 0.5 * patch_fidelity(
        photo.image, style.image, samples=200)
    nose = tuple(photo.landmarks[30].astype(int)[::-1])
    assert np.abs(made.image[nose] * 255 - (120, 90, 200)).max() < 50
    made.dump(tmp_path)
    assert {path.stem for path in tmp_path.glob("*.png")} >= {
        "appearance", "segmentation", "position", "occupancy", "result"}
    assert "facestyle" in METHODS
    again = paint(photo.image, style, QUICK, photo.landmarks)
    other = paint(photo.image, style, replace(QUICK, seed=5), photo.landmarks)
    assert again.image.tobytes() == made.image.tobytes() != other.image.tobytes()


def test_a_small_photo_is_painted_with_the_exemplar_made_small():
    style = drawn_face(320, 240, skin=(120, 90, 200))
    photo = drawn_face(96, 80, seed=1)
    made = FaceStyle(style, QUICK).apply(photo.image, photo.landmarks)
    jaw = photo.landmarks[8]
    below_lips = (int(0.5 * (jaw[1] + photo.landmarks[57, 1])), int(jaw[0]))
    assert np.abs(made.image[below_lips] * 255 - (120, 90, 200)).max() < 50
