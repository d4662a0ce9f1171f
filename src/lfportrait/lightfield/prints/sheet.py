"""A print's parameters and geometry: the page in printer pixels, and the lens sheet as a `Display`.

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
import re
from dataclasses import dataclass
from typing import Literal

from ...errors import UserError
from ..display import Display
from ..placement import PlacementConfig

INCH = 25.4  # Millimetres.
_UNITS = {"mm": 1.0, "cm": 10.0, "in": INCH, "inch": INCH, '"': INCH}
_A_SIZES = ((841, 1189), (594, 841), (420, 594), (297, 420), (210, 297), (148, 210), (105, 148))
"""A0 to A6 in millimetres (ISO 216)."""
_LEAST, _MOST = 20.0, 3000.0  # Millimetres of a side.
_SIDES = re.compile(r'(\d+\.?\d*|\.\d+)\s*(mm|cm|inch|in|")?\s*[x×]\s*'
                    r'(\d+\.?\d*|\.\d+)\s*(mm|cm|inch|in|")')
_SHEET = re.compile(r"a([0-6])(?:-(portrait|landscape))?")


def paper_size(text: str) -> tuple[float, float]:
    """Width and height in millimetres.

    Of width x height with a unit (mm, cm, in), or A0 to A6, upright or with ``-landscape``.
    """
    words = text.strip().lower()
    if sheet := _SHEET.fullmatch(words):
        width, height = map(float, _A_SIZES[int(sheet[1])])
        if sheet[2] == "landscape":
            width, height = height, width
    elif sides := _SIDES.fullmatch(words):
        width = float(sides[1]) * _UNITS[sides[2] or sides[4]]
        height = float(sides[3]) * _UNITS[sides[4]]
    else:
        raise UserError(f"can't read the size {text!r}; write it as 8x10in, 200x250mm, a4 or "
                        "a4-landscape")
    if not (_LEAST <= width <= _MOST and _LEAST <= height <= _MOST):
        raise UserError(f"a print of {width:g} x {height:g} mm can't be made: sides must be "
                        f"{_LEAST:g} to {_MOST:g} mm long")
    return width, height


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


@dataclass(frozen=True, kw_only=True)
class PrintConfig(PlacementConfig):
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

_VIEWS = 256
"""Directions that kernels sort rays by; the rays themselves have each pixel's own direction."""
_LARGEST = 65536  # Pixels of a side.
_ANGLE = 50.0
"""Viewing angle in degrees where nothing is known: sheets for portraits have 45 to 55."""
_NEAR = 400.0  # Least viewing distance in millimetres where none is given.


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
    config : What it was made from.
    display : The whole page, margins included, as a display; half its height is the unit of
        length.
    picture : Finished print and bleed.
    trim : The finished print.
    thickness : Of the lens sheet, mm.
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
        UserError : If the page has too many pixels, or the sheet's numbers contradict each
            other.
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
