"""A beard below the jaw: where photos show it, and what it hangs from."""

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from lfportrait.capture import Camera
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo import beard
from lfportrait.face.one_photo.beard import BEARD, _hung_from, beard_of, beneath
from lfportrait.face.one_photo.lattice import shell_of
from lfportrait.face.one_photo.paint import Shot, painted
from lfportrait.face.one_photo.parts import parts_of
from lfportrait.face.one_photo.piece import METRES
from lfportrait.face.one_photo.samples import MeshSamples
from lfportrait.face.one_photo.solid import HEAD, Solid, solid_of
from lfportrait.field import C0

SIDE, LONG = 400, 45
SKIN, HAIR, SHIRT = (np.float32(color) for color in ([0.80, 0.60, 0.50], [0.24, 0.17, 0.13],
                                                     [0.20, 0.25, 0.40]))


@pytest.fixture(scope="module")
def head() -> tuple[Camera, MeshSamples, np.ndarray]:
    prior = generic_prior()
    points = prior.mean.astype(float) / METRES
    points[:, 2] -= points[:, 2].mean()
    points[:, 1] -= points[prior.landmarks[30], 1]
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=600.0,
                        target=(0, 0, 0), pitch=0.0)
    landmarks = camera.project(points[prior.landmarks])[0][0]
    return camera, MeshSamples.of(points, prior.outer, prior.rest), landmarks


def photo(landmarks: np.ndarray, length: int, shade: float = 1.0, color: np.ndarray = HAIR,
          wide: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sitter in a shirt, uint8, whose beard ends ``length`` pixels below the jaw, or has none.

    Also the matte, and where the beard is below the jaw. ``shade`` darkens the throat; the beard
    stands out by ``wide`` pixels beside the jaw.
    """
    generator = np.random.default_rng(3)
    face = np.zeros((SIDE, SIDE), np.uint8)
    outline = np.vstack([landmarks[:17], landmarks[26:16:-1] - [0, 60]])
    cv2.fillPoly(face, [np.rint(outline).astype(np.int32)], 1)
    middle, chin = landmarks[8]
    rows, columns = np.indices(face.shape)
    throat = (np.abs(columns - middle) < 45) & (rows > chin - 40) & (rows < chin + 75)
    shirt = (rows >= chin + 60) & (np.abs(columns - middle) < 45 + 1.5 * (rows - chin - 50))
    image = np.ones((SIDE, SIDE, 3), np.float32)
    image[throat] = SKIN * shade
    image[face > 0] = SKIN
    image[shirt] = SHIRT
    beard = np.zeros(face.shape, np.uint8)
    if length:
        jaw = np.rint(landmarks[3:14]).astype(np.int32)
        end = jaw + np.array([0, length], np.int32)
        cv2.fillPoly(beard, [np.vstack([jaw, end[::-1]])], 1)
        cv2.fillPoly(beard, [np.rint(np.vstack([landmarks[3:14], landmarks[[54, 48]]])
                                     ).astype(np.int32)], 1)
        whiskers = np.rint(landmarks[[3, 4, 5, 11, 12, 13]]).astype(np.int32)
        for x, y in whiskers if wide else []:
            cv2.circle(beard, (int(x), int(y)), wide, 1, -1)
        strands = color * generator.uniform(0.4, 1.6, (SIDE, SIDE, 1)).astype(np.float32)
        image[beard > 0] = strands[beard > 0]
    person = (face > 0) | throat | shirt | (beard > 0)
    return (np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8), person.astype(np.float32),
            (beard > 0) & (face == 0))


@pytest.mark.parametrize("length", [15, 30, LONG])
def test_beards_are_found_as_far_as_they_reach(head, length):
    image, matte, beard = photo(head[2], length)
    shown = beard_of(image, matte, head[2])
    assert shown is not None
    found = shown.below
    assert (found & beard).sum() > 0.7 * (found | beard).sum()
    chin, cheek = (np.rint(head[2][list(marks)].mean(axis=0)).astype(int)
                   for marks in ((8, 57), (31, 2, 41)))
    assert shown.whole[chin[1], chin[0]] > 0.9 and shown.whole[cheek[1], cheek[0]] < 0.1


def test_a_beard_may_be_as_white_as_the_hair(head):
    image, matte, beard = photo(head[2], LONG, color=np.float32([0.85, 0.84, 0.82]))
    assert beard_of(image, matte, head[2]) is None, "it may be wool"
    hair = np.zeros((SIDE, SIDE), np.float32)
    hair[:int(head[2][19, 1]) - 20, 150:250] = 1.0
    for color, white in ((0.85, True), (0.15, False)):
        image[hair > 0] = np.uint8(255 * color)
        shown = beard_of(image, np.maximum(matte, hair), head[2], hair)
        assert (shown is not None) == white
        if shown is not None:
            assert (shown.below & beard).sum() > 0.7 * (shown.below | beard).sum()


def test_whiskers_beside_a_jaw_are_of_the_beard(head):
    bare, shown = (photo(head[2], LONG, wide=wide) for wide in (0, 14))
    beside = (shown[1] > 0.5) & (bare[1] < 0.5)
    assert beside.sum() > 200
    found = beard_of(shown[0], shown[1], head[2])
    assert found is not None and (found.whole > 0.5)[beside].mean() > 0.5


@pytest.mark.parametrize("shade", [1.0, 0.5, 0.3])
def test_a_chin_without_a_beard_has_none_below(head, shade):
    image, matte, _ = photo(head[2], 0, shade)
    assert beard_of(image, matte, head[2]) is None


@pytest.mark.parametrize("light, bearded", [(0.5, True), (0.29, False)])
def test_the_shade_below_a_chin_with_stubble_is_no_beard(head, light, bearded, monkeypatch):
    image, matte, below = photo(head[2], LONG, color=1.4 * HAIR)
    locks = (np.arange(SIDE) // 16 % 2 == 0)[None]
    hairs = (np.abs(image - 255 * 1.4 * HAIR).max(axis=2) < 60) & ~below
    image[hairs & locks] = np.rint(0.55 * image[hairs & locks])
    image[below] = np.rint(light * image[below])
    assert (beard_of(image, matte, head[2]) is not None) == bearded
    monkeypatch.setattr(beard, "CAST", 9.0)
    found = beard_of(image, matte, head[2])
    assert found is not None and found.below.sum() > 1000, "one by all else"


def test_a_chin_half_of_which_lies_in_shade_has_no_beard(head):
    image, matte, _ = photo(head[2], 0)
    dark = image.copy()
    dark[:, :int(head[2][8, 0])] = (0.25 * dark[:, :int(head[2][8, 0])]).astype(np.uint8)
    assert beard_of(dark, matte, head[2]) is None


def test_a_chin_in_uneven_shade_has_no_beard(head):
    image, matte, beard = photo(head[2], LONG)
    generator = np.random.default_rng(2)
    lower = beard | ((image.astype(int).sum(axis=2) < 300) & (matte > 0.5))
    # As red as skin in light, and a little less even.
    shade = SKIN ** 2.2 * 0.12 * generator.uniform(0.85, 1.15, (SIDE, SIDE, 1))
    image[lower] = np.rint(255 * shade ** (1 / 2.2)).astype(np.uint8)[lower]
    assert beard_of(image, matte, head[2]) is None


def with_beard(head: tuple[Camera, MeshSamples, np.ndarray], shown: bool) -> Solid:
    camera, samples, landmarks = head
    _, matte, beard = photo(landmarks, LONG)
    parts = parts_of(camera, matte, np.zeros_like(matte), 4.0, None, beard if shown else None)
    return solid_of(parts, samples)


def front(solid: Solid, down: float, x: float = 0.0) -> tuple[float, int]:
    """How far ahead a solid reaches so far below its chin, and what is there."""
    chin = solid.head.points[np.argmin(np.linalg.norm(solid.head.rest - [0, 0, 0.09], axis=1))]
    z = np.linspace(1.2, -0.6, 400)
    line = np.stack([np.full(400, x), np.full(400, chin[1] - down), z], axis=1)
    away, owner = solid.distance(line, 0.5)
    first = int(np.argmax(away < 0))
    return float(z[first]), int(owner[first])


def test_a_beard_hangs_from_the_chin_and_not_on_the_throat(head):
    bearded, bare = with_beard(head, True), with_beard(head, False)
    below = 0.5 * LONG / 600 * 4.0
    ahead, owner = front(bearded, below)
    throat, _ = front(bare, below)
    assert owner == BEARD
    assert ahead > throat + 0.1, "it lies on the throat"
    # It begins where the chin ends, and recedes with the jaw.
    lip, owner = front(bearded, -0.12)
    assert owner == HEAD and abs(lip - front(bare, -0.12)[0]) < 0.01
    assert abs(ahead - lip) < 0.15
    assert front(bearded, below, 0.25)[0] < ahead - 0.05


def test_a_beard_below_a_chin_that_is_held_up_is_no_slab_apart_from_it(head):
    _, samples, _ = head
    prior = generic_prior()
    points = prior.mean.astype(float) / METRES
    points[:, 2] -= points[:, 2].mean()
    points[:, 1] -= points[prior.landmarks[30], 1]
    below = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=600.0,
                       target=(0, 0, 0), pitch=-22.0)  # it sees the nape below the chin
    landmarks = below.project(points[prior.landmarks])[0][0]
    bearded = with_beard((below, samples, landmarks), True)
    chin = bearded.head.points[np.argmin(np.linalg.norm(bearded.head.rest - [0, 0, 0.09], axis=1))]
    for down in np.linspace(0.03, 0.16, 6):
        ahead, owner = front(bearded, down)
        assert owner == BEARD
        assert ahead > chin[2] - 0.08, "a gap between the two"


@pytest.mark.slow  # a head once more
def test_what_no_photo_shows_is_bearded_or_bare_and_nothing_between(head):
    camera, _, landmarks = head
    below = photo(landmarks, LONG)[2]
    whole = below.copy()
    jaw = np.zeros((SIDE, SIDE), np.uint8)
    cv2.fillPoly(jaw, [np.rint(np.vstack([landmarks[1:16], landmarks[[54, 48]]])
                               ).astype(np.int32)], 1)
    whole |= jaw > 0
    colors = np.where(whole[..., None], np.float32(0.1), np.float32(0.7)).repeat(3, axis=2)
    shell = shell_of(with_beard(head, True), 80)
    sh, grown, _ = painted(shell, [Shot.of(camera, colors, None, None, whole.astype(np.float32),
                                           beneath(below, 150.0))])
    shade = sh[:, 0, 0] * C0 + 0.5
    assert grown is not None
    near = shell.owner == HEAD
    near[near] = cKDTree(shell.on[shell.owner == BEARD]).query(shell.on[near])[0] < 0.02
    assert near.sum() > 50 and (shade[near & ~shell.face] < 0.3).mean() > 0.9
    back = (shell.owner == HEAD) & (shell.on[:, 2] < -0.2) & (shell.on[:, 1] > 0)
    assert back.sum() > 50 and shade[back].min() > 0.6 and grown[back].max() < 30


@pytest.mark.slow  # a head once more
def test_a_beard_without_a_shape_is_of_the_skins_color(head):
    camera, _, landmarks = head
    below = photo(landmarks, LONG)[2].astype(np.float32)
    colors = np.where(below[..., None] > 0, np.float32(0.2), np.float32(0.7)).repeat(3, axis=2)
    shell = shell_of(with_beard(head, False), 64)
    with_map, without = (painted(shell, [Shot.of(camera, colors, None, None, one)])
                         for one in (below, None))
    assert np.array_equal(with_map[0], without[0])
    # Nothing grows there, and that is known.
    assert with_map[1] is not None and not with_map[1].any()


def test_what_lies_below_a_beard_does_not_color_it(head):
    _, _, beard = photo(head[2], LONG)
    mixed = beneath(beard, 150.0)
    chin = np.rint(head[2][8]).astype(int)
    assert mixed[chin[1] + 20, chin[0]] < 0.05
    assert mixed[chin[1] + LONG + 3, chin[0]] > 0.9


def test_a_beard_hangs_down_the_head_however_the_photo_is_turned():
    face = np.full((80, 80), np.nan)
    face[:40] = 3.0
    face[:40, 40:] = 3.5
    beard = np.zeros(face.shape, bool)
    beard[40:70, 10:70] = True
    start, length = _hung_from(face, beard, np.array([1.0, 0.0]))
    assert (start[40:70, 10:40] == 3.0).all() and (start[40:70, 40:70] == 3.5).all()
    assert np.array_equal(length[40:70, 20], np.arange(1, 31))
    turned = np.array([np.cos(0.6), np.sin(0.6)])
    start, length = _hung_from(face, beard, turned)
    assert start[69, 41] == 3.0, "up the head is left of it in the photo"
    assert abs(length[60, 50] - 21 / np.cos(0.6)) < 2
    # Up from there lies nothing.
    narrow = np.where(np.arange(80) < 30, face, np.nan)
    start, length = _hung_from(narrow, beard, np.array([1.0, 0.0]))
    assert np.isnan(start[60, 50]) and length[60, 50] <= 30


def test_a_beard_that_the_photo_cuts_off_goes_on_below_it(head):
    camera, samples, landmarks = head
    _, matte, beard = photo(landmarks, LONG)
    end = int(landmarks[8, 1]) + 20
    cut = Camera(camera.pose, camera.focal, camera.center, camera.width, np.array([end]))
    parts = parts_of(cut, matte[:end], np.zeros((end, SIDE)), 4.0, None, beard[:end])
    solid = solid_of(parts, samples)
    for down in np.linspace(4, 18, 4) / 600 * 4.0:
        assert front(solid, down)[1] == BEARD


def test_cloth_before_a_chin_is_no_beard(head):
    image, matte, beard = photo(head[2], LONG)
    generator = np.random.default_rng(0)
    for color in ([0.7, 0.1, 0.1], [0.2, 0.3, 0.7], [0.95, 0.95, 0.95]):
        worn = image.copy()
        lower = (image.astype(int).sum(axis=2) < 300) & (matte > 0.5)
        cloth = np.float32(color) * generator.uniform(0.9, 1.1, (SIDE, SIDE, 1))
        worn[lower] = np.rint(255 * np.clip(cloth, 0, 1)).astype(np.uint8)[lower]
        assert beard_of(worn, matte, head[2]) is None
    plain = np.where(beard[..., None] | (image.astype(int).sum(axis=2) < 300)[..., None],
                     np.uint8([40, 40, 40]), image)
    assert beard_of(plain, matte, head[2]) is None, "a scarf is smooth"


def test_hair_that_hangs_beside_a_jaw_is_no_beard(head):
    image, matte, _ = photo(head[2], 15)
    generator = np.random.default_rng(1)
    hair = np.zeros((SIDE, SIDE), np.float32)
    left, right = head[2][2, 0], head[2][14, 0]
    columns = np.arange(SIDE)
    top, end = int(head[2][19, 1]) - 30, int(head[2][8, 1]) + 40
    hair[top:end] = (np.abs(columns - left) < 12) | (np.abs(columns - right) < 12)
    strands = HAIR * generator.uniform(0.4, 1.6, (SIDE, SIDE, 1))
    long = np.where(hair[..., None] > 0, np.rint(255 * strands).astype(np.uint8), image)
    shown = beard_of(long, np.maximum(matte, hair), head[2], hair)
    assert shown is None or (shown.below & (hair > 0)).sum() < 0.1 * shown.below.sum()
