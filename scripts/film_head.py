"""Film a modelled head as people film themselves: one sweep at arm's length, and true views beyond.

    python scripts/film_head.py OUT [--person NAME] [--azimuth 14] [--distance 2.45]
                                    [--height 0] [--frames 64] [--seed 0]

Writes ``images/`` (JPEG frames before a plain wall, a shaking hand, an exposure that drifts,
noise), ``true_cameras.json`` with the cameras of the frames, and, for checking only, seven cut-out
views from -40 to 40 degrees: ``test/`` and ``true_test.json`` (NeRF's convention).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from lfportrait.capture import Camera
from lfportrait.files import write_json
from modelled_head import PEOPLE, HeadModel, photograph

WIDTH, HEIGHT, FOCAL = 405, 720, 648.0
AIM = np.array([0.0, 0.36, 0.0])
"""High enough that the picture ends above the lower end of the bust."""
BEYOND = ((-40, 0), (-25, 10), (-12, -8), (0, 0), (12, 12), (25, -5), (40, 5))
"""Azimuth and elevation of the true views, degrees."""


def place(azimuth: float, elevation: float, distance: float) -> np.ndarray:
    """Where a camera stands, [3]; angles in degrees."""
    turn, up = np.radians(azimuth), np.radians(elevation)
    return distance * np.array([np.cos(up) * np.sin(turn), np.sin(up), np.cos(up) * np.cos(turn)])


def looking(position: np.ndarray, target: np.ndarray) -> Camera:
    """An upright phone at a place that looks at a point."""
    return Camera.look_at(position, target, width=WIDTH, height=HEIGHT, focal=FOCAL)


def described(cameras: Camera, names: list[str]) -> dict[str, object]:
    """A NeRF file of cameras."""
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    return {"fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2, "w": WIDTH,
            "h": HEIGHT, "frames": [{"file_path": name, "transform_matrix": (pose @ flip).tolist()}
                                    for name, pose in zip(names, cameras.pose)]}


def film(model: HeadModel, out: Path, azimuth: float, distance: float, height: float, frames: int,
         seed: int) -> None:
    """Take the frames of one sweep."""
    rng = np.random.default_rng(seed)
    (out / "images").mkdir(parents=True, exist_ok=True)
    shake = np.cumsum(rng.normal(0, 0.006, (frames, 3)), axis=0)
    shake -= shake.mean(axis=0)
    batches, names = [], []
    for k, part in enumerate(np.linspace(-1, 1, frames)):
        position = place(azimuth * part, height, distance * (1 + 0.03 * np.sin(3 * part)))
        camera = looking(position + shake[k], AIM + rng.normal(0, 0.01, 3))
        picture = photograph(model, camera).image.astype(np.float64)
        alpha = picture[..., 3:] / 255.0
        wall = 205.0 + 6.0 * np.linspace(-1, 1, HEIGHT)[:, None, None] * np.ones(3)
        gain = 1.0 + 0.06 * np.sin(4 * part) * np.array([1.0, 0.97, 1.05])
        shot = (picture[..., :3] * alpha + wall * (1 - alpha)) * gain
        shot += rng.normal(0, 1.5, shot.shape)
        name = f"images/{k:03d}.jpg"
        Image.fromarray(np.clip(shot + 0.5, 0, 255).astype(np.uint8)).save(out / name, quality=92)
        batches.append(camera)
        names.append(name)
    write_json(out / "true_cameras.json", described(Camera.concatenate(batches), names))


def beyond(model: HeadModel, out: Path, distance: float) -> None:
    """Take the true views."""
    (out / "test").mkdir(parents=True, exist_ok=True)
    batches, names = [], []
    for k, (azimuth, elevation) in enumerate(BEYOND):
        camera = looking(place(azimuth, elevation, distance), AIM)
        names.append(f"test/test_{k}.png")
        Image.fromarray(photograph(model, camera).image).save(out / names[-1])
        batches.append(camera)
    write_json(out / "true_test.json", described(Camera.concatenate(batches), names))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--person", choices=tuple(PEOPLE), default="sitter")
    parser.add_argument("--azimuth", type=float, default=14.0)
    parser.add_argument("--distance", type=float, default=2.45)
    parser.add_argument("--height", type=float, default=0.0)
    parser.add_argument("--frames", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    model = PEOPLE[given.person]
    film(model, given.out, given.azimuth, given.distance, given.height, given.frames, given.seed)
    beyond(model, given.out, given.distance)


if __name__ == "__main__":
    main()
