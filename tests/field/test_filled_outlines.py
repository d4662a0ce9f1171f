"""A closed surface is raised where it lacks what photos show at their outlines."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Camera, Capture
from lfportrait.field.closing.outlines import filling_outlines, lacking
from lfportrait.field.closing.photos import Photos
from lfportrait.field.geometry.head_surface import bust_chart
from tests.fields import head_field

SIDE, RADIUS = 160, 0.6  # The field is a ball.


@pytest.fixture(scope="module")
def filmed():
    """The ball, from an arc of photos with mattes."""
    field = head_field(64)
    cameras = Camera.arc(np.linspace(-14, 14, 9), distance=5.0, width=SIDE, height=SIDE,
                         focal=5.0 * SIDE / 2.4)
    mattes = [np.rint(255 * field.depth(cameras, view)[0]).astype(np.uint8)
              for view in range(len(cameras))]
    return field, Capture(cameras, [np.zeros((SIDE, SIDE, 3), np.uint8)] * len(cameras), mattes,
                          [f"{k}.png" for k in range(len(cameras))],
                          np.zeros(len(cameras), bool))


def ball(chart, radius):
    """Distances [V, U] of a ball's surface along a chart's rays."""
    origins = np.broadcast_to(chart.origins[:, None], chart.rays.shape)
    along = (origins * chart.rays).sum(axis=-1)
    return -along + np.sqrt(np.maximum(along ** 2 - (origins ** 2).sum(axis=-1) + radius ** 2,
                                       1e-4))


def sunken(chart, by):
    """The ball, sunken aside and behind; where that is; and cells that have it on their rays."""
    whole = np.linalg.norm(chart.origins, axis=-1) < 0.7 * (RADIUS - by)
    gap = whole[:, None] & (np.abs(chart.angle) > np.radians(60))
    return np.where(gap, ball(chart, RADIUS - by), ball(chart, RADIUS)), gap, whole


@pytest.mark.parametrize("by", [0.04, 0.1])
def test_a_sunken_side_is_raised_to_the_outlines(filmed, by):
    photos, chart = Photos(*filmed), bust_chart(0.04)
    distance, gap, whole = sunken(chart, by)
    before = lacking(chart, distance, gap, photos)
    assert (before > 0).sum() > 20 and not before[~gap].any()
    found = filling_outlines(chart, distance, gap, photos)
    assert lacking(chart, found, gap, photos).sum() < 0.6 * before.sum()
    # Photos do not see past it, and what nothing asks for stays: what is not new, and the back.
    radius = np.linalg.norm(chart.points(found), axis=-1)[whole]
    assert radius.max() < RADIUS + 2.5 * photos.voxel
    assert (found >= distance).all() and np.array_equal(found[~gap], distance[~gap])
    back = np.abs(chart.angle) > np.radians(165)
    assert np.abs(found - distance)[whole][:, back].max() < photos.voxel
    aside = np.abs(np.abs(chart.angle) - np.radians(90)) < np.radians(10)
    level = np.abs(chart.axis[whole, 1]) < 0.1
    raised = np.linalg.norm(chart.points(found), axis=-1)[whole][level][:, aside]
    assert np.abs(raised - RADIUS).max() < photos.voxel


def test_mattes_alone_ask_for_it(filmed):
    field, capture = filmed
    chart = bust_chart(0.04)
    distance, gap, _ = sunken(chart, 0.1)
    bare = replace(capture, alphas=[np.zeros_like(matte) for matte in capture.alphas])
    assert not lacking(chart, distance, gap, Photos(field, bare)).any()
    assert filling_outlines(chart, distance, gap, Photos(field, bare)) is distance
    # Nor does the matte of one photo.
    one = replace(capture, alphas=[capture.alphas[0], *bare.alphas[1:]])
    assert not lacking(chart, distance, gap, Photos(field, one)).any()
    # A surface that fills them stays.
    full = ball(chart, RADIUS + 0.06)
    assert filling_outlines(chart, full, gap, Photos(field, capture)) is full


def test_what_lies_below_a_chart_asks_for_nothing(filmed):
    chart = bust_chart(0.04)
    first = int(np.argmin(np.abs(chart.axis[:, 1])))
    high = replace(chart, axis=chart.axis[first:], elevation=chart.elevation[first:],
                   level=chart.level - first)
    distance, gap, _ = sunken(high, 0.1)
    missing = lacking(high, distance, gap | True, Photos(*filmed))
    assert missing.shape == gap.shape and np.isfinite(missing).all()
