"""Consistency of views: exact warps give no error, hidden surfaces do not count."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.capture import Camera
from lfportrait.field import Rendering
from lfportrait_eval.metrics import consistency, pair_error, view_pairs, warp

SIZE = 40


def shifted_cameras(count: int, step: float) -> Camera:
    """Parallel cameras, each ``step`` world units further right; focal SIZE, looking along -z."""
    pose = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (count, 1, 1))
    pose[:, 0, 3] = step * np.arange(count)
    return Camera(pose, np.array([SIZE, SIZE]), np.array([SIZE / 2, SIZE / 2]), np.array(SIZE),
                  np.array(SIZE))


def wall(cameras: Camera, depth: float, contrast: float = 1.0, seed: int = 0):
    """Views of a wall with random colors, seen without resampling: one pixel a step."""
    texture = np.random.default_rng(seed).random((SIZE, SIZE + 64, 3)).astype(np.float32)
    texture = 0.5 + contrast * (texture - 0.5)
    pictures, renderings = [], []
    for view in range(len(cameras)):
        moved = round(float(cameras.position[view, 0]) * SIZE / depth)
        picture = texture[:, moved:moved + SIZE].copy()
        pictures.append(picture)
        renderings.append(Rendering(picture, np.ones((SIZE, SIZE), np.float32),
                                    np.full((SIZE, SIZE), depth, np.float32)))
    return pictures, renderings


def test_identical_frames_of_one_camera_agree():
    cameras = shifted_cameras(12, 0.0)
    pictures, renderings = wall(cameras, 4.0)
    figures = consistency(pictures, renderings, cameras)
    assert set(figures) == {"gap_1", "gap_7", "gap_10", "extremes"}
    for row in figures.values():
        assert row["rmse"] == 0 and row["floor_rmse"] == 0 and row["normalised"] == 0
        assert row["valid"] > 0.9
    assert figures["gap_1"]["pairs"] == 11 and figures["extremes"]["pairs"] == 1


@settings(max_examples=15, deadline=None)
@given(depth=st.floats(1.0, 8.0), pixels=st.integers(-3, 3))
def test_a_known_shift_with_known_depth_leaves_no_error(depth, pixels):
    step = depth * abs(pixels) / SIZE
    cameras = shifted_cameras(3, step)
    pictures, renderings = wall(cameras, depth)
    for row in consistency(pictures, renderings, cameras).values():
        assert row["rmse"] < 1e-4
    # Against the wrong depth the same pictures disagree.
    if pixels:
        wrong = [Rendering(r.color, r.alpha, 3 * r.depth) for r in renderings]
        assert consistency(pictures, wrong, cameras)["gap_1"]["rmse"] > 0.05


def test_independent_noise_is_measured_and_its_contrast_taken_out():
    cameras = shifted_cameras(5, 0.1)
    rows = []
    for contrast in (1.0, 0.5):
        pictures, renderings = wall(cameras, 4.0, contrast)
        generator = np.random.default_rng(5)
        noisy = [picture + contrast * 0.1 * generator.standard_normal(picture.shape)
                 for picture in pictures]
        rows.append(consistency(noisy, renderings, cameras, gaps=(1,))["gap_1"])
    assert rows[0]["rmse"] == pytest.approx(0.1 * np.sqrt(2), rel=0.05)
    assert rows[1]["rmse"] == pytest.approx(rows[0]["rmse"] / 2, rel=1e-3)
    assert rows[1]["normalised"] == pytest.approx(rows[0]["normalised"], rel=1e-3)
    assert rows[0]["floor_rmse"] < 1e-6


def test_hidden_surfaces_and_edges_do_not_count():
    cameras = shifted_cameras(2, 0.8)  # the wall at 4 moves by 8 pixels, the square at 2 by 16
    far, near = np.float32(4.0), np.float32(2.0)
    depth = np.full((2, SIZE, SIZE), far)
    depth[0, 10:30, 24:34] = near
    depth[1, 10:30, 8:18] = near
    image = np.repeat((depth == near)[..., None], 3, axis=3).astype(np.float32)
    warped, valid = warp(image[1], cameras, 1, 0, depth[1], depth[0])
    # The square covers columns 16..25 of the wall as the first view sees it.
    assert not valid[12:28, 16:24].any()
    assert valid[12:28, 26:32].all() and valid[2:8, 10:38].all()
    assert np.array_equal(warped[valid], image[0][valid])
    assert not valid[:, 0:7].any()  # out of the second view
    assert not valid[10:30, 23:25].any()  # an edge


def test_a_head_turned_by_cameras_on_an_arc_agrees_with_itself():
    """A ball with a smooth pattern on its surface, seen from an arc: resampling errors only."""
    cameras = Camera.arc(np.linspace(-20, 20, 11), distance=4.0, width=96, height=96, focal=150.0)
    pictures, renderings = [], []
    for view in range(len(cameras)):
        origins, directions = cameras.rays(view)
        b = (origins * directions).sum(1)
        inside = b ** 2 - (origins ** 2).sum(1) + 1.0
        hit = inside > 0
        along = -b - np.sqrt(np.maximum(inside, 0))
        points = origins + along[:, None] * directions
        color = np.where(hit[:, None], 0.5 + 0.4 * np.sin(4 * points), 1.0)
        depth = np.where(hit, along * (directions @ cameras.pose[view, :3, 2]), np.inf)
        shape = (96, 96)
        picture = np.float32(color).reshape(*shape, 3)
        pictures.append(picture)
        renderings.append(Rendering(picture, np.float32(hit).reshape(shape),
                                    np.float32(depth).reshape(shape)))
    figures = consistency(pictures, renderings, cameras)
    for name, row in figures.items():
        assert row["rmse"] < 0.01, name
        assert row["valid"] > (0.35 if name == "extremes" else 0.45)
    # Paint that stays on the screen instead of the surface swims: the figure must see it.
    swimming = [pictures[0]] * len(pictures)
    assert consistency(swimming, renderings, cameras)["gap_7"]["rmse"] > 0.1


def test_flat_and_empty_pairs_are_not_numbers():
    flat = np.full((4, 4, 3), 0.5)
    assert pair_error(flat, flat, np.ones((4, 4), bool))[0] == 0
    assert np.isnan(pair_error(flat, flat, np.ones((4, 4), bool))[1])
    assert np.isnan(pair_error(flat, flat, np.zeros((4, 4), bool))).all()
    assert view_pairs(4, 2) == [(0, 2), (1, 3)] and view_pairs(3, 5) == []


def test_sequences_must_have_one_length():
    cameras = shifted_cameras(3, 0.1)
    pictures, renderings = wall(cameras, 4.0)
    with pytest.raises(ValueError, match="one entry each"):
        consistency(pictures[:2], renderings, cameras)
