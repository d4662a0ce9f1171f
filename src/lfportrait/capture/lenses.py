"""Lens distortion: the models of OpenCV, COLMAP and photogrammetry; pictures resampled as flat.

With normalised image coordinates (x, y) = (X/Z, Y/Z), r^2 = x^2 + y^2:

- ``opencv``: x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
  + 2 p1 x y + p2 (r^2 + 2 x^2), and y' likewise with p1 and p2 exchanged;
- ``brown``: x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) and the same terms with p1 and p2;
- ``fisheye``: theta = atan r, theta' = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6
  + k4 theta^8), (x', y') = theta'/r (x, y);
- ``thin_prism``: (u, v) = theta/r (x, y), q = theta; u' = u (1 + k1 q^2 + k2 q^4 + k3 q^6 + k4 q^8)
  + 2 p1 u v + p2 (q^2 + 2 u^2) + s1 q^2, and v' likewise with p1 and p2 exchanged and s2;
- ``fov``: r' = atan(2 r tan(w/2)) / w with w = k1, (x', y') = r'/r (x, y).

A straightened picture shows nothing that the photo does not: where a lens pulls the corners inwards
its focal length is a little longer, so that the photo covers it all. Depth maps are straightened
with their pictures, saved beside them and read again.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..arrays import Array, Bool, Float32, Float64
from ..files import UNREADABLE_ARRAYS, load_arrays
from ..media.colors import premultiplied, straight
from ..media.depth import DepthMap

# A straightened picture may be this much larger than the photo to leave no uncovered corners.
_LARGEST_ZOOM = 1.5


@dataclass(frozen=True)
class Lens:
    """A camera's intrinsics with its distortion."""

    # width, height: Picture size in pixels.
    width: int
    height: int
    # focal, center: (x, y) in pixels.
    focal: tuple[float, float]
    center: tuple[float, float]
    # ``"opencv"``, ``"brown"``, ``"fisheye"``, ``"thin_prism"`` or ``"fov"``.
    model: str = "opencv"
    # Radial coefficients: up to 6 (opencv), 4 (brown, fisheye, thin_prism), the angle w (fov).
    k: tuple[float, ...] = ()
    # Tangential coefficients p1, p2 (opencv, brown, thin_prism).
    p: tuple[float, float] = (0.0, 0.0)
    s: tuple[float, float] = (0.0, 0.0)  # Prism coefficients s1, s2 (thin_prism).

    @property
    def distorts(self) -> bool:
        """Whether the lens bends straight lines; a fisheye always does."""
        return self.model in ("fisheye", "thin_prism") or any(self.k) or any(self.p)

    def resized(self, width: int, height: int) -> Lens:
        """The lens of the same picture at another size, in pixels."""
        ratio = width / self.width, height / self.height
        return replace(self, width=width, height=height,
                       focal=(self.focal[0] * ratio[0], self.focal[1] * ratio[1]),
                       center=(self.center[0] * ratio[0], self.center[1] * ratio[1]))

    def turned(self) -> Lens:
        """The lens of the same picture turned clockwise by a quarter turn."""
        # The vectors (p2, p1) and (s1, s2) turn with the picture.
        return replace(self, width=self.height, height=self.width, focal=self.focal[::-1],
                       center=(self.height - self.center[1], self.center[0]),
                       p=(self.p[1], -self.p[0]), s=(-self.s[1], self.s[0]))

    def _radial(self, r: Float64) -> Float64:
        """Distance from the centre on the sensor over the pinhole's, without the other terms."""
        if self.model == "fov":
            angle = self.k[0] if self.k else 0.0
            if abs(angle) < 1e-6:
                return np.ones_like(r)
            reach = 2.0 * np.tan(0.5 * angle)
            return np.where(r > 1e-9, np.arctan(r * reach) / np.maximum(r * angle, 1e-300),
                            reach / angle)
        if self.model == "opencv":
            k = (*self.k, *([0.0] * 6))[:6]
            r2 = r * r
            below = 1 + r2 * (k[3] + r2 * (k[4] + r2 * k[5]))
            return (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]))) / np.where(below == 0, 1e-300, below)
        k = (*self.k, *([0.0] * 4))[:4]
        if self.model == "brown":
            r2 = r * r
            return np.asarray(1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3]))))
        theta = np.arctan(r)
        t2 = theta * theta
        bent = theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
        return np.where(r > 1e-12, bent / np.maximum(r, 1e-12), 1.0)

    def distort(self, points: Float64) -> Float64:
        """Normalised pinhole coordinates [..., 2] -> normalised coordinates on the sensor."""
        r = np.sqrt((points * points).sum(-1))
        found: Float64 = points * self._radial(r)[..., None]
        if self.model == "thin_prism":
            points = points * np.where(r > 1e-12, np.arctan(r) / np.maximum(r, 1e-12),
                                       1.0)[..., None]
        elif self.model not in ("opencv", "brown"):
            return found
        (p1, p2), (s1, s2) = self.p, self.s
        x, y = points[..., 0], points[..., 1]
        r2 = x * x + y * y
        return found + np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s1 * r2,
                                 p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + s2 * r2], axis=-1)

    def pinhole(self) -> Lens:
        """The straightened picture's lens: no distortion, all covered by the photo if possible."""
        if not self.distorts:
            return self
        zoom = _zoom(self)
        return Lens(self.width, self.height, (self.focal[0] * zoom, self.focal[1] * zoom),
                    self.center)

    def source_pixels(self, size: tuple[int, int] | None = None) -> Float64:
        """For each pixel of the pinhole picture, where it lies in the photo: [H, W, 2] (x, y).

        NaN where the lens' formula folds back, which no photo shows. ``size``, (width, height):
        for the pixels of the picture reduced to it; the places are still in the photo's pixels.
        """
        width, height = size or (self.width, self.height)
        x, y = np.meshgrid((np.arange(width) + 0.5) * (self.width / width),
                           (np.arange(height) + 0.5) * (self.height / height))
        return _source(self, np.stack([x, y], -1), self.pinhole().focal)


def _source(lens: Lens, pixels: Float64, focal: tuple[float, float]) -> Float64:
    """Where pixels [..., 2] of a pinhole picture with this focal length lie in the photo."""
    flat = (pixels - np.array(lens.center)) / np.array(focal)
    r = np.sqrt((flat * flat).sum(-1))
    # Up to where the distance on the sensor grows with the angle.
    ladder = np.linspace(0.0, max(float(r.max()), 1e-9), 1025)
    falls = np.flatnonzero(np.diff(ladder * lens._radial(ladder)) <= 0)
    place = lens.distort(flat) * np.array(lens.focal) + np.array(lens.center)
    if len(falls):
        place[r > ladder[falls[0]]] = np.nan
    return place


def _covered(lens: Lens, place: Float64) -> Bool:
    """Which places [..., 2] lie in the photo; not the unknown ones."""
    return np.asarray((place[..., 0] >= 0) & (place[..., 0] <= lens.width)
                      & (place[..., 1] >= 0) & (place[..., 1] <= lens.height))


@functools.cache
def _zoom(lens: Lens) -> float:
    """By how much longer a focal length leaves no corner uncovered; 1 where none is enough."""
    x, y = np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5
    rim = np.concatenate([np.stack([x, np.full_like(x, edge)], -1) for edge in (y[0], y[-1])]
                         + [np.stack([np.full_like(y, edge), y], -1) for edge in (x[0], x[-1])])

    def fits(zoom: float) -> bool:
        focal = lens.focal[0] * zoom, lens.focal[1] * zoom
        return bool(_covered(lens, _source(lens, rim, focal)).all())

    if fits(1.0) or not fits(_LARGEST_ZOOM):
        return 1.0
    low, high = 1.0, _LARGEST_ZOOM
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if fits(middle) else (middle, high)
    return high


def undistort(image: Array, lens: Lens) -> tuple[Array, Bool]:
    """Resample a photo uint8 [H, W, C] as the pinhole camera ``lens.pinhole()`` sees it.

    Gives uint8 [H, W, C], and bool [H, W]: which pixels the photo covers.
    """
    if not lens.distorts:
        return image, np.ones(image.shape[:2], bool)
    columns, rows, inside = _map(lens)
    # What is transparent has any color, which must not get into the edge of what is not.
    cut_out = image.ndim == 3 and image.shape[2] == 4 and bool((image[..., 3] < 255).any())
    if cut_out:
        image = premultiplied(image)
    # Cubic, as a linear blend of pixels would blur the photo.
    flat = cv2.remap(np.ascontiguousarray(image), columns, rows, cv2.INTER_CUBIC,
                     borderMode=cv2.BORDER_REPLICATE)
    flat = np.asarray(flat).reshape(image.shape)
    return (straight(flat.astype(np.float32)) if cut_out else flat), inside


@functools.lru_cache(maxsize=1)
def _map(lens: Lens) -> tuple[Float32, Float32, Bool]:
    """Columns and rows [H, W] of the photo for each pixel, and where the photo covers it.

    Photos of one camera follow each other, so the last one's is kept.
    """
    place = lens.source_pixels()
    return (*_columns_rows(place), _covered(lens, place))


def _columns_rows(place: Float64) -> tuple[Float32, Float32]:
    """Places [H, W, 2] as `cv2.remap` takes them: outside of the picture where they are unknown."""
    columns, rows = (np.ascontiguousarray(np.nan_to_num(place[..., axis], nan=-1.0) - 0.5,
                                          np.float32) for axis in (0, 1))
    return columns, rows


_TOLD = ("kind", "metric", "along", "near", "far", "source")


def some_depth(depths: Sequence[DepthMap | None]) -> list[DepthMap | None] | None:
    """The depth maps of views, or None where no view has one."""
    return list(depths) if any(depth is not None for depth in depths) else None


def straightened(depth: DepthMap, lens: Lens) -> DepthMap:
    """The map of an upright photo's depth as it lies over the picture that `undistort` makes of it.

    The numbers are moved alone: z along the axis and the distance along the ray are of a point, not
    of the lens. Between pixels they are blended from those that are known; unknown is what lies
    nearer to an unknown one, or outside the photo.
    """
    if not lens.distorts:
        return depth
    height, width = depth.values.shape
    place = lens.source_pixels((width, height))
    outside = ~((place >= 0) & (place <= (lens.width, lens.height))).all(-1)
    columns, rows = _columns_rows(place * (width / lens.width, height / lens.height))

    def moved(numbers: Float32) -> Float32:
        return np.asarray(cv2.remap(np.ascontiguousarray(numbers), columns, rows,
                                    cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))

    known = np.isfinite(depth.values).astype(np.float32)
    weight = moved(known)
    values = moved(np.where(known > 0, depth.values, np.float32(0.0)))
    values = np.where((weight >= 0.5) & ~outside, values / np.maximum(weight, np.float32(1e-6)),
                      np.float32(np.nan))
    confidence = None
    if depth.confidence is not None:
        confidence = np.where(outside, np.float32(0.0), moved(depth.confidence))
    return replace(depth, values=np.asarray(values, np.float32), confidence=confidence)


def save_depth(folder: Path, name: str, depth: DepthMap) -> dict[str, Any]:
    """Write a map's arrays to ``folder/name`` (.npz); the entry for ``transforms.json``."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {"values": depth.values}
    if depth.confidence is not None:
        arrays["confidence"] = depth.confidence
    np.savez_compressed(path, **arrays)
    return {"file_path": name} | {key: getattr(depth, key) for key in _TOLD}


def load_depth(folder: Path, entry: Any) -> DepthMap | None:
    """The map of an entry that `save_depth` made; a damaged one is left out with a warning."""
    if entry is None:
        return None
    try:
        arrays = {name: np.asarray(values, np.float32)
                  for name, values in load_arrays(folder / entry["file_path"]).items()}
        return DepthMap(arrays["values"], confidence=arrays.get("confidence"),
                        **{key: entry[key] for key in _TOLD})
    except UNREADABLE_ARRAYS as error:
        warnings.warn(f"a depth map in {folder} can't be read and is left out: {error}",
                      stacklevel=2)
        return None
