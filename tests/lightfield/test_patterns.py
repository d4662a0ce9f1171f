"""Test patterns and cross-talk, judged by what the simulated eye sees."""

import dataclasses
import math

import numpy as np
import pytest

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.lightfield import DepthReport, Display, ViewMask, interlace, pattern, simulate
from lfportrait.media.pictures import read_image

PANEL = Display(720, 400, views=24, pitch=9.4, slant=math.radians(8), cone=40, distance=4,
                name="panel")
CELLS = ((-0.31, 0.25, 0.28, 0.25, 0.0, -0.25), (-0.31, -0.25, 0.28, -0.25, 0.0, 0.25))


def seen(image, display, view, **options):
    return simulate(image, display, (display.eyes()[view],), **options)


def inner(picture):
    """Without the border, where half of the sub-pixels that make up a place are missing."""
    return picture[:, 12:-12]


def lamps(picture, display):
    """Brightness of each view's lamp in each of the four charts, [4, V]."""
    height, width = display.height // 2, display.width // 2
    columns = max(1, round((display.views * display.aspect) ** 0.5))
    rows = -(-display.views // columns)
    values = np.zeros((4, display.views))
    for chart in range(4):
        top, left = chart // 2 * height, chart % 2 * width
        for view in range(display.views):
            row, column = divmod(view, columns)
            y, x = (row + 0.78) * height / rows, (column + 0.5) * width / columns
            half_y, half_x = 0.08 * height / rows, 0.3 * width / columns
            values[chart, view] = picture[round(top + y - half_y):round(top + y + half_y) + 1,
                                          round(left + x - half_x):round(left + x + half_x)].mean()
    return values


# The order of sub-pixels is asked of the display, as are their places (`cells`).
@pytest.mark.parametrize("change", [
    {"inverted": True}, {"cells": CELLS, "cell_pattern": "checkerboard"},
    *(pytest.param(change, marks=pytest.mark.slow) for change in ({}, {"subpixels": "BGR"}))])
def test_the_lamp_of_the_view_that_reaches_the_eye_is_lit(change):
    display = dataclasses.replace(PANEL, **change)
    image = pattern(display, "views")
    for view in (3, 12, 20):
        values = lamps(seen(image, display, view), display)
        center = (values * np.arange(24)).sum(1) / values.sum(1)
        assert np.abs(center - view).max() < 0.7
        # A lens mixes what lies within one sub-pixel's step, and no more.
        assert values[:, [v for v in range(24) if abs(v - view) > 5]].max() < 0.05


def test_crosstalk_lights_more_lamps_and_from_the_cones_other_edge_too():
    image = pattern(PANEL, "views")

    def width(**options):
        values = lamps(seen(image, PANEL, 12, **options), PANEL).mean(0)
        return np.sqrt((values * (np.arange(24) - 12) ** 2).sum() / values.sum())

    assert width() < width(crosstalk=2.0) < width(crosstalk=4.0)
    edge = lamps(seen(image, PANEL, 0, crosstalk=2.0), PANEL).mean(0)
    assert edge[23] > 0.15 > 0.02 > edge[12]


@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_views_leak_as_light_and_not_as_stored_values(gamma):
    """Between black and white views half of the light arrives, whatever the gamma."""
    display = dataclasses.replace(PANEL, gamma=gamma)
    views = np.zeros((24, 40, 72, 3), np.uint8)
    views[12:] = 255
    stored = simulate(interlace(views, display), display, (0.0,), crosstalk=3.0)
    assert abs((stored ** gamma).mean() - 0.5) < 0.01


def test_outside_of_its_cone_a_panel_repeats_its_views():
    image = pattern(PANEL, "slant")
    cone = 2 * PANEL.eye_reach
    assert np.allclose(simulate(image, PANEL, (0.3,)), simulate(image, PANEL, (0.3 + cone,)),
                       atol=1e-3)


def test_the_middle_eye_sees_all_white_and_the_others_one_color():
    image = pattern(PANEL, "slant")
    assert inner(seen(image, PANEL, 12)).min() > 0.9
    left, right = inner(seen(image, PANEL, 2)), inner(seen(image, PANEL, 21))
    assert left[..., 0].min() > 0.5 > 0.1 > left[..., 1:].max()
    assert right[..., 2].min() > 0.5 > 0.1 > right[..., :2].max()


@pytest.mark.parametrize(("change", "axis"), [({"pitch": 9.4 * 1.01}, 1),
                                              ({"slant": math.radians(9.2)}, 0)])
def test_a_wrong_pitch_shows_across_and_a_wrong_slant_along_the_panel(change, axis):
    """The picture is coded with wrong numbers; what the true panel shows of it has bands."""
    image = pattern(dataclasses.replace(PANEL, **change), "slant")
    green = simulate(image, PANEL, (0.0,))[..., 1]
    profile = green.reshape(40, 10, 72, 10).mean((1, 3))
    across, along = np.ptp(profile, axis=1).mean(), np.ptp(profile, axis=0).mean()
    assert max(across, along) > 0.5
    assert (across > 2 * along) if axis == 1 else (along > 2 * across)


def test_a_wrong_offset_shows_as_one_color_all_over():
    image = pattern(dataclasses.replace(PANEL, offset=0.36 * PANEL.pitch), "slant")
    # Single rows catch the edge of the cone; over a few of them it is one color.
    picture = inner(simulate(image, PANEL, (0.0,))).reshape(40, 10, 58, 12, 3).mean((1, 3))
    assert picture[..., :2].max() < 0.2
    assert picture[..., 2].min() > 0.5


def test_thirds_of_the_views_do_not_mix_and_edges_have_no_color():
    image = pattern(PANEL, "fringe")
    for view, channel in ((3, 0), (12, 1), (20, 2)):
        top = inner(seen(image, PANEL, view)[:190])
        others = [c for c in range(3) if c != channel]
        assert top[..., channel].min() > 0.95
        assert top[..., others].max() < 0.05

    def color(display):
        bottom = inner(simulate(image, display, (0.0,))[210:])
        blocks = bottom.reshape(19, 10, 696, 3).mean(1)
        return (blocks.max(-1) - blocks.min(-1)).mean()

    assert color(PANEL) < 0.06
    assert color(dataclasses.replace(PANEL, subpixels="BGR")) > 2 * color(PANEL)


def place_of(row_of_pixels):
    weight = row_of_pixels.sum(0)
    return (weight * np.arange(len(weight))).sum() / weight.sum()


def test_each_depth_moves_as_it_should():
    """Bands from behind to in front: the labels move with the eye, not at all, and against it."""
    image = pattern(PANEL, "depth")
    left, right = seen(image, PANEL, 6), seen(image, PANEL, 17)
    report = DepthReport.of(PANEL)
    eyes = PANEL.eyes()[[6, 17]]
    for number, z in enumerate([2 * report.back, report.back, 0, report.front, 2 * report.front]):
        rows = slice(number * 80 + 12, number * 80 + 68)
        # Labels are brighter than the grid.
        bright = [np.clip(picture[rows].mean(-1) - 0.6, 0, None) for picture in (left, right)]
        moved = place_of(bright[1]) - place_of(bright[0])
        wanted = -(eyes[1] - eyes[0]) * z / (4 - z) / (2 * PANEL.aspect) * 720
        assert abs(moved - wanted) < 4 + 0.15 * abs(wanted), (number, moved, wanted)


@pytest.mark.parametrize("kind", ["views", "slant", "fringe", "depth"])
@pytest.mark.parametrize("size", [(2, 3), (40, 90), (91, 33)])
def test_patterns_fit_panels_of_any_size(kind, size):
    display = dataclasses.replace(PANEL, width=size[0], height=size[1], views=7)
    assert pattern(display, kind).shape == (size[1], size[0], 3)


def test_the_slant_pattern_follows_the_mask():
    views = ViewMask.build(PANEL, cache=False).views
    image = pattern(PANEL, "slant")
    middle = np.abs(views - 11.5) <= 0.5 + 1.6 * 24 / 9.4
    assert (image[middle] == 255).all()
    assert (image[~middle] < 200).all()


def test_the_command_writes_patterns_and_tells_mistakes(tmp_path, capsys):
    PANEL.save(tmp_path / "panel.toml")
    out = tmp_path / "p.png"
    assert main(["display", "pattern", str(tmp_path / "panel.toml"), "--kind", "fringe", "--out",
                 str(out)]) == 0
    assert np.array_equal(read_image(out), pattern(PANEL, "fringe"))
    for words in (["--kind", "moire", "--out", "q.png"], ["--out", "q.jpg"], []):
        assert main(["display", "pattern", str(tmp_path / "panel.toml"), *words]) == 2
    errors = capsys.readouterr().err
    assert "views, slant, fringe, depth" in errors
    assert "every sub-pixel" in errors
    assert "--out FILE.png" in errors
    with pytest.raises(UserError, match="slant"):
        pattern(PANEL, "moire")
