"""Arrays in few bytes: the same numbers come back, fewer bytes where neighbours are alike."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from lfportrait.example.skin.storage import check, pack, unpack

KINDS = (np.bool_, np.uint8, np.int32, np.uint16, np.float16, np.float32, np.float64)


@settings(max_examples=150, deadline=None)
@given(arrays.arrays(st.sampled_from(KINDS), arrays.array_shapes(min_side=0, max_dims=4,
                                                                 max_side=6)),
       st.integers(0, 3))
def test_what_is_packed_comes_back(values, order):
    found = unpack(pack(values, order))
    assert found.dtype == values.dtype and found.shape == values.shape
    assert found.tobytes() == values.tobytes()  # NaN and -0 are what they were
    assert found.flags.c_contiguous and found.flags.writeable


def test_numbers_in_the_last_place_are_kept():
    extremes = np.array([0, -1, 2**31 - 1, -2**31, 5, 2**31 - 1], np.int32)
    odd = np.array([np.inf, -np.inf, np.nan, -0.0, 1e-45, 3.4e38], np.float32)
    for values in (extremes, odd, extremes.reshape(2, 3), odd[::-1], odd.reshape(2, 3).T):
        for order in (0, 1, 2):
            assert unpack(pack(values, order)).tobytes() == values.tobytes()


def test_what_is_alike_takes_little_room():
    places = np.arange(100_000)
    assert pack(places).size < places.nbytes / 200
    assert pack(places // 1000 % 2 == 0).size < len(places) / 100
    wave = np.sin(places / 3000).astype(np.float32)
    once, twice = pack(wave).size, pack(wave, 2).size
    assert twice < 0.8 * once < 0.6 * wave.nbytes
    pairs = np.stack([wave, -wave], axis=1)  # columns are apart
    assert pack(pairs, 2).size < 2.1 * twice
    noise = np.random.default_rng(0).integers(0, 256, 100_000, np.uint8)
    assert pack(noise).size < 1.01 * len(noise)


def test_damaged_bytes_are_found():
    data = pack(np.random.default_rng(0).random(500))
    check(data)
    for place in range(0, len(data), 7):
        bad = data.copy()
        bad[place] ^= 0x10
        for reader in (check, unpack):
            with pytest.raises(ValueError, match="damaged"):
                reader(bad)
    for cut in (0, 3, 20, len(data) // 2, len(data) - 1):
        with pytest.raises(ValueError, match="damaged"):
            unpack(data[:cut])
