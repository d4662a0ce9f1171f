"""The ground of a page in the color of a painting's."""

from __future__ import annotations

import numpy as np

from ...field import Backdrop

__all__ = ["ground_style"]

_DARK, _LIGHT = 0.16, 0.88
"""Luma of a page's ground, at most and at least: its text must stay legible."""


def ground_style(backdrop: Backdrop | None) -> tuple[str, bool]:
    """Style sheet of a page's ground, and whether the page begins with a light one.

    A painted ground that is dark takes the place of the page's dark one, a light one that of its
    light one: the other can be chosen as before. Without a painted ground the style is empty.
    """
    if backdrop is None:
        return "", False
    color = backdrop.color
    luma = float(color @ [0.299, 0.587, 0.114])
    light = luma > 0.5
    if light:
        ground = 1 - (1 - color) * min(1.0, (1 - _LIGHT) / max(1 - luma, 1e-3))
        glow = 1 - (1 - ground) * 0.4
    else:
        ground = color * min(1.0, _DARK / max(luma, 1e-3))
        glow = np.clip(1.6 * ground + 0.02, 0, 1)
    chosen = '[data-ground="light"]' if light else ':not([data-ground="light"])'
    return f"\n:root{chosen} {{ --ground: {_hex(ground)}; --glow: {_hex(glow)}; }}\n", light


def _hex(color: np.ndarray) -> str:
    """A color in [0, 1] for a style sheet."""
    return "#" + "".join(f"{round(255 * float(value)):02x}" for value in color)
