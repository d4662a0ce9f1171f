"""Narrow arcs: the surface is found before the field, which does not reach beyond it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from lfportrait.capture import Camera, Capture
from lfportrait.demo import demo_landmarks
from lfportrait.face.capture_head import fit_in_space
from lfportrait.face.head_prior import generic_prior
from lfportrait.field import ReconstructConfig, reconstruct_with_figures
from lfportrait.field.closing import FittedHead, close_sides, sides
from lfportrait.field.closing.colors import usual_hair
from lfportrait.field.closing.photos import Coverage
from lfportrait.field.geometry.chart import continued, fitted_plate
from lfportrait.field.geometry.exposure import surface_gains
from lfportrait.field.geometry.head_surface import (
    bust_chart,
    bust_distance,
    distance_outside,
    find_surface,
    is_narrow,
    span_of,
)
from tests.recordings import photographs

SIDE = 112


def cameras(angles, pitch=0.0):
    return Camera.arc(np.asarray(angles, float), distance=3.0, width=SIDE, height=SIDE,
                      focal=0.5 * SIDE / np.tan(np.radians(20)), target=(0.0, -0.05, 0.0),
                      pitch=pitch)


@pytest.fixture(scope="module")
def arc():
    found = cameras(np.linspace(-16, 16, 14))
    shots = [shot.image for shot in photographs("arc", found)]
    return Capture(found, [np.ascontiguousarray(shot[..., :3]) for shot in shots],
                   [np.ascontiguousarray(shot[..., 3]) for shot in shots],
                   [f"{k}.png" for k in range(len(shots))], np.arange(len(shots)) % 6 == 3,
                   np.eye(4), demo_landmarks())


@pytest.fixture(scope="module")
def surface(arc):
    return find_surface(arc)


@given(some.floats(-0.4, 0.4), some.floats(0.5, 2.0), some.floats(-1, 1), some.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_a_chart_in_any_frame_finds_its_own_points(turn, scale, shift, seed):
    frame = np.eye(4)
    frame[:3, :3] = scale * np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0],
                                      [-np.sin(turn), 0, np.cos(turn)]])
    frame[:3, 3] = shift
    chart = bust_chart(0.08, 0.05, frame)
    rng = np.random.default_rng(seed)
    distance = rng.uniform(0.2, 0.9, (len(chart.axis), len(chart.angle)))
    places, away = chart.places(chart.points(distance).reshape(-1, 3))
    rows, columns = np.meshgrid(np.arange(len(chart.axis)), np.arange(len(chart.angle)),
                                indexing="ij")
    np.testing.assert_allclose(away, distance.ravel(), atol=1e-9)
    np.testing.assert_allclose(places[0], rows.ravel(), atol=1e-6)
    turns = (places[1] - columns.ravel() + 0.5) % len(chart.angle) - 0.5
    np.testing.assert_allclose(turns, 0, atol=1e-6)


def test_the_bust_has_a_persons_size():
    chart = bust_chart(0.03)
    points = chart.points(bust_distance(chart)).reshape(-1, 3)
    eyes = points[np.abs(points[:, 1]) < 0.03]
    assert 0.7 < np.ptp(eyes[:, 0]) < 0.85  # a head is 0.155 m wide, a unit is 0.2 m
    assert 0.9 < np.ptp(eyes[:, 2]) < 1.05
    assert points[:, 1].max() == pytest.approx(0.57, abs=0.03)
    assert np.ptp(points[points[:, 1] < -1.2, 0]) > 1.9


def test_a_plate_keeps_data_and_is_smooth_between():
    rng = np.random.default_rng(0)
    rows, columns = np.meshgrid(np.linspace(0, 1, 20), np.arange(30) / 30 * 2 * np.pi,
                                indexing="ij")
    truth = rows ** 2 + 0.3 * np.cos(columns)
    weights = np.where(rng.random(truth.shape) < 0.3, 1e3, 0.0)
    found = fitted_plate(np.where(weights > 0, truth, 9.0), weights, 1.0, 0.0, 0.0)
    assert np.abs(found - truth)[3:-3].max() < 0.03  # its ends are free
    assert np.abs(fitted_plate(truth, weights, 1.0, 0.0, 1e9)).max() < 1e-3


@pytest.mark.parametrize(("angles", "narrow"), [
    (np.linspace(-14, 14, 9), True), (np.linspace(-35, 35, 9), True),
    (np.linspace(-65, 65, 12), True),
    (np.linspace(-100, 100, 12), False)])
def test_an_arc_is_told_from_a_way_around(angles, narrow):
    found = cameras(angles)
    blank = [np.zeros((SIDE, SIDE, 3), np.uint8)] * len(found)
    capture = Capture(found, blank, [image[..., 0] for image in blank],
                      [str(k) for k in range(len(found))], np.zeros(len(found), bool), np.eye(4),
                      demo_landmarks())
    assert span_of(found) == pytest.approx(np.ptp(angles), abs=0.1)
    assert is_narrow(capture) == narrow
    assert not is_narrow(replace(capture, alphas=None))
    assert not is_narrow(replace(capture, landmarks=None))


def test_hair_goes_on_behind_and_above_but_not_over_the_face():
    chart = bust_chart(0.016)
    distance = bust_distance(chart)
    hair = usual_hair(chart, distance)

    def at(height, degrees):
        row = int(np.argmin(np.abs(chart.axis[:chart.level, 1] - height)))
        return hair[row, int(np.argmin(np.abs(np.degrees(chart.angle) - degrees)))]

    assert hair[-1].all() and at(-0.2, 179.0) and at(-0.2, -150.0) and at(0.08, 95.0)
    assert not (at(0.0, 0.0) or at(-0.3, 90.0) or at(-0.3, -90.0) or at(-0.5, 179.0))
    colors = np.where(hair[..., None], [0.2, 0.1, 0.0], [0.9, 0.7, 0.6])
    seen = np.abs(np.degrees(chart.angle)) < 60
    found = continued(colors, np.broadcast_to(seen, hair.shape), apart=hair)
    behind = np.broadcast_to(~seen, hair.shape) & (chart.axis[:, 1] > -0.3)[:, None]
    assert np.abs(found - colors)[behind].mean() < 0.08
    mixed = continued(colors, np.broadcast_to(seen, hair.shape))
    assert np.abs(mixed - colors)[behind].mean() > 0.1


def test_a_head_of_hair_takes_no_color_of_the_neck_however_little_of_it_is_shown():
    chart = bust_chart(0.016)
    hair = usual_hair(chart, bust_distance(chart))
    colors = np.where(hair[..., None], [0.2, 0.1, 0.0], [0.9, 0.7, 0.6])
    seen = ~hair | (np.abs(np.degrees(chart.angle)) < 30)
    found = continued(colors, seen, apart=hair)
    assert np.abs(found - colors)[hair].max() < 0.01


def test_the_surface_lies_where_the_face_is(surface):
    camera = cameras([0.0])
    truth = photographs("before", camera, "depth")[0]
    _, directions = camera.rays(0)
    points = camera.position[0] + directions * truth.more[..., None].reshape(
        *directions.shape[:-1], 1)
    inside = (truth.more > 0).reshape(directions.shape[:-1])
    face = points[inside]
    face = face[(np.abs(face[:, 0]) < 0.3) & (face[:, 1] > -0.5) & (face[:, 1] < 0.4)]
    places, away = surface.chart.places(face)
    row, column = np.rint(places).astype(int)
    error = np.abs(away - surface.distance[row, column % len(surface.chart.angle)])
    assert np.median(error) < 0.02
    assert np.quantile(error, 0.9) < 0.06


def test_a_neck_widens_to_the_shoulders_as_outlines_show_it(arc, surface):
    view = int(np.abs(arc.cameras.position[:, 0]).argmin())
    pixels = arc.cameras[view].project(surface.chart.points(surface.distance).reshape(-1, 3))[0][0]
    height = np.repeat(surface.chart.axis[:, 1], surface.distance.shape[1])
    wide = []
    # From the jaw to the shoulders' slope; the bust ends in the rows below.
    for row in range(*(int(np.median(pixels[np.abs(height - at) < 0.02, 1])) for at in
                       (-0.5, -0.72))):
        own = pixels[(np.floor(pixels[:, 1]) == row) & (np.abs(height) < 0.85), 0]
        shown = np.flatnonzero(arc.alphas[view][row] > 127)
        wide.append((np.ptp(own), len(shown)))
    own, shown = np.array(wide).T
    assert len(shown) >= 5 and shown.max() > 1.3 * shown.min()
    assert np.abs(own - shown).max() < 6  # of 112 pixels; as a tube it is ten too narrow


def test_space_before_the_surface_is_clear(surface):
    shape = (40, 48, 40)
    distance, clearance = distance_outside(surface, shape, np.zeros(3), np.full(3, 1.2))
    assert distance.shape == clearance.shape == shape
    middle, front = distance[20, 24, 20], distance[-1, 24, 20]
    assert middle < -0.2
    assert front > 0.4
    assert 0.0 < clearance.min() < clearance.max() < 0.1


@pytest.fixture(scope="module")
def whole(arc, surface):
    """The field of these photos and its figures; their surface is not searched for again."""
    def found(capture):
        assert all(np.array_equal(*pair) for pair in zip(capture.images, arc.images, strict=True))
        return surface

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lfportrait.field.training.trainer.find_surface", found)
        return reconstruct_with_figures(arc, ReconstructConfig(resolution=64, rays=(0.25, 0.5),
                                                               seed=1))


@pytest.mark.slow  # trains a head; what photos see: test_closing.py
def test_photos_cover_the_face_and_not_the_back(arc, whole):
    field, _ = whole
    coverage = Coverage(field, arc)
    around = cameras([0.0, 180.0])
    face, back = (coverage.directions(around, view) for view in range(2))
    middle = np.s_[SIDE // 3:SIDE // 2, 2 * SIDE // 5:3 * SIDE // 5]
    assert np.median(face[middle]) >= Coverage.ENOUGH
    assert np.median(back[middle]) == 0
    assert face[2, 2] == back[2, 2] == -1
    few = replace(arc, held_out=np.arange(len(arc)) != len(arc) // 2)
    assert np.median(Coverage(field, few).directions(around, 0)[middle]) == 1
    assert Coverage(field, few).share(4.0) == 0 < coverage.share(4.0) < 0.9


@pytest.fixture(scope="module")
def closed_alone(arc, surface, whole):
    """That field with the sides of its surface, which no head is fitted to. Not to be changed."""
    return close_sides(whole[0], surface, arc)[0]


@pytest.mark.slow  # closed once more
def test_sides_follow_a_head_that_is_fitted_to_what_is_seen(arc, surface, whole, closed_alone):
    field, _ = whole
    given = []

    def fit_head(*parts):
        given.append(parts)
        prior = generic_prior()
        return FittedHead(fit_in_space(prior, *parts), prior.triangles,
                          np.zeros(len(prior.mean), bool))

    closed, told = close_sides(field, surface, arc, None, fit_head)
    assert told is not None and len(given) == 1
    marks, points, normals, trust = given[0]
    # In the portrait frame, eyes are at its origin's height and the face looks to +z.
    assert np.abs(marks[36:48, 1]).max() < 0.08 and marks[30, 2] > marks[36, 2]
    face = (np.abs(points[:, 0]) < 0.3) & (np.abs(points[:, 1] + 0.2) < 0.3)
    assert face.sum() > 100 and points[face, 2].min() > -0.05
    assert (normals[face, 2] > 0).mean() > 0.9
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-6
    assert trust.min() > 0 and trust.max() == 1
    front = cameras([0.0])
    before, after = (one.render(front, 0).color for one in (field, closed))
    middle = np.s_[SIDE // 3:SIDE // 2, 2 * SIDE // 5:3 * SIDE // 5]
    assert np.abs(before - after)[middle].mean() < 0.01
    # Without a head they follow the surface that was found.
    plain, _ = close_sides(field, surface, arc, None, lambda *parts: None)
    assert np.array_equal(plain.density, closed_alone.density)
    assert np.array_equal(plain.sh, closed_alone.sh)


@pytest.mark.slow  # closed once more
def test_closed_sides_fill_the_outlines_that_photos_show(arc, surface, whole, closed_alone,
                                                         monkeypatch):
    gaps = []

    def unchanged(chart, distance, gap, photos):
        gaps.append(gap)
        return distance

    monkeypatch.setattr(sides, "filling_outlines", unchanged)
    plain, _ = close_sides(whole[0], surface, arc)
    # Ears stand out of what a chart can hold.
    assert gaps[0].any() and not gaps[0][sides._about_ears(surface.chart, None)].any()

    def missing(field):
        return sum(int(((arc.alphas[view] > 127) & (field.depth(arc.cameras, view)[0] < 0.5)).sum())
                   for view in arc.training())

    assert missing(closed_alone) < missing(plain)


@pytest.mark.slow  # trains a head; knots: test_knots.py
def test_a_knot_is_closed_as_it_was_found(arc, surface, whole, closed_alone):
    field, _ = whole
    chart = surface.chart
    behind = np.abs(chart.angle) > np.radians(165)
    middle = (chart.axis[:, 1] > -0.05) & (chart.elevation == 0)
    knots = np.where(middle[:, None] & behind, 1.25 * surface.distance, 0.0)
    assert not surface.knots[knots > 0].any()

    def matter(field, at):
        places = chart.points(at * surface.distance)[knots > 0]
        cells = np.floor((places - field.bounds[0]) / field.spacing).astype(int)
        inside = ((cells >= 0) & (cells < field.links.shape[::-1])).all(axis=1)
        rows = field.links[tuple(cells[inside].T[::-1])]
        return (np.where(rows >= 0, field.density[rows], 0) > 0).sum() / len(places)

    knotted, _ = close_sides(field, replace(surface, knots=knots), arc)
    assert matter(closed_alone, 1.2) < 0.05 and matter(knotted, 1.2) > 0.8
    assert matter(knotted, 1.4) < 0.05


def test_exposures_are_read_from_the_surface_that_was_found(arc, surface):
    views, tests = arc.training(), arc.testing()
    assert surface_gains(surface, arc, views, tests) is None
    gains = np.exp(0.08 * np.sin(np.arange(len(arc.images)))[:, None] * [1.0, 0.8, 1.2])
    images = [np.clip(image * 0.8 * gain + 0.5, 0, 255).astype(np.uint8)
              for image, gain in zip(arc.images, gains)]
    found = surface_gains(surface, replace(arc, images=images), views, tests)
    assert found is not None
    mean = np.log(gains[views]).mean(axis=0)
    for one, some_views in zip(found, (views, tests)):
        assert np.abs(np.log(one) - np.log(gains[some_views]) + mean).max() < 0.02


def test_exposures_that_drift_along_a_wide_arc_are_found_whole(arc, surface):
    found = cameras(np.linspace(-65, 65, 14))
    drift = np.linspace(-0.3, 0.3, 14)
    pictures = [np.full((SIDE, SIDE, 3), np.rint(110 * np.exp(gain)), np.uint8) for gain in drift]
    wide = replace(arc, cameras=found, images=pictures,
                   alphas=[np.full((SIDE, SIDE), 255, np.uint8)] * 14)
    around = replace(surface, facing=np.ones_like(surface.facing))
    gains = surface_gains(around, wide, np.arange(14), np.arange(0))
    assert gains is not None
    # Somewhat less than all of it, as dark colors count less.
    slope = np.polyfit(drift, np.log(gains[0]).mean(axis=1), 1)[0]
    assert slope == pytest.approx(1, abs=0.08) and gains[1].shape == (0, 3)


def test_a_surface_that_no_photo_faces_tells_no_exposures(arc, surface):
    aside = replace(surface, facing=np.zeros_like(surface.facing))
    assert surface_gains(aside, arc, arc.training(), arc.testing()) is None


@pytest.mark.slow  # trains a head
def test_a_face_holds_beyond_the_arc(whole):
    field, figures = whole
    assert figures["geometry"]["span_degrees"] == pytest.approx(32, abs=1)
    assert 0.2 < figures["geometry"]["head_shown"] < 0.6
    beyond = cameras([-40, 40])
    for view, shot in enumerate(photographs("beyond", beyond)):
        truth = shot.image[..., 3] > 127
        shown = field.render(beyond, view).alpha > 0.5
        # The lower end is trimmed, the rest of the outline must be there.
        high = np.arange(SIDE)[:, None] < 0.62 * SIDE
        overlap = (truth & shown & high).sum() / ((truth | shown) & high).sum()
        assert overlap > 0.9
