"""The layout of a quilt that is a file: by its name, what lies beside it, and what is in it.

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
from itertools import combinations
from pathlib import Path
from typing import Any

from ...errors import UserError
from ...files import read_json
from ...media.kinds import VIDEOS
from ...media.pictures import open_picture
from ..display import Display
from .layout import QuiltHint, QuiltLayout

__all__ = ["layout_for", "layout_of_file"]

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
    """The layout of a quilt by its name, its side file or its metadata, in this order.

    If they contradict each other, the first counts, and a warning says so.

    Parameters
    ----------
    path
        The quilt, a picture or a video.
    display
        Its aspect is taken where only columns and rows are given.
    asked
        What the user says; it comes first.

    Returns
    -------
    layout
        None if nothing gives it.

    Raises
    ------
    UserError
        If the name gives an impossible layout, or two.
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

    Raises
    ------
    UserError
        If nothing gives the layout, or the file can't be read.
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
