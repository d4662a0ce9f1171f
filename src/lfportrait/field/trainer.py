"""The optimisation itself: one lattice, trained level by level (`lfportrait.field.reconstruct`)."""

from __future__ import annotations

import time
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from ..capture import Capture
from ..errors import UserError
from ..files import atomic_write
from ..kernels.bricks import row_width
from ..kernels.descent import rmsprop, total_variation
from ..kernels.train import train_kernel
from ..progress import Progress
from .background import Background, BackgroundTrainer
from .config import ReconstructConfig
from .exposure import exposure_gains
from .grid import VoxelField
from .hull import hull_box, visual_hull
from .lattice import Lattice, box_shape
from .pixels import TrainingPixels
from .sweep import fuse, scene_box, small_view, sweep_depth

__all__ = ["Trainer"]


class Trainer:
    """The state of one reconstruction."""

    def __init__(self, capture: Capture, config: ReconstructConfig,
                 progress: Progress | None) -> None:
        self.capture, self.config, self.progress = capture, config, progress
        self.views = capture.training()
        if len(self.views) < 3:
            raise UserError(f"{len(self.views)} training views are too few; give 20 or more photos")
        self.data = TrainingPixels(capture, self.views)
        if not len(self.data.tiles):
            raise UserError("the mattes of all photos are empty: there is nothing to reconstruct")
        self.basis = (config.sh_degree + 1) ** 2
        self.width = row_width(self.basis)
        # One gradient array per worker, summed in a fixed order.
        self.workers = min(numba.get_num_threads(), 16)
        self.level, self.rays_done = 0, 0
        self.log: list[dict[str, Any]] = []
        self.lattice: Lattice | None = None
        self.background: Background | None = None
        # Exposures: what photos are divided by; held-out photos have theirs, too.
        self.gains = np.ones((len(self.views), 3))
        self.test_gains = np.ones((len(capture.testing()), 3))

    @property
    def scale(self) -> NDArray[np.float32]:
        """What the kernel multiplies 8-bit colours of each view with, [V, 3]."""
        return (1.0 / (255.0 * self.gains)).astype(np.float32)

    # -- state ------------------------------------------------------------------------------------

    def field(self) -> VoxelField:
        """The field as it is."""
        lattice = self.lattice
        assert lattice is not None
        count = lattice.count
        sh = lattice.rows[:count, :3 * self.basis].reshape(count, 3, self.basis)
        return VoxelField(lattice.links, lattice.density[:count].copy(), np.ascontiguousarray(sh),
                          lattice.center, lattice.radius, self.capture.frame, self.background)

    def save(self, path: Path | None) -> None:
        """Write the state between two levels."""
        if path is None or self.lattice is None:
            return
        behind: dict[str, Any] = {} if self.background is None else {
            "background_links": self.background.links, "background_data": self.background.data}
        with atomic_write(path) as stream:
            np.savez(stream, level=self.level, rays=self.rays_done, links=self.lattice.links,
                     density=self.lattice.density, rows=self.lattice.rows,
                     center=self.lattice.center, radius=self.lattice.radius, key=self._key(),
                     gains=self.gains, test_gains=self.test_gains, **behind)

    def restore(self, path: Path | None) -> None:
        """Go on from a checkpoint of the same capture and parameters, if there is one."""
        if path is None or not path.is_file():
            return
        try:
            with np.load(path, allow_pickle=False) as data:
                if str(data["key"]) == self._key():
                    self.lattice = Lattice(data["links"], data["density"], data["rows"],
                                           data["center"], data["radius"])
                    if "background_links" in data:
                        self.background = Background(data["background_links"],
                                                     data["background_data"])
                    self.gains, self.test_gains = data["gains"], data["test_gains"]
                    self.level, self.rays_done = int(data["level"]), int(data["rays"])
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return

    def _key(self) -> str:
        return (f"{self.config} {len(self.views)} {int(self.data.pixels[::997].sum())} "
                f"{self.workers}")

    # -- levels -----------------------------------------------------------------------------------

    def run_level(self, start: float) -> None:
        """Refine the lattice and train it; ``start`` is when the reconstruction began."""
        config = self.config
        resolution = config.resolutions[self.level]
        if self.lattice is None:
            self.lattice = self._first(resolution)
        else:
            self.lattice = self._refined(resolution)
        begun = time.perf_counter()
        steps = max(1, round(config.rays[self.level] * 1e6 / config.batch[self.level]))
        deadline = np.inf
        if config.time_budget > 0:
            share = config.rays[self.level] / sum(config.rays[self.level:])
            deadline = begun + share * max(1.0, 0.93 * config.time_budget - (begun - start))
        error = self._train(steps, deadline)
        self.log.append({"resolution": resolution, "voxels": self.lattice.count,
                         "train_psnr": round(-10 * float(np.log10(max(error, 1e-12))), 2),
                         "seconds": round(time.perf_counter() - begun, 2)})
        self.level += 1

    def _first(self, resolution: int) -> Lattice:
        """The lattice to start from: the visual hull of the mattes, or the whole cube."""
        center, radius = np.zeros(3), np.ones(3)
        alphas = self.capture.alphas
        if alphas is None:
            return self._first_room(resolution)
        cameras, mattes = self.capture.cameras[self.views], [alphas[view] for view in self.views]
        center, radius = hull_box(cameras, mattes)
        points = visual_hull(cameras, mattes, box_shape(resolution, radius), center, radius)
        if not points.any():
            raise UserError("the mattes of the photos have no common volume inside the "
                            "portrait frame; check the cameras and the mattes")
        # Opacity of about 0.1 a voxel: a ray sees through the first few voxels.
        return Lattice.filled(points, 0.05 * resolution, self.width, center, radius)

    def _first_room(self, resolution: int) -> Lattice:
        """Without mattes: the surfaces that a plane sweep finds, or else a cube of haze."""
        config = self.config
        maps = sweep_depth(self.capture, self.views) if config.sweep else []
        box = scene_box(maps, 1.0, config.reach) if maps else None
        if box is not None and config.exposure:
            held_out = [small_view(self.capture, int(view)) for view in self.capture.testing()]
            self.gains, self.test_gains = exposure_gains(maps, held_out)
        if box is None:
            center, radius = np.zeros(3), np.ones(3)
            # Rays see through most of the cube at first, and the density must grow slowly: wrong
            # matter near the cameras would hide the rest.
            if config.sweep:
                self.config = config = replace(config, lr_sigma=min(config.lr_sigma, 0.3))
            lattice = Lattice.filled(np.ones(box_shape(resolution, radius), bool), 0.1, self.width,
                                     center, radius)
        else:
            center, radius = box
            surfaces = fuse(maps, resolution, center, radius)
            lattice = Lattice.filled(surfaces.keep, 0.01 * resolution, self.width, center, radius)
            rows = lattice.links[surfaces.solid]
            lattice.density[rows] = 0.15 * resolution
            for channel in range(3):
                lattice.rows[rows, channel * self.basis] = surfaces.color[surfaces.solid, channel]
        layers = config.background_nlayers
        if layers:
            coarse = max(16, config.background_reso >> (len(config.resolutions) - 1))
            self.background = Background.seen(
                [self.data.cube_rays(self.data.tiles[part::16], center, radius)
                 for part in range(4)], coarse, layers, 1.0)
        return lattice

    def _refined(self, resolution: int) -> Lattice:
        """Prune what no training ray sees, and interpolate the rest on a finer lattice."""
        assert self.lattice is not None
        shape = box_shape(resolution, self.lattice.radius)
        growth = float(np.prod(shape)) / self.lattice.links.size
        weights, least = self._largest_weights(), self.config.prune
        keep = self.lattice.seen(weights, least)
        while keep.sum() * growth > 1e6 * self.config.max_voxels and least < 1.0:
            least *= 1.5
            keep = self.lattice.seen(weights, least)
        if self.data.has_alpha:
            keep &= self.lattice.attached()
        if self.background is not None:
            self.background = self.background.upsampled()
        return self.lattice.refined(shape, keep)

    def finish(self) -> None:
        """Remove what no ray sees and what is not attached, once the last level is trained."""
        assert self.lattice is not None
        keep = self.lattice.seen(self._largest_weights(), self.config.prune)
        if self.data.has_alpha:
            keep &= self.lattice.attached()
        self.lattice = self.lattice.kept(keep)

    def _largest_weights(self) -> NDArray[np.float32]:
        """The largest weight of each row on an eighth of the training tiles."""
        assert self.lattice is not None
        lattice = self.lattice
        table, links, geometry = lattice.geometry()
        seen = np.zeros((self.workers, len(lattice.density)), np.float32)
        tiles = self.data.tiles[self.level % 8::8]
        # Behind a transmittance of ``prune`` no weight is larger than that: a ray may end there.
        step = self.config.step_size
        options = np.array([step, 1e-4 / (step * lattice.voxel), self.config.prune, 0.0, 0.0, 0.0,
                            1.0, self.config.near_clip])
        one = np.zeros((self.workers, 1), np.float32)
        train_kernel(self.width)(
            table, links, lattice.density, lattice.rows.ravel(), geometry, self.basis,
            self.data.cameras, self.data.sizes, self.data.starts, self.data.pixels, self.scale,
            tiles, np.zeros((16 * len(tiles), 3), np.float32), options, one,
            np.zeros((1, 3), np.float32), np.zeros((self.workers, 1), np.uint8), seen,
            np.zeros((self.workers, 2)))
        return np.asarray(seen.max(axis=0))

    # -- optimisation -----------------------------------------------------------------------------

    def _rate(self, first: float, last: float, done: float) -> np.float32:
        """Learning rates fall geometrically with the share of the rays that are done."""
        return np.float32(first * (last / first) ** done)

    def _train(self, steps: int, deadline: float) -> float:
        """Train one level; returns the mean squared error of the last steps."""
        assert self.lattice is not None
        config, data, lattice = self.config, self.data, self.lattice
        density, flat, count = lattice.density, lattice.rows.ravel(), lattice.count
        table, links, geometry = lattice.geometry()
        resolution = config.resolutions[self.level]
        kernel = train_kernel(self.width)
        gradients = np.zeros((self.workers, flat.size), np.float32)
        touched = np.zeros((self.workers, count + 1), np.uint8)
        mean_square = np.zeros_like(flat)
        losses, unused = np.zeros((self.workers, 2)), np.zeros((self.workers, 1), np.float32)
        neighbours = lattice.neighbours()
        # A density that takes less than 1e-4 of the light in a step is left alone: it teaches
        # nothing, and most samples are of this kind.
        delta = config.step_size * lattice.voxel
        options = np.array([config.step_size, 1e-4 / delta, config.stop_thresh,
                            config.lambda_alpha if data.has_alpha else 0.0,
                            config.lambda_sparsity, config.lambda_distortion, 0.0,
                            config.near_clip])
        finest = self.level == len(config.resolutions) - 1
        # Without mattes the first, wrong, gradients would clear space for good: until the last
        # level a trace of density stays, which can grow again.
        lowest = np.float32(0.0 if data.has_alpha or finest else 2e-4 / delta)
        tv = config.lambda_tv * 0.5 ** self.level
        tv_sh = config.lambda_tv_sh * (0.1 if finest else 1.0)
        behind = (None if self.background is None else
                  BackgroundTrainer(self.background, self.workers, config.background))
        batches = _Batches(data, max(1, config.batch[self.level] // 16), [config.seed, self.level])
        error, used = 0.0, 0
        before = sum(config.rays[:self.level]) / sum(config.rays)
        share = config.rays[self.level] / sum(config.rays)
        for step in range(steps):
            tiles = batches.next()
            rays = None
            if behind is not None:
                rays = data.cube_rays(tiles, lattice.center, lattice.radius)
                ground = behind.background.color(rays, config.background)
            elif data.has_alpha:
                ground = np.repeat(np.repeat(batches.generator.random(
                    (len(tiles), 1), np.float32), 3, axis=1), 16, axis=0)
            else:
                ground = np.full((16 * len(tiles), 3), config.background, np.float32)
            slopes = np.empty_like(ground)
            losses[:] = 0.0
            kernel(table, links, density, flat, geometry, self.basis, data.cameras, data.sizes,
                   data.starts, data.pixels, self.scale, tiles, ground, options, gradients,
                   slopes, touched, unused, losses)
            first = int(batches.generator.integers(0, max(1, count)))
            run = max(1, int(config.tv_sparsity * count))
            last = min(count, first + run)
            scale = resolution / 256.0
            if tv > 0:
                total_variation(neighbours, first, last, density, self.width, tv / run, scale,
                                gradients[0], touched[0])
            if tv_sh > 0:
                total_variation(neighbours, first, last, flat, self.width, tv_sh / run, scale,
                                gradients[0], touched[0])
            done = before + share * (step + 1) / steps
            rate = self._rate(config.lr_sigma, config.lr_sigma_final, done)
            rate_sh = self._rate(config.lr_sh, config.lr_sh_final, done)
            if not data.has_alpha and self.level == 0:
                rate *= np.float32(min(1.0, 0.01 + step / 100.0))
            rmsprop(density, flat, self.width, gradients, touched, mean_square, rate, rate_sh,
                    np.float32(config.rms_beta), np.float32(1e-8), lowest)
            gradients[:, -self.width:] = 0.0
            if behind is not None and rays is not None:
                fall = rate / config.lr_sigma
                fall_sh = rate_sh / config.lr_sh
                behind.step(rays, ground, slopes, float(config.lr_color_bg * fall_sh),
                            float(config.lr_sigma_bg * fall))
            self.rays_done += 16 * len(tiles)
            recent = losses.sum(axis=0)
            error = 0.98 * error + recent[0]
            used = 0.98 * used + 3 * recent[1]
            if self.progress is not None and step % 8 == 0:
                self.progress.total = 1000
                self.progress.update(int(1000 * done),
                                     f"{resolution}^3, {count / 1e6:.2f} M voxels, "
                                     f"{-10 * np.log10(max(error / used, 1e-12)):.1f} dB")
            if time.perf_counter() > deadline:
                break
        return error / max(used, 1.0)


class _Batches:
    """Tiles in random order, each as often as the others."""

    def __init__(self, data: TrainingPixels, size: int, key: list[int]) -> None:
        self.data, self.size = data, size
        self.generator = np.random.Generator(np.random.Philox(key=key))
        self.pool = data.tiles[self.generator.permutation(len(data.tiles))]
        self.place = 0

    def next(self) -> NDArray[np.int32]:
        """The next tiles: those of one view side by side, so that neighbours share the cache."""
        if self.place + self.size > len(self.pool):
            self.pool = self.data.tiles[self.generator.permutation(len(self.data.tiles))]
            self.place = 0
        tiles = self.pool[self.place:self.place + self.size]
        self.place += self.size
        return tiles[np.lexsort((tiles[:, 2], tiles[:, 1], tiles[:, 0]))]
