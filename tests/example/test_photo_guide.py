"""Position guide of photos below the chin: necks made longer, shoulders of the exemplar's own."""

import numpy as np

from lfportrait.example import Exemplar
from lfportrait.example.guides.regions import find_regions
from lfportrait.example.photo_guide import FlatGuide, lengthen_neck, plain_neck
from lfportrait.labels import PICTURE_LABELS as LABELS
from tests.portraits import drawn_face


def nodes_of(rows, columns, grid, shift):
    y, x = np.mgrid[:rows, :columns] * grid + 0.5
    return np.stack([x, y + shift], axis=-1).astype(np.float32)


def test_the_plainest_strip_of_the_neck_is_found():
    picture = np.random.default_rng(0).random((200, 100)).astype(np.float32)
    landmarks = np.full((68, 2), 50.0)
    landmarks[17:27, 1], landmarks[8] = 40, (50, 140)
    picture[145:156] = 0.5
    first, last = plain_neck(picture, landmarks)
    assert 140 + first >= 145 and 140 + last <= 156 and last > first
    assert plain_neck(picture[:143], landmarks)[0] == 0


def test_the_lower_border_stays_on_the_exemplar_and_moves_as_one():
    nodes = nodes_of(61, 20, 4, 30.0)
    before = nodes.copy()
    lengthen_neck(nodes, 120.0, 200, (6.0, 20.0), 1.0, 4)
    assert np.abs(nodes[-1, :, 1] - 198).max() < 1e-3
    assert np.array_equal(nodes[:31], before[:31]) and np.array_equal(nodes[..., 0], before[..., 0])
    steps = np.diff(nodes[:, 0, 1])
    assert (steps >= 0).all() and np.allclose(steps[-6:], 4, atol=1e-3)


def test_an_exemplar_that_shows_enough_changes_nothing():
    nodes = nodes_of(61, 20, 4, 0.0)
    before = nodes.copy()
    lengthen_neck(nodes, 120.0, 400, (6.0, 20.0), 1.0, 4)
    assert np.array_equal(nodes, before)


def test_shoulders_are_the_exemplars_and_the_face_is_the_photos():
    face = drawn_face(320, 240)
    regions = find_regions(face.image, face.landmarks, face.mask)
    labels = regions.labels()
    guide = FlatGuide(Exemplar(face.image, face.landmarks), regions, labels)
    y, x = np.mgrid[:320, :240] + 0.5
    position = np.stack([x, y], axis=-1).astype(np.float32)
    position[310:] = np.nan
    body, ground = LABELS.index("body"), LABELS.index("background")
    mine = labels.copy()
    below = int(face.landmarks[8, 1]) + 5
    mine[below:] = 0
    mine[below:, :, ground] = 255
    before = mine.copy()
    person = guide.own_shoulders(position, face.landmarks, mine, np.zeros((320, 240), np.float32))
    assert np.array_equal(mine[below:310], labels[below:310])
    assert np.array_equal(mine[310:], before[310:])
    assert np.array_equal(mine[:below - 6], before[:below - 6])
    assert np.allclose(person[below:310], 1 - labels[below:310, :, ground] / 255, atol=1e-6)
    assert (mine[below:310, :, body] > 200).any()
