"""Kernels of the transfer against their plain forms, at sizes that are no multiple of a vector."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from lfportrait.example.guides.filters import appearance_guide, shrunk
from lfportrait.example.guides.position import pixel_centres
from lfportrait.example.kernels.guides import distances
from lfportrait.example.kernels.labels import pixel_weights, shrink_label, soft_labels
from lfportrait.example.kernels.vote import elect, vote
from lfportrait.example.styleblit import label_words, pack_colors, shift_planes
from tests.reference import transfer as reference

SHAPES = [(9, 7), (20, 16), (11, 37), (33, 64)]


def _planes(shape, factor, count, random):
    small = -(-shape[0] // factor), -(-shape[1] // factor)
    planes = np.clip(random.normal(0, 0.6, (count, *small)), 0, 1).astype(np.float32)
    planes[:, :, :small[1] // 2] = 0
    return planes


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("factor", [1, 2, 8])
@pytest.mark.parametrize("like", [(False, False), (True, False), (False, True)])
def test_labels_and_weights(shape, factor, like):
    random = np.random.default_rng(factor)
    person, hair = random.random((2, *shape)).astype(np.float32)
    planes = _planes(shape, factor, 5, random)
    words = np.full((*shape, 2), -1, np.int32)
    soft_labels(person, hair, planes, factor, *like, words)
    found = words.view(np.uint8)
    wanted = reference.labels(person, hair, planes, factor, *like)
    assert np.abs(found - wanted).max() < 0.51
    soft = _planes(shape, factor, 1, random)[0]
    place, look = np.array([1.3, 3.3], np.float32), np.array([15, 300], np.float32)
    out = np.full((*shape, 2), np.nan, np.float32)
    face, lines = _planes(shape, factor, 2, random)
    hair, body = np.array([[0.8, 0.4], [0.3, 0.1]], np.float32)
    pixel_weights(person, label_words(found), soft, face, lines, factor, place, np.float32(2),
                  look, hair, body, np.float32(0.2), np.float32(3), out)
    assert np.allclose(out, reference.weights(person, found, soft, face, lines, factor, place, 2,
                                              look, hair, body, 0.2, 3), rtol=1e-4, atol=1e-4)
    for grid in (1, 4):
        small = np.empty((-(-shape[0] // grid), -(-shape[1] // grid)), np.float32)
        shrink_label(found, 7, True, grid, small)
        plane = 1 - found[..., 7].astype(np.float32) / 255
        assert np.allclose(small, shrunk(plane, grid), atol=1e-6)


def _shifts(shape, margin, random):
    """Few different shifts, some pixels without; as picture and as planes."""
    shift = random.integers(-2, 2, (*shape, 2)).astype(np.float32)
    shift[:, : shape[1] // 2] = 1.0
    shift[random.random(shape) < 0.1] = np.nan
    planes = shift_planes(*shape, margin)
    planes[:, margin:margin + shape[0], margin:margin + shape[1]] = np.moveaxis(shift, -1, 0)
    return shift, planes


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("radius", [1, 2])
def test_election(shape, radius):
    shift, planes = _shifts(shape, radius, np.random.default_rng(radius))
    out = shift_planes(*shape, radius)
    elect(pixel_centres(shape), np.float32(5 * radius), planes, radius, shape[1], out)
    found = np.moveaxis(out[:, radius:radius + shape[0], radius:radius + shape[1]], 0, -1)
    wanted = reference.elect(shift, radius)
    assert np.array_equal(found, wanted, equal_nan=True)
    # The margin must stay empty: the votes read it.
    out[:, radius:radius + shape[0], radius:radius + shape[1]] = np.nan
    assert np.isnan(out).all()


@pytest.mark.parametrize("shape", [*SHAPES[:3], pytest.param(
    SHAPES[3], marks=pytest.mark.slow)])  # its rows are whole vectors, as of the second
@pytest.mark.parametrize("radius", [0, 1, 2])
@pytest.mark.parametrize("exact", [True, False])
def test_votes(shape, radius, exact):
    random = np.random.default_rng(radius)
    shift, planes = _shifts(shape, max(radius, 1), random)
    anchor = pixel_centres(shape) * np.float32(1.0 if exact else 1.3)
    picture = (random.integers(0, 256, (31, 23, 3)) / 255).astype(np.float32)
    out = np.full((*shape, 3), np.nan, np.float32)
    vote(pack_colors(picture), anchor, np.float32(9), planes, max(radius, 1), radius, exact, out)
    assert np.allclose(out, reference.vote(picture, anchor, shift, radius, exact), atol=2e-5)


def test_pieces_of_the_anchor_plane_do_not_vote_for_each_other():
    """Shifts on both sides of a tear mean the same places: so they must stay apart."""
    shape, reach = (20, 37), np.float32(5)
    anchor = pixel_centres(shape)
    anchor[:, 18:] += 500
    shift = np.zeros((*shape, 2), np.float32)
    shift[:, 18:] = -500
    # Lonely pixels beside the tear, which most of their window would vote down.
    shift[5::4, 17] = 1
    planes, out = shift_planes(*shape, 1), shift_planes(*shape, 1)
    planes[:, 1:-1, 1:38] = np.moveaxis(shift, -1, 0)
    elect(anchor, reach, planes, 1, 37, out)
    assert (np.abs(out[:, 1:-1, 1:19]) <= 1).all() and (out[:, 1:-1, 19:38] == -500).all()
    picture = np.random.default_rng(4).integers(0, 256, (*shape, 3)) / 255
    made = np.empty((*shape, 3), np.float32)
    planes[:, 1:-1, 1:19] = 0
    vote(pack_colors(picture.astype(np.float32)), anchor, reach, planes, 1, 1, True, made)
    assert np.allclose(made, picture, atol=1e-5)


@pytest.mark.parametrize("sigma", [0.9, 1.7, 4.0])
def test_the_appearance_is_a_difference_of_two_blurs(sigma):
    """Both parities of the kernels' radius, and borders nearer than it."""
    picture = np.random.default_rng(2).random((21, 37, 3)).astype(np.float32)
    grey = picture @ np.array([0.299, 0.587, 0.114])
    found = appearance_guide(picture, sigma, 0.4 * sigma)
    fine, broad = (gaussian_filter(grey, s, mode="reflect", truncate=3)
                   for s in (0.4 * sigma, np.hypot(sigma, 0.4 * sigma)))
    assert np.abs(found - (fine - broad)).max() < 0.01


def test_distances_of_several_masks_at_once_end_where_they_are_told():
    random = np.random.default_rng(1)
    masks = (random.random((2, 6, 9)) > 0.5).repeat(6, 1).repeat(6, 2).astype(np.float32)
    one, far = np.empty_like(masks), np.array([50, 3], np.float32)
    distances(masks, far, one)
    alone = np.empty_like(masks)
    for k in range(2):
        distances(masks[k:k + 1], np.array([50], np.float32), alone[k:k + 1])
    assert np.array_equal(one[0], alone[0])
    assert np.abs(one[1]).max() <= 3
    near = np.abs(alone[1]) < 2.9
    assert near.sum() > 100 and np.abs(one[1] - alone[1])[near].max() < 1e-5
