"""Skin around the features is not taken for plain skin."""

import numpy as np
import pytest

from lfportrait.example.painter.picture_materials import FEATURES, NECK, SKIN
from lfportrait.example.painter.plain_skin import plain_skin
from lfportrait.labels import MATERIALS
from tests.portraits import drawn_face

BLANK = np.full((400, 300, 3), 180, np.uint8)


@pytest.fixture(scope="module")
def points():
    return drawn_face(400, 300).landmarks


def all_skin(shape):
    shares = np.zeros((*shape, len(MATERIALS)), np.float32)
    shares[..., SKIN] = 1
    return shares


def test_skin_around_eyes_and_lips_stays_in_the_face(points):
    given = all_skin((400, 300))
    shares = plain_skin(given, points, BLANK)
    assert given[..., SKIN].min() == 1
    np.testing.assert_allclose(shares.sum(axis=-1), 1, atol=1e-5)
    bag = points[40] + [0, 0.25 * np.linalg.norm(points[39] - points[36])]
    lip = points[57] + [0, 2]
    for x, y in (points[37], bag, points[51], lip, points[33], points[19]):
        assert shares[int(y), int(x), FEATURES] > 0.6
    cheek, forehead = 0.5 * (points[3] + points[48]), points[27] - [0, 70]
    for x, y in (cheek, forehead, points[8] + [0, 30], (3.0, 3.0)):
        assert shares[int(y), int(x), SKIN] == pytest.approx(1, abs=0.01)


def test_a_little_skin_is_all_used(points):
    shares = all_skin((400, 300))
    low, high = points[36:48].min(axis=0).astype(int), points[36:48].max(axis=0).astype(int)
    shares[..., SKIN] = 0
    shares[low[1]:high[1], low[0]:high[0], SKIN] = 1
    np.testing.assert_array_equal(plain_skin(shares, points, BLANK), shares)


def test_unknown_landmarks_take_nothing(points):
    unknown = points.copy()
    unknown[[36, 45, 31, 50]] = np.nan
    shares = plain_skin(all_skin((400, 300)), unknown, BLANK)
    assert np.isfinite(shares).all() and shares[..., FEATURES].max() == 0


def test_a_dark_fold_on_cheek_or_neck_is_none_of_their_paint(points):
    shares = all_skin((400, 300))
    shares[330:, :, SKIN], shares[330:, :, NECK] = 0, 1
    image = BLANK.copy()
    (x, y), chin = points[3].astype(int), points[8].astype(int)
    image[y - 20:y + 20, x + 2:x + 7] = 70
    image[chin[1] + 60:chin[1] + 66, chin[0] - 30:chin[0] + 30] = 70
    assert chin[1] + 60 > 330
    found = plain_skin(shares, points, image)
    assert found[y - 10:y + 10, x + 4, SKIN].max() < 0.1
    assert found[chin[1] + 63, chin[0] - 20:chin[0] + 20, NECK].max() < 0.1
    assert found[y, x - 25:x - 15, SKIN].min() > 0.9
    # Hatching is how this face is drawn.
    image = BLANK.copy()
    image[:, ::12] = image[:, 1::12] = image[:, 2::12] = image[:, 3::12] = 70
    np.testing.assert_array_equal(plain_skin(shares, points, image),
                                  plain_skin(shares, points, BLANK))
