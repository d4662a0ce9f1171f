"""The training pixels of a reconstruction."""


import numpy as np
from scipy import ndimage

from ...arrays import Array, Float32, Float64, Int32, Int64, UInt8
from ...capture import Camera, Capture
from ...simd.threads import side_by_side

IMPORTANCE = 0.7  # Share of rays sampled where the error is large (docs/reconstruction.md).
_EDGE = -0.15  # Cosine to a surface from which on a photo may show it, or its outline.
_AROUND = 2  # Tiles around those that show a place which do, too: what was trained stood out there.


class TrainingPixels:
    """The training pixels in one array, and the 4x4 tiles that are worth casting."""

    def __init__(self, capture: Capture, views: Int64) -> None:
        self.has_alpha = capture.alphas is not None
        shapes = [capture.images[view].shape[:2] for view in views]
        ends = np.cumsum([height * width for height, width in shapes])
        self.starts = np.append(0, ends[:-1]).astype(np.int64)
        self.pixels = np.empty((int(ends[-1]), 4), np.uint8)

        def take(number: int) -> Int32:
            """Write a view's pixels, and give its tiles."""
            image = capture.images[views[number]]
            alpha = (capture.alphas[views[number]] if capture.alphas is not None
                     else np.full(image.shape[:2], 255, np.uint8))
            own = self.pixels[self.starts[number]:ends[number]].reshape(*alpha.shape, 4)
            own[..., :3], own[..., 3] = image, alpha
            return self._tiles(number, alpha)

        self.tiles = np.concatenate(side_by_side(take, range(len(views))))
        cameras = capture.cameras[views]
        self.sizes = np.stack([cameras.width, cameras.height], 1)
        self.place(cameras)

    def place(self, cameras: Camera) -> None:
        """Cast the rays from these cameras from now on."""
        self.cameras = np.stack([cameras.row(view) for view in range(len(cameras))])

    def lay_mattes(self, mattes: list[UInt8]) -> None:
        """Learn from these mattes of the training views from now on; the tiles stay the same."""
        for view, matte in enumerate(mattes):
            width, height = self.sizes[view]
            first = self.starts[view]
            self.pixels[first:first + width * height, 3] = matte.ravel()

    def cube_rays(self, tiles: Int32, center: Float64, radius: Float64) -> Float32:
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

    def showing(self, points: Float64, outwards: Float64) -> Int32:
        """The tiles that show places of a surface, or its outline there: [T, 3], as `tiles`.

        Places and the surface's unit normals there are float64 [N, 3] each; what hides them is not
        asked for.
        """
        found = []
        for view, camera in enumerate(self.cameras):
            pose = camera[:12].reshape(3, 4)
            ways = pose[:, 3] - points
            facing = (ways * outwards).sum(axis=1) > _EDGE * np.linalg.norm(ways, axis=1)
            across, down, ahead = -(ways[facing] @ pose[:, :3]).T
            ahead = np.where(ahead > 0, ahead, np.nan)
            own = self.tiles[self.tiles[:, 0] == view]
            shape = own[:, 1:].max(axis=0, initial=0) // 4 + 1
            row = (down / ahead * camera[13] + camera[15]) // 4
            column = (across / ahead * camera[12] + camera[14]) // 4
            inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
            shown = np.zeros(shape, bool)
            shown[row[inside].astype(int), column[inside].astype(int)] = True
            shown = ndimage.binary_dilation(shown, np.ones((3, 3)), iterations=_AROUND)
            found.append(own[shown[own[:, 1] // 4, own[:, 2] // 4]])
        return np.concatenate(found)

    def _tiles(self, view: int, alpha: UInt8) -> Int32:
        """Tiles that show the person or border on them: [T, 3] (view, row, column)."""
        height, width = alpha.shape
        padded = np.zeros((-(-height // 4) * 4, -(-width // 4) * 4), np.uint8)
        padded[:height, :width] = alpha
        # First four rows, whose values lie one behind the other: much faster than both at once.
        most = padded.reshape(-1, 4, padded.shape[1]).max(axis=1)
        shown = most.reshape(len(most), -1, 4).max(axis=2) > 12
        if self.has_alpha:
            shown = ndimage.binary_dilation(shown, iterations=3)
        rows, columns = np.nonzero(shown)
        return np.stack([np.full(len(rows), view), 4 * rows, 4 * columns], 1).astype(np.int32)


class Batches:
    """Tiles in random order, more often where the error is large (importance sampling).

    Every eighth of a pass over the tiles, the next eighth is chosen. Each tile is given a share of
    it by its importance, which is one part the same for all and another the mean squared error
    lately found in the tile's block of 12x12 pixels; the tiles with the most unused shares have
    their turn. While nothing is known of errors each tile comes once a pass.

    Parameters
    ----------
    size : Tiles a step.
    seed, level : What the order follows from.
    importance : Share of the rays that errors draw, from 0 to 1.
    tiles : [T, 3], some of the data's; None: all of them.
    """

    _PARTS, _BLOCK, _KEEP = 8, 12, 0.6

    def __init__(self, data: TrainingPixels, size: int, seed: int, level: int,
                 importance: float = 0.0, tiles: Int32 | None = None) -> None:
        self.tiles = data.tiles if tiles is None else tiles
        self.size = max(1, min(size, len(self.tiles)))
        self.seed, self.level, self.importance = seed, level, importance
        places = self.tiles // np.array([1, self._BLOCK, self._BLOCK], np.int32)
        _, self._block = np.unique(np.ravel_multi_index(
            tuple(places.T), tuple(places.max(axis=0) + 1)), return_inverse=True)
        # Error and tiles of each block, fading from one choice to the next; unused shares.
        self._error, self._seen = np.zeros((2, self._block.max() + 1))
        self._credit = np.zeros(len(self.tiles), np.float32)
        self._part, self._order, self._now = -1, np.zeros(0, np.int64), np.zeros(0, np.int64)

    def generator(self, kind: int, number: int) -> np.random.Generator:
        """Random numbers of one step (``kind`` 0) or one choice of tiles (``kind`` 1)."""
        return np.random.Generator(np.random.Philox(
            key=[self.seed, self.level], counter=[0, 0, kind, number]))

    @property
    def _steps(self) -> int:
        """Steps for which tiles are chosen together."""
        return max(1, len(self.tiles) // self.size // self._PARTS)

    def chooses(self, number: int) -> bool:
        """Whether tiles are chosen for a step: by the errors of all steps before it."""
        return number // self._steps != self._part

    def step(self, number: int) -> Int32:
        """The tiles of a step: those of one view side by side, so that neighbours share the cache.

        Steps are taken one after the other. int32 [T, 3].
        """
        part, place = divmod(number, self._steps)
        if part != self._part:
            self._part = part
            self._order = self._chosen(self.generator(1, part), self._steps * self.size)
        now = self._order[place * self.size:(place + 1) * self.size]
        # Tiles are numbered view by view, and row by row in each.
        self._now = np.sort(now)
        return np.asarray(self.tiles[self._now])

    def _chosen(self, generator: np.random.Generator, count: int) -> Int64:
        """The next ``count`` tiles, in random order."""
        weight = np.ones(len(self._credit), np.float32)
        if self.importance > 0 and self._error.any():
            mean = self._error.sum() / self._seen.sum()
            error = ((self._error + mean) / (self._seen + 1.0))[self._block]
            weight += self.importance * (error / error.mean() - 1.0).astype(np.float32)
            self._error *= self._KEEP
            self._seen *= self._KEEP
        self._credit += weight * np.float32(count / len(weight))
        turn = generator.random(len(weight), np.float32) - self._credit
        chosen = np.argpartition(turn, count - 1)[:count]
        self._credit[chosen] -= 1.0
        return np.asarray(chosen[generator.permutation(count)])

    @property
    def blocks(self) -> Int64:
        """The blocks of the last step's tiles, [T]."""
        return np.asarray(self._block[self._now])

    def learn(self, errors: Float32, block: Int64 | None = None) -> None:
        """Take in the squared errors of a step's tiles, [T], by their blocks: the last step's."""
        if block is None:
            block = self.blocks
        np.add.at(self._error, block, errors)
        np.add.at(self._seen, block, 1.0)

    @property
    def state(self) -> dict[str, Array]:
        """What the next steps follow from."""
        return {"batch_error": self._error, "batch_seen": self._seen, "batch_credit": self._credit,
                "batch_order": self._order, "batch_part": np.array(self._part)}

    def restore(self, state: dict[str, Array]) -> None:
        """Go on from such a state."""
        self._error, self._seen = state["batch_error"], state["batch_seen"]
        self._credit, self._order = state["batch_credit"], state["batch_order"]
        self._part = int(state["batch_part"])
