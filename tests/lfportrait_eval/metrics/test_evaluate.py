"""Likeness and feature distances: self tests with known answers."""

import json

import numpy as np
import pytest
from scipy import linalg

from lfportrait import models
from lfportrait.media.pictures import read_image
from lfportrait_eval.metrics import (
    PatchIndex,
    contour_correlation,
    feature_distance,
    frechet_distance,
    identity,
    inception_features,
    kernel_distance,
    landmark_error,
    patch_fidelity,
    style_distance,
)
from lfportrait_eval.metrics.patches import lab, spread_places
from lfportrait_eval.metrics.views import face_region
from tests.portraits import drawn_face


def texture(seed: int, shape=(48, 60)) -> np.ndarray:
    return np.random.default_rng(seed).random((*shape, 3)).astype(np.float32)


def smooth(seed: int, shape=(96, 96)) -> np.ndarray:
    from scipy import ndimage

    noise = ndimage.gaussian_filter(texture(seed, shape), (4, 4, 0))
    return np.float32((noise - noise.min()) / np.ptp(noise))


def test_landmark_error_is_relative_to_the_eyes():
    points = np.random.default_rng(0).random((68, 2)) * 100
    points[36], points[45] = (20, 50), (70, 50)
    assert landmark_error(points, points) == 0
    assert landmark_error(points + np.array([3, 4]), points) == pytest.approx(5 / 50)
    assert landmark_error(2 * points + (6, 8), 2 * points) == pytest.approx(10 / 100)


def test_the_region_of_the_face_lies_between_jaw_and_brows():
    photo = drawn_face(120, 100)
    region = face_region(photo.image.shape, photo.landmarks)
    assert region[tuple(photo.landmarks[30].astype(int)[::-1])]
    assert not region[:int(photo.landmarks[17:27, 1].min()) - 2].any()
    assert not region[int(photo.landmarks[8, 1]) + 2:].any()


def test_identity_counts_the_faces_that_are_found():
    base = np.random.default_rng(0).random((68, 2)) * 100
    base[36], base[45] = (20, 50), (70, 50)
    answers = {0: base, 1: base + np.array([5, 0]), 2: None, 3: base}
    pictures = {index: np.full((4, 4, 3), index, np.uint8) for index in answers}

    def detect(image):
        return answers[int(image[0, 0, 0])]

    stylised = [pictures[index] for index in (0, 1, 2, 0)]
    real = [pictures[index] for index in (0, 0, 0, 2)]
    figures = identity(stylised, real, detect)
    assert figures["views"] == 3 and figures["detected"] == pytest.approx(2 / 3)
    assert figures["nme"] == pytest.approx((0 + 0.1) / 2)
    nothing = identity([pictures[2]], [pictures[2]], detect)
    assert nothing["views"] == 0 and np.isnan(nothing["nme"])


def test_contours_correlate_whatever_the_colors():
    a = smooth(1)
    mask = np.ones(a.shape[:2], bool)
    assert contour_correlation(a, a, mask) == pytest.approx(1.0)
    assert contour_correlation(0.2 + 0.5 * a, a, mask) == pytest.approx(1.0)
    assert abs(contour_correlation(smooth(2), a, mask)) < 0.4
    assert np.isnan(contour_correlation(np.zeros_like(a), a, mask))


def test_patches_copied_from_the_exemplar_are_perfect():
    exemplar = texture(3)
    assert patch_fidelity(exemplar[5:30, 7:40], exemplar, samples=200) < 0.05
    assert patch_fidelity(exemplar[:, ::-1], exemplar, samples=100) > 1.0


def test_patch_fidelity_equals_brute_force():
    from skimage.color import rgb2lab

    image, exemplar = texture(4, (14, 16)), texture(5, (18, 15))

    def cut(picture):
        lab = rgb2lab(picture.astype(np.float64))
        return np.array([lab[y:y + 7, x:x + 7].ravel() for y in range(picture.shape[0] - 6)
                         for x in range(picture.shape[1] - 6)])

    ours, theirs = cut(image), cut(exemplar)
    nearest = [np.sqrt(((theirs - patch) ** 2).sum(1).min() / 49) for patch in ours]
    assert patch_fidelity(image, exemplar, samples=10 ** 6) == pytest.approx(
        np.mean(nearest), rel=1e-3)


def test_patches_are_looked_up_exactly_in_a_tree_of_many_leaves():
    exemplar, image = texture(8, (60, 70)), texture(9, (24, 30))
    image[4:20, 5:25] = 0.5 * image[4:20, 5:25] + 0.5 * exemplar[10:26, 30:50]
    index = PatchIndex(exemplar)
    assert len(index.leaf) > 33
    every = np.ascontiguousarray(np.argwhere(np.ones((18, 24), bool)).T)
    ours, theirs = (np.lib.stride_tricks.sliding_window_view(lab(picture), (7, 7), axis=(0, 1))
                    .reshape(-1, 147).astype(np.float64) for picture in (image, exemplar))
    squared = (ours ** 2).sum(1)[:, None] + (theirs ** 2).sum(1) - 2 * ours @ theirs.T
    assert index.distances(image, *every) == pytest.approx(
        np.sqrt(squared.min(axis=1) / 49), rel=1e-3)


def test_patches_are_spread_evenly_inside_the_mask():
    mask = np.zeros((90, 120), bool)
    mask[10:70, 30:110] = True
    places = spread_places(mask, 500, seed=1)
    assert 450 < len(places) < 700 and mask[tuple(places.T)].all()
    assert len({tuple(p) for p in places.tolist()}) == len(places)
    halves = (places[:, 1] < 70).mean()
    assert 0.45 < halves < 0.55
    assert len(spread_places(mask, 10 ** 6)) == mask.sum()
    assert (spread_places(mask, 500, seed=2)[:20] != places[:20]).any()


def test_patch_fidelity_looks_inside_the_mask_alone():
    exemplar = texture(6)
    image = texture(7)
    image[:, :30] = exemplar[:, :30]
    mask = np.zeros(image.shape[:2], bool)
    mask[:, :27] = True  # the patches reach three pixels further
    assert patch_fidelity(image, exemplar, mask, samples=100) < 0.05
    assert np.isnan(patch_fidelity(image, exemplar, np.zeros_like(mask)))


def test_frechet_distance_of_normal_distributions():
    generator = np.random.default_rng(0)
    a, b = generator.standard_normal((500, 6)), generator.standard_normal((400, 6)) * 2 + 1
    assert frechet_distance(a, a) == pytest.approx(0, abs=1e-8)
    assert frechet_distance(a + 3, a) == pytest.approx(6 * 9)
    first, second = np.cov(a.T), np.cov(b.T)
    expected = ((a.mean(0) - b.mean(0)) ** 2).sum() + np.trace(
        first + second - 2 * linalg.sqrtm(first @ second).real)
    assert frechet_distance(a, b) == pytest.approx(expected)
    # With fewer pictures than dimensions the covariances are singular; still no failure.
    few = frechet_distance(generator.standard_normal((5, 30)), generator.standard_normal((4, 30)))
    assert np.isfinite(few) and few > 0


def test_kernel_distance_is_unbiased():
    generator = np.random.default_rng(1)
    same = [kernel_distance(generator.standard_normal((30, 8)), generator.standard_normal((30, 8)))
            for _ in range(40)]
    assert abs(np.mean(same)) < 3 * np.std(same) / np.sqrt(len(same))
    far = kernel_distance(generator.standard_normal((30, 8)),
                          generator.standard_normal((30, 8)) + 1)
    assert far > 5 * np.std(same)


def test_feature_distance_grows_with_the_difference():
    a = smooth(8)
    assert feature_distance(a, a, network="embedded") == 0
    noise = np.random.default_rng(9).standard_normal(a.shape)
    small, large = (feature_distance(a, np.clip(a + s * noise, 0, 1), network="embedded")
                    for s in (0.02, 0.2))
    assert 0 < small < large < 4
    mask = np.zeros(a.shape[:2], bool)
    mask[:32, :32] = True
    spoiled = a.copy()
    spoiled[64:] = 0
    assert feature_distance(a, spoiled, mask, network="embedded") < 1e-3
    assert feature_distance(a, spoiled, network="embedded") > 1e-2


@pytest.mark.data
def test_inception_gives_the_published_features(shared_data, shared_weights, monkeypatch):
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    assert models.available("inception")
    expected = json.loads((shared_weights / "expected.json").read_text())["inception"]
    y, x, size = expected["crop"]
    picture = read_image(shared_data / "faceblit_reference" / "target1.png")[..., :3]
    found = inception_features([picture[y:y + size, x:x + size]])
    for name in ("64", "192", "768"):
        row = expected[f"pool{name}"]
        values = found[name][0]
        assert values.shape == (int(name),)
        assert values[:5] == pytest.approx(row["first5"], abs=2e-3)
        assert values.mean() == pytest.approx(row["mean"], rel=1e-3)
        assert values.std(ddof=1) == pytest.approx(row["std"], rel=1e-3)


@pytest.mark.data
def test_style_distance_tells_sets_of_pictures_apart(shared_weights, monkeypatch):
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    sets = [[np.uint8(255 * tint * smooth(seed, (64, 64))) for seed in seeds]
            for tint, seeds in ((1.0, range(2)), (1.0, range(3, 5)), (0.3, range(6, 8)))]
    near, far = style_distance(sets[0], sets[1]), style_distance(sets[0], sets[2])
    for name in ("fid_64", "fid_192", "kid_768"):
        assert far[name] > near[name]
    assert near["pictures"] == near["exemplar_pictures"] == 2
