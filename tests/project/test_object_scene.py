"""The script that renders an object with hollows."""

import importlib
import sys
from pathlib import Path

import numpy as np

from lfportrait.capture import Capture
from lfportrait.files import read_image

SCRIPTS = str(Path(__file__).parents[2] / "scripts")


def test_the_object_is_where_its_cameras_look(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", [SCRIPTS, *sys.path])
    script = importlib.import_module("make_object_scene")
    script.make(tmp_path, size=48, train=2, test=1)
    for name in ("train/r_0", "train/r_1", "test/r_0"):
        alpha = read_image(tmp_path / f"{name}.png")[..., 3]
        assert 0.1 < (alpha == 255).mean() < 0.6 and (alpha == 0).mean() > 0.3
        assert 0.01 < ((alpha > 0) & (alpha < 255)).mean() < 0.2  # edges are smooth
    capture = Capture.load(tmp_path)
    assert list(capture.held_out) == [False, False, True]
    # Cameras stand on a sphere about the origin, whose z is up, and look at it.
    back = np.linalg.inv(capture.frame)
    position = capture.cameras.position @ back[:3, :3].T + back[:3, 3]
    np.testing.assert_allclose(np.linalg.norm(position, axis=1), script.DISTANCE)
    assert (position[:, 2] > 0).all()
    pixels, _ = capture.cameras.project((capture.frame[:3, 3])[None])
    np.testing.assert_allclose(pixels, 24.0, atol=1e-6)
    # What stands on the plate hides what lies behind: seen from elsewhere, the roof's colour stays.
    roof = capture.frame[:3, :3] @ (0.9 * np.array([-0.25, 0.0, 0.47]) + (0, 0, 0.13))
    pixels, _ = capture.cameras.project((roof + capture.frame[:3, 3])[None])
    for view, (x, y) in enumerate(pixels[:, 0]):
        red, green, blue = capture.images[view][int(y), int(x)].astype(int)
        assert red > 100 and red > green > 2 * blue
