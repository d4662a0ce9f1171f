"""A plain NumPy twin of the kernel that composes clean plates."""

import cv2
import numpy as np

from tests.reference.voting import project


def compose_plate(inverse: np.ndarray, wanted: np.ndarray, camera: np.ndarray, others: np.ndarray,
                  pictures: np.ndarray, gains: np.ndarray, enough: float, spread: float,
                  ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean colors [h, w, 3], their noise [h, w] and the sum of the weights [h, w]."""
    height, width = inverse.shape
    y, x = np.mgrid[:height, :width] + 0.5
    along = 1 / np.maximum(inverse.astype(float), 1e-6)
    local = np.stack([(x - camera[14]) / camera[12] * along, (y - camera[15]) / camera[13] * along,
                      along], -1).reshape(-1, 3)
    pose = camera[:12].reshape(3, 4)
    points = local @ pose[:, :3].T + pose[:, 3]
    high, wide = pictures.shape[1:3]
    colors = np.zeros((len(others), height * width, 3))
    weights = np.zeros((len(others), height * width))
    for k, other in enumerate(others):
        pixels, depth = project(other, points)
        place = (pixels - 0.5).astype(np.float32)
        sample = cv2.remap(pictures[k].astype(np.float32), *place.reshape(height, width, 2)
                           .transpose(2, 0, 1), cv2.INTER_LINEAR).reshape(-1, 4) / 255
        inside = (depth > 1e-6) & (place >= 0).all(1) & (place < (wide - 1, high - 1)).all(1)
        weight = np.where(inside & (sample[:, 3] > 0.004), sample[:, 3], 0)
        weights[k] = np.where(weights.sum(0) < enough, weight, 0)
        colors[k] = sample[:, :3] * gains[k]
    used = weights
    mean = variance = None
    for step in range(3):
        if step:
            away = ((colors - mean) ** 2).sum(-1)
            used = weights * (spread**2 / (spread**2 + away)) ** 2
            variance = (used * away).sum(0) / np.maximum(3 * used.sum(0), 1e-12)
        mean = (used[..., None] * colors).sum(0) / np.maximum(used.sum(0), 1e-12)[:, None]
    show = wanted.astype(bool)
    return (np.where(show[..., None], mean.reshape(height, width, 3), 0),
            np.where(show, np.sqrt(variance).reshape(height, width), 0),
            np.where(show, used.sum(0).reshape(height, width), 0))
