"""Plain NumPy twins of the atlas' kernels."""

import numpy as np
from scipy.ndimage import map_coordinates

from tests.reference.voting import project


def unit(vectors):
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore"):
        return np.where(length > 1e-9, vectors / length, (0, 0, 1))


def surface_normals(points, limit):
    """Cross product of the steps down and across, from the neighbours that are near enough."""
    height, width = points.shape[:2]
    out = np.full(points.shape, np.nan)
    for y, x in np.ndindex(height, width):
        steps = []
        for dy, dx in ((0, 1), (1, 0)):
            found = [sign * (points[y + sign * dy, x + sign * dx] - points[y, x])
                     for sign in (-1, 1)
                     if 0 <= y + sign * dy < height and 0 <= x + sign * dx < width]
            found = [step for step in found if np.linalg.norm(step) < limit]
            steps.append(sum(found) if found else np.full(3, np.nan))
        normal = np.cross(steps[1], steps[0])
        if np.linalg.norm(normal) > 0:
            out[y, x] = normal / np.linalg.norm(normal)
    return out


def sum_normals(points, normals, low, cell, sums):
    known = np.isfinite(normals[..., 0])
    cells = np.floor((points[known] - low) / cell).astype(int)
    inside = ((cells >= 0) & (cells < sums.shape[2::-1])).all(axis=1)
    x, y, z = cells[inside].T
    out = sums.astype(np.float64)
    np.add.at(out, (z, y, x), normals[known][inside])
    return out


def smooth_normals(points, grid, low, cell):
    places = ((points - low) / cell - 0.5).T[::-1]
    return unit(np.stack([map_coordinates(grid[..., axis].astype(np.float64), places, order=1,
                                          mode="nearest") for axis in range(3)], axis=-1))


def towards(camera, points, normals):
    return (unit(camera[3:12:4] - points) * normals).sum(axis=-1)


class Charts:
    """Cameras [C, 16], what is added to their cosines, boxes, and depths of the atlas."""

    def __init__(self, cameras, bias, boxes, depths):
        self.cameras, self.bias, self.boxes, self.depths = cameras, bias, boxes, depths

    def shown(self, chart, points):
        """Places in the atlas [N, 2], depths, and whether the atlas holds them."""
        pixels, depth = project(self.cameras[chart], points)
        x0, y0, x1, y1, dx, dy = self.boxes[chart]
        column, row = np.floor(pixels).T
        held = (column >= x0) & (row >= y0) & (column < x1) & (row < y1)
        return pixels + np.array([dx, dy]), depth, held

    def depth_at(self, places, held):
        out = np.full(len(places), np.inf)
        i, j = np.floor(places[held]).astype(int).T
        out[held] = self.depths[j, i]
        return out

    def find(self, points, normals, before, behind):
        """Best chart of each point, its place there, and how far behind the surface it lies."""
        best, score = np.full(len(points), -1), np.full(len(points), -np.inf)
        place, away = np.full((len(points), 2), np.nan), np.full(len(points), np.nan)
        for chart, camera in enumerate(self.cameras):
            facing = towards(camera, points, normals) + self.bias[chart]
            places, depth, held = self.shown(chart, points)
            behind_it = depth - self.depth_at(places, held)
            better = (facing > score) & held & (behind_it >= -before) & (behind_it <= behind)
            best[better], score[better] = chart, facing[better]
            place[better], away[better] = places[better], behind_it[better]
        return best, place, away

    def owners(self, points, normals, own, tolerance):
        """Flat index of the owner of each pixel [H, W]; -1 without a point."""
        index = np.arange(own.size)
        flat = points.reshape(-1, 3).astype(np.float64)
        best, place, _ = self.find(flat, normals, tolerance, tolerance)
        other = (best >= 0) & (best != own.ravel())
        out = index.copy()
        i, j = np.floor(place[other]).astype(int).T
        out[other] = j * own.shape[1] + i
        return np.where(np.isfinite(flat[:, 0]), out, -1).reshape(own.shape)

    def locate(self, points, normals, before, behind):
        """Places [N, 2] of points brought up to the surface, and how far they lie under it."""
        best, place, away = self.find(points, normals, before, behind)
        depth = np.full(len(points), np.nan)
        for chart, camera in enumerate(self.cameras):
            of = np.flatnonzero(best == chart)
            depth[of] = away[of] * np.maximum(towards(camera, points[of], normals[of]), 0)
            raised = points[of] + depth[of, None] * normals[of]
            places, _, held = self.shown(chart, raised)
            good = np.isfinite(self.depth_at(places, held))
            place[of[good]] = places[good]
        return place, depth


def lift_points(depth, camera):
    rows, columns = np.indices(depth.shape)
    local = np.stack([(columns + 0.5 - camera[14]) / camera[12],
                      (rows + 0.5 - camera[15]) / camera[13], np.ones(depth.shape)], axis=-1)
    pose = camera[:12].reshape(3, 4)
    with np.errstate(invalid="ignore"):
        points = (local * depth[..., None]) @ pose[:, :3].T + pose[:, 3]
    return np.where(np.isfinite(depth)[..., None], points, np.nan)


def best_facing(points, normals, positions):
    to = positions[None] - points[:, None]
    cosine = (to * normals[:, None]).sum(-1) / np.linalg.norm(to, axis=-1)
    return cosine.max(axis=1, initial=-1)


def fringe(owner, margin):
    out = owner.copy()
    for y, x in zip(*np.nonzero(owner < 0)):
        near = [owner[y + dy * away, x + dx * away] for away in range(1, margin + 1)
                for dy, dx in ((0, -1), (0, 1), (-1, 0), (1, 0))
                if 0 <= y + dy * away < owner.shape[0] and 0 <= x + dx * away < owner.shape[1]]
        out[y, x] = next((found for found in near if found >= 0), -1)
    return out


def bilinear(values, places):
    """Values [H, W, C] at places (x, y), in units of the nodes, [N, 2]; the border's beyond."""
    return np.stack([map_coordinates(values[..., channel].astype(np.float64), places.T[::-1],
                                     order=1, mode="nearest")
                     for channel in range(values.shape[2])], axis=-1)
