"""What a network takes for hair on a shaven head, told from hair; heads and ears from the side."""

import numpy as np
import pytest

from lfportrait.demo import demo_landmarks
from lfportrait.example.guides import regions as scalp
from lfportrait.example.guides.regions import Regions, find_regions, is_scalp, photo_regions
from lfportrait.face.landmarks import GENERIC_LANDMARKS
from lfportrait_eval.metrics import head_cameras
from tests.example.test_turned import posed
from tests.recordings import photographs

SIZE = 400
SKIN = np.array([0.85, 0.66, 0.58], np.float32)


def photo(crown, rough, sure=0.97, seed=0):
    """A head with a crown of a color and a roughness, lit from one side; and its regions."""
    points = posed(0.0, scale=160.0, shift=(200.0, 210.0)).project(GENERIC_LANDMARKS)
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    person = ((x - 200) / 75) ** 2 + ((y - 215) / 120) ** 2 < 1
    hair = person & (y < 165)
    light = np.float32(0.75 + 0.25 * x / SIZE)[..., None]
    image = np.where(hair[..., None], np.asarray(crown, np.float32), SKIN) * light
    grain = np.random.default_rng(seed).normal(size=(SIZE, SIZE, 1)).astype(np.float32)
    image = image + grain * np.where(hair, rough, 0.01)[..., None]
    image[~person] = 0.5
    mask = np.where(hair, np.float32(sure), np.float32(0))
    return np.clip(image, 0, 1).astype(np.float32), Regions(points, person.astype(np.float32), mask)


@pytest.mark.parametrize(("crown", "rough", "sure", "bare"), [
    (SKIN * 0.85, 0.006, 0.97, True),  # a shaven head's shaded half
    (SKIN * 0.85, 0.05, 0.97, False),  # fair hair
    (SKIN * 0.15, 0.006, 0.97, False),  # black hair, smooth and dark
    ((0.45, 0.28, 0.16), 0.04, 0.97, False),  # brown hair
    (SKIN, 0.01, 0.5, True),  # a network that is not sure, and nothing but skin
    ((0.2, 0.4, 0.7), 0.01, 0.5, False),  # not sure, but blue
])
def test_a_scalp_is_smooth_and_of_the_faces_color(crown, rough, sure, bare):
    image, regions = photo(crown, rough, sure)
    assert is_scalp(image, regions) == bare
    assert is_scalp((image * 255).astype(np.uint8), regions) == bare


def test_nothing_is_told_from_a_few_pixels():
    image, regions = photo(SKIN, 0.006)
    tiny = np.zeros_like(regions.person)
    tiny[95:99, 195:205] = 1
    assert not is_scalp(image, Regions(regions.landmarks, regions.person, tiny))


def test_a_scalp_is_no_hair_of_a_photo(monkeypatch):
    for crown, bare in ((SKIN * 0.85, True), ((0.2, 0.15, 0.1), False)):
        image, regions = photo(crown, 0.006)
        monkeypatch.setattr(scalp, "find_regions", lambda *_, regions=regions, **__: regions)
        found = photo_regions(image, regions.landmarks)
        assert (found.hair is None) == bare and np.array_equal(found.person, regions.person)


def test_hair_that_only_colors_see_is_none_in_a_photo(monkeypatch):
    # The shaded half of a shaven head is of another color than the lit half.
    image, regions = photo(SKIN * 0.45, 0.01)
    for seen, hair in ((0.0, False), (0.3, True)):
        answer = np.where(regions.hair > 0.5, np.float32(seen), np.float32(0))
        monkeypatch.setattr("lfportrait.example.guides.regions._networks",
                            lambda *_, answer=answer: (regions.person, answer))
        monkeypatch.setattr(scalp, "is_scalp", lambda *_: False)
        assert (photo_regions(image, regions.landmarks).hair is not None) == hair
        # Of paintings, which the network knows less of, colors say it alone.
        assert find_regions(image, regions.landmarks).hair is not None


def test_small_faces_are_seen_larger_by_the_network(monkeypatch):
    image, regions = photo(SKIN * 0.2, 0.05)
    asked = []

    def find(picture, *_, size, **__):
        asked.append(size)
        return regions

    monkeypatch.setattr(scalp, "find_regions", find)
    photo_regions(image, regions.landmarks, regions.person)
    photo_regions(np.pad(image, ((0, 900), (0, 0), (0, 0))), regions.landmarks, regions.person)
    assert asked[0] < asked[1]


@pytest.mark.parametrize(("bridge", "kept"), [(0, False), (12, False), (90, True)])
def test_what_hangs_on_the_person_by_little_is_none_of_it(monkeypatch, bridge, kept):
    image, regions = photo(SKIN * 0.2, 0.05)
    person = regions.person.copy()
    person[250:390, 330:] = 1
    person[385 - bridge:385, 200:340] = 1
    whole = Regions(regions.landmarks, person, regions.hair)
    monkeypatch.setattr(scalp, "find_regions", lambda *_, **__: whole)
    found = photo_regions(image, regions.landmarks)
    assert (found.person[300, 370] > 0.5) == kept
    assert (found.person[110:320, 190:210] == 1).all()
    # A mask that is given is known.
    assert photo_regions(image, regions.landmarks, person).person is person


# The other side is a mirror image.
@pytest.mark.parametrize("yaw", [-65.0, pytest.param(65.0, marks=pytest.mark.slow)])
def test_a_head_seen_from_the_side_is_a_person(monkeypatch, yaw):
    # The back of the head is as far behind the face as a profile shows it.
    pose = posed(yaw, scale=120.0, shift=(200.0 + 0.4 * yaw, 190.0))
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    person = (((x - 200) / 105) ** 2 + ((y - 175) / 105) ** 2 < 1) | (
        (np.abs(x - 200) < 60) & (y > 200))
    person = person.astype(np.float32)
    monkeypatch.setattr("lfportrait.example.guides.regions._networks", lambda *_: (person, None))
    image = np.full((SIZE, SIZE, 3), 128, np.uint8)
    image[person > 0.5] = (200, 150, 130)
    found = find_regions(image, pose.project(GENERIC_LANDMARKS))
    assert found.person is person
    # Beside a frontal face that much is no head.
    monkeypatch.setattr("lfportrait.example.guides.regions._networks",
                        lambda *_: (np.ones_like(person), None))
    found = find_regions(image, pose.project(GENERIC_LANDMARKS))
    assert found.person.mean() < 0.9


@pytest.mark.parametrize("yaw", [-70.0, 70.0])
def test_the_ear_of_a_head_in_profile_is_no_hair(yaw):
    marks = demo_landmarks()
    cameras = head_cameras(marks, (yaw,), SIZE, room=1.25, back=0.25)
    picture = photographs(f"profile_{yaw:.0f}", cameras, "surface")[0]
    person = picture.image[..., 3] / np.float32(255)
    found = find_regions(picture.image[..., :3], cameras.project(marks)[0][0], person,
                         networks=False)
    behind, down = found.frame.local((SIZE, SIZE))
    behind = -np.sign(found.frame.turn(found.landmarks)) * behind
    head = (person > 0.99) & (down < 1)
    ear = head & (picture.more == 0) & (behind > 0.7) & (down < 0.5)
    hair = head & (picture.more == 1)
    assert ear.sum() > 200
    assert found.hair[ear].mean() < 0.3 and found.hair[hair].mean() > 0.9
