"""A room's surfaces from a plane sweep, and the exposures of its photos."""

import cv2
import numpy as np
import pytest
from scipy import ndimage

from lfportrait.capture import Camera, Capture
from lfportrait.field.geometry.exposure import exposure_gains
from lfportrait.field.geometry.sweep import fuse, scene_box, small_view, sweep_depth
from lfportrait.field.kernels.depth_maps import (
    facing_cosines,
    fuse_depth,
    hull_along_rays,
    match_planes,
    places_shown,
    surface_agreement,
)

GAINS = 1.0 + 0.2 * np.sin(np.arange(9))


def noise(x, y, random, size=2.0):
    """A smooth texture over the plane, in [0, 1]."""
    waves = random.standard_normal((40, 2)) * 9.0
    phase = random.uniform(0, 2 * np.pi, 40)
    total = sum(np.sin(a * x + b * y + p) for (a, b), p in zip(waves, phase))
    return np.clip(0.5 + 0.09 * total, 0.05, 0.95)


@pytest.fixture(scope="module")
def room():
    """Nine photos of a textured wall at z = -0.5 and a nearer board at z = 0.3."""
    cameras = Camera.arc(np.linspace(-24, 24, 9), distance=3.0, width=160, height=120, focal=150.0)
    images = []
    for view in range(9):
        origins, directions = cameras.rays(view)
        image = np.zeros((len(directions), 3))
        for z, edge, seed in ((-0.5, np.inf, 1), (0.3, 0.5, 2)):
            t = (z - origins[..., 2]) / directions[:, 2]
            point = origins + t[:, None] * directions
            there = (abs(point[:, 0]) < edge) & (abs(point[:, 1]) < edge)
            for channel in range(3):
                random = np.random.default_rng(10 * seed + channel)
                value = noise(point[:, 0], point[:, 1], random)
                image[there, channel] = value[there]
        image = 0.75 * image * GAINS[view]
        images.append(np.uint8(np.clip(image, 0, 1).reshape(120, 160, 3) * 255 + 0.5))
    return Capture(cameras, images, None, [f"{i}.png" for i in range(9)], np.arange(9) == 4)


def test_depth_lies_on_the_wall_and_the_board(room):
    maps = sweep_depth(room, room.training())
    assert np.mean([np.isfinite(item.depth).mean() for item in maps]) > 0.5
    z = np.concatenate([item.points() for item in maps])[:, 2]
    assert np.mean((abs(z + 0.5) < 0.08) | (abs(z - 0.3) < 0.08)) > 0.9


def test_surfaces_are_kept_and_open_space_is_not(room):
    maps = sweep_depth(room, room.training())
    _, radius = scene_box(maps, 1.0, 2.0)
    assert (radius <= 2.0).all() and (radius >= 1.0).all()
    surfaces = fuse(maps, 32, np.zeros(3), np.ones(3))
    axis = 2 * (np.arange(32) + 0.5) / 32 - 1
    middle = abs(axis) < 0.3
    column = surfaces.keep[:, middle][:, :, middle].mean(axis=(1, 2))
    assert column[abs(axis - 0.3).argmin()] > 0.9
    assert column[(axis > 0.6) & (axis < 0.95)].mean() < 0.1
    assert surfaces.solid.sum() > 500
    assert not surfaces.color[~surfaces.solid].any()


def test_exposures_are_found_for_all_photos(room):
    maps = sweep_depth(room, room.training())
    gains, others = exposure_gains(maps, [small_view(room, 4)])
    truth = GAINS / np.exp(np.log(np.delete(GAINS, 4)).mean())
    assert abs(gains / np.delete(truth, 4)[:, None] - 1).max() < 0.04
    assert abs(others / truth[4] - 1).max() < 0.04


def test_votes_equal_the_reference():
    random = np.random.default_rng(0)
    camera = Camera.arc([25.0], distance=2.0, width=12, height=9, focal=10.0)
    row = np.concatenate([camera.pose[0, :3].ravel(), camera.focal[0], camera.center[0]])
    depth = random.uniform(1.2, 2.8, (9, 12)).astype(np.float32)
    sure = random.random((9, 12)) < 0.6
    image = random.random((9, 12, 3)).astype(np.float32)
    axis = np.linspace(-0.9, 0.9, 7)
    empty, solid, unsure = (np.zeros((7, 7, 7), np.int16) for _ in range(3))
    color = np.zeros((7, 7, 7, 3), np.float32)
    fuse_depth(axis, axis, axis, row, depth, sure, image, 0.2, 0.15, empty, solid, unsure, color)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    pixels, along = camera.project(np.stack([x, y, z], -1).reshape(-1, 3))
    column, line = (np.floor(pixels[0, :, i]).astype(int) for i in (0, 1))
    inside = (along[0] > 0) & (column >= 0) & (column < 12) & (line >= 0) & (line < 9)
    there = depth[np.clip(line, 0, 8), np.clip(column, 0, 11)]
    known = sure[np.clip(line, 0, 8), np.clip(column, 0, 11)]
    thick = np.where(known, 0.2, np.maximum(0.2, 0.15 * there))
    ahead, within = along[0] < there - thick, along[0] < there + thick
    assert np.array_equal(empty.ravel(), inside & ahead)
    assert np.array_equal(solid.ravel(), inside & ~ahead & within & known)
    assert np.array_equal(unsure.ravel(), inside & ~ahead & within & ~known)
    seen = solid.ravel() > 0
    assert np.allclose(color.reshape(-1, 3)[seen], image[line[seen], column[seen]])


@pytest.mark.parametrize("others, ranks", [(1, 1), (3, 1), (4, 2)])
def test_planes_are_matched_as_by_the_reference(others, ranks):
    random = np.random.default_rng(others)
    height, width, planes = 17, 26, 5
    reference = random.random((height, width)).astype(np.float32)
    sizes = np.array([(19, 30), (15, 22), (20, 26), (17, 31)])[:others]
    pictures = np.zeros((others, 20, 31), np.float32)
    for picture, (high, wide) in zip(pictures, sizes):
        picture[:high, :wide] = ndimage.gaussian_filter(random.random((high, wide)), 0.7)
    warps = np.eye(3) + random.normal(0, 0.02, (planes, others, 3, 3))
    warps[..., :2, 2] += random.uniform(-3, 3, (planes, others, 2))
    warps[..., 2, :2] *= 0.02

    def mean(picture, window=7):
        return cv2.boxFilter(np.asarray(picture, np.float64), -1, (window, window))

    own = mean(reference)
    spread = mean(reference.astype(float) ** 2) - own ** 2
    pixels = np.stack([*np.meshgrid(np.arange(width), np.arange(height)),
                       np.ones((height, width))], -1)
    scores = np.empty((planes, height, width))
    for plane in range(planes):
        found = []
        for picture, (high, wide), warp in zip(pictures, sizes, warps[plane]):
            there = pixels @ warp.T
            x, y = there[..., 0] / there[..., 2], there[..., 1] / there[..., 2]
            inside = (x >= 0) & (y >= 0) & (x < wide - 1) & (y < high - 1)
            moved = np.where(inside, ndimage.map_coordinates(
                picture.astype(float), [y, x], order=1), -10.0)
            level = mean(moved)
            both = np.maximum(spread * (mean(moved ** 2) - level ** 2), 1e-8)
            found.append(np.where(inside, (mean(reference * moved) - own * level)
                                  / np.sqrt(both), -1.0))
        scores[plane] = mean(np.sort(found, axis=0)[-ranks:].mean(axis=0), 3)
    scratch = tuple(np.full(shape, np.nan, np.float32) for shape in (
        (height, width), (height, width), (ranks, height, width), (3, width + 8), (3, width),
        (2, width), width))
    top, below, above = np.empty((3, height, width), np.float32)
    winner = np.empty((height, width), np.int32)
    match_planes(reference, own.astype(np.float32), spread.astype(np.float32), pictures, sizes,
                 warps, scratch, top, winner, below, above)
    assert np.array_equal(winner, scores.argmax(axis=0))
    assert len(np.unique(winner)) == planes
    assert np.abs(top - scores.max(axis=0)).max() < 1e-4
    inner = (winner > 0) & (winner < planes - 1)
    for near, step in ((below, -1), (above, 1)):
        wanted = np.take_along_axis(scores, np.clip(winner + step, 0, planes - 1)[None], 0)[0]
        assert np.abs(near - wanted)[inner].max() < 1e-4


@pytest.mark.parametrize("beside", [2, 4])
def test_pictures_agree_on_a_surface_as_by_the_reference(beside):
    random = np.random.default_rng(beside)
    height, width, count = 13, 22, 3
    cameras = Camera.arc([-20.0, 5.0, 30.0], distance=2.5, width=24, height=18, focal=26.0)
    rows = np.stack([np.concatenate([cameras.pose[k, :3].ravel(), cameras.focal[k],
                                     cameras.center[k]]) for k in range(count)])
    y, x = np.meshgrid(np.linspace(0.9, -0.9, height), np.linspace(-1.2, 1.2, width),
                       indexing="ij")
    points = np.stack([x, y, 0.3 * np.cos(2 * x)], axis=-1)
    points[0, 0] = 9.0  # behind the cameras
    sizes = np.array([(18, 24), (17, 23), (18, 20)])
    pictures = np.zeros((count, 18, 24), np.float32)
    for picture, (high, wide) in zip(pictures, sizes):
        picture[:high, :wide] = random.random((high, wide))
    weights = random.random((count, height, width)).astype(np.float32)

    def mean(picture):
        return cv2.boxFilter(np.asarray(picture, np.float64), -1, (2 * beside + 1,) * 2)

    pixels, along = cameras.project(points.reshape(-1, 3))
    levels, shares = np.zeros((2, count, height, width))
    for k, (high, wide) in enumerate(sizes):
        u, v = (pixels[k].reshape(height, width, 2) - 0.5).transpose(2, 0, 1)
        inside = ((along[k].reshape(height, width) > 0) & (u >= 0) & (v >= 0) & (u < wide - 1)
                  & (v < high - 1))
        level = np.where(inside, ndimage.map_coordinates(pictures[k].astype(float), [v, u],
                                                         order=1), 0.0)
        levels[k], shares[k] = level - mean(level), np.where(inside, weights[k], 0.0)
    assert 0.2 < (shares > 0).mean() < 0.9
    total = shares.sum(axis=0)
    common = (shares * levels).sum(axis=0) / np.maximum(total, 1e-6)
    own = mean(common ** 2)
    score = sum(share * mean(level * common)
                / np.sqrt(np.maximum(mean(level ** 2) * own, 1e-12))
                for level, share in zip(levels, shares))
    values = np.full((2, count, height, width), np.nan, np.float32)
    found = np.full((3, height, width), np.nan, np.float32)
    scratch = tuple(np.full(shape, np.nan, np.float32) for shape in (
        (height, width), (2, width + 8), (2, width)))
    surface_agreement(points, rows, pictures, sizes, weights, beside, scratch, values, *found)
    assert np.abs(values[0] - levels).max() < 1e-5
    assert np.abs(values[1] - shares).max() < 1e-6
    for ours, theirs in zip(found, (score, total, own)):
        assert np.abs(ours - theirs).max() < 1e-4


@pytest.mark.parametrize("before, square, outside", [(0.3, 0.0, False), (0.3, 0.4, True),
                                                  (-1.0, 0.0, False)])
def test_places_that_a_view_shows_are_those_of_the_reference(before, square, outside):
    random = np.random.default_rng(3)
    camera = Camera.arc([25.0], distance=2.0, width=24, height=18, focal=20.0)
    row = np.concatenate([camera.pose[0, :3].ravel(), camera.focal[0], camera.center[0]])
    nearest = random.uniform(1.2, 2.2, (18, 24)).astype(np.float32)
    farthest = nearest + random.uniform(0, 0.4, (18, 24)).astype(np.float32)
    farthest[3:6] = np.inf
    nearest[3:5] = np.inf
    cosines = random.random((18, 24)).astype(np.float32)
    points = random.uniform(-1.4, 1.4, (4000, 3))
    outwards = random.normal(size=(4000, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    pixels, along = (part[0] for part in camera.project(points))
    column, line = np.floor(pixels).astype(int).T
    wanted = (along > 0) & (column >= 0) & (column < 24) & (line >= 0) & (line < 18)
    assert 0.1 < wanted.mean() < 0.9
    place = np.clip(line, 0, 17), np.clip(column, 0, 23)
    wanted &= along < farthest[place] + np.float32(0.1)
    if before >= 0:
        wanted &= along > nearest[place] - np.float32(before)
    if square:
        wanted &= cosines[place] > square
    if outside:
        away = camera.position[0] - points
        wanted &= (away * outwards).sum(axis=1) > 0.2 * np.linalg.norm(away, axis=1)
    shown = np.empty(len(points), bool)
    places_shown(points, row, nearest, farthest, np.float32(before), np.float32(0.1), cosines,
                 square, outwards if outside else np.zeros((0, 3)), 0.2, shown)
    assert np.array_equal(shown, wanted)
    assert 0.005 < shown.mean() < 0.5


def test_how_squarely_a_camera_looks_is_what_the_reference_says():
    random = np.random.default_rng(1)
    camera = Camera.arc([30.0], distance=2.0, width=24, height=18, focal=20.0)
    points = random.uniform(-0.6, 0.6, (900, 3))
    points[:3] = camera.position[0] + [[0.0, 0, 0], [0.1, 0, 0], [9.0, 0, 9.0]]  # at, behind it
    normals = random.normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    (pixels,), (depth,) = camera.project(points)
    before = depth > 0.05 * depth.mean()
    assert (~before).sum() == 3
    away = camera.position[0] - points
    with np.errstate(invalid="ignore"):
        wanted = (away * normals).sum(axis=1) / np.linalg.norm(away, axis=1)
    spread = pixels - camera.center[0]
    spread -= spread[before].min(axis=0)
    for cell, blocks in ((0.02, 200), (0.02, 8)):  # in the second there are too few blocks
        block = max(3.0 * cell * 20.0 / depth.mean(), spread[before].max() / (blocks - 1))
        nearest, cosines = np.full((blocks, blocks), np.nan), np.empty(900)
        with np.errstate(invalid="ignore"):
            facing_cosines(points, normals, camera.row(0), cell, np.empty((3, 900)), nearest,
                           cosines)
        hidden = ~before
        for k in np.flatnonzero(before):
            same = before & (spread // block == spread[k] // block).all(axis=1)
            hidden[k] = depth[k] > depth[same].min() + 5.0 * cell
        assert 0.05 < hidden.mean() < 0.99
        assert np.allclose(cosines, np.where(hidden, -1.0, wanted), atol=1e-9)


def test_a_hull_ends_where_mattes_rule_a_ray_out():
    random = np.random.default_rng(2)
    cameras = Camera.arc(np.linspace(-60, 60, 7), distance=2.5, width=32, height=24, focal=30.0)
    y, x = np.mgrid[:24, :32]
    mattes = np.zeros((7, 24, 32), np.float32)
    for matte in mattes:
        matte[np.hypot(x + 0.5 - 16, y + 0.5 - 12) < random.uniform(5, 9)] = 255.0
    sizes = np.tile([24, 32], (7, 1))
    sizes[2] = 20, 30
    origins = np.column_stack([np.zeros(3), [-0.3, 0.0, 5.0], np.zeros(3)])
    turn = np.linspace(-np.pi, np.pi, 11)
    rays = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], axis=-1)[None].repeat(3, axis=0)
    reach = random.uniform(0.8, 1.6, (3, 11))
    shares, found = np.linspace(0.3, 1.0, 15), np.full((3, 11), -1.0)
    hull_along_rays(origins, rays, reach, shares, np.stack([cameras.row(k) for k in range(7)]),
                    mattes, sizes, 3, found)

    def ruled_out(point):
        pixels, depth = (part[:, 0] for part in cameras.project(point[None]))
        at = np.floor(pixels).astype(int)
        seen = (depth > 0) & (at >= 0).all(axis=1) & (at < sizes[:, ::-1]).all(axis=1)
        against = sum(seen[k] and mattes[k, at[k, 1], at[k, 0]] < 127 for k in range(7))
        return against > 0.06 * seen.sum() and seen.sum() >= 0.4 * 7

    for v in range(3):
        for u in range(11):
            out = [ruled_out(origins[v] + share * reach[v, u] * rays[v, u]) for share in shares]
            if not any(out):
                assert np.isnan(found[v, u])
                continue
            first = out.index(True)
            low, high = shares[max(first - 1, 0)], shares[first]
            for _ in range(3):
                middle = 0.5 * (low + high)
                beyond = ruled_out(origins[v] + middle * reach[v, u] * rays[v, u])
                low, high = (low, middle) if beyond else (middle, high)
            assert found[v, u] == pytest.approx(low * reach[v, u])
    assert 3 < np.isnan(found).sum() < 30
