"""Spectacles of a head: found where they stand before it, and drawn in the painter's black."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.example.mouth import Palette, parts_lips
from lfportrait.example.skin.painting import SkinConfig, SkinPainter
from lfportrait.example.skin.sitter import Skin, canvas_of
from lfportrait.example.skin.wires import painted_wires, wires
from tests.portraits import HEAD_LANDMARKS, drawn_face

from .conftest import PIXELS


@pytest.fixture
def worn(skin):
    """The small head with a dark level wire before its eyes, and where that is, bool [N]."""
    unit, width = skin.plane.height, skin.atlas.depth.shape[1]
    down = skin.flat[:, 1] / unit
    place = (np.abs(down - 0.15) < 0.02) & (np.abs(skin.flat[:, 0]) < 0.6 * skin.plane.radius)
    depth, shown = skin.atlas.depth.copy(), np.full((*skin.atlas.depth.shape, 3), 0.6, np.float32)
    rows, columns = skin.index[place] // width, skin.index[place] % width
    depth[rows, columns] -= 0.08 * unit
    shown[rows, columns] = 0.05
    atlas = replace(skin.atlas, depth=depth, shown=shown)
    return replace(skin, atlas=atlas, hair=None, ears=np.zeros_like(skin.ears), kept={}), place


def test_wires_are_what_is_thin_and_stands_before_the_face(skin, worn):
    assert not wires(replace(skin, ears=np.zeros_like(skin.ears), kept={})).any()
    there, place = worn
    found = wires(there) > 0.5
    assert found[place].mean() > 0.95 and found[~place].mean() < 0.02
    # Hair is no wire.
    combed = replace(there, hair=np.ones_like(skin.tone), kept={})
    assert not wires(combed).any()


def test_wires_are_as_dark_as_in_the_photo_in_the_painters_colors(worn, painter):
    there, place = worn
    palette = Palette.of(painter.given)
    palette = palette._replace(black=np.array([0.1, 0.0, 0.2]))
    light = np.where(place, 0.03, 0.6).astype(np.float32)
    paint = np.full((len(place), 3), 0.5, np.float32)
    drawn = painted_wires(there, paint, light, palette)
    np.testing.assert_allclose(np.median(drawn[place], axis=0), [0.1, 0.0, 0.2], atol=0.06)
    assert np.median(np.abs(drawn[~place] - 0.5)) == 0
    bright = painted_wires(there, paint, np.full_like(light, 0.6), palette)
    np.testing.assert_allclose(np.median(bright[place], axis=0), palette.cheeks, atol=0.02)


def test_a_head_without_any_is_left_as_it_is(skin, painter):
    paint = np.full((len(skin.index), 3), 0.5, np.float32)
    palette = Palette.of(painter.given)
    assert painted_wires(skin, paint, paint[:, 0], palette) is paint


@pytest.fixture
def dark_eyed():
    """A painter whose eyes have black in them."""
    drawn = drawn_face(160, 120)
    for first in (36, 42):
        x, y = drawn.landmarks[first:first + 6].mean(axis=0).astype(int)
        drawn.image[y - 1:y + 2, x - 1:x + 2] = 10
    return SkinPainter(drawn)


def test_a_painting_shows_them(worn, dark_eyed):
    there, place = worn
    painter = dark_eyed
    assert Palette.of(painter.given).black.max() < 0.2
    color = painter.paint(there).color
    canvas = canvas_of(there, 1)[0]
    seen = np.full((len(place), 3), np.nan, np.float32)
    seen[canvas.slots[canvas.own]] = color[canvas.own]
    black = Palette.of(painter.given).black
    assert np.abs(np.nanmedian(seen[place], axis=0) - black).max() < 0.2


# The mouth is drawn after either, by the same steps.
@pytest.mark.parametrize("patchmatch", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_an_open_mouth_of_a_head_is_painted(field, dark_eyed, patchmatch):
    """In the painter's white where the head is light between its lips."""
    marks = HEAD_LANDMARKS.copy()
    width = np.linalg.norm(marks[54] - marks[48])
    marks[[61, 62, 63], 1] += 0.12 * width
    marks[[67, 66, 65], 1] -= 0.12 * width
    skin = Skin.of(field, marks, pixels=PIXELS, networks=False)
    given = dark_eyed.given
    closed = given.landmarks.copy()
    closed[[61, 62, 63]] = closed[[67, 66, 65]] = 0.5 * (closed[[61, 62, 63]]
                                                         + closed[[67, 66, 65]])
    painter = SkinPainter(replace(given, landmarks=closed), SkinConfig(patchmatch=patchmatch))
    assert parts_lips(painter.exemplar, skin.plane.landmarks)
    color = painter.paint(skin).color
    painter._draw = lambda *_: None
    plain = painter.paint(skin).color
    changed = np.abs(color - plain).max(axis=2) > 0.1
    assert 5 < changed.sum() < 0.05 * changed.size
