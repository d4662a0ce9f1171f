"""Placement of a field in front of a panel: parameters and their similarity transform.

By default the middle of the head lies on the panel's plane, and the head, two world units high,
takes 80 % of the panel's height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from .display import Display

__all__ = ["EncodeConfig", "Placement"]


@dataclass(frozen=True)
class EncodeConfig:
    """Parameters of the coding."""

    size: float = 0.8
    """Height of the head ([-1, 1] in the portrait frame) over the panel's height."""
    shift_x: float = 0.0
    """Moves the head to the right, in half panel heights."""
    shift_y: float = -0.04
    """Moves the head up, in half panel heights."""
    focus: float = 0.0
    """Moves the head towards the viewer, in half panel heights; the panel plane is sharpest."""
    turn: float = 0.0
    """Turns the head to its left about the vertical axis, in degrees."""
    depth_scale: float = 1.0
    """Factor of the head's depth: below 1 flattens it about its middle, so that more of it lies
    within the panel's sharp depth."""
    method: Literal["auto", "slices", "direct"] = "auto"
    """slices: one slice of the field per panel row; direct: one ray per sub-pixel; auto: slices,
    unless the head is turned far."""
    blend: Literal["nearest", "continuous", "filtered"] = "nearest"
    """nearest: a sub-pixel shows its nearest view; continuous: its own place between two views;
    filtered: the mean over all directions of its lens, three rays: beyond the panel's depth budget,
    content blurs instead of breaking into a comb."""
    step_size: float = 0.5
    """Distance between samples in voxels, for --method direct; slices have one sample per plane of
    voxels."""
    draft: bool = False
    """Double the distance between samples: 1.5 to 2 times faster."""
    background: float = 0.0
    """Grey level behind the head, instead of a painted ground; black hides cross-talk between views
    on a real panel."""
    compose: bool = False
    """Compose the picture: the face in the panel's plane, the head as large as fits and within the
    panel's depth budget, the eyes in the middle third. Size, shifts, focus and depth scale then
    change what is composed."""
    ground: str = "painted"
    """What is behind the head: painted (from the painting's background, where the field has it),
    black, white or a picture's file."""
    ground_depth: float = 0.45
    """How far the ground lies behind the head, in half panel heights."""
    ground_blur: float = 0.5
    """Blur of the ground, over the width that a panel can't tell apart at its depth: without it the
    ground's strokes break into a comb. 0 leaves it sharp, 1 leaves no comb at all."""
    shadow: float = 0.45
    """Darkness of the head's shadow on the ground, 0 to 1."""

    def __post_init__(self) -> None:
        if not 0 <= self.shadow <= 1:
            raise UserError(f"--shadow must lie between 0 and 1, not {self.shadow:g}")
        if not 0 <= self.ground_blur <= 10:
            raise UserError(f"--ground-blur must lie between 0 and 10, not {self.ground_blur:g}")
        if not 0 <= self.ground_depth <= 20:
            raise UserError(f"--ground-depth must lie between 0 and 20 half panel heights, not "
                            f"{self.ground_depth:g}")


@dataclass(frozen=True)
class Placement:
    """The similarity that puts the field's world into the display frame.

    Attributes
    ----------
    scale
        Half panel heights per world unit.
    shift
        (x, y, z) of the world's origin in the display frame.
    turn
        Angle about the vertical axis in radians; positive turns the face to the panel's right.
    depth
        Factor by which z, seen from the head's middle, is flattened once the head stands there.
    """

    scale: float
    shift: tuple[float, float, float]
    turn: float = 0.0
    depth: float = 1.0

    @staticmethod
    def of(display: Display, config: EncodeConfig) -> Placement:
        """The placement that a configuration asks for; narrow panels get a smaller head."""
        if not 0.01 <= config.size <= 10:
            raise UserError(f"the size of the head must lie between 0.01 and 10 panel heights, "
                            f"not {config.size}")
        scale = min(config.size, config.size * display.aspect * 1.15)
        if not -180 <= config.turn <= 180:
            raise UserError(f"the head can be turned by -180 to 180 degrees, not {config.turn}")
        if not 0.01 <= config.depth_scale <= 4:
            raise UserError(f"the depth scale must lie between 0.01 and 4, not "
                            f"{config.depth_scale}")
        return Placement(scale, (config.shift_x, config.shift_y, config.focus),
                         math.radians(config.turn), config.depth_scale)

    def pixel(self, display: Display) -> float:
        """Size in world units of what an eye sees as one pixel of the head.

        To an eye each lens shows one sub-pixel of a row, and a color takes three of them.
        """
        return 2.0 / display.height * math.sqrt(display.pitch) / self.scale

    # Flattening all of space about the panel, eyes included, changes no picture: rays still meet
    # the panel and the scene in the same places. So the head keeps its shape for the kernels, and
    # its place and the eyes' distance are those before the flattening, in the "deep" frame.

    @property
    def deep_shift(self) -> NDArray[np.float64]:
        """``shift`` [3] before the flattening."""
        return np.array([self.shift[0], self.shift[1], self.shift[2] / self.depth])

    def deep_distance(self, display: Display) -> float:
        """Distance of the eyes before the flattening."""
        return display.distance / self.depth

    @property
    def to_world(self) -> NDArray[np.float64]:
        """Rotation [3, 3] from the display frame to the field's world."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])

    def to_lattice(self, lattice: NDArray[np.float64]) -> NDArray[np.float64]:
        """Matrix [3, 4] from the deep frame to lattice coordinates (`VoxelField.lattice`)."""
        linear = lattice[3:6, None] * self.to_world / self.scale
        return np.column_stack([linear, lattice[6:9] - linear @ self.deep_shift])
