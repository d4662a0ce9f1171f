"""Half precision without instructions for it, and kernels compiled for lesser processors."""

import os
import subprocess
import sys

import numpy as np
import pytest
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from lfportrait.errors import UserError
from lfportrait.simd import processor
from lfportrait.simd.processor import F
from lfportrait.simd.vectors import LANES

WORDS = ir.VectorType(ir.IntType(16), 16)


@intrinsic
def widen(typing, words, start):
    def code(context, builder, sig, args):
        base = context.make_array(sig.args[0])(context, builder, args[0]).data
        place = builder.gep(base, [context.cast(builder, args[1], sig.args[1], types.uintp)])
        values = builder.load(builder.bitcast(place, ir.PointerType()), align=2, typ=WORDS)
        return processor.widened(builder, values)
    return F(words, start), code


@intrinsic
def narrow(typing, words, start, value):
    def code(context, builder, sig, args):
        base = context.make_array(sig.args[0])(context, builder, args[0]).data
        place = builder.gep(base, [context.cast(builder, args[1], sig.args[1], types.uintp)])
        builder.store(processor.narrowed(builder, args[2]),
                      builder.bitcast(place, WORDS.as_pointer()), align=2)
        return context.get_dummy_value()
    return types.none(words, start, value), code


@pytest.fixture
def without_halves(monkeypatch):
    monkeypatch.setattr(processor, "_converts_halves", lambda: False)


def test_every_half_is_widened_exactly(without_halves):
    store = LANES.store

    @njit
    def all_of(words, found):
        for start in range(0, words.size, 16):
            store(found, start, widen(words, start))

    words = np.arange(65536).astype(np.uint16)
    found = np.zeros(65536, np.float32)
    all_of(words, found)
    wanted = words.view(np.float16).astype(np.float32)
    numbers = ~np.isnan(wanted)
    assert np.array_equal(found.view(np.uint32)[numbers], wanted.view(np.uint32)[numbers])
    assert np.isnan(found[~numbers]).all()


def test_numbers_are_rounded_as_numpy_does(without_halves):
    load = LANES.load

    @njit
    def all_of(values, found):
        for start in range(0, values.size, 16):
            narrow(found, start, load(values, start))

    random = np.random.default_rng(4)
    bits = random.integers(0, 1 << 32, 1 << 16, dtype=np.uint32)
    halves = np.arange(65536).astype(np.uint16).view(np.float16).astype(np.float32)
    between = halves + np.spacing(halves.astype(np.float16)).astype(np.float32) / 2
    special = np.float32([0, -0.0, np.inf, -np.inf, np.nan, 65504, 65519.99, 65520, 1e-8, 6e-8,
                          2 ** -14, 2 ** -24, 2 ** -25, -(2 ** -25), 3 * 2 ** -26, 1])
    values = np.concatenate([bits.view(np.float32), halves, between, special])
    found = np.zeros(values.size, np.uint16)
    all_of(values, found)
    with np.errstate(over="ignore", invalid="ignore"):
        wanted = values.astype(np.float16)
    numbers = ~np.isnan(wanted)
    assert np.array_equal(found[numbers], wanted.view(np.uint16)[numbers])
    assert np.isnan(found.view(np.float16)[~numbers]).all()


def test_a_level_that_is_none_or_missing_is_one_line(monkeypatch):
    monkeypatch.setenv(processor.SETTING, "avx9")
    with pytest.raises(UserError, match="avx2 or sse2"):
        processor.limit_vectors()
    monkeypatch.setenv(processor.SETTING, "avx2")
    monkeypatch.setattr(processor, "_host", lambda: {"sse2": True})
    with pytest.raises(UserError, match="does not have"):
        processor.limit_vectors()


@pytest.mark.parametrize(("level", "unit"), [("avx2", "AVX2"), ("sse2", "SSE2")])
def test_what_is_used_is_what_is_asked_for(level, unit):
    script = "from lfportrait.simd import host; print(host.vector_unit()[0])"
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True,
                           env={**os.environ, processor.SETTING: level}, check=True)
    assert found.stdout.strip() == unit
