"""What is closed has the colors of what photos show beside it."""

import numpy as np
import pytest

from lfportrait.field.closing.colors import (
    continued_colors,
    continued_in_shade,
    hair_cells,
    shade_of,
)
from lfportrait.field.geometry.chart import Chart

ROWS, COLUMNS = 90, 120
DARK, LIGHT = np.array([0.25, 0.15, 0.1]), np.array([0.8, 0.6, 0.5])


def head():
    """A chart of the portrait frame whose surface is a tube with a dome."""
    cell = 0.02
    level = 60
    above = np.arange(1, ROWS - level + 1) * np.pi / 2 / (ROWS - level + 1)
    heights = np.append(-0.9 + cell * np.arange(level), np.full(len(above), -0.9 + cell * level))
    axis = np.stack([0 * heights, heights, 0 * heights], axis=1)
    elevation = np.append(np.zeros(level), above)
    angle = (np.arange(COLUMNS) + 0.5) / COLUMNS * 2 * np.pi - np.pi
    return Chart(axis, elevation, angle, cell, level), np.full((ROWS, COLUMNS), 0.6)


def heights(chart, distance):
    return chart.points(distance)[..., 1]


def shown(chart, reach=50.0):
    return np.broadcast_to(np.abs(np.degrees(chart.angle)) < reach, (ROWS, COLUMNS)).copy()


def painted(hair, seed=0):
    colors = np.where(hair[..., None], DARK, LIGHT)
    return colors + np.random.default_rng(seed).normal(0, 0.02, colors.shape)


@pytest.mark.parametrize("line", [0.1, 0.22])
def test_the_hairline_is_this_heads_own_where_photos_show_it(line):
    chart, distance = head()
    well = shown(chart)
    truth = heights(chart, distance) > line
    colors = painted(truth)
    colors[~well] = 0.5
    found, own = hair_cells(chart, distance, colors, well)
    assert found is not None and (own == well).mean() > 0.99
    clear = np.abs(heights(chart, distance) - line) > 0.03
    assert (found == truth)[well & clear].mean() > 0.99
    # Beside what they show it goes on; far behind, as on most heads.
    beside = ~well & shown(chart, 60.0) & clear
    assert (found == truth)[beside].mean() > 0.95
    behind = np.abs(np.degrees(chart.angle)) > 150
    assert found[:, behind][heights(chart, distance)[:, behind] > -0.2].mean() > 0.95
    assert not found[heights(chart, distance) < -0.6].any()


def test_a_head_of_one_color_has_no_hairline():
    chart, distance = head()
    colors = painted(np.zeros((ROWS, COLUMNS), bool))
    assert hair_cells(chart, distance, colors, shown(chart))[0] is None


def test_a_dark_collar_is_no_hair():
    chart, distance = head()
    well = shown(chart)
    high = heights(chart, distance)
    found, own = hair_cells(chart, distance, painted((high > 0.15) | (high < -0.7)), well)
    assert found is not None and not found[high < -0.65].any()
    assert own[well & (high < -0.7)].all()


def test_an_ear_before_hair_is_no_skin_behind_it():
    chart, distance = head()
    degrees = np.abs(np.degrees(chart.angle))[None]
    high = heights(chart, distance)
    well = shown(chart, 100.0)
    truth = (high > 0.15) | (high > -0.3) & (degrees > 80)
    ear = (high > -0.15) & (high < 0.1) & (degrees > 88)
    found, own = hair_cells(chart, distance, painted(truth & ~ear), well)
    assert found is not None
    behind = (high > -0.15) & (high < 0.1) & (degrees > 120)
    assert found[behind].mean() > 0.98
    # Its skin is not what hair goes on in.
    assert (own & ear & found).sum() < 0.1 * (well & ear & found).sum()


def test_colors_go_on_without_a_step_and_keep_apart():
    chart, distance = head()
    well, hair = shown(chart), heights(chart, distance) > 0.1
    colors = painted(hair)
    # It is darker towards one side.
    colors *= (1 - 0.3 * chart.angle / np.pi)[None, :, None]
    out = continued_colors(np.where(well[..., None], colors, 0.5), well, 0.3, hair)
    last = np.flatnonzero(well[0])[-1]
    for part in (hair, ~hair):
        inside, beyond = (colors[:, last - 3:last + 1][part[:, last - 3:last + 1]],
                          out[:, last + 1:last + 5][part[:, last + 1:last + 5]])
        assert np.abs(inside.mean(axis=0) - beyond.mean(axis=0)).max() < inside.std(axis=0).min()
    behind = ~shown(chart, 120.0)
    assert np.abs(out[behind & hair].mean(axis=0) - DARK).max() < 0.05
    assert np.abs(out[behind & ~hair].mean(axis=0) - LIGHT).max() < 0.08


def test_hair_beyond_the_photos_has_strands_and_skin_is_plain():
    chart, distance = head()
    well, hair = shown(chart), heights(chart, distance) > 0.1
    colors = np.where(hair[..., None], DARK, LIGHT) * np.ones((ROWS, COLUMNS, 1))
    strands = 0.06 * np.sin(np.arange(COLUMNS) * 2 * np.pi / 8)[None, :, None]
    colors = colors + strands
    out = continued_colors(np.where(well[..., None], colors, 0.5), well, 0.3, hair)
    beyond = ~shown(chart, 60.0)
    wavy, plain = (out[part & beyond].std(axis=0).mean() for part in (hair, ~hair))
    assert wavy > 0.02 > 2 * plain
    # Strands run down, over each other.
    rows = out[50:58][:, beyond[0]][hair[50:58][:, beyond[0]]].reshape(-1, beyond[0].sum(), 3)
    assert np.corrcoef(rows[0, :, 0], rows[-1, :, 0])[0, 1] > 0.9


def lit(chart, towards=(0.15, 0.3, 0.3)):
    """Unit normals of the head, and what a light makes of them."""
    normals = chart.rays
    return normals, np.exp(normals @ np.array(towards))[..., None]


def test_skin_that_turns_away_from_the_light_is_dark_where_no_photo_looks():
    chart, _ = head()
    normals, light = lit(chart)
    truth = 0.7 * LIGHT * light
    well, bare = shown(chart), np.ones((ROWS, COLUMNS), bool)
    given = np.where(well[..., None], truth, 0.0)
    # Brows and lips are no shade.
    given[40:43, 55:65] = 0.1
    plain = continued_colors(given, well, 1.0, None)
    found = continued_in_shade(given, well, 1.0, None, bare, normals)
    beside = shown(chart, 100.0) & ~shown(chart, 60.0)
    errors = [np.abs(part - truth)[beside].mean() for part in (plain, found)]
    assert errors[1] < 0.6 * errors[0]
    # What photos show stays.
    inner = shown(chart, 35.0)
    inner[36:47, 50:70] = False
    assert np.abs(found - truth)[inner].max() < 0.02


def test_no_skin_gets_darker_than_any_that_photos_show():
    chart, _ = head()
    normals, light = lit(chart, (0.0, 0.0, 1.5))
    well = shown(chart)
    shade = shade_of(LIGHT * light, well, normals)
    assert shade.max() / shade.min() < 1.01 * light[well].max() / light[well].min()
    assert np.ptp(shade_of(LIGHT * light, np.zeros_like(well), normals)) == 0.0


def test_hair_has_no_shade_of_skin():
    chart, distance = head()
    normals, light = lit(chart, (0.5, 0.0, 0.0))
    hair = heights(chart, distance) > 0.1
    colors = np.where(hair[..., None], DARK, LIGHT * light)
    well = shown(chart)
    parts = colors, well, 1.0, hair
    found = continued_in_shade(*parts, np.ones_like(hair), normals)
    assert np.abs(found - continued_colors(*parts))[hair].max() < 0.02
    assert not np.array_equal(found[~hair], continued_colors(*parts)[~hair])
