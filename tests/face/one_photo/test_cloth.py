"""What of a body is clothes in a photo, and what is bare."""

import cv2
import numpy as np
import pytest

from lfportrait import models
from lfportrait.capture import Camera
from lfportrait.example.skin.hair import clothes_of_head
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo import cloth, paint
from lfportrait.face.one_photo.cloth import clothes_of
from lfportrait.face.one_photo.collar import Collar
from lfportrait.face.one_photo.lattice import shell_of
from lfportrait.face.one_photo.paint import Shot, _clothed, _Mean, painted
from lfportrait.face.one_photo.parts import parts_of
from lfportrait.face.one_photo.samples import MeshSamples
from lfportrait.face.one_photo.solid import BODY, HEAD, solid_of
from lfportrait.field import C0
from tests.fields import shell_field

from .generic import generic_head

SIDE = 400
SKIN = np.float32([0.82, 0.62, 0.52])
Head = tuple[Camera, MeshSamples, np.ndarray]


@pytest.fixture(scope="module")
def head() -> Head:
    points, samples = generic_head()
    camera = Camera.arc(np.zeros(1), distance=4.0, width=SIDE, height=SIDE, focal=560.0,
                        target=(0, -0.4, 0), pitch=0.0)
    landmarks = camera.project(points[generic_prior().landmarks])[0][0]
    return camera, samples, landmarks


@pytest.fixture(autouse=True)
def _no_network(monkeypatch):
    monkeypatch.setattr(models, "available", lambda name: False)


HULLS: dict[int, tuple[Head, np.ndarray]] = {}
"""Heads by their id, and their outlines: to project all samples takes longest."""


def person(head: Head) -> np.ndarray:
    """Head, neck and shoulders, bool [H, W]."""
    camera, samples, landmarks = head
    out = np.zeros((SIDE, SIDE), np.uint8)
    if id(head) not in HULLS:
        pixels = camera.project(samples.points)[0][0]
        HULLS[id(head)] = head, cv2.convexHull(np.rint(pixels).astype(np.int32))
    cv2.fillConvexPoly(out, HULLS[id(head)][1], 1)
    x, y = landmarks[8]
    shoulders = [(x - 45, y - 20), (x + 45, y - 20), (x + 55, y + 35), (x + 175, y + 75),
                 (x + 185, SIDE), (x - 185, SIDE), (x - 175, y + 75), (x - 55, y + 35)]
    cv2.fillPoly(out, [np.rint(shoulders).astype(np.int32)], 1)
    return out > 0


def shirt(head: Head) -> np.ndarray:
    """What of the body is clothed, bool [H, W]: all but an open collar."""
    x, y = head[2][8]
    bare = np.zeros((SIDE, SIDE), np.uint8)
    cv2.fillPoly(bare, [np.rint([(x - 50, y + 25), (x, y + 110), (x + 50, y + 25), (x + 50, 0),
                                 (x - 50, 0)]).astype(np.int32)], 1)
    low = np.arange(SIDE)[:, None] > y + 25
    return person(head) & (bare == 0) & low


def photo(head: Head, color: tuple[float, float, float] | None) -> np.ndarray:
    """A lit face, a neck in the shade of its chin, and a shirt of one cloth, or none."""
    y, x = np.mgrid[:SIDE, :SIDE]
    chin = head[2][8]
    light = np.linspace(1.1, 0.8, SIDE)[None, :, None] * np.ones((SIDE, 1, 1))
    under = np.exp(-((x - chin[0]) / 70) ** 2 - ((y - chin[1] - 18) / 22.0) ** 2)
    light = light * (1 - 0.55 * under[..., None] * (y > chin[1] - 4)[..., None])
    out = SKIN * light
    if color is not None:
        worn = shirt(head)
        folds = 1 + 0.1 * np.sin(x / 9.0 + y / 15.0)
        out[worn] = (np.array(color) * folds[..., None])[worn]
    noise = np.random.default_rng(3).normal(0, 0.01, (SIDE, SIDE, 1))
    return np.clip(out + noise, 0, 1).astype(np.float32)


def found(head: Head, colors: np.ndarray, **more: np.ndarray) -> np.ndarray:
    camera, samples, landmarks = head
    image = np.rint(255 * colors).astype(np.uint8)
    return clothes_of(image, colors, person(head).astype(np.float32), more.get("hair"),
                      more.get("beard"), landmarks, camera, samples)


@pytest.mark.parametrize("color", [
    # The one that is most like skin stays quick.
    pytest.param((0.03, 0.03, 0.035), id="black", marks=pytest.mark.slow),
    pytest.param((0.92, 0.92, 0.93), id="white", marks=pytest.mark.slow),
    pytest.param((0.2, 0.25, 0.45), id="blue", marks=pytest.mark.slow),
    pytest.param((0.36, 0.36, 0.36), id="grey", marks=pytest.mark.slow),
    pytest.param((0.36, 0.30, 0.26), id="brown")])
def test_a_shirt_is_clothes_and_the_shade_of_a_chin_is_not(head, color):
    worn, truth = found(head, photo(head, color)) > 0.5, shirt(head)
    shown = person(head)
    both, either = (worn & truth & shown).sum(), ((worn | truth) & shown).sum()
    assert both > 0.94 * either


def test_bare_shoulders_are_skin(head):
    assert found(head, photo(head, None)).max() == 0


def test_without_colors_the_place_says_it(head):
    grey = photo(head, (0.45, 0.45, 0.45)).mean(axis=2, keepdims=True).repeat(3, axis=2)
    worn, truth = found(head, grey) > 0.5, shirt(head)
    assert (worn & truth).sum() > 0.85 * truth.sum()
    x, y = np.rint(head[2][8]).astype(int)
    assert not worn[y + 5:y + 15, x - 20:x + 20].any()


def test_a_necklace_is_skin_and_a_button_cloth(head):
    colors = photo(head, (0.2, 0.25, 0.45))
    x, y = np.rint(head[2][8]).astype(int)
    colors[y + 40:y + 44, x - 30:x + 30] = 0.9
    colors[y + 150:y + 156, x - 3:x + 3] = SKIN
    worn = found(head, colors)
    assert worn[y + 36:y + 48, x - 20:x + 20].max() < 0.2
    assert worn[y + 145:y + 160, x - 10:x + 10].min() > 0.8


def test_below_hair_and_beard_it_goes_on_as_beside_them(head):
    colors = photo(head, (0.2, 0.25, 0.45))
    x, y = np.rint(head[2][8]).astype(int)
    locks, beard = np.zeros((2, SIDE, SIDE), np.float32)
    locks[y - 100:y + 130, x + 70:x + 95] = 1
    beard[y - 20:y + 60, x - 40:x + 40] = 1
    colors[(locks + beard) > 0] = (0.12, 0.08, 0.05)
    worn = found(head, colors, hair=locks, beard=beard)
    assert worn[y + 80:y + 130, x + 72:x + 92].min() > 0.9
    assert worn[y + 45:y + 55, x - 15:x + 15].max() < 0.3, "a throat"


def test_a_network_that_sees_clothes_is_asked_where_there_is_one(head, monkeypatch):
    worn = shirt(head)
    shares = {"clothes": worn, "body-skin": ~worn, "face-skin": np.zeros_like(worn)}
    monkeypatch.setattr(models, "available", lambda name: name == "multiclass-segmentation")
    monkeypatch.setattr(cloth, "parts_of_network", lambda image: {
        name: share.astype(np.float32) for name, share in shares.items()})
    out = found(head, photo(head, None)) > 0.5
    shown = person(head)
    assert (out & worn & shown).sum() > 0.95 * ((out | worn) & shown).sum()


class _Shell:
    """Points of a neck before and behind, of shoulders before and behind, and of a face."""

    def __init__(self) -> None:
        random = np.random.default_rng(1)
        count = 400
        turn = random.uniform(-np.pi, np.pi, count)
        high = random.uniform(-1.2, 0.1, count)
        radius = np.where(high > -0.6, 0.3, 0.8)
        self.normals = np.stack([np.sin(turn), np.zeros(count), np.cos(turn)], axis=1)
        self.on = self.normals * radius[:, None] + np.stack(
            [np.zeros(count), high, np.zeros(count)], axis=1)
        self.owner = np.where(high > -0.6, HEAD, BODY).astype(np.uint8)
        self.face = high > -0.3
        self.scalp = np.zeros(count, bool)
        self.voxel = 0.05
        self.collar = Collar(np.array([0, -0.6, 0]), 0.3, np.array([0.0, 1.0, 0.0]))


def test_what_no_photo_shows_of_a_body_is_worn_as_what_it_shows(head):
    shell = _Shell()
    own = _Mean(len(shell.on))
    front = np.clip(shell.normals[:, 2], 0, 1)
    own.best[:] = own.weights[:] = front
    own.worn[:] = front * (shell.owner == BODY)
    worn = _clothed(shell, own)
    assert worn[shell.owner == BODY].min() > 0.9
    assert worn[shell.owner == HEAD].max() < 0.1
    own.worn[:] = front  # a high collar
    worn = _clothed(shell, own)
    assert worn[(shell.owner == HEAD) & ~shell.face].min() > 0.9
    assert worn[shell.face].max() == 0
    aside = shell.normals[:, 0] > 0.8
    own.worn[:] = front * aside  # something before one side of the neck
    behind = (shell.owner == HEAD) & (shell.normals[:, 2] < -0.3)
    assert _clothed(shell, own)[behind].max() < 0.1
    own.worn[:] = 0
    assert _clothed(shell, own).max() == 0


def test_where_neck_and_body_meet_in_teeth_clothes_end_evenly(head):
    shell = _Shell()
    random = np.random.default_rng(4)
    turn, high = random.uniform(-np.pi, np.pi, 40000), random.uniform(-0.7, -0.5, 40000)
    shell.normals = np.stack([np.sin(turn), np.zeros(len(turn)), np.cos(turn)], axis=1)
    shell.on = 0.3 * shell.normals + np.stack([0 * high, high, 0 * high], axis=1)
    teeth = np.sin(60 * turn) > 0
    shell.owner = np.where(high > -0.6 + 0.02 * np.where(teeth, 1, -1), HEAD, BODY)
    shell.face, shell.scalp = np.zeros((2, len(turn)), bool)
    own = _Mean(len(turn))
    own.best[:] = own.weights[:] = np.where(high < -0.66, 1.0, 0.0)  # the shirt is seen, no more
    own.worn[:] = own.weights
    own.best[high > -0.52] = own.weights[high > -0.52] = 1.0
    worn = _clothed(shell, own)
    edge = np.abs(high + 0.6) < 0.01
    assert (shell.owner[edge & teeth] == BODY).all() and (shell.owner[edge & ~teeth] == HEAD).all()
    assert abs(np.median(worn[edge & teeth]) - np.median(worn[edge & ~teeth])) < 0.4
    assert worn[high < -0.65].min() > 0.9 and worn[high > -0.55].max() < 0.1


@pytest.fixture(scope="module")
def shell(head):
    """The shell of that person, 48 voxels high. Not to be changed."""
    camera, samples, _ = head
    matte = person(head).astype(np.float32)
    return shell_of(solid_of(parts_of(camera, matte, np.zeros_like(matte), 4.0), samples), 48)


def test_a_field_knows_its_clothes_if_its_photo_says(head, shell):
    """And none if it does not: `test_the_far_side...` has such a field."""
    told = Shot.of(head[0], photo(head, (0.2, 0.25, 0.45)), None,
                   clothes=np.ones((SIDE, SIDE), np.float32))
    worn = painted(shell, [told]).clothes
    assert worn is not None and worn.shape == (len(shell.points),) and worn[shell.face].max() == 0


def test_places_on_a_surface_are_what_the_rows_around_them_are():
    field = shell_field(size=32)
    rows = field.lattice_points()
    places = rows[field.density > 0]
    normals = places / np.linalg.norm(places, axis=1, keepdims=True)
    assert clothes_of_head(field, places, normals) is None
    field.clothes = np.where(rows[:, 1] < 0, 255, 0).astype(np.uint8)
    worn = clothes_of_head(field, places, normals)
    away = 2 * field.spacing.max()
    assert worn is not None and worn[places[:, 1] < -away].min() > 0.99
    assert worn[places[:, 1] > away].max() < 0.01


def test_shoulders_beside_a_chin_are_clothed(head):
    colors, shown = photo(head, (0.2, 0.25, 0.45)), person(head)
    x, y = np.rint(head[2][8]).astype(int)
    shown[y - 70:, x + 130:x + 185] = True
    colors[y - 70:, x + 130:x + 185] = (0.2, 0.25, 0.45)
    camera, samples, landmarks = head
    worn = clothes_of(np.rint(255 * colors).astype(np.uint8), colors, shown.astype(np.float32),
                      None, None, landmarks, camera, samples)
    assert worn[y - 60:y + 40, x + 140:x + 180].min() > 0.9


def test_clothes_that_no_photo_shows_go_on_in_their_own_color(head, shell):
    camera, cloth_color = head[0], (0.1, 0.2, 0.7)
    shot = Shot.of(camera, photo(head, cloth_color), None,
                   clothes=shirt(head).astype(np.float32))
    found = painted(shell, [shot])
    colors = 0.5 + C0 * found.sh[:, :, 0]
    behind = (shell.owner == BODY) & (shell.normals[:, 2] < -0.5)
    assert np.abs(np.median(colors[behind], axis=0) - cloth_color).max() < 0.06
    nape = shell.face & (shell.normals[:, 2] < 0)
    if nape.any():
        assert np.abs(np.median(colors[nape], axis=0) - SKIN).max() < 0.1


def test_a_collar_of_another_color_goes_round_the_neck(head, shell):
    """Behind it a white collar is white, and what is below it is not."""
    camera, (x, y) = head[0], head[2][8]
    down = np.hypot(np.maximum(np.abs(np.arange(SIDE)[None] - x) - 45, 0),
                    np.maximum(np.arange(SIDE)[:, None] - y - 15, 0))
    worn = (np.arange(SIDE)[:, None] > y + 15) & (down > 8)
    colors = np.tile(SKIN, (SIDE, SIDE, 1)).astype(np.float32)
    colors[worn] = (0.1, 0.2, 0.7)
    colors[worn & (down < 40)] = 0.9
    found = painted(shell, [Shot.of(camera, colors, None, clothes=worn.astype(np.float32))])
    assert found.clothes is not None
    out = 0.5 + C0 * found.sh[:, :, 0]
    below = shell.collar.around(shell.on)[:, 0]
    behind = (shell.owner == BODY) & (shell.normals[:, 2] < -0.3)
    for low, high, color in ((0.16, 0.26, (0.9, 0.9, 0.9)), (0.4, 0.6, (0.1, 0.2, 0.7))):
        some = behind & (below > low) & (below < high)
        assert some.sum() > 20 and found.clothes[some].mean() > 200
        assert np.abs(np.median(out[some], axis=0) - color).max() < 0.15


def test_bare_backs_go_on_from_the_neck(head, shell):
    """The nape is as bright as the throat's shade, or a seam is seen where the back begins."""
    shot = Shot.of(head[0], photo(head, None), None, clothes=np.zeros((SIDE, SIDE), np.float32))
    out = 0.5 + C0 * painted(shell, [shot]).sh[:, :, 0]
    below = shell.collar.around(shell.on)[:, 0]
    behind = shell.normals[:, 2] < -0.3
    neck = behind & (shell.owner == HEAD) & ~shell.face & (below > -0.1)
    back = behind & (shell.owner == BODY) & (below < 0.1)
    assert neck.sum() > 20 and back.sum() > 20
    assert np.abs(np.median(out[neck], axis=0) - np.median(out[back], axis=0)).max() < 0.04


def test_the_far_side_of_a_turned_face_has_the_near_ones_color(shell, monkeypatch):
    """A photo of a head that is turned by 25 degrees: its far cheek has a wrong color."""
    camera = Camera.arc(np.array([25.0]), distance=4.0, width=SIDE, height=SIDE, focal=SIDE * 2.0,
                        target=(0, 0, 0), pitch=0.0)
    points = shell.on
    cheek = shell.face & (np.abs(points[:, 0]) > 0.18) & (shell.normals[:, 2] > 0.2)
    near, far = cheek & (points[:, 0] > 0), cheek & (points[:, 0] < 0)
    to_eye = camera.position[0] - points
    cosine = (to_eye * shell.normals).sum(axis=1) / np.linalg.norm(to_eye, axis=1)
    slanted = far & (cosine > 0.3) & (cosine < 0.42)
    assert slanted.sum() > 20 and near.sum() > 20
    # All skin, but for what is seen on the far side's last degrees.
    colors = np.tile(SKIN, (SIDE, SIDE, 1)).astype(np.float32)
    for column, row in np.floor(camera.project(points[slanted])[0][0]).astype(int):
        colors[row - 1:row + 2, column - 1:column + 2] = 0.1, 0.6, 0.1
    field = painted(shell, [Shot.of(camera, colors, None)])
    assert field.clothes is None, "no photo says what is clothes"
    out = 0.5 + C0 * field.sh[:, :, 0]
    assert np.abs(np.median(out[slanted], axis=0) - SKIN).max() < 0.15
    monkeypatch.setattr(paint, "SQUARER", (9.0, 10.0))
    out = 0.5 + C0 * painted(shell, [Shot.of(camera, colors, None)]).sh[:, :, 0]
    assert np.abs(np.median(out[slanted], axis=0) - SKIN).max() > 0.2, "the photo shows it"
