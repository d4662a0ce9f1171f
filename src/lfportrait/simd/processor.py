"""What a vector is: Numba's types of sixteen lanes, and the instructions they are compiled to.

The types are LLVM vectors: 16 float32 (`F`), 16 int32 (`I`) and 16 booleans (`M`). What can be done
with them is in `lfportrait.simd.vectors`.

By default LLVM compiles for this very processor. ``LFPORTRAIT_VECTORS`` asks for less: ``avx2``
(most laptops) or ``sse2`` (every 64-bit processor of the x86 kind), for code that is to run
elsewhere and for tests. Numba keeps the code of each choice apart.

Older processors, and virtual machines that hide what theirs can, convert no half-precision numbers;
LLVM would call a function for it that nobody provides. There the conversions are made of whole
numbers, bit for bit the same.
"""

import operator
import os
from collections.abc import Callable
from typing import Any

import llvmlite.binding
import numba
from llvmlite import ir
from numba import types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

from ..errors import UserError

WIDTH = 16

F32, I32, I16, I1 = ir.FloatType(), ir.IntType(32), ir.IntType(16), ir.IntType(1)
VF, VI, VM = (ir.VectorType(kind, WIDTH) for kind in (F32, I32, I1))
for _kind in (F32, I32, I16, I1, VF, VI, VM):
    # llvmlite keeps a type's text from its first use on, which would change what Numba hashes.
    str(_kind)


class Lanes(types.Type):
    """A vector of 16 values; ``kind`` is ``"f"``, ``"i"`` or ``"m"``."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        super().__init__(name=f"lanes16{kind}")


class _FloatLanes(Lanes):
    pass


class _IntLanes(Lanes):
    pass


class _MaskLanes(Lanes):
    pass


F, I, M = _FloatLanes("f"), _IntLanes("i"), _MaskLanes("m")
VECTOR = {F: VF, I: VI, M: VM}


def _model(vector: ir.Type) -> type:
    class Model(models.PrimitiveModel):
        def __init__(self, manager, lanes):
            super().__init__(manager, lanes, vector)
    return Model


for _class, _vector in ((_FloatLanes, VF), (_IntLanes, VI), (_MaskLanes, VM)):
    register_model(_class)(_model(_vector))


def _splat(builder, value, vector):
    """The same scalar in every lane."""
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(I32, 0))
    zeros = ir.Constant(ir.VectorType(I32, WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, first, zeros)


def lanes_of(context, builder, value, given, wanted):
    """``value`` of Numba type ``given`` as lanes of kind ``wanted``."""
    if isinstance(given, Lanes):
        return value
    scalar = {F: types.float32, I: types.int32, M: types.boolean}[wanted]
    value = context.cast(builder, value, given, scalar)
    if wanted is M:
        value = builder.trunc(value, I1) if value.type != I1 else value
    return _splat(builder, value, VECTOR[wanted])


def kind_of(arguments) -> Lanes | None:
    """The lane kind that an operation on ``arguments`` works in, or None for scalars alone."""
    kinds = {a.kind for a in arguments if isinstance(a, Lanes)}
    if len(kinds) != 1:
        return None
    return {"f": F, "i": I, "m": M}[kinds.pop()]


def _operator(function: Callable[..., Any], result: Callable[[Lanes], Lanes],
              allowed: dict[Lanes, Callable[..., Any]], count: int = 2) -> None:
    """Give an operator a meaning on lanes: LLVM generator and result by the operands' kind."""
    scalars = (types.Number, types.Boolean)

    @infer_global(function)
    class Template(AbstractTemplate):
        # Numba asks for meanings that are made for one kind of processor before the general ones,
        # of which an operator has dozens.
        metadata = {"target": "cpu"}  # noqa: RUF012

        def generic(self, args, kws):
            kind = kind_of(args)
            if len(args) != count or kind not in allowed:
                return None
            if not all(isinstance(a, (Lanes, *scalars)) for a in args):
                return None
            return signature(result(kind), *args)

    def lower(context, builder, sig, args):
        kind = kind_of(sig.args)
        return allowed[kind](builder, *(lanes_of(context, builder, value, given, kind)
                                        for value, given in zip(args, sig.args)))

    patterns: list[tuple[Any, ...]] = [(a, b) for a in (_FloatLanes, _IntLanes, _MaskLanes)
                for b in (_FloatLanes, _IntLanes, _MaskLanes, types.Number, types.Boolean)]
    patterns += [(b, a) for a, b in patterns if not issubclass(b, Lanes)]
    if count == 1:
        patterns = [(a,) for a in (_FloatLanes, _IntLanes, _MaskLanes)]
    for pattern in patterns:
        lower_builtin(function, *pattern)(lower)


def _fast(name: str) -> Callable[..., Any]:
    return lambda builder, a, b: getattr(builder, name)(a, b, flags=("contract",))


def _same(kind):
    return kind


for _plain, _in_place, _floating, _whole in (
        (operator.add, operator.iadd, "fadd", "add"), (operator.sub, operator.isub, "fsub", "sub"),
        (operator.mul, operator.imul, "fmul", "mul")):
    for _function in (_plain, _in_place):
        _operator(_function, _same, {
            F: _fast(_floating), I: lambda b, x, y, name=_whole: getattr(b, name)(x, y)})
_operator(operator.truediv, _same, {F: _fast("fdiv")})
_operator(operator.and_, _same, {I: lambda b, x, y: b.and_(x, y), M: lambda b, x, y: b.and_(x, y)})
_operator(operator.or_, _same, {I: lambda b, x, y: b.or_(x, y), M: lambda b, x, y: b.or_(x, y)})
_operator(operator.xor, _same, {I: lambda b, x, y: b.xor(x, y), M: lambda b, x, y: b.xor(x, y)})
_operator(operator.lshift, _same, {I: lambda b, x, y: b.shl(x, y)})
_operator(operator.rshift, _same, {I: lambda b, x, y: b.ashr(x, y)})
_operator(operator.invert, _same, {I: lambda b, x: b.not_(x), M: lambda b, x: b.not_(x)}, count=1)
_operator(operator.neg, _same, {F: lambda b, x: b.fneg(x), I: lambda b, x: b.neg(x)}, count=1)


def _mask(kind):
    return M


def _compare(symbol: str) -> dict[Lanes, Callable[..., Any]]:
    return {F: lambda b, x, y: b.fcmp_ordered(symbol, x, y),
            I: lambda b, x, y: b.icmp_signed(symbol, x, y)}


for _function, _symbol in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"),
                           (operator.ge, ">="), (operator.eq, "=="), (operator.ne, "!=")):
    _operator(_function, _mask, _compare(_symbol))

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
    """Compile for the vector unit that `SETTING` names, if any."""
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
