"""The report: one HTML file with pictures, figures and times that opens offline, anywhere.

A `Report` is a hero picture and a list of sections; a section has a text, pictures and tables, any
of which may be missing. `write_report` puts all of it, pictures and video included, into one file:
no script, no font and no picture is loaded from elsewhere. It follows the reader's light or dark
setting.
"""

import base64
import html
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any, Literal

import numpy as np
from PIL import Image

from ..arrays import Array
from ..color import to_uint8
from ..files import write_bytes
from ..media.pictures import read_image


@dataclass(frozen=True)
class Picture:
    """A picture with its caption."""

    # A file, or [H, W] or [H, W, 3 or 4], uint8 or float in [0, 1].
    image: str | Path | Array
    caption: str = ""  # Text below it.
    # Every pixel matters (coded pictures, masks): embedded without loss and shown with hard pixels
    # at its own size.
    exact: bool = False
    # Larger pictures are embedded scaled down to this width in pixels; 0 = as they are.
    width: int = 640


@dataclass(frozen=True)
class Table:
    """A table; numbers are set right and rounded for reading."""

    rows: Sequence[Sequence[Any]]  # Cells of each row: text, numbers, None (empty).
    header: Sequence[str] = ()  # Names of the columns; none by default.
    # Index of a column of numbers that is drawn as bars, too (times of stages); -1 = none.
    bars: int = -1
    caption: str = ""  # Text above it.


@dataclass
class Section:
    """A part of the report: a title, a text, pictures and tables; empty ones are left out."""

    title: str
    text: str = ""
    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    # A row of one height that scrolls; columns; one below the other in full width.
    layout: Literal["strip", "grid", "wide"] = "grid"
    video: str | Path | None = None  # A file, embedded; left out if it does not exist.
    drawings: Sequence[str] = ()  # SVG elements, made by us: they are put in as they are.

    def empty(self) -> bool:
        """Whether there is nothing to show."""
        film = self.video is not None and Path(self.video).is_file()
        return not (self.text or _present(self.pictures) or self.tables or self.drawings or film)


@dataclass
class Report:
    """A report: title, hero picture, key figures, sections."""

    title: str
    subtitle: str = ""
    hero: Picture | None = None
    # Up to about six pairs, label and value, shown large below the title.
    key_figures: list[tuple[str, str]] = field(default_factory=list)
    sections: list[Section] = field(default_factory=list)


def _pixels(picture: Picture) -> Image.Image:
    """The picture, scaled down to its width."""
    array = (read_image(picture.image) if isinstance(picture.image, (str, Path))
             else np.asarray(picture.image))
    if array.dtype == bool:
        array = array.astype(np.uint8) * 255
    else:
        array = to_uint8(np.nan_to_num(array))
    image = Image.fromarray(array)
    if picture.width and image.width > picture.width and not picture.exact:
        height = max(1, round(image.height * picture.width / image.width))
        image = image.resize((picture.width, height), Image.Resampling.LANCZOS)
    return image


def _data_address(picture: Picture) -> tuple[str, int, int]:
    """The picture as a ``data:`` address, and its width and height."""
    image = _pixels(picture)
    buffer = io.BytesIO()
    if picture.exact or image.mode in ("RGBA", "LA"):
        image.save(buffer, "PNG", optimize=True)
        kind = "png"
    else:
        # Not `optimize`: then Pillow's buffer must hold the whole file, and noise does not fit in.
        image.convert("RGB").save(buffer, "JPEG", quality=88, subsampling=0)
        kind = "jpeg"
    text = base64.b64encode(buffer.getvalue()).decode()
    return f"data:image/{kind};base64,{text}", image.width, image.height


def _figure(picture: Picture) -> str:
    address, width, height = _data_address(picture)
    caption = html.escape(picture.caption)
    kind = ' class="exact"' if picture.exact else ""
    below = f"<figcaption>{caption}</figcaption>" if caption else ""
    return (f'<figure{kind}><img src="{address}" width="{width}" height="{height}" '
            f'alt="{caption}">{below}</figure>')


def _cell(value: Any) -> tuple[str, bool]:
    """A cell's text, and whether it is a number."""
    if value is None:
        return "", False
    if isinstance(value, (bool, np.bool_)):
        return ("yes" if value else "no"), False
    if isinstance(value, (int, np.integer)):
        return f"{int(value):,}".replace(",", "\u202f"), True
    if isinstance(value, (float, np.floating)):
        number = float(value)
        if not np.isfinite(number):
            return ("\u221e" if number > 0 else "-\u221e") if not np.isnan(number) else "", True
        if abs(number) >= 1000:
            return f"{number:,.0f}".replace(",", "\u202f"), True
        text = f"{number:.3g}" if abs(number) < 100 else f"{number:.1f}"
        return (text if "e" not in text else f"{number:.2e}"), True
    return html.escape(str(value)), False


def _table(table: Table) -> str:
    largest = 0.0
    if table.bars >= 0:
        largest = max((float(row[table.bars]) for row in table.rows
                       if row[table.bars] is not None), default=0.0)
    lines = []
    if table.caption:
        lines.append(f"<caption>{html.escape(table.caption)}</caption>")
    if table.header:
        cells = "".join(f"<th>{html.escape(name)}</th>" for name in table.header)
        lines.append(f"<tr>{cells}{'<th></th>' if table.bars >= 0 else ''}</tr>")
    for row in table.rows:
        cells = "".join(f'<td class="number">{text}</td>' if number else f"<td>{text}</td>"
                        for text, number in map(_cell, row))
        if table.bars >= 0:
            share = 100 * float(row[table.bars] or 0) / largest if largest > 0 else 0.0
            cells += f'<td class="bar"><span style="width:{share:.1f}%"></span></td>'
        lines.append(f"<tr>{cells}</tr>")
    return f'<div class="table"><table>{"".join(lines)}</table></div>'


def _video(path: str | Path | None) -> str:
    if path is None or not Path(path).is_file():
        return ""
    text = base64.b64encode(Path(path).read_bytes()).decode()
    return ('<figure class="film"><video controls loop muted autoplay playsinline '
            f'src="data:video/mp4;base64,{text}"></video></figure>')


def _present(pictures: Sequence[Picture]) -> list[Picture]:
    """The pictures that are there: a file that a job did not write is left out."""
    return [picture for picture in pictures
            if not isinstance(picture.image, (str, Path)) or Path(picture.image).is_file()]


def _anchor(title: str) -> str:
    return "".join(letter if letter.isalnum() else "-" for letter in title.lower()).strip("-")


def _section(section: Section) -> str:
    parts = [f'<section id="{_anchor(section.title)}"><h2>{html.escape(section.title)}</h2>']
    if section.text:
        parts.extend(f"<p>{html.escape(paragraph)}</p>" for paragraph in section.text.split("\n\n"))
    parts.append(_video(section.video))
    pictures = _present(section.pictures)
    if pictures:
        figures = "".join(map(_figure, pictures))
        # As many columns as leave the fewest empty places in the last row.
        columns = min((4, 3), key=lambda number: -len(pictures) % number)
        parts.append(f'<div class="{section.layout}" style="--columns:{columns}">{figures}</div>')
    parts.extend(map(_table, section.tables))
    parts.extend(f'<div class="drawing">{drawing}</div>' for drawing in section.drawings)
    return "".join(parts) + "</section>"


def write_report(path: str | Path, report: Report) -> None:
    """Write a report as one self-contained HTML file; it appears when it is complete.

    Texts are escaped; sections without content, and files that don't exist, are left out.
    """
    sections = [section for section in report.sections if not section.empty()]
    links = "".join(f'<a href="#{_anchor(section.title)}">{html.escape(section.title)}</a>'
                    for section in sections)
    figures = "".join(f"<div><b>{html.escape(value)}</b><span>{html.escape(label)}</span></div>"
                      for label, value in report.key_figures)
    template = Template(resources.files(__package__).joinpath("report.html").read_text("utf-8"))
    page = template.substitute(
        title=html.escape(report.title), subtitle=html.escape(report.subtitle),
        hero="".join(map(_figure, _present([report.hero] if report.hero else []))), links=links,
        figures=f'<div class="figures">{figures}</div>' if figures else "",
        sections="\n".join(map(_section, sections)))
    write_bytes(path, page.encode())
