"""More operations on lanes: half precision, extremes, columns, and short rows read at random."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .cache_keys import identified
from .decorators import lean
from .processor import features, narrowed, widened
from .types import WIDTH, F, I
from .vectors import gather_pair

__all__ = ["largest", "make_look_up", "make_restrict", "make_store_columns", "smallest",
           "store_half"]

_VF = ir.VectorType(ir.FloatType(), WIDTH)
_VI = ir.VectorType(ir.IntType(32), WIDTH)


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any, index_type: Any,
             vector: ir.Type) -> Any:
    base = context.make_array(array_type)(context, builder, array).data
    place = context.cast(builder, index, index_type, types.uintp)
    return builder.bitcast(builder.gep(base, [place]), vector.as_pointer())


@identified("lanes", "store half")
@intrinsic
def store_half(typing, array, start, value):  # type: ignore[no-untyped-def]
    """array[start : start + 16] = value rounded to float16, for a C-contiguous uint16 array."""
    if not isinstance(array, types.Array) or array.dtype != types.uint16 or value is not F:
        return None

    def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
        address = _address(context, builder, sig.args[0], args[0], args[1], sig.args[1],
                           ir.VectorType(ir.IntType(16), WIDTH))
        builder.store(narrowed(builder, args[2]), address, align=2)
        return context.get_dummy_value()
    return types.none(array, start, value), code


def _has_permutes() -> bool:
    """Whether this processor picks 16-bit values from two registers in one step (AVX-512 BW)."""
    return bool(features().get("avx512bw"))


def make_look_up(permutes: bool | None = None) -> Callable[..., Any]:
    """Neighbouring values of a short stretch of a row, as linear interpolation wants them.

    Parameters
    ----------
    permutes
        Whether to pick values in registers (AVX-512 BW) or gather them; what the processor can by
        default.

    Returns
    -------
    look_up
        ``look_up(array, start, index)``: the float16 values array[start + index] and
        array[start + index + 1] lane by lane, as two float lanes. The array is C-contiguous uint16
        and holds 64 values from ``start`` on; int lanes ``index`` lie in 0..62.
    """
    if not (_has_permutes() if permutes is None else permutes):
        @identified("look up", False)
        @lean
        def gathered(array, start, index):  # type: ignore[no-untyped-def]
            return gather_pair(array, index + np.int32(start))
        return gathered
    pair = types.UniTuple(F, 2)
    short = ir.VectorType(ir.IntType(16), WIDTH)
    table = ir.VectorType(ir.IntType(16), 2 * WIDTH)

    @identified("look up", True)
    @intrinsic
    def look_up(typing, array, start, index):  # type: ignore[no-untyped-def]
        if not isinstance(array, types.Array) or array.dtype != types.uint16 or index is not I:
            return None

        def halves(context, builder, pair_of_lanes):  # type: ignore[no-untyped-def]
            values = []
            for half in range(2):
                order = ir.Constant(_VI, list(range(WIDTH * half, WIDTH * (half + 1))))
                part = builder.shuffle_vector(
                    pair_of_lanes, ir.Constant(table, ir.Undefined), order)
                values.append(widened(builder, part))
            return context.make_tuple(builder, pair, values)

        def permute(context, builder, sig, args):  # type: ignore[no-untyped-def]
            parts = []
            for offset in (0, 2 * WIDTH):
                place = builder.add(context.cast(builder, args[1], sig.args[1], types.uintp),
                                    ir.Constant(ir.IntType(64), offset))
                address = _address(context, builder, sig.args[0], args[0], place, types.uintp,
                                   table)
                parts.append(builder.load(address, align=2))
            low = builder.trunc(args[2], short)
            high = builder.add(low, ir.Constant(short, [1] * WIDTH))
            order = ir.Constant(ir.VectorType(ir.IntType(32), 2 * WIDTH), list(range(2 * WIDTH)))
            both = builder.shuffle_vector(low, high, order)
            pick = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(table, [table] * 3),
                "llvm.x86.avx512.vpermi2var.hi.512")
            return halves(context, builder, builder.call(pick, [parts[0], both, parts[1]]))

        return pair(array, start, index), permute
    return look_up


def make_store_columns(count: int) -> Callable[..., Any]:
    """Sixteen vectors of 16 float16 values as columns of a table.

    Parameters
    ----------
    count
        Number of rows that are kept of the 16.

    Returns
    -------
    store_columns
        ``store_columns(target, start, pitch, source)``: target[start + pitch * row + column] =
        source[16 * column + row] for each column and row < ``count``; both are C-contiguous uint16.
    """
    @identified("store columns", count)
    @intrinsic
    def store_columns(typing, target, start, pitch, source):  # type: ignore[no-untyped-def]
        for array in (target, source):
            if not isinstance(array, types.Array) or array.dtype != types.uint16:
                return None

        def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
            vector = ir.VectorType(ir.IntType(16), WIDTH)
            columns = []
            for column in range(WIDTH):
                address = _address(context, builder, sig.args[3], args[3],
                                   ir.Constant(ir.IntType(64), WIDTH * column), types.uintp, vector)
                columns.append(builder.load(address, align=2))
            # Four rounds: interleaving the first half with the second turns rows to columns.
            half = WIDTH // 2
            for _ in range(4):
                mixed = []
                for i in range(half):
                    for first in (0, half):
                        order = [first + j // 2 + WIDTH * (j % 2) for j in range(WIDTH)]
                        mixed.append(builder.shuffle_vector(
                            columns[i], columns[i + half], ir.Constant(_VI, order)))
                columns = mixed
            start = context.cast(builder, args[1], sig.args[1], types.uintp)
            pitch = context.cast(builder, args[2], sig.args[2], types.uintp)
            for row in range(count):
                place = builder.add(start, builder.mul(pitch, ir.Constant(pitch.type, row)))
                address = _address(context, builder, sig.args[0], args[0], place, types.uintp,
                                   vector)
                builder.store(columns[row], address, align=2)
            return context.get_dummy_value()
        return types.none(target, start, pitch, source), code
    return store_columns


def _extreme(less: str) -> Callable[..., Any]:
    @intrinsic
    def function(typing, value):  # type: ignore[no-untyped-def]
        if value is not F:
            return None

        def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
            # Four halvings; LLVM's own reduction minds NaN and goes lane by lane.
            value = args[0]
            for distance in (8, 4, 2, 1):
                order = ir.Constant(_VI, [(lane + distance) % WIDTH for lane in range(WIDTH)])
                other = builder.shuffle_vector(value, value, order)
                value = builder.select(builder.fcmp_ordered(less, value, other), value, other)
            return builder.extract_element(value, ir.Constant(ir.IntType(32), 0))
        return types.float32(F), code
    return function


smallest = identified("lanes", "smallest")(_extreme("<"))
"""The least of float lanes, none of them NaN, as a number."""
largest = identified("lanes", "largest")(_extreme(">"))
"""The greatest of float lanes, none of them NaN, as a number."""


@functools.cache
def make_restrict(count: int) -> Callable[..., Any]:
    """Coefficients of each channel through a matrix, all channels at once.

    Parameters
    ----------
    count
        Coefficients a channel in a row: the row is [3, count], zero-padded to 16 or 32 values.

    Returns
    -------
    restrict
        ``restrict(first, rest, matrix)``: lanes of a row's first and next 16 values (the same
        lanes twice for rows of 16); ``matrix`` float32 [count * 16], for each of the row's
        coefficients its weight in the results [3, 4], lane
        ``4 * channel + term``; the last four lanes do not count.
    """
    @identified("restrict", count)
    @intrinsic
    def restrict(typing, first, rest, matrix):  # type: ignore[no-untyped-def]
        if first is not F or rest is not F or not isinstance(matrix, types.Array):
            return None

        def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
            fma = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(_VF, [_VF] * 3), "llvm.fma.v16f32")
            result = ir.Constant(_VF, [0.0] * WIDTH)
            for part in range(count):
                # Lane 4 * channel + term takes the row's value count * channel + part.
                chosen = [min(lane // 4, 2) * count + part for lane in range(WIDTH)]
                order = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), chosen)
                values = builder.shuffle_vector(args[0], args[1], order)
                place = ir.Constant(ir.IntType(64), WIDTH * part)
                address = _address(context, builder, sig.args[2], args[2], place, types.uintp,
                                   _VF)
                weights = builder.load(address, align=4)
                result = builder.call(fma, [values, weights, result])
            return result
        return F(first, rest, matrix), code
    return restrict
