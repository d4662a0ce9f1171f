"""Numba types of sixteen lanes, and what Python's operators mean on them.

The types are LLVM vectors: 16 float32 (`F`), 16 int32 (`I`) and 16 booleans (`M`). Operands are
lanes of one kind, or lanes and a number, which is then the same in every lane. What else can be
done with them is in `lfportrait.lanes.vectors`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

__all__ = ["VECTOR", "WIDTH", "F", "I", "Lanes", "M", "kind_of", "lanes_of"]

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
    """Give Python's operator ``function`` a meaning on lanes.

    ``allowed`` maps the operands' kind to a generator of LLVM code; ``result`` maps it to the
    result's kind.
    """
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
