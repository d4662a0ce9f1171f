"""Spectacles of a photo: wires before the eyes that the photo's own camera sees where they were."""

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from lfportrait.capture import Camera
from lfportrait.face import dark_glasses
from lfportrait.face.glasses import Spectacles
from lfportrait.face.head_fit import View
from lfportrait.face.head_prior import generic_prior
from lfportrait.face.one_photo import lattice, wires
from lfportrait.face.one_photo.lattice import shell_of
from lfportrait.face.one_photo.parts import parts_of
from lfportrait.face.one_photo.piece import METRES
from lfportrait.face.one_photo.samples import MeshSamples
from lfportrait.face.one_photo.solid import WORN, Solid
from tests.portraits import CANONICAL

SKIN, WIRE, HORN = (200, 150, 120), (30, 40, 90), (110, 110, 120)
SIZE, FOCAL = 500, 1000.0


@pytest.fixture(scope="module")
def worn():
    """A head of one color in its camera's frame, its photo with two round rims, what is found."""
    prior = generic_prior()
    view = View(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.1, 0.9]), FOCAL,
                np.full(2, SIZE / 2), np.zeros(len(prior.expression)))
    local = view.to_camera(prior.mean.astype(float))
    landmarks = view.project(prior.mean.astype(float))[prior.landmarks]
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rims = tuple(landmarks[eye:eye + 6].mean(axis=0)
                 + 24 * np.stack([np.cos(angle), np.sin(angle)], axis=1) for eye in (36, 42))
    photo = np.full((SIZE, SIZE, 3), SKIN, np.uint8)
    for side, rim in zip((-1, 1), rims):  # broad temples, as of horn, with hinges of metal
        ear = np.linalg.norm(prior.rest - np.array([side, 1, 1]) * wires.EAR, axis=1).argmin()
        turn = np.radians(wires.HINGE)
        first = rim.mean(axis=0) + 24 * np.array([side * np.cos(turn), -np.sin(turn)])
        last = view.project(prior.mean[ear:ear + 1].astype(float))[0]
        ends = np.rint([first, last]).astype(int)
        cv2.line(photo, ends[0], ends[1], HORN, 5)
    for rim in rims:
        cv2.polylines(photo, [np.rint(rim).astype(np.int32)], True, WIRE, 5)
    frame = np.diag([1 / METRES, -1 / METRES, -1 / METRES, 1.0])
    frame[:3, 3] = -frame[:3, :3] @ local.mean(axis=0)
    samples = MeshSamples.of(local @ frame[:3, :3].T + frame[:3, 3], prior.outer, prior.rest)
    found = Spectacles(rims, 5.0, 2.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wires, "find_spectacles", lambda *_, **__: found)
        made, bare = wires.wires_of(photo, landmarks, prior, view, local, frame, samples)
    camera = Camera(np.diag([1.0, -1, -1, 1])[None] @ np.eye(4), np.full((1, 2), FOCAL),
                    np.full((1, 2), SIZE / 2), np.array([SIZE]), np.array([SIZE]))
    return prior, view, local, frame, samples, rims, photo, bare, made, camera


def test_the_photo_sees_wires_where_they_were(worn):
    _, view, _, frame, _, rims, *_, made, _ = worn
    local = (made.points - frame[:3, 3]) @ np.linalg.inv(frame[:3, :3]).T
    seen = local[:, :2] / local[:, 2:] * view.focal + view.center
    for rim in rims:
        assert np.linalg.norm(seen[None] - rim[:, None], axis=2).min(axis=1).max() < 1.0


def test_rims_are_worn_before_the_eyes_and_outside_of_the_head(worn):
    prior, _, local, frame, samples, *_, made, _ = worn
    assert samples.distance(made.points, 1.0).min() > 0.9 * made.radius
    lids = local[prior.landmarks[36:48]] @ frame[:3, :3].T + frame[:3, 3]
    front = lids[:, 2].max() * METRES
    inside = np.abs(made.points[:, 0]) * METRES < 0.04
    high = made.points[inside, 2] * METRES
    assert front + 0.009 < high.min() and high.max() < front + 0.03


def test_temples_reach_both_ears(worn):
    _, _, local, frame, _, _, _, _, made, _ = worn
    ears = np.array([[-1, 1, 1], [1, 1, 1]]) * wires.EAR
    rest = worn[0].rest
    for ear in ears:
        vertex = np.linalg.norm(rest - ear, axis=1).argmin()
        place = local[vertex] @ frame[:3, :3].T + frame[:3, 3]
        assert np.linalg.norm(made.points - place, axis=1).min() < 0.01 / METRES


def test_the_photo_is_bare_below_them(worn):
    photo, bare = worn[6:8]
    assert np.abs(photo.astype(int) - SKIN).max() > 100
    assert np.abs(bare.astype(int) - SKIN).max() < 8
    assert np.abs(made_colors(worn) - np.array(WIRE) / 255).max() < 0.2


def made_colors(worn):
    """The middle colors of the rims and the temples."""
    colors = worn[8].colors
    return np.stack([np.median(colors[:200], axis=0), np.median(colors[-200:], axis=0)])


@pytest.mark.parametrize("fine", [False, True])
def test_a_lattice_has_them_without_gaps(worn, fine, monkeypatch):
    if fine:  # where the head lies between points that are two voxels apart
        monkeypatch.setattr(lattice, "DETAIL", 1.0)
    _, _, _, _, samples, _, _, _, made, camera = worn
    matte = np.ones((SIZE, SIZE), np.float32)
    parts = parts_of(camera, matte, np.zeros_like(matte), 0.9 / METRES)
    solid = Solid(parts, samples, None, None, np.array([0, 1.0, 0, -9]), -9.0)
    shell = shell_of(solid, 70, made)
    on = shell.points[(shell.owner == WORN) & (shell.away < 0)]
    assert cKDTree(on).query(made.points)[0].max() < 1.1 * shell.voxel
    points, _ = ndimage.label((shell.links >= 0) & (shell.owner == WORN)[shell.links]
                              & (shell.away < 0)[shell.links], np.ones((3, 3, 3)))
    assert points.max() == 1, "rims and temples hang together"


def test_dark_lenses_are_told_from_bare_eyes():
    landmarks = 120 * CANONICAL + 200
    photo = np.full((400, 400, 3), SKIN, np.uint8)
    assert not dark_glasses(photo, landmarks)
    for number, eye in enumerate((36, 42)):
        middle = np.rint(landmarks[eye:eye + 6].mean(axis=0)).astype(int).tolist()
        cv2.circle(photo, middle, round(0.6 * float(landmarks[33, 1] - landmarks[27, 1])),
                   (40, 40, 40), -1)
        assert dark_glasses(photo, landmarks) == (number == 1), "one eye may lie in the shade"
