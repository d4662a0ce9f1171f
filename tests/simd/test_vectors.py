"""Sixteen-lane values against NumPy, operator by operator, edges included."""

import numpy as np
import pytest
from numba import njit

from lfportrait.simd import vectors as lanes

EDGES = np.array([0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 1e-30, -1e-30, 1e30, 88.0, -87.0, 3.999, -3.999,
                  7.0, 255.0, 1e-7], np.float32)


@njit
def arithmetic(a, b, out):
    x, y = lanes.load(a, 0), lanes.load(b, 0)
    lanes.store(out, 0, x + y)
    lanes.store(out, 16, x - y)
    lanes.store(out, 32, x * y)
    lanes.store(out, 48, -x)
    lanes.store(out, 64, np.float32(2.0) * x + np.float32(1.0))
    lanes.store(out, 80, lanes.floor(x))
    lanes.store(out, 96, lanes.minimum(x, y))
    lanes.store(out, 112, lanes.maximum(x, y))
    lanes.store(out, 128, lanes.absolute(x))
    lanes.store(out, 144, lanes.where(x < y, x, y))
    lanes.store(out, 160, lanes.where((x < y) & ~(x == y) | (y > np.float32(5.0)), np.float32(1.0),
                                      x))
    z = x
    z += y
    z *= np.float32(3.0)
    lanes.store(out, 176, z)


@pytest.mark.parametrize("seed", range(3))
def test_float_operators(seed):
    random = np.random.default_rng(seed)
    a = EDGES if seed == 0 else (10 * random.standard_normal(16)).astype(np.float32)
    b = random.permutation(EDGES) if seed < 2 else a[::-1].copy()
    out = np.zeros(192, np.float32)
    arithmetic(a, b, out)
    chosen = np.where((a < b) & ~(a == b) | (b > 5), np.float32(1), a)
    wanted = [a + b, a - b, a * b, -a, 2 * a + 1, np.floor(a), np.minimum(a, b), np.maximum(a, b),
              np.abs(a), np.where(a < b, a, b), chosen, (a + b) * 3]
    for got, right in zip(out.reshape(12, 16), wanted):
        assert np.allclose(got, right, rtol=1e-6, atol=0)


@njit
def integers(a, out):
    i = lanes.ints(lanes.load(a, 0))
    lanes.store(out, 0, i)
    lanes.store(out, 16, (i >> np.int32(1)) & np.int32(7))
    lanes.store(out, 32, (i << np.int32(2)) + lanes.iota())
    lanes.store(out, 48, lanes.maximum(i, np.int32(2)) - np.int32(1) * i)
    lanes.store(out, 64, lanes.where(i >= np.int32(0), ~i, i ^ np.int32(3)))


def test_int_operators():
    a = np.linspace(-40, 60, 16).astype(np.float32)
    out = np.zeros(80, np.int32)
    integers(a, out)
    i = a.astype(np.int32)
    wanted = [i, (i >> 1) & 7, (i << 2) + np.arange(16), np.maximum(i, 2) - i,
              np.where(i >= 0, ~i, i ^ 3)]
    assert np.array_equal(out.reshape(5, 16), wanted)


@njit
def exponential(a, out):
    for start in range(0, len(a), 16):
        lanes.store(out, start, lanes.exp(lanes.load(a, start)))


@njit
def faded(a, out):
    for start in range(0, len(a), 16):
        lanes.store(out, start, lanes.fading(lanes.load(a, start)))


def test_light_fades_by_half_for_each_unit():
    y = np.concatenate([np.linspace(0, 20, 4080), np.linspace(120, 1e4, 16)]).astype(np.float32)
    out = np.zeros_like(y)
    faded(y, out)
    assert np.abs(out - np.exp2(-y.astype(np.float64))).max() < 3e-6
    # What lets all light pass changes none of it.
    assert out[0] == 1 and (out[-16:] > 0).all()


def test_exp_is_exact_to_single_precision():
    x = np.linspace(-87, 88, 4096).astype(np.float32)
    out = np.zeros_like(x)
    exponential(x, out)
    assert np.abs(out / np.exp(x.astype(np.float64)) - 1).max() < 3e-7
    x = np.full(16, -1e9, np.float32)
    exponential(x, out)
    assert (out[:16] < 1e-37).all()


@njit
def memory(floats, whole, halves, index, out):
    place = lanes.ints(lanes.load(index, 0))
    lanes.store(out, 0, lanes.gather(floats, place))
    lanes.store(out, 16, lanes.floats(lanes.gather(whole, place)))
    low, high = lanes.gather_pair(halves, place)
    lanes.store(out, 32, low)
    lanes.store(out, 48, high)
    lanes.store(out, 64, lanes.load_half(halves, 3))
    return lanes.total(lanes.load(floats, 5)), lanes.lane(lanes.load(floats, 5), 7)


def test_gathers_and_loads():
    random = np.random.default_rng(0)
    floats = random.standard_normal(64).astype(np.float32)
    whole = random.integers(-99, 99, 64).astype(np.int32)
    halves = random.standard_normal(65).astype(np.float16)
    index = random.permutation(64)[:16]
    index[:2] = 0, 63
    out = np.zeros(80, np.float32)
    sums, one = memory(floats, whole, halves.view(np.uint16), index.astype(np.float32), out)
    wanted = [floats[index], whole[index], halves[index], halves[index + 1], halves[3:19]]
    assert np.array_equal(out.reshape(5, 16), np.array(wanted, np.float32))
    assert np.isclose(sums, floats[5:21].sum(), atol=1e-5)
    assert one == floats[12]


@njit
def mask_bits(a):
    word = lanes.bits(lanes.load(a, 0) > np.float32(0.0))
    found = 0
    rest = word
    while rest != 0:
        found |= 1 << lanes.lowest(rest)
        rest &= rest - np.uint32(1)
    return word, found


def test_masks_and_their_bits():
    a = np.where(np.arange(16) % 3 == 0, 1.0, -1.0).astype(np.float32)
    word, found = mask_bits(a)
    assert word == found == sum(1 << i for i in range(0, 16, 3))
    assert mask_bits(-np.ones(16, np.float32)) == (0, 0)
