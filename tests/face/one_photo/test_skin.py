"""The sides of a face that a photo shows, and what it shows before and beside them."""

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo.paint import ABOUT, DEEP, Look, Shot, _Outline
from lfportrait.face.one_photo.piece import METRES
from lfportrait.face.one_photo.samples import MeshSamples
from lfportrait.face.one_photo.skin import clothes, not_skin, open_mouth
from lfportrait.face.one_photo.solid import BODY, HAIR, HEAD
from tests.fields import shell_field

from .generic import generic_head

SIDE = 320
SKIN = np.float32([0.82, 0.62, 0.52])
NOWHERE = _Outline(np.full((SIDE, SIDE), np.inf), np.zeros((SIDE, SIDE)))  # No face is near.


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
        weight = shot.look(point, towards, depth, NOWHERE, 0.02,
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


@pytest.mark.parametrize("yaw, least, most", [(0.0, 0.99, 1.0), (20.0, 0.0, 0.1)])
def test_beside_the_edge_of_a_turned_nose_a_photo_says_nothing(yaw, least, most):
    """A wall hides another one 2 cm behind it: what lies beside its edge, and what does not."""
    camera = Camera.arc(np.array([yaw]), distance=4.0, width=SIDE, height=SIDE, focal=700.0,
                        target=(0, 0, 0), pitch=0.0)
    depth = np.full((SIDE, SIDE), 4.0)
    depth[:, :SIDE // 2] -= 0.02 / METRES
    shot = Shot.of(camera, shaded(), None)
    far = 0.015 / METRES * 175  # Pixels.
    for column, low, high in ((SIDE / 2 + 1.5, least, most), (SIDE / 2 - 0.5, least, most),
                              (SIDE / 2 + far, 0.99, 1.0), (SIDE / 2 - far, 0.99, 1.0)):
        origin, ray = camera.rays(0, np.array([[column, SIDE / 2]]))
        point = origin + ray * depth[0, int(column)] / float(ray[0] @ camera.pose[0, :3, 2])
        towards = (origin - point) / np.linalg.norm(origin - point)
        for owner, one, two in ((HEAD, low, high), (BODY, 0.99, 1.0)):
            weight = shot.look(point, towards, depth, NOWHERE, 0.02,
                               np.array([owner], np.uint8)).weight[0]
            assert one <= weight <= two


def test_what_a_jaw_may_hide_has_not_its_color(head):
    camera = head[0]
    shot = Shot.of(camera, shaded(), None)
    rows = np.arange(SIDE)[:, None] + np.zeros(SIDE)
    chin = SIDE // 2
    face = _Outline(np.full((SIDE, SIDE), 4.0),
                    np.clip(1 - (rows - chin) / (ABOUT * 175.0), 0, 1))
    depth = np.full((SIDE, SIDE), 4.0 + 0.03 / METRES)
    for below, owner, least, most in ((1, BODY, 0.0, 0.1), (1, HAIR, 0.99, 1.0),
                                      (ABOUT * 175 / 2, BODY, 0.4, 0.6), (20, BODY, 0.99, 1.0)):
        origin, ray = camera.rays(0, np.array([[SIDE / 2, chin + below + 0.5]]))
        point = origin + ray * depth[0, 0] / float(ray[0] @ camera.pose[0, :3, 2])
        towards = (origin - point) / np.linalg.norm(origin - point)
        weight = shot.look(point, towards, depth, face, 0.02, np.array([owner], np.uint8)).weight
        assert least <= weight[0] <= most


def test_where_a_face_ends_is_known_around_it():
    field = shell_field(size=32)
    camera = Camera.arc(np.zeros(1), distance=4.0, width=64, height=64, focal=120.0,
                        target=(0, 0, 0), pitch=0.0)
    outline = _Outline.of(field, camera)
    assert outline.near[32, 32] == 1 and outline.near[0, 0] == 0
    assert np.isfinite(outline.depth).all() and 3.0 < outline.depth[32, 32] < 4.0
    at = np.array([[32, 32], [32, 32], [0, 0]])
    far = outline.depth[32, 32] + np.array([0.0, 3 * DEEP, 3 * DEEP])
    assert outline.before(at, far) == pytest.approx([0, 1, 0])
    nothing = _Outline.of(shell_field(size=32, density=0.0), camera)
    assert not nothing.before(at, far).any()


def test_the_other_side_counts_where_it_is_seen_more_squarely():
    count = 4
    look = Look(np.zeros((count, 3)), np.zeros(count), None, None, np.ones(count),
                np.array([0.9, 0.3, 0.3, 0.3]))
    mirrored = look._replace(cosine=np.array([0.3, 0.5, 0.95, 0.95]),
                             weight=np.array([1.0, 1.0, 1.0, 0.0]))
    assert look.beside(mirrored).weight == pytest.approx([1, 1, 0, 1])


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
        weight = shot.look(point, away, np.full((SIDE, SIDE), far), NOWHERE, 0.005,
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
