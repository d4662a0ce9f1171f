"""A depth map that a camera kept beside its picture, and what notes in XML (XMP) say of it.

Three vocabularies, each known by the address of its names:

- Google's GDepth, ``http://ns.google.com/photos/1.0/depthmap/``, and Android's Dynamic Depth 1.0,
  ``http://ns.google.com/photos/dd/1.0/depthmap/``, scale a grey picture v in [0, 1] from ``Near``
  to ``Far``: ``RangeLinear`` d = near + v (far - near), ``RangeInverse`` 1/d = 1/near +
  v (1/far - 1/near); black is near. ``MeasureType`` is ``OpticalAxis``, the default, or
  ``OpticRay``. ``Units``: ``m``, ``mm``, or Dynamic Depth's ``Meters``, ``Diopters``, ``None``.
  Google's reference gives metres as GDepth's default, but the cameras that leave it out (Lens Blur)
  knew no scale; so metres must be noted. A confidence is linear in [0, 1].
  (developers.google.com/depthmap-metadata/reference and /encoding; "Dynamic Depth 1.0", 2019-03-20,
  developer.android.com.)
- Apple's ``http://ns.apple.com/pixeldatainfo/1.0/``: whole numbers from ``IntMinValue`` to
  ``IntMaxValue`` stand for ``FloatMinValue`` to ``FloatMaxValue``; ``NativeFormat`` is a pixel
  format of Core Video as a number: 'hdis', 'fdis' are disparity in 1 / metres, 'hdep', 'fdep' depth
  in metres along the axis. Mattes, which have no such format, are no depth. ``Accuracy`` in
  ``http://ns.apple.com/depthData/1.0/`` is ``absolute``, or ``relative`` where two cameras alone
  measured: right about what is nearer, not about metres. (AVDepthData, "Creating Auxiliary Depth
  Data Manually", developer.apple.com.)
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ..arrays import Float32

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
    values : float32 [h, w], NaN = unknown; distances or inverse distances (``kind``).
    kind : ``"distance"`` (larger is farther) or ``"inverse"`` (larger is nearer, 0 = no end).
    metric : Whether ``values`` are in metres, or 1 / metres, by the camera's own word. Where not,
        their scale is unknown, and with it, for inverse ones, perhaps their zero.
    along : ``"axis"``: the distance of the plane through the point that faces the camera, which is
        z in the camera's frame; ``"ray"``: the distance of the point.
    near, far : The range that the file notes, as distances in the unit of ``values``; None where it
        notes none, or no end.
    confidence : float32 [h, w] in [0, 1], 1 = sure, or None.
    source : ``"heic"``, ``"gdepth"``, ``"dynamic depth"``, ``"apple jpeg"`` or ``"data set"``.
    """

    values: Float32
    kind: Literal["distance", "inverse"]
    metric: bool
    along: Literal["axis", "ray"] = "axis"
    near: float | None = None
    far: float | None = None
    confidence: Float32 | None = None
    source: str = ""

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or not self.values.size:
            raise ValueError(f"a depth map has two axes, not the shape {self.values.shape}")
        if self.confidence is not None and self.confidence.shape != self.values.shape:
            raise ValueError(f"a confidence of {self.confidence.shape} for a depth map of "
                             f"{self.values.shape}")

    def distance(self) -> tuple[Float32, bool]:
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


def fitted(confidence: Float32 | None, shape: tuple[int, int]) -> Float32 | None:
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
    orientation : As EXIF notes it for the picture, 1 to 8; others leave the map.
    stored : Width and height of the picture's stored pixels.
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


GOOGLE = "http://ns.google.com/photos/1.0/depthmap/"
ANDROID = "http://ns.google.com/photos/dd/1.0/depthmap/"
APPLE = "http://ns.apple.com/pixeldatainfo/1.0/"
ITEMS = ("http://ns.google.com/photos/dd/1.0/item/",
         "http://ns.google.com/photos/1.0/container/item/")
"""The files that follow a JPEG: of Dynamic Depth, and of Google's later container."""
_APPLE_DEPTH = "http://ns.apple.com/depthData/1.0/"
_METRES = {"m": 1.0, "meters": 1.0, "metres": 1.0, "cm": 0.01, "mm": 0.001}
_APPLE_KINDS: dict[bytes, Literal["distance", "inverse"]] = {
    b"hdis": "inverse", b"fdis": "inverse", b"hdep": "distance", b"fdep": "distance"}


class XmpError(ValueError):
    """Notes that can't be read, or that contradict themselves."""


def packets(data: bytes) -> list[bytes]:
    """The XMP packets that lie in a file's bytes, wherever its format keeps them."""
    return re.findall(rb"<x:xmpmeta.*?</x:xmpmeta>", data, re.DOTALL)


def properties(packet: bytes, namespace: str) -> list[dict[str, str]]:
    """The values of a vocabulary's names in a packet: a table for each thing that has any.

    XMP writes a value as an attribute or as an element of its own, which means the same.

    Raises
    ------
    XmpError
        If it is no XML, or declares entities, which XMP never does.
    """
    if b"<!" in packet.replace(b"<!--", b""):
        raise XmpError("the XMP declares entities")
    try:
        root = ElementTree.fromstring(packet.strip(b"\0 \r\n\t"))
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise XmpError(f"the XMP is damaged: {error}") from error
    mark = f"{{{namespace}}}"
    found = []
    for element in root.iter():
        table = {name[len(mark):]: value.strip() for name, value in element.attrib.items()
                 if name.startswith(mark)}
        table |= {child.tag[len(mark):]: (child.text or "").strip() for child in element
                  if isinstance(child.tag, str) and child.tag.startswith(mark) and not len(child)}
        if table:
            found.append(table)
    return found


def _number(table: dict[str, str], name: str) -> float | None:
    """A positive number, inf included; None where there is none."""
    try:
        number = float(table[name])
    except (KeyError, ValueError):
        return None
    return number if number > 0 else None


def _blend(shares: Float32, first: float, last: float) -> Float32:
    return np.asarray(first + shares * (last - first), np.float32)


def android_depth(shares: Float32, confidence: Float32 | None, table: dict[str, str],
                  source: str) -> DepthMap:
    """The depth map of a grey picture by GDepth's or Dynamic Depth's notes.

    Parameters
    ----------
    shares : float32 [h, w] in [0, 1], the grey picture.
    confidence : float32 [., .] in [0, 1], or None.
    table : ``Format``, ``Near``, ``Far``, ``Units``, ``MeasureType``, where noted.
    source : For `DepthMap.source`.

    Raises
    ------
    XmpError
        If the format is unknown or the range makes no sense.
    """
    linear = table.get("Format", "RangeInverse").lower()
    if linear not in ("rangelinear", "rangeinverse"):
        raise XmpError(f"the depth's format {table['Format']!r} is unknown")
    along: Literal["axis", "ray"] = (
        "ray" if table.get("MeasureType", "").lower() == "opticray" else "axis")
    kind: Literal["distance", "inverse"] = "distance" if linear == "rangelinear" else "inverse"
    sure = fitted(confidence, (shares.shape[0], shares.shape[1]))
    near, far = _number(table, "Near"), _number(table, "Far")
    if near is None or far is None:
        # What is nearer is still known.
        values = shares if kind == "distance" else np.asarray(1.0 - shares, np.float32)
        return DepthMap(values, kind, False, along, None, None, sure, source)
    if not math.isfinite(near) or (kind == "distance" and not math.isfinite(far)):
        raise XmpError(f"the depth's range from {near:g} to {far:g} makes no sense")
    units = table.get("Units", "").lower()
    metres = _METRES.get(units, 1.0)
    near, far = near * metres, far * metres
    values = (_blend(shares, near, far) if kind == "distance"
              else _blend(shares, 1.0 / near, 1.0 / far))
    if units == "diopters":
        # The range is of inverse distances: what is linear in one is inverse in the other.
        kind = "inverse" if kind == "distance" else "distance"
        near, far = 1.0 / near, 1.0 / far
    return DepthMap(values, kind, units in _METRES or units == "diopters", along, near,
                    far if math.isfinite(far) else None, sure, source)


def apple_depth(shares: Float32, packet: bytes, source: str) -> DepthMap | None:
    """The depth map of a grey picture by Apple's notes, or None where they are of another thing.

    Parameters
    ----------
    shares : float32 [h, w] in [0, 1], the grey picture.
    packet : The XMP packet that belongs to it.
    source : For `DepthMap.source`.

    Raises
    ------
    XmpError
        If the notes are damaged.
    """
    table = {name: value for one in properties(packet, APPLE) for name, value in one.items()}
    kind = _APPLE_KINDS.get(_pixel_format(table.get("NativeFormat", "")))
    if kind is None:
        return None
    try:
        codes = float(table["IntMinValue"]), float(table["IntMaxValue"])
        range_ = float(table["FloatMinValue"]), float(table["FloatMaxValue"])
    except (KeyError, ValueError) as error:
        raise XmpError(f"the depth's range is not noted: {error}") from error
    if not (np.isfinite((*codes, *range_)).all() and codes[1] > codes[0]
            and range_[1] >= range_[0]):
        raise XmpError("the depth's range makes no sense")
    # White is the largest number of so many bits: 8, or more where the numbers need them.
    white = 2 ** max(8, int(codes[1]).bit_length()) - 1
    steps = (shares * white - codes[0]) / (codes[1] - codes[0])
    accuracy = {one.get("Accuracy", "").lower() for one in properties(packet, _APPLE_DEPTH)}
    low, high = range_ if kind == "distance" else _inverse(range_)
    return DepthMap(_blend(steps, *range_), kind, "absolute" in accuracy, "axis",
                    low, high, None, source)


def _inverse(range_: tuple[float, float]) -> tuple[float | None, float | None]:
    """Nearest and farthest distance of a range of inverse distances; None = no end."""
    low, high = range_
    return (1.0 / high if high > 0 else None), (1.0 / low if low > 0 else None)


def _pixel_format(text: str) -> bytes:
    """The four letters of a pixel format that is written as a number, or as letters."""
    try:
        return int(text).to_bytes(4, "big")
    except (ValueError, OverflowError):
        return text.encode("ascii", "replace")
