"""Measure how well the regions of a head are found, on a modelled head whose materials are known.

    python scripts/measure_regions.py JOB FILM [--person NAME]

JOB is the folder of a job (``capture/``, ``field.npz``) made from FILM, a folder of
`scripts/film_head.py`; both are of the same ``--person``. Printed, by how well photos saw a place:
the share of the hair's surface that is taken for skin, and of the skin's that is taken for hair,
all of it and without what lies within 2 cm of the true border; and the step of brightness where
photos end, over the photos' own variation beside it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lfportrait.capture import Camera, Capture
from lfportrait.example import Skin
from lfportrait.example.guides.filters import grey
from lfportrait.field import VoxelField
from lfportrait.files import read_json
from modelled_head import PEOPLE, HeadModel, photograph

Float64 = NDArray[np.float64]

CLOSE, BORDER, BESIDE = 0.06, 0.08, 0.12
"""World units of the model, a face being 0.8 high: a place is on the true surface if it lies no
further off; what is near a true border; and how far beside the photos' end brightness is read."""
HAIR, SKIN = 1, 0
LOOKS = tuple((yaw, pitch) for pitch in (-20.0, 10.0, 45.0) for yaw in range(-160, 200, 40))


def to_truth(capture: Capture, film: Path) -> tuple[float, Float64, Float64]:
    """Scale, rotation [3, 3] and shift [3] from a capture to the film's world, by the cameras."""
    frames = read_json(film / "true_cameras.json")["frames"]
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    true = {Path(frame["file_path"]).stem: np.array(frame["transform_matrix"]) @ flip
            for frame in frames}
    names = [(n, Path(name).stem) for n, name in enumerate(capture.names)]
    found = np.array([capture.cameras.pose[n] for n, name in names if name in true])
    given = np.array([true[name] for _, name in names if name in true])
    u, _, vt = np.linalg.svd(np.einsum("nij,nkj->ik", given[:, :3, :3], found[:, :3, :3]))
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    here, there = (part[:, :3, 3] - part[:, :3, 3].mean(axis=0) for part in (found, given))
    scale = float(((here @ turn.T) * there).sum() / (here ** 2).sum())
    return scale, turn, given[:, :3, 3].mean(axis=0) - scale * turn @ found[:, :3, 3].mean(axis=0)


def true_surface(model: HeadModel, side: int = 200) -> tuple[Float64, NDArray[np.int8]]:
    """Points [N, 3] all over a modelled head, and their materials [N] (`Picture.surface`)."""
    points, materials = [], []
    for yaw, pitch in LOOKS:
        camera = Camera.arc(np.array([yaw]), distance=4.4, width=side, height=side,
                            focal=1.9 * side, pitch=pitch)
        picture = photograph(model, camera)
        rows, columns = np.nonzero(picture.surface >= 0)
        pixels = np.stack([columns + 0.5, rows + 0.5], axis=1)
        rays = np.column_stack([(pixels - camera.center[0]) / camera.focal[0], np.ones(len(rows))])
        rays = rays @ camera.pose[0, :3, :3].T
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        points.append(camera.position[0] + rays * picture.depth[rows, columns][:, None])
        materials.append(picture.surface[rows, columns])
    return np.concatenate(points), np.concatenate(materials)


def shares(found: NDArray[np.bool_], true: NDArray[np.bool_], weight: Float64) -> float:
    """Per cent of the true places that are found, by weight."""
    return float(100 * weight[found & true].sum() / max(weight[true].sum(), 1e-9))


def seam_step(skin: Skin, points: Float64, material: NDArray[np.int8], chosen: int) -> float:
    """Median step of brightness where photos end on a material, over the variation beside it."""
    luma = grey(skin.atlas.color).reshape(-1)[skin.index]
    mine = material == chosen
    inside, outside = mine & (skin.seen > 0.3), mine & (skin.seen <= 0)
    if min(inside.sum(), outside.sum()) < 1000:
        return float("nan")
    trees = [cKDTree(points[part]) for part in (inside, outside)]
    ends = np.flatnonzero(mine & (skin.seen > 0) & (skin.seen < 0.2))
    steps = []
    for place in points[np.random.default_rng(0).permutation(ends)[:400]]:
        near = [luma[part][tree.query_ball_point(place, BESIDE)]
                for part, tree in zip((inside, outside), trees)]
        if min(map(len, near)) > 30:
            steps.append(abs(near[0].mean() - near[1].mean()) / max(near[0].std(), 1e-3))
    return float(np.median(steps)) if steps else float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("job", type=Path)
    parser.add_argument("film", type=Path)
    parser.add_argument("--person", choices=tuple(PEOPLE), default="sitter")
    given = parser.parse_args()
    capture = Capture.load(given.job / "capture")
    field = VoxelField.load(given.job / "field.npz")
    if capture.landmarks is None:
        parser.error("the capture has no landmarks")
    skin = Skin.of(field, capture.landmarks, capture.cameras)
    surface, materials = true_surface(PEOPLE[given.person])
    scale, turn, shift = to_truth(capture, given.film)
    points = skin.atlas.points.reshape(-1, 3)[skin.index].astype(np.float64) * scale @ turn.T
    points += shift
    far, nearest = cKDTree(surface).query(points)
    material = np.where(far < CLOSE, materials[nearest], -1)
    border = np.zeros(len(points), bool)
    for kind in (SKIN, HAIR):
        others = cKDTree(surface[materials != kind])
        border |= (material == kind) & (others.query(points)[0] < BORDER)
    labels, names = skin.labels
    taken = labels[:, names.index("hair")] > 127
    bare = np.isin(np.array(names)[labels.argmax(axis=1)], ("skin", "neck", "ears", "nose"))
    weight = np.ones(len(points))
    head = points[:, 1] > np.nanmin(surface[materials == HAIR, 1])
    print(f"hair by the sitter's own: {skin.hair is not None}")
    for name, part in (("all", head), ("seen", head & (skin.seen > 0.5)),
                       ("hardly", head & (skin.seen > 0) & (skin.seen <= 0.5)),
                       ("unseen", head & (skin.seen <= 0))):
        row = [shares(bare & part & inner, (material == HAIR) & part & inner, weight)
               for inner in (np.ones_like(border), ~border)]
        row += [shares(taken & part & inner, (material == SKIN) & part & inner, weight)
                for inner in (np.ones_like(border), ~border)]
        print(f"{name:7} hair taken for skin {row[0]:5.1f} % (off the border {row[1]:5.1f}), "
              f"skin as hair {row[2]:5.1f} % ({row[3]:5.1f}); "
              f"{100 * part.mean():.0f} % of the places")
    steps = [seam_step(skin, points, material, kind) for kind in (HAIR, SKIN)]
    print(f"step of brightness where photos end: hair {steps[0]:.2f}, skin {steps[1]:.2f} of the "
          "variation beside it")


if __name__ == "__main__":
    main()
