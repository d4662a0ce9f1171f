"""Numbers rounded to half precision and back, sixteen at a time: NumPy takes them one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Float32
from ...simd.decorators import kernel
from ...simd.interleaved import store_half
from ...simd.threads import shared
from ...simd.vectors import LANES

__all__ = ["floats_of", "halves"]

_LINE = 1 << 14
"""Numbers that one thread takes at a time."""
_LARGEST = 6e4
"""What is larger becomes this: half precision ends at 65504."""

_load, _load_half, _store, _floats = LANES.load, LANES.load_half, LANES.store, LANES.floats
_minimum, _maximum = LANES.minimum, LANES.maximum


@shared("lines")
@kernel
def _round(since, until, lines, values, largest, out):
    """Lines of `_LINE` numbers of ``values``, as bits in ``out``; both hold multiples of 16."""
    for start in range(since * _LINE, min(until * _LINE, len(out)), 16):
        value = _maximum(_minimum(_load(values, np.uintp(start)), _floats(largest)),
                         _floats(-largest))
        store_half(out, np.uintp(start), value)


@shared("lines")
@kernel
def _widen(since, until, lines, bits, out):
    """Lines of `_LINE` numbers in half precision as float32; both hold multiples of 16."""
    for start in range(since * _LINE, min(until * _LINE, len(out)), 16):
        _store(out, np.uintp(start), _load_half(bits, np.uintp(start)))


def halves(values: NDArray[np.floating[Any]]) -> NDArray[np.float16]:
    """Numbers in half precision, as NumPy rounds them; those beyond 60000 become that.

    Parameters
    ----------
    values
        Of any shape, without NaN.
    """
    flat = np.ascontiguousarray(values, np.float32).reshape(-1)
    out, whole = np.empty(len(flat), np.uint16), len(flat) // 16 * 16
    _round(-(-whole // _LINE), flat[:whole], np.float32(_LARGEST), out[:whole])
    out[whole:] = np.clip(flat[whole:], -_LARGEST, _LARGEST).astype(np.float16).view(np.uint16)
    return out.view(np.float16).reshape(values.shape)


def floats_of(values: NDArray[np.float16]) -> Float32:
    """Numbers in half precision as float32."""
    bits = np.ascontiguousarray(values).reshape(-1).view(np.uint16)
    out, whole = np.empty(len(bits), np.float32), len(bits) // 16 * 16
    _widen(-(-whole // _LINE), bits[:whole], out[:whole])
    out[whole:] = bits[whole:].view(np.float16)
    return out.reshape(values.shape)
