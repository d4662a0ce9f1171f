"""Known colours of a head's surface come back from the field that was painted with them."""

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.example import LABELS
from lfportrait.example.skin import Painting, Skin
from lfportrait.stylize.fit import ColorModel
from lfportrait.stylize.skin_fit import BEHIND, chart_views, look_up_rows, row_places
from tests.fields import head_field
from tests.portraits import HEAD_LANDMARKS

GREY = 0.7
VOXEL = 2 / 48


def known_color(points):
    return (0.5 + 0.4 * np.sin(3 * np.nan_to_num(points) + [0, 1, 2])).astype(np.float32)


@pytest.fixture(scope="module")
def field():
    return head_field()


@pytest.fixture(scope="module")
def painting(field):
    """Every surface point of the atlas in its known colour, also beside the surface."""
    skin = Skin.of(field, HEAD_LANDMARKS, pixels=64.0, networks=False)
    atlas = skin.atlas
    color = known_color(atlas.points.reshape(-1, 3)[np.maximum(atlas.owner, 0)])
    color[atlas.owner < 0] = 0
    labels = np.zeros((len(skin.index), len(LABELS)), np.uint8)
    return Painting(skin, color, 1, labels, {})


def test_rows_near_the_surface_have_a_place_under_it(field, painting):
    places = row_places(field, painting.skin)
    points = field.lattice_points()
    assert places.shape == (len(points), 2) and places.dtype == np.float32
    known = np.isfinite(places[:, 0])
    ball = points[:, 1] > -0.15
    under = 0.6 - np.linalg.norm(points, axis=1)
    assert known[ball & (np.abs(under - 1.5 * VOXEL) < 2.5 * VOXEL)].mean() > 0.99
    assert not known[ball & (under > (BEHIND + 1.5) * VOXEL)].any()
    shown = painting.skin.atlas.points[places[known, 1].astype(int), places[known, 0].astype(int)]
    away = np.linalg.norm(shown - points[known], axis=1)
    assert np.nanmax(away) < (BEHIND + 3) * VOXEL


def test_rows_take_the_colour_of_the_surface_above_them(field, painting):
    model = ColorModel(field, GREY)
    before = model.colors.copy()
    places = row_places(field, painting.skin)
    look_up_rows(model, painting, places)
    known = np.isfinite(places[:, 0])
    assert np.array_equal(model.seen, known.astype(np.float32))
    assert np.array_equal(model.colors[~known], before[~known])
    points = field.lattice_points()
    ball = known & (points[:, 1] > -0.15)
    above = 0.6 * points[ball] / np.linalg.norm(points[ball], axis=1)[:, None]
    error = np.abs(model.colors[ball] - known_color(above)).max(axis=1)
    assert np.median(error) < 0.03 and np.quantile(error, 0.95) < 0.15


def test_charts_become_views_that_are_trusted_where_they_own(field, painting):
    views = chart_views(field, painting, GREY)
    atlas = painting.skin.atlas
    assert len(views) == len(atlas.boxes)
    assert sum(int(view.confidence.sum()) for view in views) == int(atlas.own.sum())
    model = ColorModel(field, GREY)
    for n, (view, (x0, y0, x1, y1, dx, dy)) in enumerate(zip(views, atlas.boxes.tolist())):
        there = slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)
        assert view.shape == (y1 - y0, x1 - x0)
        assert view.content.shape == view.example.shape == (*view.shape, 3)
        assert np.array_equal(view.confidence, atlas.own[there].astype(np.float32))
        held = atlas.owner[there] >= 0
        assert not view.alpha[~held].any()
        assert np.allclose(view.example[~held], GREY) and np.allclose(view.content[~held], GREY)
        assert view.alpha[atlas.own[there]].min() > 0.3
        solid = view.alpha > 0.999
        assert np.allclose(view.example[solid], painting.color[there][solid], atol=2e-3)
        # The rows behind the pixels are those that the chart's camera sees.
        shot = field.render(atlas.cameras[n], 0, background=GREY)
        inner = solid & atlas.own[there]
        assert np.abs(model.picture(view) - shot.color[y0:y1, x0:x1])[inner].max() < 0.03


def test_known_colours_come_back_from_the_fit(field, painting):
    model = ColorModel(field, GREY)
    look_up_rows(model, painting, row_places(field, painting.skin))
    looked_up = model.colors.copy()
    errors = model.fit(chart_views(field, painting, GREY), 8)
    assert errors[-1] < 0.1 * errors[0] and np.sqrt(errors[-1]) < 0.01
    model.fill_unseen()
    # A camera of its own sees each surface point in its colour.
    camera = Camera.arc([25.0], distance=4.0, width=96, height=96, focal=150.0, pitch=10.0)
    for colors in (looked_up, model.colors):
        model.colors = colors
        shot = field.with_sh(model.coefficients(field)).render(camera, 0)
        points = shot.points(camera, 0)
        seen = np.isfinite(points[..., 0]) & (shot.alpha > 0.99) & (points[..., 1] > -0.5)
        assert seen.sum() > 1000
        assert np.abs(shot.color[seen] - known_color(points[seen])).mean() < 0.025
