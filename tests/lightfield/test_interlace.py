"""Quilts and folders of views to coded pictures, and back."""

import dataclasses
import json
import math

import numpy as np
import pytest

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.files import write_image
from lfportrait.lightfield import (
    Display,
    InterlaceConfig,
    QuiltLayout,
    assemble_quilt,
    deinterlace,
    each_view,
    interlace,
    quilt_tiles,
    read_coded,
    simulate,
)
from lfportrait.lightfield.kernels.panel import _gather_rows
from lfportrait.media.pictures import read_image
from lfportrait.metrics import psnr

SMALL = Display(90, 48, views=12, pitch=7.3, slant=math.radians(9), offset=2.1, cone=50, distance=3,
                quilt=(4, 3), quilt_size=(240, 96), name="small")
CELLED = dataclasses.replace(
    SMALL, cells=((-0.31, 0.25, 0.28, 0.25, 0.0, -0.25), (-0.31, -0.25, 0.28, -0.25, 0.0, 0.25)),
    cell_pattern="checkerboard")
EXACT = InterlaceConfig(sample="nearest")


def run(*words):
    return main([str(word) for word in words])


def error_of(capsys):
    lines = [line for line in capsys.readouterr().err.splitlines()
             if line.startswith("lfportrait:")]
    assert len(lines) == 1, lines
    return lines[0]


def smooth_views(count, height, width):
    """Soft blobs that move against each other from view to view."""
    y, x = np.mgrid[:height, :width]
    y, x = (y + 0.5) / height, (x + 0.5) / width
    views = []
    for view in range(count):
        turn = (view + 0.5) / count - 0.5
        red = 0.5 + 0.4 * np.sin(9 * (x - 0.15 * turn))
        green = np.exp(-20 * ((x - 0.5 + 0.2 * turn) ** 2 + (y - 0.4) ** 2))
        blue = 0.5 + 0.4 * np.cos(7 * y + 4 * x)
        views.append(np.stack([red, green, blue], -1))
    return np.uint8(np.clip(np.stack(views), 0, 1) * 255 + 0.5)


# -- against a plain twin -------------------------------------------------------------------------


def plain_sample(picture, top, left, linear):
    height, width = picture.shape
    if not linear:
        return float(picture[min(int(top), height - 1), min(max(math.floor(left), 0), width - 1)])
    row, column = math.floor(top - 0.5), math.floor(left - 0.5)
    total = 0.0
    for dy in (0, 1):
        for dx in (0, 1):
            weight = ((top - 0.5 - row) if dy else 1 - (top - 0.5 - row)) * (
                (left - 0.5 - column) if dx else 1 - (left - 0.5 - column))
            total += weight * picture[min(max(row + dy, 0), height - 1),
                                      min(max(column + dx, 0), width - 1)]
    return total


def plain_interlace(views, display, linear, blend, focus):
    """One sub-pixel after the other, from `Display.view_of` and `Display.places`."""
    count, height, width = views.shape[:3]
    places = display.places()
    image = np.zeros((display.height, display.width, 3))
    for y in range(display.height):
        for x in range(display.width):
            for k in range(3):
                place = float(display.view_of(y, x, k)) * count / display.views
                along = (x + places[y % 4, x % 2, k, 0]) / display.width
                top = (y + places[y % 4, x % 2, k, 1]) / display.height * height
                shares = {min(int(place), count - 1): 1.0}
                if blend:
                    inside = min(max(place - 0.5, 0), count - 1)
                    low = min(int(inside), count - 2)
                    shares = {low: 1 - (inside - low), low + 1: inside - low}
                value = 0.0
                for view, share in shares.items():
                    eye = display.eye_reach * (2 * (view + 0.5) / count - 1)
                    shift = eye * focus / (display.distance + focus) / (2 * display.aspect)
                    value += share * plain_sample(views[view, :, :, display.channel(k)], top,
                                                  (along + shift) * width, linear)
                image[y, x, display.channel(k)] = value
    return image


@pytest.mark.parametrize(("change", "linear", "blend", "focus"), [
    ({}, False, False, 0.0), ({}, True, False, 0.0), ({"subpixels": "BGR"}, True, True, 0.2),
    ({"inverted": True}, False, True, -0.3), ("cells", True, False, 0.0)])
def test_interlacing_equals_its_plain_twin(change, linear, blend, focus):
    display = CELLED if change == "cells" else dataclasses.replace(SMALL, **change)
    display = dataclasses.replace(display, width=40, height=20)
    views = np.random.default_rng(1).integers(0, 256, (9, 11, 17, 3), dtype=np.uint8)
    config = InterlaceConfig("linear" if linear else "nearest", "linear" if blend else "nearest",
                             "contain", focus)
    image = interlace(views, display, config)
    assert np.abs(image - plain_interlace(views, display, linear, blend, focus)).max() <= 0.5 + 1e-6


# -- there and back -------------------------------------------------------------------------------


@pytest.mark.parametrize("display", [SMALL, CELLED, dataclasses.replace(SMALL, subpixels="BGR"),
                                     dataclasses.replace(SMALL, inverted=True, views=40)])
def test_views_of_the_panels_size_come_back_exactly_where_they_were_shown(display):
    views = np.random.default_rng(0).integers(0, 256, (display.views, 48, 90, 3), dtype=np.uint8)
    image = interlace(views, display, EXACT)
    back = np.stack(list(each_view(image, display)))
    for view in range(display.views):
        _, owned = deinterlace(image, display, view)
        assert np.array_equal(back[view][owned], views[view][owned])
    assert np.array_equal(interlace(back, display, EXACT), image)


def test_smooth_views_come_back_whole():
    display = Display(640, 400, views=24, pitch=9.4, slant=math.radians(9), offset=2.1)
    views = smooth_views(24, 200, 320)
    image = interlace(views, display)
    back = np.stack(list(each_view(image, display, width=320, height=200)))
    scores = [psnr(a / 255, b / 255) for a, b in zip(views, back)]
    assert min(scores) > 34
    for view in range(0, 24, 4):
        likeness = [psnr(back[view] / 255, other / 255) for other in views]
        assert abs(int(np.argmax(likeness)) - view) <= 1


def test_taking_apart_in_several_passes_changes_nothing(monkeypatch):
    image = interlace(smooth_views(12, 48, 90), SMALL)
    whole = list(each_view(image, SMALL, width=45, height=24))
    monkeypatch.setattr("lfportrait.lightfield.interlacing._MEMORY", 24 * 45 * 24 * 5)
    assert all(np.array_equal(a, b)
               for a, b in zip(whole, each_view(image, SMALL, width=45, height=24)))


def test_fewer_more_and_larger_views_can_be_asked_for():
    image = interlace(smooth_views(12, 48, 90), SMALL)
    assert len(list(each_view(image, SMALL, count=5, width=30, height=16))) == 5
    many = list(each_view(image, SMALL, count=30, width=180, height=96))
    assert (len(many), many[0].shape) == (30, (96, 180, 3))
    with pytest.raises(UserError, match="can't be made"):
        list(each_view(image, SMALL, count=-1))


def test_focus_brings_what_lay_behind_onto_the_panel():
    """A line at depth -0.5: without focus it follows the eye, with it it stands still."""
    display = Display(600, 200, views=20, pitch=10, cone=40, distance=4)
    views = np.zeros((20, 100, 900, 3), np.uint8)
    for view, eye in enumerate(display.eyes()):
        x = eye * 0.5 / 4.5  # place on the panel of a line behind its middle
        middle = round((x / display.aspect / 2 + 0.5) * 900)
        views[view, :, middle - 9:middle + 9] = 255

    def moves(focus):
        image = interlace(views, display, InterlaceConfig(focus=focus))
        places = []
        for view in (2, 17):
            seen = simulate(image, display, (display.eyes()[view],)).sum((0, 2))
            places.append((seen * np.arange(600)).sum() / seen.sum())
        return abs(places[1] - places[0])

    assert moves(0.0) > 20
    assert moves(0.5) < 3
    with pytest.raises(UserError, match="focus"):
        interlace(views, display, InterlaceConfig(focus=-4.0))


@pytest.mark.parametrize(("aspect", "fit", "bars", "left"), [
    (1.0, "contain", "sides", 0), (1.0, "cover", None, 0), (1.0, "stretch", None, 1),
    (3.0, "contain", "ends", 1), (3.0, "cover", None, None), (1.875, "contain", None, 1)])
def test_views_of_another_aspect_are_fitted(aspect, fit, bars, left):
    views = np.full((12, 40, 40, 3), 200, np.uint8)
    image = interlace(views, SMALL, InterlaceConfig(fit=fit), aspect=aspect)
    assert image[24, 45].min() == 200
    assert (image[24, 2].max() == 0) == (bars == "sides")
    assert (image[2, 45].max() == 0) == (bars == "ends")


# -- commands -------------------------------------------------------------------------------------


@pytest.fixture
def panel(tmp_path):
    SMALL.save(tmp_path / "small.toml")
    return tmp_path / "small.toml"


def test_a_quilts_name_tells_its_layout(tmp_path, panel):
    views = smooth_views(6, 30, 60)
    write_image(tmp_path / "q_qs3x2a1.875.png", assemble_quilt(views, QuiltLayout(3, 2, 1.875)))
    assert run("interlace", tmp_path / "q_qs3x2a1.875.png", "--display", panel, "--out",
               tmp_path / "coded.png", "--json", tmp_path / "run.json", "--quiet") == 0
    assert np.array_equal(read_image(tmp_path / "coded.png"), interlace(views, SMALL))
    figures = json.loads((tmp_path / "run.json").read_text())
    assert (figures["views"], figures["view_size"]) == (6, [60, 30])
    assert figures["seconds"]["interlace"] > 0


def test_the_options_tell_what_a_name_does_not(tmp_path, panel):
    views = smooth_views(6, 30, 60)
    write_image(tmp_path / "quilt.png", assemble_quilt(views, QuiltLayout(2, 3, 1.875)))
    assert run("interlace", tmp_path / "quilt.png", "--display", panel, "--columns", 2, "--rows", 3,
               "--views", 5, "--aspect", 1.875, "--out", tmp_path / "coded.png", "--quiet") == 0
    assert np.array_equal(read_image(tmp_path / "coded.png"), interlace(views[:5], SMALL))


def test_without_any_hint_a_quilt_has_the_panels_layout(tmp_path, panel):
    views = smooth_views(12, 32, 60)
    write_image(tmp_path / "quilt.png", assemble_quilt(views, QuiltLayout(4, 3, 1.875)))
    assert run("interlace", tmp_path / "quilt.png", "--display", panel, "--out",
               tmp_path / "coded.png", "--quiet") == 0
    assert np.array_equal(read_image(tmp_path / "coded.png"), interlace(views, SMALL))


def test_a_folder_of_views_goes_in_and_comes_out(tmp_path, panel):
    views = smooth_views(12, 48, 90)
    for number, view in enumerate(views):
        write_image(tmp_path / "in" / f"{number:02d}.png", view)
    assert run("interlace", tmp_path / "in", "--display", panel, "--sample", "nearest", "--out",
               tmp_path / "coded.png", "--quiet") == 0
    assert run("deinterlace", tmp_path / "coded.png", "--display", panel, "--out",
               tmp_path / "back", "--quiet") == 0
    files = sorted((tmp_path / "back").iterdir())
    assert [file.name for file in files] == [f"{number:04d}.png" for number in range(12)]
    back = np.stack([read_image(file) for file in files])
    coded = read_coded(tmp_path / "coded.png", SMALL)
    assert np.array_equal(interlace(back, SMALL, EXACT), coded)


def test_a_coded_picture_becomes_a_quilt(tmp_path, panel):
    views = smooth_views(12, 48, 90)
    assert not (tmp_path / "q_qs4x3a1.875.png").exists()
    write_image(tmp_path / "coded.png", interlace(views, SMALL))
    assert run("deinterlace", tmp_path / "coded.png", "--display", panel, "--out",
               tmp_path / "q.png", "--quiet") == 0
    known = set(_gather_rows.signatures)
    quilt = read_image(tmp_path / "q_qs4x3a1.875.png")
    assert quilt.shape == (96, 240, 3)
    tiles = quilt_tiles(quilt, QuiltLayout(4, 3, 1.875))
    whole = np.stack(list(each_view(interlace(views, SMALL), SMALL, width=60, height=32)))
    assert np.array_equal(tiles, whole)
    # Whether it was read or made: Numba tells arrays that can't be written to from others.
    assert set(_gather_rows.signatures) == known
    assert run("deinterlace", tmp_path / "coded.png", "--display", panel, "--out",
               tmp_path / "q_qs2x2a1.875.png", "--size", 120, 64, "--quiet") == 0
    assert read_image(tmp_path / "q_qs2x2a1.875.png").shape == (64, 120, 3)


@pytest.mark.parametrize(("words", "complaint"), [
    (["interlace", "none.png"], "no such file"), (["interlace", "empty"], "no pictures"),
    (["interlace", "mixed"], "differ in size"), (["interlace", "tiny_qs40x30a1.png"], "no quilt"),
    (["interlace", "tiny_qs0x3a1.png"], "impossible layout"),
    (["interlace", "tiny_qs2x2a1.png", "--views", "9"], "has 4 views"),
    (["interlace", "tiny_qs2x2a1.png", "--columns", "3"], "both"),
    (["interlace", "tiny_qs2x2a1.png", "--aspect", "-1"], "aspect"),
    (["interlace", "tiny_qs2x2a1.png", "--out", "coded.jpg"], "every sub-pixel"),
    (["interlace", "tiny_qs2x2a1.png", "--out", "coded"], "without a suffix"),
    (["deinterlace", "tiny_qs2x2a1.png"], "must not be scaled"),
    (["deinterlace", "tiny_qs2x2a1.png", "--size", "-4", "9"], "--size"),
    (["deinterlace", "tiny_qs2x2a1.png", "--views", "-4"], "--views"),
    (["deinterlace", "tiny_qs2x2a1.png", "--out", "q.png", "--views", "4"], "--views")])
def test_mistakes_are_told_in_one_line(tmp_path, panel, capsys, monkeypatch, words, complaint):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    for name, size in (("mixed/a", 4), ("mixed/b", 5), ("tiny_qs2x2a1", 8), ("tiny_qs40x30a1", 8),
                       ("tiny_qs0x3a1", 8)):
        write_image(tmp_path / f"{name}.png", np.zeros((size, size, 3), np.uint8))
    before = sorted(tmp_path.rglob("*"))
    assert run(*words, "--display", panel, "--quiet") == 2
    assert complaint in error_of(capsys)
    assert sorted(tmp_path.rglob("*")) == before
