"""Composition: where eyes, face, crown and bust come to lie on panels of every shape."""

import dataclasses
import warnings

import numpy as np
import pytest

from lfportrait.demo import demo_head, demo_landmarks
from lfportrait.lightfield import (
    DepthReport,
    Display,
    EncodeConfig,
    Placement,
    composed,
    encode,
    simulate,
)
from tests.fields import head_field as ball
from tests.recordings import form

SHAPES = {"16:9": (3840, 2160), "9:16": (2160, 3840), "3:4": (1536, 2048)}


@pytest.fixture(scope="module")
def field():
    return demo_head()


def panel_of(shape):
    width, height = SHAPES[shape]
    return dataclasses.replace(Display.preset("generic-4k"), width=width, height=height)


def on_panel(points, panel, placement, eye):
    """Where an eye sees points of the world on the panel, [N, 2] in half panel heights."""
    place = placement.scale * (points @ placement.to_world) + placement.deep_shift
    far = placement.deep_distance(panel)
    middle = np.array([eye, panel.eye_height])
    return middle + (place[:, :2] - middle) * (far / (far - place[:, 2:]))


@pytest.mark.parametrize("shape", SHAPES)
def test_the_eyes_lie_in_the_middle_third_from_everywhere(field, shape):
    panel = panel_of(shape)
    config = composed(field, panel, EncodeConfig(compose=True))
    assert not config.compose
    placement = Placement.of(panel, config)
    points = demo_landmarks()
    eyes = np.stack([points[36:42].mean(axis=0), points[42:48].mean(axis=0)])
    for eye in panel.eyes()[[0, 15, 30, 45, 59]]:
        seen = on_panel(eyes, panel, placement, eye)
        assert (np.abs(seen[:, 1]) < 1 / 3).all()
        assert (np.abs(seen[:, 0]) < panel.aspect / 3).all()
    # The face is in the panel's plane: it moves by next to nothing.
    left, right = (on_panel(eyes, panel, placement, eye) for eye in panel.eyes()[[0, -1]])
    assert np.abs(left - right).max() < 0.12 * placement.scale
    face = placement.deep_shift[2] + placement.scale * 0.4
    assert abs(face) < 1e-6


@pytest.mark.parametrize("shape", SHAPES)
def test_the_crown_is_within_the_picture_and_the_busts_end_is_not(field, shape):
    panel = panel_of(shape)
    placement = Placement.of(panel, composed(field, panel, EncodeConfig(compose=True)))
    points = field.lattice_points()[field.density > 10]
    crown = points[np.argsort(points[:, 1])[-50:]]
    end = points[np.argsort(points[:, 1])[:50]]
    assert on_panel(crown, panel, placement, 0.0)[:, 1].max() < 0.95
    assert np.median(on_panel(end, panel, placement, 0.0)[:, 1]) < -0.95
    # It fills more of the panel than without.
    assert placement.scale > 0.9 * Placement.of(panel, EncodeConfig()).scale


def test_what_is_seen_of_it_shows_the_face_in_the_middle(field):
    panel = panel_of("16:9").scaled(384, 216)
    image = encode(field, panel, EncodeConfig(compose=True, ground="black"))
    seen = simulate(image, panel).max(axis=-1)
    filled = seen > 0.08
    assert not filled[:4].any() and filled[-2:].any()
    assert 0.2 < filled.mean() < 0.7


@pytest.mark.parametrize("name", Display.names())
def test_the_head_is_sharp_as_far_as_it_is_seen_or_a_line_says_so(field, name):
    panel = Display.preset(name)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        config = composed(field, panel, EncodeConfig(compose=True))
    placement = Placement.of(panel, config)
    report = DepthReport.of(panel)
    nose, outline = (placement.depth * placement.scale * z + placement.shift[2] for z in (0.6, 0.0))
    sharp = nose <= report.front + 1e-9 and outline >= report.back - 1e-9
    assert sharp == (not said)
    for one in said:
        assert name in str(one.message) and "\n" not in str(one.message)


def test_options_change_what_is_composed():
    field, panel = ball(32), panel_of("16:9")
    plain = composed(field, panel, EncodeConfig(compose=True))
    other = composed(field, panel, EncodeConfig(compose=True, size=0.4, shift_x=0.1, shift_y=0.06,
                                                focus=0.05, depth_scale=0.5))
    assert other.size == pytest.approx(plain.size / 2)
    assert other.shift_x == 0.1
    assert other.shift_y == pytest.approx(plain.shift_y + 0.1)
    assert other.focus - 0.05 == pytest.approx(plain.focus / 2 / 2 / plain.depth_scale
                                               * other.depth_scale / 0.5)
    assert composed(field, panel, EncodeConfig(size=0.7)) == EncodeConfig(size=0.7)


def test_people_of_all_kinds_fit():
    panel = panel_of("3:4")
    for person in ("girl", "curly"):
        field = form(person)
        placement = Placement.of(panel, composed(field, panel, EncodeConfig(compose=True)))
        points = field.lattice_points()[field.density > 10]
        assert on_panel(points, panel, placement, 0.0)[:, 1].max() < 0.99
