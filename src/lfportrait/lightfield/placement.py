"""Where a field stands in front of a panel, and how much of its depth the panel shows sharply.

A point at z in front of the panel moves by b z / (D - z) on the panel from one view to the next,
where b is the distance of neighbouring eye points and D the viewing distance. As soon as that is
more than the width of a lens, detail is drawn twice or blurs (Zwicker et al. 2006): the range in
which it is less is the depth budget.

The options of coding fields and views are here, too: commands list them without any kernel.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from ..arrays import Float64
from ..errors import UserError
from .display import Display


@dataclass(frozen=True)
class PlacementConfig:
    """Where a head is put, on a panel or on a print."""

    shift_x: float = 0.0
    """Moves the head to the right, in half heights of the panel or print."""
    shift_y: float = -0.04
    """Moves the head up, in half heights of the panel or print."""
    turn: float = 0.0
    """Turns the head to its left about the vertical axis, in degrees."""
    background: float = 0.0
    """Grey level behind the head, instead of a painted ground; black hides cross-talk between views
    on a real panel."""


@dataclass(frozen=True)
class EncodeConfig(PlacementConfig):
    """Parameters of the coding."""

    size: float = 0.8
    """Height of the head ([-1, 1] in the portrait frame) over the panel's height."""
    focus: float = 0.0
    """Moves the head towards the viewer, in half panel heights; the panel plane is sharpest."""
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
class InterlaceConfig:
    """Parameters of coding pictures of views."""

    sample: Literal["linear", "nearest"] = "linear"
    """Interpolation within a view's picture: linear is smoother, nearest copies pixels exactly."""
    blend: Literal["nearest", "linear"] = "nearest"
    """nearest: a sub-pixel shows its nearest view; linear: its own place between two views, softer
    from view to view but less sharp off the panel."""
    fit: Literal["contain", "cover", "stretch"] = "contain"
    """If the views' aspect differs from the panel's: show all with bars, fill and crop, or
    stretch."""
    focus: float = 0.0
    """Shift the views so that content this far behind the panel (in half panel heights) moves onto
    it, where it is sharpest; negative: content in front."""


@dataclass(frozen=True)
class Placement:
    """The similarity that puts the field's world into the display frame."""

    scale: float  # Half panel heights per world unit.
    shift: tuple[float, float, float]  # (x, y, z) of the world's origin in the display frame.
    # Angle about the vertical axis in radians; positive turns the face to the panel's right.
    turn: float = 0.0
    # Factor by which z, seen from the head's middle, is flattened once the head stands there.
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
    def deep_shift(self) -> Float64:
        """``shift`` [3] before the flattening."""
        return np.array([self.shift[0], self.shift[1], self.shift[2] / self.depth])

    def deep_distance(self, display: Display) -> float:
        """Distance of the eyes before the flattening."""
        return display.distance / self.depth

    @property
    def to_world(self) -> Float64:
        """Rotation [3, 3] from the display frame to the field's world."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])

    def to_lattice(self, lattice: Float64) -> Float64:
        """Matrix [3, 4] from the deep frame to lattice coordinates (`VoxelField.lattice`)."""
        linear = lattice[3:6, None] * self.to_world / self.scale
        return np.column_stack([linear, lattice[6:9] - linear @ self.deep_shift])


@dataclass(frozen=True)
class DepthReport:
    """A panel's depth budget, and its consequences for a head.

    All depths are in half panel heights, positive in front of the panel.
    """

    # front, back: Limits of what is sharp; ``back`` is minus infinity where nothing behind ever
    # blurs.
    front: float
    back: float
    # head_front, head_back: The foremost and the hindmost point of the head.
    head_front: float
    head_back: float
    sharp_percent: float  # Share of the head's depth that lies within the limits.
    # front_blur, back_blur: Width of the blur at the head's foremost and hindmost point, in lenses;
    # up to 1 is sharp.
    front_blur: float
    back_blur: float
    best_focus: float  # ``focus`` with which most of the head is sharp.
    sharp_size: float  # Largest ``size`` of a head that is sharp from front to back at that focus.
    # Largest ``depth_scale`` with which the head is sharp from front to back at that focus.
    sharp_depth_scale: float
    millimetres: float  # Millimetres in half a panel height; 0 = not known.

    @staticmethod
    def of(display: Display, config: EncodeConfig | None = None, views: float = 0.0) -> DepthReport:
        """The report for a head placed as ``config`` says.

        ``views``: how many views the lenses tell apart, where that is not the display's number.
        """
        config = config or EncodeConfig()
        placement = Placement.of(display, config)
        step = 2.0 * display.eye_reach / (views or display.views)
        lens = 2.0 * display.pitch / (3.0 * display.height)
        front = lens * display.distance / (step + lens)
        back = -lens * display.distance / (step - lens) if step > lens else -math.inf
        half = placement.scale * placement.depth
        head_front, head_back = placement.shift[2] + half, placement.shift[2] - half
        inside = max(0.0, min(front, head_front) - max(back, head_back))
        # No eye sees what lies at its own distance or behind it.
        blurs = [step * abs(z) / max(display.distance - z, 1e-3) / lens
                 for z in (head_front, head_back)]
        best = max(0.5 * (front + back), front - half)
        if 2.0 * half <= front - back:
            # All of it fits: as near to the middle of the panel as it goes.
            best = min(max(0.0, back + half), front - half)
        sharp = 0.5 * (front - back) if math.isfinite(back) else 10.0
        return DepthReport(
            front, back, head_front, head_back, 50.0 * inside / half, blurs[0], blurs[1],
            best, min(sharp * config.size / half, 10.0),
            min(sharp / placement.scale, 1.0),
            display.panel_height / 2 * 1000.0)

    def figures(self) -> dict[str, Any]:
        """For ``--json``; millimetres only where the panel's size is known."""
        figures = {key: value for key, value in asdict(self).items()
                   if key != "millimetres" and math.isfinite(value)}
        if self.millimetres > 0:
            for key in ("front", "back", "head_front", "head_back"):
                if math.isfinite(getattr(self, key)):
                    figures[f"{key}_mm"] = getattr(self, key) * self.millimetres
        return figures

    def length(self, value: float) -> str:
        """A depth for people."""
        if not math.isfinite(value):
            return "any depth"
        if self.millimetres > 0:
            return f"{abs(value) * self.millimetres:.1f} mm"
        return f"{abs(value):.3f} half panel heights"

    def lines(self) -> list[str]:
        """The report for people."""
        def place(z: float) -> str:
            side = "in front of" if z >= 0 else "behind"
            return f"{self.length(z)} {side} the panel"

        lines = [f"sharp: from {self.length(self.back)} behind the panel to "
                 f"{self.length(self.front)} in front of it",
                 f"head: from {place(self.head_back)} to {place(self.head_front)}; "
                 f"{self.sharp_percent:.0f} % of its depth is sharp"]
        blurred = []
        for part, end, limit, width in (
                ("front", self.head_front, self.front, self.front_blur),
                ("back", self.head_back, self.back, self.back_blur)):
            beyond = end - limit if part == "front" else limit - end
            if beyond > 0:
                share = 100.0 * min(1.0, beyond / (self.head_front - self.head_back))
                blurred.append(f"the {part} {self.length(beyond)} ({share:.0f} %), by up to "
                               f"{width:.1f} lens widths")
        lines.append("blurs: " + ("; ".join(blurred) if blurred else "nothing"))
        if blurred:
            lines.append(f"best focus: {self.best_focus:.3f}; all of a head is sharp up to size "
                         f"{self.sharp_size:.3f}, or with its depth scaled by "
                         f"{self.sharp_depth_scale:.2f}, there (--focus, --size, --depth-scale)")
        return lines
