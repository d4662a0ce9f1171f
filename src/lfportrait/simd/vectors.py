"""Sixteen-lane SIMD values for Numba, with plain operators, and the same names for plain numbers.

Numba turns scalar Python into scalar machine code, and LLVM does not vectorise loops that gather.
The three types of `lfportrait.simd.processor` are LLVM vectors of 16 float32 (`F`), 16 int32
(`I`) and 16 booleans (`M`), so that a kernel reads like scalar Python and works on 16 rays, or 16
channels, at once::

    x = origin_x + t * direction_x              # F + F * F
    inside = (x >= 0.0) & (x < limit)           # M
    t = where(inside, t + step, t)              # a select instead of an `if`

LLVM maps 16 lanes to one AVX-512, two AVX2 or four NEON registers. Operands may be lanes of one
kind, or lanes and a number, which is then the same in every lane. Gathers have no bounds check and
read lane values as unsigned offsets from the array's first element.

`LANES` is a *namespace* of all of it, which a kernel's factory takes.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .decorators import identified, identified_all, lean
from .processor import (
    F32,
    I1,
    I16,
    I32,
    VECTOR,
    VF,
    VI,
    VM,
    WIDTH,
    F,
    I,
    Lanes,
    M,
    kind_of,
    lanes_of,
    widened,
)


def _call(builder, name: str, result: ir.Type, arguments: list[Any]):
    """Call an LLVM intrinsic by its name."""
    kind = ir.FunctionType(result, [a.type for a in arguments])
    function = cgutils.get_or_insert_function(builder.module, kind, name)
    return builder.call(function, arguments)


@intrinsic
def floats(typing, value):
    """A number, or lanes of int, as float lanes."""
    def code(context, builder, sig, args):
        if sig.args[0] is I:
            return builder.sitofp(args[0], VF)
        return lanes_of(context, builder, args[0], sig.args[0], F)
    return F(value), code


@intrinsic
def ints(typing, value):
    """A number, or lanes of float (rounded towards zero), as int lanes."""
    def code(context, builder, sig, args):
        if sig.args[0] is F:
            return builder.fptosi(args[0], VI)
        return lanes_of(context, builder, args[0], sig.args[0], I)
    return I(value), code


@intrinsic
def masks(typing, value):
    """A truth value in every lane."""
    def code(context, builder, sig, args):
        return lanes_of(context, builder, args[0], sig.args[0], M)
    return M(value), code


@intrinsic
def iota(typing):
    """0, 1, ... 15 as int lanes."""
    def code(context, builder, sig, args):
        return ir.Constant(VI, list(range(WIDTH)))
    return I(), code


@intrinsic
def where(typing, condition, yes, no):
    """``yes`` where the mask is set, else ``no``; one of them may be a number."""
    kind = kind_of((yes, no))
    if condition is not M or kind is None:
        return None

    def code(context, builder, sig, args):
        return builder.select(args[0], lanes_of(context, builder, args[1], sig.args[1], kind),
                              lanes_of(context, builder, args[2], sig.args[2], kind))
    return kind(condition, yes, no), code


def _elementwise(code_of: dict[Lanes, str], count: int):
    """An LLVM intrinsic applied lane by lane."""
    if count == 1:
        @intrinsic
        def function(typing, a):
            if a not in code_of:
                return None

            def code(context, builder, sig, args):
                return _call(builder, code_of[a], VECTOR[a], list(args))
            return a(a), code
    else:
        @intrinsic
        def function(typing, a, b):
            kind = kind_of((a, b))
            if kind not in code_of:
                return None

            def code(context, builder, sig, args):
                values = [lanes_of(context, builder, v, t, kind) for v, t in zip(args, sig.args)]
                return _call(builder, code_of[kind], VECTOR[kind], values)
            return kind(a, b), code
    return function


floor = _elementwise({F: "llvm.floor.v16f32"}, 1)
absolute = _elementwise({F: "llvm.fabs.v16f32"}, 1)
sqrt = _elementwise({F: "llvm.sqrt.v16f32"}, 1)
round_even = identified("lanes", "round even")(_elementwise({F: "llvm.roundeven.v16f32"}, 1))
minimum = _elementwise({F: "llvm.minnum.v16f32", I: "llvm.smin.v16i32"}, 2)
maximum = _elementwise({F: "llvm.maxnum.v16f32", I: "llvm.smax.v16i32"}, 2)


@identified("lanes", "from bits")
@intrinsic
def _from_bits(typing, value):
    def code(context, builder, sig, args):
        return builder.bitcast(args[0], VF)
    return F(I), code


@intrinsic
def fused(typing, a, b, c):
    """A b + c in one rounding."""
    def code(context, builder, sig, args):
        values = [lanes_of(context, builder, v, t, F) for v, t in zip(args, sig.args)]
        return _call(builder, "llvm.fma.v16f32", VF, values)
    return F(a, b, c), code


@lean
def exp(x):
    """E to the power x, relative error below 2e-7 for -87 < x < 88; 0 below, inf never."""
    x = minimum(maximum(x, np.float32(-87.0)), np.float32(88.0))
    whole = round_even(x * np.float32(1.4426950408889634))
    rest = fused(whole, np.float32(-0.693359375), x)
    rest = fused(whole, np.float32(2.12194440e-4), rest)
    series = fused(rest, np.float32(1.9875691500e-4), np.float32(1.3981999507e-3))
    series = fused(series, rest, np.float32(8.3334519073e-3))
    series = fused(series, rest, np.float32(4.1665795894e-2))
    series = fused(series, rest, np.float32(1.6666665459e-1))
    series = fused(series, rest, np.float32(5.0000001201e-1))
    series = fused(series, rest * rest, rest + np.float32(1.0))
    return series * _from_bits((ints(whole) + np.int32(127)) << np.int32(23))


@lean
def fading(y):
    """2 to the power -y, error below 3e-6, for y from 0 to 126; more is taken for 126.

    Light that passes is all that it is for: a polynomial of degree 4 is enough for that.
    """
    y = minimum(y, np.float32(126.0))
    whole = round_even(y)
    rest = whole - y
    series = fused(rest, np.float32(0.009681905), np.float32(0.055919694))
    series = fused(series, rest, np.float32(0.24022021))
    series = fused(series, rest, np.float32(0.69312153))
    series = fused(series, rest, np.float32(1.0))
    return series * _from_bits((np.int32(127) - ints(whole)) << np.int32(23))


def _pointer(context, builder, array_type, array):
    """Address of an array's first element."""
    return context.make_array(array_type)(context, builder, array).data


def _addresses(builder, base, offsets, element: ir.Type):
    """base[offset] for every lane, offsets unsigned."""
    wide = builder.zext(offsets, ir.VectorType(ir.IntType(64), WIDTH))
    base = builder.bitcast(base, ir.PointerType())
    pointers = ir.VectorType(ir.PointerType(), WIDTH)
    instruction = ir.instructions.GEPInstr(builder.block, base, [wide], inbounds=False, name="",
                                           source_etype=element)
    instruction.type = pointers
    builder._insert(instruction)
    return instruction


def _gather(builder, base, offsets, element: ir.Type, loaded: ir.Type, align: int):
    vector = ir.VectorType(loaded, WIDTH)
    name = f"llvm.masked.gather.v16{'f32' if loaded == F32 else 'i32'}.v16p0"
    return _call(builder, name, vector, [
        _addresses(builder, base, offsets, element), ir.Constant(I32, align),
        ir.Constant(VM, [1] * WIDTH), ir.Constant(vector, ir.Undefined)])


@intrinsic
def gather(typing, array, index):
    """array[index] lane by lane; the array is C-contiguous int32 or float32, the index flat."""
    if not isinstance(array, types.Array) or index is not I:
        return None
    kind = {types.int32: I, types.float32: F}.get(array.dtype)
    if kind is None:
        return None

    def code(context, builder, sig, args):
        element = F32 if kind is F else I32
        return _gather(builder, _pointer(context, builder, sig.args[0], args[0]), args[1],
                       element, element, 4)
    return kind(array, index), code


@intrinsic
def gather_pair(typing, array, index):
    """The float16 values array[index] and array[index + 1] lane by lane, as two float lanes.

    The array is C-contiguous uint16 (Numba has no float16 on the CPU).
    """
    if not isinstance(array, types.Array) or array.dtype != types.uint16 or index is not I:
        return None
    pair = types.UniTuple(F, 2)

    def code(context, builder, sig, args):
        words = _gather(builder, _pointer(context, builder, sig.args[0], args[0]), args[1], I16,
                        I32, 2)
        short = ir.VectorType(I16, WIDTH)
        sixteen = ir.Constant(VI, [16] * WIDTH)
        low = widened(builder, builder.trunc(words, short))
        high = widened(builder, builder.trunc(builder.lshr(words, sixteen), short))
        return context.make_tuple(builder, pair, [low, high])
    return pair(array, index), code


def _load(half: bool):
    @intrinsic
    def function(typing, array, start):
        wanted = types.uint16 if half else types.float32
        if not isinstance(array, types.Array) or array.dtype != wanted:
            return None

        def code(context, builder, sig, args):
            base = _pointer(context, builder, sig.args[0], args[0])
            index = context.cast(builder, args[1], sig.args[1], types.uintp)
            address = builder.gep(base, [index])
            if not half:
                return builder.load(builder.bitcast(address, ir.PointerType()), align=4, typ=VF)
            words = builder.load(builder.bitcast(address, ir.PointerType()), align=2,
                                 typ=ir.VectorType(I16, WIDTH))
            return widened(builder, words)
        return F(array, start), code
    return function


load = _load(half=False)
load_half = _load(half=True)


@intrinsic
def store(typing, array, start, value):
    """array[start : start + 16] = value, for a C-contiguous float32 or int32 array."""
    if not isinstance(array, types.Array) or not isinstance(value, Lanes):
        return None

    def code(context, builder, sig, args):
        base = _pointer(context, builder, sig.args[0], args[0])
        index = context.cast(builder, args[1], sig.args[1], types.uintp)
        address = builder.bitcast(builder.gep(base, [index]), args[2].type.as_pointer())
        builder.store(args[2], address, align=4)
        return context.get_dummy_value()
    return types.none(array, start, value), code


@intrinsic
def bits(typing, mask):
    """The mask as an integer, lane i in bit i."""
    def code(context, builder, sig, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(WIDTH)), ir.IntType(32))
    return types.uint32(M), code


@intrinsic
def lowest(typing, word):
    """Number of the lowest bit that is set; undefined for 0."""
    def code(context, builder, sig, args):
        return _call(builder, "llvm.cttz.i32", I32, [args[0], ir.Constant(I1, 1)])
    return types.uint32(types.uint32), code


@intrinsic
def lane(typing, value, index):
    """The value of one lane as a number."""
    scalar = {F: types.float32, I: types.int32}.get(value)
    if scalar is None:
        return None

    def code(context, builder, sig, args):
        position = context.cast(builder, args[1], sig.args[1], types.int32)
        return builder.extract_element(args[0], position)
    return scalar(value, index), code


@intrinsic
def total(typing, value):
    """Sum over the lanes of float lanes, in a fixed order (halves added pairwise)."""
    def code(context, builder, sig, args):
        kind = ir.FunctionType(F32, [F32, VF])
        function = cgutils.get_or_insert_function(builder.module, kind,
                                                  "llvm.vector.reduce.fadd.v16f32")
        return builder.call(function, [ir.Constant(F32, 0.0), args[0]], fastmath=("reassoc",))
    return types.float32(F), code


LANES = SimpleNamespace(
    width=WIDTH, jit=lean, floats=floats, ints=ints, masks=masks, iota=iota,
    where=where, floor=floor, absolute=absolute, sqrt=sqrt, minimum=minimum, maximum=maximum,
    exp=exp, fading=fading, gather=gather, gather3=gather, gather_pair=gather_pair,
    load=load, load_half=load_half, store=store, bits=bits, lowest=lowest, lane=lane, total=total,
    fused=fused)
identified_all("lanes", LANES.width, LANES)
