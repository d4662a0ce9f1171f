"""Known colors of a head's surface come back from the field that was painted with them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from lfportrait.capture import Camera
from lfportrait.example import Painting, Skin
from lfportrait.stylize.fit import ColorModel
from lfportrait.stylize.skin import (
    ASIDE,
    chart_pixels,
    chart_views,
    for_lattice,
    look_up_rows,
    row_labels,
    show_painting,
)
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
    """Every surface point of the atlas in its known color, also beside the surface."""
    skin = Skin.of(field, HEAD_LANDMARKS, pixels=64.0, networks=False)
    atlas = skin.atlas
    color = known_color(atlas.points.reshape(-1, 3)[np.maximum(atlas.owner, 0)])
    color[atlas.owner < 0] = 0
    return Painting(skin, color, 1, {})


@pytest.fixture(scope="module")
def views(field, painting):
    found = chart_views(field, painting.skin, GREY)
    show_painting(found, painting, GREY)
    return found


def test_rows_near_the_surface_have_a_place_under_it(field, painting):
    places = painting.skin.rows
    points = field.lattice_points()
    assert places.shape == (len(points), 2) and places.dtype == np.float32
    known = np.isfinite(places[:, 0])
    ball = points[:, 1] > -0.15
    under = 0.6 - np.linalg.norm(points, axis=1)
    assert known[ball & (np.abs(under - 1.5 * VOXEL) < 2.5 * VOXEL)].mean() > 0.99
    assert not known[ball & (under > 8.5 * VOXEL)].any()
    shown = painting.skin.atlas.points[places[known, 1].astype(int), places[known, 0].astype(int)]
    away = np.linalg.norm(shown - points[known], axis=1)
    assert np.nanmax(away) < 10 * VOXEL


def test_rows_take_the_color_of_the_surface_above_them(field, painting):
    model = ColorModel(field, GREY)
    before = model.colors.copy()
    look_up_rows(model, painting)
    known = np.isfinite(painting.skin.rows[:, 0])
    assert np.array_equal(model.seen, known.astype(np.float32))
    assert np.array_equal(model.colors[~known], before[~known])
    points = field.lattice_points()
    ball = known & (points[:, 1] > -0.15)
    above = 0.6 * points[ball] / np.linalg.norm(points[ball], axis=1)[:, None]
    error = np.abs(model.colors[ball] - known_color(above)).max(axis=1)
    assert np.median(error) < 0.03 and np.quantile(error, 0.95) < 0.15


def waves(painting, field, period, step):
    """A painting of vertical waves, so many lattice points long, and where the skin is known."""
    atlas = painting.skin.atlas
    known = (atlas.owner >= 0)[::step, ::step]
    x = np.arange(known.shape[1]) * step / (field.spacing.mean() * painting.skin.pixels)
    wave = 0.5 + 0.4 * np.sin(2 * np.pi * x / period)
    color = np.where(known[..., None], wave[:, None].repeat(3, axis=1), 0).astype(np.float32)
    return replace(painting, color=color, step=step), known


@pytest.mark.parametrize("step", [1, 2])
def test_below_a_texture_a_lattice_has_no_strokes_that_it_can_not_show(field, painting, step):
    fine, known = waves(painting, field, 1.5, step)
    inside = binary_erosion(known, iterations=12)
    assert np.abs(for_lattice(fine, field).color[inside] - 0.5).max() < 0.03
    coarse, _ = waves(painting, field, 30.0, step)
    # Nothing is known beside the skin: it must not darken its border.
    assert np.abs(for_lattice(coarse, field).color - coarse.color)[known].max() < 0.06


def test_rows_have_the_regions_of_the_surface_above_them(field, painting):
    labels, names = row_labels(painting.skin)
    points = field.lattice_points()
    known = np.isfinite(painting.skin.rows[:, 0])
    assert labels.shape == (len(points), len(names)) and not labels[~known].any()
    named = np.array(names)[labels.argmax(axis=1)]
    assert (named[known & (points[:, 1] < -0.85)] == "clothes").mean() > 0.95
    assert (named[known & (points[:, 1] > 0.45)] == "hair").mean() > 0.95


def test_charts_become_views_that_are_trusted_where_they_own(field, painting, views):
    atlas = painting.skin.atlas
    assert len(views) == len(atlas.boxes)
    model = ColorModel(field, GREY)
    for n, view in enumerate(views):
        there, (x0, y0, x1, y1) = chart_pixels(painting.skin, n, 1), atlas.boxes[n, :4]
        assert view.shape == (y1 - y0, x1 - x0)
        assert view.content.shape == view.example.shape == (*view.shape, 3)
        own = atlas.own[there]
        # What it does not own has no rows: it shows the background, and does not count.
        assert not view.alpha[~own].any() and not view.trust[~own].any()
        assert np.allclose(view.example[~own], GREY) and np.allclose(view.content[~own], GREY)
        assert view.alpha[own].min() > 0.25
        assert np.array_equal(view.trust[own], view.alpha[own])
        solid = view.alpha > 0.999
        assert np.allclose(view.example[solid], painting.color[there][solid], atol=2e-3)
        assert np.allclose(view.content[solid], atlas.color[there][solid], atol=2e-3)
        # The rows behind the pixels are those that the chart's camera sees.
        shot = field.render(atlas.cameras[n], 0, background=GREY).color[y0:y1, x0:x1]
        assert np.abs(model.picture(view) - shot)[solid].max() < 0.03


def test_smaller_views_show_the_painting_made_small(field, painting):
    skin = painting.skin
    own = skin.atlas.own
    small = painting.color.reshape(own.shape[0] // 2, 2, own.shape[1] // 2, 2, 3).mean((1, 3))
    preview = Painting(skin, small, 2, {})
    one, two = (chart_views(field, skin, GREY, step=2) for _ in range(2))
    show_painting(one, painting, GREY, 2)
    show_painting(two, preview, GREY, 2)
    model = ColorModel(field, GREY)
    for n, (view, same) in enumerate(zip(one, two)):
        assert view.example.tobytes() == same.example.tobytes()
        there = chart_pixels(skin, n, 2)
        assert view.shape == own[there].shape
        inner = own[there] & (view.alpha > 0.999)
        assert np.abs(view.example - painting.color[there])[inner].mean() < 0.02
        assert np.allclose(view.trust[inner], view.alpha[inner])
        aside = ~own[there] & (view.alpha > 0.999)
        assert np.allclose(view.trust[aside], ASIDE, atol=1e-3)
        assert not view.trust[view.alpha < 0.05].any()
        assert np.abs(model.picture(view) - view.content)[inner].mean() < 0.04


def test_known_colors_come_back_from_the_fit(field, painting, views):
    model = ColorModel(field, GREY)
    look_up_rows(model, painting)
    looked_up = model.colors.copy()
    errors = model.fit(views, 8)
    assert errors[-1] < 0.1 * errors[0] and np.sqrt(errors[-1]) < 0.01
    model.fill_unseen()
    # A camera of its own sees each surface point in its color.
    camera = Camera.arc([25.0], distance=4.0, width=96, height=96, focal=150.0, pitch=10.0)
    for colors in (looked_up, model.colors):
        painted = field.with_sh(((colors - 0.5) / 0.28209479177387814)[:, :, None])
        shot = painted.render(camera, 0)
        points = shot.points(camera, 0)
        seen = np.isfinite(points[..., 0]) & (shot.alpha > 0.99) & (points[..., 1] > -0.5)
        assert seen.sum() > 1000
        assert np.abs(shot.color[seen] - known_color(points[seen])).mean() < 0.025
