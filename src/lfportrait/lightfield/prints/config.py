"""Parameters of a lenticular print."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from ...errors import UserError
from .sizes import paper_size

__all__ = ["PrintConfig"]

_BOUNDS = {
    "lpi": (3, 400, "lenses per inch"), "dpi": (50, 10_000, "dots per inch"),
    "bleed": (0, 100, "millimetres of bleed"), "margin": (0, 100, "millimetres of margin"),
    "phase": (-10, 10, "lenses"), "slant": (-45, 45, "degrees of the lenses' slant"),
    "index": (1.2, 2.5, "as refractive index"), "shift_x": (-3, 3, "half heights to the right"),
    "shift_y": (-3, 3, "half heights up"), "background": (0, 1, "as grey level"),
    "relief": (0.01, 100, "depth budgets")}
"""Least and most of each number."""
_POSITIVE = {
    "distance": (50, 100_000, "millimetres of viewing distance"),
    "judged_at": (50, 100_000, "millimetres of viewing distance"),
    "angle": (5, 120, "degrees of viewing angle"),
    "thickness": (0.05, 20, "millimetres of thickness")}
"""The same for numbers that may also be 0, not given."""


@dataclass(frozen=True)
class PrintConfig:
    """Paper, lens sheet and placement of the head."""

    lpi: float
    """Lenses per inch as found with --pitch-test, such as 60.12; the printed nominal number is not
    exact enough."""
    dpi: float = 720.0
    """Pixels per inch of the printer, its native number: it must not scale the file."""
    size: str = "8x10in"
    """Size of the finished print, width x height: 8x10in, 200x250mm, a4, a4-landscape."""
    distance: float = 0.0
    """Viewing distance in mm; 0: twice the print's longer side, at least 400 mm."""
    judged_at: float = 0.0
    """Distance in mm from which --lpi was found; 0: the viewing distance. From elsewhere the pitch
    looks different, and is corrected by the sheet's thickness."""
    angle: float = 0.0
    """Viewing angle of the lens sheet in degrees; 0: from its thickness, or 50."""
    thickness: float = 0.0
    """Thickness of the lens sheet in mm; 0: from its viewing angle."""
    index: float = 1.56
    """Refractive index of the sheet: PET 1.57, acrylic 1.49, varnish about 1.5."""
    slant: float = 0.0
    """Angle of the lenses against the vertical in degrees: positive where they lean to the right
    at the top."""
    phase: float = 0.0
    """Moves the picture under the lenses, in lenses to the right, as found with --pitch-test."""
    bleed: float = 5.0
    """Picture beyond each edge of the finished print, in mm, to be cut off."""
    margin: float = 10.0
    """White border beyond the bleed for marks, in mm; 0: none."""
    marks: bool = True
    """Draw marks into the border: stripes of the lenses' pitch to align the sheet, and where to
    cut."""
    mirror: bool = False
    """Mirror the page: to print on the back of the lens sheet itself."""
    head: float = 0.8
    """Height of the head ([-1, 1] in the portrait frame) over the print's height."""
    shift_x: float = 0.0
    """Moves the head to the right, in half heights of the print."""
    shift_y: float = -0.04
    """Moves the head up, in half heights of the print."""
    turn: float = 0.0
    """Turns the head to its left about the vertical axis, in degrees."""
    relief: float = 1.0
    """Depth of the visible head over the sheet's depth budget: up to 1 all of it is sharp."""
    depth_scale: float | None = None
    """Depth of the head over its true depth, instead of --relief."""
    focus: float | None = None
    """How far the head's middle lies in front of the paper, in mm; by default so that all of it is
    sharp, and nothing in front of the paper touches an edge."""
    blend: Literal["continuous", "filtered"] = "continuous"
    """continuous: one ray a pixel, from its middle; filtered: the mean over the pixel's own
    directions, three rays: what is deeper than the budget blurs."""
    background: float = 0.0
    """Grey level behind the head, instead of a painted ground."""

    def __post_init__(self) -> None:
        for bounds, zero in ((_BOUNDS, False), (_POSITIVE, True)):
            for name, (low, high, what) in bounds.items():
                value = getattr(self, name)
                if not (low <= value <= high or (zero and value == 0)):
                    raise UserError(f"{value:g} {what} can't be printed: --"
                                    f"{name.replace('_', '-')} must lie between {low:g} and "
                                    f"{high:g}{', or be 0' if zero else ''}")
        if self.focus is not None and not math.isfinite(self.focus):
            raise UserError(f"--focus must be a number of millimetres, not {self.focus}")
        paper_size(self.size)
        if self.dpi / self.lpi < 2:
            raise UserError(f"{self.dpi:g} dpi are {self.dpi / self.lpi:.2f} pixels a lens of "
                            f"{self.lpi:g} lpi, and at least 2 are needed: print with a higher "
                            "--dpi, or use a sheet with fewer lenses")
