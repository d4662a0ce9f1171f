"""Pieces of a person's solid: where they are, and where their surfaces only lead out of sight."""

import numpy as np

from lfportrait.face.one_photo.solid import EDGE, Piece


def test_hair_is_only_a_little_beyond_where_it_grows():
    ahead, behind = np.zeros((2, 20, 30), bool)
    ahead[6:9, 6:20], behind[6:14, 6:20] = True, True
    piece = Piece(np.ones((20, 30)), np.ones((20, 30)), np.full((20, 30), 3.0), ahead, behind)
    around = range(-EDGE, EDGE + 1)
    row, column = (part.ravel() for part in np.mgrid[-6:26, -6:36])
    places = np.stack([row, column]).astype(float)
    for depth, part in ((2.9, ahead), (3.1, behind)):
        found = piece.covers(places, np.full(len(row), depth))
        grown = {(y + dy, x + dx) for y, x in np.argwhere(part) for dy in around
                 for dx in around}
        assert {(y, x) for y, x, yes in zip(row, column, found, strict=True) if yes} == grown


def test_without_parts_a_piece_is_anywhere():
    piece = Piece(*(np.ones((4, 4)) for _ in range(3)))
    assert piece.covers(np.zeros((2, 3)), np.array([0.5, 1.0, 2.0])).all()
