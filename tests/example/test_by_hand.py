"""Regions that were painted over by hand take the place of what is found."""

import numpy as np
import pytest

from lfportrait.errors import UserError
from lfportrait.example import Exemplar, painted_shares
from lfportrait.example.painter.picture_materials import known_shares
from lfportrait.example.worn.hat import headwear
from lfportrait.face import write_landmarks
from lfportrait.files import write_image
from lfportrait.job.graph import painting_key
from lfportrait.job.warmup import drawn_exemplar
from lfportrait.labels import BY_HAND, MATERIALS


@pytest.fixture
def painting(tmp_path):
    """A painting on the disk, and a picture of regions of its size in which nothing is painted."""
    exemplar = drawn_exemplar(192, 256)
    path = tmp_path / "ken.png"
    write_image(path, exemplar.image)
    write_landmarks(path.with_suffix(".landmarks.txt"), exemplar.landmarks)
    write_image(path.with_suffix(".mask.png"), exemplar.mask)
    return path, np.zeros((256, 192), np.uint8)


def painted(path, values):
    write_image(path.with_suffix(".regions.png"), values)
    return Exemplar.load(path)


def test_nothing_painted_changes_nothing(painting):
    path, values = painting
    before, after = Exemplar.load(path), painted(path, values)
    assert before.by_hand is None and not after.by_hand.any()
    assert np.array_equal(before.regions().person, after.regions().person)
    shares = [known_shares(one, one.regions(), one.regions().labels()) for one in (before, after)]
    assert np.array_equal(*shares)


# A region that photos have too, and one that they have not; all are painted in one way.
@pytest.mark.parametrize("name", [
    name if name in ("hat", "hair") else pytest.param(name, marks=pytest.mark.slow)
    for name in BY_HAND[1:]])
def test_each_region_is_what_was_painted(painting, name):
    path, values = painting
    # On the forehead, beside the head and on the body at once.
    values[60:90, 80:110] = values[10:30, 5:40] = values[230:250, 60:120] = BY_HAND.index(name)
    there, exemplar = values > 0, painted(path, values)
    regions = exemplar.regions()
    assert (regions.person[there] == (name != "background")).all()
    hair = np.zeros_like(there) if regions.hair is None else regions.hair == 1
    assert (hair[there] == (name == "hair")).all()
    shares = known_shares(exemplar, regions, regions.labels())
    assert shares.sum(axis=-1) == pytest.approx(1, abs=0.02)
    wanted = {"hat": "features"}.get(name, name)
    own = shares[there][:, MATERIALS.index(wanted)]
    if name == "skin":  # brows reach into it, and ears stay
        own = own + shares[there][:, MATERIALS.index("features")] + shares[there][
            :, MATERIALS.index("ears")]
    assert own == pytest.approx(1, abs=0.01)
    hat = headwear(exemplar)
    assert hat is None or (hat[there] == (name == "hat")).all()
    assert (hat is not None) or name != "hat"
    # Far from what was painted all is as it is found.
    plain = Exemplar.load(path, exemplar.landmarks)
    plain.by_hand = None
    found = painted_shares(plain, plain.regions(), plain.regions().labels())
    far = np.zeros_like(there)
    far[150:170, 80:110] = True
    if name != "background":
        assert np.abs(shares - found)[far].mean() < 0.25


def test_a_forehead_is_filled_all_the_same(painting):
    from lfportrait.example.worn.inpainting import _filled

    path, values = painting
    values[:40] = BY_HAND.index("hat")
    exemplar = painted(path, values)
    height = exemplar.regions().frame.height
    bare, hole = np.zeros((2, 256, 192), bool)
    bare[60:160, 70:125] = True
    hole[60:75, 80:110] = True
    broad = exemplar.image.astype(np.float32) / np.float32(255)
    found = _filled(exemplar, bare, hole, broad, height)
    plain = Exemplar.load(path, exemplar.landmarks)
    plain.by_hand = None
    assert np.array_equal(found, _filled(plain, bare, hole, broad, height))


def test_a_wrong_file_is_said_in_one_line(painting):
    path, values = painting
    for wrong, words in ((values[:10], "size"), (values + 9, "grey values")):
        with pytest.raises(UserError, match=words):
            painted(path, wrong)


def test_what_was_painted_is_part_of_a_results_key(painting):
    path, values = painting
    keys = {painting_key(Exemplar.load(path))}
    for value in range(3):
        values[:9] = value
        keys.add(painting_key(painted(path, values)))
    assert len(keys) == 4


def test_it_stays_where_it_is_in_smaller_copies(painting):
    path, values = painting
    values[:128] = 1
    small = painted(path, values).within(15.0)
    assert small.by_hand.shape == small.image.shape[:2] and small.by_hand.shape[0] < 256
    assert (small.by_hand[:small.by_hand.shape[0] // 2 - 1] == 1).all()
    assert not small.by_hand[small.by_hand.shape[0] // 2 + 1:].any()
