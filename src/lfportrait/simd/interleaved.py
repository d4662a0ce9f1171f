"""Loads and stores of interleaved values, short rows read at random, half precision, and extremes.

Pictures hold pairs (a place's x and y, weights, label words) and colors side by side. Sixteen
pixels of a row are read as whole vectors and sorted into lanes: a gather would cost several times
as much.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .decorators import identified, lean, woven
from .processor import WIDTH, F, I, features, narrowed, widened
from .vectors import LANES, gather_pair

_load, _iota, _minimum = LANES.load, LANES.iota, LANES.minimum

_I32, _I64 = ir.IntType(32), ir.IntType(64)
_EVEN, _ODD = (ir.Constant(ir.VectorType(_I32, 16), list(range(n, 32, 2))) for n in (0, 1))
for _kind in (_I64, ir.VectorType(_I64, 16), ir.VectorType(_I32, 32),
              ir.VectorType(ir.IntType(8), 16)):
    # llvmlite keeps a type's text from its first use on, which would change what Numba hashes.
    str(_kind)


def _kinds(array):
    """Lanes and LLVM element of an array of float32 or int32; None for others."""
    if not isinstance(array, types.Array):
        return None
    return {types.float32: (F, ir.FloatType()), types.int32: (I, _I32)}.get(array.dtype)


def _address(context, builder, sig, args):
    """Address of array[start], the first two arguments."""
    base = context.make_array(sig.args[0])(context, builder, args[0]).data
    index = context.cast(builder, args[1], sig.args[1], types.uintp)
    return builder.bitcast(builder.gep(base, [index]), ir.PointerType())


def _split(context, builder, result, words):
    """Even and odd elements of a vector of 32 as a tuple of lanes."""
    return context.make_tuple(builder, result, [
        builder.shuffle_vector(words, words, order) for order in (_EVEN, _ODD)])


@identified("example lanes", "load ints")
@intrinsic
def load_ints(typing, array, start):
    """array[start : start + 16] of an int32 array."""
    if not isinstance(array, types.Array) or array.dtype != types.int32:
        return None

    def code(context, builder, sig, args):
        return builder.load(_address(context, builder, sig, args), align=4,
                            typ=ir.VectorType(_I32, 16))
    return I(array, start), code


@identified("example lanes", "load pairs")
@intrinsic
def load_pairs(typing, array, start):
    """The elements start, start + 2, .. and start + 1, start + 3, .. of a C-contiguous array."""
    kinds = _kinds(array)
    if kinds is None:
        return None
    result = types.UniTuple(kinds[0], 2)

    def code(context, builder, sig, args):
        words = builder.load(_address(context, builder, sig, args), align=4,
                             typ=ir.VectorType(kinds[1], 32))
        return _split(context, builder, result, words)
    return result(array, start), code


def _gathered(context, builder, sig, args, element, name, pitch=None):
    """Elements of an array at signed 32-bit offsets, which count elements of type ``pitch``."""
    base = context.make_array(sig.args[0])(context, builder, args[0]).data
    # Sign extension folds into the instruction, zero extension takes two of them.
    wide = builder.sext(args[1], ir.VectorType(_I64, 16))
    pointers = ir.instructions.GEPInstr(builder.block, builder.bitcast(base, ir.PointerType()),
                                        [wide], inbounds=False, name="",
                                        source_etype=pitch or element)
    pointers.type = ir.VectorType(ir.PointerType(), 16)
    builder._insert(pointers)
    vector = ir.VectorType(element, 16)
    mask = ir.VectorType(ir.IntType(1), 16)
    kind = ir.FunctionType(vector, [pointers.type, _I32, mask, vector])
    function = cgutils.get_or_insert_function(builder.module, kind,
                                              f"llvm.masked.gather.v16{name}.v16p0")
    return builder.call(function, [pointers, ir.Constant(_I32, 4), ir.Constant(mask, [1] * 16),
                                   ir.Constant(vector, ir.Undefined)])


@identified("example lanes", "gather signed")
@intrinsic
def gather_signed(typing, array, index):
    """array[index] lane by lane, for arrays of fewer than 2^31 elements."""
    kinds = _kinds(array)
    if kinds is None or index is not I:
        return None

    def code(context, builder, sig, args):
        return _gathered(context, builder, sig, args, kinds[1], "f32" if kinds[0] is F else "i32")
    return kinds[0](array, index), code


def _gathered_two(array, index, pitch):
    """Type and code of a gather of two int32 that lie side by side; see `_gathered`."""
    if not isinstance(array, types.Array) or array.dtype != types.int32 or index is not I:
        return None
    result = types.UniTuple(I, 2)

    def code(context, builder, sig, args):
        words = _gathered(context, builder, sig, args, _I64, "i64", pitch)
        return _split(context, builder, result, builder.bitcast(words, ir.VectorType(_I32, 32)))
    return result(array, index), code


@identified("example lanes", "gather pairs")
@intrinsic
def gather_pairs(typing, array, index):
    """array[2 index] and array[2 index + 1] lane by lane; int32, C-contiguous."""
    return _gathered_two(array, index, _I64)


@identified("example lanes", "gather neighbours")
@intrinsic
def gather_neighbours(typing, array, index):
    """array[index] and array[index + 1] lane by lane; int32, C-contiguous."""
    return _gathered_two(array, index, _I32)


@identified("example lanes", "prefetch")
@intrinsic
def prefetch(typing, array, index):
    """Ask for array[index], which must lie inside, to be in the cache soon."""
    if not isinstance(array, types.Array):
        return None

    def code(context, builder, sig, args):
        address = _address(context, builder, sig, args)
        kind = ir.FunctionType(ir.VoidType(), [ir.PointerType(), _I32, _I32, _I32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        # For reading, to be kept, data.
        builder.call(function, [address, *(ir.Constant(_I32, n) for n in (0, 3, 1))])
        return context.get_dummy_value()
    return types.none(array, index), code


@identified("example lanes", "store bytes")
@intrinsic
def store_bytes(typing, array, start, value):
    """The lowest bytes of lanes of int into array[start : start + 16], uint8."""
    if not isinstance(array, types.Array) or array.dtype != types.uint8 or value is not I:
        return None

    def code(context, builder, sig, args):
        small = builder.trunc(args[2], ir.VectorType(ir.IntType(8), 16))
        address = _address(context, builder, sig, args)
        builder.store(small, builder.bitcast(address, small.type.as_pointer()), align=1)
        return context.get_dummy_value()
    return types.none(array, start, value), code


@identified("example lanes", "store pairs")
@intrinsic
def store_pairs(typing, array, start, one, two):
    """Lanes of two values side by side into array[start : start + 32]."""
    kinds = _kinds(array)
    if kinds is None or not (one is kinds[0] and two is kinds[0]):
        return None

    def code(context, builder, sig, args):
        mixed = builder.shuffle_vector(args[2], args[3], ir.Constant(
            ir.VectorType(_I32, 32), [n // 2 + (0, 16)[n % 2] for n in range(32)]))
        address = _address(context, builder, sig, args)
        builder.store(mixed, builder.bitcast(address, mixed.type.as_pointer()), align=4)
        return context.get_dummy_value()
    return types.none(array, start, one, two), code


@identified("example lanes", "store triples")
@intrinsic
def store_triples(typing, array, start, one, two, three):
    """Lanes of three floats side by side into array[start : start + 48]."""
    if not isinstance(array, types.Array) or array.dtype != types.float32 or not (
            one is F and two is F and three is F):
        return None

    def code(context, builder, sig, args):
        def order(numbers):
            return ir.Constant(ir.VectorType(_I32, len(numbers)), numbers)

        first = builder.shuffle_vector(args[2], args[3], order(list(range(32))))
        last = builder.shuffle_vector(args[4], args[4], order(list(range(32))))
        mixed = builder.shuffle_vector(first, last, order(
            [n // 3 + (0, 16, 32)[n % 3] for n in range(48)]))
        address = _address(context, builder, sig, args)
        builder.store(mixed, builder.bitcast(address, mixed.type.as_pointer()), align=4)
        return context.get_dummy_value()
    return types.none(array, start, one, two, three), code


@woven
def pairs(array, n):
    """The pairs n .. n + 15 of a flat array; past its end the last one."""
    if 2 * n + 32 <= array.size:
        return load_pairs(array, 2 * n)
    pair = _minimum(_iota() + np.int32(n), np.int32(array.size // 2 - 1)) * np.int32(2)
    return gather_signed(array, pair), gather_signed(array, pair + np.int32(1))


@woven
def singles(array, n):
    """The elements n .. n + 15 of a flat array; past its end the last one."""
    if n + 16 <= array.size:
        return _load(array, n)
    return gather_signed(array, _minimum(_iota() + np.int32(n), np.int32(array.size - 1)))

_VI = ir.VectorType(ir.IntType(32), WIDTH)


def _place_of(context: Any, builder: Any, array_type: Any, array: Any, index: Any, index_type: Any,
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
        address = _place_of(context, builder, sig.args[0], args[0], args[1], sig.args[1],
                           ir.VectorType(ir.IntType(16), WIDTH))
        builder.store(narrowed(builder, args[2]), address, align=2)
        return context.get_dummy_value()
    return types.none(array, start, value), code


def look_up_way() -> str:
    """How this processor reads a stretch of a row quickest.

    ``"permuted"``: picked from two registers in one step (AVX-512 BW); ``"near"``: gathered, but
    for stretches of 16 places `make_near_look_up` is quicker (AVX2); or ``"gathered"``.
    """
    found = features()
    if found.get("avx512bw"):
        return "permuted"
    return "near" if found.get("avx2") and found.get("f16c") else "gathered"


def make_look_up(way: str | None = None) -> Callable[..., Any]:
    """Neighbouring values of a short stretch of a row, as linear interpolation wants them.

    ``look_up(array, start, index)``: the float16 values array[start + index] and array[start +
    index + 1] lane by lane, as two float lanes. The array is C-contiguous uint16 and holds 64
    values from ``start`` on; int lanes ``index`` lie in 0..62. ``way`` is by default what
    `look_up_way` says.
    """
    if (way or look_up_way()) != "permuted":
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
                address = _place_of(context, builder, sig.args[0], args[0], place, types.uintp,
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


NEAR = 15  # Greatest index of `make_near_look_up`.


def make_near_look_up() -> Callable[..., Any]:
    """`make_look_up` of two stretches of 16 places, picked in the registers of AVX2.

    ``look_up(array, start, other, index)`` as `make_look_up` has it, but for the first eight lanes
    the stretch begins at ``start``, for the last eight at ``other``. ``index`` lies in 0..`NEAR`,
    and the array holds 17 values from either start on.
    """
    pair = types.UniTuple(F, 2)
    eight, places = ir.VectorType(ir.FloatType(), 8), ir.VectorType(_I32, 8)
    words, halves = ir.VectorType(ir.IntType(16), 8), ir.VectorType(ir.HalfType(), 8)

    @identified("near look up")
    @intrinsic
    def look_up(typing, array, start, other, index):  # type: ignore[no-untyped-def]
        if not isinstance(array, types.Array) or array.dtype != types.uint16 or index is not I:
            return None

        def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
            pick = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(eight, [eight, places]), "llvm.x86.avx2.permps")

            def picked(place, at):  # type: ignore[no-untyped-def]
                """Of eight values from a place on, those at the lowest three bits of ``at``."""
                address = _place_of(context, builder, sig.args[0], args[0], place, types.uintp,
                                    words)
                table = builder.bitcast(builder.load(address, align=2), halves)
                return builder.call(pick, [builder.fpext(table, eight), at])

            found: list[list[Any]] = [[], []]
            for side in range(2):
                order = ir.Constant(places, list(range(8 * side, 8 * side + 8)))
                at = builder.shuffle_vector(args[3], args[3], order)
                second = builder.icmp_signed(">", at, ir.Constant(places, [7] * 8))
                begin = context.cast(builder, args[1 + side], sig.args[1 + side], types.uintp)
                for ahead in range(2):
                    low, high = (picked(builder.add(begin, ir.Constant(_I64, ahead + away)), at)
                                 for away in (0, 8))
                    found[ahead].append(builder.select(second, high, low))
            every = ir.Constant(_VI, list(range(WIDTH)))
            return context.make_tuple(builder, pair, [
                builder.shuffle_vector(*sides, every) for sides in found])
        return pair(array, start, other, index), code
    return look_up


def _extreme(less: str, halves: bool = False) -> Callable[..., Any]:
    result = types.UniTuple(types.float32, 2) if halves else types.float32

    @intrinsic
    def function(typing, value):  # type: ignore[no-untyped-def]
        if value is not F:
            return None

        def code(context, builder, sig, args):  # type: ignore[no-untyped-def]
            # Halvings; LLVM's own reduction minds NaN and goes lane by lane.
            value = args[0]
            for distance in (4, 2, 1) if halves else (8, 4, 2, 1):
                order = ir.Constant(_VI, [lane ^ distance for lane in range(WIDTH)])
                other = builder.shuffle_vector(value, value, order)
                value = builder.select(builder.fcmp_ordered(less, value, other), value, other)
            ends = [builder.extract_element(value, ir.Constant(_I32, lane)) for lane in (0, 8)]
            return context.make_tuple(builder, result, ends) if halves else ends[0]
        return result(F), code
    return function


smallest = identified("lanes", "smallest")(_extreme("<"))
"""The least of float lanes, none of them NaN, as a number."""
largest = identified("lanes", "largest")(_extreme(">"))
"""The greatest of float lanes, none of them NaN, as a number."""
smallest_of_halves = identified("lanes", "smallest of halves")(_extreme("<", True))
"""The least of the first eight and of the last eight float lanes, none of them NaN."""
largest_of_halves = identified("lanes", "largest of halves")(_extreme(">", True))
"""The greatest of the first eight and of the last eight float lanes, none of them NaN."""
