"""Regions are measured against a modelled head's own materials."""

from types import SimpleNamespace

import numpy as np
import pytest

import measure_regions
from lfportrait.capture import Camera, Capture
from lfportrait.files import write_json
from modelled_head import SITTER
from modelled_head.studio import Picture


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def test_a_captures_frame_is_found_by_its_cameras(tmp_path):
    cameras = Camera.arc(np.linspace(-14, 14, 9), distance=2.0, width=40, height=60, focal=50.0)
    blank = [np.zeros((60, 40, 3), np.uint8)] * 9
    capture = Capture(cameras, blank, None, [f"{n:03d}.jpg" for n in range(9)], np.zeros(9, bool))
    turn, shift = turned(0.4), np.array([0.1, -0.3, 0.2])
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    frames = []
    for n, pose in enumerate(cameras.pose):
        true = pose.copy()
        true[:3, :3] = turn @ pose[:3, :3]
        true[:3, 3] = 1.7 * turn @ pose[:3, 3] + shift
        frames.append({"file_path": f"images/{n:03d}.jpg",
                       "transform_matrix": (true @ flip).tolist()})
    write_json(tmp_path / "true_cameras.json", {"frames": frames})
    scale, found, moved = measure_regions.to_truth(capture, tmp_path)
    assert scale == pytest.approx(1.7, rel=1e-3)
    assert np.allclose(found, turn, atol=1e-6) and np.allclose(moved, shift, atol=1e-3)


def test_points_of_the_true_surface_lie_where_rays_end(monkeypatch):
    """A ball stands in for the head: hair above, skin below."""
    def ball(model, cameras, view=0):
        y, x = np.mgrid[:40, :40] + 0.5
        rays = np.stack([(x - 20) / cameras.focal[0, 0], (y - 20) / cameras.focal[0, 1],
                         np.ones_like(x)], axis=-1) @ cameras.pose[0, :3, :3].T
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        eye = cameras.position[0]
        along = -(rays @ eye)
        inside = 0.6 ** 2 - (eye @ eye - along ** 2)
        depth = np.where(inside > 0, along - np.sqrt(np.maximum(inside, 0)), 0)
        high = (eye + rays * depth[..., None])[..., 1] > 0.2
        return Picture(np.zeros((40, 40, 4), np.uint8), np.zeros((40, 40, 3), np.float32),
                       np.where(inside > 0, high, -1).astype(np.int8), depth.astype(np.float32))

    monkeypatch.setattr(measure_regions, "photograph", ball)
    points, materials = measure_regions.true_surface(SITTER, 40)
    assert np.abs(np.linalg.norm(points, axis=1) - 0.6).max() < 1e-5
    assert np.array_equal(materials == measure_regions.HAIR, points[:, 1] > 0.2)
    # From all around.
    assert (points.min(axis=0) < -0.5).all() and (points.max(axis=0) > 0.5).all()


@pytest.mark.parametrize("step, least, most", [(0.0, 0.0, 0.3), (0.1, 3.0, 7.0)])
def test_a_step_is_measured_over_the_variation_beside_it(step, least, most):
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(0, 1, 160), np.linspace(0, 1, 160)))
    seen = np.clip((0.55 - x) / 0.1, 0, 1).astype(np.float32)
    luma = 0.5 + np.random.default_rng(0).normal(0, 0.02, x.shape) + step * (seen <= 0)
    color = np.repeat(luma[None, :, None], 3, axis=2).astype(np.float32)
    skin = SimpleNamespace(atlas=SimpleNamespace(color=color), index=np.arange(len(x)), seen=seen)
    points = np.stack([x, y, 0 * x], axis=1)
    found = measure_regions.seam_step(skin, points, np.zeros(len(x), np.int8), 0)
    assert least <= found <= most
