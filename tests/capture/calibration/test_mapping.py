"""Tries to place photos go on while they help."""

from types import SimpleNamespace

import numpy as np
import pytest

from lfportrait.capture.calibration import mapping
from lfportrait.capture.calibration.mapping import Placing, place_photos


@pytest.mark.parametrize(("placed", "asked"), [
    ([8, 8, 8, 9, 10], 3),       # two tries in vain, most are placed
    ([3, 3, 3, 9, 10, 10], 5),   # few are placed: no way is left out
    ([8, 8, 9, 9, 9, 10], 5),    # one that helped gives two more
    ([10, 10], 1)])
def test_tries_end_where_they_bring_no_more(monkeypatch, placed, asked):
    made = []

    def tries(mapper, groups, best):
        for count in placed:
            made.append(count)
            yield Placing("somehow", None, list(range(count)), groups)
    monkeypatch.setattr(mapping, "_tries", tries)
    scene = SimpleNamespace(seen_again=lambda *_: np.ones(10, np.int64))
    found = place_photos(scene, [0] * 10, "SIMPLE_RADIAL", lambda: None, lambda line: None)
    assert len(made) == asked
    assert len(found.photos) == max(made)
