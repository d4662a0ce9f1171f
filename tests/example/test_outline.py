"""The outline match: signed distances, and guides whose edges meet those of the exemplar."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from lfportrait.example.guides.position import pixel_centres
from lfportrait.example.guides.regions import Regions
from lfportrait.example.photo_guide import EdgeMatch, lay_body, signed_distance
from tests.portraits import CANONICAL


def disc(shape, middle, radius):
    """A soft disc, one pixel of ramp at its edge, float32 [H, W]."""
    away = np.linalg.norm(pixel_centres(shape) - np.array(middle, np.float32), axis=-1)
    return np.clip(radius - away + 0.5, 0, 1).astype(np.float32)


def nodes_of(shape, grid):
    y, x = np.mgrid[:-(-(shape[0] - 1) // grid) + 1, :-(-(shape[1] - 1) // grid) + 1]
    return (np.stack([x, y], axis=-1) * grid + 0.5).astype(np.float32)


@pytest.mark.parametrize("cell", [1, 4])
def test_distance_from_a_circle(cell):
    found = signed_distance(disc((120, 160), (83.3, 57.1), 30.0), cell)
    y, x = np.mgrid[:found.shape[0], :found.shape[1]]
    exact = 30.0 - np.hypot((x + 0.5) * cell - 83.3, (y + 0.5) * cell - 57.1)
    near = np.abs(exact) < 8 * cell
    assert np.abs(found - exact)[near].max() < 0.5 * cell
    assert np.abs(found - exact)[near].mean() < 0.13 * cell


def test_distance_agrees_with_the_exact_transform():
    mask = np.random.default_rng(3).random((12, 15)).repeat(10, 0).repeat(10, 1) > 0.6
    found = signed_distance(mask.astype(np.float32), 1)
    exact = np.where(mask, distance_transform_edt(mask) - 0.5, 0.5 - distance_transform_edt(~mask))
    assert ((found > 0) == mask).all()
    assert np.abs(found - exact).max() < 1.5
    assert np.abs(found - exact).mean() < 0.3


def test_outlines_meet_between_the_control_points():
    """A target's disc is wider than the exemplar's; the plain guide is the identity."""
    style, target = disc((200, 200), (100, 100), 60.0), disc((200, 200), (100, 100), 66.0)
    match = EdgeMatch.of(style, reach=20.0, most=15.0)
    nodes = nodes_of((200, 200), 4)
    match.move(nodes, target, 4, 1.0)
    pixels = nodes_of((200, 200), 4)
    away = np.linalg.norm(pixels - 100, axis=-1)
    found = np.linalg.norm(nodes - 100, axis=-1)
    edge = np.abs(away - 66) < 2.5
    assert edge.sum() > 40
    assert np.abs(found - away + 6)[edge].max() < 1.5
    # Far from the edge nothing moves, and nowhere do places change order along a ray.
    assert np.abs(nodes - pixels)[(away < 5) | (away > 130)].max() < 0.1
    middle = nodes[25, 25:, 0]
    assert (np.diff(middle) > 0.5).all()


def test_other_edges_do_not_pull():
    """Where the distances disagree by far, another edge is meant."""
    style, target = disc((200, 200), (60, 60), 20.0), disc((200, 200), (140, 140), 20.0)
    match = EdgeMatch.of(style, reach=20.0, most=10.0)
    nodes = nodes_of((200, 200), 4)
    match.move(nodes, target, 4, 1.0)
    assert np.abs(nodes - nodes_of((200, 200), 4)).max() < 0.9


def test_a_region_that_fills_the_picture_has_no_edge():
    assert EdgeMatch.of(np.ones((40, 40), np.float32), 5.0, 5.0) is None
    assert EdgeMatch.of(np.zeros((40, 40), np.float32), 5.0, 5.0) is None


def test_odd_sizes_and_grids():
    for shape in ((97, 61), (64, 64), (130, 47)):
        for grid in (1, 3, 4):
            mask = disc(shape, (shape[1] / 2, shape[0] / 2), 10.0)
            match = EdgeMatch.of(mask, 10.0, 8.0)
            nodes = nodes_of(shape, grid)
            match.move(nodes, mask, grid, 1.0)
            assert np.isfinite(nodes).all()
            # The same outline on both sides: nothing to move but rounding of the cells.
            assert np.abs(nodes - nodes_of(shape, grid)).max() < 1.6


@pytest.mark.parametrize("aside", [-40, 40])
def test_person_and_background_keep_to_their_sides(aside):
    """The guide is the identity, but the target's disc lies ``aside`` the exemplar's."""
    style, target = disc((200, 200), (100, 100), 30.0), disc((200, 200), (100 + aside, 100), 30.0)
    match = EdgeMatch.of(style, reach=10.0, most=5.0)
    nodes = nodes_of((200, 200), 4)
    away = np.linalg.norm(nodes - (100 + aside, 100), axis=-1)
    # In the very middle of the exemplar's disc all sides are alike.
    middle = np.linalg.norm(nodes - 100, axis=-1) < 14
    match.pull(nodes, signed_distance(target, 4), 4, 1.0, keep=12.0)
    found = np.linalg.norm(nodes - 100, axis=-1)
    assert found[away < 24].max() < 31
    assert found[(away > 36) & (away < 80) & ~middle].min() > 27


def test_body_is_laid_between_its_edges():
    """Two straight necks, one of them beside the face and of another width."""
    points = CANONICAL * 60 + (100, 80)
    pictures = []
    for middle, half in ((100, 30), (125, 20)):
        person = disc((240, 200), (100, 80), 60.0)
        person[120:, middle - half:middle + half] = 1
        pictures.append(Regions(points, person, None))
    style, own = pictures
    nodes = nodes_of((240, 200), 4)
    before = nodes.copy()
    lay_body(nodes, 4, own, style)
    down = (before - own.frame.origin) @ own.frame.down / own.frame.height
    assert (nodes[down < 1.0] == before[down < 1.0]).all()
    low = (down > 1.4) & (before[..., 1] < 225)
    x, found = before[low][:, 0], nodes[low][:, 0]
    inside = np.abs(x - 125) < 20
    assert np.abs(found - (100 + 1.5 * (x - 125)))[inside].max() < 3
    assert np.abs(found - (x - 25 + 10 * np.sign(x - 125)))[~inside].max() < 3
