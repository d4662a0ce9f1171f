"""What a kind of scene hands to the renderer: solids, what they are made of, light and cameras."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt

import numpy as np

__all__ = ["DISTANCE", "INDOORS", "OUTDOORS", "STUDIO", "SUN", "Design", "lamp", "sun"]

OUTDOORS, STUDIO, INDOORS = range(3)  # what is mirrored where no solid is
ANGLE_X, DISTANCE = 0.6911112070083618, 4.031128874149275
SUN = np.array([0.45, -0.52, 0.73]) / sqrt(0.45**2 + 0.52**2 + 0.73**2)


def sun(strength: float, softness: float = 14.0, direction: np.ndarray = SUN) -> np.ndarray:
    """A light at infinity; the shadow's edge is the sharper, the larger ``softness`` is."""
    return np.array([*direction, 0.0, strength, 0.94 * strength, 0.82 * strength, softness])


def lamp(place, color, softness: float = 10.0) -> np.ndarray:
    """A light at a place; ``color`` is its strength one unit away."""
    return np.array([*place, 1.0, *color, softness])


@dataclass
class Design:
    """A scene.

    Attributes
    ----------
    solids, profiles, materials : See `solids.Model` and `materials.material`.
    lights : Rows of `sun` or `lamp`.
    ambient : Color of the light from everywhere [3], its part that does not depend on a
        surface's tilt, and the part that does.
    surroundings : OUTDOORS, STUDIO or INDOORS.
    extent, cells : Half edge of the cube that holds the solids; cells a side of its grid, a
        multiple of 4.
    angle_x : Horizontal field of view of the cameras.
    distances, heights : Range of the cameras' distances from the origin, and of the sine of
        their elevation.
    start : Where rays start, from the camera.
    samples, tolerance : Rays along a side of a pixel whose neighbours differ by more than
        ``tolerance``.
    closed : Whether there is something behind every pixel.
    """

    solids: np.ndarray
    profiles: np.ndarray
    materials: np.ndarray
    lights: np.ndarray = field(default_factory=lambda: np.array([sun(1.05)]))
    ambient: np.ndarray = field(default_factory=lambda: np.array(
        [0.55 * 0.88, 0.55 * 0.95, 0.55, 0.55, 0.45]))
    surroundings: int = OUTDOORS
    extent: float = 1.3
    cells: int = 72
    angle_x: float = ANGLE_X
    distances: tuple[float, float] = (DISTANCE, DISTANCE)
    heights: tuple[float, float] = (0.02, 0.99)
    start: float = 0.5
    samples: int = 4
    tolerance: float = 0.03
    closed: bool = False
