"""A head without hair in its photo: known to be bald, or not known at all."""

import numpy as np
import pytest

from lfportrait.face.head_fit import Picture
from lfportrait.face.one_photo import portrait
from lfportrait.face.one_photo.portrait import _bald

SIDE = 100


def seen(monkeypatch, shown: float, *, low: int = 20, hair: bool = False) -> bool:
    """A head from some row on, of which the network takes a share from above for hair."""
    landmarks = np.zeros((68, 2))
    landmarks[0], landmarks[16] = (25, 50), (75, 50)
    matte, found = np.zeros((2, SIDE, SIDE), np.float32)
    matte[low:, 20:80] = 1
    found[low:low + round(shown * SIDE), 20:80] = 1
    monkeypatch.setattr(portrait, "_hair_seen", lambda *_: found)
    mask = found if hair else np.zeros_like(found)
    return _bald(Picture((SIDE, SIDE), landmarks, hair=mask), matte,
                 np.zeros((SIDE, SIDE, 3), np.uint8))


@pytest.mark.parametrize(("shown", "bald"), [(0.0, True), (0.01, True), (0.2, False)])
def test_a_head_is_bald_where_the_network_sees_no_hair(monkeypatch, shown, bald):
    """Hair like skin is left out of the mask: that head is not known to be bald."""
    monkeypatch.setattr(portrait, "_knows_hair", lambda: True)
    assert seen(monkeypatch, shown) == bald
    assert not seen(monkeypatch, max(shown, 0.2), hair=True)


def test_nothing_is_known_of_a_crown_that_is_cut_off_nor_without_the_network(monkeypatch):
    monkeypatch.setattr(portrait, "_knows_hair", lambda: True)
    assert not seen(monkeypatch, 0.0, low=0)
    monkeypatch.setattr(portrait, "_knows_hair", lambda: False)
    assert not seen(monkeypatch, 0.0)
