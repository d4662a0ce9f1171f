"""A print's geometry: the page in printer pixels, and the lens sheet on it, as a `Display`.

Under a lens of pitch p lie ``dpi p`` pixels of the printer. As the three colors of a pixel lie in
one place, its pitch as a display is three times that, ``3 dpi / lpi`` sub-pixels, with all
``cells`` zero. A lens turns left and right around, so that from left to right under a lens the
views go from right to left (``inverted``).

An eye at a distance D sees through the lens at X the ink at X (1 + t / (n D)), t and n being the
sheet's thickness and refractive index. So the pitch that fits is a little larger than that of the
lenses, and depends on the distance: 0.1 % from near to far, half a lens over 8 inches at 60 lpi.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...errors import UserError
from ..display import Display
from .config import PrintConfig
from .sizes import INCH, paper_size

__all__ = ["Box", "PrintSheet"]

_VIEWS = 256
"""Directions that kernels sort rays by; the rays themselves have each pixel's own direction."""
_LARGEST = 65536
"""Pixels of a side."""
_ANGLE = 50.0
"""Viewing angle in degrees where nothing is known: sheets for portraits have 45 to 55."""
_NEAR = 400.0
"""Least viewing distance in millimetres where none is given."""


@dataclass(frozen=True)
class Box:
    """A rectangle on the page in pixels from its upper left corner; right and bottom excluded."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def width(self) -> int:
        """Pixels from left to right."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Pixels from top to bottom."""
        return self.bottom - self.top


@dataclass(frozen=True)
class PrintSheet:
    """A page and the lens sheet on it.

    Attributes
    ----------
    config
        What it was made from.
    display
        The whole page, margins included, as a display; half its height is the unit of length.
    picture
        Finished print and bleed.
    trim
        The finished print.
    thickness
        Of the lens sheet, mm.
    """

    config: PrintConfig
    display: Display
    picture: Box
    trim: Box
    thickness: float

    @staticmethod
    def of(config: PrintConfig, *, bare: bool = False) -> PrintSheet:
        """The page of a configuration; ``bare``: neither bleed nor margin, as for test pages.

        Raises
        ------
        UserError
            If the page has too many pixels, or the sheet's numbers contradict each other.
        """
        wide, high = paper_size(config.size)
        border = 0.0 if bare else config.bleed + config.margin
        width, height = (round((side + 2 * border) / INCH * config.dpi) for side in (wide, high))
        if max(width, height) > _LARGEST:
            raise UserError(f"the page would have {width} x {height} pixels, and a side has at "
                            f"most {_LARGEST}: print it smaller, or with a lower --dpi")
        page_height = height / config.dpi * INCH
        distance = config.distance or max(_NEAR, 2 * max(wide, high))
        pitch, angle, thickness = _lenses(config, distance)
        slant = math.radians(config.slant)
        # The middle of a lens lies in the middle of the page.
        offset = (pitch * (0.5 - config.phase) - 1.5 * (width - 1)
                  - 1.5 * math.tan(slant) * (height - 1)) % pitch
        display = Display(
            width, height, _VIEWS, pitch, slant=slant, offset=offset, cone=angle,
            distance=2 * distance / page_height, inverted=True, cells=((0.0,) * 6,),
            panel_height=page_height / 1000.0, calibrated=True, name="print",
            note=f"{config.lpi:g} lpi, {config.dpi:g} dpi")

        def box(inward: float) -> Box:
            edge = round(inward / INCH * config.dpi)
            return Box(edge, edge, width - edge, height - edge)

        return PrintSheet(config, display, box(0 if bare else config.margin), box(border),
                          thickness)

    @property
    def pixels_per_lens(self) -> float:
        """N, the directions that a lens shows: printed pixels under it."""
        return self.display.pitch / 3.0

    @property
    def half_height(self) -> float:
        """Millimetres in half the page's height, the display's unit."""
        return 500.0 * self.display.panel_height

    @property
    def distance(self) -> float:
        """Viewing distance in millimetres."""
        return self.display.distance * self.half_height

    @property
    def depth_budget(self) -> float:
        """D = 2 N t / n in millimetres: depth that the sheet shows without blur."""
        return 2.0 * self.pixels_per_lens * self.thickness / self.config.index

    def pixels(self, millimetres: float) -> int:
        """A length in pixels."""
        return round(millimetres / INCH * self.config.dpi)

    def summary(self) -> str:
        """One line for people."""
        wide, high = paper_size(self.config.size)
        return (f"{wide:g} x {high:g} mm, with borders {self.display.width} x "
                f"{self.display.height} pixels; {self.pixels_per_lens:.2f} pixels a lens, "
                f"viewing angle {self.display.cone:.0f} degrees, {self.thickness:.2f} mm thick, "
                f"seen from {self.distance:.0f} mm")


def _lenses(config: PrintConfig, distance: float) -> tuple[float, float, float]:
    """Pitch (sub-pixels), viewing angle (degrees) and thickness (mm) of the lens sheet."""
    lens = INCH / config.lpi
    angle, thickness = config.angle, config.thickness
    if not thickness:
        # From the lens's vertex to the edges of its strip of ink, bent by the surface.
        angle = angle or _ANGLE
        inside = math.asin(math.sin(math.radians(angle) / 2) / config.index)
        thickness = lens / (2 * math.tan(inside))
    elif not angle:
        sine = config.index * math.sin(math.atan(lens / (2 * thickness)))
        if sine > math.sin(math.radians(60)):
            raise UserError(f"lenses of {config.lpi:g} lpi on a sheet of {thickness:g} mm would "
                            "have a viewing angle of over 120 degrees: check --thickness (mm), or "
                            "give --angle")
        angle = 2 * math.degrees(math.asin(sine))
    pitch = 3.0 * config.dpi / config.lpi
    if config.judged_at:
        bend = thickness / config.index
        pitch *= (1 + bend / distance) / (1 + bend / config.judged_at)
    return pitch, angle, thickness
