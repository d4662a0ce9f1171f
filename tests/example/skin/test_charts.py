"""Charts of a head: each surface point has one owner, and is found again."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lfportrait.errors import UserError
from lfportrait.example.skin.charts import ALIGN, DISTANCE, MARGIN, draw_atlas
from lfportrait.field import VoxelField
from tests.example.skin.conftest import PIXELS

VOXEL = 2 / 48


def box_slices(box):
    x0, y0, x1, y1, dx, dy = box
    return slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)


def test_charts_lie_side_by_side_and_show_what_their_cameras_see(field, skin):
    atlas = skin.atlas
    count = np.zeros(atlas.depth.shape, int)
    assert atlas.depth.shape[0] % ALIGN == atlas.depth.shape[1] % ALIGN == 0
    assert 6 <= len(atlas.cameras) == len(atlas.boxes) <= 8
    for n, box in enumerate(atlas.boxes.tolist()):
        there = box_slices(box)
        count[there] += 1
        assert (box[0] + box[4]) % ALIGN == (box[1] + box[5]) % ALIGN == 0
        seen = np.isfinite(atlas.depth[there])
        pixels, depth = atlas.cameras[n].project(atlas.points[there][seen])
        rows, columns = np.nonzero(seen)
        assert np.allclose(pixels[0] - 0.5, np.stack([columns, rows], 1) + box[:2], atol=0.01)
        assert np.allclose(depth[0], atlas.depth[there][seen], atol=1e-4)
    assert count.max() == 1
    assert not np.isfinite(atlas.depth[count == 0]).any()
    assert np.array_equal(np.isfinite(atlas.depth), np.isfinite(atlas.points[..., 0]))
    shot = field.render(atlas.cameras[0], 0, background=0.0, step=1.0)
    x0, y0, x1, y1, _, _ = atlas.boxes[0]
    seen = np.isfinite(atlas.depth[box_slices(atlas.boxes[0])])
    assert np.allclose(atlas.depth[box_slices(atlas.boxes[0])][seen],
                       shot.depth[y0:y1, x0:x1][seen], atol=1e-4)


def test_charts_show_the_surface(skin, points):
    ball = points[:, 1] > -0.25
    assert np.abs(np.linalg.norm(points[ball], axis=1) - 0.6).max() < VOXEL
    neck = (points[:, 1] < -0.5) & (points[:, 1] > -0.75)
    assert np.abs(np.hypot(points[neck, 0], points[neck, 2]) - 0.396).max() < VOXEL
    normals = skin.atlas.shape.at(points)
    assert (normals[ball] * points[ball]).sum(1).min() > 0.6 * np.cos(np.radians(25))


def test_each_surface_point_has_one_owner(skin, points):
    atlas = skin.atlas
    owner, flat = atlas.owner, atlas.owner.ravel()
    assert np.array_equal(flat[flat[flat >= 0]], flat[flat >= 0])
    surface = np.isfinite(atlas.depth)
    assert (owner[surface] >= 0).all() and surface.ravel()[flat[flat >= 0]].all()
    copies = surface & ~atlas.own
    assert copies.sum() > 0.3 * surface.sum()
    away = np.linalg.norm(atlas.points[copies]
                          - atlas.points.reshape(-1, 3)[owner[copies]], axis=1)
    assert np.median(away) < 1 / PIXELS
    # Where two charts see it from the side, a pixel's depth is what a voxel or two allow.
    assert away.max() < 2.5 * VOXEL + 1.5 / PIXELS
    # Were a place owned twice, another chart's pixel would lie within a pixel of it.
    chart = np.zeros(owner.shape, int)
    for n, box in enumerate(atlas.boxes.tolist()):
        chart[box_slices(box)] = n
    chart = chart.ravel()[skin.index]
    twice = sum((cKDTree(points[chart != n]).query(points[chart == n])[0] < 0.7 / PIXELS).sum()
                for n in range(len(atlas.boxes)))
    assert twice < 0.05 * len(points)


def test_the_whole_head_is_on_the_charts(skin, points):
    angle = np.random.default_rng(0).normal(0, 1, (500, 3))
    ball = 0.6 * angle / np.linalg.norm(angle, axis=1)[:, None]
    ball = ball[ball[:, 1] > -0.25]
    assert cKDTree(points).query(ball)[0].max() < VOXEL + 1.5 / PIXELS
    own = skin.atlas.own[box_slices(skin.atlas.boxes[0])]
    assert own.sum() > 0.2 * len(points)  # the front chart has the face and more


def test_beside_the_surface_the_nearest_pixel_owns(skin):
    atlas = skin.atlas
    beside = (atlas.owner >= 0) & ~np.isfinite(atlas.depth)
    assert beside.any()
    surface = np.isfinite(atlas.depth)
    y, x = np.nonzero(beside)
    near = np.zeros(len(y), bool)
    for away in range(1, MARGIN + 1):
        for dy, dx in ((0, away), (0, -away), (away, 0), (-away, 0)):
            j, i = (np.clip(a, 0, n - 1) for a, n in zip((y + dy, x + dx), beside.shape))
            near |= surface[j, i] & (atlas.owner[j, i] == atlas.owner[y, x])
    assert near.all()


def test_surface_points_are_located_where_they_are_shown(skin, points):
    atlas = skin.atlas
    # Along the sharp edge of the cut below, one side of it lies a little under the other.
    chosen = points[:, 1] > -0.9
    places, depth = atlas.locate(points[chosen].astype(np.float32), 2.5 * VOXEL, 7 * VOXEL)
    assert places.dtype == depth.dtype == np.float32
    assert np.isfinite(places).all() and np.isfinite(depth).all()
    shown = atlas.points[places[:, 1].astype(int), places[:, 0].astype(int)]
    away = np.linalg.norm(shown - points[chosen], axis=1)
    assert np.quantile(away, 0.999) < 1 / PIXELS
    rows, columns = np.divmod(skin.index[chosen], atlas.depth.shape[1])
    same = np.abs(places - np.stack([columns, rows], 1) - 0.5).max(axis=1) < 0.05
    assert same.mean() > 0.99
    assert np.abs(depth[same]).max() < 1e-3


@pytest.mark.parametrize("under", [-0.05, 0.06, 0.12])
def test_points_above_and_under_the_surface_find_the_place_over_them(skin, points, under):
    ball = points[points[:, 1] > -0.15][::7]
    moved = ball * (1 - under / 0.6)
    places, depth = skin.atlas.locate(moved.astype(np.float32), 2.5 * VOXEL, 7 * VOXEL)
    known = np.isfinite(places[:, 0])
    assert known.mean() > 0.98
    shown = skin.atlas.points[places[known, 1].astype(int), places[known, 0].astype(int)]
    away = np.linalg.norm(shown - ball[known], axis=1)
    assert np.nanquantile(away, 0.9) < abs(under) / 2 + 1.5 / PIXELS
    assert np.abs(np.median(depth[known]) - under) < 0.02


def test_points_far_from_the_surface_have_no_place(skin):
    far = np.float32([[0, 0, 0], [0, 0.1, 0.9], [5, 0, 0], [0, 0, DISTANCE + 3]])
    places, depth = skin.atlas.locate(far, 2.5 * VOXEL, 7 * VOXEL)
    assert np.isnan(places).all() and np.isnan(depth).all()


def test_an_empty_field_is_told(field):
    empty = VoxelField(field.links, np.zeros_like(field.density), field.sh)
    with pytest.raises(UserError, match="empty"):
        draw_atlas(empty, PIXELS)
