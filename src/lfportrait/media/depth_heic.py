"""Depth in HEIC, as iPhones keep it in portraits.

It is an auxiliary image of type ``urn:mpeg:hevc:2015:auxid:2``, which pillow-heif lists. What its
numbers mean stands in Apple's XMP (`depth_xmp`), and in the "depth representation information" of
H.265 (annex F.14), which is all that other writers note. That has four types:

- 0: 1/z from 1/far (0) to 1/near (the largest number);
- 1: disparity from ``d_min`` to ``d_max``, of no certain unit (iPhones: 1 / metres);
- 2: z from near to far;
- 3: disparity by a curve; only what is nearer is certain.

z lies along the optical axis, in a unit that the standard leaves open.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .depth_map import DepthMap, same_ratio, upright
from .depth_xmp import APPLE, apple_depth, packets

__all__ = ["heic_depth", "is_heic"]

Floats = NDArray[np.float32]

_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"}
_LARGEST = 1 << 26
"""Pixels of a depth map beyond which it is none."""
_SOURCE = "heic"
_ORIENTATION = 0x0112


def is_heic(start: bytes) -> bool:
    """Whether a file that starts so (12 bytes) is a HEIC picture."""
    return start[4:8] == b"ftyp" and start[8:12] in _BRANDS


def heic_depth(path: Path) -> DepthMap | None:
    """The depth of a HEIC picture, upright, or None where it has none.

    Raises
    ------
    Exception
        Whatever pillow-heif raises for a damaged file.
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
    orientation = _orientation(file.info.get("exif"))
    if orientation < 5:
        raise ValueError("it lies another way than its picture")
    return upright(depth, orientation, (size[0], size[1]))


def _shares(image: Any) -> Floats:
    """A grey picture's pixels as float32 [h, w] in [0, 1]."""
    numbers = np.asarray(image)
    if numbers.ndim == 3:
        numbers = numbers[..., 0]
    numbers = numbers[:image.size[1], :image.size[0]]
    white = np.float32(np.iinfo(numbers.dtype).max)  # more than 8 bits are stretched to 16
    return np.asarray(numbers / white, np.float32)


def _orientation(exif: bytes | None) -> int:
    notes = Image.Exif()
    notes.load(exif or b"")
    return int(notes.get(_ORIENTATION, 1))


def _by_standard(shares: Floats, notes: dict[str, Any]) -> DepthMap:
    """The depth map by H.265's notes, or one that only says what is nearer."""
    kind = notes.get("representation_type")
    near, far, low, high = (_positive(notes.get(name))
                            for name in ("z_near", "z_far", "d_min", "d_max"))
    if kind == 0 and near and far:
        values = 1.0 / far + shares * (1.0 / near - 1.0 / far)
        return DepthMap(np.asarray(values, np.float32), "inverse", False, "axis", near, far,
                        None, _SOURCE)
    if kind == 2:
        start, end = (near, far) if near and far else (0.0, 1.0)
        values = start + shares * (end - start)
        return DepthMap(np.asarray(values, np.float32), "distance", False, "axis",
                        near or None, far or None, None, _SOURCE)
    if kind == 1 and high > low:
        return DepthMap(np.asarray(low + shares * (high - low), np.float32), "inverse", False,
                        "axis", 1.0 / high, 1.0 / low if low else None, None, _SOURCE)
    return DepthMap(shares, "inverse", False, "axis", None, None, None, _SOURCE)


def _positive(value: Any) -> float:
    """A number above 0 that is noted, else 0."""
    number = float(value or 0.0)
    return number if np.isfinite(number) and number > 0 else 0.0
