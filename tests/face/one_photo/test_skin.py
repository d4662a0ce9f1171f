"""The sides of a face that a photo shows, and what it shows before and beside them."""

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo.paint import Shot
from lfportrait.face.one_photo.piece import METRES
from lfportrait.face.one_photo.samples import MeshSamples
from lfportrait.face.one_photo.skin import clothes, not_skin, open_mouth
from lfportrait.face.one_photo.solid import BODY, HEAD

from .generic import generic_head

SIDE = 320
SKIN = np.float32([0.82, 0.62, 0.52])


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
        weight = shot.look(point, towards, depth, 0.02,
                           np.array([HEAD if skin else BODY], np.uint8)).weight[0]
        assert least <= weight <= most


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
        weight = shot.look(point, away, np.full((SIDE, SIDE), far), 0.005,
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
