"""Rays of a chart stop at the surface that a plain march finds; no lattice point is missed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from lfportrait.field.geometry.chart import WITHIN, Chart, read_surface
from lfportrait.field.grid import Cut
from lfportrait.field.kernels.march import C0
from tests.fields import head_field

FRAME = np.array([[0.8, 0.0, -0.6, 0.03], [0.0, 1.0, 0.0, -0.02], [0.6, 0.0, 0.8, 0.01],
                  [0, 0, 0, 1]]) * [[1.3], [1.3], [1.3], [1.0]]


def chart(frame=None, rows=24, level=16, columns=30):
    axis = np.stack([np.full(rows, 0.02), np.minimum(np.arange(rows), level - 1) * 0.08 - 1.0,
                     0.01 * np.minimum(np.arange(rows), level - 1)], axis=1)
    elevation = np.maximum(np.arange(rows) - (level - 1), 0) * 0.17
    angle = (np.arange(columns) + 0.5) / columns * 2 * np.pi - np.pi
    return Chart(axis, elevation, angle, 0.08, level, frame)


def plain_march(field, one, cut):
    """`read_surface`, a ray after the other, for every sixth column."""
    voxel = float(field.spacing.mean())
    distance, color = np.full((24, 5), np.nan), np.zeros((24, 5, 3))
    reach = float(np.linalg.norm(np.abs(field.bounds - one.origins[-1]).max(axis=0)))
    low = field.bounds[0] + 0.5 * field.spacing
    for v, u in np.ndindex(24, 5):
        left, behind, seen = 1.0, 0, np.zeros(3)
        for away in np.arange(reach, 0.0, -voxel):
            point = one.origins[v] + away * one.rays[v, 6 * u]
            place = np.rint((point - low) / field.spacing).astype(int)
            row = -1
            if ((place >= 0) & (place < field.links.shape[::-1])).all():
                row = field.links[tuple(place[::-1])]
            if row < 0 or (cut is not None and cut.above(point) <= 0):
                after = left
            else:
                after = left * np.exp(-max(field.density[row], 0) * voxel)
                seen += (left - after) * np.clip(0.5 + C0 * field.sh[row, :, 0], 0, 1)
            if left >= 0.5 > after:
                distance[v, u] = away + voxel * (1 - (left - 0.5) / (left - after))
            left, behind = after, behind + (after < 0.5)
            if behind > WITHIN:
                break
        color[v, u] = seen / max(1 - left, 1e-6)
        if left >= 0.1:
            distance[v, u] = np.nan
    return distance, color


CUT = Cut(np.array([0.0, 1.0, 0.0]), -0.4)


# With neither and with both; slow: with one of them.
@pytest.mark.parametrize(("cut", "frame"), [
    (None, None), (CUT, FRAME), *(pytest.param(*both, marks=pytest.mark.slow)
                                  for both in ((CUT, None), (None, FRAME)))])
def test_a_surface_is_read_as_by_a_plain_march(cut, frame):
    field, one = head_field(24), chart(frame)
    distance, color = (plane[:, ::6] for plane in read_surface(field, one, cut))
    expected, shade = plain_march(field, one, cut)
    assert np.isfinite(expected).any() and (cut is None or np.isnan(expected).any())
    assert np.array_equal(np.isnan(distance), np.isnan(expected))
    assert np.allclose(distance, expected, atol=1e-4, equal_nan=True)
    assert np.allclose(color, shade, atol=1e-4)


@settings(max_examples=15, deadline=None)
@given(some.integers(0, 10 ** 6), some.booleans())
def test_lattice_points_between_two_surfaces_are_found(seed, turned):
    generator = np.random.default_rng(seed)
    field, one = head_field(24), chart(FRAME if turned else None)
    low = 0.1 + 0.3 * generator.random((24, 30))
    high = low + 0.2 * generator.random((24, 30))
    none = generator.random((24, 30)) < 0.3
    low[none], high[none] = np.inf, -np.inf
    box = generator.uniform(-1.2, 1.2, (2, 3))
    cells = one.cells_between(field, low, high, box)
    empty = np.argwhere(field.links < 0)[:, ::-1]
    places, away = plain_places(one, field.bounds[0] + field.spacing * (empty + 0.5))
    row, column = np.rint(places).astype(int)
    at = np.clip(row, 0, 23), column % 30
    first, last = (np.rint((corner - field.bounds[0]) / field.spacing - 0.5)
                   for corner in (box.min(0), box.max(0)))
    wanted = ((away > low[at]) & (away < high[at])
              & (empty >= first).all(1) & (empty <= last).all(1))
    # A point next to the border of two cells may be taken for the other's.
    sure = (np.abs(places - np.rint(places)) < 0.499).all(axis=0)
    found = set(map(tuple, cells))
    assert len(found) == len(cells)
    assert set(map(tuple, empty[wanted & sure])) <= found
    assert not found & set(map(tuple, empty[~wanted & sure]))


@pytest.mark.parametrize("frame", [None, FRAME])
def test_lattice_points_are_looked_up_as_a_plain_interpolation_does(frame):
    one, generator = chart(frame), np.random.default_rng(3)
    distance, margin = generator.uniform(0.2, 0.9, (2, 24, 30))
    shape, center, radius = (7, 9, 8), np.array([0.1, -0.05, 0.02]), np.array([1.1, 1.4, 1.2])
    beyond, margins = one.outside(distance, margin, shape, center, radius)
    assert beyond.shape == margins.shape == shape and beyond.dtype == np.float32
    for place in np.ndindex(shape):
        point = center + radius * (2 * (np.array(place[::-1]) + 0.5) / shape[::-1] - 1)
        places, distances = plain_places(one, point[None])
        (row, column), away = places[:, 0], distances[0]
        row = np.clip(row, 0, 23)
        low, left = min(int(row), 22), int(column)
        for values, found, sign in ((distance, beyond, -1.0), (margin, margins, 1.0)):
            corners = values[low:low + 2][:, [left % 30, (left + 1) % 30]]
            wanted = ([1 - row + low, row - low] @ corners
                      @ [1 - column + left, column - left])
            got = found[place] - (away if sign < 0 else 0.0)
            assert got == pytest.approx(sign * wanted, abs=2e-6)


def plain_places(one, points):
    """`Chart.places`, in NumPy."""
    if one.frame is not None:
        points = points @ one.frame[:3, :3].T + one.frame[:3, 3]
    x, z = (points[:, k] - np.interp(points[:, 1], one.axis[:, 1], one.axis[:, k]) for k in (0, 2))
    y = np.maximum(points[:, 1] - one.axis[-1, 1], 0.0)
    flat = np.hypot(x, z)
    step = one.elevation[-1] - one.elevation[-2]
    rows = np.where(y > 0, one.level - 1 + np.arctan2(y, flat) / step,
                    (points[:, 1] - one.axis[0, 1]) / one.cell)
    column = (np.arctan2(x, z) - one.angle[0]) / (one.angle[1] - one.angle[0])
    return np.stack([rows, column % len(one.angle)]), np.hypot(flat, y) / one.scale


@pytest.mark.parametrize("frame", [None, FRAME])
def test_places_are_those_of_plain_numpy(frame):
    one = chart(frame)
    points = np.random.default_rng(4).uniform(-1.6, 1.6, (500, 3))
    points[0] = 0.02, 0.0, 0.0
    for got, wanted in zip(one.places(points), plain_places(one, points), strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-9)
    places, away = one.places(np.zeros((0, 3)))
    assert places.shape == (2, 0) and away.shape == (0,)
