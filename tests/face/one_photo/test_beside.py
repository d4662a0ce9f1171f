"""People beside the sitter of a photo are cut away, and nothing of the sitter's is."""

import cv2
import numpy as np
import pytest

from lfportrait.face import GENERIC_LANDMARKS
from lfportrait.face.head_fit import ear_to_ear
from lfportrait.face.one_photo import beside, portrait

SIZE = (300, 420)
WALL, SKIN, SUIT, COAT = (200, 205, 210), (205, 160, 135), (40, 45, 60), (120, 60, 40)


def landmarks(x, y, width):
    """Those of a face with its eyes at a place."""
    flat = GENERIC_LANDMARKS[:, :2] * [1.0, -1.0]
    flat = flat / ear_to_ear(flat) * width
    return flat - flat[36:48].mean(axis=0) + [x, y]


def disc(x, y, wide, high):
    return cv2.ellipse(np.zeros(SIZE, np.uint8), ((x, y), (2 * wide, 2 * high), 0), 1, -1) > 0


FACE = landmarks(200, 90, 90)
SITTER = disc(200, 105, 46, 65) | disc(200, 300, 120, 140) | disc(200, 180, 26, 40)


class Scene:
    """A photo that is painted from behind, and what its networks say of it."""

    def __init__(self):
        self.grain = np.random.default_rng(3).normal(0, 6, (*SIZE, 1))
        self.image = np.array(WALL) + self.grain
        self.people = np.zeros(SIZE, bool)
        self.hair = np.zeros(SIZE, np.float32)
        self.faces = [FACE]

    def add(self, mask, color, blurred=False):
        soft = cv2.GaussianBlur(mask.astype(np.float64), (0, 0), 6.0)[..., None] if blurred \
            else mask[..., None]
        self.image += soft * (np.array(color) + (0 if blurred else self.grain) - self.image)
        self.people |= mask
        return self

    def sitter(self):
        self.add(SITTER, SUIT).add(disc(200, 105, 46, 65), SKIN)
        for x, y in FACE[17:]:
            cv2.circle(self.image, (round(x), round(y)), 2, (165, 120, 100), -1)
        return self

    def alone(self, monkeypatch, look=None, found=None):
        """What is left of the matte; ``look`` are the people that are seen from near."""
        image = np.clip(self.image, 0, 255).astype(np.uint8)
        shown = self.people if look is None else look
        # A crop's place is found by its bytes: the networks see nothing else.
        monkeypatch.setattr(beside, "person_matte", lambda part: shown[_place(image, part)])
        monkeypatch.setattr(beside, "detect_faces", lambda image, near: found or [])
        return beside.sitter_alone(image, self.people.astype(np.float32), self.hair, self.faces)


def _place(image, part):
    rows, columns = part.shape[:2]
    for row in range(SIZE[0] - rows + 1):
        for column in range(SIZE[1] - columns + 1):
            if (image[row, column:column + columns] == part[0]).all():
                return np.s_[row:row + rows, column:column + columns]
    raise AssertionError


def parted(left, other):
    """Shares of the sitter and of somebody else that are left."""
    return left[SITTER].mean(), left[other & ~SITTER].mean()


def test_a_sitter_alone_stays(monkeypatch):
    assert Scene().sitter().alone(monkeypatch) is None


# The other side is a mirror image.
@pytest.mark.parametrize("x", [330, pytest.param(70, marks=pytest.mark.slow)])
def test_somebody_out_of_focus_behind_a_shoulder_goes(monkeypatch, x):
    other = disc(x, 100, 60, 70) | disc(x, 170, 45, 80)
    left = Scene().add(other, COAT, blurred=True).sitter().alone(monkeypatch)
    mine, theirs = parted(left, other)
    assert mine > 0.985 and theirs < 0.12


def test_a_hand_that_is_held_up_stays(monkeypatch):
    """It is as sharp as the face."""
    arm = disc(335, 130, 25, 60) | disc(320, 220, 22, 60)
    assert Scene().sitter().add(arm, SKIN).alone(monkeypatch) is None


@pytest.mark.slow  # others beside: above
def test_a_sharp_face_beside_goes_with_what_it_wears(monkeypatch):
    other = disc(335, 110, 40, 55) | disc(345, 190, 45, 80)
    scene = Scene().add(other, COAT).add(disc(335, 110, 40, 55), SKIN).sitter()
    assert scene.alone(monkeypatch) is None, "it may be a hand"
    mine, theirs = parted(scene.alone(monkeypatch, found=[landmarks(335, 100, 70)]), other)
    assert mine > 0.985 and theirs < 0.12
    scene.faces.append(landmarks(335, 100, 70))
    mine, theirs = parted(scene.alone(monkeypatch), other)
    assert mine > 0.985 and theirs < 0.12


def test_a_face_that_is_printed_on_a_shirt_stays(monkeypatch):
    scene = Scene().sitter()
    scene.faces.append(landmarks(255, 235, 60))
    assert scene.alone(monkeypatch) is None


@pytest.mark.slow  # others beside: here, too
def test_a_face_in_the_sitters_curls_is_none(monkeypatch):
    curls = disc(200, 80, 115, 75)
    scene = Scene().add(curls, COAT).sitter()
    scene.hair[curls & ~SITTER] = 1
    found = [landmarks(290, 80, 28)]
    assert scene.alone(monkeypatch, found=found) is None
    scene.hair[:] = 0
    assert scene.alone(monkeypatch, found=found) is not None


@pytest.mark.slow  # others beside: here, too
def test_hair_that_is_not_the_sitters_is_somebody_elses(monkeypatch):
    other = disc(335, 110, 40, 55) | disc(345, 190, 45, 80)
    scene = Scene().add(other, COAT).sitter()
    scene.hair[disc(335, 80, 38, 30) & ~SITTER] = 1
    mine, theirs = parted(scene.alone(monkeypatch), other)
    assert mine > 0.985 and theirs < 0.12
    lock = disc(270, 75, 80, 12)  # now it hangs together with the sitter's
    scene.add(lock, COAT).hair[lock] = 1
    assert scene.alone(monkeypatch) is None


def test_a_crowd_that_is_not_seen_from_near_goes(monkeypatch):
    crowd = np.zeros(SIZE, bool)
    crowd[205:, :] = True
    left = Scene().add(crowd, COAT).sitter().alone(monkeypatch, look=SITTER)
    mine, theirs = parted(left, crowd)
    assert mine > 0.985 and theirs < 0.12


def test_what_is_apart_goes_and_nothing_else_changes(monkeypatch):
    other = disc(30, 80, 28, 40)
    left = Scene().add(other, COAT).sitter().alone(monkeypatch)
    assert (left[SITTER] == 1).all() and left[other].max() == 0
    speck = Scene().add(disc(30, 80, 6, 6), COAT).sitter()
    assert speck.alone(monkeypatch) is None


def test_ground_that_is_not_seen_from_near_counts_half(monkeypatch):
    soft, hair = SITTER.astype(np.float32), np.zeros(SIZE, np.float32)
    wall, curls, body = disc(260, 90, 12, 20), disc(140, 90, 12, 20), disc(200, 250, 9, 9)
    soft[wall], soft[curls], hair[curls] = 0.6, 0.6, 0.9
    look = SITTER & ~body
    scene = Scene().sitter()
    image = np.clip(scene.image, 0, 255).astype(np.uint8)
    monkeypatch.setattr(beside, "person_matte",
                        lambda part: look[_place(image, part)].astype(np.float32))
    left = beside.seen_from_near(image, soft, hair, FACE)
    np.testing.assert_allclose(left[wall], 0.3)
    left[wall] = soft[wall]
    np.testing.assert_array_equal(left, soft, "hair stays, and what was sure")


def test_a_bust_is_of_one_piece_with_its_loose_hair():
    matte = SITTER.astype(np.float32)
    curl, hand = disc(243, 60, 5, 5), disc(60, 60, 16, 16)
    matte[curl], matte[hand] = 0.9, 1.0
    soft = cv2.GaussianBlur(matte, (0, 0), 1.0)
    left = beside.in_one_piece(soft, FACE)
    assert left[:110, :90].max() == 0, "the hand goes, with its soft border"
    np.testing.assert_array_equal(left[:, 120:], soft[:, 120:])
    assert beside.in_one_piece(left, FACE) is left
    assert beside.in_one_piece(soft, FACE + 1000) is soft, "a face beside the photo says nothing"


def test_a_walk_ends_where_it_is_likely_to():
    random = np.random.default_rng(0)
    colors = random.normal(0, 2, (5, 6, 3)).astype(np.float32)
    domain = random.random((5, 6)) < 0.8
    mine, theirs = random.random((2, 5, 6))
    places = np.argwhere(domain)
    matrix, right = np.zeros((len(places),) * 2), mine[domain]
    for i, one in enumerate(places):
        matrix[i, i] += mine[tuple(one)] + theirs[tuple(one)]
        for j, two in enumerate(places):
            if abs(one - two).sum() == 1:
                apart = colors[tuple(one)].astype(float) - colors[tuple(two)]
                weight = np.exp(-beside.EDGES * (apart ** 2).sum()) + beside.LEAK
                matrix[i, i] += weight
                matrix[i, j] -= weight
    share = beside.walker(colors, domain, mine, theirs)
    np.testing.assert_allclose(share[domain], np.linalg.solve(matrix, right), atol=1e-6)
    assert (share[~domain] == 0).all() and share.max() <= 1


def test_it_is_said_that_others_are_cut_away(monkeypatch):
    image = np.zeros((40, 40, 3), np.uint8)
    matte = np.zeros((40, 40), np.float32)
    matte[10:] = 1
    monkeypatch.setattr(portrait.models, "available", lambda name: True)
    monkeypatch.setattr(portrait, "hair_mask", lambda image: matte)
    monkeypatch.setattr(portrait, "refine_matte", lambda image, matte: matte)
    monkeypatch.setattr(portrait, "seen_from_near", lambda image, matte, *given: matte)
    monkeypatch.setattr(portrait, "sitter_alone", lambda *given: None)
    assert portrait._matte_of(image, matte, [FACE], "her.jpg") is matte
    monkeypatch.setattr(portrait, "sitter_alone", lambda *given: 0.5 * matte)
    with pytest.warns(UserWarning, match=r"her\.jpg shows other people"):
        assert portrait._matte_of(image, matte, [FACE], "her.jpg").max() == 0.5


def test_a_face_where_nobody_is_is_none():
    leaves = landmarks(340, 60, 80)
    matte = SITTER.astype(np.float32)
    assert [id(one) for one in beside.faces_of_people([leaves, FACE], matte)] == [id(FACE)]
    both = np.maximum(matte, disc(340, 60, 50, 60))
    assert len(beside.faces_of_people([leaves, FACE], both)) == 2
    # A matte that sees nobody decides nothing; nor does a face beyond the picture's edge.
    away = landmarks(2000, 60, 80)
    assert len(beside.faces_of_people([away, FACE], np.zeros(SIZE, np.float32))) == 2
    assert [id(one) for one in beside.faces_of_people([away, FACE], matte)] == [id(FACE)]
