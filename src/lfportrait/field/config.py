"""Parameters of the reconstruction, under svox2's names where it has them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
import tyro

from ..errors import UserError

_LEAST = 0.4  # Share of a coarse level's usual rays that it has however short the time is.


def lattice_points(pixel: float) -> int:
    """Lattice points to two world units for pixels of this size (world units, at the origin).

    A voxel is about two pixels; 256 to 512.
    """
    return int(np.clip(32 * round(1.04 / max(pixel, 1e-3) / 32), 256, 512))


@dataclass(frozen=True)
class ReconstructConfig:
    """Parameters of the reconstruction (svox2's names where it has them)."""

    resolutions: tuple[int, ...] = ()
    """Lattice points per two world units (the cube's edge), coarse to fine; by default a quarter
    (not for narrow arcs), half and all of --resolution for photos with mattes, 96 192 for photos of
    a room."""
    resolution: int = 0
    """Lattice points per two world units at the last level, for photos with mattes; 0: a voxel is
    about two pixels, with 256 to --max-resolution points."""
    max_resolution: int = 512
    """Maximum of lattice points for --resolution 0; `make` uses no more than the display shows, but
    at least 256."""
    rays: tuple[float, ...] = ()
    """Training rays of each level in millions; by default 1 5 12, more above 256 points, and 4 8
    for a room. With a time budget, coarse levels use at least two fifths of these and run for their
    share of the time; the last level uses the rest."""
    batch: tuple[int, ...] = ()
    """Rays per step of each level; by default 2048, and 2048 4096 for a room."""
    sh_degree: int = 2
    """Degree of the spherical harmonics: 0 (matt), 1 or 2."""
    density_floor: float | None = None
    """How far a lattice point's density may be negative, as the optical depth of a voxel. The
    interpolated density is clipped at zero, so that a surface can lie anywhere within a voxel (ReLU
    fields, Karnewar et al. 2022); 0: no negative densities. By default 0.1 where the finest voxel
    is 1.5 pixels or more, else 0; and 0.3 for a room."""
    polyak_fraction: float | None = None
    """Average the field over this share of the last level, at its end (Polyak and Juditsky 1992), 0
    to 1; 0: no averaging; by default 0.3, and 0 for a room."""
    max_voxels: float = 8.0
    """Maximum of lattice points in millions; above it, the weakest are pruned. A million needs
    about 0.65 GB in training (two threads, degree 2). A head of one photo is not trained: it has
    the points around its surface, as many as its resolution asks for."""
    background: float = 1.0
    """Grey level behind photos without mattes, and behind test views."""
    background_nlayers: int | None = None
    """Spheres behind the lattice; by default 32 for photos without mattes, else 0, none."""
    near_clip: float | None = None
    """Near plane: distance from the camera where rays start, in world units (the head is about 2
    high); by default 0, and a quarter of the nearest camera's distance for a room."""
    exposure: bool = True
    """For a room: compensate exposure with one gain per photo and channel, also in tests on
    held-out photos."""
    refine_poses: bool = False
    """Refine the camera poses during training, for pose errors of a pixel or more; held-out photos
    are tested at their refined poses."""
    refine_mattes: Literal["auto", "yes", "no"] = "auto"
    """Recompute the mattes before and within the last level, along the photos' edges near the
    field's outline. ``auto``: only mattes that were computed from the photos, not given ones."""
    mvs_init: bool = True
    """For a room: initialise from the surfaces of a plane sweep instead of uniform density."""
    fill_back: bool = True
    """Close the back of the head where no photo shows it, smoothly and with the surrounding
    colors, after testing; for a person with mattes and landmarks."""
    cut_base: bool = True
    """Cut the frayed lower end of a bust by a plane and remove loose pieces, after testing; for a
    person with mattes and landmarks."""
    time_budget: float = 0.0
    """Time limit in seconds; 0: run all rays. The learning rates decay over this time."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the order of the rays."""

    def refines_mattes(self, how: str | None) -> bool:
        """Whether mattes are recomputed; ``how`` is the way they were made (`job.cut_person`)."""
        return self.refine_mattes == "yes" or (
            self.refine_mattes == "auto" and how in ("network", "geometry"))

    @property
    def paced(self) -> bool:
        """Whether levels follow the clock: each lasts its share of the time budget."""
        return bool(np.isinf(self.rays[-1]))

    def shares(self) -> tuple[float, ...]:
        """Each level's share of the schedule, adding up to one.

        Four fifths of what is left of the time for the last level, of the rest four fifths for the
        one before, and so on: coarse rays are cast several times as fast, and the matter that
        they clear away costs the fine ones time and sharpness.
        """
        if self.paced:
            parts = [0.8 * 0.2 ** level for level in range(len(self.rays) - 1)]
            return (1.0 - sum(parts), *parts[::-1])
        return tuple(count / sum(self.rays) for count in self.rays)

    def training_seconds(self, matted: bool, faced: bool) -> float:
        """Seconds of the time budget that are there for training.

        What comes after takes a fixed time on a head: points are dropped and held-out views looked
        at (7 s on two cores), and with a face's landmarks the head is closed and trimmed (5 s).

        Parameters
        ----------
        faced : Whether a head with landmarks is closed or trimmed.
        """
        after = 0.07 * self.time_budget
        if matted:
            part, most = (0.35, 12.0) if faced else (0.2, 7.0)
            after = max(after, min(part * self.time_budget, most))
        return self.time_budget - after

    def resolved(self, room: bool, distance: float, pixel: float = 0.0,
                 narrow: bool = False) -> Settings:
        """The same with every default put in, and what has no option.

        Parameters
        ----------
        room : Whether the photos show a room rather than a person with a matte.
        distance : Distance of the nearest camera from the origin, in world units.
        pixel : Size of a pixel at the origin, in world units.
        narrow : Whether the field starts from a surface that was found
            (`geometry.head_surface`), which the coarsest level would blur.

        Raises
        ------
        UserError : If levels do not fit together or a value makes no sense.
        """
        finest = self.resolution or min(lattice_points(pixel), self.max_resolution)
        if finest < 16:
            raise UserError(f"--resolution and --max-resolution must be at least 16, not {finest}")
        usual = (finest // 4,) * (finest >= 64 and not narrow) + (finest // 2, finest)
        resolutions = self.resolutions or ((96, 192) if room else usual)
        levels = len(resolutions)
        rays = self.rays
        if not rays:
            more = float(np.clip((resolutions[-1] / 256.0) ** 2, 1.0, 4.0))
            last = (4.0, 8.0) if room else (more, 5.0 * more, 12.0 * more)
            rays = (last[0],) * (levels - len(last)) + last[-levels:]
            if self.time_budget > 0:
                rays = (*(_LEAST * count for count in rays[:-1]), float("inf"))
        if len(rays) != levels:
            raise UserError(f"give as many --rays as there are --resolutions, one a level: "
                            f"{levels}, for {' '.join(map(str, resolutions))}")
        batch = self.batch or ((2048, 4096) if room else (2048,))
        if len(batch) not in (1, levels) and self.batch:
            raise UserError("give one --batch, or as many as --resolutions")
        polyak = (0.0 if room else 0.3) if self.polyak_fraction is None else self.polyak_fraction
        if not 0 <= polyak <= 1:
            raise UserError(f"--polyak-fraction must be from 0 to 1, not {polyak:g}")
        if self.sh_degree not in (0, 1, 2):
            raise UserError(f"--sh-degree must be 0, 1 or 2, not {self.sh_degree}")

        def chosen(value: float | None, usual: float) -> float:
            return usual if value is None else value

        own: dict[str, Any] = {entry.name: getattr(self, entry.name)
                               for entry in fields(ReconstructConfig)}
        # Below zero, voxels that are small against the pixels follow the photos' noise.
        floor = 0.3 if room else (0.1 if 2.0 / resolutions[-1] >= 1.5 * pixel else 0.0)
        layers = self.background_nlayers
        own |= {"resolutions": resolutions, "rays": rays,
                "batch": tuple(batch[min(level, len(batch) - 1)] for level in range(levels)),
                "polyak_fraction": polyak, "density_floor": chosen(self.density_floor, floor),
                "background_nlayers": (32 if room else 0) if layers is None else layers,
                "near_clip": chosen(self.near_clip, distance / 4.0 if room else 0.0)}
        return Settings(**own, **(_ROOM if room else {}))


@dataclass(frozen=True)
class Settings(ReconstructConfig):
    """All numbers of one training: the parameters with every default put in, and what has none.

    The latter are those of a person with mattes, found on the demo's head and the photographed
    heads of docs/reconstruction.md; `_ROOM` has what differs for photos of a room.
    """

    density_floor: float = 0.1
    polyak_fraction: float = 0.3
    background_nlayers: int = 0
    near_clip: float = 0.0
    step_size: float = 0.5
    """Distance between samples in voxels."""
    lr_sigma: float = 10.0
    """Learning rate of the density at the start; for photos with mattes this is the rate at 256
    points, and it scales with the resolution."""
    lr_sigma_final: float = 4.0
    """The same at the end."""
    lr_sh_final: float = 1.0
    """Learning rate of the colors at the end."""
    lambda_tv: float = 1e-5
    """Weight of total variation on the density, halved at each finer level."""
    lambda_tv_sh: float = 0.0
    """Weight of total variation on the color, a tenth at the finest level."""
    tv_sparsity: float = 0.003
    """Share of lattice points regularised by total variation at each step."""
    lambda_distortion: float = 0.03
    """Weight of the distortion loss (Mip-NeRF 360), which makes surfaces thin."""
    prune: float = 0.01
    """Lattice points whose largest weight on any training ray is below this are pruned."""


_ROOM: dict[str, Any] = {
    "step_size": 1.0, "lr_sigma": 7.0, "lr_sigma_final": 1.0, "lr_sh_final": 0.5,
    "lambda_tv": 1e-3, "lambda_tv_sh": 5e-3, "tv_sparsity": 0.005, "lambda_distortion": 0.01,
    "prune": 0.02}
"""What photos of a room, without mattes, have otherwise."""
