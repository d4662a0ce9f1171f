"""Parameters of 3D files and of the turning video."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as option
from typing import Literal

from ..errors import UserError

__all__ = ["ExportConfig", "LoopConfig", "SplatConfig", "SweepConfig", "Up"]

Up = Literal["auto", "y-up", "y-down"]


@dataclass(frozen=True)
class SplatConfig:
    """Parameters of Gaussian splats."""

    count: int = 400_000
    """Number of splats at most: one for each point of the visible surface."""
    steps: int = 120
    """Views of the field to which the splats are fitted, one after the other; 0 does not fit."""
    degree: Literal[0, 1, 2] | None = None
    """Degree of the spherical harmonics; by default the field's. Painted fields have degree 0."""
    seed: int = 0
    """Of the choice of views."""
    up: Up = "auto"
    """Which way is up in the file. y-down: turned by 180 degrees about z, which SuperSplat undoes.
    auto: y-down in PLY and SOG files, y-up in SPZ and GLB files."""


@dataclass(frozen=True)
class ExportConfig:
    """Parameters of export."""

    kind: str = "auto"
    """Content of the file. auto: what its name asks for: splats in SPZ and SOG files, and in PLY
    and GLB files whose name contains "splat"; points in other PLY files; a mesh in GLB, USDZ and
    OBJ files; `lfportrait formats` lists all."""
    world: Literal["portrait", "source"] = "portrait"
    """Coordinates: the portrait frame (+y up, +z out of the face; points and meshes in metres,
    20 cm high; splats see ``--splats.up``), or those of the source capture as they are."""
    opacity: float = 0.1
    """Points: minimum opacity along one voxel."""
    point_color: Literal["mean", "seen"] = "mean"
    """Points: mean color over all directions (degree 0), or the color seen from the front and
    outside."""
    surface: Literal["auto", "outer", "density"] = "auto"
    """Mesh: outer: the surface seen from outside; density: an isosurface of the density, with inner
    walls; auto: density for a field with a background."""
    level: float | None = None
    """Mesh: opacity at the surface, 0 to 1; by default 0.5, accumulated from outside (0.15 with a
    texture), or 0.1 per voxel (surface density)."""
    smooth: float | None = None
    """Mesh: sigma in voxels of the Gaussian that smooths the opacity first; by default 1.5, with a
    texture 0.8."""
    least_piece: float = 0.05
    """Mesh: remove connected pieces smaller than this share of the largest one."""
    texture: Literal["auto", "yes", "no"] = "auto"
    """Mesh in a GLB or OBJ file: colors as a picture (yes) or at the vertices (no). auto: a picture
    if the field is painted. USDZ files always have a picture, PLY files never."""
    splats: SplatConfig = option(default_factory=SplatConfig)
    """Splats."""


@dataclass(frozen=True)
class SweepConfig:
    """Parameters of a video in which the head turns from side to side."""

    size: int = 512
    """Width and height in pixels."""
    frames: int = 90
    """Number of frames of one loop."""


@dataclass(frozen=True)
class LoopConfig:
    """Parameters of a short loop for messengers, in which the head turns a little."""

    size: int = 480
    """Width and height in pixels."""
    frames: int = 48
    """Number of frames of one loop."""
    fps: float = 20.0
    """Frames per second."""
    sway: float = 10.0
    """How far the head turns to each side, in degrees."""
    rise: float = 3.0
    """How far it is seen from above and from below, in degrees."""

    def __post_init__(self) -> None:
        for name, least, most in (("size", 16, 2160), ("frames", 2, 600), ("fps", 1, 50),
                                  ("sway", 0, 90), ("rise", 0, 60)):
            value = getattr(self, name)
            if not least <= value <= most:
                raise UserError(f"--loop.{name} must be {least} to {most}, not {value:g}")
