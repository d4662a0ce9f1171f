"""Corrections of the cameras while a field is trained."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lfportrait.capture import Camera, Capture, pose_corrections, without_drift
from lfportrait.field import ReconstructConfig, VoxelField, reconstruct_with_figures
from lfportrait.field.kernels.render import pose_equations
from lfportrait.field.training.poses import aligned
from lfportrait.field.training.trainer import Trainer

TINY = ReconstructConfig(resolutions=(40, 80), rays=(0.12, 0.4), batch=(2048,))


def shaken(cameras, degrees=0.3, share=0.005, seed=0):
    """Cameras turned about random axes and moved by a share of their distance."""
    random = np.random.default_rng(seed)
    axes, ways = random.standard_normal((2, len(cameras), 3))
    axes *= np.radians(degrees) / np.linalg.norm(axes, axis=1, keepdims=True)
    ways *= share / np.linalg.norm(ways, axis=1, keepdims=True)
    pose = cameras.pose.copy()
    pose[:, :3, :3] = pose[:, :3, :3] @ Rotation.from_rotvec(axes).as_matrix()
    pose[:, :3, 3] += ways * np.linalg.norm(cameras.position, axis=1, keepdims=True)
    return replace(cameras, pose=pose)


def knobbly_field(size=80):
    """A solid with knobs, in soft bright patterns."""
    axis = 2 * (np.arange(size) + 0.5) / size - 1
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    filled = np.sqrt(x * x + y * y + z * z) < 0.6 + 0.2 * np.sin(6 * x) * np.sin(6 * y + 1)
    links = np.where(filled, np.cumsum(filled).reshape(filled.shape) - 1, -1).astype(np.int32)
    places = np.stack([x[filled], y[filled], z[filled]], 1)
    waves = np.random.default_rng(4).normal(0, 9, (3, 3, 3))
    sh = 0.6 * np.sin(np.einsum("cwk,nk->ncw", waves, places)).sum(2, keepdims=True)
    return VoxelField(links, np.full(len(places), 60.0, np.float32), sh.astype(np.float32))


@functools.cache
def rendered_capture(count=32, size=144):
    """Views of a solid from all around. Not to be changed."""
    field = knobbly_field()
    away = np.random.default_rng(1).standard_normal((count, 3))
    away *= 2.2 / np.linalg.norm(away, axis=1, keepdims=True)
    cameras = Camera.look_at(away, np.zeros(3), width=size, height=size, focal=1.05 * size)
    images, alphas = [], []
    for view in range(count):
        shot = field.render(cameras, view, background=0.0)
        color = shot.color / np.maximum(shot.alpha, 1e-6)[..., None]
        images.append(np.uint8(np.clip(color, 0, 1) * 255 + 0.5))
        alphas.append(np.uint8(np.clip(shot.alpha, 0, 1) * 255 + 0.5))
    return field, Capture(cameras, images, alphas, [f"{i}.png" for i in range(count)],
                          np.arange(count) % 8 == 3)


def test_equations_are_the_sums_they_should_be():
    random = np.random.default_rng(0)
    values, photo = random.random((2, 7, 9, 4)).astype(np.float32)
    depth = (2 + random.random((7, 9))).astype(np.float32)
    depth[2, 3], depth[4, 5] = np.inf, np.nan
    lens, usual = (20.0, 22.0, 4.4, 3.6), 0.4
    matrix, slope = np.ones((6, 6)), np.ones(6)
    cost, count = pose_equations(values, photo, depth, lens, usual, matrix, slope)

    row, column = np.nonzero(np.isfinite(depth))
    inner = (row > 0) & (row < 6) & (column > 0) & (column < 8)
    row, column = row[inner], column[inner]
    mean = 0.5 * (values + photo)
    across = 0.5 * (mean[row, column + 1] - mean[row, column - 1])
    down = 0.5 * (mean[row + 1, column] - mean[row - 1, column])
    point = np.stack([(column + 0.5 - 4.4) / 20.0, (row + 0.5 - 3.6) / 22.0, np.ones(len(row))], 1)
    point *= depth[row, column][:, None]
    moves = np.empty((len(row), 2, 6))
    for number in range(6):  # by differences: the camera moves, the point stays
        step = 1e-6 * np.eye(6)[number]
        there = (point - step[3:]) @ Rotation.from_rotvec(step[:3]).as_matrix()
        for axis in range(2):
            moves[:, axis, number] = lens[axis] * (there[:, axis] / there[:, 2]
                                                   - point[:, axis] / point[:, 2]) / 1e-6
    # The rendering moves as the points do, so that its values at a pixel change against them.
    jacobian = -(across[..., None] * moves[:, None, 0] + down[..., None] * moves[:, None, 1])
    error = (photo - values)[row, column]
    ratio = (error ** 2).sum(1) / (2 * usual) ** 2
    weight = 1 / (1 + ratio)
    assert count == len(row) == 33
    assert cost == pytest.approx(np.log1p(ratio).mean(), rel=1e-5)
    np.testing.assert_allclose(
        matrix, np.einsum("p,pci,pcj->ij", weight, jacobian, jacobian), rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(slope, np.einsum("p,pci,pc->i", weight, jacobian, error),
                               rtol=1e-3, atol=1e-3)


def test_photos_of_a_known_field_find_their_cameras():
    field, capture = rendered_capture(count=8)
    off = replace(capture, cameras=shaken(capture.cameras))
    views = np.arange(8)
    found = aligned(field, off, off.cameras, views, np.ones((8, 3)), steps=8)
    before, after = (np.concatenate(pose_corrections(capture.cameras, cameras))
                     for cameras in (off.cameras, found))
    assert np.median(after[:8]) < 0.35 * np.median(before[:8])
    assert np.median(after[8:]) < 0.35 * np.median(before[8:])
    # Photos in which nothing is to be seen keep their cameras.
    empty = replace(off, alphas=[np.zeros_like(alpha) for alpha in capture.alphas],
                    cameras=off.cameras.transformed(np.diag([1.0, 1, 1, 1]) + 90 * np.eye(4, k=3)))
    kept = aligned(field, empty, empty.cameras, views, np.ones((8, 3)))
    assert np.array_equal(kept.pose, empty.cameras.pose)


def test_what_corrections_have_in_common_is_taken_out():
    cameras = rendered_capture(count=8, size=8)[1].cameras
    moved = np.eye(4)
    moved[:3, :3] = 1.02 * Rotation.from_rotvec([0.01, -0.02, 0.015]).as_matrix()
    moved[:3, 3] = 0.03, -0.01, 0.02
    back = without_drift(cameras.transformed(moved), cameras)
    np.testing.assert_allclose(back.pose, cameras.pose, atol=1e-9)


@pytest.mark.slow  # cameras are found in a known field above, refined in a training below
def test_refinement_recovers_shaken_cameras():
    field, capture = rendered_capture()
    off = replace(capture, cameras=shaken(capture.cameras))
    _, plain = reconstruct_with_figures(off, TINY)
    _, figures = reconstruct_with_figures(off, replace(TINY, refine_poses=True))
    flip = np.diag([1.0, -1, -1, 1])
    found = np.array([item["transform_matrix"] for item in figures["cameras"]["cameras"]]) @ flip
    true = capture.cameras[capture.training()]
    before, after = (without_drift(cameras, true) for cameras in
                     (off.cameras[capture.training()], replace(true, pose=found)))
    for first, last, most in zip(pose_corrections(true, before), pose_corrections(true, after),
                                 (0.6, 0.5)):
        assert np.median(last) < most * np.median(first)  # degrees, shares of the distance
    # In the picture turns and shifts make up for each other: there the cameras are nearly right.
    points = field.lattice_points()[::500]
    first, last = (np.linalg.norm(cameras.project(points)[0] - true.project(points)[0], axis=2)
                   for cameras in (before, after))
    assert np.median(last) < 0.3 * np.median(first)
    assert figures["test"]["psnr"] > plain["test"]["psnr"] + 4.0
    assert figures["test"]["psnr_at_given_cameras"] < figures["test"]["psnr"]
    assert 0.1 < figures["cameras"]["median_degrees"] < 0.6
    assert 0.002 < figures["cameras"]["median_share_of_distance"] < 0.01


@pytest.mark.slow  # trains twice; cameras are found above
def test_a_resumed_run_with_refinement_gives_the_same_bytes(tmp_path, monkeypatch):
    _, capture = rendered_capture(count=16, size=40)
    capture = replace(capture, cameras=shaken(capture.cameras))
    config = replace(TINY, resolutions=(24, 40), rays=(0.05, 0.08), refine_poses=True)
    first, one = reconstruct_with_figures(capture, config)
    checkpoint = tmp_path / "state.npz"

    def stop(trainer):
        trainer.save()
        if trainer.level == 1 and trainer.step == 10:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "save_now_and_then", stop)
        with pytest.raises(KeyboardInterrupt):
            reconstruct_with_figures(capture, config, checkpoint=checkpoint)
    second, two = reconstruct_with_figures(capture, config, checkpoint=checkpoint)
    assert np.array_equal(first.density, second.density)
    assert np.array_equal(first.sh, second.sh)
    assert one["cameras"] == two["cameras"]
    assert one["test"] == two["test"]
