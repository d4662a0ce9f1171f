"""Reconstruction: Plenoxels' optimisation on the CPU, coarse to fine.

Each level of resolution trains density and colour by RMSProp on the squared colour error (Shen et
al. 2023, Eq. 2) with total variation (Eq. 3); between levels, lattice points that no training ray
sees are pruned and the rest are upsampled. Where the photos have mattes, the field starts from
their visual hull, the opacity of each ray is fitted, too, and every batch is composited on random
backgrounds, so that empty space ends clean; rays that the hull and the mattes make idle are not
drawn. Steps are counted in rays, not in seconds, unless a time budget is given.
"""

from __future__ import annotations

import time
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import numpy as np
import tyro
from numpy.typing import NDArray
from scipy import ndimage

from ..capture import Capture
from ..errors import UserError
from ..files import atomic_write
from ..kernels.bricks import brick_table, row_width
from ..kernels.march import lattice_of_world
from ..kernels.train import rmsprop, total_variation, train_kernel
from ..metrics import psnr, ssim
from ..progress import Progress
from .grid import VoxelField, camera_row
from .hull import hull_box, visual_hull

__all__ = ["ReconstructConfig", "held_out_quality", "reconstruct", "reconstruct_with_figures"]


@dataclass(frozen=True)
class ReconstructConfig:
    """Parameters of the reconstruction (svox2's names where it has them)."""

    resolutions: tuple[int, ...] = (96, 192, 256)
    """Lattice points along the cube's edge, coarse to fine."""
    rays: tuple[float, ...] = (2.0, 5.0, 8.0)
    """Training rays of each level in millions."""
    batch: int = 24576
    """Rays per step."""
    sh_degree: int = 2
    """Degree of the spherical harmonics: 0 (matt), 1 or 2."""
    step_size: float = 0.5
    """Distance between samples in voxels."""
    lr_sigma: float = 30.0
    """Learning rate of the density at the start."""
    lr_sigma_final: float = 1.0
    """Learning rate of the density at the end."""
    lr_sh: float = 2e-2
    """Learning rate of the colour coefficients at the start."""
    lr_sh_final: float = 1e-3
    """Learning rate of the colour coefficients at the end."""
    rms_beta: float = 0.95
    """Decay of RMSProp's running mean."""
    lambda_tv: float = 1e-5
    """Weight of total variation on the density; halved at each finer level."""
    lambda_tv_sh: float = 1e-3
    """Weight of total variation on the colour; a tenth at the finest level."""
    tv_sparsity: float = 0.1
    """Share of the lattice points that total variation visits at each step."""
    lambda_sparsity: float = 0.0
    """Weight of the Cauchy sparsity loss log(1 + 2 sigma^2) on the samples."""
    lambda_alpha: float = 0.3
    """Weight of the squared opacity error where the photos have mattes."""
    prune: float = 0.004
    """Lattice points whose largest weight on any training ray is below this are dropped."""
    background: float = 1.0
    """Grey level behind photos without mattes, and behind test views."""
    time_budget: float = 0.0
    """Seconds that the reconstruction may take; 0 follows the rays given above."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the order of the rays."""


def reconstruct(capture: Capture, config: ReconstructConfig | None = None,
                progress: Progress | None = None, checkpoint: Path | None = None) -> VoxelField:
    """Reconstruct a radiance field from a capture: `reconstruct_with_figures`' field alone."""
    return reconstruct_with_figures(capture, config, progress, checkpoint)[0]


def reconstruct_with_figures(capture: Capture, config: ReconstructConfig | None = None,
                             progress: Progress | None = None, checkpoint: Path | None = None,
                             ) -> tuple[VoxelField, dict[str, Any]]:
    """Reconstruct a radiance field from a capture.

    Parameters
    ----------
    capture
        Views with their cameras in the portrait frame; held-out views are only tested on.
    config
        Parameters.
    progress
        Progress line.
    checkpoint
        File that the state is written to after each level; a run that finds one there goes on
        from it to the same field.

    Returns
    -------
    field, figures
        The field and the figures for ``--json``: ``test.psnr`` (dB) and ``test.ssim`` over the
        held-out views, ``train.rays``, ``train.rays_per_second``, ``voxels``, ``seconds``.

    Raises
    ------
    UserError
        If nothing is left to train on.
    """
    config = config or ReconstructConfig()
    if len(config.resolutions) != len(config.rays):
        raise UserError("give as many --rays as --resolutions, one a level")
    if config.sh_degree not in (0, 1, 2):
        raise UserError(f"--sh-degree must be 0, 1 or 2, not {config.sh_degree}")
    start = time.perf_counter()
    trainer = _Trainer(capture, config, progress)
    trainer.restore(checkpoint)
    while trainer.level < len(config.resolutions):
        trainer.run_level(start)
        trainer.save(checkpoint)
    trainer.drop_floaters()
    trained = time.perf_counter() - start
    field = trainer.field()
    figures: dict[str, Any] = {
        "train": {"rays": trainer.rays_done, "views": len(trainer.views),
                  "rays_per_second": trainer.rays_done / max(trained, 1e-9)},
        "voxels": len(field.density), "resolution": config.resolutions[-1],
        "levels": trainer.log, "device": "cpu"}
    if len(capture.testing()):
        figures["test"] = held_out_quality(field, capture, config.background)
    figures["seconds"] = {"train": round(trained, 3),
                          "test": round(time.perf_counter() - start - trained, 3)}
    if progress is not None and "test" in figures:
        progress.update(progress.total, f"held-out views {figures['test']['psnr']:.2f} dB")
    return field, figures


def held_out_quality(field: VoxelField, capture: Capture, background: float = 1.0,
                     ) -> dict[str, float]:
    """Mean PSNR (dB) and SSIM of the held-out views, composited on ``background``."""
    scores = []
    for view in capture.testing():
        image = np.clip(field.render(capture.cameras, view, background=background).color, 0, 1)
        truth = capture.image_float(view, background)
        scores.append((psnr(image, truth), ssim(image, truth)))
    means = np.mean(scores, axis=0)
    return {"psnr": float(means[0]), "ssim": float(means[1]), "views": len(scores)}


class _Pixels:
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
        self.cameras = np.stack([camera_row(cameras, view) for view in range(len(views))])

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


class _Trainer:
    """The state of one reconstruction."""

    def __init__(self, capture: Capture, config: ReconstructConfig,
                 progress: Progress | None) -> None:
        self.capture, self.config, self.progress = capture, config, progress
        self.views = capture.training()
        if len(self.views) < 3:
            raise UserError(f"{len(self.views)} training views are too few; give 20 or more photos")
        self.data = _Pixels(capture, self.views)
        if not len(self.data.tiles):
            raise UserError("the mattes of all photos are empty: there is nothing to reconstruct")
        self.center, self.radius = np.zeros(3), np.ones(3)
        if capture.alphas is not None:
            self.center, self.radius = hull_box(capture.cameras[self.views],
                                                [capture.alphas[view] for view in self.views])
        self.basis = (config.sh_degree + 1) ** 2
        self.width = row_width(self.basis)
        # One gradient array per worker, summed in a fixed order.
        self.workers = min(numba.get_num_threads(), 16)
        self.level, self.rays_done = 0, 0
        self.log: list[dict[str, Any]] = []
        self.links: NDArray[np.int32] = np.zeros((0, 0, 0), np.int32)
        self.density: NDArray[np.float32] = np.zeros(0, np.float32)
        self.rows: NDArray[np.float32] = np.zeros((0, self.width), np.float32)

    # -- state ------------------------------------------------------------------------------------

    def field(self) -> VoxelField:
        """The field as it is."""
        count = len(self.density) - 1
        sh = self.rows[:count, :3 * self.basis].reshape(count, 3, self.basis)
        return VoxelField(self.links, self.density[:count].copy(), np.ascontiguousarray(sh),
                          self.center, self.radius, self.capture.frame)

    def save(self, path: Path | None) -> None:
        """Write the state between two levels."""
        if path is None:
            return
        with atomic_write(path) as stream:
            np.savez(stream, level=self.level, rays=self.rays_done, links=self.links,
                     density=self.density, rows=self.rows, key=self._key())

    def restore(self, path: Path | None) -> None:
        """Go on from a checkpoint of the same capture and parameters, if there is one."""
        if path is None or not path.is_file():
            return
        try:
            with np.load(path, allow_pickle=False) as data:
                if str(data["key"]) == self._key():
                    self.level, self.rays_done = int(data["level"]), int(data["rays"])
                    self.links, self.density, self.rows = (data["links"], data["density"],
                                                           data["rows"])
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return

    def _key(self) -> str:
        return f"{self.config} {len(self.views)} {int(self.data.pixels[::997].sum())}"

    # -- levels -----------------------------------------------------------------------------------

    def run_level(self, start: float) -> None:
        """Refine the lattice and train it."""
        resolution = self.config.resolutions[self.level]
        if self.level == 0:
            self._begin(resolution)
        else:
            self._refine(resolution)
        begun = time.perf_counter()
        steps = max(1, round(self.config.rays[self.level] * 1e6 / self.config.batch))
        if self.config.time_budget > 0:
            share = self.config.rays[self.level] / sum(self.config.rays[self.level:])
            deadline = begun + share * max(
                1.0, 0.93 * self.config.time_budget - (begun - start))
        else:
            deadline = np.inf
        error = self._train(steps, deadline)
        self.log.append({"resolution": resolution, "voxels": len(self.density) - 1,
                         "train_psnr": round(-10 * float(np.log10(max(error, 1e-12))), 2),
                         "seconds": round(time.perf_counter() - begun, 2)})
        self.level += 1

    def _shape(self, resolution: int) -> tuple[int, int, int]:
        """Lattice points along z, y, x: ``resolution`` to two world units."""
        x, y, z = (max(8, round(resolution * float(r))) for r in self.radius)
        return z, y, x

    def _begin(self, resolution: int) -> None:
        if self.data.has_alpha:
            alphas = self.capture.alphas
            assert alphas is not None
            hull = visual_hull(self.capture.cameras[self.views],
                               [alphas[view] for view in self.views], self._shape(resolution),
                               self.center, self.radius)
            if not hull.any():
                raise UserError("the mattes of the photos have no common volume inside the "
                                "portrait frame; check the cameras and the mattes")
        else:
            hull = np.ones(self._shape(resolution), bool)
        count = int(hull.sum())
        self.links = np.full(hull.shape, -1, np.int32)
        self.links[hull] = np.arange(count, dtype=np.int32)
        # Opacity of about 0.1 a voxel: a ray sees through the first few voxels.
        self.density = np.full(count + 1, 0.05 * resolution if self.data.has_alpha else 0.1,
                               np.float32)
        self.density[-1] = 0.0
        self.rows = np.zeros((count + 1, self.width), np.float32)

    def _refine(self, resolution: int) -> None:
        """Prune what no training ray sees, and interpolate the rest on a finer lattice."""
        seen = self._largest_weights()
        keep = np.zeros(self.links.shape, bool)
        filled = self.links >= 0
        keep[filled] = seen[self.links[filled]] > self.config.prune
        keep = ndimage.binary_dilation(keep, np.ones((3, 3, 3), bool)) & filled
        if self.data.has_alpha:
            keep &= self._attached()
        # Coarse cell and place inside it of each fine plane, per axis (z, y, x).
        shape = self._shape(resolution)
        low, part = [], []
        for new, old in zip(shape, self.links.shape):
            place = (np.arange(new) + 0.5) / new * old - 0.5
            low.append(np.clip(np.floor(place).astype(int), 0, old - 2))
            part.append(np.clip(place - low[-1], 0.0, 1.0).astype(np.float32))
        corners = [(dz, dy, dx) for dz in (0, 1) for dy in (0, 1) for dx in (0, 1)]
        # A fine point lives where any of its coarse cell's corners does.
        fine = np.zeros(shape, bool)
        for corner in corners:
            fine |= keep[np.ix_(*(plane + step for plane, step in zip(low, corner)))]
        place_of = np.nonzero(fine)
        z, y, x = place_of
        count = len(z)
        density = np.zeros(count + 1, np.float32)
        rows = np.zeros((count + 1, self.width), np.float32)
        mass = np.zeros((count, 1), np.float32)
        for corner in corners:
            weight = np.ones(count, np.float32)
            for share, index, step in zip(part, place_of, corner):
                weight *= share[index] if step else 1 - share[index]
            row = self.links[tuple(plane[index] + step for plane, index, step
                                   in zip(low, place_of, corner))]
            there = row >= 0
            density[:count] += weight * np.where(there, self.density[row], 0.0)
            # Colour is not mixed with that of empty points, which have none.
            weight = (weight * there)[:, None]
            rows[:count] += weight * self.rows[row]
            mass += weight
        rows[:count] /= np.maximum(mass, 1e-6)
        self.links = np.full(fine.shape, -1, np.int32)
        self.links[z, y, x] = np.arange(count, dtype=np.int32)
        self.density, self.rows = density, rows

    def _attached(self) -> NDArray[np.bool_]:
        """Lattice points within two steps of the largest connected piece of solid matter.

        A person is one piece; what floats beside it comes from slivers of the mattes. Solid is
        what takes a twentieth of the light along one voxel.
        """
        voxel = 2.0 * float(self.radius[0]) / self.links.shape[2]
        solid = np.zeros(self.links.shape, bool)
        filled = self.links >= 0
        solid[filled] = self.density[self.links[filled]] * voxel > 0.05
        pieces, count = ndimage.label(solid)
        if count > 1:
            sizes = np.bincount(pieces.ravel())
            sizes[0] = 0
            solid = pieces == int(sizes.argmax())
        if not count:
            return filled
        return np.asarray(ndimage.binary_dilation(solid, np.ones((3, 3, 3), bool), iterations=2))

    def drop_floaters(self) -> None:
        """Remove what is not attached to the person, once the last level is trained."""
        if not self.data.has_alpha:
            return
        keep = (self.links >= 0) & self._attached()
        old = self.links[keep]
        order = np.sort(old)
        place = np.full(len(self.density), -1, np.int32)
        place[order] = np.arange(len(order), dtype=np.int32)
        self.links = np.where(keep, place[self.links], -1).astype(np.int32)
        last = np.array([len(self.density) - 1])
        rows = np.concatenate([order, last])
        self.density, self.rows = self.density[rows], self.rows[rows]

    # -- optimisation -----------------------------------------------------------------------------

    def _geometry(self) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]:
        table, links = brick_table(self.links, len(self.density) - 1)
        shape = self.links.shape
        scale, offset = lattice_of_world(self.center, self.radius,
                                         (shape[0], shape[1], shape[2]))
        return table, links, np.concatenate([np.array(shape[::-1], float), scale, offset])

    def _largest_weights(self) -> NDArray[np.float32]:
        """The largest weight of each row on a quarter of the training tiles."""
        table, links, lattice = self._geometry()
        rows = len(self.density)
        seen = np.zeros((self.workers, rows), np.float32)
        tiles = self.data.tiles[self.level % 4::4]
        options = np.array([self.config.step_size, 1e-8, 1e-3, 0.0, 0.0, 1.0])
        one = np.zeros((self.workers, 1), np.float32)
        train_kernel(self.width)(
            table, links, self.density, self.rows.ravel(), lattice, self.basis, self.data.cameras,
            self.data.sizes, self.data.starts, self.data.pixels, tiles,
            np.zeros((len(tiles), 3), np.float32), options, one, one,
            np.zeros((self.workers, 1), np.uint8), seen, np.zeros((self.workers, 2)))
        return seen.max(axis=0)

    def _neighbours(self) -> NDArray[np.int32]:
        """Rows of the six neighbours of each row, the row itself where there is none."""
        z, y, x = np.nonzero(self.links >= 0)
        own = self.links[z, y, x]
        found = np.empty((len(own), 6), np.int32)
        top, high, wide = (n - 1 for n in self.links.shape)
        for column, (dz, dy, dx) in enumerate(((0, 0, 1), (0, 1, 0), (1, 0, 0),
                                               (0, 0, -1), (0, -1, 0), (-1, 0, 0))):
            there = self.links[np.clip(z + dz, 0, top), np.clip(y + dy, 0, high),
                               np.clip(x + dx, 0, wide)]
            found[own, column] = np.where(there >= 0, there, own)
        return found

    def _train(self, steps: int, deadline: float) -> float:
        config, data = self.config, self.data
        resolution = config.resolutions[self.level]
        table, links, lattice = self._geometry()
        count = len(self.density)
        kernel = train_kernel(self.width)
        flat = self.rows.ravel()
        grad_density = np.zeros((self.workers, count), np.float32)
        grad_rows = np.zeros((self.workers, flat.size), np.float32)
        touched = np.zeros((self.workers, count), np.uint8)
        square_density, square_rows = np.zeros(count, np.float32), np.zeros_like(flat)
        losses = np.zeros((self.workers, 2))
        unused = np.zeros((self.workers, 1), np.float32)
        neighbours = self._neighbours()
        order = np.arange(count - 1, dtype=np.int32)
        # A density that takes less than 1e-4 of the light in a step is left alone: it teaches
        # nothing, and most samples are of this kind.
        delta = config.step_size * 2.0 * float(self.radius[0]) / self.links.shape[2]
        options = np.array([config.step_size, 1e-4 / delta, 1e-4,
                            config.lambda_alpha if data.has_alpha else 0.0,
                            config.lambda_sparsity, 0.0])
        finest = self.level == len(config.resolutions) - 1
        # Without mattes the first, wrong, gradients would clear space for good: until the last
        # level a trace of density stays, which can grow again.
        lowest = np.float32(0.0 if data.has_alpha or finest else 2e-4 / delta)
        tv = config.lambda_tv * 0.5 ** self.level
        tv_sh = config.lambda_tv_sh * (0.1 if finest else 1.0)
        tiles_per_step = max(1, config.batch // 16)
        generator = np.random.Generator(np.random.Philox(key=[config.seed, self.level]))
        pool = data.tiles[generator.permutation(len(data.tiles))]
        place, error, used = 0, 0.0, 0
        before = sum(config.rays[:self.level]) / sum(config.rays)
        share = config.rays[self.level] / sum(config.rays)
        for step in range(steps):
            if place + tiles_per_step > len(pool):
                pool, place = data.tiles[generator.permutation(len(data.tiles))], 0
            tiles = pool[place:place + tiles_per_step]
            place += tiles_per_step
            # Tiles of one view side by side, so that neighbours share bricks in the cache.
            tiles = tiles[np.lexsort((tiles[:, 2], tiles[:, 1], tiles[:, 0]))]
            if data.has_alpha:
                background = np.repeat(generator.random((len(tiles), 1), np.float32), 3, axis=1)
            else:
                background = np.full((len(tiles), 3), config.background, np.float32)
            losses[:] = 0.0
            kernel(table, links, self.density, flat, lattice, self.basis, data.cameras, data.sizes,
                   data.starts, data.pixels, tiles, background, options, grad_density, grad_rows,
                   touched, unused, losses)
            first = int(generator.integers(0, max(1, count - 1)))
            run = max(1, int(config.tv_sparsity * (count - 1)))
            last = min(count - 1, first + run)
            if tv > 0:
                total_variation(order, neighbours, first, last, self.density, 1, 1, tv / run,
                                resolution / 256.0, grad_density[0], touched[0])
            if tv_sh > 0:
                total_variation(order, neighbours, first, last, flat, self.width, 3 * self.basis,
                                tv_sh / run, resolution / 256.0, grad_rows[0], touched[0])
            at = before + share * (step + 1) / steps
            rate = np.float32(config.lr_sigma * (config.lr_sigma_final / config.lr_sigma) ** at)
            rate_sh = np.float32(config.lr_sh * (config.lr_sh_final / config.lr_sh) ** at)
            beta, floor = np.float32(config.rms_beta), np.float32(1e-8)
            if not data.has_alpha and self.level == 0:
                rate *= np.float32(min(1.0, 0.01 + step / 100.0))
            rmsprop(self.density, 1, 1, grad_density, touched, square_density, rate, beta, floor,
                    lowest, False)
            rmsprop(flat, self.width, 3 * self.basis, grad_rows, touched, square_rows, rate_sh,
                    beta, floor, np.float32(-1e30), True)
            self.density[-1] = 0.0
            flat[-self.width:] = 0.0
            grad_density[:, -1] = 0.0
            self.rays_done += 16 * len(tiles)
            recent = losses.sum(axis=0)
            error = 0.98 * error + recent[0]
            used = 0.98 * used + 3 * recent[1]
            if self.progress is not None and step % 8 == 0:
                self.progress.total = 1000
                self.progress.update(int(1000 * at),
                                     f"{resolution}^3, {count / 1e6:.2f} M voxels, "
                                     f"{-10 * np.log10(max(error / used, 1e-12)):.1f} dB")
            if time.perf_counter() > deadline:
                break
        return error / max(used, 1.0)
