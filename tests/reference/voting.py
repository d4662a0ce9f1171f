"""Plain NumPy twins of the voting kernels."""

import numpy as np


def project(camera: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Image points [N, 2] and depth [N] of world points for a row of 16 camera numbers."""
    pose = camera[:12].reshape(3, 4)
    local = (points - pose[:, 3]) @ pose[:, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = local[:, :2] / local[:, 2:] * camera[12:14] + camera[14:16]
    return pixels, local[:, 2]


def lattice(first: np.ndarray, spacing: float, size: int) -> np.ndarray:
    z, y, x = np.meshgrid(*[np.arange(size)] * 3, indexing="ij")
    return first + spacing * np.stack([x, y, z], -1).reshape(-1, 3)


def inside(camera: np.ndarray, points: np.ndarray, height: int, width: int) -> tuple:
    pixels, depth = project(camera, points)
    with np.errstate(invalid="ignore"):
        column, row = np.floor(pixels).T
        shown = ((depth > 1e-9) & (column >= 0) & (column < width) & (row >= 0) & (row < height))
    return shown, row[shown].astype(int), column[shown].astype(int)


def vote_lattice(cameras: np.ndarray, mattes: list, first: np.ndarray, spacing: float, size: int,
                 tolerance: float) -> np.ndarray:
    """Share of the person in each point's votes; 0 where the background has too many."""
    points = lattice(first, spacing, size)
    against, seen = np.zeros(len(points)), np.zeros(len(points))
    for camera, matte in zip(cameras, mattes):
        shown, rows, columns = inside(camera, points, *matte.shape)
        seen[shown] += 1
        against[shown] += 1 - matte[rows, columns]
    share = np.where(seen > 0, 1 - against / np.maximum(seen, 1), 1)
    return np.where(against > tolerance * len(cameras), 0, share).reshape(size, size, size)


def cover_views(camera: np.ndarray, points: np.ndarray, first: np.ndarray, spacing: float,
                height: int, width: int) -> np.ndarray:
    """Pixels in which one of the marked points lies."""
    covered = np.zeros((height, width), bool)
    _, rows, columns = inside(camera, lattice(first, spacing, len(points))[points.ravel()], height,
                              width)
    covered[rows, columns] = True
    return covered
