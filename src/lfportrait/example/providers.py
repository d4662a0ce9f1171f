"""Exemplars and training photos of later packages, found through entry points.

A package names what it offers under ``[project.entry-points]`` in its ``pyproject.toml``; this one
offers its own painted exemplars and portraits of modelled people in the same way:

* group ``lfportrait.styles``: functions of no argument that give ``{name: function}``, where the
  latter makes the exemplar of that name;
* group ``lfportrait.sittings``: functions ``(count, height, seed)`` that give photos with landmarks
  to train a network on.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError

__all__ = ["Sitting", "provided_sittings", "provided_styles"]

Sitting = tuple[NDArray[np.uint8], NDArray[np.float64]]
"""A photo, uint8 [H, W, 3], and its landmarks [68, 2]."""


def provided_styles() -> dict[str, Callable[[], Any]]:
    """The installed exemplars: for each name what makes its `Exemplar`."""
    styles: dict[str, Callable[[], Any]] = {}
    for entry in entry_points(group="lfportrait.styles"):
        styles.update(entry.load()())
    return styles


def provided_sittings(count: int, height: int, seed: int) -> list[Sitting]:
    """Photos with landmarks from installed packages.

    Parameters
    ----------
    count
        Number of photos.
    height
        Of a photo in pixels.
    seed
        Of all choices.

    Raises
    ------
    UserError
        If nobody does.
    """
    for entry in entry_points(group="lfportrait.sittings"):
        found: list[Sitting] = entry.load()(count, height, seed)
        return found
    raise UserError("there are no photos to train on; give a folder with portraits, or install the "
                    "package (`pip install lfportrait`) instead of running it from its sources")
