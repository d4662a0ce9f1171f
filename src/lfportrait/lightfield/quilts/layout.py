"""The layout of a quilt, and how a name gives it."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field

from ...errors import UserError
from ..display import Display

__all__ = ["QuiltHint", "QuiltLayout", "quilt_part", "warn_of_misfit"]

# Case differs, the aspect may be missing, and some languages write a comma in it.
_QUILT = re.compile(r"_qs(?:(\d+)x(\d+)(?:a(\d*[.,]?\d+))?|(?![a-z0-9]))", re.IGNORECASE)
_SAME = 0.01
"""Names give the aspect in a few digits."""
_SQUEEZED = 2.0
"""Tiles may be squeezed: customary quilts do it by up to 1.6."""


def quilt_part(name: str) -> re.Match[str] | None:
    """The part of a name that makes it a quilt's: ``_qs``, ``_qs8x6`` or ``_qs8x6a0.75``.

    Its groups are columns, rows and aspect, or None.

    Raises
    ------
    UserError
        If the name has two layouts that differ.
    """
    found = list(_QUILT.finditer(name))
    numbered = [part for part in found if part[1]]
    if not numbered:
        return found[-1] if found else None
    sizes = {(int(part[1]), int(part[2])) for part in numbered}
    aspects = {_number(part[3]) for part in numbered if part[3]}
    if len(sizes) > 1 or len(aspects) > 1:
        raise UserError(f"the name {name!r} gives two layouts ("
                        f"{' and '.join(part[0].lstrip('_') for part in numbered)}): leave one in "
                        "it")
    return max(numbered, key=lambda part: part[3] is not None)


def _number(text: str | None) -> float:
    return float((text or "0").replace(",", "."))


@dataclass(frozen=True)
class QuiltHint:
    """What one place says of a quilt's layout, in part or whole.

    Attributes
    ----------
    place
        Where it is said, for messages.
    columns, rows
        0 where nothing is said.
    aspect
        Width over height of what a view shows; 0 where nothing is said.
    """

    place: str
    columns: int = 0
    rows: int = 0
    aspect: float = 0.0

    @staticmethod
    def of_name(name: str) -> QuiltHint | None:
        """What a file name says, or None.

        Raises
        ------
        UserError
            If it gives an impossible layout, or two.
        """
        part = quilt_part(name)
        if part is None or part[1] is None:
            return None
        hint = QuiltHint("its name", int(part[1]), int(part[2]), _number(part[3]))
        if min(hint.columns, hint.rows) < 1 or (part[3] and not 0 < hint.aspect < 1e4):
            raise UserError(f"the quilt name {name!r} has an impossible layout")
        return hint

    @staticmethod
    def of_options(columns: int, rows: int, aspect: float) -> QuiltHint | None:
        """What the options ``--columns``, ``--rows`` and ``--aspect`` say, or None.

        Raises
        ------
        UserError
            If they are impossible, or only one of columns and rows is given.
        """
        if (columns > 0) != (rows > 0) or min(columns, rows) < 0:
            raise UserError("give both --columns and --rows of the quilt, or neither")
        if not 0 <= aspect < 1e4:
            raise UserError(f"--aspect must be above 0, not {aspect}")
        return QuiltHint("the options", columns, rows, aspect) if columns or aspect else None

    def agrees(self, other: QuiltHint) -> bool:
        """Whether both may be true."""
        sizes = not (self.columns and other.columns) or (
            (self.columns, self.rows) == (other.columns, other.rows))
        return sizes and (not (self.aspect and other.aspect)
                          or abs(self.aspect / other.aspect - 1) <= _SAME)

    def said(self) -> str:
        """It in a message."""
        size = f"{self.columns} x {self.rows} views" if self.columns else "views"
        return f"{self.place}: {size}{f' of aspect {self.aspect:.4g}' if self.aspect else ''}"


@dataclass(frozen=True)
class QuiltLayout:
    """Columns and rows of a quilt and the aspect (width over height) of its views.

    View 0, the leftmost, is the bottom left tile; views run to the right, then up. A quilt's file
    name ends in ``_qsCOLSxROWSaASPECT``, e.g. ``portrait_qs8x6a0.75.png``. Where a file's layout is
    said, ``place`` names it, for people.
    """

    columns: int
    rows: int
    aspect: float
    place: str = field(default="", compare=False)

    @staticmethod
    def of_name(name: str, display: Display | None = None) -> QuiltLayout | None:
        """The layout that a file name gives, or None.

        A name without an aspect (``portrait_qs8x6.png``) has that of ``display``.

        Raises
        ------
        UserError
            If it is impossible, or the name gives two.
        """
        hint = QuiltHint.of_name(name)
        if hint is None:
            return None
        aspect = hint.aspect or (display.aspect if display else 0.0)
        return QuiltLayout(hint.columns, hint.rows, aspect) if aspect else None

    @staticmethod
    def of_display(display: Display) -> QuiltLayout:
        """The customary layout of a panel."""
        return QuiltLayout(*display.quilt, display.aspect)

    @property
    def count(self) -> int:
        """Number of views."""
        return self.columns * self.rows

    def suffix(self) -> str:
        """The end of a file name for this layout."""
        return f"_qs{self.columns}x{self.rows}a{self.aspect:.4g}"


def warn_of_misfit(name: str, width: int, height: int, layout: QuiltLayout) -> None:
    """Warn if a picture of this size can hardly be a quilt of this layout.

    Some makers' quilts have a rest at the edges that belongs to no view; these are not warned of.
    """
    right, top = width % layout.columns, height % layout.rows
    tile = (width // layout.columns) / max(1, height // layout.rows)
    if not 1 / _SQUEEZED <= tile / layout.aspect <= _SQUEEZED:
        warnings.warn(f"{name} as {layout.columns} x {layout.rows} views has tiles of the aspect "
                      f"{tile:.3g}, but its layout says that views have {layout.aspect:.3g}: check "
                      "the layout", UserWarning, stacklevel=2)
    elif (right or top) and not _customary(width, height, layout):
        warnings.warn(f"{name} has {width} x {height} pixels, which {layout.columns} x "
                      f"{layout.rows} views do not divide: {right} at the right and {top} at the "
                      "top are left out; if the picture was scaled, take the original",
                      UserWarning, stacklevel=2)


def _customary(width: int, height: int, layout: QuiltLayout) -> bool:
    panels = (Display.preset(name) for name in Display.names())
    return any(panel.quilt == (layout.columns, layout.rows)
               and panel.quilt_size == (width, height) for panel in panels)
