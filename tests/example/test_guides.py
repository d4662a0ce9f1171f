"""Guides: moving least squares, appearance, histogram, folding, the surface of a head."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from lfportrait.errors import UserError
from lfportrait.example import Exemplar, SurfaceGuide, position_guide
from lfportrait.example.guides.filters import (
    appearance_guide,
    enlarged,
    gaussian_blur,
    match_histogram,
)
from lfportrait.example.guides.position import (
    anchor_scale,
    fold_inside,
    mls_similarity,
    pixel_centres,
    relative_stretch,
)
from lfportrait.example.guides.regions import FaceFrame, find_regions, without_hair
from lfportrait.example.surface_guide import squeeze
from lfportrait.labels import PICTURE_LABELS as LABELS
from tests.portraits import CANONICAL, HEAD_LANDMARKS, ball_head, drawn_face
from tests.reference import mls


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 40))
def test_mls_equals_the_minimisation(seed, count):
    random = np.random.default_rng(seed)
    sources, targets = random.uniform(0, 100, (2, count, 2))
    points = np.concatenate([random.uniform(-50, 150, (20, 2)), sources[:2]])
    weights = random.uniform(0.5, 3, count)
    expected = mls.mls_similarity(points, sources, targets, weights)
    assert np.allclose(mls_similarity(points, sources, targets, weights), expected, atol=1e-5)


@settings(max_examples=20, deadline=None)
@given(st.floats(-3, 3), st.floats(0.3, 3), st.floats(-50, 50), st.floats(-50, 50))
def test_mls_reproduces_similarities(angle, scale, tx, ty):
    sources = np.random.default_rng(1).uniform(0, 100, (12, 2))
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = np.random.default_rng(2).uniform(-100, 200, (30, 2))
    mapped = mls_similarity(points, sources, sources @ turn.T + (tx, ty))
    assert np.allclose(mapped, points @ turn.T + (tx, ty), atol=1e-6)


def test_one_control_point_is_a_translation():
    mapped = mls_similarity(np.array([[3.0, 4.0]]), np.array([[1.0, 1.0]]), np.array([[2.0, 5.0]]))
    assert np.allclose(mapped, [[4.0, 8.0]])


def test_coarse_grid_is_close_to_every_pixel():
    random = np.random.default_rng(3)
    source = drawn_face(160, 120).landmarks
    target = source * 1.1 + random.normal(0, 1.0, source.shape)
    exact = position_guide((160, 120), source, target, grid=1)
    coarse = position_guide((160, 120), source, target, grid=4)
    assert exact.shape == (160, 120, 2)
    assert np.abs(exact - coarse).mean() < 0.1
    assert np.percentile(np.abs(exact - coarse), 99) < 1.0


def test_unknown_landmarks_are_left_out():
    source = drawn_face(80, 60).landmarks
    holes = source.copy()
    holes[5] = np.nan
    guide = position_guide((80, 60), holes, source)
    assert np.allclose(guide, pixel_centres((80, 60)), atol=1e-3)


def test_folding_stays_in_the_border_strip():
    places = np.stack([np.linspace(-300, 500, 801), np.linspace(-300, 500, 801)], axis=1)
    folded = fold_inside(places.astype(np.float32), (200, 100), (20, 30, 70, 180))
    assert folded.min() >= 0 and (folded < [100, 200]).all()
    inside = (places > 0) & (places < [99.9, 199.9])
    assert np.allclose(folded[inside], places[inside])
    assert folded[places[:, 0] < 0, 0].max() <= 20
    assert folded[places[:, 1] > 200, 1].min() >= 180 - 0.1
    assert np.abs(np.diff(folded, axis=0)).max() < 1.1


def test_blur_is_a_gaussian():
    image = np.random.default_rng(4).random((40, 31)).astype(np.float32)
    from scipy.ndimage import gaussian_filter

    expected = gaussian_filter(image, 2.0, mode="reflect", radius=6)
    assert np.allclose(gaussian_blur(image, 2.0), expected, atol=1e-5)


@pytest.mark.parametrize("factor", [2, 5])
@pytest.mark.parametrize("shape", [(1, 1), (7, 23), (20, 10)])
def test_block_means_are_enlarged_bilinearly(shape, factor):
    """Also where the last block is cut, or missing: then its neighbour's value goes on."""
    for less in (0, 1):
        small = np.random.default_rng(0).random(
            [max(1, -(-side // factor) - less) for side in shape]).astype(np.float32)
        found = enlarged(small, factor, shape)
        down, across = (np.clip((np.arange(side) + 0.5) / factor - 0.5, 0, blocks - 1)
                        for side, blocks in zip(shape, small.shape))
        expected = map_coordinates(small, np.meshgrid(down, across, indexing="ij"), order=1,
                                   mode="nearest")
        assert found.shape == shape and found == pytest.approx(expected, abs=1e-5)


def test_blur_wider_than_the_picture():
    image = np.full((5, 7), 0.3, np.float32)
    assert np.allclose(gaussian_blur(image, 9.0), 0.3, atol=1e-5)


def test_appearance_ignores_slow_light():
    ramp = np.repeat(np.linspace(0, 1, 200, dtype=np.float32)[None, :, None], 200, 0)
    guide = appearance_guide(np.repeat(ramp, 3, axis=2), 4.0)
    assert np.abs(guide[:, 20:-20]).max() < 1e-3


@settings(max_examples=10, deadline=None)
@given(st.floats(0.2, 4.0), st.floats(-0.1, 0.1))
def test_histogram_matching_undoes_contrast(gain, offset):
    random = np.random.default_rng(5)
    values = random.normal(0, 0.05, (100, 100)).astype(np.float32)
    matched = match_histogram((values * gain + offset).astype(np.float32), values,
                              np.ones((100, 100), bool))
    assert np.abs(matched - values).mean() < 2e-3


def test_histogram_of_a_flat_picture_is_finite():
    flat = np.zeros((10, 10), np.float32)
    assert np.isfinite(match_histogram(flat, flat, flat > 1)).all()


def test_anchor_scale_and_stretch():
    places = pixel_centres((20, 30)) * np.float32(2.5)
    assert anchor_scale(places) == pytest.approx(2.5)
    halved = relative_stretch(places * np.float32(0.5), places)
    # The last pixel has no neighbour to compare with, and the result is blurred.
    assert np.allclose(halved[:10, :20], 0.5, atol=1e-3)


def test_regions_of_a_drawn_face():
    face = drawn_face(320, 240)
    regions = find_regions(face.image, face.landmarks, networks=False)
    truth = face.mask
    assert ((regions.person > 0.5) == (truth > 0.5)).mean() > 0.95
    assert regions.hair is not None
    labels = regions.labels().astype(int)
    assert np.abs(labels.sum(axis=-1) - 255).max() <= 6
    outline = regions.outline()
    assert np.isfinite(outline).all()
    centre = face.landmarks[17:27].mean(axis=0)
    assert (np.linalg.norm(outline - centre, axis=1)
            > np.linalg.norm(regions.hairline() - centre, axis=1)).all()


def test_surface_guide_meets_the_landmarks():
    face = drawn_face(320, 240)
    guide = SurfaceGuide(HEAD_LANDMARKS, face)
    position, anchor = guide(HEAD_LANDMARKS[None])
    assert np.abs(position[0, 17:] - face.landmarks[17:]).max() < 1.0
    assert position.dtype == np.float32 and anchor.shape == (1, 68, 2)


def test_surface_guide_does_not_depend_on_the_view():
    """The same surface points in another order and grid give the same guides."""
    guide = SurfaceGuide(HEAD_LANDMARKS, drawn_face(320, 240))
    points = ball_head(np.linspace(-2.8, 2.8, 60), np.linspace(-0.9, 0.9, 40))
    first = guide(points)
    second = guide(points[::-1, ::-1])
    for one, two in zip(first, second):
        assert np.array_equal(one[::-1, ::-1], two)


def test_surface_guide_does_not_fold_on_the_face():
    """From cheek to cheek the exemplar's coordinate grows; no dent is as deep as a pixel."""
    guide = SurfaceGuide(HEAD_LANDMARKS, drawn_face(320, 240))
    points = ball_head(np.radians(np.linspace(-60, 60, 121)), np.linspace(-0.3, 0.3, 31))
    position, anchor = guide(points)
    assert np.diff(position[..., 0], axis=1).min() > -1
    assert np.diff(position[:, 5::5, 0], axis=1)[:, 1:-1].min() > 0
    assert np.diff(position[..., 1], axis=0).min() > -1
    assert np.diff(position[::6, :, 1], axis=0).min() > 0
    assert np.diff(anchor[..., 0], axis=1).min() > 0


def test_surface_guide_stays_on_the_exemplar_all_around():
    face = drawn_face(320, 240)
    guide = SurfaceGuide(HEAD_LANDMARKS, face)
    points = ball_head(np.linspace(-np.pi, np.pi, 90), np.linspace(-2.5, 0.99, 70))
    points[0, 0] = np.nan
    position, anchor = guide(points)
    assert np.isnan(position[0, 0]).all() and np.isnan(anchor[0, 0]).all()
    seen = position[np.isfinite(position[..., 0])]
    assert seen.min() >= 0 and (seen < [240, 320]).all()
    head = position[points[..., 1] > -0.3]
    inside = face.mask[head[:, 1].astype(int), head[:, 0].astype(int)]
    assert inside.mean() > 0.98


def test_surface_guide_is_smooth_on_the_crown():
    """The dome has no pole on top of the head: neighbours there stay neighbours."""
    guide = SurfaceGuide(HEAD_LANDMARKS, drawn_face(320, 240))
    x, z = np.meshgrid(np.linspace(-0.2, 0.2, 41), np.linspace(-0.2, 0.2, 41))
    points = np.stack([x, np.sqrt(1 - x ** 2 - z ** 2), z], axis=-1) * 0.6
    _, anchor = guide(points)
    step = np.abs(np.diff(anchor, axis=1)).max()
    assert step < 4 * guide.scale * 0.6 * 0.01 + 1


def test_squeeze_is_monotone_and_bounded():
    angle = np.linspace(0, np.pi, 500)
    squeezed = squeeze(angle)
    assert (np.diff(squeezed) > 0).all() and squeezed[-1] < np.radians(92)
    assert np.allclose(squeezed[angle < np.radians(60)], angle[angle < np.radians(60)])


def test_too_few_landmarks_in_space():
    landmarks = np.full((68, 3), np.nan)
    landmarks[:10] = HEAD_LANDMARKS[:10]
    with pytest.raises(UserError, match="only 10 of 68"):
        SurfaceGuide(landmarks, drawn_face(80, 60))


def test_exemplar_checks_its_parts():
    face = drawn_face(80, 60)
    with pytest.raises(ValueError, match="68, 2"):
        Exemplar(face.image, face.landmarks[:5])
    with pytest.raises(ValueError, match="mask"):
        Exemplar(face.image, face.landmarks, "x", np.zeros((3, 3), np.float32))


def test_hair_counts_as_skin_where_the_target_has_none():
    labels = np.zeros((2, 3, len(LABELS)), np.uint8)
    labels[0, :, LABELS.index("hair")], labels[0, :, LABELS.index("skin")] = 200, 70
    labels[1, :, LABELS.index("body")] = 255
    bald = without_hair(labels)
    assert (bald[..., LABELS.index("hair")] == 0).all()
    assert (bald[0, :, LABELS.index("skin")] == 255).all()
    assert (bald[1] == labels[1]).all()


def test_turn_of_a_face():
    landmarks = CANONICAL * 50 + 100
    assert abs(FaceFrame.of(landmarks).turn(landmarks)) < 0.01
    landmarks[30, 0] += 0.5 * 0.62 * 50
    assert abs(FaceFrame.of(landmarks).turn(landmarks) - 0.5) < 0.02
