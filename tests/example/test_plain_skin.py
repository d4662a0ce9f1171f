"""Skin around the features is not taken for plain skin."""

import numpy as np
import pytest

from lfportrait.example.painter.picture_materials import CLOTHES, FEATURES, NECK, SKIN
from lfportrait.example.painter.plain_skin import plain_skin, unlike_face
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
    shares = plain_skin(given, points, BLANK)[0]
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
    np.testing.assert_array_equal(plain_skin(shares, points, BLANK)[0], shares)


def test_unknown_landmarks_take_nothing(points):
    unknown = points.copy()
    unknown[[36, 45, 31, 50]] = np.nan
    shares = plain_skin(all_skin((400, 300)), unknown, BLANK)[0]
    assert np.isfinite(shares).all() and shares[..., FEATURES].max() == 0


def test_a_dark_fold_on_cheek_or_neck_is_none_of_their_paint(points):
    shares = all_skin((400, 300))
    shares[330:, :, SKIN], shares[330:, :, NECK] = 0, 1
    image = BLANK.copy()
    (x, y), chin = points[3].astype(int), points[8].astype(int)
    image[y - 20:y + 20, x + 2:x + 7] = 70
    image[chin[1] + 60:chin[1] + 66, chin[0] - 30:chin[0] + 30] = 70
    assert chin[1] + 60 > 330
    found = plain_skin(shares, points, image)[0]
    assert found[y - 10:y + 10, x + 4, SKIN].max() < 0.1
    assert found[chin[1] + 63, chin[0] - 20:chin[0] + 20, NECK].max() < 0.1
    assert found[y, x - 25:x - 15, SKIN].min() > 0.9
    # Hatching is how this face is drawn.
    image = BLANK.copy()
    image[:, ::12] = image[:, 1::12] = image[:, 2::12] = image[:, 3::12] = 70
    np.testing.assert_array_equal(plain_skin(shares, points, image)[0],
                                  plain_skin(shares, points, BLANK)[0])


BROWN, COAT = (200, 150, 120), (40, 32, 28)
BEARDLESS = np.zeros((400, 300), np.float32)


def bust(points, low):
    """A brown face over a neck and a coat: picture and shares; what is below the mouth is ``low``
    in color, as far as the coat, which begins at the last quarter."""
    shares = all_skin((400, 300))
    (_, chin), lip = points[8].astype(int), int(points[57, 1])
    shares[chin:, :, SKIN], shares[chin:, :, NECK] = 0, 1
    shares[360:, :, NECK], shares[360:, :, CLOTHES] = 0, 1
    image = np.full((400, 300, 3), BROWN, np.uint8)
    image[lip + 12:] = low
    image[360:] = COAT
    return image, shares, (lip, chin)


def test_a_dark_beard_is_neither_neck_nor_plain_skin(points):
    image, shares, (lip, chin) = bust(points, (52, 40, 34))
    image[lip - 12:lip + 12] = image[lip + 12]
    found = plain_skin(shares, points, image)[0]
    np.testing.assert_allclose(found.sum(axis=-1), 1, atol=1e-5)
    assert found[..., NECK].max() == 0
    assert found[chin - 8:chin - 3, 20:60, SKIN].max() < 0.1
    assert found[lip - 60:lip - 40, 20:60, SKIN].min() > 0.9
    assert found[370:, :, CLOTHES].min() > 0.9
    assert shares[chin + 5, 5, NECK] == 1  # what was given stays


def test_a_neck_in_a_little_shade_is_one(points):
    image, shares, _ = bust(points, (189, 141, 112))
    assert np.max(unlike_face(image, shares, points, BEARDLESS)) == 0


def test_of_a_neck_that_is_mostly_a_coat_nothing_is_used(points):
    image, shares, (_, chin) = bust(points, COAT)
    image[chin:, :90] = BROWN
    image[360:] = COAT
    found = plain_skin(shares, points, image)[0]
    assert found[..., NECK].max() == 0
    assert found[chin + 10, 200, FEATURES] > 0.9
    # Half of one is a neck still.
    image[chin:360, :150] = BROWN
    assert plain_skin(shares, points, image)[0][chin + 20, 20:100, NECK].min() > 0.9


def test_a_coat_that_was_taken_for_a_neck_is_clothes(points):
    image, shares, (_, chin) = bust(points, COAT)
    shares[360:385, :, NECK], shares[360:385, :, CLOTHES] = 1, 0
    found = plain_skin(shares, points, image)[0]
    assert found[370:, :, CLOTHES].min() > 0.8 and found[chin + 60:, 5:20, CLOTHES].min() > 0.9
    assert found[..., NECK].max() == 0 and found[chin + 5, 150, CLOTHES] < 0.1
    np.testing.assert_allclose(found.sum(axis=-1), 1, atol=1e-5)


def test_a_face_alone_is_compared_with_nothing(points):
    assert np.max(unlike_face(BLANK, all_skin((400, 300)), points, BEARDLESS)) == 0


def test_a_red_beard_that_goes_on_beyond_what_is_known_of_it_is_no_skin(points):
    image, shares, (lip, chin) = bust(points, BROWN)
    image[lip + 12:chin] = (170, 80, 40)
    known = BEARDLESS.copy()
    known[lip + 12:chin, 100:200] = 1
    shares[..., SKIN] -= known * shares[..., SKIN]
    strange = unlike_face(image, shares, points, known)[1]
    assert strange[chin - 10:chin - 5, 205:230].min() > 0.9
    assert strange[lip - 60:lip - 10].max() < 0.1
    assert np.max(unlike_face(image, shares, points, BEARDLESS)[1]) < 0.1


def test_shade_of_a_face_is_its_skin(points):
    image, shares, (_, chin) = bust(points, (150, 105, 80))
    found = plain_skin(shares, points, image)[0]
    assert found[chin - 8:chin - 3, 20:60, SKIN].min() > 0.9
