"""Depth budget of a panel: the depth range shown sharply, and what of a head blurs.

A point at z in front of the panel moves by b z / (D - z) on the panel from one view to the next,
where b is the distance of neighbouring eye points and D the viewing distance. As soon as that is
more than the width of a lens, detail is drawn twice or blurs (Zwicker et al. 2006): the range in
which it is less is the depth budget.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from .display import Display
from .placement import EncodeConfig, Placement

__all__ = ["DepthReport"]


@dataclass(frozen=True)
class DepthReport:
    """A panel's depth budget, and its consequences for a head.

    All depths are in half panel heights, positive in front of the panel.

    Attributes
    ----------
    front, back
        Limits of what is sharp; ``back`` is minus infinity where nothing behind ever blurs.
    head_front, head_back
        The foremost and the hindmost point of the head.
    sharp_percent
        Share of the head's depth that lies within the limits.
    front_blur, back_blur
        Width of the blur at the head's foremost and hindmost point, in lenses; up to 1 is sharp.
    best_focus
        ``focus`` with which most of the head is sharp.
    sharp_size
        Largest ``size`` of a head that is sharp from front to back at that focus.
    sharp_depth_scale
        Largest ``depth_scale`` with which the head is sharp from front to back at that focus.
    millimetres
        Millimetres in half a panel height; 0 = not known.
    """

    front: float
    back: float
    head_front: float
    head_back: float
    sharp_percent: float
    front_blur: float
    back_blur: float
    best_focus: float
    sharp_size: float
    sharp_depth_scale: float
    millimetres: float

    @staticmethod
    def of(display: Display, config: EncodeConfig | None = None,
           views: float = 0.0) -> DepthReport:
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
