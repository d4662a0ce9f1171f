"""A knot of hair behind a head, of which photos show an edge above the crown."""

import functools

import cv2
import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.field.geometry import head_surface as module
from lfportrait.field.geometry.chart import at_places
from lfportrait.field.geometry.head_surface import _run, bust_chart, bust_distance, knots_behind

SIDE, FOCAL = 320, 470.0
MIDDLE, RADIUS = np.array([0.03, 0.60, -0.33]), 0.13


@pytest.fixture(scope="module")
def bust():
    chart = bust_chart(0.02)
    return chart, bust_distance(chart)


def cameras(side=0.0):
    return Camera.arc(np.linspace(-14, 14, 9) + side, distance=2.4, width=SIDE, height=SIDE,
                      focal=FOCAL, target=(0.0, 0.1, 0.0))


@functools.cache
def bust_mattes(side):
    """What `cameras` show of the bust, uint8 [H, W] each. Not to be changed."""
    chart, views, found = bust_chart(0.02), cameras(side), []
    halves = chart.halves
    points = chart.finer().points(at_places(bust_distance(chart), halves.reshape(2, -1))
                                  .reshape(halves.shape[1:])).reshape(-1, 3)
    for view in range(len(views)):
        matte = np.zeros((SIDE, SIDE), np.uint8)
        x, y = np.clip(views[view].project(points)[0][0].astype(int), 0, SIDE - 1).T
        matte[y, x] = 255
        found.append(cv2.morphologyEx(matte, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8)))
    return found


def mattes(side, ball=None, shown=None):
    """What `cameras` show of the bust and a ball, uint8 [H, W] each."""
    found, views = [], cameras(side)
    for view, plain in enumerate(bust_mattes(side)):
        matte = plain.copy()
        if ball is not None and (shown is None or view in shown):
            middle, radius = ball
            (pixel,), (depth,) = (part[0] for part in views[view].project(middle[None]))
            cv2.circle(matte, np.rint(pixel).astype(int).tolist(), round(FOCAL * radius / depth),
                       255, -1)
        found.append(matte)
    return found


def knots(chart, distance, side, *more):
    limit = np.full(distance.shape, np.inf)
    return knots_behind(chart, distance, limit, cameras(side), mattes(side, *more))


# One to the side is harder to find than one in the middle.
@pytest.mark.parametrize("side", [pytest.param(0.0, marks=pytest.mark.slow), 8.0])
def test_a_knot_is_found_where_it_is(bust, side):
    chart, distance = bust
    found = knots(chart, distance, side, (MIDDLE, RADIUS))
    assert found.any()
    points = chart.points(found)[found > 0]
    assert np.abs(np.linalg.norm(points - MIDDLE, axis=1) - RADIUS).mean() < 0.03
    assert abs(points[:, 1].max() - MIDDLE[1] - RADIUS) < 0.03
    assert (found[found > 0] > distance[found > 0]).all()


@pytest.mark.parametrize("middle, radius", [((0.0, 0.6, -0.3), 0.1), ((0.0, 0.55, -0.38), 0.16)])
def test_a_knot_is_as_large_as_its_ball(bust, monkeypatch, middle, radius):
    found = []

    def ball(*given):
        found.append(measured(*given))
        return found[-1]

    measured = module._ball
    monkeypatch.setattr(module, "_ball", ball)
    knots(*bust, 3.0, (np.array(middle), radius))
    (_, size), = [one for one in found if one is not None]
    assert size == pytest.approx(radius, abs=0.01)


def test_a_ball_touches_the_rays_at_all_outlines(bust):
    chart, distance = bust
    true = np.array([0.02, 0.62, -0.34])
    shown = mattes(3.0, (true, 0.15))
    others = module._beside(chart, distance, cameras(3.0), shown)
    ball = module._touching(true + np.array([0.01, 0.02, 0.03]), 0.125, cameras(3.0), shown, others)
    assert np.linalg.norm(ball[0] - true) < 0.015
    assert ball[1] == pytest.approx(0.15, abs=0.012)
    # Where nothing is seen of it, or its outline is something else's, it stays.
    for middle, radius in ((true - np.array([0.0, 0.5, 0.0]), 0.05),
                           (true + np.array([0.3, 0.1, 0.0]), 0.1)):
        found, size = module._touching(middle, radius, cameras(3.0), shown, others)
        assert np.array_equal(found, middle) and size == radius


def test_no_knot_is_found_where_there_is_none(bust):
    assert not knots(*bust, 0.0).any()


def test_single_photos_make_no_knot(bust):
    assert not knots(*bust, 0.0, (MIDDLE, RADIUS), (2, 6)).any()


def test_what_stands_out_beside_the_face_is_no_knot(bust):
    assert not knots(*bust, 0.0, (np.array([0.42, -0.1, -0.05]), 0.12)).any()


def test_a_knot_stays_within_the_mattes(bust):
    chart, distance = bust
    limit = distance + 0.02
    found = knots_behind(chart, distance, limit, cameras(), mattes(0.0, (MIDDLE, RADIUS)))
    assert found.any() and (found <= limit).all()


def test_a_run_ends_beside_its_column():
    rows, left, right = _run(np.array([[0, 1, 1, 0, 1], [1, 0, 0, 1, 1], [1, 1, 1, 1, 1]], bool), 2)
    assert rows.tolist() == [0, 2] and left.tolist() == [1, 0] and right.tolist() == [2, 4]
