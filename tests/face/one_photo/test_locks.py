"""Fine detail of hair that no photo shows, and hair that lies deep."""

import numpy as np

from lfportrait.face.one_photo.locks import AXIS, HIGH, RADIUS, Chart
from lfportrait.face.one_photo.paint import Relief, _fill, _Mean


def mane(count: int = 60_000) -> tuple[np.ndarray, np.ndarray]:
    """Places of a cylinder around the chart's axis, and their angles, 0 in front."""
    random = np.random.default_rng(0)
    around = random.uniform(-np.pi, np.pi, count)
    points = np.stack([RADIUS * np.sin(around), random.uniform(-0.9, HIGH, count),
                       AXIS + RADIUS * np.cos(around)], axis=1)
    return points, around


def test_strands_go_on_where_hair_is_not_seen_any_more():
    points, around = mane()
    # They lean: mirrored ones would lean the other way.
    phase = 40 * (around - 0.3 * points[:, 1] * np.sign(around))
    detail = 0.2 * np.sin(phase)[:, None] * np.ones(3)
    seen = ((np.abs(around) > 0.5) & (np.abs(around) < 1.2)).astype(float)
    chart = Chart.of(points[seen > 0], detail[seen > 0], seen[seen > 0], 0.01)
    found, sure = chart.at(points)
    assert sure.min() > 0.9
    within = (np.abs(around) > 0.6) & (np.abs(around) < 0.9)
    assert np.abs(found - detail)[within].mean() < 0.03, "what is seen is itself"
    for low, high in ((1.3, 1.9), (1.9, 2.6)):
        part = (around > low) & (around < high) & (np.abs(points[:, 1] + 0.3) < 0.4)
        assert 0.6 < found[part].std() / detail.std() < 1.2
        # One strand goes on in its direction: along it the detail is the same.
        lower = points[part] - [0, 0.1, 0]
        turn = around[part] - 0.03
        lower[:, 0], lower[:, 2] = RADIUS * np.sin(turn), AXIS + RADIUS * np.cos(turn)
        along = np.corrcoef(found[part, 0], chart.at(lower)[0][:, 0])[0, 1]
        turn = around[part] + 0.03
        lower[:, 0], lower[:, 2] = RADIUS * np.sin(turn), AXIS + RADIUS * np.cos(turn)
        across = np.corrcoef(found[part, 0], chart.at(lower)[0][:, 0])[0, 1]
        assert along > 0.8 and along > across + 0.5


def test_both_sides_of_a_chart_are_alike():
    around = np.linspace(-1.2, 1.2, 4801)
    points = np.stack([RADIUS * np.sin(around), np.resize(np.linspace(-0.9, 0, 3), 4801),
                       AXIS + RADIUS * np.cos(around)], axis=1)
    seen = points[np.abs(around) > 0.5]
    chart = Chart.of(seen, np.ones((len(seen), 1)), np.ones(len(seen)), 0.0125)
    assert np.allclose(chart.ends[0], chart.ends[1], atol=0.013)
    assert abs(chart.widths[0] - chart.widths[1]) < 0.013


def test_of_little_that_is_seen_nothing_is_copied():
    points, around = mane(20_000)
    seen = np.abs(around - 1.0) < 0.03
    chart = Chart.of(points[seen], np.ones((int(seen.sum()), 3)), np.ones(int(seen.sum())), 0.01)
    assert not chart.at(points)[1].any()


def test_hair_that_is_not_seen_is_dark_between_locks_and_has_no_color_of_an_outline():
    points, around = mane(20_000)
    square = np.clip(np.cos(around), 0, 1)
    own, other = _Mean(len(points)), _Mean(len(points))
    brown, ground = np.array([0.4, 0.3, 0.2]), np.array([0.3, 0.4, 0.9])
    photo = brown + (1 - square[:, None]) ** 4 * (ground - brown)
    own.best[:] = (square > 0.25).astype(float)
    own.weights[:] = own.best
    own.total[:] = own.best[:, None] * np.column_stack([photo, np.ones(len(points))])
    own.square[:] = own.best * square ** 3
    parts = tuple(np.full(len(points), float(kind == 0)) for kind in range(4))
    free = np.where(points[:, 1] < -0.5, 0.3, 1.0)
    found = _fill(points, own, other, parts, np.zeros(len(points), bool), None,
                  Relief(points, free, 1.0))
    side = np.abs(np.abs(around) - 1.7) < 0.15
    plain, deep = found[side & (points[:, 1] > -0.3)], found[side & (points[:, 1] < -0.7)]
    assert deep.mean() < 0.5 * plain.mean()
    blue = np.median(plain[:, 2] / plain[:, 0])
    unlit = _fill(points, own, other, parts, np.zeros(len(points), bool))[side]
    assert blue < 0.8 < np.median(unlit[:, 2] / unlit[:, 0])
