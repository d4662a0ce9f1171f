"""A painted cap: found as a thing, put on the sitter of a photo when asked, else on nobody."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image

from lfportrait.example import Exemplar, Transfer, TransferConfig, bared
from lfportrait.example.frontal import frontalised
from lfportrait.example.guides.regions import find_regions, soft_face
from lfportrait.example.painter.picture_materials import HAIR, known_shares
from lfportrait.example.transfers import transfer
from lfportrait.example.worn.hat import headwear, not_worn
from tests.portraits import drawn_face

HEIGHT, WIDTH = 320, 260
SKIN = 225, 180, 150
GROUND = np.array([90, 130, 170])
GREEN = np.array([40, 120, 60])
PAINTINGS = ("chardin_spectacles", "rubens_straw_hat", "vermeer_procuress_detail",
             "weyden_winged_bonnet")
BARE = ("jeanne_samary_by_renoir", "michelangelo_by_volterra", "mona_lisa", "vangogh_self_1887")


def capped(face, wide):
    """A painting with a cap, and where that is, bool [h, w]; ``wide`` over half the face's."""
    frame = face.regions().frame
    half = 0.5 * frame.width / frame.height
    right = half * np.array([-wide, wide, wide, 1.25, 1.1, -1.1, -1.25, -wide])
    down = np.array([-0.25, -0.25, -0.4, -0.5, -1.0, -1.0, -0.5, -0.4])
    corners = np.round(frame.point(right, down)).astype(int)
    image, cap = face.image.copy(), np.zeros(face.image.shape[:2], np.uint8)
    cv2.fillPoly(cap, [corners], 1)
    grain = np.random.default_rng(0).normal(0, 4, (*cap.shape, 3))
    image[cap > 0] = np.clip(GREEN + grain, 0, 255)[cap > 0]
    return replace(face, image=image), cap > 0


@pytest.fixture(scope="module")
def face():
    return drawn_face(HEIGHT, WIDTH, seed=3)


def greenish(image):
    """Where a picture in [0, 1] has the cap's color."""
    return np.abs(image - GREEN / 255).max(axis=-1) < 0.12


@pytest.mark.parametrize("wide", [1.25, *(
    pytest.param(wide, marks=pytest.mark.slow) for wide in (1.8, 2.2))])
def test_a_cap_is_found_as_one_thing(face, wide):
    exemplar, cap = capped(face, wide)
    mask = headwear(exemplar)
    assert mask is not None and mask.dtype == np.float32 and mask.shape == cap.shape
    assert mask.min() >= 0 and mask.max() <= 1
    found = mask > 0.5
    assert (found & cap).sum() / (found | cap).sum() > 0.9
    assert cv2.connectedComponents(found.astype(np.uint8))[0] == 2


def test_who_wears_nothing_has_no_hat(face):
    assert headwear(face) is None
    assert not_worn(face, ("hat",)) == ["drawn wears no hat: --wear hat changes nothing"]
    assert not_worn(face, ()) == []
    assert not_worn(capped(face, 1.8)[0], ("hat",)) == []


@pytest.mark.parametrize("quality", ["fast", pytest.param("best", marks=pytest.mark.slow)])
def test_it_is_put_on_when_asked_and_not_otherwise(face, quality):
    exemplar, _ = capped(face, 1.8)
    photo = drawn_face(300, 280, seed=1, hair=(120, 90, 60))
    regions = find_regions(photo.image, photo.landmarks, photo.mask, networks=False)
    right, down = regions.frame.local(photo.image.shape)
    half = 0.5 * regions.frame.width / regions.frame.height
    hat = (np.abs(right) < half) & (down > -0.85) & (down < -0.35)
    brim = (np.abs(right) > 1.3 * half) & (np.abs(right) < 1.7 * half) & (
        down > -0.38) & (down < -0.3)
    face_only = (np.abs(right) < 0.7 * half) & (down > 0) & (down < 0.9)
    forehead = (np.abs(right) < 0.6 * half) & (down > -0.4) & (down < -0.1)
    forehead &= np.abs(photo.image.astype(int) - SKIN).max(axis=-1) < 40
    made = {wear: transfer(photo.image, exemplar, TransferConfig(quality=quality, wear=wear),
                           photo.landmarks, regions=regions).image for wear in ((), ("hat",))}
    worn, bare = (greenish(made[wear]) for wear in (("hat",), ()))
    assert worn[hat].mean() > 0.95 and worn[brim].mean() > 0.9
    assert worn[face_only].mean() < 0.01
    assert bare[forehead].mean() < 0.02


@pytest.mark.slow  # a hat is put on above
@pytest.mark.parametrize("quality", ["fast", pytest.param("best", marks=pytest.mark.slow)])
def test_hair_that_would_stick_out_above_it_is_background(face, quality):
    exemplar, _ = capped(face, 1.8)
    photo = drawn_face(300, 280, seed=1)
    frame = photo.regions().frame
    middle = np.round(frame.point(np.array([0.7]), np.array([-0.8]))[0]).astype(int).tolist()
    bun = np.zeros(photo.mask.shape, np.uint8)
    cv2.circle(bun, middle, round(0.16 * frame.height), 1, -1)
    image = np.where(bun[..., None] > 0, np.uint8([60, 40, 30]), photo.image)
    regions = find_regions(image, photo.landmarks, np.maximum(photo.mask, bun), networks=False)
    made = {wear: transfer(image, exemplar, TransferConfig(quality=quality, wear=wear),
                           photo.landmarks, regions=regions).image for wear in ((), ("hat",))}
    stuck = (bun > 0) & ~greenish(made["hat",])
    assert stuck.mean() > 0.3 * bun.mean()
    ground = [np.abs(image - GROUND / 255).max(axis=-1) < 0.12 for image in made.values()]
    assert ground[0][stuck].mean() < 0.3
    assert ground[1][stuck].mean() > 0.8


def test_spectacles_are_accepted_and_change_nothing_yet(face):
    photo = drawn_face(300, 280, seed=1)
    regions = find_regions(photo.image, photo.landmarks, photo.mask, networks=False)
    images = [Transfer(face, TransferConfig(wear=wear), regions=face.regions()).apply(
        photo.image, photo.landmarks, regions=regions).image for wear in ((), ("spectacles",))]
    np.testing.assert_array_equal(*images)


@pytest.mark.slow  # a hat is put on above
def test_a_part_of_a_photo_keeps_its_rest_under_the_hat(face):
    exemplar, _ = capped(face, 1.8)
    photo = drawn_face(300, 280, seed=1)
    made = transfer(photo.image, exemplar, TransferConfig(extent="head", wear=("hat",)),
                    photo.landmarks, mask=photo.mask).image
    frame = find_regions(photo.image, photo.landmarks, photo.mask, networks=False).frame
    right, down = frame.local(photo.image.shape)
    half = 0.5 * frame.width / frame.height
    brim = (np.abs(right) > 1.3 * half) & (np.abs(right) < 1.7 * half) & (
        down > -0.38) & (down < -0.3)
    assert greenish(made)[brim].mean() > 0.9
    far = (down < 0.5) & (np.abs(right) > 2.1 * half)
    assert np.abs(made - photo.image / 255)[far].max() < 0.02


@pytest.fixture
def old_master(shared_data, shared_weights, monkeypatch, tmp_path):
    """Loads a painting by its name, or one reduced by a factor: a third of the work."""
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))

    def loaded(name, factor=1):
        path = shared_data / "paintings" / f"{name}.jpg"
        if not path.exists():
            pytest.skip("the painting is not in ../shared/data/paintings")
        if factor == 1:
            return Exemplar.load(path)
        with Image.open(path) as picture:
            picture.reduce(factor).save(tmp_path / f"{name}.png")
        return Exemplar.load(tmp_path / f"{name}.png")
    return loaded


@pytest.mark.parametrize(("name", "also_as_painted", "factor"), [
    pytest.param("chardin_spectacles", True, 2, id="chardin_spectacles reduced"),
    pytest.param("mona_lisa", True, 2, id="mona_lisa reduced"), *(
        pytest.param(name, not number % 2, 1, marks=pytest.mark.slow, id=name)
        for number, name in enumerate(PAINTINGS + BARE))])
def test_old_masters_hats_are_found(old_master, name, also_as_painted, factor):
    exemplar = old_master(name, factor)
    for version in (exemplar, frontalised(exemplar))[not also_as_painted:]:
        mask = headwear(version)
        assert (mask is not None) == (name in PAINTINGS)
        if mask is not None:
            right, down = version.regions().frame.local(mask.shape)
            face = (soft_face(mask.shape, version.landmarks) > 242) & (down > 0)
            assert mask[face].mean() < 0.02
            assert mask[(np.abs(right) < 0.3) & (down < -0.65) & (down > -0.8)].mean() > 0.5


def test_baring_keeps_what_is_worn(face):
    exemplar, _ = capped(face, 1.8)
    without = bared(exemplar)
    assert without.covered is not None
    np.testing.assert_array_equal(headwear(without.covered), headwear(exemplar))


@pytest.mark.parametrize(("name", "factor"), [("rubens_straw_hat", 2), *(
    pytest.param(name, 1, marks=pytest.mark.slow)
    for name in ("rubens_straw_hat", "vermeer_procuress_detail", "weyden_winged_bonnet"))])
def test_hair_is_that_beside_a_hat_of_another_color(old_master, name, factor):
    front = bared(frontalised(old_master(name, factor)), True)
    shown = name == "rubens_straw_hat"
    assert (front.hat is not None) == shown
    regions = front.regions()
    shares = known_shares(front, regions, regions.labels())
    hat = headwear(front.covered)
    hair = shares[..., HAIR] > 0.6
    assert hair.sum() > 0.1 * front.size ** 2
    if shown:
        assert hair[hat > 0.9].mean() < 0.01
        red, _, blue = np.median(front.image[hair], axis=0)
        assert red > blue + 15
