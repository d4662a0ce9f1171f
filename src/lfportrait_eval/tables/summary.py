"""Summary of the cells' figures: mean, spread and number over sitters and styles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

__all__ = ["COLUMNS", "FLOORS", "GROUPS", "Cell", "Column", "Spread", "spreads"]

FLOORS = {"field": "the field before style", "photos": "the photos"}
"""Rows of the consistency that are no methods."""


@dataclass(frozen=True)
class Column:
    """One figure.

    Attributes
    ----------
    name
        In the cells.
    title
        At the head of a table.
    better
        ``low``, ``high``, or ``one``: the nearer to 1 the better; empty: neither.
    digits
        Behind the point.
    """

    name: str
    title: str
    better: Literal["low", "high", "one", ""] = "low"
    digits: int = 3


@dataclass(frozen=True)
class Cell:
    """One method's result for one sitter in one style."""

    sitter: str
    style: str
    method: str
    figures: dict[str, float | None]
    facts: dict[str, Any]


@dataclass(frozen=True)
class Spread:
    """Mean, standard deviation (of single cells, n - 1) and number; the deviation of one is 0."""

    mean: float
    deviation: float
    count: int

    @staticmethod
    def of(values: Iterable[float | None]) -> Spread | None:
        """Of what is known; None where nothing is."""
        known = np.array([value for value in values if value is not None and np.isfinite(value)],
                         np.float64)
        if not len(known):
            return None
        return Spread(float(known.mean()), float(known.std(ddof=1)) if len(known) > 1 else 0.0,
                      len(known))


COLUMNS = {column.name: column for column in (
    Column("short_rmse", "neighbours, RMSE", digits=4),
    Column("long_rmse", "7 apart, RMSE", digits=4),
    Column("ends_rmse", "ends, RMSE", digits=4),
    Column("short_normalised", "neighbours, over contrast"),
    Column("long_normalised", "7 apart, over contrast"),
    Column("short_lpips_alex", "neighbours, LPIPS alex"),
    Column("long_lpips_alex", "7 apart, LPIPS alex"),
    Column("short_lpips_vgg", "neighbours, LPIPS vgg"),
    Column("long_lpips_vgg", "7 apart, LPIPS vgg"),
    Column("contrast", "contrast", "", 2),
    Column("patches", "patches", digits=2),
    Column("sharpness", "sharpness", "one", 2),
    Column("identity_error", "landmarks"),
    Column("identity_found", "faces found", "high", 2),
    Column("contours", "contours", "high", 2),
    Column("repeats_hair", "repeats, hair", digits=2),
    Column("repeats_body", "repeats, body", digits=2),
    Column("content", "content"),
    Column("fid_64", "FID-64", digits=2),
    Column("fid_192", "FID-192", digits=2),
    Column("fid_768", "FID-768", digits=3),
    Column("fid_2048", "FID-2048", digits=1),
    Column("kid_768", "KID-768", digits=4),
    Column("psnr_content", "PSNR, photo field", "high", 2),
    Column("ssim_content", "SSIM, photo field", "high"),
    Column("lpips_alex_content", "LPIPS alex, photo field"),
    Column("lpips_vgg_content", "LPIPS vgg, photo field"),
    Column("psnr_example", "PSNR, painted views", "high", 2),
    Column("ssim_example", "SSIM, painted views", "high"),
    Column("lpips_alex_example", "LPIPS alex, painted views"),
    Column("lpips_vgg_example", "LPIPS vgg, painted views"),
    Column("seconds_once", "once, s", digits=1),
    Column("seconds_view", "each view, s"),
    Column("memory", "peak memory, GiB", digits=2),
)}
"""All figures of a cell."""

GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "overview": ("Side by side", (
        "short_normalised", "long_normalised", "contrast", "patches", "sharpness",
        "identity_error", "identity_found", "contours", "repeats_hair", "repeats_body")),
    "consistency": ("Consistency", (
        "short_rmse", "long_rmse", "ends_rmse", "short_normalised", "long_normalised",
        "short_lpips_alex", "long_lpips_alex", "short_lpips_vgg", "long_lpips_vgg", "contrast")),
    "style": ("Distance to the style and to the photo", (
        "fid_64", "fid_192", "fid_768", "fid_2048", "kid_768", "patches", "content")),
    "table_2": ("Table 2", (
        "fid_2048", "psnr_content", "ssim_content", "lpips_alex_content", "lpips_vgg_content",
        "psnr_example", "ssim_example", "lpips_alex_example", "lpips_vgg_example")),
    "cost": ("Cost", ("seconds_once", "seconds_view", "memory")),
}
"""The tables: title and figures."""


def spreads(cells: Sequence[Cell], methods: Sequence[str]) -> dict[str, dict[str, Spread]]:
    """By method and figure: mean, deviation and number over sitters and styles."""
    found: dict[str, dict[str, Spread]] = {}
    for method in methods:
        mine = [cell.figures for cell in cells if cell.method == method]
        found[method] = {name: spread for name in [*COLUMNS, "short_degrees", "long_degrees"]
                         if (spread := Spread.of(row.get(name) for row in mine)) is not None}
    return found


def best(rows: dict[str, dict[str, Spread]], name: str, methods: Sequence[str]) -> str | None:
    """The method with the best mean of a figure, over as many cells as any; None if none is."""
    column = COLUMNS[name]
    known = {method: rows[method][name] for method in methods if name in rows.get(method, {})}
    most = max((spread.count for spread in known.values()), default=0)
    full = {method: spread.mean for method, spread in known.items() if spread.count == most}
    if not column.better or len(full) < 2:
        return None
    keys = {"low": lambda value: value, "high": lambda value: -value,
            "one": lambda value: abs(value - 1.0)}
    return min(full, key=lambda method: keys[column.better](full[method]))
