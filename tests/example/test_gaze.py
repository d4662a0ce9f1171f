"""Painted eyes that look apart are made to look the same way; others stay."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait import face, models
from lfportrait.example import gaze
from lfportrait.example.gaze import MESH_EYES, agreed, looking_apart, with_parallel_eyes
from tests.portraits import drawn_face

WHITE, DARK = (235, 235, 235), (20, 40, 120)


@pytest.fixture
def painted(monkeypatch, tmp_path):
    """A function that draws a face whose irises lie so far right of the middles of the eyes.

    Over half the eye's width; the landmarker sees an iris where the picture is blue and dark.
    """
    monkeypatch.setattr(models, "available", lambda name: name == "face-landmarker")
    monkeypatch.setattr(gaze, "kept_arrays", lambda kind, key, make: make())
    drawn = drawn_face(480, 480, seed=4)
    corners = [(drawn.landmarks[a], drawn.landmarks[b]) for a, b in ((36, 39), (42, 45))]

    def draw(*right):
        image = drawn.image.copy()
        y, x = np.mgrid[:480, :480] + 0.5
        for (left, end), share in zip(corners, right):
            middle, half = 0.5 * (left + end), 0.5 * (end[0] - left[0])
            away = np.hypot((x - middle[0]) / half, (y - middle[1]) / (0.45 * half))
            image[away < 1.1] = WHITE
            iris = np.hypot(x - middle[0] - share * half, y - middle[1]) < 0.35 * half
            image[iris & (away < 1.1)] = DARK
        return replace(drawn, image=image)

    def irises(image):
        blue = (image[..., 2].astype(int) - image[..., 0] > 60) & (image[..., 0] < 90)
        found = []
        for left, end in corners:
            low, high = np.minimum(left, end), np.maximum(left, end)
            part = np.zeros_like(blue)
            rows = slice(int(low[1] - 12), int(high[1] + 12))
            part[rows, int(low[0]):int(high[0]) + 1] = blue[rows, int(low[0]):int(high[0]) + 1]
            found.append(np.argwhere(part).mean(axis=0)[::-1] + 0.5)
        return found

    def mesh(image, landmarks):
        points = np.zeros((478, 2))
        for (left, end), eye, iris in zip(corners, MESH_EYES, irises(image)):
            up = np.array([0, 0.2 * (end[0] - left[0])])
            points[list(eye)] = left, end, iris, iris - up, iris + up
        return points

    monkeypatch.setattr(gaze, "_mesh", mesh)
    # This landmarker is exact.
    monkeypatch.setattr(gaze, "FOLLOWED", 1.0)
    return draw, lambda image: looking_apart(mesh(image, None)[np.array(MESH_EYES)])


def test_eyes_that_look_apart_look_the_same_way(painted):
    draw, apart = painted
    exemplar = draw(-0.15, 0.2)
    before = np.linalg.norm(apart(exemplar.image))
    level = with_parallel_eyes(exemplar)
    assert 4 < before < 10 and np.linalg.norm(apart(level.image)) < 0.4 * before
    changed = np.argwhere((level.image != exemplar.image).any(axis=-1))[:, ::-1]
    middles = np.stack([exemplar.landmarks[36:42].mean(axis=0),
                        exemplar.landmarks[42:48].mean(axis=0)])
    width = np.linalg.norm(exemplar.landmarks[39] - exemplar.landmarks[36])
    away = np.linalg.norm(changed[:, None] - middles, axis=-1).min(axis=1)
    assert len(changed) > 20 and away.max() < 0.75 * width
    np.testing.assert_array_equal(level.landmarks, exemplar.landmarks)


def test_eyes_move_by_no_more_than_discs_and_landmarker_agree_on():
    corners = np.array([[[0.0, 0.0], [100.0, 0.0]], [[200.0, 0.0], [300.0, 0.0]]])

    def eyes(degrees):
        irises = corners.mean(axis=1)
        irises[1, 0] += degrees / gaze.FULL * 50
        return np.stack([*corners.swapaxes(0, 1), irises, irises, irises], axis=1)

    def asked(by_mesh, by_discs):
        discs = eyes(by_discs + gaze.DISCS_USUAL)[:, 2]
        return agreed(eyes(by_mesh + gaze.USUAL[0]), discs)

    # The landmarker reports half of what there is.
    assert asked(3.0, 5.0) == pytest.approx(5.0) and asked(-3.0, -7.0) == pytest.approx(-6.0)
    assert asked(3.0, -5.0) == 0.0 and asked(-0.5, 6.0) == 0.0
    assert asked(3.0, gaze.MOST + 1) == 0.0 and asked(gaze.MOST + 1, 3.0) == 0.0


def test_parallel_eyes_and_unlikely_ones_stay(painted, monkeypatch):
    draw, apart = painted
    usual = gaze.USUAL[0] / gaze.FULL
    parallel, wild = draw(0.2 - usual / 2, 0.2 + usual / 2), draw(-0.4, 0.4)
    assert np.linalg.norm(apart(parallel.image)) < 1 and apart(wild.image)[0] > gaze.MOST
    assert with_parallel_eyes(parallel) is parallel and with_parallel_eyes(wild) is wild
    exemplar = draw(-0.15, 0.2)
    with monkeypatch.context() as other:
        other.setattr(gaze, "irises_found", lambda image, landmarks: None)
        assert with_parallel_eyes(exemplar) is exemplar
    monkeypatch.setattr(gaze, "_mesh", lambda image, landmarks: None)
    assert with_parallel_eyes(exemplar) is exemplar
    monkeypatch.setattr(models, "available", lambda name: False)
    assert with_parallel_eyes(exemplar) is exemplar


def test_a_face_is_looked_at_closely_and_places_are_the_pictures(monkeypatch):
    drawn = drawn_face(480, 480, seed=4)
    seen = []

    def mesh(close):
        seen.append(close)
        return np.full((478, 2), (gaze.SIDE / 2, gaze.SIDE / 2))

    monkeypatch.setattr(face, "face_mesh", mesh)
    image = np.zeros_like(drawn.image)
    low, high = drawn.landmarks.min(axis=0), drawn.landmarks.max(axis=0)
    at = np.floor(0.5 * (low + high) - [0, 0.1 * (high[1] - low[1])]).astype(int)
    image[at[1], at[0]] = 255
    found = gaze._mesh(image, drawn.landmarks)
    assert found is not None and np.abs(found[0] - at).max() <= 1
    y, x = np.unravel_index(int(seen[0][..., 0].argmax()), seen[0].shape[:2])
    scale = gaze.SIDE / (gaze.ROOM * (high - low).max())
    assert scale > 1 and np.abs(np.array([x, y]) + 0.5 - gaze.SIDE / 2).max() <= scale + 1
