"""A depth map that a camera kept beside its picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["DepthMap", "fitted", "upright"]

Floats = NDArray[np.float32]

# How the stored pixels are brought upright, by EXIF's orientation; 1 leaves them.
_TO_UPRIGHT: dict[int, Callable[[NDArray[Any]], NDArray[Any]]] = {
    2: np.fliplr,
    3: lambda stored: np.rot90(stored, 2),
    4: np.flipud,
    5: np.transpose,
    6: lambda stored: np.rot90(stored, -1),
    7: lambda stored: np.rot90(stored.T, 2),
    8: np.rot90,
}
# Maps are rounded to whole pixels, and cut to whole blocks.
_SAME_RATIO = 0.05


@dataclass(frozen=True)
class DepthMap:
    """Depth of an upright picture, at a size of its own.

    The map is stretched over the whole picture: pixel (x, y) of it shows what the picture shows at
    (x W / w, y H / h), in pixel edges. All phones keep a smaller map than the picture.

    Attributes
    ----------
    values
        float32 [h, w], NaN = unknown; distances or inverse distances (``kind``).
    kind
        ``"distance"`` (larger is farther) or ``"inverse"`` (larger is nearer, 0 = no end).
    metric
        Whether ``values`` are in metres, or 1 / metres, by the camera's own word. Where not, their
        scale is unknown, and with it, for inverse ones, perhaps their zero.
    along
        ``"axis"``: the distance of the plane through the point that faces the camera, which is z in
        the camera's frame; ``"ray"``: the distance of the point.
    near, far
        The range that the file notes, as distances in the unit of ``values``; None where it notes
        none, or no end.
    confidence
        float32 [h, w] in [0, 1], 1 = sure, or None.
    source
        ``"heic"``, ``"gdepth"``, ``"dynamic depth"``, ``"apple jpeg"`` or ``"data set"``.
    """

    values: Floats
    kind: Literal["distance", "inverse"]
    metric: bool
    along: Literal["axis", "ray"] = "axis"
    near: float | None = None
    far: float | None = None
    confidence: Floats | None = None
    source: str = ""

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or not self.values.size:
            raise ValueError(f"a depth map has two axes, not the shape {self.values.shape}")
        if self.confidence is not None and self.confidence.shape != self.values.shape:
            raise ValueError(f"a confidence of {self.confidence.shape} for a depth map of "
                             f"{self.values.shape}")

    def distance(self) -> tuple[Floats, bool]:
        """Distances, float32 [h, w], NaN = unknown or no end; and whether they are metres."""
        if self.kind == "distance":
            known = np.isfinite(self.values) & (self.values > 0)
            return np.where(known, self.values, np.float32(np.nan)), self.metric
        known = self.values > 0
        found = np.full(self.values.shape, np.nan, np.float32)
        np.divide(1.0, self.values, out=found, where=known)
        found[~np.isfinite(found)] = np.nan
        return found, self.metric

    def ratio(self, picture: tuple[int, int]) -> tuple[float, float]:
        """How many pixels of a picture of this (width, height) one of the map's takes, (x, y)."""
        return picture[0] / self.values.shape[1], picture[1] / self.values.shape[0]

    def changed(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> DepthMap:
        """The map with its arrays moved alike: a turn, a flip or a cut."""
        return replace(self, values=np.ascontiguousarray(change(self.values)),
                       confidence=None if self.confidence is None
                       else np.ascontiguousarray(change(self.confidence)))

    def turned(self, turns: int) -> DepthMap:
        """The map after so many counter-clockwise quarter turns."""
        return self.changed(lambda array: np.rot90(array, turns)) if turns % 4 else self


def fitted(confidence: Floats | None, shape: tuple[int, int]) -> Floats | None:
    """A confidence at the size of its depth map, float32 [h, w], by the nearest pixels."""
    if confidence is None or confidence.shape == shape:
        return confidence
    rows = np.arange(shape[0]) * confidence.shape[0] // shape[0]
    columns = np.arange(shape[1]) * confidence.shape[1] // shape[1]
    return np.ascontiguousarray(confidence[rows[:, None], columns])


def upright(depth: DepthMap, orientation: int, stored: tuple[int, int]) -> DepthMap:
    """A depth map brought upright with its picture.

    A map lies as the picture's stored pixels do, and is turned with them. One whose shape fits the
    upright picture alone was turned by the program that wrote it.

    Parameters
    ----------
    orientation
        As EXIF notes it for the picture, 1 to 8; others leave the map.
    stored
        Width and height of the picture's stored pixels.
    """
    change = _TO_UPRIGHT.get(orientation)
    if change is None:
        return depth
    height, width = depth.values.shape
    if (orientation >= 5 and not same_ratio((width, height), stored)
            and same_ratio((width, height), stored[::-1])):
        return depth
    return depth.changed(change)


def same_ratio(first: tuple[int, int], second: tuple[int, int]) -> bool:
    """Whether two sizes (width, height) are of one shape, but for rounding."""
    ratio = first[0] * second[1] / max(1, first[1] * second[0])
    return abs(ratio - 1.0) < _SAME_RATIO
