"""What a narrow arc does not show follows a fitted head; its ears are solids of their own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lfportrait.capture import Camera, Capture
from lfportrait.field.closing import FittedHead, close_back, fitted_head, sides
from lfportrait.field.closing.fitted_head import (
    _WHOLE,
    Ears,
    _as_high,
    _Move,
    _moved,
    _shown,
    _Skull,
    ears_of,
    head_distance,
    mesh_samples,
)
from lfportrait.field.closing.photos import Photos
from lfportrait.field.closing.shell import Shell, _changed, with_shell
from lfportrait.field.geometry.head_surface import HeadSurface, bust_chart, bust_distance
from tests.fields import head_field
from tests.portraits import HEAD_LANDMARKS

SIDE = 160


def ball(radii=(1.0, 1.0, 1.0), middle=(0.0, 0.0, 0.0), rows=40):
    """An ellipsoid as a mesh: points [N, 3] and triangles."""
    across = 2 * rows
    high, around = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, rows + 1),
                               np.arange(across) * 2 * np.pi / across, indexing="ij")
    points = np.stack([np.cos(high) * np.sin(around), np.sin(high),
                       np.cos(high) * np.cos(around)], -1).reshape(-1, 3)
    mesh = np.arange((rows + 1) * across).reshape(rows + 1, across)
    right = np.roll(mesh, -1, axis=1)
    triangles = np.concatenate([
        np.stack([mesh[:-1], right[:-1], right[1:]], -1).reshape(-1, 3),
        np.stack([mesh[:-1], right[1:], mesh[1:]], -1).reshape(-1, 3)])
    corners = points[triangles]
    flat = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0],
                                   corners[:, 2] - corners[:, 0]), axis=1) < 1e-9
    return points * radii + middle, triangles[~flat].astype(np.int32)


def test_samples_lie_on_a_mesh_and_face_outwards():
    points, triangles = ball()
    places, normals, triangle = mesh_samples(points, triangles, 0.02)
    assert np.abs(np.linalg.norm(places, axis=1) - 1).max() < 0.005
    assert (normals * places).sum(axis=1).min() > 0.98
    assert set(triangle) == set(range(len(triangles)))
    # None is further from the next than asked for.
    assert cKDTree(places).query(points)[0].max() < 0.03


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_a_chart_reads_a_fitted_head(scale):
    frame = np.diag([scale, scale, scale, 1.0])
    chart = bust_chart(0.03, 0.0, frame)
    around = bust_distance(chart)
    middle = np.array([0.0, 0.1, -0.04])
    points, triangles = ball((0.4, 0.5, 0.45), middle)
    ear = np.zeros(len(points), bool)
    knob, more = ball((0.1, 0.1, 0.1), (0.42, 0.1, -0.04), rows=12)
    head = FittedHead(np.concatenate([points, knob]),
                      np.concatenate([triangles, more + len(points)]),
                      np.append(ear, np.ones(len(knob), bool)))
    found = head_distance(head, chart, around)
    places = (chart.points(found) * scale - middle) / [0.4, 0.5, 0.45]
    inside = (chart.axis[:, 1] > -0.15)[:, None] & np.ones(around.shape, bool)
    # The knob at its side is an ear, which is none of the skull.
    assert np.abs(np.linalg.norm(places[inside], axis=1) - 1).max() < 0.06
    # Far below, where the ball has no surface, the bust goes on.
    low = chart.axis[:, 1] < -1.2
    assert np.abs(np.log(found[low] / around[low])).max() < 0.25


def surface_of(facing, rows=None):
    chart = bust_chart(0.05)
    distance = bust_distance(chart)
    return HeadSurface(chart, distance, np.ones(distance.shape), np.full(distance.shape, facing),
                       28.0, np.zeros(distance.shape))


def led(facing, away):
    """The guess where photos looked at a face at such a cosine and saw it so far out."""
    surface = surface_of(facing)
    known = np.ones(surface.distance.shape, bool)
    guess = sides._Guess(surface.distance, np.full(known.shape, sides.SURE), known,
                         np.full(known.shape, sides.LOOSE), np.full(known.shape, -np.inf), None)
    found = sides._led(guess, surface.distance, surface, surface.distance + away, None)
    chart = surface.chart
    cheek = ((np.abs(chart.axis[:, 1] + 0.3) < 0.1)[:, None]
             & (np.abs(chart.angle) < np.radians(60)))
    behind = (chart.axis[:, 1] > -0.1)[:, None] & (np.abs(chart.angle) > np.radians(150))
    return found, cheek, behind


def test_what_photos_see_well_stays():
    found, cheek, _ = led(0.8, 0.15)
    assert (found.trust[cheek] == sides.SURE).all() and found.known[cheek].all()
    assert not np.isfinite(found.yields[cheek]).any()


def test_the_more_rays_slant_the_less_they_say():
    trusts = [led(cosine, 0.0)[0].trust.max() for cosine in (0.08, 0.15, 0.2, 0.3, 0.5)]
    assert np.all(np.diff(trusts) > 0)
    found, cheek, _ = led(0.2, 0.0)
    assert not found.known[cheek].any() and not np.isfinite(found.yields[cheek]).any()


def test_what_slanting_rays_saw_far_from_a_face_goes():
    found, cheek, behind = led(0.2, 0.08)
    assert (found.trust[cheek] == 0).all() and (found.yields[cheek] == sides.STANDS_OUT).all()
    # Hair may be thick.
    assert (found.trust[behind] > 0).all() and not np.isfinite(found.yields[behind]).any()


def test_an_unseen_face_is_pulled_to_the_head_more_than_hair():
    found, cheek, behind = led(0.8, 0.0)
    assert found.tension[cheek].min() > 10 * found.tension[behind].max()


def hair_behind(thick, low=-np.inf):
    """How thick hair is behind a skull, [V], over how thick photos show it before the ears."""
    chart = bust_chart(0.05)
    skull = bust_distance(chart)
    shown = (np.abs(chart.angle) < np.radians(100)) & (chart.axis[:, 1] > low)[:, None]
    trained = np.where(shown, skull * (1 + thick), np.nan)
    found = sides.with_hair(skull, chart, trained, shown)
    behind = np.abs(chart.angle) > np.radians(150)
    return (chart.axis[:, 1], (found / skull - 1)[:, behind].mean(axis=1),
            np.abs(found / skull - 1)[:, np.abs(chart.angle) < np.radians(30)])


@pytest.mark.parametrize("thick", [0.1, 0.3])
def test_hair_behind_is_as_thick_as_photos_show_it_and_ends_at_the_nape(thick):
    height, behind, front = hair_behind(thick)
    crown, nape = behind[-3:], behind[(height > -0.33) & (height < -0.2)]
    assert np.all(crown > 0.9 * thick) and np.all(crown < 1.01 * thick)
    assert np.all(nape < 0.4 * thick)
    assert np.all(np.diff(behind[height > -0.3]) > -1e-9)
    # There is none on a neck, or on a face, however far they are from the fitted head.
    assert not behind[height < -0.4].any()
    assert not front[height < 0.1].any()


def test_bulky_hair_hangs_lower_than_flat_hair():
    height, flat, _ = hair_behind(0.08)
    bulky = hair_behind(0.45)[1]
    nape = (height > -0.25) & (height < 0.0)
    assert np.all(bulky[nape] / 0.45 > flat[nape] / 0.08 + 0.05)


def test_a_head_whose_hair_no_photo_shows_has_its_skull_there():
    assert not hair_behind(0.2, low=9.0)[1].any()


def test_a_fitted_neck_widens_at_its_sides_and_below_the_jaw_alone():
    surface = surface_of(0.5)
    chart, skull = surface.chart, 0.7 * surface.distance
    found = sides.with_sloping_neck(skull, surface) / surface.distance
    low = chart.axis[:, 1] < -0.5
    aside = np.degrees(np.abs(chart.angle))
    assert np.allclose(found[low][:, (aside > 80) & (aside < 90)], 1.0)
    assert np.allclose(found[low][:, (aside < 60) | (aside > 110)], 0.7)
    assert np.allclose(found[chart.axis[:, 1] > -0.3], 0.7)
    # Where the fitted one is wider it stays.
    assert np.array_equal(sides.with_sloping_neck(1.2 * surface.distance, surface),
                          1.2 * surface.distance)


def test_a_crumb_behind_does_not_pull_the_head_out():
    chart = bust_chart(0.05)
    known = (np.abs(chart.angle) < np.radians(60)) & np.ones((len(chart.axis), 1), bool)
    rim = np.zeros(known.shape, bool)
    row = int(np.searchsorted(chart.axis[:, 1], -0.5))
    rim[row, 0] = rim[0, 0] = rim[row + 2:row + 10, np.flatnonzero(known[0])[0] - 1] = True
    kept = sides.without_crumbs(rim, known, chart)
    # On shoulders crumbs are all that there is.
    assert not kept[row, 0] and kept.sum() == rim.sum() - 1


def photographs(field):
    """An arc of photos of a field, with mattes."""
    found = Camera.arc(np.linspace(-14, 14, 15), distance=5.0, width=SIDE, height=SIDE,
                       focal=5.0 * SIDE / 2.4)
    mattes = [np.rint(255 * field.depth(found, view)[0]).astype(np.uint8)
              for view in range(len(found))]
    return Capture(found, [np.zeros((SIDE, SIDE, 3), np.uint8)] * len(found), mattes,
                   [f"{k}.png" for k in range(len(found))], np.zeros(len(found), bool))


@pytest.fixture(scope="module")
def filmed():
    field = head_field(64)
    capture = photographs(field)
    return capture, Photos(field, capture)


def test_places_that_photos_see_lie_on_the_surface(filmed):
    _, photos = filmed
    places, ways, colors = photos.surface(7, photos.cameras.center[7] - 10,
                                          photos.cameras.center[7] + 10)
    assert len(places) >= 400 and colors.shape == places.shape and not colors.any()
    assert np.abs(np.linalg.norm(places, axis=1) - 0.6).max() < 2 * photos.voxel
    assert np.abs(np.linalg.norm(ways, axis=1) - 1).max() < 1e-9
    assert (ways[:, 2] > 0.9).all()
    depth, before, around = photos.depth_at(7, places)
    assert np.abs(depth - before).max() < 2.5 * photos.voxel and around.all()
    # Above and beside it there is none.
    turn = np.linspace(0, np.pi, 50)
    aside = 0.75 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    assert not photos.depth_at(7, aside)[2].any()


def test_a_slanting_ear_is_whole_and_one_with_holes_is_torn(filmed):
    capture, photos = filmed
    turn, high = np.meshgrid(np.radians(np.linspace(58, 72, 30)), np.linspace(-0.2, 0.2, 30))
    normals = np.stack([np.sin(turn), high / 0.6, np.cos(turn)], axis=-1).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shown, whole = _shown(photos, 0.6 * normals, normals, 0.05)
    assert shown > 0.9 and whole > _WHOLE
    field = head_field(64)
    riddled = field.density * (np.random.default_rng(0).random(len(field.density)) < 0.08)
    holes = Photos(replace(field, density=riddled.astype(np.float32)), capture)
    assert _shown(holes, 0.6 * normals, normals, 0.05)[1] < _WHOLE


def test_the_half_of_an_arc_that_shows_an_ear_says_whether_it_is_there(filmed):
    _, photos = filmed
    # Beside the ball, and behind it from one side.
    across, high = np.meshgrid(np.linspace(0.62, 0.72, 20), np.linspace(-0.1, 0.1, 20))
    places = np.stack([across, high, np.full_like(high, -0.3)], axis=-1).reshape(-1, 3)
    ahead = np.broadcast_to([0.0, 0.0, 1.0], places.shape)
    free = [np.mean(depth < before + 0.06) for depth, before, _ in
            (photos.depth_at(view, places) for view in range(len(photos.cameras)))]
    assert np.mean(free) < 0.6 and max(free) > 0.7
    assert _shown(photos, places, ahead, 0.06)[0] > np.mean(free) + 0.2


def solid(points, triangles, reach=0.2, torn=()):
    places, normals, _ = mesh_samples(points, triangles, 0.01)
    return Ears(places, normals, np.ones(len(places), bool), np.reshape(torn, (-1, 2, 3)),
                cKDTree(places), reach, 0.01)


def test_distances_from_an_ear_are_signed():
    ear = solid(*ball((0.3, 0.3, 0.3), (0.5, 0, 0)))
    at = np.random.default_rng(0).uniform(-1, 1, (4000, 3))
    away, sample = ear.distance(at)
    true = np.linalg.norm(at - [0.5, 0, 0], axis=1) - 0.3
    near = np.isfinite(away)
    assert near.sum() > 200 and np.abs(away[near] - true[near]).max() < 0.01
    assert (np.abs(true[~near]) > 0.19).all()
    assert np.linalg.norm(ear.points[sample[near]] - at[near], axis=1) == pytest.approx(
        np.abs(true[near]), abs=0.015)


def test_an_ear_that_was_torn_is_replaced_near_it_alone():
    points, triangles = ball((0.1, 0.1, 0.1), (0.5, 0, 0))
    whole, torn = (solid(points, triangles, 0.05, box) for box in ([], [[points.min(axis=0),
                                                                       points.max(axis=0)]]))
    at = np.array([[0.5, 0.0, 0.09], [0.5, 0.0, 0.5], [-0.5, 0.0, 0.09]])
    assert not whole.replaced(at).any()
    assert torn.replaced(at).tolist() == [True, False, False]


def test_an_ear_is_moved_to_what_is_seen_of_it():
    points, triangles = ball((0.06, 0.15, 0.1))
    places, normals, _ = mesh_samples(points, triangles, 0.01)
    own = np.ones(len(places), bool)
    shift = np.array([0.012, -0.01, 0.008])
    front = normals[:, 2] > 0.2
    seen = places[front] + shift, np.tile([0.0, 0.0, 1.0], (front.sum(), 1))
    stays = _Move(np.zeros(3), np.zeros(3), 0.0)
    moved, _ = _moved(places, normals, own, seen, 1.0, stays)
    assert np.linalg.norm(moved - places - shift, axis=1).mean() < 0.5 * np.linalg.norm(shift)
    few = seen[0][:5], seen[1][:5]
    assert np.allclose(_moved(places, normals, own, few, 1.0, stays)[0], places)
    begun = _Move(np.zeros(3), np.array([0.0, 0.03, 0.0]), 0.1)
    middle, every = places.mean(axis=0), np.ones((len(places), 1))
    assert np.allclose(_moved(places, normals, own, few, 1.0, begun)[0],
                       begun.of(places, normals, middle, every)[0])


@pytest.mark.parametrize("low, high, known", [(0.03, 0.05, True), (-0.05, -0.03, True),
                                              (-0.02, 0.02, False), (0.02, -0.02, False)])
def test_an_ear_ends_where_what_stands_out_ends(filmed, low, high, known):
    _, photos = filmed
    points, triangles = ball((0.05, 0.14, 0.06), (0.65, 0.0, 0.0))
    places, normals, _ = mesh_samples(points, triangles, 0.01)
    skull = _Skull.of(*ball((0.6, 0.6, 0.6)), 0.02)
    own, front = np.ones(len(places), bool), (normals[:, 2] > 0) & (skull.outside(places) > 0.03)
    # The same ear, but its lower end is moved by ``low`` and its upper one by ``high``.
    seen = places[front]
    ends = seen[:, 1].min(), seen[:, 1].max()
    seen[:, 1] += np.interp(seen[:, 1], ends, (low, high))
    up = np.array([0.0, 1.0, 0.0])
    move = _as_high(places, normals, own, photos, skull, seen, 1.0, up)
    moved, _ = move.of(places, normals, places.mean(axis=0), np.ones((len(places), 1)))
    if not known:
        assert not move.shift.any() and move.size == 0.0
        return
    assert moved[front, 1].min() == pytest.approx(seen[:, 1].min(), abs=0.012)
    assert moved[front, 1].max() == pytest.approx(seen[:, 1].max(), abs=0.012)
    # Beside a few places, or far away, nothing is known.
    for none in (seen[:10], seen + np.array([0.0, 0.2, 0.0]), seen[:0]):
        assert not _as_high(places, normals, own, photos, skull, none, 1.0, up).shift.any()


def test_what_is_seen_far_above_an_ear_is_looked_at(filmed):
    _, photos = filmed
    # A spot in the middle of the ball: what is seen within .25 of it is a disc of that size.
    spot = np.array([[0.0, 0.0, 0.6], [0.01, 0.0, 0.6]])
    places, _ = fitted_head._surface_near(photos, spot, 0.25, None)
    away = np.linalg.norm(places[:, :2], axis=1)
    assert 0.2 < away.max() < 0.27 and (np.abs(places[:, 1]) > 0.15).any()


def test_ears_have_the_colors_that_photos_show_of_them(filmed):
    capture, _ = filmed
    # Photos of one color each: what is seen from the front has their mean.
    images = [np.full_like(image, 160) for image in capture.images]
    full = [np.full_like(matte, 255) for matte in capture.alphas]
    seen = Photos(head_field(64), Capture(capture.cameras, images, full, capture.names,
                                                      capture.held_out))
    found = ears_of(head_with_ears(), bust_chart(0.05), seen)
    assert np.abs(found.colors - 160 / 255).max() < 0.01
    # Where all that is seen has hair's color, an ear has the colors around it.
    hairy = ears_of(head_with_ears(), bust_chart(0.05), seen,
                    lambda colors: np.zeros(len(colors), bool))
    assert hairy.colors is None


def head_with_ears(x=0.65):
    """The head of `head_field` with a knob on each side."""
    points, triangles = ball((0.6, 0.6, 0.6))
    parts, faces, ears = [points], [triangles], [np.zeros(len(points), bool)]
    for side in (-1, 1):
        knob, more = ball((0.1, 0.14, 0.06), (side * x, 0.0, 0.0), rows=16)
        faces.append(more + sum(map(len, parts)))
        parts.append(knob)
        ears.append(np.ones(len(knob), bool))
    return FittedHead(np.concatenate(parts), np.concatenate(faces), np.concatenate(ears))


def test_ears_outside_of_all_mattes_are_left_out(filmed):
    capture, photos = filmed
    chart = bust_chart(0.05)
    assert ears_of(head_with_ears(0.85), chart, photos) is None
    bare = head_with_ears()
    none = FittedHead(bare.points, bare.triangles, np.zeros(len(bare.points), bool))
    assert ears_of(none, chart, photos) is None
    full = Capture(capture.cameras, capture.images,
                   [np.full_like(matte, 255) for matte in capture.alphas], capture.names,
                   capture.held_out)
    found = ears_of(bare, chart, Photos(head_field(64), full))
    assert found is not None and (np.abs(found.points[found.own, 0]) > 0.4).all()


def test_a_gap_that_the_face_hides_from_most_of_an_arc_is_none_of_an_ear(filmed):
    capture, photos = filmed
    # Behind the ball on its left: from the right, the ball's matte is before it.
    gap, within, deep = [0.62, 0.0, -0.3], [0.0, 0.0, 0.58], [0.0, 0.0, -0.5]
    place = capture.cameras.project(np.array([gap]))[0][:, 0].astype(int)
    before = [matte[y, x] > 127 for matte, (x, y) in zip(capture.alphas, place)]
    assert 0.7 < np.mean(before) < 0.9
    assert photos.matter(np.array([gap, within, deep]), 0.05).tolist() == [0.0, 1.0, 1.0]


def test_a_surface_is_not_raised_where_ears_may_lie():
    chart = bust_chart(0.05)
    head = head_with_ears()
    near = sides._about_ears(chart, head)
    row, column = np.rint(chart.places(head.points[head.ears])[0]).astype(int)
    assert near[row, column % len(chart.angle)].all()
    turn = np.abs(np.degrees(chart.angle))
    assert not near[:, (turn < 40) | (turn > 140)].any() and 0 < near.mean() < 0.2
    # Without a head, where most have them.
    usual = sides._about_ears(chart, None)
    assert usual.any() and not usual[:, (turn < 50) | (turn > 135)].any()
    assert not usual[chart.axis[:, 1] < -0.5].any()


def test_ears_behind_hair_are_left_out(filmed):
    _, photos = filmed
    # Knobs behind the ball: it hides them.
    head = head_with_ears(0.3)
    behind = FittedHead(head.points - [0, 0, 0.9] * head.ears[:, None], head.triangles, head.ears)
    assert ears_of(behind, bust_chart(0.05), photos) is None


def closed(monkeypatch, field, capture, **change):
    """A field whose open back was closed with a shell that was changed."""
    def changed(field, shell, photos, cut):
        return with_shell(field, replace(shell, guessed=True, **change), photos, cut)

    monkeypatch.setattr(sides, "with_shell", changed)
    return close_back(field, HEAD_LANDMARKS, capture)[0]


@pytest.fixture(scope="module")
def front():
    """A head that is open behind."""
    field = head_field(64)
    points = field.lattice_points()
    around = np.degrees(np.abs(np.arctan2(points[:, 0], points[:, 2])))
    field = replace(field, density=np.where(around < 120, field.density, 0).astype(np.float32))
    return field, photographs(field)


def test_an_ear_is_part_of_what_is_closed(monkeypatch, front):
    field, capture = front
    knob, triangles = ball((0.1, 0.12, 0.1), (0.6, 0.0, -0.35))
    # As if what was trained were shreds, which photos see past.
    ear = solid(knob, triangles, torn=[[knob.min(axis=0), knob.max(axis=0)]])
    plain, eared, missing = (closed(monkeypatch, field, capture, ears=one)
                             for one in (None, ear, solid(knob, triangles)))
    behind = Camera.arc(np.array([180.0]), distance=5.0, width=SIDE, height=SIDE,
                        focal=5.0 * SIDE / 2.4)
    before, after, none = (one.depth(behind, 0)[0] > 0.5 for one in (plain, eared, missing))
    middle = np.array([0.6, 0.0, -0.35])
    pixels = behind.project(middle + 0.7 * (ear.points - middle))[0][0]
    column, row = np.floor(pixels).astype(int).T
    assert after[row, column].mean() > 0.95 and before[row, column].mean() < 0.7
    # Else no ear is where photos see past it.
    assert none[row, column].mean() < 0.8
    # Elsewhere the outline is the same.
    away = np.ones(after.shape, bool)
    away[row.min() - 6:row.max() + 7, column.min() - 6:column.max() + 7] = False
    assert (before != after)[away].mean() < 0.002


class Sure:
    """Photos that see all there is, and well."""

    enough = 3

    def seen(self, points, outwards=None, least=0.0):
        return np.full(len(points), 9, np.int32)

    def faced(self, points, least):
        return np.full(len(points), 9, np.int32)

    def past(self, points, nearly=True, share=0.0):
        return np.zeros(len(points), bool)


def test_what_stands_out_goes_where_it_yields():
    field, chart = head_field(64), bust_chart(0.05)
    shape = len(chart.axis), len(chart.angle)
    # The new surface lies inside of the head.
    shell = Shell(chart, np.full(shape, 0.4), np.ones(shape), np.full((*shape, 3), 0.5),
                  np.ones(shape, bool), 1 / 32, guessed=True)
    deep, places = shell.depth(field.lattice_points())
    near = (deep > -np.inf) & (deep < 5)
    kept, _ = _changed(field, shell, Sure())
    assert (kept == field.density).all()
    left = chart.angle[np.rint(places[1]).astype(int) % shape[1]] > 0
    allowed = np.where(np.broadcast_to(chart.angle > 0, shape), -2.0, -np.inf)
    changed, _ = _changed(field, replace(shell, yields=allowed), Sure())
    out = near & (deep < -2) & (field.density > 8)
    assert (out & left).sum() > 500 and (changed[out & left] <= 0).all()
    rest = ~(near & (deep < -2) & left)
    assert (changed[rest] == field.density[rest]).all()


class Aslant(Sure):
    """Photos that see all there is, but only along it."""

    def seen(self, points, outwards=None, least=0.0):
        return np.full(len(points), 9 if outwards is None else 0, np.int32)

    def faced(self, points, least):
        return np.zeros(len(points), np.int32)


def test_what_photos_see_by_an_ear_stays():
    field, chart = head_field(64), bust_chart(0.05)
    shape = len(chart.axis), len(chart.angle)
    ear = solid(*ball((0.1, 0.12, 0.1), (0.6, 0.0, 0.0)))
    shell = Shell(chart, np.full(shape, 0.4), np.ones(shape), np.full((*shape, 3), 0.5),
                  np.ones(shape, bool), 1 / 32, guessed=True, ears=ear)
    points = field.lattice_points()
    deep = shell.depth(points)[0]
    by_ear = np.isfinite(ear.distance(points)[0])
    changed, _ = _changed(field, shell, Aslant())
    near = (deep > -np.inf) & (deep < 5)
    stays = ~near | by_ear
    assert (changed[stays] == field.density[stays]).all()
    on = near & (deep > shell.fringe) & ~by_ear
    assert (changed[on] >= field.density[on]).all()
    out = near & (deep < -4) & (field.density > 8)
    assert (out & by_ear).sum() > 50 and (out & ~by_ear).sum() > 500
    assert (changed[out & ~by_ear] <= 0).all()
