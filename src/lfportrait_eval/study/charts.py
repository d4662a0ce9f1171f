"""Values with intervals as an SVG drawing: rows of a dot and a line, in groups."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

__all__ = ["Row", "interval_chart"]

_INK, _SOFT, _GRID = "#28282c", "#6f6f76", "#e2e2e6"
_COLORS = ("#1f62b4", "#c85214", "#28824a", "#823c96")
_ROW, _LETTER = 26, 7.2


@dataclass(frozen=True)
class Row:
    """One value.

    Attributes
    ----------
    label, note
        What stands on the left and on the right of it.
    value, low, high
        The dot, and the ends of the line.
    """

    label: str
    value: float
    low: float
    high: float
    note: str = ""


def _ticks(low: float, high: float) -> list[float]:
    """About eight round numbers from ``low`` to ``high``."""
    raw = max(high - low, 1e-9) / 8
    unit = 10.0 ** math.floor(math.log10(raw))
    step = next(unit * size for size in (1, 2, 2.5, 5, 10) if unit * size >= raw * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [step * k for k in range(first, last + 1)]


def _text(x: float, y: float, text: str, anchor: str = "start", color: str = _INK,
          weight: str = "normal") -> str:
    return (f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{color}" '
            f'font-weight="{weight}">{escape(text)}</text>')


def interval_chart(groups: Sequence[tuple[str, Sequence[Row]]], *, title: str, across: str,
                   reference: float, span: tuple[float, float] | None = None,
                   width: int = 860) -> str:
    """Draw groups of values with their intervals.

    Parameters
    ----------
    groups
        Heading and rows of each; at least one row in all.
    title
        What the drawing shows.
    across
        What the axis shows.
    reference
        Where a line marks no difference.
    span
        Ends of the axis; by default what the intervals need.
    width
        Width of the drawing in pixels.

    Returns
    -------
    svg
        The drawing as text.
    """
    rows = [row for _, members in groups for row in members]
    if span is None:
        low = min(reference, *(row.low for row in rows))
        high = max(reference, *(row.high for row in rows))
        low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
    else:
        low, high = span
    left = 24 + _LETTER * max(len(row.label) for row in rows)
    right = width - 40 - _LETTER * max(len(row.note) for row in rows)
    bottom = 56 + _ROW * (len(rows) + sum(1.5 if name else 0.5 for name, _ in groups))

    def place(value: float) -> float:
        return left + (right - left) * (value - low) / max(high - low, 1e-9)

    parts = [f'<rect width="{width}" height="{bottom + 56:.0f}" fill="#fff"/>',
             _text(16, 28, title, weight="bold")]
    for tick in _ticks(low, high):
        parts += [f'<path d="M{place(tick):.1f} 44V{bottom:.1f}" stroke="{_GRID}"/>',
                  _text(place(tick), bottom + 18, f"{tick:g}", "middle", _SOFT)]
    parts.append(f'<path d="M{place(reference):.1f} 44V{bottom:.1f}" stroke="{_SOFT}" '
                 'stroke-dasharray="4 3"/>')
    y = 56.0
    for number, (name, members) in enumerate(groups):
        color = _COLORS[number % len(_COLORS)]
        if name:
            y += _ROW
            parts.append(_text(16, y - 6, name, color=color, weight="bold"))
        for row in members:
            y += _ROW
            middle = y - 10
            parts += [_text(left - 10, y - 5, row.label, "end"),
                      f'<path d="M{place(row.low):.1f} {middle}H{place(row.high):.1f}" '
                      f'stroke="{color}" stroke-width="3" stroke-linecap="round"/>',
                      f'<circle cx="{place(row.value):.1f}" cy="{middle}" r="5.5" '
                      f'fill="{color}"/>',
                      _text(width - 16, y - 5, row.note, "end", _SOFT)]
        y += _ROW / 2
    parts.append(_text((left + right) / 2, bottom + 40, across, "middle", _SOFT))
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {bottom + 56:.0f}" '
            f'width="{width}" font-family="system-ui, sans-serif" font-size="13" role="img">\n'
            f"<title>{escape(title)}</title>\n" + "\n".join(parts) + "\n</svg>\n")
