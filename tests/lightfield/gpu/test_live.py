"""Light fields that move: pictures equal the CPU's, whatever is mixed, mirrored or still coarse."""

import dataclasses

import numpy as np
import pytest

from lfportrait.errors import UserError
from lfportrait.gpu import GpuProcess
from lfportrait.lightfield import Display, EncodeConfig, encode, encode_rows, view_camera
from lfportrait.lightfield.gpu.live import LiveCoder, same_points, spread_viewpoints
from lfportrait.lightfield.screens.live import one_eyed
from lfportrait.metrics import psnr
from tests.fields import head_field, shell_field
from tests.lightfield.test_ground import checkered

PANEL = Display(160, 96, views=24, pitch=11.3, slant=0.2, cone=40, distance=4, name="panel")
CONFIG = EncodeConfig()
EVEN = 50.0
"""PSNR in dB from which pictures count as equal."""


def caller(process):
    """What calls a function of `live_runs` in a device's process."""
    return lambda function, *arguments: process.call(
        "tests.lightfield.gpu.live_runs:quietly", function, *arguments)


@pytest.fixture
def run(gpu_child):
    return caller(gpu_child)


@pytest.fixture
def run_alone(adapter):
    """In a process that nothing was done in before: its memory is looked at."""
    process = GpuProcess(adapter)
    yield caller(process)
    process.close()


def alike(picture, wanted):
    assert picture.shape == wanted.shape and picture.dtype == np.uint8
    assert wanted.std() > 5
    return psnr(picture / 255.0, wanted / 255.0) >= EVEN


def painted(field, seed=7):
    """A field of the same points with one random color each."""
    colors = shell_field(24, basis=1, seed=seed).sh
    return field.with_sh(colors[:len(field.density)])


@pytest.mark.slow  # shaders; one panel is coded in test_coding_on_gpu.py
def test_pictures_are_the_cpus_wherever_the_head_is_turned_to(run):
    field = checkered(shell_field(24, basis=9, seed=1))
    configs = [CONFIG, EncodeConfig(turn=20, focus=0.2, depth_scale=0.6, size=0.5),
               EncodeConfig(turn=-170), EncodeConfig(method="direct", blend="filtered", focus=-0.3)]
    pictures = run("settled", field, PANEL, [(config, 0.0) for config in configs])
    for picture, config in zip(pictures, configs, strict=True):
        assert alike(picture, encode(field, PANEL, config, device="cpu"))


@pytest.mark.slow  # shaders
@pytest.mark.parametrize("changes", [
    {"subpixels": "BGR", "inverted": True}, {"flip_x": True, "flip_y": True},
    {"cells": ((-0.3, 0.1, 0.0, -0.2, 0.35, 0.1),), "width": 151, "height": 83}])
def test_all_kinds_of_panels_are_coded(run, changes):
    panel = dataclasses.replace(PANEL, **changes)
    field = shell_field(20, basis=1)
    picture, = run("settled", field, panel, [(CONFIG, 0.0)])
    assert alike(picture, encode(field, panel, CONFIG, device="cpu"))


@pytest.mark.slow  # shaders
@pytest.mark.parametrize("page", [None, 1 << 15])
def test_a_photos_colors_are_mixed_in(run, page):
    photo = shell_field(24, basis=9, seed=3)
    painting = painted(photo)
    shares = (0.0, 0.35, 1.0, 0.0)
    pictures = run("settled", painting, PANEL, [(CONFIG, share) for share in shares], photo, page)
    wide = np.zeros_like(photo.sh)
    wide[..., :1] = painting.sh
    for picture, share in zip(pictures, shares, strict=True):
        mixed = photo.with_sh((1 - share) * wide + share * photo.sh)
        assert alike(picture, encode(mixed, PANEL, CONFIG, device="cpu"))
    assert not alike(pictures[0], pictures[1]) and not alike(pictures[1], pictures[2])


@pytest.mark.slow  # shaders
def test_a_texture_fades_with_the_painting_that_it_belongs_to(run):
    from tests.lightfield.gpu.test_coding_on_gpu import textured

    photo = head_field(32)
    painting = textured(photo.with_sh(0.3 * photo.sh))
    pictures = run("settled", painting, PANEL, [(CONFIG, 0.0), (CONFIG, 1.0)], photo)
    assert alike(pictures[0], encode(painting, PANEL, CONFIG, device="cpu"))
    assert alike(pictures[1], encode(photo, PANEL, CONFIG, device="cpu"))
    plain = encode(painting.with_sh(painting.sh), PANEL, CONFIG, device="cpu")
    assert not alike(pictures[0], plain)


@pytest.mark.slow  # shaders
def test_a_slow_device_shows_every_nth_row_of_what_moves_and_then_all(run):
    field = checkered(shell_field(24, basis=1, seed=2))
    other = EncodeConfig(turn=25)
    before, first, apart, last, steps = run("coarse", field, PANEL, CONFIG, other)
    assert alike(before, encode(field, PANEL, CONFIG, device="cpu"))
    assert apart == 17 and steps > 1
    whole = encode(field, PANEL, other, device="cpu")
    assert alike(last, whole)
    for row in range(apart // 2, PANEL.height, apart):
        block = first[row - apart // 2:row + apart // 2 + 1]
        assert (block == block[0]).all()
    # Its ground may still be the one before; the head in front of it is the new one.
    lit, dark = (encode_rows(field, PANEL, dataclasses.replace(
        other, ground="black", background=grey), apart // 2, 5, apart) for grey in (1.0, 0.0))
    head = lit == dark
    assert head.mean() > 0.05
    assert psnr(first[apart // 2:5 * apart:apart][head] / 255.0, dark[head] / 255.0) >= EVEN


@pytest.mark.slow  # shaders
def test_an_eye_in_the_middle_sees_a_plain_perspective_view(run):
    field = head_field(40)
    config = EncodeConfig(size=0.7, focus=0.1, method="direct", background=1.0)
    seen = one_eyed(PANEL, 120, 72)
    picture, = run("settled", field, seen, [(config, 0.0)])
    assert alike(picture, encode(field, seen, config, device="cpu"))
    camera = view_camera(PANEL, config, 0.0, width=120, height=72)
    view = field.render(camera, background=1.0).color
    assert psnr(picture / 255.0, np.clip(view, 0, 1)) > 40


@pytest.mark.slow  # shaders
def test_memory_stays_as_it_is_over_a_hundred_pictures(run_alone):
    panel = PANEL.scaled(48, 32)
    (early, first), (late, last) = run_alone("hundred", shell_field(16, basis=1), panel)[0]
    assert last == first
    assert late - early < 16 << 20


@pytest.mark.slow  # shaders
@pytest.mark.parametrize("format", ["rgba8unorm", "bgra8unorm"])
def test_a_panel_is_sent_the_pictures_bytes_mirrored_if_it_mirrors(run, format):
    random = np.random.default_rng(1)
    picture = random.integers(0, 256, (33, 96), dtype=np.uint8)
    display = dataclasses.replace(PANEL, width=23, height=33, flip_x=True, flip_y=True)
    own = picture[:, :69].reshape(33, 23, 3)
    pixels, complaint = run("drawn", display, picture, format)
    assert np.array_equal(pixels, display.to_panel(own))
    assert "does not show the picture's own pixels" in complaint


def test_fields_of_other_points_are_not_mixed():
    field = shell_field(16, basis=1)
    assert same_points(field, shell_field(16, basis=9))
    for other in (shell_field(18, basis=9), shell_field(16, basis=9, seed=4),
                  shell_field(16, basis=9, box=(1.0, 1.1, 1.0))):
        assert not same_points(field, other)
        with pytest.raises(UserError, match="give the field that was stylised"):
            LiveCoder(None, field, PANEL, other)


@pytest.mark.parametrize("size", [(8193, 64), (8192, 8192)])
def test_panels_that_no_window_can_have_are_refused(size):
    with pytest.raises(UserError, match="can be live on panels of up to 8192 pixels a side"):
        LiveCoder(None, shell_field(8), PANEL.scaled(*size))


def test_eyes_are_spread_over_the_same_line():
    line = np.array([[0.0, 1, 4]]) + np.outer((np.arange(5) + 0.5) / 5, [2.0, 0, 1])
    for layers in (1, 2, 5, 9):
        share = (np.arange(layers) + 0.5) / layers
        wanted = np.array([0, 1, 4]) + np.outer(share, [2, 0, 1])
        assert np.allclose(spread_viewpoints(line, layers), wanted)
    assert np.allclose(spread_viewpoints(line[:1], 3), line[0])


def test_other_colors_of_the_same_points_share_the_layout():
    photo = shell_field(20, basis=9)
    table = photo.bricks.table
    painting = painted(photo)
    assert painting.bricks.table is table
    fresh = dataclasses.replace(painting)
    assert np.array_equal(encode(painting, PANEL, device="cpu"), encode(fresh, PANEL, device="cpu"))
