"""Render an object or a room as a data set in NeRF's synthetic layout, with known cameras.

python scripts/make_object_scene.py OUT [--kind bricks] [--size 800] [--train 88] [--test 14]

Kinds, each hard in another way:
bricks   a toy bulldozer, a potted plant, a fence and glossy balls: thin rods, gaps, a hollow blade
foliage  a small tree of hundreds of leaves, a wire cage, springs and a net
glass    chrome, brass, cymbals, clear and colored glass, balls of differing gloss
pottery  vases, a bowl and a jug, hollow and smooth, on a wavy cloth
room     a table in a room with papered walls, shelves and pictures, seen by someone who walks

OUT holds ``transforms_train.json``, ``transforms_test.json`` and the pictures in ``train/`` and
``test/``, with straight alpha but for the room; the world's z points up, cameras are 4.03 away on
the upper half of a sphere, in the room 1.1 to 2. How it works: `object_scenes`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from lfportrait.files import write_image, write_json
from object_scenes import KINDS, Scene


def make(out: Path, size: int, train: int, test: int, kind: str = "bricks") -> None:
    design = KINDS[kind]()
    scene = Scene(design)
    for seed, (split, count) in enumerate((("train", train), ("test", test))):
        views = scene.cameras(count, size, seed)
        frames = []
        for view in range(count):
            name = f"./{split}/r_{view}"
            picture = scene.picture(views.pose[view], size)
            # Pictures without alpha are read as photos, of which nothing is cut out.
            write_image(out / f"{name}.png", picture[..., :3] if design.closed else picture)
            frames.append({"file_path": name, "transform_matrix":
                           (views.pose[view] @ np.diag([1.0, -1, -1, 1])).tolist()})
            print(f"\r{split} {view + 1}/{count}", end="", flush=True)
        write_json(out / f"transforms_{split}.json",
                   {"camera_angle_x": design.angle_x, "frames": frames})
    print()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--kind", choices=KINDS, default="bricks", help="what to render")
    parser.add_argument("--size", type=int, default=800, help="edge of a picture in pixels")
    parser.add_argument("--train", type=int, default=88, help="training views")
    parser.add_argument("--test", type=int, default=14, help="held-out views")
    options = parser.parse_args()
    make(options.out, options.size, options.train, options.test, options.kind)
