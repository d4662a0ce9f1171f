"""Gaussian splats pixel by pixel, in float64: the formulas of Kerbl et al. 2023."""

import numpy as np

from tests.reference.raycast import sh_basis


def _axes(turns):
    w, x, y, z = np.asarray(turns, np.float64).T
    return np.moveaxis(np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]), 2, 0)


def layers(splats, cameras, view):
    """Color times alpha, and alpha, [H, W, 4]."""
    height, width = int(cameras.height[view]), int(cameras.width[view])
    world, eye = cameras.pose[view, :3, :3], cameras.pose[view, :3, 3]
    focal, center = cameras.focal[view], cameras.center[view]
    places = (np.asarray(splats.positions, np.float64) - eye) @ world
    axes = _axes(splats.turns)
    rows, columns = np.mgrid[:height, :width] + 0.5
    image = np.zeros((height, width, 4))
    through = np.ones((height, width))
    for n in np.argsort(places[:, 2], kind="stable"):
        x, y, z = places[n]
        if z < 0.05:
            continue
        spread = axes[n] * np.asarray(splats.scales, np.float64)[n]
        flat = np.array([[focal[0] / z, 0, -focal[0] * x / z ** 2],
                         [0, focal[1] / z, -focal[1] * y / z ** 2]]) @ world.T
        covariance = flat @ spread @ spread.T @ flat.T + 0.3 * np.eye(2)
        inverse = np.linalg.inv(covariance)
        dx, dy = columns - (focal[0] * x / z + center[0]), rows - (focal[1] * y / z + center[1])
        power = -0.5 * (inverse[0, 0] * dx * dx + inverse[1, 1] * dy * dy) - inverse[0, 1] * dx * dy
        alpha = np.minimum(splats.opacity[n] * np.exp(power), 0.99)
        alpha = np.where((alpha >= 1 / 255) & (through >= 1e-4), alpha, 0)
        away = splats.positions[n] - eye
        basis = sh_basis(away / np.linalg.norm(away), splats.sh.shape[2])
        color = np.maximum(np.asarray(splats.sh, np.float64)[n] @ basis + 0.5, 0)
        image[..., :3] += (through * alpha)[..., None] * color
        through = through * (1 - alpha)
    image[..., 3] = 1 - through
    return image


def picture(splats, cameras, view, background):
    """On a grey background, [H, W, 3]."""
    image = layers(splats, cameras, view)
    return image[..., :3] + (1 - image[..., 3:]) * background


def loss(splats, cameras, view, weight):
    """A weighted sum of all numbers of a picture."""
    return float((layers(splats, cameras, view) * weight).sum())
