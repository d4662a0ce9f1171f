"""The pixels that a reconstruction learns from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..capture import Camera, Capture
from .grid import camera_row

__all__ = ["Batches", "TrainingPixels"]


class TrainingPixels:
    """The training pixels in one array, and the 4x4 tiles that are worth casting."""

    def __init__(self, capture: Capture, views: NDArray[np.int64]) -> None:
        self.has_alpha = capture.alphas is not None
        planes, starts, tiles, total = [], [], [], 0
        for number, view in enumerate(views):
            image = capture.images[view]
            height, width = image.shape[:2]
            alpha = (capture.alphas[view] if capture.alphas is not None
                     else np.full((height, width), 255, np.uint8))
            planes.append(np.dstack([image, alpha]).reshape(-1, 4))
            starts.append(total)
            total += height * width
            tiles.append(self._tiles(number, alpha))
        self.pixels = np.ascontiguousarray(np.concatenate(planes))
        self.starts = np.array(starts, np.int64)
        self.tiles = np.concatenate(tiles)
        cameras = capture.cameras[views]
        self.sizes = np.stack([cameras.width, cameras.height], 1)
        self.place(cameras)

    def place(self, cameras: Camera) -> None:
        """Cast the rays from these cameras from now on."""
        self.cameras = np.stack([camera_row(cameras, view) for view in range(len(cameras))])

    def cube_rays(self, tiles: NDArray[np.int32], center: NDArray[np.float64],
                  radius: NDArray[np.float64]) -> NDArray[np.float32]:
        """The 16 rays of each tile in the coordinates of a box's cube: float32 [16 T, 6]."""
        inner = np.arange(16)
        view = np.repeat(tiles[:, 0], 16)
        x = np.minimum((tiles[:, 2, None] + (inner & 3)).ravel(), self.sizes[view, 0] - 1) + 0.5
        y = np.minimum((tiles[:, 1, None] + (inner >> 2)).ravel(), self.sizes[view, 1] - 1) + 0.5
        camera = self.cameras[view]
        across = (x - camera[:, 14]) / camera[:, 12]
        down = (y - camera[:, 15]) / camera[:, 13]
        pose = camera[:, :12].reshape(-1, 3, 4)
        directions = pose[:, :, 0] * across[:, None] + pose[:, :, 1] * down[:, None] + pose[:, :, 2]
        directions /= radius
        rays = np.empty((len(view), 6), np.float32)
        rays[:, :3] = (pose[:, :, 3] - center) / radius
        rays[:, 3:] = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return rays

    def _tiles(self, view: int, alpha: NDArray[np.uint8]) -> NDArray[np.int32]:
        """Tiles that show the person or border on them: [T, 3] (view, row, column)."""
        height, width = alpha.shape
        padded = np.zeros((-(-height // 4) * 4, -(-width // 4) * 4), np.uint8)
        padded[:height, :width] = alpha
        shown = padded.reshape(padded.shape[0] // 4, 4, -1, 4).max(axis=(1, 3)) > 12
        if self.has_alpha:
            shown = ndimage.binary_dilation(shown, iterations=3)
        rows, columns = np.nonzero(shown)
        return np.stack([np.full(len(rows), view), 4 * rows, 4 * columns], 1).astype(np.int32)


class Batches:
    """Tiles in random order, each as often as the others; a function of the step's number.

    Nothing but the number of the step need be kept to go on from any step.

    Parameters
    ----------
    data
        The pixels.
    size
        Tiles a step.
    seed, level
        What the order follows from.
    """

    def __init__(self, data: TrainingPixels, size: int, seed: int, level: int) -> None:
        self.data, self.size = data, max(1, min(size, len(data.tiles)))
        self.seed, self.level = seed, level
        self._epoch = -1
        self._order = np.zeros(0, np.int64)

    def generator(self, kind: int, number: int) -> np.random.Generator:
        """Random numbers of one step (``kind`` 0) or one pass over the tiles (``kind`` 1)."""
        return np.random.Generator(np.random.Philox(
            key=[self.seed, self.level], counter=[0, 0, kind, number]))

    def step(self, number: int) -> NDArray[np.int32]:
        """The tiles of a step: those of one view side by side, so that neighbours share the cache.

        int32 [T, 3].
        """
        epoch, place = divmod(number, len(self.data.tiles) // self.size)
        if epoch != self._epoch:
            self._epoch = epoch
            self._order = self.generator(1, epoch).permutation(len(self.data.tiles))
        tiles = self.data.tiles[self._order[place * self.size:(place + 1) * self.size]]
        return np.asarray(tiles[np.lexsort((tiles[:, 2], tiles[:, 1], tiles[:, 0]))])
