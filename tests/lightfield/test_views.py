"""Level views by slices: against their plain twin, and against the views rendered one by one."""

import dataclasses
from functools import cache

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.field import VoxelField
from lfportrait.lightfield import (
    Display,
    EncodeConfig,
    eight_bit,
    quilt_of,
    render_views,
    view_camera,
    views,
)
from lfportrait.metrics import psnr
from lfportrait.share import sweep_cameras, sweep_frames
from tests.field.test_texture import textured
from tests.fields import head_field, shell_field
from tests.lightfield.test_slices import smooth_field
from tests.reference.views import pixel


def beside(count, width, height, display=None, **options):
    """Cameras at places along a line, whose pictures are one window."""
    display = display or Display(60, 40, views=5, pitch=5.0, cone=40.0, distance=4.0)
    return Camera.concatenate([
        view_camera(display, EncodeConfig(**options), display.eye_reach * place, width=width,
                    height=height) for place in np.linspace(-1, 1, count)])


def rendered(field, cameras, **options):
    """Copies of what `render_views` gives."""
    return [dataclasses.replace(each, color=each.color.copy(), alpha=each.alpha.copy(),
                                depth=each.depth.copy())
            for each in render_views(field, cameras, **options)]


@cache
def soft_field(basis, size=96):
    """An uneven shell whose density is gone before its last voxels, as a reconstructed one's is.

    Not to be changed.
    """
    field = smooth_field(basis, size)
    x, y, z = field.lattice_points().T * size / (size - 1)
    away = np.sqrt(x * x + 0.8 * y * y + z * z) - 0.55 - 0.1 * np.sin(5 * x)
    density = 40 * np.clip(np.cos(10 * away), 0, 1)
    return dataclasses.replace(field, density=density.astype(np.float32))


@pytest.fixture
def no_fallback(monkeypatch):
    """All views go through slices, steep ones too, or the test fails."""
    def refuse(*_, **__):
        raise AssertionError("rendered one by one")
    monkeypatch.setattr(VoxelField, "render", refuse)
    monkeypatch.setattr(views, "_STEEPEST", 60.0)


@pytest.mark.parametrize(("field", "options", "size"), [
    ({}, {}, (37, 29)),
    ({"size": 17}, {"focus": 0.3, "turn": 20.0}, (16, 40)),
    ({"basis": 1, "shape": (20, 14, 31)}, {"shift_y": 0.4}, (50, 21)),
    ({"basis": 1, "box": (0.8, 1.1, 0.9), "center": (0.1, -0.05, 0.2)}, {"turn": -25.0}, (33, 33)),
    ({"shape": (3, 2, 2), "density": 3.0}, {}, (20, 9)),
])
def test_every_pixel_equals_the_twin(field, options, size, no_fallback):
    field = shell_field(**{"size": 24, "basis": 9, **field})
    cameras = beside(3, *size, **options)
    shots = rendered(field, cameras, background=0.0)
    random = np.random.default_rng(0)
    away, lit = [], 0
    for view, shot in enumerate(shots):
        for _ in range(60):
            x, y = random.integers(0, size[0]), random.integers(0, size[1])
            color, through = pixel(field, cameras, view, x, y,
                                   views._FAINTEST * field.lattice[5], views._STOP)
            away += [*np.abs(shot.color[y, x] - color), abs(shot.alpha[y, x] + through - 1)]
            lit += through < 0.5
    # Coefficients and densities are kept as halves, cos(2 phi) as a straight line in cos(phi).
    assert np.mean(away) < 2e-3
    assert np.quantile(away, 0.99) < 8e-3
    assert lit > 10 or field.links.size < 200


def alike(field, cameras, least=50.0, background=0.2):
    """Assert that slices show what the views rendered one by one show, in color and depth."""
    fine = [field.render(cameras, view, background=background) for view in range(len(cameras))]
    for one, other in zip(rendered(field, cameras, background=background), fine, strict=True):
        assert other.color.std() > 0.05
        assert psnr(np.clip(one.color, 0, 1), np.clip(other.color, 0, 1)) > least
        assert np.abs(one.alpha - other.alpha).mean() < 2e-3
        both = np.isfinite(one.depth) & np.isfinite(other.depth)
        assert (np.isfinite(one.depth) == np.isfinite(other.depth)).mean() > 0.995
        assert np.median(np.abs(one.depth - other.depth)[both]) < 0.1 * field.spacing[2]


@pytest.mark.parametrize("basis", [1, 9])
@pytest.mark.parametrize("options", [{}, {"turn": 15.0, "size": 0.6}, {"focus": -0.3}])
def test_slices_show_what_single_views_show(basis, options):
    alike(soft_field(basis), beside(4, 97, 63, **options))


@pytest.mark.parametrize("size", [(64, 48), (131, 77)])
def test_a_textured_head_looks_the_same(size):
    # Densities of a reconstructed surface: they rise over two voxels.
    field = head_field(96)
    field.density[:] *= 0.5
    field = textured(field, pixels=60.0)
    field = dataclasses.replace(field, texture=field.texture.with_texels(
        np.asarray(field.texture.texels // 4, np.int8)))
    alike(field, beside(3, *size), 44.0)


def test_a_sweep_shows_what_its_frames_show():
    field = soft_field(9)
    cameras = sweep_cameras(50.0, 8, 90, field)
    alike(field, cameras)
    frames = list(sweep_frames(field, 50.0, 8, 90, background=0.2))
    shots = rendered(field, cameras, background=0.2)
    assert len(frames) == 8
    for frame, shot in zip(frames, shots, strict=True):
        assert np.abs(frame.astype(int) - eight_bit(shot.color)).max() <= 1
    assert frames[1] is frames[3] and frames[5] is frames[7]
    assert not np.array_equal(frames[1], frames[5])


def test_views_that_do_not_fit_are_rendered_one_by_one():
    field = smooth_field(1, 48)
    level = beside(2, 40, 30)
    raised = Camera.arc(np.zeros(1), distance=4.0, width=40, height=30, focal=50.0, pitch=20.0)
    aside = Camera.arc(np.array([80.0, 180.0]), distance=4.0, width=40, height=30, focal=50.0)
    rolled = level[0].transformed(np.eye(4))
    turn = np.radians(5)
    rolled.pose[:, :3, :2] = rolled.pose[:, :3, :2] @ np.array(
        [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    inside = Camera.arc(np.zeros(1), distance=0.5, width=40, height=30, focal=50.0)
    small = beside(1, 20, 15)
    cameras = Camera.concatenate([level, raised, aside, rolled, inside, small, level])
    shots = rendered(field, cameras, background=0.3)
    assert len(shots) == len(cameras) == 10
    for view, shot in enumerate(shots):
        one = field.render(cameras, view, background=0.3)
        assert shot.color.shape == one.color.shape
        if 2 <= view < 7:
            assert np.array_equal(shot.color, one.color)
        else:
            assert psnr(np.clip(shot.color, 0, 1), np.clip(one.color, 0, 1)) > 44
    chosen = rendered(field, cameras[[9, 7, 2]], background=0.3)
    for shot, view in zip(rendered(field, cameras, views=[9, 7, 2], background=0.3), chosen):
        assert np.array_equal(shot.color, view.color)


def test_few_at_a_time_look_the_same(monkeypatch):
    field, cameras = smooth_field(1, 48), beside(5, 40, 30)
    shots = rendered(field, cameras)
    monkeypatch.setattr(views, "_TOGETHER", 2 * 40 * 30 * 20)
    for one, other in zip(rendered(field, cameras), shots, strict=True):
        assert np.array_equal(one.color, other.color)
        assert np.array_equal(one.depth, other.depth)


@pytest.mark.parametrize("layout", ["q_qs3x2a1.5.png", "q_qs2x5a0.6.png"])
def test_a_quilt_holds_the_views(layout):
    field = soft_field(9)
    display = Display(120, 80, views=6, pitch=5.0, cone=40, distance=4, quilt=(3, 2),
                      quilt_size=(241, 163))
    quilt, _ = quilt_of(field, display, EncodeConfig(turn=10.0), name=layout)
    columns, rows = (int(number) for number in layout[4:7].split("x"))
    width, height = 241 // columns, 163 // rows
    count = columns * rows
    for view in range(count):
        eye = display.eye_reach * (2 * (view + 0.5) / count - 1)
        camera = view_camera(display, EncodeConfig(turn=10.0), eye, width=width, height=height)
        one = np.clip(field.render(camera, 0, background=0.0).color, 0, 1)
        row, column = divmod(view, columns)
        top = 163 - (row + 1) * height
        tile = quilt[top:top + height, column * width:(column + 1) * width]
        assert psnr(tile / 255.0, one) > 50


def test_an_empty_field_leaves_the_background():
    field = shell_field(size=12)
    field.density[:] = 0.0
    for shot in render_views(field, beside(2, 20, 15), background=0.4):
        assert np.allclose(shot.color, 0.4) and not shot.alpha.any()
        assert np.isinf(shot.depth).all()
