"""What a file's name asks for, and names that any drive takes."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from ...errors import UserError
from ...lightfield import QuiltHint, QuiltLayout, quilt_part

__all__ = ["PICTURES", "VIDEOS", "QuiltName", "safe_names"]

PICTURES = (".png", ".jpg", ".jpeg", ".webp")
VIDEOS = (".mp4", ".mov", ".mkv", ".webm")
_MOST_VIEWS, _MOST_TILES = 108, 50
_RESERVED = {"con", "prn", "aux", "nul", *(f"{port}{number}" for port in ("com", "lpt")
                                         for number in range(1, 10))}
_LONGEST = 100
"""Letters of a name on a drive, without what is put behind it."""


@dataclass(frozen=True)
class QuiltName:
    """The layout that a quilt's name asks for, in part or whole.

    Attributes
    ----------
    columns, rows
        0 where the name leaves them to the display.
    aspect
        Width over height of the views; 0 where the name leaves it to the display.
    """

    columns: int = 0
    rows: int = 0
    aspect: float = 0.0

    @staticmethod
    def of(name: str) -> QuiltName:
        """What ``NAME_qs``, ``NAME_qs8x13`` or ``NAME_qs8x6a0.75`` ask for.

        Raises
        ------
        UserError
            If the layout is impossible, or has more views than a frame shows.
        """
        hint = QuiltHint.of_name(name)
        if hint is None:
            return QuiltName()
        columns, rows, aspect = hint.columns, hint.rows, hint.aspect
        good = (1 <= columns <= _MOST_TILES and 1 <= rows <= _MOST_TILES
                and 2 <= columns * rows <= _MOST_VIEWS)
        if not good:
            raise UserError(f"a quilt has 2 to {_MOST_VIEWS} views, in at most {_MOST_TILES} "
                            f"columns and rows, not {columns} x {rows}")
        if aspect and not 0.1 <= aspect <= 10:
            raise UserError(f"the aspect of a quilt's views must be 0.1 to 10, not {aspect:g}")
        return QuiltName(columns, rows, aspect)

    @staticmethod
    def completed(path: Path, layout: QuiltLayout) -> Path:
        """The path with a layout in its name; a name that has one already is left as it is."""
        found = quilt_part(path.name)
        if found is None:
            return path.with_name(f"{path.stem}{layout.suffix()}{path.suffix}")
        if found[3] is not None:
            return path
        name = path.name
        return path.with_name(f"{name[:found.start()]}{layout.suffix()}{name[found.end():]}")


def safe_names(titles: Iterable[str]) -> list[str]:
    """Names for files on any drive: FAT's forbidden characters and Unicode are left out.

    A frame's playlist has no stated encoding, so that only ASCII is safe. FAT does not tell
    capitals from small letters: names that differ in nothing else get a number.
    """
    taken: set[str] = set()
    names = []
    for title in titles:
        plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode()
        base = re.sub(r"[^A-Za-z0-9._-]+", "-", plain).strip("-. ")[:_LONGEST].rstrip("-. ")
        base = base or "portrait"
        if base.split(".")[0].lower() in _RESERVED:
            base = f"portrait-{base}"
        name, number = base, 2
        while name.lower() in taken:
            name, number = f"{base}-{number}", number + 1
        taken.add(name.lower())
        names.append(name)
    return names
