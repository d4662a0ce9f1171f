"""Hot loops of the atlas against their plain forms, on random charts of a ball."""

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.example.kernels import atlas
from tests.reference import atlas as plain

CELL, LOW = 0.21, np.array([-0.7, -0.75, -0.65])
BEFORE, BEHIND = 0.05, 0.2


@pytest.fixture(scope="module")
def problem():
    """Four charts of an uneven ball with holes, cut to parts and laid side by side."""
    random = np.random.default_rng(0)
    cameras = Camera.arc(np.array([0.0, 70.0, -50.0, 180.0]), distance=9.0, width=44, height=40,
                         focal=300.0, pitch=8.0)
    rows = np.stack([cameras.row(n) for n in range(4)])
    boxes, depths = np.zeros((4, 6), np.int64), np.full((50, 190), np.inf, np.float32)
    own, points = np.full(depths.shape, -1, np.int8), np.full((50, 190, 3), np.nan, np.float32)
    for n in range(4):
        x0, y0, x1, y1 = random.integers(0, 6), random.integers(0, 6), 44 - n, 39 - n
        dx, dy = 46 * n + 3 - x0, 5 - y0 + n
        origins, directions = cameras.rays(n)
        across = (origins * directions).sum(1)
        root = across ** 2 - (origins ** 2).sum(1) + 0.36
        along = -across - np.sqrt(np.where(root > 0, root, np.nan))
        depth = (along * (directions @ cameras.pose[n, :3, 2])).reshape(40, 44)
        depth += random.normal(0, 0.02, depth.shape)
        depth[random.random(depth.shape) < 0.05] = np.nan
        depth = np.where(np.isfinite(depth), depth, np.inf).astype(np.float32)
        there = slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)
        boxes[n] = x0, y0, x1, y1, dx, dy
        depths[there], own[there] = depth[y0:y1, x0:x1], n
        points[there] = plain.lift_points(depth, rows[n])[y0:y1, x0:x1]
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, 7)] * 3, indexing="ij")
    grid = np.stack([x, y, z], -1) + random.normal(0, 0.2, (7, 7, 7, 3))
    bias = np.array([0.3, 0, 0, 0])
    return rows, bias, boxes, depths, own, points, grid.astype(np.float32)


@pytest.mark.parametrize("shape", [(9, 7), (1, 5), (6, 1)])
def test_normals_come_from_near_neighbours(shape):
    random = np.random.default_rng(1)
    y, x = np.mgrid[:shape[0], :shape[1]].astype(float)
    points = np.stack([x, -y, random.normal(0, 1, shape)], axis=-1).astype(np.float32)
    points[random.random(shape) < 0.2] = np.nan
    out = np.zeros(points.shape, np.float32)
    atlas.surface_normals(points, 2.0, out)
    assert np.allclose(out, plain.surface_normals(points, 2.0), atol=1e-6, equal_nan=True)


def test_normals_of_a_slope_lie_towards_the_viewer():
    y, x = np.mgrid[:6, :8] / 10
    points = np.stack([x, -y, 0.5 * x], axis=-1).astype(np.float32)
    out = np.empty(points.shape, np.float32)
    atlas.surface_normals(points, 0.2, out)
    assert np.allclose(out, np.array([-0.5, 0, 1]) / np.sqrt(1.25), atol=1e-5)


def test_normals_are_summed_in_the_cells_that_hold_them():
    random = np.random.default_rng(2)
    points = random.uniform(-1, 1, (23, 17, 3)).astype(np.float32)
    normals = random.normal(0, 1, points.shape).astype(np.float32)
    normals[random.random((23, 17)) < 0.2] = np.nan
    # Some points lie right below the grid, some beyond its end.
    low = np.array([-0.9, -0.95, -0.8])
    sums = random.random((5, 6, 7, 3)).astype(np.float32)
    wanted = plain.sum_normals(points, normals, low, 0.25, sums)
    atlas.sum_normals(points, normals, low, 0.25, sums)
    assert np.allclose(sums, wanted, atol=1e-5)


def test_the_large_shape_is_smooth_and_goes_on_beyond_its_grid():
    random = np.random.default_rng(3)
    grid = random.normal(0, 1, (4, 5, 6, 3)).astype(np.float32)
    points = random.uniform(-1.5, 1.5, (300, 3)).astype(np.float32)
    points[:2] = LOW + CELL / 2, LOW + CELL * np.array([5.5, 4.5, 3.5])
    out = np.empty_like(points)
    atlas.smooth_normals(points, grid, LOW, CELL, out)
    assert np.allclose(out, plain.smooth_normals(points, grid, LOW, CELL), atol=0.01)
    assert np.allclose(np.linalg.norm(out, axis=1), 1, atol=1e-5)
    atlas.smooth_normals(points, np.zeros_like(grid), LOW, CELL, out)
    assert np.array_equal(out, np.broadcast_to(np.float32([0, 0, 1]), out.shape))


def test_points_lie_at_their_depths(problem):
    rows, *_ = problem
    depth = np.random.default_rng(4).uniform(1, 3, (11, 14)).astype(np.float32)
    depth[3, 4] = depth[0, 13] = np.inf
    out = np.zeros((11, 14, 3), np.float32)
    atlas.lift_points(depth, rows[1], out)
    assert np.allclose(out, plain.lift_points(depth, rows[1]), atol=1e-5, equal_nan=True)
    pixels, found = plain.project(rows[1], out[5].astype(np.float64))
    assert np.allclose(found, depth[5], atol=1e-5)
    assert np.allclose(pixels - 0.5, np.stack([np.arange(14), np.full(14, 5)], 1), atol=1e-3)


def test_a_point_is_owned_by_the_chart_that_it_faces_most(problem):
    rows, bias, boxes, depths, own, points, grid = problem
    charts = plain.Charts(rows, bias, boxes, depths)
    owner = np.full(own.shape, -7, np.int32)
    atlas.find_owners(points, grid, LOW, CELL, own, rows, bias, boxes, depths, 0.1, owner)
    normals = plain.smooth_normals(np.nan_to_num(points.reshape(-1, 3)), grid, LOW, CELL)
    wanted = charts.owners(points, normals, own, 0.1)
    assert np.array_equal(owner, wanted)
    index = np.arange(owner.size).reshape(owner.shape)
    assert (owner < 0).sum() > 1000
    assert (owner == index).sum() > 1000 and ((owner >= 0) & (owner != index)).sum() > 500


def test_points_under_the_surface_are_brought_up(problem):
    rows, bias, boxes, depths, _, points, grid = problem
    random = np.random.default_rng(5)
    flat = points.reshape(-1, 3)
    flat = flat[np.isfinite(flat[:, 0])]
    # From within to before the surface, and some that lie nowhere near.
    asked = flat * random.uniform(0.5, 1.15, (len(flat), 1))
    asked = np.concatenate([asked, random.uniform(-3, 3, (50, 3))]).astype(np.float32)
    places, depth = np.zeros((len(asked), 2), np.float32), np.zeros(len(asked), np.float32)
    atlas.locate(asked, grid, LOW, CELL, rows, bias, boxes, depths, BEFORE, BEHIND, places, depth)
    normals = plain.smooth_normals(asked, grid, LOW, CELL)
    wanted, under = plain.Charts(rows, bias, boxes, depths).locate(
        asked.astype(np.float64), normals, BEFORE, BEHIND)
    assert np.allclose(places, wanted, atol=1e-3, equal_nan=True)
    assert np.allclose(depth, under, atol=1e-5, equal_nan=True)
    known = np.isfinite(places[:, 0])
    assert 0.3 < known.mean() < 0.95
    assert depth[known].min() < -0.3 * BEFORE and depth[known].max() > 0.5 * BEHIND


def test_the_best_camera_is_the_one_that_a_normal_points_at():
    random = np.random.default_rng(6)
    points = random.normal(0, 1, (70, 3)).astype(np.float32)
    normals = plain.unit(random.normal(0, 1, (70, 3))).astype(np.float32)
    positions = random.normal(0, 4, (5, 3))
    out = np.empty(70, np.float32)
    atlas.best_facing(points, normals, positions, out)
    assert np.allclose(out, plain.best_facing(points, normals, positions), atol=1e-5)
    atlas.best_facing(points, normals, positions[:0], out)
    assert (out == -1).all()


@pytest.mark.parametrize("margin", [1, 4])
def test_the_fringe_takes_its_owner_from_the_nearest_pixel(margin):
    random = np.random.default_rng(7)
    owner = np.where(random.random((19, 23)) < 0.06, random.integers(0, 400, (19, 23)), -1)
    owner = owner.astype(np.int32)
    out = owner.copy()
    atlas.fringe(owner, margin, out)
    assert np.array_equal(out, plain.fringe(owner, margin))
    assert (out < 0).any() and (out >= 0).sum() > 2 * (owner >= 0).sum()


@pytest.mark.parametrize("kind", [np.float32, np.int32])
def test_copies_take_over_their_owners_values(kind):
    random = np.random.default_rng(8)
    values = (100 * random.random((12, 9, 2))).astype(kind)
    size = 12 * 9
    owner = np.where(random.random(size) < 0.4, np.arange(size), -1)
    owners = np.flatnonzero(owner >= 0)
    copies = (owner < 0) & (random.random(size) < 0.7)
    owner[copies] = random.choice(owners, copies.sum())
    wanted = values.reshape(size, 2).copy()
    wanted[owner >= 0] = wanted[owner[owner >= 0]]
    atlas.exchange(owner.reshape(12, 9).astype(np.int32), values)
    assert np.array_equal(values, wanted.reshape(12, 9, 2))


def test_colors_between_pixels_are_blended_and_the_unknown_left():
    random = np.random.default_rng(9)
    colors = random.random((13, 8, 3)).astype(np.float32)
    places = random.uniform(-2, 15, (200, 2)).astype(np.float32)
    places[:4] = (0.5, 0.5), (7.5, 12.5), (8.0, 13.0), (3.5, 4.5)
    places[10:20, 0] = np.nan
    out = np.full((200, 3), 7, np.float32)
    atlas.look_up_colors(colors, places, out)
    wanted = plain.bilinear(colors, np.nan_to_num(places) - 0.5)
    wanted[10:20] = 7
    assert np.allclose(out, wanted, atol=1e-5)
    assert np.array_equal(out[3], colors[4, 3]) and np.array_equal(out[1], colors[12, 7])


def test_nodes_are_blended_and_their_border_goes_on():
    random = np.random.default_rng(10)
    nodes = random.random((6, 5, 4)).astype(np.float32)
    low, spacing = np.array([-0.3, 0.2]), 0.15
    places = random.uniform(-1, 2, (200, 2)).astype(np.float32)
    places[:2] = low, low + spacing * np.array([4, 5])
    out = np.full((200, 4), np.nan, np.float32)
    atlas.sample_nodes(nodes, low, spacing, places, out)
    assert np.allclose(out, plain.bilinear(nodes, (places - low) / spacing), atol=1e-5)
    assert np.allclose(out[:2], [nodes[0, 0], nodes[5, 4]], atol=1e-5)


def test_lists_are_spread_over_the_pixels_that_name_them():
    random = np.random.default_rng(11)
    values = random.random((30, 3)).astype(np.float32)
    slots = random.integers(-1, 30, (9, 14)).astype(np.int32)
    out = np.empty((9, 14, 3), np.float32)
    atlas.spread(values, slots, np.float32(5), out)
    assert np.array_equal(out, np.where(slots[..., None] >= 0, values[slots], np.float32(5)))
