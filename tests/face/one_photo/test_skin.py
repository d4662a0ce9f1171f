"""The sides of a face that a photo shows, and what it shows before and beside them."""

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo.beard import BEARD
from lfportrait.face.one_photo.paint import ABOUT, DEEP, Look, Shot, _Depths
from lfportrait.face.one_photo.piece import METRES
from lfportrait.face.one_photo.samples import MeshSamples
from lfportrait.face.one_photo.skin import clothes, not_skin, open_mouth
from lfportrait.face.one_photo.solid import BODY, HAIR, HEAD
from tests.fields import shell_field

from .generic import generic_head

SIDE = 320
SKIN = np.float32([0.82, 0.62, 0.52])


def depths(depth: np.ndarray, face: np.ndarray | float = np.inf, near: np.ndarray | float = 0.0,
           turned: float = 0.0) -> _Depths:
    """Of a picture [h, w] without edges, whose ``face`` is ``near``."""
    ones = np.ones_like(depth)
    return _Depths(depth, depth, depth, face * ones, near * ones, 0.01, turned)



@pytest.fixture(scope="module")
def head() -> tuple[Camera, MeshSamples, np.ndarray]:
    points, samples = generic_head()
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=700.0,
                        target=(0, 0, 0), pitch=0.0)
    landmarks = camera.project(points[generic_prior().landmarks])[0][0]
    return camera, samples, landmarks


def shaded() -> np.ndarray:
    """Skin that is darker by a half on one side of the picture than on the other."""
    light = np.linspace(1.0, 0.5, SIDE, dtype=np.float32)
    return np.tile(light[None, :, None] * SKIN, (SIDE, 1, 1))


def cheek(head: tuple[Camera, MeshSamples, np.ndarray]) -> tuple[int, int]:
    """A pixel at the side of the right cheek, which the photo looks at in passing."""
    camera, samples, _ = head
    to_eye = camera.position[0] - samples.points
    cosine = (samples.normals * to_eye).sum(axis=1) / np.linalg.norm(to_eye, axis=1)
    place = (np.abs(samples.rest[:, 1] - 0.05) < 0.004) & (np.abs(cosine - 0.4) < 0.1)
    place &= samples.rest[:, 0] > 0.03
    column, row = camera.project(samples.points[place])[0][0].mean(axis=0)
    return int(row), int(column)


def test_shade_is_skin_and_what_lies_before_a_cheek_is_not(head):
    camera, samples, landmarks = head
    assert not_skin(shaded(), None, landmarks, camera, samples).max() == 0
    row, column = cheek(head)
    worn = shaded()
    worn[row - 8:row + 8, column - 3:column + 20] = [0.9, 0.9, 0.95]
    found = not_skin(worn, None, landmarks, camera, samples)
    assert found[row, column] > 0.9
    assert found[:, :column - 16].max() < 0.1, "the other cheek is skin"
    assert found[:row - 20].max() < 0.1 and found[row + 20:].max() < 0.1


def test_what_is_before_skin_colors_hair_and_body_alone(head):
    camera, samples, landmarks = head
    row, column = cheek(head)
    worn = shaded()
    worn[row - 8:row + 8, column - 3:column + 20] = [0.1, 0.1, 0.3]
    other = not_skin(worn, None, landmarks, camera, samples)
    shot = Shot.of(camera, worn, None, other)
    origin, ray = camera.rays(0, np.array([[column + 0.5, row + 0.5]]))
    point = origin + 4.0 * ray
    towards = (origin - point) / np.linalg.norm(origin - point)
    depth = np.full((SIDE, SIDE), 10.0)
    for skin, least, most in ((True, 0.0, 0.1), (False, 0.99, 1.0)):
        weight = shot.look(point, towards, depths(depth), 0.02,
                           np.array([HEAD if skin else BODY], np.uint8)).weight[0]
        assert least <= weight <= most


def test_a_bare_neck_is_skin_in_whatever_light_it_lies(head):
    camera, samples, landmarks = head
    lit = shaded()
    below = int(landmarks[8, 1]) + 8
    lit[below - 4:] = [0.2, 0.2, 0.6]
    bare = np.zeros((SIDE, SIDE), np.float32)
    found, known, worn = (not_skin(lit, None, landmarks, camera, samples, one)
                          for one in (None, bare, bare + 1))
    assert found[below:].max() > 0.9 and known[below:].max() < 0.1
    assert np.array_equal(worn, found), "clothes are none"


class Walls:
    """A wall that hides another one 2 cm behind it on the left of a picture, as a field is drawn.

    The right quarter of the picture is empty.
    """

    def depth(self, camera: Camera, _: int) -> tuple[np.ndarray, np.ndarray]:
        width, height = int(camera.width[0]), int(camera.height[0])
        depth = np.full((height, width), 4.0)
        depth[:, :width // 2] -= 0.02 / METRES
        alpha = np.ones_like(depth)
        alpha[:, 3 * width // 4:] = 0
        return alpha, depth


class Nothing(Walls):
    """Nothing at all."""

    def depth(self, camera: Camera, view: int) -> tuple[np.ndarray, np.ndarray]:
        alpha, depth = super().depth(camera, view)
        return 0 * alpha, depth


@pytest.mark.parametrize("yaw, least, most", [(0.0, 0.99, 1.0), (20.0, 0.0, 0.1)])
@pytest.mark.parametrize("size", [SIDE, 80])
def test_beside_the_edge_of_a_turned_nose_a_photo_says_nothing(yaw, least, most, size):
    camera = Camera.arc(np.array([yaw]), distance=4.0, width=SIDE, height=SIDE, focal=700.0,
                        target=(0, 0, 0), pitch=0.0)
    solid = _Depths.of(Walls(), Nothing(), camera.scaled(size / SIDE), 0.02)
    assert solid.near.max() == 0
    shot, far = Shot.of(camera, shaded(), None), 0.03 / METRES * 175  # Pixels.
    for column, low, high in ((SIDE / 2 + 1.5, least, most), (SIDE / 2 - 0.5, least, most),
                              (SIDE / 2 + far, 0.99, 1.0), (SIDE / 2 - far, 0.99, 1.0)):
        origin, ray = camera.rays(0, np.array([[column, SIDE / 2]]))
        deep = 4.0 - (column < SIDE / 2) * 0.02 / METRES
        point = origin + ray * deep / float(ray[0] @ camera.pose[0, :3, 2])
        towards = (origin - point) / np.linalg.norm(origin - point)
        for owner, one, two in ((HEAD, low, high), (BODY, 0.99, 1.0)):
            weight = shot.look(point, towards, solid, 0.02, np.array([owner], np.uint8)).weight[0]
            assert one <= weight <= two


@pytest.mark.parametrize("gap", [0.02, 0.001])
def test_hair_that_hangs_before_skin_has_no_rim_of_its_color(gap):
    """Where the two meet on the skin a photo's own hairline stays."""
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=2800.0,
                        target=(0, 0, 0), pitch=0.0)
    curtain = Nothing()
    left = np.arange(SIDE)[None, :] < SIDE // 2
    curtain.depth = lambda *_: (np.ones((SIDE, SIDE)),
                                np.where(left, 4.0 - gap / METRES, 4.0) + np.zeros((SIDE, 1)))
    solid = _Depths.of(curtain, Nothing(), camera, 0.02)
    shot = Shot.of(camera, shaded(), (left + np.zeros((SIDE, 1))).astype(np.float32))
    weights = []
    for beside in (0.5, 40.5):
        origin, ray = camera.rays(0, np.array([[SIDE / 2 - beside, SIDE / 2]]))
        point = origin + ray * (4.0 - gap / METRES) / float(ray[0] @ camera.pose[0, :3, 2])
        towards = (origin - point) / np.linalg.norm(origin - point)
        for owner in (HAIR, BODY):
            weights.append(shot.look(point, towards, solid, 0.02,
                                     np.array([owner], np.uint8)).weight[0])
    assert weights == pytest.approx([float(gap < 0.01), 1, 1, 1], abs=0.05)


def test_of_hair_a_photo_says_less_than_of_skin_that_is_as_slanted():
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=700.0,
                        target=(0, 0, 0), pitch=0.0)
    wall = Nothing()
    wall.depth = lambda *_: (np.ones((SIDE, SIDE)), np.full((SIDE, SIDE), 4.0))
    solid = _Depths.of(wall, Nothing(), camera, 0.02)
    shot = Shot.of(camera, shaded(), None)
    for cosine, owner, least, most in ((0.2, HEAD, 0.1, 0.3), (0.2, BODY, 0.1, 0.3),
                                       (0.2, HAIR, 0, 0), (0.2, BEARD, 0, 0), (0.4, HEAD, 1, 1),
                                       (0.4, HAIR, 0.7, 0.95), (0.1, HEAD, 0, 0)):
        normal = np.array([[np.sqrt(1 - cosine ** 2), 0.0, cosine]])
        weight = shot.look(np.zeros((1, 3)), normal, solid, 0.02,
                           np.array([owner], np.uint8)).weight[0]
        assert least <= weight <= most, (cosine, owner)


@pytest.mark.parametrize("unit", [40.0, 128.0, 400.0])
@pytest.mark.parametrize("cosine", [0.45, 0.7])
def test_what_is_slanted_is_no_edge(cosine, unit):
    """A plane, to the side and to a corner of the picture, of pixels of any size."""
    camera = Camera.arc(np.array([20.0]), distance=4.0, width=64, height=64, focal=4 * unit,
                        target=(0, 0, 0), pitch=0.0)
    columns, rows = np.meshgrid(np.arange(64.0), np.arange(64.0))
    rise = np.sqrt(1 - cosine ** 2) / cosine / unit
    for along in (columns, (columns + rows) / np.sqrt(2)):
        plane = Nothing()
        plane.depth = lambda *_, along=along: (np.ones((64, 64)), 4.0 + rise * along)
        solid = _Depths.of(plane, Nothing(), camera, 0.02)
        at = np.array([[32, 32]])
        assert solid.beside_edge(at, solid.all[at[:, 1], at[:, 0]], np.array([cosine]),
                                 np.zeros(1, bool))[0] < 0.05


def test_what_a_jaw_may_hide_has_not_its_color(head):
    camera = head[0]
    shot = Shot.of(camera, shaded(), None)
    rows = np.arange(SIDE)[:, None] + np.zeros(SIDE)
    chin = SIDE // 2
    solid = depths(np.full((SIDE, SIDE), 4.0 + 0.03 / METRES), 4.0,
                   np.clip(1 - (rows - chin) / (ABOUT * 175.0), 0, 1))
    for below, owner, least, most in ((1, BODY, 0.0, 0.1), (1, HAIR, 0.99, 1.0),
                                      (ABOUT * 175 / 2, BODY, 0.4, 0.6), (20, BODY, 0.99, 1.0)):
        origin, ray = camera.rays(0, np.array([[SIDE / 2, chin + below + 0.5]]))
        point = origin + ray * solid.all[0, 0] / float(ray[0] @ camera.pose[0, :3, 2])
        towards = (origin - point) / np.linalg.norm(origin - point)
        weight = shot.look(point, towards, solid, 0.02, np.array([owner], np.uint8)).weight
        assert least <= weight[0] <= most


@pytest.mark.parametrize("size", [64, 256])
def test_where_a_face_ends_is_known_around_it(size):
    field = shell_field(size=32)
    camera = Camera.arc(np.zeros(1), distance=4.0, width=size, height=size, focal=2.0 * size,
                        target=(0, 0, 0), pitch=0.0)
    solid = _Depths.of(field, field, camera, 0.06)
    middle = size // 2
    assert solid.near[middle, middle] == 1 and solid.near[0, 0] == 0
    ends = np.flatnonzero(np.isfinite(solid.farthest[middle]) & (solid.near[middle] == 1))[-1]
    reach = ABOUT * 0.5 * size  # Pixels.
    beside = solid.near[middle, ends + 1:]
    assert (beside > 0).sum() == pytest.approx(reach, abs=1)
    at = np.array([[middle, middle], [middle, middle], [0, 0]])
    far = solid.face[middle, middle] + np.array([0.0, 3 * DEEP, 3 * DEEP])
    assert solid.behind_face(at, far) == pytest.approx([0, 1, 0])
    # What lies behind something else is no face: one that is hidden has no outline.
    wall = Nothing()
    wall.depth = lambda *_: (np.ones((size, size)), np.full((size, size), 2.0))
    hidden = _Depths.of(wall, field, camera, 0.06)
    assert not hidden.near.any() and not hidden.behind_face(at, far).any()


def test_the_other_side_counts_where_it_is_seen_more_squarely_and_is_the_same():
    count = 7
    ones, zeros = np.ones(count), np.zeros(count)
    look = Look(np.zeros((count, 3)), zeros, None, zeros, ones,
                np.array([0.9, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3]), ones,
                np.array([0, 0, 0, 0, 1, 0, 0.0]))
    mirrored = look._replace(cosine=np.array([0.3, 0.5, 0.95, 0.95, 0.95, 0.95, 0.95]),
                             sure=np.array([1, 1, 1, 0, 1, 1, 1.0]),
                             hair=np.array([0, 0, 0, 0, 0, 1, 0.0]),
                             clothes=np.array([0, 0, 0, 0, 0, 0, 1.0]))
    assert look.beside(mirrored).weight == pytest.approx([1, 1, 0, 1, 1, 1, 1])


def test_only_heads_have_the_other_sides_color_and_open_mouths_have_their_own(head):
    camera, _, landmarks = head
    shot = Shot.of(camera, shaded(), None, mouth=np.ones((SIDE, SIDE), np.float32))
    plain = Shot.of(camera, shaded(), None)
    origin, ray = camera.rays(0, landmarks[:1])
    point = origin + 4.0 * ray
    far = camera.project(point)[1][0, 0]
    for one, owner, kept in ((plain, HEAD, 0), (plain, HAIR, 0), (plain, BODY, 1), (shot, HEAD, 1)):
        look = one.look(point, -ray, depths(np.full((SIDE, SIDE), far)), 0.02,
                        np.array([owner], np.uint8))
        assert look.kept[0] == kept and look.sure[0] == look.weight[0] == 1
    before = plain.look(point, -ray, depths(np.full((SIDE, SIDE), far + 1)), 0.02,
                        np.array([HEAD], np.uint8))
    assert before.weight[0] == 1 and before.sure[0] == 0, "it hangs in the air"


def test_an_open_mouth_is_colored_however_slanted_and_a_little_behind_the_lips(head):
    camera, _, landmarks = head
    parted = landmarks.copy()
    parted[[61, 62, 63], 1] -= 4
    parted[[67, 66, 65], 1] += 4
    shut = landmarks.copy()
    shut[[61, 62, 63]] = shut[[67, 66, 65]]
    assert open_mouth(shut, (SIDE, SIDE)) is None
    mouth = open_mouth(parted, (SIDE, SIDE))
    middle = parted[60:68].mean(axis=0)
    assert mouth[int(middle[1]), int(middle[0])] > 0.9 and mouth.sum() < 0.05 * SIDE ** 2
    shot = Shot.of(camera, shaded(), None, mouth=mouth)
    for pixel, behind, least, most in ((middle, 0.0, 0.9, 1.01), (middle, 0.015, 0.9, 1.01),
                                       (middle, 0.05, 0.0, 0.1), (middle + 80, 0.0, 0.0, 0.1)):
        origin, ray = camera.rays(0, pixel[None])
        point = origin + (4.0 + behind / METRES) * ray
        far = camera.project(point)[1][0, 0] - behind / METRES
        away = np.cross(ray, [0.0, 1.0, 0.0])  # It is seen edge on.
        weight = shot.look(point, away, depths(np.full((SIDE, SIDE), far)), 0.005,
                           np.array([HEAD], np.uint8)).weight[0]
        assert least <= weight <= most


def test_a_beard_that_goes_on_along_the_jaw_is_skin(head):
    camera, samples, landmarks = head
    row = int(cheek(head)[0])
    bearded = shaded()
    bearded[row - 4:] *= 0.25
    assert not_skin(bearded, None, landmarks, camera, samples).max() < 0.1
    beside = shaded()
    column = int(landmarks[54, 0])
    beside[row - 4:, column + 20:] *= 0.25
    assert not_skin(beside, None, landmarks, camera, samples).max() > 0.9


def test_clothes_below_the_ears_are_neither_skin_nor_beard(head):
    _, _, landmarks = head
    none = np.zeros((SIDE, SIDE), np.float32)
    image = np.rint(255 * shaded()).astype(np.uint8)
    assert not clothes(image, none, landmarks).any()
    chin, ears = int(landmarks[8, 1]), int(landmarks[[2, 14], 1].mean())
    image[chin + 10:] = [20, 30, 90]
    image[:ears - 40, :40] = [20, 30, 90]
    found = clothes(image, none, landmarks)
    assert found[chin + 14:].all() and not found[:ears - 8].any()
    assert not clothes(image, none + 1, landmarks).any(), "hair is none"
    mouth = int(landmarks[57, 1])
    image[mouth:] = [40, 30, 25]
    assert not clothes(image, none, landmarks).any(), "nor is what is like the beard"
