"""Which vector instructions kernels are compiled for, and half precision where there are none.

By default LLVM compiles for this very processor. ``LFPORTRAIT_VECTORS`` asks for less: ``avx2``
(most laptops) or ``sse2`` (every 64-bit processor of the x86 kind), for code that is to run
elsewhere and for tests. Numba keeps the code of each choice apart.

Older processors, and virtual machines that hide what theirs can, convert no half-precision numbers;
LLVM would call a function for it that nobody provides. There the conversions are made of whole
numbers, bit for bit the same.
"""

from __future__ import annotations

import os
from typing import Any

import llvmlite.binding
import numba
from llvmlite import ir

from ..errors import UserError
from .types import VF, VI, WIDTH

__all__ = ["SETTING", "features", "limit_vectors", "narrowed", "widened"]

SETTING = "LFPORTRAIT_VECTORS"
_LEVELS = {
    "avx2": ("haswell", ("sse2", "avx", "avx2", "f16c", "fma")),
    "sse2": ("x86-64", ("sse2",)),
}
"""LLVM's name of a processor that has no more, and what of its features is asked for here."""
_settings: Any = numba.config
_SHORT = ir.VectorType(ir.IntType(16), WIDTH)
_HALF = ir.VectorType(ir.HalfType(), WIDTH)


def _host() -> dict[str, bool]:
    try:
        return dict(llvmlite.binding.get_host_cpu_features())
    except RuntimeError:  # the features can't be read
        return {}


def _level() -> str | None:
    return os.environ.get(SETTING, "").strip().lower() or None


def features() -> dict[str, bool]:
    """LLVM's features that kernels are compiled for, by name."""
    level = _level()
    if level is None:
        return _host()
    return {name: name in _LEVELS[level][1] for name in {*_host(), *_LEVELS[level][1]}}


def limit_vectors() -> None:
    """Compile for the vector unit that `SETTING` names, if any.

    Raises
    ------
    UserError
        If it is no level, or one that this processor does not have.
    """
    level = _level()
    if level is None:
        return
    if level not in _LEVELS:
        raise UserError(f"{SETTING} is {level!r}; it may be {' or '.join(_LEVELS)}")
    name, needed = _LEVELS[level]
    if not all(_host().get(feature) for feature in needed):
        raise UserError(f"{SETTING} is {level!r}, which this processor does not have; unset it")
    _settings.CPU_NAME, _settings.CPU_FEATURES = name, ""


def _converts_halves() -> bool:
    """Whether the processor converts half precision: all do but for older ones of the x86 kind."""
    found = features()
    return bool(found.get("f16c")) or "sse2" not in found


def _constant(value: int) -> ir.Constant:
    return ir.Constant(VI, [value] * WIDTH)


def widened(builder: Any, words: Any) -> Any:
    """Sixteen float16 values, given as 16-bit words, as float lanes."""
    if _converts_halves():
        return builder.fpext(builder.bitcast(words, _HALF), VF)
    bits = builder.zext(words, VI)
    size = builder.shl(builder.and_(bits, _constant(0x7FFF)), _constant(13))
    # The exponent's bias goes from 15 to 127 by a multiplication, which is exact for small numbers,
    # too; infinity and NaN get the largest exponent.
    scaled = builder.bitcast(builder.fmul(
        builder.bitcast(size, VF), builder.bitcast(_constant(0x77800000), VF)), VI)
    endless = builder.icmp_unsigned(">=", size, _constant(0x0F800000))
    scaled = builder.select(endless, builder.or_(scaled, _constant(0x7F800000)), scaled)
    sign = builder.shl(builder.and_(bits, _constant(0x8000)), _constant(16))
    return builder.bitcast(builder.or_(scaled, sign), VF)


def narrowed(builder: Any, value: Any) -> Any:
    """Float lanes rounded to float16 (to even where two are equally near), as 16-bit words."""
    if _converts_halves():
        return builder.bitcast(builder.fptrunc(value, _HALF), _SHORT)
    bits = builder.bitcast(value, VI)
    size = builder.and_(bits, _constant(0x7FFFFFFF))
    sign = builder.lshr(builder.and_(bits, _constant(-(1 << 31))), _constant(16))
    # Usual numbers: half of the last place that stays is added, less one where that is even.
    odd = builder.and_(builder.lshr(size, _constant(13)), _constant(1))
    usual = builder.lshr(builder.add(builder.add(size, _constant(0xFFF - (112 << 23))), odd),
                         _constant(13))
    # Numbers below 2^-14: the addition of 0.5 leaves their last place at the end of the word.
    half = builder.bitcast(_constant(126 << 23), VF)
    small = builder.sub(builder.bitcast(builder.fadd(builder.bitcast(size, VF), half), VI),
                        _constant(126 << 23))
    found = builder.select(builder.icmp_unsigned("<", size, _constant(113 << 23)), small, usual)
    found = builder.select(builder.icmp_unsigned(">=", size, _constant(143 << 23)),
                           _constant(0x7C00), found)
    found = builder.select(builder.icmp_unsigned(">", size, _constant(0x7F800000)),
                           _constant(0x7E00), found)
    return builder.trunc(builder.or_(found, sign), _SHORT)
