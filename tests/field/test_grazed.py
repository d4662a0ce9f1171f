"""Where photos only look along a surface its colors are even; elsewhere they stay."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lfportrait.capture import Camera, Capture
from lfportrait.field.closing.fitted_head import Ears
from lfportrait.field.closing.grazed import (
    Grazed,
    faced_by,
    photo_colors,
    with_even_colors,
    without_specks,
)
from lfportrait.field.closing.photos import Photos
from lfportrait.field.geometry.chart import chart_of, read_surface
from lfportrait.field.kernels.march import C0
from tests.fields import head_field
from tests.portraits import HEAD_LANDMARKS

SIZE = 48
ARC = Camera.arc(np.linspace(-14, 14, 9), distance=5.0, width=120, height=120, focal=250.0)


@pytest.fixture(scope="module")
def head():
    """A head with specks, its chart and distances."""
    field = head_field(SIZE)
    sh = np.random.default_rng(0).normal(0, 0.5, (len(field.sh), 3, 9)).astype(np.float32)
    sh[:, :, :1] += field.sh
    voxel = 2 / SIZE
    chart = chart_of(field.lattice_points()[field.density > 0], voxel, HEAD_LANDMARKS)
    distance = read_surface(field, chart, None)[0]
    return replace(field, sh=sh), chart, np.where(np.isfinite(distance), distance, 0.3)


def test_an_arc_faces_the_front_and_no_side(head):
    _, chart, distance = head
    faced = faced_by(chart, distance, ARC)
    angle = np.degrees(np.abs(chart.angle))
    face = (chart.axis[:, 1] > -0.3) & (np.arange(len(chart.axis)) < chart.level)
    assert faced[face][:, angle < 40].min() > 0.95
    assert faced[face][:, angle > 125].max() < 0.05
    # From further around, the sides are seen as well.
    wide = Camera.arc(np.linspace(-80, 80, 17), distance=5.0, width=120, height=120, focal=250.0)
    assert faced_by(chart, distance, wide)[face][:, angle < 90].min() > 0.9
    # Of a body all stays.
    assert np.all(faced[chart.axis[:, 1] < -0.95] == 1)


def test_specks_go_edges_stay():
    random = np.random.default_rng(1)
    clean = np.full((40, 60, 3), (0.7, 0.5, 0.4))
    clean[:20] *= 0.5
    colors = clean + np.where(random.random((40, 60, 1)) < 0.1, random.normal(0, 0.3, (40, 60, 3)),
                              0.0)
    told = random.random((40, 60)) > 0.05
    even = without_specks(np.where(told[..., None], colors, np.nan), told, None)
    inner = np.s_[4:17, :]
    assert np.abs(even - clean)[inner].max() < 0.05 < np.abs(colors - clean)[inner].max()
    light = even.mean(axis=-1).mean(axis=1)
    assert light[22] - light[17] > 0.9 * (0.5333 - 0.2667)


def test_hair_and_skin_do_not_mix():
    hair = np.zeros((40, 60), bool)
    hair[:, 30:45] = True
    colors = np.where(hair[..., None], (0.1, 0.05, 0.0), (0.8, 0.6, 0.5))
    told = np.ones((40, 60), bool)
    told[10:20, 25:50] = False
    even = without_specks(np.where(told[..., None], colors, np.nan), told, hair)
    inner = hair & np.roll(hair, 4, 1) & np.roll(hair, -4, 1)
    assert np.abs(even - colors)[inner].max() < 0.03
    plain = without_specks(np.where(told[..., None], colors, np.nan), told, None)
    border = hair & ~np.roll(hair, 1, 1)
    assert np.abs(even - colors)[border].mean() < np.abs(plain - colors)[border].mean()


def test_colors_are_even_where_nothing_faces_them_and_stay_elsewhere(head):
    field, chart, distance = head
    left = chart.angle < 0
    faced = np.broadcast_to(np.where(left, 0.0, 1.0), distance.shape).copy()
    nothing = np.zeros(distance.shape, bool)
    even = with_even_colors(field, Grazed(chart, distance, faced, None, nothing, None, None))
    assert np.array_equal(even.density, field.density) and np.array_equal(even.links, field.links)
    points = field.lattice_points()
    near = (np.abs(np.linalg.norm(points, axis=1) - 0.6) < 0.04) & (points[:, 2] > 0.2)
    near &= np.abs(points[:, 1]) < 0.1
    stays, goes = near & (points[:, 0] > 0.1), near & (points[:, 0] < -0.1)
    assert np.array_equal(even.sh[stays], field.sh[stays])
    assert C0 * even.sh[goes][..., 0].std(axis=0).max() < 0.5 * C0 * (
        field.sh[goes][..., 0].std(axis=0).min())
    # Even is from all sides alike, and no other color.
    assert not even.sh[goes][..., 1:].any()
    middle = [0.5 + C0 * one.sh[goes][..., 0].mean(axis=0) for one in (even, field)]
    assert np.abs(middle[0] - middle[1]).max() < 0.06


def test_hair_that_nothing_faces_keeps_the_strands_of_before_the_last_training(head):
    field, chart, distance = head
    left, hair = chart.angle < 0, np.ones(distance.shape, bool)
    faced = np.broadcast_to(np.where(left, 0.0, 1.0), distance.shape).copy()
    trained = replace(field, sh=field.sh + np.float32(0.5))
    grazed = Grazed(chart, distance, faced, None, ~hair, hair, None)
    even = with_even_colors(trained, grazed, field)
    points = field.lattice_points()
    near = (np.abs(np.linalg.norm(points, axis=1) - 0.6) < 0.04) & (np.abs(points[:, 1]) < 0.1)
    stays, goes = near & (points[:, 0] > 0.1), near & (points[:, 0] < -0.1)
    assert np.array_equal(even.sh[stays], trained.sh[stays])
    np.testing.assert_allclose(even.sh[goes], field.sh[goes], atol=1e-6)
    assert np.array_equal(with_even_colors(trained, grazed).sh, trained.sh)


def test_hair_that_nothing_faces_has_the_colors_it_was_closed_in(head):
    field, chart, distance = head
    left, hair = chart.angle < 0, np.ones(distance.shape, bool)
    faced = np.broadcast_to(np.where(left, 0.0, 1.0), distance.shape).copy()
    paint = np.full((*distance.shape, 3), (0.3, 0.2, 0.1))
    even = with_even_colors(field, Grazed(chart, distance, faced, None, ~hair, hair, None,
                                          paint=paint), field)
    points = field.lattice_points()
    near = (np.abs(np.linalg.norm(points, axis=1) - 0.6) < 0.04) & (np.abs(points[:, 1]) < 0.1)
    stays, goes = near & (points[:, 0] > 0.1), near & (points[:, 0] < -0.1)
    assert np.array_equal(even.sh[stays], field.sh[stays])
    assert np.abs(0.5 + C0 * even.sh[goes][..., 0] - paint[0, 0]).max() < 1e-6
    assert not even.sh[goes][..., 1:].any()


@pytest.mark.parametrize(("ground", "goes"), [
    ((0.6, 0.6, 0.62), True), ((0.3, 0.5, 0.3), True), ((0.35, 0.24, 0.19), False),
    ((0.45, 0.22, 0.14), False)])
def test_a_patch_of_the_wall_on_skin_goes_and_shade_stays(head, ground, goes):
    field, chart, distance = head
    points = field.lattice_points()
    angle = np.degrees(np.arctan2(points[:, 0], points[:, 2]))
    skin = np.array((0.7, 0.48, 0.38))
    patch = (np.abs(angle + 90) < 50) & (np.abs(points[:, 1]) < 0.3)
    sh = np.zeros_like(field.sh)
    sh[:, :, 0] = (np.where(patch[:, None], ground, skin) - 0.5) / C0
    faced = np.broadcast_to(np.where(chart.angle < 0, 0.0, 1.0), distance.shape).copy()
    grazed = Grazed(chart, distance, faced, None, np.zeros(distance.shape, bool), None, None,
                    paint=np.full((*distance.shape, 3), skin))
    even = with_even_colors(replace(field, sh=sh), grazed)
    middle = (np.abs(angle + 90) < 15) & (np.abs(np.linalg.norm(points, axis=1) - 0.6) < 0.04)
    middle &= np.abs(points[:, 1]) < 0.1
    found = np.median(0.5 + C0 * even.sh[middle][..., 0], axis=0)
    assert np.abs(found - (skin if goes else ground)).max() < 0.05


def test_next_to_ears_hair_keeps_its_colors(head):
    field, chart, distance = head
    hair = np.ones(distance.shape, bool)
    places = np.array([[-0.6, 0.0, 0.0]])
    ears = Ears(places, places / 0.6, np.ones(1, bool), np.zeros((0, 2, 3)), cKDTree(places), 0.05,
                0.02)
    beside = np.broadcast_to(np.abs(np.degrees(chart.angle) + 90) < 15, distance.shape)
    grazed = Grazed(chart, distance, np.zeros(distance.shape), ears, beside, hair, None,
                    paint=np.full((*distance.shape, 3), 0.3))
    even = with_even_colors(field, grazed)
    points = field.lattice_points()
    angle = np.degrees(np.arctan2(points[:, 0], points[:, 2]))
    near = (np.abs(np.linalg.norm(points, axis=1) - 0.6) < 0.04) & (np.abs(points[:, 1]) < 0.1)
    by_ear, far = near & (np.abs(angle + 90) < 22), near & (angle > 0)
    assert np.array_equal(even.sh[by_ear], field.sh[by_ear])
    assert np.abs(0.5 + C0 * even.sh[far][..., 0] - 0.3).max() < 1e-6


def test_hair_must_be_faced_more_squarely_than_skin(head):
    _, chart, distance = head
    every = np.ones(distance.shape, bool)
    skin, hair = (faced_by(chart, distance, ARC, part) for part in (~every, every))
    assert np.array_equal(skin, faced_by(chart, distance, ARC))
    head_rows = (chart.axis[:, 1] > -0.3) & (np.arange(len(chart.axis)) < chart.level)
    between = head_rows[:, None] & (skin > 0.1) & (skin < 1)
    assert np.all(hair <= skin) and np.all(hair[between] < skin[between])


@pytest.fixture(scope="module")
def photographed(head):
    """A gray head with specks, darker on its left, and an arc of photos without them."""
    sh = np.zeros_like(head[0].sh)
    sh[:, :, 0] = (np.where(head[0].lattice_points()[:, :1] > 0, 0.4, 0.7) - 0.5) / C0
    clean = replace(head[0], sh=sh)
    specks = np.random.default_rng(2).normal(0, 0.5, (len(sh), 3, 1)).astype(np.float32)
    field = replace(clean, sh=sh + specks * (np.arange(9) == 0))
    views = [clean.render(ARC, view) for view in range(len(ARC))]
    images = [np.uint8(255 * np.clip(view.color, 0, 1)) for view in views]
    # One was exposed otherwise, and something green passed before another.
    images[3] = np.uint8(images[3] * 0.8)
    images[5][:] = (0, 255, 0)
    alphas = [np.uint8(255 * np.clip(view.alpha, 0, 1)) for view in views]
    return field, Photos(field, Capture(ARC, images, alphas, [str(k) for k in range(len(ARC))],
                                        np.zeros(len(ARC), bool)))


def test_photos_know_the_colors_that_they_look_along(head, photographed):
    (field, photos), (_, chart, distance) = photographed, head
    told = np.ones(distance.shape, bool)
    colors = read_surface(field, chart, None)[1]
    shown, share = photo_colors(photos, chart, distance, colors, told)
    angle = np.degrees(chart.angle)
    rows = (np.abs(chart.axis[:, 1]) < 0.1) & (np.arange(len(chart.axis)) < chart.level)
    for low, high, true in ((-65, -20, 0.7), (20, 65, 0.4)):
        part = np.ix_(rows, (angle > low) & (angle < high))
        assert share[part].min() == 1.0
        assert np.abs(shown[part].mean(axis=-1) - true).max() < 0.05
        assert np.abs(colors[part].mean(axis=-1) - true).max() > 0.1
    # What no photo shows is the field's.
    behind = np.ix_(rows, np.abs(angle) > 120)
    assert not share[behind].any() and np.array_equal(shown[behind], colors[behind])
    even = with_even_colors(field, Grazed(chart, distance, np.zeros(distance.shape), None, ~told,
                                          None, None, photos))
    points = field.lattice_points()
    near = (np.abs(np.linalg.norm(points, axis=1) - 0.6) < 0.04) & (points[:, 2] > 0.2)
    near &= (np.abs(points[:, 1]) < 0.1) & (points[:, 0] < -0.2)
    assert np.abs(0.5 + C0 * even.sh[near][..., 0] - 0.7).max() < 0.06


def test_beside_what_is_nearer_photos_tell_no_colors(head, photographed):
    (_, photos), (_, chart, distance) = photographed, head
    level = (np.abs(chart.axis[:, 1]) < 0.1) & (np.arange(len(chart.axis)) < chart.level)
    front = np.ix_(level, np.abs(chart.angle) < 0.7)
    points = chart.points(distance)[front]
    normals = points / np.linalg.norm(points, axis=-1, keepdims=True)
    nothing = np.full(points.shape, np.nan)
    assert photos.colors(points, normals, nothing)[1].min() > 0.5
    beside = copy.copy(photos)
    # A pixel next to each shows something two tenths before it.
    beside._first = [first - np.float32(0.2) for first in photos._first]
    assert not beside.colors(points, normals, nothing)[1].any()


@pytest.mark.parametrize("strip, kept", [((0.3, 0.5, 0.8), False), ((0.2, 0.15, 0.11), True)],
                         ids=["wall", "shade"])
def test_an_ear_loses_what_no_photo_faces_and_a_strip_of_wall(head, photographed, strip, kept):
    (field, photos), (_, chart, distance) = photographed, head
    points = field.lattice_points()
    colors = np.broadcast_to((0.8, 0.6, 0.5), points.shape).copy()
    stripe = (np.abs(points[:, 1]) < 0.04) & (points[:, 2] > 0)
    hidden = points[:, 2] < -0.1
    colors[stripe], colors[hidden] = strip, (0.1, 0.9, 0.1)
    sh = np.zeros_like(field.sh)
    sh[..., 0] = (colors - 0.5) / C0
    angle, height = np.mgrid[np.radians(-130):np.radians(-30):60j, -0.3:0.3:40j]
    across = np.sqrt(0.36 - height ** 2)
    places = np.stack([across * np.sin(angle), height, across * np.cos(angle)], -1).reshape(-1, 3)
    ears = Ears(places, places / 0.6, np.ones(len(places), bool), np.zeros((0, 2, 3)),
                cKDTree(places), 0.05, 0.02)
    even = with_even_colors(replace(field, sh=sh), Grazed(
        chart, distance, np.ones(distance.shape), ears, np.zeros(distance.shape, bool), None, None,
        photos))
    found = 0.5 + C0 * even.sh[..., 0]
    ear = ears.distance(points)[0] < 0.02
    assert (hidden & ear).sum() > 20 and (stripe & ear).sum() > 20
    assert np.abs(found - (0.8, 0.6, 0.5))[hidden & ear].max() < 0.05
    front = stripe & ear & (points[:, 2] > 0.2) & (np.linalg.norm(points, axis=1) > 0.57)
    assert np.abs(found - (strip if kept else (0.8, 0.6, 0.5)))[front].max() < 0.05
    assert np.allclose(even.sh[points[:, 0] > 0], sh[points[:, 0] > 0], atol=1e-5)


def test_what_stands_out_beside_a_fitted_ear_is_no_skin_of_the_head(head, photographed):
    (field, photos), (_, chart, distance) = photographed, head
    # The fitted ear lies behind the one that photos show, on the left.
    angle, height = np.mgrid[np.radians(-130):np.radians(-110):20j, -0.3:0.3:40j]
    across = np.sqrt(0.36 - height ** 2)
    places = np.stack([across * np.sin(angle), height, across * np.cos(angle)], -1).reshape(-1, 3)
    ears = Ears(places, places / 0.6, np.ones(len(places), bool), np.zeros((0, 2, 3)),
                cKDTree(places), 0.05, 0.02)
    beside = np.broadcast_to(np.abs(np.degrees(chart.angle) + 80) < 40, distance.shape)
    # The field stands out of the closed surface there, in another color than the head's.
    points = field.lattice_points()
    ear, head_color = (0.8, 0.6, 0.5), (0.5, 0.6, 0.8)
    angle = np.degrees(np.arctan2(points[:, 0], points[:, 2]))
    sh = np.zeros_like(field.sh)
    sh[..., 0] = (np.where((np.abs(angle + 80) < 42)[:, None], ear, head_color) - 0.5) / C0
    surface = np.where(beside, distance - 5 * 2 / SIZE, distance)
    grazed = Grazed(chart, surface, np.zeros(distance.shape), ears, beside, None, None, photos)
    shown = (np.abs(angle + 65) < 10) & (np.abs(points[:, 1]) < 0.1)
    shown &= (photos.faced(points, 0.2) >= 4) & (field.density > 8)
    assert shown.sum() > 5
    even = with_even_colors(replace(field, sh=sh), grazed)
    assert np.abs(0.5 + C0 * even.sh[shown][..., 0] - ear).max() < 0.02
    # Away from ears it takes the colors around.
    elsewhere = with_even_colors(replace(field, sh=sh), replace(
        grazed, beside=np.zeros(distance.shape, bool)))
    assert np.abs(0.5 + C0 * elsewhere.sh[shown][..., 0] - ear).max() > 0.06


def test_hair_keeps_its_strands(head):
    field, chart, distance = head
    nothing = np.zeros(distance.shape, bool)
    hair = np.broadcast_to(chart.angle > 0, distance.shape).copy()
    even = with_even_colors(field, Grazed(chart, distance, np.zeros(distance.shape), None, nothing,
                                          hair, None))
    points = field.lattice_points()
    near = (np.abs(np.linalg.norm(points, axis=1) - 0.6) < 0.04) & (points[:, 2] > 0.2)
    left, right = near & (points[:, 0] < -0.1), near & (points[:, 0] > 0.1)
    assert np.array_equal(even.sh[right], field.sh[right])
    assert not np.isclose(even.sh[left][..., 0], field.sh[left][..., 0]).any(axis=1).all()


def test_what_shows_nothing_is_left_alone(head):
    field, chart, distance = head
    nowhere = Grazed(chart, distance, np.zeros(distance.shape), None,
                     np.ones(distance.shape, bool), None, None)
    assert with_even_colors(field, nowhere) is field


def test_a_finer_chart_has_the_same_rays_and_those_between(head):
    chart = head[1]
    fine = chart.finer()
    places, away = chart.places(fine.points(np.full(chart.halves.shape[1:], 0.5)).reshape(-1, 3))
    # A place beyond the last row or the first column is the same one counted otherwise.
    inner = np.zeros(chart.halves.shape[1:], bool)
    inner[1:-1, 1:] = True
    assert np.allclose(places[:, inner.ravel()], chart.halves[:, inner], atol=1e-6)
    assert np.allclose(away[inner.ravel()], 0.5)


def test_new_is_what_was_closed_and_the_ears(head):
    _, chart, distance = head
    gap = np.broadcast_to(np.abs(chart.angle) > 2.0, distance.shape)
    places = np.array([[0.7, 0.0, 0.0], [0.6, 0.0, 0.1]])
    ears = Ears(places, np.array([[1.0, 0, 0]] * 2), np.array([True, False]),
                np.zeros((0, 2, 3)), cKDTree(places), 0.05, 0.02)
    grazed = Grazed(chart, distance, np.ones(distance.shape), ears, ~gap, None, None, None, gap)
    found, outwards = grazed.new()
    assert len(found) == gap.sum() + 1 and np.array_equal(found[-1], places[0])
    level = (np.abs(found[:-1, 1]) < 0.1) & (np.linalg.norm(found[:-1], axis=1) > 0.5)
    assert level.sum() > 20 and (found[:-1][level, 2] < 0.1).all()
    assert ((found * outwards).sum(axis=1)[:-1][level] > 0).all()
