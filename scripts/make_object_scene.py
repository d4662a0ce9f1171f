"""Render an object with hollows as a data set in NeRF's synthetic layout, with known cameras.

python scripts/make_object_scene.py OUT [--size 800] [--train 88] [--test 14]

A toy bulldozer of bricks, a potted plant, a fence and glossy balls on a plate with studs: thin
rods, treads with gaps, a hollow blade, stripes (`toy_bulldozer.py`). OUT holds
``transforms_train.json``, ``transforms_test.json`` and the pictures (straight alpha) in ``train/``
and ``test/``; the world's z points up, cameras are 4.03 away on the upper half of a sphere.

The solids are signed distances. Cells of a grid list the few that are near, so that a ray takes
steps that are exact near surfaces and large elsewhere. Sunlight has soft shadows, the sky is dimmed
by occlusion. A pixel whose neighbours differ is the mean of 4x4 rays.
"""

from __future__ import annotations

import argparse
from math import pi, sin, sqrt
from pathlib import Path

import numpy as np
from numba import njit, prange

from lfportrait.capture import Camera
from lfportrait.files import write_image, write_json
from toy_bulldozer import BOX, CYLINDER, LEAF, MATERIALS, toy_scene

ANGLE_X, DISTANCE = 0.6911112070083618, 4.031128874149275
EXTENT, CELLS, LISTED = 1.3, 72, 48  # half edge of the grid's cube, cells a side, solids a cell
SUN = np.array([0.45, -0.52, 0.73]) / sqrt(0.45**2 + 0.52**2 + 0.73**2)


@njit(cache=True)
def distance(solid, x, y, z):
    """Signed distance to one solid, or a lower bound."""
    x, y, z = x - solid[1], y - solid[2], z - solid[3]
    u = abs(solid[4] * x + solid[5] * y + solid[6] * z)
    v = abs(solid[7] * x + solid[8] * y + solid[9] * z)
    w = solid[10] * x + solid[11] * y + solid[12] * z
    rounding = solid[16]
    if solid[0] == LEAF:
        w += rounding * u * u
        outer = sqrt((u / solid[13])**2 + (v / solid[14])**2)
        inner = sqrt((u / solid[13]**2)**2 + (v / solid[14]**2)**2)
        edge = outer * (outer - 1.0) / inner if inner > 1e-6 else -solid[14]
        u, v, w, rounding = edge, -1.0, abs(w) - solid[15], 0.0
        return 0.7 * (min(max(u, w), 0.0) + sqrt(max(u, 0.0)**2 + max(w, 0.0)**2))
    w = abs(w)
    if solid[0] == BOX:
        u, v = u - solid[13], v - solid[14]
    elif solid[0] == CYLINDER:
        u, v = sqrt(u * u + v * v) - solid[13], -1.0
    else:
        u, v = abs(sqrt(u * u + v * v) - solid[13]) - solid[14], -1.0
    u, v, w = u + rounding, v + rounding, w - solid[15] + rounding
    return (min(max(u, v, w), 0.0) + sqrt(max(u, 0.0)**2 + max(v, 0.0)**2 + max(w, 0.0)**2)
            - rounding)


@njit(cache=True, parallel=True)
def bake(solids, grid, near):
    """Distance at the cells' middles, and the solids that may be nearest somewhere in a cell."""
    cell = 2.0 * EXTENT / CELLS
    half = 0.5 * sqrt(3.0) * cell
    for i in prange(CELLS):
        values = np.empty(len(solids))
        for j in range(CELLS):
            for k in range(CELLS):
                for s in range(len(solids)):
                    values[s] = distance(solids[s], (i + 0.5) * cell - EXTENT,
                                         (j + 0.5) * cell - EXTENT, (k + 0.5) * cell - EXTENT)
                least = values.min()
                grid[i, j, k] = least
                count = 0
                if least < 2.0 * half:
                    for s in range(len(solids)):
                        if values[s] <= least + 2.0 * half and count < LISTED:
                            near[i, j, k, count] = s
                            count += 1


@njit(cache=True)
def smooth_distance(grid, x, y, z):
    """The grid's distance, interpolated: continuous, but blind to what is thinner than a cell."""
    scale, last = CELLS / (2.0 * EXTENT), CELLS - 1.001
    fx = min(max((x + EXTENT) * scale - 0.5, 0.0), last)
    fy = min(max((y + EXTENT) * scale - 0.5, 0.0), last)
    fz = min(max((z + EXTENT) * scale - 0.5, 0.0), last)
    i, j, k = int(fx), int(fy), int(fz)
    fx, fy, fz = fx - i, fy - j, fz - k
    total = 0.0
    for corner in range(8):
        a, b, c = corner >> 2, (corner >> 1) & 1, corner & 1
        total += ((fx if a else 1.0 - fx) * (fy if b else 1.0 - fy) * (fz if c else 1.0 - fz)
                  * grid[i + a, j + b, k + c])
    return total


@njit(cache=True)
def march(solids, grid, near, origin, direction, start):
    """Walk along a ray: (distance or -1, solid, how much of a soft sun passes by)."""
    first, last = start, 1e9
    for axis in range(3):
        slope = direction[axis] if abs(direction[axis]) > 1e-9 else 1e-9
        a, b = (-EXTENT - origin[axis]) / slope, (EXTENT - origin[axis]) / slope
        first, last = max(first, min(a, b)), min(last, max(a, b))
    cell = 2.0 * EXTENT / CELLS
    t, light = first + 1e-6, 1.0
    while t < last:
        x, y = origin[0] + t * direction[0], origin[1] + t * direction[1]
        z = origin[2] + t * direction[2]
        i = min(max(int((x + EXTENT) / cell), 0), CELLS - 1)
        j = min(max(int((y + EXTENT) / cell), 0), CELLS - 1)
        k = min(max(int((z + EXTENT) / cell), 0), CELLS - 1)
        if near[i, j, k, 0] < 0:
            step = grid[i, j, k] - 0.5 * sqrt(3.0) * cell
            clear = smooth_distance(grid, x, y, z)
        else:
            step, nearest = 1e9, 0
            for n in range(LISTED):
                s = near[i, j, k, n]
                if s < 0:
                    break
                value = distance(solids[s], x, y, z)
                if value < step:
                    step, nearest = value, s
            clear = step
            if step < 2e-4:
                return t, nearest, 0.0
        light = min(light, 14.0 * clear / max(t - start, 1e-3))
        t += max(step, 1e-4)
    return -1.0, 0, light


@njit(cache=True)
def sky(z):
    """Brightness of the sky towards a direction of height ``z``; below lies a grey floor."""
    return 0.35 + 0.65 * min(max(0.5 + 1.5 * z, 0.0), 1.0)


@njit(cache=True)
def shade(solids, materials, grid, near, sun, point, ray, nearest, color):
    """The colour, sRGB in [0, 1], of a point on a solid."""
    solid = solids[nearest]
    normal, place = np.zeros(3), np.zeros(3)
    for corner in range(4):  # gradient by the corners of a tetrahedron
        a, b = 1.0 if corner in (0, 1) else -1.0, 1.0 if corner in (0, 2) else -1.0
        c = 1.0 if corner in (0, 3) else -1.0
        h = 3e-4
        value = distance(solid, point[0] + a * h, point[1] + b * h, point[2] + c * h)
        normal += np.array([a, b, c]) * value
    normal /= sqrt((normal * normal).sum()) + 1e-12
    for axis in range(3):
        place[axis] = (solid[4 + 3 * axis:7 + 3 * axis] * (point - solid[1:4])).sum()
    material = materials[int(solid[17])]
    striped = material[6] > 0 and sin(pi * material[6] * (place[0] + place[1] + place[2])) > 0
    facing = (normal * sun).sum()
    light = 0.0
    if facing > 0:
        light = max(march(solids, grid, near, point + 2e-3 * normal, sun, 2e-3)[2], 0.0)
    occlusion = 1.0
    for tap in range(1, 6):
        reach = 0.035 * tap
        there = point + reach * normal
        clear = smooth_distance(grid, there[0], there[1], there[2])
        occlusion -= max(reach - clear, 0.0) * 4.0 / tap**1.3
    occlusion = max(occlusion, 0.15)
    half = sun - ray
    half /= sqrt((half * half).sum())
    highlight = max((normal * half).sum(), 0.0)**material[8] * light * max(facing, 0.0)**0.3
    cosine = -(normal * ray).sum()
    fresnel = 0.04 + 0.6 * (1.0 - min(max(cosine, 0.0), 1.0))**4
    mirrored = ray[2] + 2.0 * cosine * normal[2]
    for channel in range(3):
        albedo = material[channel + (3 if striped else 0)]**1.6
        warm = 1.0 if channel == 0 else (0.94 if channel == 1 else 0.82)
        cool = 0.88 if channel == 0 else (0.95 if channel == 1 else 1.0)
        value = albedo * (1.05 * warm * light * max(facing, 0.0)
                          + 0.55 * cool * occlusion * (0.55 + 0.45 * normal[2]))
        value += material[7] * (0.8 * warm * highlight
                                + 0.5 * cool * fresnel * sky(mirrored) * occlusion)
        color[channel] = min(value, 1.0)**(1 / 2.2)


@njit(cache=True, parallel=True)
def cast(solids, materials, grid, near, sun, camera, focal, rays, out):
    """Cast rays through picture points [K, 2]: out [K, 5] is colour, opacity and the solid."""
    for number in prange(len(rays)):
        local = np.array([(rays[number, 0]) / focal, rays[number, 1] / focal, 1.0])
        ray, origin = np.zeros(3), camera[:3, 3].copy()
        for axis in range(3):
            ray[axis] = (camera[axis, :3] * local).sum() / sqrt((local * local).sum())
        t, nearest, _ = march(solids, grid, near, origin, ray, 0.5)
        out[number] = 0.0
        if t > 0:
            shade(solids, materials, grid, near, sun, origin + t * ray, ray, nearest, out[number])
            out[number, 3], out[number, 4] = 1.0, nearest + 1.0


class Scene:
    """The model, baked."""

    def __init__(self) -> None:
        self.solids = toy_scene()
        self.grid = np.zeros((CELLS,) * 3, np.float32)
        self.near = np.full((CELLS,) * 3 + (LISTED,), -1, np.int16)
        bake(self.solids, self.grid, self.near)

    def picture(self, pose: np.ndarray, size: int) -> np.ndarray:
        """RGBA, uint8 [size, size, 4] with straight alpha, from an OpenCV pose."""
        focal = 0.5 * size / np.tan(0.5 * ANGLE_X)

        def rays(points: np.ndarray) -> np.ndarray:
            out = np.zeros((len(points), 5))
            cast(self.solids, MATERIALS, self.grid, self.near, SUN, pose, focal,
                 points - 0.5 * size, out)
            return out

        pixels = np.stack(np.meshgrid(np.arange(size), np.arange(size)), 2).reshape(-1, 2)
        first = rays(pixels + 0.5).reshape(size, size, 5)
        rough = np.zeros((size, size), bool)
        for axis in (0, 1):
            step = np.abs(np.diff(first, axis=axis))
            changed = (step[..., 4] > 0) | (step[..., :3].max(axis=2) > 0.03)
            lower, upper = [slice(None)] * 2, [slice(None)] * 2
            lower[axis], upper[axis] = slice(0, -1), slice(1, None)
            rough[tuple(lower)] |= changed
            rough[tuple(upper)] |= changed
        inner = (np.stack(np.meshgrid(np.arange(4), np.arange(4)), 2).reshape(1, 16, 2) + 0.5) / 4
        fine = rays((pixels[rough.ravel()][:, None] + inner).reshape(-1, 2)).reshape(-1, 16, 5)
        total = first[..., :4].copy()
        total[rough] = fine[..., :4].mean(axis=1)
        total[..., :3] /= np.maximum(total[..., 3:], 1e-9)
        return np.uint8(np.clip(total, 0, 1) * 255 + 0.5)


def cameras(count: int, size: int, seed: int) -> Camera:
    """Cameras at random on the upper half of the sphere, looking at the origin."""
    random = np.random.default_rng(seed)
    height, turn = random.uniform(0.02, 0.99, count), random.uniform(0, 2 * pi, count)
    flat = np.sqrt(1 - height**2)
    away = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], 1)
    return Camera.look_at(DISTANCE * away, np.zeros(3), width=size, height=size,
                          focal=0.5 * size / np.tan(0.5 * ANGLE_X), up=(0, 0, 1))


def make(out: Path, size: int, train: int, test: int) -> None:
    scene = Scene()
    for seed, (split, count) in enumerate((("train", train), ("test", test))):
        views = cameras(count, size, seed)
        frames = []
        for view in range(count):
            name = f"./{split}/r_{view}"
            write_image(out / f"{name}.png", scene.picture(views.pose[view], size))
            frames.append({"file_path": name, "transform_matrix":
                           (views.pose[view] @ np.diag([1.0, -1, -1, 1])).tolist()})
            print(f"\r{split} {view + 1}/{count}", end="", flush=True)
        write_json(out / f"transforms_{split}.json", {"camera_angle_x": ANGLE_X, "frames": frames})
    print()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--size", type=int, default=800, help="edge of a picture in pixels")
    parser.add_argument("--train", type=int, default=88, help="training views")
    parser.add_argument("--test", type=int, default=14, help="held-out views")
    options = parser.parse_args()
    make(options.out, options.size, options.train, options.test)
