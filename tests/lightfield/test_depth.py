"""Depth against what a panel can show: flattening the head, and the view filter."""

import dataclasses
import math

import numpy as np
import pytest

from lfportrait.errors import UserError
from lfportrait.field import VoxelField
from lfportrait.lightfield import (
    DepthReport,
    Display,
    EncodeConfig,
    Placement,
    ViewMask,
    encode,
    render_view,
    simulate,
    view_camera,
)
from lfportrait.lightfield.kernels.panel import mix_light
from lfportrait.metrics import psnr

PANEL = Display(360, 240, views=24, pitch=9.4, slant=math.radians(8), cone=50, distance=3,
                name="panel")


def ball(depth, size=56):
    """An opaque colored ball, flattened to a depth; seen alike from all sides."""
    axis = 2 * (np.arange(size) + 0.5) / size - 1
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    inside = x ** 2 + y ** 2 + z ** 2 < 0.75 ** 2
    links = np.full((size,) * 3, -1, np.int32)
    links[inside] = np.arange(inside.sum())
    colors = 1.2 * np.sin(6 * np.stack([x[inside], y[inside], z[inside]], 1))
    return VoxelField(links, np.full(inside.sum(), 400.0, np.float32),
                      colors.astype(np.float32)[:, :, None], np.zeros(3),
                      np.array([1.0, 1.0, depth]))


def coded(field, panel=PANEL, **options):
    return encode(field, panel, EncodeConfig(**options), mask=ViewMask.build(panel, cache=False))


def test_rays_of_the_flattened_head_meet_the_panel_where_they_should():
    config = EncodeConfig(depth_scale=0.4, focus=0.3, turn=25.0, shift_x=0.1)
    placement = Placement.of(PANEL, config)
    lattice = ball(1.0).lattice
    random = np.random.default_rng(0)
    for world in random.uniform(-1, 1, (20, 3)):
        # As described: turned, scaled, flattened, and moved.
        shown = (placement.to_world.T @ world) * placement.scale * [1, 1, 0.4] + [0.1, -0.04, 0.3]
        eye = np.array([random.uniform(-1, 1), 0.2, PANEL.distance])
        panel = eye + (shown - eye) * eye[2] / (eye[2] - shown[2])
        # As the kernels have it: the deep eye sees the head's own point behind the same place.
        deep_eye = np.array([*eye[:2], placement.deep_distance(PANEL)])
        matrix = placement.to_lattice(lattice)
        start, through = (matrix @ np.append(point, 1.0) for point in (deep_eye, panel))
        point = lattice[3:6] * world + lattice[6:9]
        assert np.abs(np.cross(point - start, through - start)).max() < 1e-6


@pytest.mark.parametrize("method", ["slices", "direct"])
@pytest.mark.parametrize(("scale", "focus", "eye"), [(0.4, 0.0, 0.0), (0.6, 0.3, 0.5)])
def test_a_head_is_flattened_about_its_middle(method, scale, focus, eye):
    panel = dataclasses.replace(PANEL, eye_height=eye)
    wanted = coded(ball(scale), panel, focus=focus, method="direct") / 255.0
    right, *others = (psnr(coded(ball(1.0), panel, focus=focus, depth_scale=other * scale,
                                 method=method) / 255.0, wanted) for other in (1, 0.5, 1.5))
    assert right > 27
    assert max(others) < right - 2


def test_flattening_follows_the_turn():
    """A turned head is flattened towards the panel, not along its own axis."""
    turned = render_view(ball(1.0), PANEL, 12, EncodeConfig(turn=90.0, depth_scale=0.4))
    upright = render_view(ball(1.0), PANEL, 12, EncodeConfig(turn=90.0))
    # From straight ahead the head stays as wide as it is.
    widths = [np.ptp(np.nonzero(picture.max(-1).max(0) > 20)[0]) for picture in (turned, upright)]
    assert abs(widths[0] / widths[1] - 1) < 0.15


def test_a_camera_sees_what_the_panel_shows():
    config = EncodeConfig(depth_scale=0.5, focus=0.2, background=0.3, method="direct")
    field = ball(1.0)
    direct = render_view(field, PANEL, 3, config)
    camera = view_camera(PANEL, config, PANEL.eyes()[3], width=1080, height=240)
    wide = field.render(camera, 0, background=0.3).color.reshape(240, 360, 3, 3)
    picture = np.clip(np.stack([wide[:, :, k, k] for k in range(3)], -1), 0, 1)
    assert np.abs(picture * 255 - direct).max() <= 0.51


@pytest.mark.parametrize("name", ["generic-4k", "lookingglass-portrait"])
def test_the_report_tells_which_scale_fits(name):
    panel = Display.preset(name)
    blurred = DepthReport.of(panel)
    assert blurred.sharp_percent < 90
    config = EncodeConfig(depth_scale=blurred.sharp_depth_scale)
    fit = DepthReport.of(panel, dataclasses.replace(
        config, focus=DepthReport.of(panel, config).best_focus))
    assert fit.sharp_percent == pytest.approx(100, abs=0.5)
    assert max(fit.front_blur, fit.back_blur) == pytest.approx(1, abs=0.1)
    wider = DepthReport.of(panel, dataclasses.replace(config, depth_scale=1.2 * config.depth_scale))
    assert wider.sharp_percent < 95
    assert "--depth-scale" in blurred.lines()[-1]


@pytest.mark.parametrize("scale", [0.0, -1.0, 5.0, math.nan])
def test_impossible_scales_are_refused(scale):
    with pytest.raises(UserError, match="depth scale"):
        coded(ball(1.0), depth_scale=scale)


def bar(depth, size=64):
    """A plate at a depth with a white and a black half."""
    axis = 2 * (np.arange(size) + 0.5) / size - 1
    inside = np.zeros((size,) * 3, bool)
    inside[(np.abs(axis - depth) < 0.05)] = (np.abs(axis) < 0.8)[:, None] & (np.abs(axis) < 0.8)
    links = np.full(inside.shape, -1, np.int32)
    links[inside] = np.arange(inside.sum())
    sh = np.full((inside.sum(), 3, 1), -2.0, np.float32)
    sh[np.nonzero(inside)[2] < size // 2] = 1.5
    return VoxelField(links, np.full(inside.sum(), 800.0, np.float32), sh)


def comb(depth, blend, panel=PANEL):
    """What the eye sees: error against the true view, and how much of it changes row by row."""
    field = bar(depth)
    image = coded(field, panel, blend=blend, shift_y=0.0)
    error = []
    for view in (6, 12, 17):
        truth = render_view(field, panel, view, EncodeConfig(shift_y=0.0)) / 255.0
        error.append((simulate(image, panel, (panel.eyes()[view],)) - truth)[40:-40])
    stacked = np.stack(error)
    return np.sqrt((stacked ** 2).mean()), np.sqrt((np.diff(stacked, axis=1) ** 2).mean())


@pytest.mark.parametrize("depth", [0.8, -0.8])
def test_the_filter_turns_combs_into_a_blur(depth):
    budget = DepthReport.of(PANEL)
    assert 0.8 * depth > 1.1 * budget.front or 0.8 * depth < 0.7 * budget.back
    error, rough = comb(depth, "filtered")
    plain_error, plain_rough = comb(depth, "nearest")
    # Part of it is there at any depth: a black edge in a row falls between two lenses.
    _, unavoidable = comb(0.0, "nearest")
    assert rough - unavoidable < 0.8 * (plain_rough - unavoidable)
    assert error < 1.02 * plain_error


def test_the_filter_leaves_what_lies_on_the_panel():
    field = bar(0.0)
    plain, filtered = coded(field, blend="continuous"), coded(field, blend="filtered")
    # But for the plate's thickness.
    assert psnr(filtered / 255.0, plain / 255.0) > 30
    deep = bar(0.8)
    assert psnr(coded(deep, blend="filtered") / 255.0,
                coded(deep, blend="continuous") / 255.0) < 26


def test_pictures_mix_as_light():
    random = np.random.default_rng(0)
    pictures = random.integers(0, 256, (3, 5, 7), np.uint8)
    pictures[:, 0] = np.arange(7)
    wanted = (((pictures / 255.0) ** 2.2).mean(0) ** (1 / 2.2) * 255 + 0.5).astype(np.uint8)
    mix_light(pictures, (np.arange(256) / 255.0) ** 2.2, 2.2)
    assert np.array_equal(pictures[0], wanted)
    assert np.array_equal(pictures[0, 0], np.arange(7))


def test_the_filter_works_on_panels_with_blue_first():
    field = ball(1.0)
    filtered = coded(field, dataclasses.replace(PANEL, subpixels="BGR"), blend="filtered")
    plain = coded(field, dataclasses.replace(PANEL, subpixels="BGR"), blend="continuous")
    other = coded(field, blend="continuous")
    assert psnr(filtered / 255.0, plain / 255.0) > psnr(filtered / 255.0, other / 255.0)
