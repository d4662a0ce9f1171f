"""A painted skin: the exemplar's colors, each place once, the same on every chart."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lfportrait.example import Exemplar, transfers
from lfportrait.example.guides.regions import soft_face
from lfportrait.example.skin.face import CopiedFace
from lfportrait.example.skin.painting import NAPE, THROAT, Painting, SkinPainter, _meeting_behind
from lfportrait.example.skin.sitter import canvas_of
from lfportrait.example.surface_guide import SurfaceGuide
from tests.portraits import drawn_face, with_lines

SKIN, HAIR, CLOTHES, GROUND = (225, 180, 150), (60, 40, 30), (160, 60, 50), (90, 130, 170)


@pytest.fixture(scope="module")
def preview(painter, skin):
    return painter.paint(skin, step=2)


def _colors(painting):
    """Colors of the skin's lists, [N, 3]."""
    return painting.color.reshape(-1, 3)[painting.skin.index]


def test_colors_are_the_exemplars(painting, painter, points):
    color = _colors(painting)
    assert painting.color.dtype == np.float32 and np.isfinite(painting.color).all()
    assert color.shape == (len(points), 3)
    image = painter.exemplar.image.reshape(-1, 3) / 255
    # Made small, its edges swing a little over.
    assert (color.min(axis=0) > image.min(axis=0) - 0.1).all()
    assert (color.max(axis=0) < image.max(axis=0) + 0.1).all()
    away = cKDTree(image).query(color)[0]
    assert np.mean(away) < 0.02 and np.quantile(away, 0.95) < 0.08


@pytest.mark.parametrize("where, wanted", [
    (lambda x, y, z: (np.abs(np.abs(x) - 0.25) < 0.06) & (np.abs(y + 0.2) < 0.04) & (z > 0), SKIN),
    (lambda x, y, z: (np.abs(x) < 0.3) & (y > 0.1) & (z < -0.2), HAIR),
    (lambda x, y, z: (y > -0.95) & (y < -0.8) & (z > 0), CLOTHES)])
def test_a_head_takes_on_its_colors_where_they_belong(painting, points, where, wanted):
    chosen = where(*points.T)
    assert chosen.sum() > 20
    color = _colors(painting)[chosen]
    assert np.abs(np.median(color, axis=0) - np.array(wanted) / 255).max() < 0.06
    assert (np.abs(color - np.array(wanted) / 255).max(axis=1) < 0.15).mean() > 0.85


def test_the_background_stays_off_the_head(painting):
    blue = np.abs(_colors(painting) - np.array(GROUND) / 255).max(axis=1) < 0.1
    assert blue.mean() < 0.01


def test_copies_show_what_their_owners_show(painting, preview):
    for made in (painting, preview):
        step = made.step
        owner = made.skin.atlas.owner
        assert made.color.shape == (owner.shape[0] // step, owner.shape[1] // step, 3)
        if step == 1:
            known = owner >= 0
            flat = made.color.reshape(-1, 3)
            assert np.array_equal(made.color[known], flat[owner[known]])
            assert not made.color[~known].any()
        else:
            surface = np.isfinite(made.skin.atlas.depth)[1::2, 1::2]
            assert (made.color[surface] > 0).any(axis=-1).all()


def test_a_preview_looks_like_the_painting_made_small(painting, preview):
    own = painting.skin.atlas.own
    whole = own[::2, ::2] & own[1::2, ::2] & own[::2, 1::2] & own[1::2, 1::2]
    color = painting.color
    small = (color[::2, ::2] + color[1::2, ::2] + color[::2, 1::2] + color[1::2, 1::2]) / 4
    away = np.abs(small - preview.color)[whole]
    assert away.mean() < 0.05
    assert np.abs((small - preview.color)[whole].mean(axis=0)).max() < 0.02


def test_colors_are_found_at_their_places(painting, preview, skin):
    rows, columns = np.divmod(skin.index, skin.atlas.depth.shape[1])
    places = np.stack([columns, rows], 1).astype(np.float32) + np.float32(0.5)
    places[5] = np.nan
    found = painting.at(places)
    assert np.isnan(found[5]).all()
    known = np.arange(len(places)) != 5
    assert np.allclose(found[known], _colors(painting)[known], atol=1e-6)
    # The middle of a pixel of the preview is the corner of four of the atlas.
    j, i = (a[7] for a in np.nonzero(np.isfinite(skin.atlas.depth[1::2, 1::2])))
    corner = np.array([[2 * i + 1, 2 * j + 1]], np.float32)
    assert np.allclose(preview.at(corner)[0], preview.color[j, i], atol=1e-6)


def test_the_same_seed_gives_the_same_bytes(painter, skin, preview):
    again, other = (SkinPainter(painter.exemplar, seed=seed).paint(skin, step=2)
                    for seed in (0, 1))
    assert isinstance(again, Painting)
    assert preview.color.tobytes() == again.color.tobytes() != other.color.tobytes()


def at_places(skin, flat, **lists):
    """A skin with other lists, whose pixels lie unwrapped at ``flat`` [N, 2]."""
    moved = replace(skin, **lists)
    vars(moved)["flat"] = flat  # instead of where its atlas has them
    return moved


def test_the_guide_comes_around_a_bare_nape_to_the_throat(skin):
    plane, half = skin.plane, np.pi * skin.plane.radius
    angle = np.linspace(-1, 1, 401)
    flat = np.stack([angle * half, np.full(401, 0.9 * plane.height)], axis=1).astype(np.float32)
    bare = at_places(skin, flat, hair=np.zeros(401, np.float32))
    found = _meeting_behind(bare)
    front = np.abs(angle) < NAPE
    assert np.array_equal(found[front], flat[front])
    # Both ends meet, without a jump on the way.
    assert np.allclose(found[[0, -1]], [0, THROAT * plane.height], atol=1e-4)
    assert np.linalg.norm(np.diff(found, axis=0), axis=1).max() < 0.06 * half
    hairy = at_places(skin, flat, hair=np.ones(401, np.float32))
    assert np.array_equal(_meeting_behind(hairy), flat)
    above = at_places(bare, flat * np.float32([1, -1]))
    assert np.array_equal(_meeting_behind(above), above.flat)


def test_lines_are_copied_whole(skin, monkeypatch):
    """A skin in all lights would break a painting's lines into crumbs."""
    made = []
    paint_face = CopiedFace.paint

    def recorded(self, places, guide, canvas, *rest):
        color = paint_face(self, places, guide, canvas, *rest)
        made.append(color[canvas.own & np.append(rest[-1], False)[canvas.slots]])
        return color
    monkeypatch.setattr(CopiedFace, "paint", recorded)
    looks = np.random.default_rng(0).random(len(skin.index), np.float32)
    rough, lined = replace(skin, appearance=looks), with_lines(drawn_face(320, 240), 48)
    SkinPainter(lined).paint(rough, step=2)
    monkeypatch.setattr(transfers.filters, "drawn_lines",
                        lambda image, *rest: np.zeros(image.shape[:2], np.uint8))
    SkinPainter(lined).paint(rough, step=2)
    whole, broken = (np.mean(color[:, 0] < 0.5) for color in made)
    assert whole > 1.5 * broken > 0


def test_what_the_guide_does_not_lead_to_the_face_is_copied_in_holes_alone(monkeypatch):
    inside, around = np.float32([1, 0, 0, 1]), np.float32([0.9, 0.9, 0.6, 0.4])
    blurs = iter([np.ones(4, np.float32), around])
    monkeypatch.setattr(CopiedFace, "_calm", lambda *_: next(blurs))
    planes = np.stack([inside, inside, 0 * inside], axis=1)
    sitter = SimpleNamespace(hair=None, outwards=np.ones(4, bool))
    core = CopiedFace.core(CopiedFace.__new__(CopiedFace), sitter, None, planes, inside, 1.0)
    assert core.tolist() == [True, True, False, False]


@pytest.mark.slow  # paints four times; whose pieces: test_cells.py
def test_no_piece_of_the_face_comes_from_its_outline(painter, skin, monkeypatch):
    """An exemplar with green dots around its face, which a rough skin would like to have."""
    image, points = painter.exemplar.image.copy(), painter.exemplar.landmarks
    soft = soft_face(image.shape, points, 0.4)
    rows, columns = np.indices(soft.shape)
    image[(soft < 240) & (soft > 60) & (rows % 4 < 2) & (columns % 4 < 2)] = 0, 255, 0
    made = []
    paint_face = CopiedFace.paint

    def recorded(self, places, guide, canvas, *rest):
        color = paint_face(self, places, guide, canvas, *rest)
        made.append(color[canvas.own & np.append(rest[-1], False)[canvas.slots]])
        return color
    monkeypatch.setattr(CopiedFace, "paint", recorded)
    random, dotted = np.random.default_rng(0), Exemplar(image, points)
    for seed in range(4):
        rough = replace(skin, appearance=random.random(len(skin.index), np.float32))
        SkinPainter(dotted, seed=seed).paint(rough)
    colors = np.concatenate(made)
    green = colors[:, 1] > colors[:, [0, 2]].max(axis=1) + 0.2
    # A smallest piece may lie across the border: few do, against one of 400 if all were allowed.
    assert len(colors) > 4000 and green.mean() < 0.0015


@pytest.mark.slow  # paints a head twice
def test_landmarks_a_little_beside_are_painted_by_with_what_was_found(painter, skin, preview):
    given = painter.given
    same = painter.moved(given.landmarks).paint(skin, step=2)
    assert np.array_equal(same.color, preview.color)
    nose = given.landmarks + (np.arange(68) == 30)[:, None] * [0.1 * given.size, 0]
    moved, known = painter.moved(nose), SkinPainter(replace(given, landmarks=nose))
    assert np.array_equal(moved.transfer.labels, known.transfer.labels)
    assert np.array_equal(moved.exemplar.landmarks, known.exemplar.landmarks)
    # The guide is the new one: only what is found in the picture is that of before.
    places = canvas_of(skin, 2)[1]
    for one, other in zip(*(each._positions(SurfaceGuide(
            skin.plane.landmarks, each.exemplar, each.transfer.regions), places)
            for each in (moved, known))):
        assert np.quantile(np.abs(one - other), 0.99) < 0.5
    other = moved.paint(skin, step=2).color
    assert not np.array_equal(other, preview.color)
    assert 10 * np.log10(1 / np.mean((other - known.paint(skin, step=2).color) ** 2)) > 25
    # Nothing of it stays behind.
    assert np.array_equal(painter.paint(skin, step=2).color, preview.color)


def test_landmarks_that_were_moved_can_be_moved_once_more(painter):
    given, nose = painter.given, (np.arange(68) == 30)[:, None]
    once, twice = (given.landmarks + nose * [way * given.size, 0] for way in (0.1, 0.14))
    moved = painter.moved(once).moved(twice)
    assert np.array_equal(moved.exemplar.landmarks, painter.moved(twice).exemplar.landmarks)
    assert np.allclose(moved.given.landmarks, twice)
    # What was found lies where it was: step by step nothing goes further from there.
    assert moved.moved(given.landmarks + nose * [0.2 * given.size, 0]) is None


@pytest.mark.parametrize(("points", "way"), [(range(68), 0.2), ([36], 0.05), ([57], 0.16)])
def test_landmarks_that_are_far_or_the_eyes_need_a_painter_of_their_own(painter, points, way):
    landmarks = painter.given.landmarks.copy()
    landmarks[list(points), 1] += way * painter.given.size
    assert painter.moved(landmarks) is None
