"""Sizes of paper in words: ``8x10in``, ``200x250mm``, ``a4``, ``a3-landscape``."""

from __future__ import annotations

import re

from ...errors import UserError

__all__ = ["INCH", "paper_size"]

INCH = 25.4
"""Millimetres."""
_UNITS = {"mm": 1.0, "cm": 10.0, "in": INCH, "inch": INCH, '"': INCH}
_A_SIZES = ((841, 1189), (594, 841), (420, 594), (297, 420), (210, 297), (148, 210), (105, 148))
"""A0 to A6 in millimetres (ISO 216)."""
_LEAST, _MOST = 20.0, 3000.0
"""Millimetres of a side."""
_SIDES = re.compile(r'(\d+\.?\d*|\.\d+)\s*(mm|cm|inch|in|")?\s*[x×]\s*'
                    r'(\d+\.?\d*|\.\d+)\s*(mm|cm|inch|in|")')
_SHEET = re.compile(r"a([0-6])(?:-(portrait|landscape))?")


def paper_size(text: str) -> tuple[float, float]:
    """Width and height in millimetres.

    Parameters
    ----------
    text
        Width x height with a unit (mm, cm, in), or A0 to A6, upright or with ``-landscape``.

    Raises
    ------
    UserError
        If it is neither, or a side is shorter than 20 mm or longer than 3 m.
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
