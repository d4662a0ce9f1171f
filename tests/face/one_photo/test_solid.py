"""Pieces of a person's solid: where they are, and where their surfaces only lead out of sight."""

import numpy as np

from lfportrait.face.one_photo.solid import Piece


def test_hair_is_no_more_than_a_cell_beyond_where_it_grows():
    ahead, behind = np.zeros((2, 20, 30), bool)
    ahead[2:6, 4:20], behind[2:12, 4:20] = True, True
    piece = Piece(np.ones((20, 30)), np.ones((20, 30)), np.full((20, 30), 3.0), ahead, behind)
    row, column = (part.ravel() for part in np.mgrid[-2:22, -2:32])
    places = np.stack([row, column]).astype(float)
    for depth, part in ((2.9, ahead), (3.1, behind)):
        found = piece.covers(places, np.full(len(row), depth))
        grown = {(y + dy, x + dx) for y, x in np.argwhere(part) for dy in (-1, 0, 1)
                 for dx in (-1, 0, 1)}
        assert {(y, x) for y, x, yes in zip(row, column, found, strict=True) if yes} == grown


def test_without_parts_a_piece_is_anywhere():
    piece = Piece(*(np.ones((4, 4)) for _ in range(3)))
    assert piece.covers(np.zeros((2, 3)), np.array([0.5, 1.0, 2.0])).all()
