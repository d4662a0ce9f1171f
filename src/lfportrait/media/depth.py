r"""Depth that phones keep in the pictures of their portrait mode, in HEIC and JPEG.

In HEIC, as iPhones keep it, depth is an auxiliary image of type ``urn:mpeg:hevc:2015:auxid:2``,
which pillow-heif lists. What its numbers mean stands in Apple's XMP, and in the "depth
representation information" of H.265 (annex F.14), which is all that other writers note. That has
four types:

- 0: 1/z from 1/far (0) to 1/near (the largest number);
- 1: disparity from ``d_min`` to ``d_max``, of no certain unit (iPhones: 1 / metres);
- 2: z from near to far;
- 3: disparity by a curve; only what is nearer is certain.

z lies along the optical axis, in a unit that the standard leaves open.

In JPEG it comes in three ways.

- GDepth keeps a grey picture in base64 in the XMP itself. What is longer than a segment of a JPEG,
  64 KiB, goes to extended XMP: segments APP1 ``http://ns.adobe.com/xmp/extension/\0`` with the MD5
  that ``xmpNote:HasExtendedXMP`` names in 32 letters, the length of the whole and the offset of
  this part (big-endian, 4 bytes each). (XMP specification, part 3, 1.1.3.)
- Dynamic Depth appends files to the JPEG. ``Container:Directory`` lists them in their order, the
  JPEG first, each with ``Length`` and ``Mime``; ``Padding`` bytes follow the JPEG. The map's
  ``DepthURI`` is the ``DataURI`` of a file; the later container calls it by its ``Semantic``.
- iPhones append JPEGs that the Multi-Picture Format lists (APP2 ``MPF\0``, a TIFF directory whose
  entry 0xB002 has 16 bytes a picture: kind, length, offset from the directory's header, two
  numbers of dependents; CIPA DC-007). Apple's XMP in one of them says that it is the depth.

What the numbers of a map mean, notes in XML (XMP) say, in three vocabularies, each known by the
address of its names:

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

import base64
import contextlib
import io
import math
import mmap
import os
import re
import struct
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np
from PIL import Image

from ..arrays import Array, Float32
from .kinds import END, jpeg_segments
from .pictures import one_line, open_picture

# How the stored pixels are brought upright, by EXIF's orientation; 1 leaves them.
_TO_UPRIGHT: dict[int, Callable[[Array], Array]] = {
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
    """

    values: Float32  # float32 [h, w], NaN = unknown; distances or inverse distances (``kind``).
    # ``"distance"`` (larger is farther) or ``"inverse"`` (larger is nearer, 0 = no end).
    kind: Literal["distance", "inverse"]
    # Whether ``values`` are in metres, or 1 / metres, by the camera's own word. Where not, their
    # scale is unknown, and with it, for inverse ones, perhaps their zero.
    metric: bool
    # ``"axis"``: the distance of the plane through the point that faces the camera, which is z in
    # the camera's frame; ``"ray"``: the distance of the point.
    along: Literal["axis", "ray"] = "axis"
    # near, far: The range that the file notes, as distances in the unit of ``values``; None where
    # it notes none, or no end.
    near: float | None = None
    far: float | None = None
    confidence: Float32 | None = None  # float32 [h, w] in [0, 1], 1 = sure, or None.
    # ``"heic"``, ``"gdepth"``, ``"dynamic depth"``, ``"apple jpeg"`` or ``"data set"``.
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

    def changed(self, change: Callable[[Array], Array]) -> DepthMap:
        """The map with its arrays moved alike: a turn, a flip or a cut."""
        return replace(self, values=np.ascontiguousarray(change(self.values)),
                       confidence=None if self.confidence is None
                       else np.ascontiguousarray(change(self.confidence)))

    def turned(self, turns: int) -> DepthMap:
        """The map after so many counter-clockwise quarter turns."""
        return self.changed(lambda array: np.rot90(array, turns)) if turns % 4 else self


def fitted(confidence: Float32 | None, shape: tuple[int, ...]) -> Float32 | None:
    """A confidence at the size of its depth map, float32 [h, w], by the nearest pixels."""
    if confidence is None or confidence.shape == shape:
        return confidence
    rows, columns = (np.arange(new) * old // new
                     for new, old in zip(shape, confidence.shape, strict=True))
    return np.ascontiguousarray(confidence[rows[:, None], columns])


def upright(depth: DepthMap, orientation: int, stored: tuple[int, int]) -> DepthMap:
    """A depth map brought upright with its picture.

    A map lies as the picture's stored pixels do (``stored``: their width and height), and is turned
    with them by EXIF's orientation, 1 to 8. One whose shape fits the upright picture alone was
    turned by the program that wrote it.
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

    XMP writes a value as an attribute or as an element of its own, which means the same. Raises
    `XmpError` where it is no XML, or declares entities, which XMP never does.
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

    Raises `XmpError` where the format is unknown or the range makes no sense.

    Parameters
    ----------
    shares, confidence : float32 [h, w] in [0, 1], the grey picture, and one of any size, or None.
    table : ``Format``, ``Near``, ``Far``, ``Units``, ``MeasureType``, where noted.
    source : For `DepthMap.source`.
    """
    linear = table.get("Format", "RangeInverse").lower()
    if linear not in ("rangelinear", "rangeinverse"):
        raise XmpError(f"the depth's format {table['Format']!r} is unknown")
    along: Literal["axis", "ray"] = (
        "ray" if table.get("MeasureType", "").lower() == "opticray" else "axis")
    kind: Literal["distance", "inverse"] = "distance" if linear == "rangelinear" else "inverse"
    sure = fitted(confidence, shares.shape)
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

    ``shares`` is the picture, float32 [h, w] in [0, 1], ``packet`` the XMP that belongs to it.
    Raises `XmpError` where the notes are damaged.
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
    # Of inverse distances the largest is the nearest; 0 is no end.
    near, far = range_ if kind == "distance" else (
        1.0 / end if end > 0 else None for end in range_[::-1])
    return DepthMap(_blend(steps, *range_), kind, "absolute" in accuracy, "axis",
                    near, far, None, source)


def _pixel_format(text: str) -> bytes:
    """The four letters of a pixel format that is written as a number, or as letters."""
    try:
        return int(text).to_bytes(4, "big")
    except (ValueError, OverflowError):
        return text.encode("ascii", "replace")


_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"}
_LARGEST = 1 << 26  # Pixels of a depth map beyond which it is none.
_SOURCE = "heic"
_ORIENTATION = 0x0112


def heic_depth(path: Path) -> DepthMap | None:
    """The depth of a HEIC picture, upright, or None where it has none.

    Raises whatever pillow-heif raises for a damaged file.
    """
    try:
        import pillow_heif
    except ImportError:  # the picture itself can't be read either
        return None
    file = pillow_heif.open_heif(path, convert_hdr_to_8bit=False)
    images = file.info.get("depth_images") or []
    if not images:
        return None
    image = images[0]
    if image.size[0] * image.size[1] > _LARGEST:
        raise ValueError(f"a depth map of {image.size[0]} x {image.size[1]} pixels")
    shares = _shares(image)
    depth = None
    for packet in packets(Path(path).read_bytes()):
        if APPLE.encode() in packet:
            depth = depth or apple_depth(shares, packet, _SOURCE)
    depth = depth or _by_standard(shares, image.info.get("metadata") or {})
    size = depth.values.shape[::-1]
    if same_ratio((size[0], size[1]), file.size) or not same_ratio(
            (size[0], size[1]), file.size[::-1]):
        return depth  # it was turned with the picture, by the same note
    exif = Image.Exif()
    exif.load(file.info.get("exif") or b"")
    orientation = int(exif.get(_ORIENTATION, 1))
    if orientation < 5:
        raise ValueError("it lies another way than its picture")
    return upright(depth, orientation, (size[0], size[1]))


def _shares(image: Any) -> Float32:
    """A grey picture's pixels as float32 [h, w] in [0, 1]."""
    numbers = np.asarray(image)
    if numbers.ndim == 3:
        numbers = numbers[..., 0]
    numbers = numbers[:image.size[1], :image.size[0]]
    white = np.float32(np.iinfo(numbers.dtype).max)  # more than 8 bits are stretched to 16
    return np.asarray(numbers / white, np.float32)


def _by_standard(shares: Float32, notes: dict[str, Any]) -> DepthMap:
    """The depth map by H.265's notes, or one that only says what is nearer."""
    kind = notes.get("representation_type")
    near, far, low, high = (_positive(notes.get(name))
                            for name in ("z_near", "z_far", "d_min", "d_max"))
    def depth(start: float, end: float, kind: Literal["distance", "inverse"],
              near: float | None, far: float | None) -> DepthMap:
        return DepthMap(_blend(shares, start, end), kind, False, "axis", near, far, None, _SOURCE)

    if kind == 0 and near and far:
        return depth(1.0 / far, 1.0 / near, "inverse", near, far)
    if kind == 2:
        start, end = (near, far) if near and far else (0.0, 1.0)
        return depth(start, end, "distance", near or None, far or None)
    if kind == 1 and high > low:
        return depth(low, high, "inverse", 1.0 / high, 1.0 / low if low else None)
    return DepthMap(shares, "inverse", False, "axis", None, None, None, _SOURCE)


def _positive(value: Any) -> float:
    """A number above 0 that is noted, else 0."""
    number = float(value or 0.0)
    return number if np.isfinite(number) and number > 0 else 0.0


_XMP, _MORE_XMP, _MPF = b"http://ns.adobe.com/xap/1.0/\0", \
    b"http://ns.adobe.com/xmp/extension/\0", b"MPF\0"
_NOTE = "http://ns.adobe.com/xmp/note/"
_APP1, _APP2 = 0xE1, 0xE2


def is_jpeg(start: bytes) -> bool:
    """Whether a file that starts so (3 bytes) is a JPEG."""
    return start[:3] == b"\xff\xd8\xff"


def jpeg_depth(path: Path) -> DepthMap | None:
    """The depth of a JPEG, upright, or None where it has none.

    Without depth no more than the segments before the first scan is read. Where depth is damaged,
    what Pillow, base64 and the parser of XML raise is raised.
    """
    with open(path, "rb") as stream, \
            mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        notes, more, pictures = _notes(data)
        found = (_embedded(notes, more) or _appended(notes, more, data)
                 or _second_picture(pictures, data))
    if found is None:
        return None
    with open_picture(path) as picture:
        return upright(found, int(picture.getexif().get(_ORIENTATION, 1)), picture.size)


def _segments(data: mmap.mmap, place: int = 0) -> Iterator[tuple[int, int, bytes]]:
    """The APP1 and APP2 segments of a JPEG at a place: number, offset and content of each."""
    for number, first, last, _ in jpeg_segments(data, place + 2, scans=False):
        if number in (_APP1, _APP2):
            yield number, first, data[first:last]


def _notes(data: mmap.mmap) -> tuple[list[bytes], dict[bytes, bytearray], list[tuple[int, int]]]:
    """The XMP of a JPEG, its extended XMP by the MD5 in letters, and its further pictures."""
    plain, more, pictures = [], dict[bytes, bytearray](), list[tuple[int, int]]()
    for number, place, content in _segments(data):
        if number == _APP1 and content.startswith(_XMP):
            plain.append(content[len(_XMP):])
        elif number == _APP1 and content.startswith(_MORE_XMP):
            _add(more, content[len(_MORE_XMP):])
        elif number == _APP2 and content.startswith(_MPF):
            pictures += _listed(content[len(_MPF):], place + len(_MPF))
    return plain, more, pictures


def _add(more: dict[bytes, bytearray], content: bytes) -> None:
    """Put one part of extended XMP in its place; parts follow each other in all known files."""
    if len(content) < 40:
        return
    name, whole = content[:32], more.setdefault(content[:32], bytearray())
    length, offset = struct.unpack(">II", content[32:40])
    if offset == len(whole) and offset + len(content) - 40 <= length:
        more[name] += content[40:]


def _google_tables(notes: list[bytes], more: dict[bytes, bytearray],
                   namespace: str) -> list[dict[str, str]]:
    """A vocabulary's values in the XMP and in what it is extended by."""
    every = [*notes, *(bytes(whole) for whole in more.values())]
    return [table for packet in every if namespace.encode() in packet
            for table in properties(packet, namespace)]


def _embedded(notes: list[bytes], more: dict[bytes, bytearray]) -> DepthMap | None:
    """GDepth's map, or None."""
    if not any(GOOGLE.encode() in packet for packet in notes):
        return None
    table: dict[str, str] = {}
    for one in _google_tables(notes, more, GOOGLE):
        table |= one
    if not table.get("Data"):
        # The notes of Google's later container give the range alone.
        if _google_tables(notes, more, _NOTE) and not _google_items(notes, more):
            raise XmpError("the extended XMP with the depth is missing or damaged")
        return None
    shares = _grey(base64.b64decode(table["Data"]))
    return android_depth(shares, _confidence(table.get("Confidence")), table, "gdepth")


def _confidence(text: str | None) -> Float32 | None:
    """A confidence in base64; a damaged one leaves the depth without."""
    try:
        return _grey(base64.b64decode(text)) if text else None
    except (OSError, ValueError, SyntaxError):
        return None


def _grey(data: bytes) -> Float32:
    """A grey JPEG or PNG as float32 [h, w] in [0, 1]; raises what Pillow raises."""
    with Image.open(io.BytesIO(data), formats=("JPEG", "PNG")) as picture:
        if picture.width * picture.height > _LARGEST:
            raise ValueError(f"a depth map of {picture.width} x {picture.height} pixels")
        deep = picture.mode.startswith("I")
        numbers = np.asarray(picture if deep else picture.convert("L"))
    return np.asarray(numbers / np.float32(65535 if deep else 255), np.float32)


def _google_items(notes: list[bytes], more: dict[bytes, bytearray]) -> list[dict[str, str]]:
    """The files that a container lists, the JPEG itself first."""
    for namespace in ITEMS:
        items = [item for item in _google_tables(notes, more, namespace) if "Mime" in item]
        if len(items) > 1:
            return items
    return []


def _appended(notes: list[bytes], more: dict[bytes, bytearray], data: mmap.mmap) -> DepthMap | None:
    """The map of Dynamic Depth, or of Google's later container; or None."""
    if not any(name.encode() in packet for packet in notes for name in ITEMS):
        return None
    items = _google_items(notes, more)
    maps = [table for table in _google_tables(notes, more, ANDROID)
            if table.get("ItemSemantic", "Depth").lower() == "depth" and table.get("DepthURI")]
    table = maps[0] if maps else {}
    wanted = _item(items, table.get("DepthURI"), {"depth", "depthmap", "depth_map"})
    if wanted is None:
        return None
    for namespace in () if maps else (GOOGLE, ANDROID):
        for one in _google_tables(notes, more, namespace):
            table |= one
    sure = _item(items, table.get("ConfidenceURI"), {"confidence", "confidencemap"})
    shares, start = _first_readable(data, items, wanted)
    confidence = None
    if sure is not None:
        place, length = _place(items, sure)
        with contextlib.suppress(OSError, ValueError, SyntaxError):  # the depth is there
            confidence = _grey(data[start + place:start + place + length])
    return android_depth(shares, confidence, table, "dynamic depth")


def _item(items: list[dict[str, str]], address: str | None, semantics: set[str]) -> int | None:
    """The number of the file with this address, else of the one with such a meaning; or None."""
    for number, item in enumerate(items):
        if number and address and item.get("DataURI") == address:
            return number
    for number, item in enumerate(items):
        if number and item.get("Semantic", "").lower() in semantics:
            return number
    return None


def _place(items: list[dict[str, str]], number: int) -> tuple[int, int]:
    """Offset of a file from the first that is appended, and its length."""
    sizes = [_count(item, "Length") for item in items]
    gaps = [_count(item, "Padding") for item in items]
    return sum(sizes[1:number]) + sum(gaps[1:number]), sizes[number]


def _count(item: dict[str, str], name: str) -> int:
    number = int(item.get(name) or 0)
    if number < 0:
        raise XmpError(f"a file of {number} bytes is appended")
    return number


def _first_readable(data: mmap.mmap, items: list[dict[str, str]], wanted: int,
                    ) -> tuple[Float32, int]:
    """The depth's grey picture, and where the files appended to the JPEG start, or end."""
    place, length = _place(items, wanted)
    every = sum(_place(items, len(items) - 1))
    end = next((end for marker, _, _, end in jpeg_segments(data) if marker == END), len(data))
    starts = [end + _count(items[0], "Padding"), len(data) - every]
    for start in starts:
        if start > 0 and start + place + length <= len(data):
            part = data[start + place:start + place + length]
            if part[:2] in (b"\xff\xd8", b"\x89P"):
                return _grey(part), start
    raise XmpError("the appended depth is cut off")


def _listed(content: bytes, place: int) -> list[tuple[int, int]]:
    """Offset and length of the pictures after the first that the Multi-Picture Format lists.

    A damaged list is an empty one: many JPEGs have it for previews, and no depth.
    """
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(content[:4])
    if order is None:
        return []
    try:
        start, = struct.unpack_from(f"{order}I", content, 4)
        count, = struct.unpack_from(f"{order}H", content, start)
        for number in range(count):
            tag, _, length, offset = struct.unpack_from(f"{order}HHII", content,
                                                        start + 2 + 12 * number)
            if tag == 0xB002:
                rows = [struct.unpack_from(f"{order}III", content, offset + 16 * row)
                        for row in range(1, length // 16)]
                return [(place + far, size) for _, size, far in rows if far]
    except struct.error:
        pass
    return []


def _second_picture(pictures: list[tuple[int, int]], data: mmap.mmap) -> DepthMap | None:
    """The depth among the pictures that an iPhone appended, or None."""
    for place, length in pictures:
        if not is_jpeg(data[place:place + 3]):
            continue
        packet = next((found for number, _, content in _segments(data, place)
                       if number == _APP1 and APPLE.encode() in content
                       for found in packets(content)), None)
        if packet is None:
            continue
        if apple_depth(np.zeros((1, 1), np.float32), packet, "") is None:
            continue  # a matte: not to be decoded
        return apple_depth(_grey(data[place:place + length]), packet, "apple jpeg")
    return None


def read_depth(path: str | os.PathLike[str]) -> DepthMap | None:
    """The depth of a picture, upright as `files.read_image` reads the picture; None without any.

    A file is known by its content, not by its name. The picture is not decoded; a JPEG without
    depth is read up to its first scan. Depth that is damaged is left out with a warning: the
    picture is worth more. A missing file has none.
    """
    path = Path(path)
    try:
        with open(path, "rb") as stream:
            start = stream.read(12)
        if is_jpeg(start):
            return jpeg_depth(path)
        return heic_depth(path) if start[4:8] == b"ftyp" and start[8:12] in _BRANDS else None
    except FileNotFoundError:
        return None
    except Exception as error:  # whatever a decoder raises, the picture may still be read
        warnings.warn(f"the depth in {path.name} can't be read and is left out: {one_line(error)}",
                      stacklevel=2)
        return None
