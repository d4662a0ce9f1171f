"""Materials of a photo: small pieces of its body, and ears and forehead of a bare head."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.example.guides.regions import Regions, find_regions
from lfportrait.example.painter.photo import photo_shares
from lfportrait.example.painter.picture_materials import CLOTHES, HAIR, NECK, SKIN
from tests.portraits import drawn_face

HEIGHT, WIDTH = 400, 400
BODY = (60, 110, 60)


@pytest.fixture(scope="module")
def face():
    """A small face over a large body in green."""
    drawn = drawn_face(200, 200, seed=1)
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[:] = (90, 130, 170)
    mask = np.zeros((HEIGHT, WIDTH), np.float32)
    image[:200, 100:300], mask[:200, 100:300] = drawn.image, drawn.mask
    landmarks = drawn.landmarks + np.array([100.0, 0.0])
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    body = (np.abs(x - 200) < 25 + np.clip(y - landmarks[8, 1] - 20, 0, 140)) & (
        y > landmarks[8, 1] + 20)
    image[body], mask[body] = BODY, 1
    return replace(drawn, image=image, landmarks=landmarks, mask=mask)


def shares_of(face, image, hair=True, painted=None):
    regions = find_regions(image, face.landmarks, face.mask, networks=False)
    if not hair:
        regions = Regions(regions.landmarks, regions.person, None)
    painted = np.zeros((4, 4), np.float32) if painted is None else painted
    return photo_shares(image, regions, regions.labels(), np.zeros((HEIGHT, WIDTH, 2), np.float32),
                        painted, np.ones(7, bool))


def test_a_zip_as_light_as_skin_is_no_neck_but_a_bare_chest_is(face):
    image = face.image.copy()
    image[280:380, 193:207] = (225, 180, 150)
    shares = shares_of(face, image)
    assert shares[300:370, 194:206, CLOTHES].min() > 0.9
    image = face.image.copy()
    bare = slice(int(face.landmarks[8, 1]), 340), slice(180, 220)
    image[bare] = (225, 180, 150)
    assert shares_of(face, image)[230:330, 190:210, NECK].min() > 0.9


def test_shade_on_a_bare_throat_is_no_shirt(face):
    image = face.image.copy()
    low = int(face.landmarks[8, 1])
    image[(face.mask > 0.5) & (np.indices(face.mask.shape)[0] > low - 2)] = (225, 180, 150)
    image[low + 7:low + 17, 188:212] = (60, 45, 60)
    shares = shares_of(face, image)
    assert shares[low + 9:low + 15, 190:210, NECK].mean() > 0.9


def test_no_hair_lies_over_a_bare_heads_ears_and_forehead(face):
    shares = shares_of(face, face.image, hair=False, painted=np.ones((4, 4), np.float32))
    frame = find_regions(face.image, face.landmarks, face.mask, networks=False).frame
    right, down = frame.local((HEIGHT, WIDTH))
    half = 0.5 * frame.width / frame.height
    head = shares[..., [SKIN, HAIR]].sum(axis=-1) > 0.95
    ears = head & (np.abs(right) > half * 1.03) & (down > 0.2) & (down < 0.5)
    crown = head & (down < -0.5)
    brows = head & (np.abs(right) < 0.3 * half) & (down > -0.25) & (down < -0.05)
    assert ears.sum() > 20 and crown.sum() > 100
    assert brows.sum() > 50 and shares[brows][:, HAIR].max() < 0.05
    assert shares[ears][:, HAIR].max() < 0.05 and shares[crown][:, HAIR].min() > 0.9


def test_a_beard_as_the_hair_is_hair_and_a_chin_in_the_shade_is_skin(face):
    y, x = np.indices(face.mask.shape)
    low = int(face.landmarks[57, 1])
    chin = (y > low) & (y < face.landmarks[8, 1] + 12) & (np.abs(x - 200) < 24)
    for color, bearded in (((60, 40, 30), True), ((150, 120, 100), False)):
        image = face.image.copy()
        noise = np.random.default_rng(2).normal(0, 6, (int(chin.sum()), 3))
        image[chin] = np.clip(np.array(color) + noise, 0, 255).astype(np.uint8)
        shares = shares_of(face, image)
        grown = shares[low + 6:int(face.landmarks[8, 1]) - 4, 190:210, HAIR].mean()
        assert grown > 0.8 if bearded else grown < 0.1
        assert shares[int(face.landmarks[30, 1]), 180:220, HAIR].max() < 0.1
        np.testing.assert_allclose(shares.sum(axis=-1), 1, atol=1e-4)
