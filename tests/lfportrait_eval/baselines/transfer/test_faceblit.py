"""FaceBlit as published: its table, its flood fill against plain forms, whole transfers."""

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from lfportrait.example import Exemplar, photo_method, prepare
from lfportrait_eval.baselines.config import FaceBlitConfig
from lfportrait_eval.baselines.kernels import NOWHERE, flood, search_windows, sweep_windows
from lfportrait_eval.baselines.transfer import FaceBlit, faceblit
from lfportrait_eval.baselines.transfer.faceblit import (
    appearance_levels,
    matched_levels,
    published_mask,
    stretched,
    warped_gradient,
)
from tests.portraits import drawn_face


def _guides(seed, height, width, cells=16):
    random = np.random.default_rng(seed)
    red = (cells * np.arange(width) // width).astype(np.int32)
    green = (cells * np.arange(height) // height).astype(np.int32)
    return red, green, random.integers(0, cells, (height, width)).astype(np.int32)


def test_the_table_holds_the_first_best_pixel_of_the_window():
    red, green, appearance = _guides(0, 40, 30)
    table = np.empty((16, 16, 16), np.int32)
    sweep_windows(red, green, appearance, 10, 2, 4, table)
    exhaustive = np.empty_like(table)
    search_windows(red, green, appearance, 10, 2, 4, 0, 16, exhaustive)
    assert np.array_equal(table, exhaustive)
    for g, r, a in ((0, 0, 0), (3, 7, 11), (15, 15, 2), (9, 0, 15)):
        top, left = max(g * 40 // 16 - 4, 0), max(r * 30 // 16 - 4, 0)
        rows, columns = slice(top, g * 40 // 16 + 5), slice(left, r * 30 // 16 + 5)
        error = (10 * np.abs(green[rows, None] - g) + 10 * np.abs(red[None, columns] - r)
                 + 2 * np.abs(appearance[rows, columns] - a))
        y, x = np.unravel_index(error.argmin(), error.shape)
        assert table[g, r, a] == (top + y) * 30 + left + x


def _plain_flood(red, green, appearance, style, seeds, box, weights, threshold):
    """The chunk of a seed is the part connected to it of what its shift explains."""
    style_red, style_green, style_appearance = style
    out = np.full(red.shape, -1)
    y, x = np.mgrid[:red.shape[0], :red.shape[1]]
    height, width = style_appearance.shape
    for top in range(box[1], box[3]):
        for left in range(box[0], box[2]):
            if out[top, left] != -1:
                continue
            v, u = seeds[top, left] // width + y - top, seeds[top, left] % width + x - left
            inside = (v >= 0) & (v < height) & (u >= 0) & (u < width)
            v, u = np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)
            error = (weights[0] * (abs(red - style_red[u]) + abs(green - style_green[v]))
                     + weights[1] * abs(appearance - style_appearance[v, u]))
            good = inside & (error < threshold) & (out == -1)
            good[top, left] = True
            parts = ndimage.label(good)[0]
            chunk = parts == parts[top, left]
            out[chunk] = (v * width + u)[chunk]
    return out


def test_flood_equals_the_plain_form():
    style = _guides(1, 28, 24, 64)
    random = np.random.default_rng(2)
    red = np.tile(np.linspace(0, 63, 30), (26, 1)).astype(np.int32)
    green = np.tile(np.linspace(0, 63, 26)[:, None], (1, 30)).astype(np.int32)
    appearance = random.integers(0, 64, (26, 30)).astype(np.int32)
    seeds = random.integers(0, 28 * 24, (26, 30)).astype(np.int32)
    for box, threshold in (([0, 0, 30, 26], 500), ([8, 5, 20, 18], 300)):
        out = np.empty((26, 30), np.int32)
        flood(red, green, appearance, *style, seeds, np.array(box), 10, 2, threshold, out)
        assert np.array_equal(out, _plain_flood(red, green, appearance, style, seeds, box,
                                                (10, 2), threshold))
        assert len(np.unique(out)) > 20
    assert (out == NOWHERE).any()


def test_appearance_is_centred_stretched_and_matched():
    random = np.random.default_rng(3)
    image = np.full((64, 48, 3), 90, np.uint8)
    assert (appearance_levels(image) == 128).all()
    image = random.integers(60, 140, (64, 48, 3)).astype(np.uint8)
    levels = appearance_levels(image)
    wide = stretched(levels)
    assert abs(np.median(wide) - 128) <= 6
    assert wide.max() - wide.min() > 1.5 * (levels.max() - levels.min())
    matched = matched_levels(levels, wide)
    quantiles = np.linspace(5, 95, 10)
    assert np.abs(np.percentile(matched, quantiles) - np.percentile(wide, quantiles)).max() <= 4
    assert np.array_equal(np.argsort(np.unique(levels)), np.arange(len(np.unique(levels))))


def test_an_unwarped_gradient_is_the_exemplar_s_own():
    places = np.arange(96, dtype=np.float32) + 0.5
    assert np.array_equal(warped_gradient(places, 96), 256 * np.arange(96) // 96)
    assert warped_gradient(np.float32([-5, 200]), 96).tolist() == [0, 253]


def test_the_exemplar_s_own_photo_comes_back(monkeypatch):
    monkeypatch.setattr(faceblit, "RADIUS", 0)
    face = drawn_face(128, 96)
    made = FaceBlit(face).apply(face.image, face.landmarks)
    away = np.abs(made.image * 255 - face.image).mean(axis=-1)
    assert np.median(away) < 6 and (away < 40).mean() > 0.95


@pytest.mark.slow  # only for comparisons
def test_without_background_the_rest_stays_the_photo(tmp_path):
    style = drawn_face(128, 96, skin=(120, 90, 200))
    photo = drawn_face(120, 100, seed=1)
    made = FaceBlit(style, FaceBlitConfig(background=False)).apply(photo.image, photo.landmarks)
    untouched = ndimage.uniform_filter(
        published_mask(photo.image, photo.landmarks).astype(float), 20) == 0
    assert untouched.any()
    assert np.allclose(made.image[untouched], photo.image[untouched] / 255, atol=1e-6)
    nose = tuple(photo.landmarks[30].astype(int)[::-1])
    assert made.image[nose][2] > made.image[nose][0] + 0.1  # painted with the exemplar's skin
    whole = prepare(style, FaceBlitConfig()).apply(photo.image, photo.landmarks)
    assert np.abs(whole.image[:5, :5] * 255 - style.image[:5, :5].mean((0, 1))).mean() < 15
    whole.dump(tmp_path)
    assert {path.stem for path in tmp_path.glob("*.png")} >= {"position", "mask", "result"}
    assert whole.seconds["precalculation_seconds"] > 0
    assert photo_method("faceblit").parameters is FaceBlitConfig


@pytest.mark.data
def test_the_authors_own_result_is_met(shared_data):
    """The published picture comes out, but for the landmarks, which the authors placed anew."""
    folder = shared_data / "faceblit_reference"
    photo = np.asarray(Image.open(folder / "target1.png").convert("RGB"))
    wanted = np.asarray(Image.open(folder / "target1_het_3x3_voting_bg.png").convert("RGB")) / 255
    # Eyes, nose, mouth and chin of the photo place the exemplar's landmarks by an affine map.
    style = Exemplar(np.asarray(Image.open(shared_data / "styles/het.png").convert("RGB")),
                     np.loadtxt(shared_data / "styles/het.landmarks.txt"))
    ours = np.array([[199, 476], [495, 479], [333, 597], [243, 688], [445, 693], [339, 865]])
    theirs = style.landmarks[[36, 45, 30, 48, 54, 8]]
    fit, *_ = np.linalg.lstsq(np.c_[theirs, np.ones(6)], ours, rcond=None)
    made = FaceBlit(style).apply(photo, np.c_[style.landmarks, np.ones(68)] @ fit)
    error = ((made.image - wanted)[250:850, 150:600] ** 2).mean()
    own = ((photo / 255 - wanted)[250:850, 150:600] ** 2).mean()
    assert error < 0.012 < own
