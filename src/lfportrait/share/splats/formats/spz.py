"""SPZ, version 3 (Niantic): numbers in few bits, one attribute after the other, deflated."""

from __future__ import annotations

import gzip
import struct
from typing import BinaryIO

import numpy as np

from ....errors import UserError
from ..cloud import Splats
from .numbers import smallest_three, to_bytes

__all__ = ["write_spz"]

COLOR = 0.15
"""Coefficients of degree 0 are multiplied by this, as colors beyond black and white occur."""
BITS = 18
"""Binary places of positions, at most: 4 millionths of a world unit."""
HALF_TURN = 511 * np.sqrt(2)
"""What a component of a quaternion is multiplied with: nine bits and a sign."""
STEPS = (2, 4)
"""Steps of the coefficients of degree 1, and of those above, in 128ths: finer than usual."""


def write_spz(stream: BinaryIO, splats: Splats) -> None:
    """Write splats.

    Raises
    ------
    UserError
        If they lie too far away for its numbers.
    """
    reach = float(np.abs(splats.positions).max())
    bits = min(BITS, int(np.floor(np.log2((2 ** 23 - 1) / max(reach, 1e-9)))))
    if bits < 0:
        raise UserError("an .spz file can't hold coordinates beyond 8 million; leave --world at "
                        "portrait")
    fixed = np.rint(splats.positions.astype(np.float64) * 2.0 ** bits).astype("<i4")
    parts = [struct.pack("<4sIIBBBB", b"NGSP", 3, len(splats), splats.degree, bits, 0, 0),
             np.ascontiguousarray(fixed[:, :, None].view(np.uint8)[:, :, :3]).tobytes(),
             to_bytes(255 * splats.opacity).tobytes(),
             to_bytes(255 * (COLOR * splats.sh[:, :, 0] + 0.5)).tobytes(),
             to_bytes(16 * (np.log(splats.scales) + 10)).tobytes(),
             _turns(splats).tobytes()]
    if splats.degree:
        step = np.full(splats.sh.shape[2] - 1, STEPS[1])
        step[:3] = STEPS[0]
        # Coefficient by coefficient, red, green and blue side by side; 128 is nothing.
        rest = np.rint(np.moveaxis(splats.sh[:, :, 1:], 2, 1) * 128 / step[:, None])
        parts.append(to_bytes(rest * step[:, None] + 128).tobytes())
    with gzip.GzipFile(fileobj=stream, mode="wb", filename="", mtime=0) as packed:
        for part in parts:
            packed.write(part)


def _turns(splats: Splats) -> np.ndarray:
    """Quaternions as uint32: which component is left out (of x, y, z, w), then three others."""
    largest, others = smallest_three(np.roll(splats.turns, -1, axis=1))
    size = np.minimum(np.rint(np.abs(others) * HALF_TURN), 511).astype("<u4")
    word = largest.astype("<u4")
    for axis in range(3):
        word = word << 10 | (others[:, axis] < 0).astype("<u4") << 9 | size[:, axis]
    return word.astype("<u4")
