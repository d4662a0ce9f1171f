"""Columns, rows and aspect of quilts: in their names, beside them and inside them.

Looking Glass's programs write it into the name, into ``NAME.png.json`` beside the quilt, or, the
older ones, as a JSON text into the EXIF tag UserComment. Programs that convert pictures carry that
text over into XMP, or into a comment of the format's own.
"""

from __future__ import annotations

import html
import json
import re
import struct
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..files import read_json
from ..media.kinds import VIDEOS
from ..media.pictures import open_picture
from .display import Display

# Case differs, the aspect may be missing, and some languages write a comma in it.
_QUILT = re.compile(r"_qs(?:(\d+)x(\d+)(?:a(\d*[.,]?\d+))?|(?![a-z0-9]))", re.IGNORECASE)
_SAME = 0.01  # Names give the aspect in a few digits.
_SQUEEZED = 2.0  # Tiles may be squeezed: customary quilts do it by up to 1.6.


def quilt_part(name: str) -> re.Match[str] | None:
    """The part of a name that makes it a quilt's: ``_qs``, ``_qs8x6`` or ``_qs8x6a0.75``.

    Its groups are columns, rows and aspect, or None.
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
    """What one place says of a quilt's layout, in part or whole."""

    place: str  # Where it is said, for messages.
    # columns, rows: 0 where nothing is said.
    columns: int = 0
    rows: int = 0
    aspect: float = 0.0  # Width over height of what a view shows; 0 where nothing is said.

    @staticmethod
    def of_name(name: str) -> QuiltHint | None:
        """What a file name says, or None."""
        part = quilt_part(name)
        if part is None or part[1] is None:
            return None
        hint = QuiltHint("its name", int(part[1]), int(part[2]), _number(part[3]))
        if min(hint.columns, hint.rows) < 1 or (part[3] and not 0 < hint.aspect < 1e4):
            raise UserError(f"the quilt name {name!r} has an impossible layout")
        return hint

    @staticmethod
    def of_options(columns: int, rows: int, aspect: float) -> QuiltHint | None:
        """What the options ``--columns``, ``--rows`` and ``--aspect`` say, or None."""
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
    elif (right or top) and not any(
            (panel.quilt, panel.quilt_size) == ((layout.columns, layout.rows), (width, height))
            for panel in map(Display.preset, Display.names())):
        warnings.warn(f"{name} has {width} x {height} pixels, which {layout.columns} x "
                      f"{layout.rows} views do not divide: {right} at the right and {top} at the "
                      "top are left out; if the picture was scaled, take the original",
                      UserWarning, stacklevel=2)


_EXIF, _USER_COMMENT = 0x8769, 0x9286
_BLOCK = re.compile(r'\{[^{}]*"LKGColumns"[^{}]*\}')
_BROKEN = (OSError, KeyError, TypeError, ValueError, AttributeError, SyntaxError, OverflowError,
           RecursionError, struct.error)


def _hint(place: str, columns: Any, rows: Any, aspect: Any) -> QuiltHint:
    hint = QuiltHint(place, int(columns), int(rows), float(aspect or 0))
    if min(hint.columns, hint.rows) < 1 or not 0 <= hint.aspect < 1e4:
        raise ValueError("an impossible layout")
    return hint


def _beside(path: Path) -> Iterator[QuiltHint]:
    """What ``NAME.png.json`` says, and ``NAME.json``, which may as well be somebody else's."""
    for name, own in ((f"{path.name}.json", True), (f"{path.stem}.json", False)):
        side = path.with_name(name)
        if not side.is_file():
            continue
        try:
            entry = read_json(side)["quilt_settings"]
            yield _hint(side.name, entry["viewX"], entry["viewY"], entry.get("aspect"))
        except (*_BROKEN, UserError):
            if own:
                warnings.warn(f"{side.name} beside {path.name} is left out: it is no JSON that "
                              "gives a quilt's layout", UserWarning, stacklevel=3)


def _texts(path: Path, thorough: bool) -> Iterator[tuple[str, str | bytes]]:
    """Texts in a file, each with its place."""
    if path.suffix.lower() in VIDEOS:
        import av

        with av.open(str(path)) as container:
            yield from (("its metadata", text) for text in container.metadata.values())
        return
    with open_picture(path) as picture:
        for key, value in picture.info.items():
            if isinstance(value, str | bytes):
                yield "its EXIF" if key == "exif" else "its metadata", value
        # A PNG may have its EXIF at the end, and is decoded on the way there.
        if "exif" not in picture.info and (thorough or picture.format != "PNG"):
            yield "its EXIF", picture.getexif().get_ifd(_EXIF).get(_USER_COMMENT, b"")
            yield from (("its metadata", value) for value in getattr(picture, "text", {}).values())


def _inside(path: Path, thorough: bool) -> Iterator[QuiltHint]:
    with suppress(*_BROKEN):
        for place, text in _texts(path, thorough):
            if isinstance(text, bytes):
                text = text.replace(b"\0", b"").decode("latin-1")  # UTF-16, too: all is ASCII
            found = _BLOCK.search(html.unescape(text))
            if found is not None:
                with suppress(*_BROKEN):
                    entry = json.loads(found[0])
                    yield _hint(place, entry["LKGColumns"], entry["LKGRows"],
                                entry.get("LKGAspect"))


def layout_of_file(path: Path, display: Display | None = None, *,
                   asked: QuiltHint | None = None) -> QuiltLayout | None:
    """The layout of a quilt by its name, its side file or its metadata, in this order; or None.

    If they contradict each other, the first counts, and a warning says so. What the user ``asked``
    comes first; the display's aspect is taken where only columns and rows are given.
    """
    hints = [hint for hint in (asked, QuiltHint.of_name(path.name)) if hint is not None]
    hints += _beside(path)
    hints += _inside(path, thorough=not any(hint.columns and hint.aspect for hint in hints))
    first = next((hint for hint in hints if hint.columns), None)
    if first is None:
        return None
    alike = [hint for hint in hints if not hint.columns or (hint.columns, hint.rows) == (
        first.columns, first.rows)]
    aspect = next((hint.aspect for hint in alike if hint.aspect), display.aspect if display else 0)
    _warn_of_contradiction(path, hints)
    return QuiltLayout(first.columns, first.rows, aspect, first.place) if aspect else None


def _warn_of_contradiction(path: Path, hints: list[QuiltHint]) -> None:
    """One line about the first two that do not agree."""
    for one, other in combinations(hints, 2):
        if not one.agrees(other):
            warnings.warn(f"{path.name} is said to have different layouts, by {one.said()}, and by "
                          f"{other.said()}: the first is used", UserWarning, stacklevel=3)
            return


def _size(path: Path) -> tuple[int, int]:
    """Width and height of a picture or a video."""
    try:
        if path.suffix.lower() in VIDEOS:
            import av

            with av.open(str(path)) as container:
                return container.streams.video[0].width, container.streams.video[0].height
        with open_picture(path) as picture:
            return picture.size
    except FileNotFoundError as error:
        raise UserError(f"no such file: {path}") from error
    except (OSError, ValueError, SyntaxError, IndexError) as error:
        raise UserError(f"can't read the picture {path}: {error}") from error


def layout_for(path: Path, display: Display | None, *, asked: QuiltHint | None = None,
               ) -> QuiltLayout:
    """The layout of a quilt for a display (`layout_of_file`), or an error that says how to give it.

    A quilt of which nothing is said, but which has just the size of the display's customary one, is
    taken for such a one, with a warning.
    """
    layout = layout_of_file(path, display, asked=asked)
    if layout is not None:
        return layout
    if display is not None and _size(path) == display.quilt_size:
        layout = QuiltLayout.of_display(display)
        warnings.warn(f"nothing gives the layout of the quilt {path.name}: by its size it is taken "
                      f"for {layout.columns} x {layout.rows} views, as is customary for "
                      f"{display.name}", UserWarning, stacklevel=2)
        return QuiltLayout(layout.columns, layout.rows,
                           asked.aspect if asked and asked.aspect else layout.aspect)
    raise UserError(f"nothing gives the layout of the quilt {path}: name it as in "
                    "portrait_qs8x6a0.75.png (columns, rows, aspect), or give --columns and --rows")
