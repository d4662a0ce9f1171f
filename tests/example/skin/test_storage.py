"""A skin's file: what comes back from it, how large it is, and when it is not used."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.example.skin.storage import as_stored, load_skin, save_skin, skin_key
from lfportrait.files import map_arrays, write_mappable

SHARES = ("tone", "detail", "appearance", "contours", "hair", "clothes", "ears", "seen")


@pytest.fixture
def path(skin, tmp_path):
    save_skin(skin, tmp_path / "skin.npz", skin_key("field", 1))
    return tmp_path / "skin.npz"


def test_a_skin_that_is_read_again_is_the_same(skin, path, tmp_path):
    again = load_skin(path, skin_key("field", 1))
    assert again is not None and again.pixels == skin.pixels
    for name in ("index", "flat", "rows", "outwards"):
        found, wanted = getattr(again, name), getattr(skin, name)
        assert found.dtype == wanted.dtype and np.array_equal(found, wanted, equal_nan=True), name
    for name in SHARES:
        assert getattr(again, name).dtype == np.float32
        assert np.array_equal(getattr(again, name), np.float16(getattr(skin, name))), name
    assert np.array_equal(again.labels[0], skin.labels[0]) and again.labels[1] == skin.labels[1]
    assert np.array_equal(again.slots, skin.slots)
    assert np.array_equal(again.plane.landmarks, skin.plane.landmarks)


def test_so_is_its_atlas(skin, path):
    found, wanted = load_skin(path, skin_key("field", 1)).atlas, skin.atlas
    for name in ("owner", "depth", "boxes", "points"):
        assert np.array_equal(getattr(found, name), getattr(wanted, name), equal_nan=True), name
    assert found.owner.dtype == np.int32 and found.color.dtype == np.float32
    assert np.abs(found.color - wanted.color).max() < 0.501 / 255
    assert np.array_equal(found.shape.normals, wanted.shape.normals)
    assert np.array_equal(found.shape.low, wanted.shape.low)
    assert found.cameras.pose.tobytes() == wanted.cameras.pose.tobytes()


def test_it_is_that_with_which_its_first_run_goes_on(skin, path):
    key = skin_key("field", 1)
    first, again = as_stored(skin, key), load_skin(path, key)
    for name in ("index", "flat", "rows", "outwards", *SHARES):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes(), name
    assert first.kept.keys() == again.kept.keys() and first.kept["key"] == again.kept["key"]
    assert np.array_equal(first.atlas.color, again.atlas.color)


def test_nothing_is_lost_from_file_to_file(path, tmp_path):
    save_skin(load_skin(path, skin_key("field", 1)), tmp_path / "other.npz", skin_key("field", 1))
    assert (tmp_path / "other.npz").read_bytes() == path.read_bytes()


def test_a_skin_without_hair_has_none_in_its_file(skin, tmp_path):
    save_skin(replace(skin, hair=None), tmp_path / "bald.npz", "key")
    bald = load_skin(tmp_path / "bald.npz", "key")
    assert bald is not None and bald.hair is None


def test_a_file_takes_a_sixth_of_the_memory(skin, path):
    atlas = skin.atlas
    lists = [getattr(skin, name) for name in (*SHARES, "index", "flat", "rows", "outwards")]
    whole = sum(part.nbytes for part in (atlas.depth, atlas.owner, atlas.color, *lists))
    assert path.stat().st_size < whole / 6


def test_a_skin_of_something_else_or_in_pieces_is_not_used(skin, path, tmp_path):
    key = skin_key("field", 1)
    assert load_skin(tmp_path / "none.npz", key) is None
    assert load_skin(path, skin_key("field", 2)) is None
    whole = path.read_bytes()
    for place in (5000, len(whole) // 3, len(whole) // 2):
        path.write_bytes(whole[:place])
        assert load_skin(path, key) is None
    colors = whole.index(b"colors.npy") + 2000
    for place in (colors, len(whole) // 2):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1:])
        assert load_skin(path, key) is None


def test_a_file_of_another_form_is_not_used(path):
    """As one of before, whose arrays were stored as they are."""
    key = skin_key("field", 1)
    arrays = {name: value.copy() for name, value in map_arrays(path).items()
              if name not in ("solid", "depths", "lit", "colors", "known", "owners")}
    shape = tuple(arrays["size"])
    arrays |= {"depth": np.zeros(shape, np.float32), "owner": np.zeros(shape, np.int32)}
    with open(path, "wb") as stream:
        write_mappable(stream, arrays)
    assert load_skin(path, key) is None
