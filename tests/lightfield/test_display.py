"""Displays: the mapping against both published formulas, conversions, validation, files."""

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.lightfield import (
    Display,
    InterlaceConfig,
    ViewMask,
    interlace,
    read_coded,
    write_coded,
)
from lfportrait.media.pictures import read_image

display_of = Display.from_looking_glass

# Three panels as their makers describe them: a published 8.9 inch one, a portrait one whose slope
# is negative and whose views are inverted, and one of 2024 with its sub-pixels in cells.
CLASSIC = {"screenW": 2560.0, "screenH": 1600.0, "DPI": 338.0, "slope": 5.0443, "center": 0.1769,
           "pitch": 49.818, "viewCone": 40.0, "invView": 0.0}
PORTRAIT = {"screenW": 1536.0, "screenH": 2048.0, "DPI": 324.0, "slope": -7.15, "center": 0.53,
            "pitch": 52.59, "viewCone": 40.0, "invView": 1.0}
CELLS = {"screenW": 3840.0, "screenH": 2160.0, "DPI": 283.0, "slope": -6.9, "center": 0.17,
         "pitch": 44.72, "viewCone": 50.0, "invView": 1.0, "CellPatternMode": 2.0,
         "subpixelCells": [
             {"ROffsetX": -0.31, "ROffsetY": 0.25, "GOffsetX": 0.28, "GOffsetY": 0.25,
              "BOffsetX": 0.0, "BOffsetY": -0.25},
             {"ROffsetX": -0.31, "ROffsetY": -0.25, "GOffsetX": 0.28, "GOffsetY": -0.25,
              "BOffsetX": 0.0, "BOffsetY": 0.25}]}
PANELS = {"classic": CLASSIC, "portrait": PORTRAIT, "cells": CELLS}
WIDE = settings(max_examples=50, deadline=None)


def cell_number(mode, x, up, count):
    """The maker's rule of which cell a pixel has; ``up`` counts rows from the bottom."""
    if mode == 1:
        number = np.where(x % 2 == up % 2, 0, 1)
    elif mode == 2:
        number = up % 4 + 0 * x
    elif mode == 3:
        number = (up + 2 * (x % 2)) % 4
    elif mode == 4:
        number = x % 2 + 0 * up
    else:
        number = 0 * (x + up)
    return number % count


def shader(calibration, views):
    """The maker's shader written out: the view of each pixel's red, green and blue, [H, W, 3]."""
    c = calibration
    width, height = int(c["screenW"]), int(c["screenH"])
    flip = c.get("flipImageX", 0.0)
    pitch = c["pitch"] * width / c["DPI"] * math.cos(math.atan(1 / c["slope"]))
    tilt = height / (width * c["slope"]) * (-1 if flip else 1)
    x, up = np.arange(width)[None, :], height - 1 - np.arange(height)[:, None]
    s, t = (x + 0.5) / width, (up + 0.5) / height
    s = 1 - s if flip else s
    planes = []
    for k in range(3):
        step = 2 - k if c.get("flipSubp") else k
        across, along = s + step / (3 * width), t
        if c.get("subpixelCells"):
            cells = c["subpixelCells"]
            number = cell_number(int(c.get("CellPatternMode", 0)), x, up, len(cells))
            across = s + np.array([cell["RGB"[k] + "OffsetX"] for cell in cells])[number] / width
            along = t + np.array([cell["RGB"[k] + "OffsetY"] for cell in cells])[number] / height
        a = (across + along * tilt) * pitch - c["center"]
        a = a - np.floor(a)
        planes.append(1 - a if c.get("invView") else a)
    return np.stack(planes, -1) * views


def ours(display):
    """The view of each pixel's red, green and blue in the picture sent to the panel, [H, W, 3]."""
    rows, columns = np.ogrid[:display.height, :display.width]
    views = np.empty((display.height, display.width, 3))
    for place in range(3):
        views[..., display.channel(place)] = display.view_of(rows, columns, place)
    return display.to_panel(views)


def apart(first, second, views):
    """Largest difference of two maps of views; the first and the last view are neighbours."""
    away = np.abs(first - second)
    return np.minimum(away, views - away).max()


# -- the published formulas -----------------------------------------------------------------------


def low(name):
    """A panel as wide as it is, but with fewer rows: whatever repeats does so within a few."""
    return {**PANELS[name], "screenH": 400.0}


@pytest.mark.parametrize("name", PANELS)
def test_every_sub_pixel_follows_the_makers_shader(name):
    display = display_of(low(name), views=48)
    assert apart(ours(display), shader(low(name), 48), 48) < 1e-6


@pytest.mark.parametrize("name", ["classic", "portrait"])
def test_every_sub_pixel_follows_equation_8(name):
    """The paper's i, j, k: row, mirrored column, sub-pixel; its value is centred."""
    display = dataclasses.replace(display_of(low(name), views=48), inverted=False)
    i = np.arange(display.height)[:, None, None]
    j = (display.width - np.arange(display.width))[None, :, None]
    k = np.arange(3)[None, None]
    inner = 3 * (display.width - j) + 3 * i * math.tan(display.slant) + k + display.offset
    paper = (inner % display.pitch - display.pitch / 2) * display.views / display.pitch
    assert apart(ours(display), paper + display.views / 2, display.views) < 1e-6


def test_both_formulas_agree_with_each_other_through_the_display():
    """Paper to Looking Glass: the calibration that we write is right for the maker's shader."""
    display = Display(640, 360, 60, pitch=16.2, slant=math.radians(10), offset=3.7)
    calibration = {key: entry["value"] for key, entry in display.looking_glass().items()
                   if isinstance(entry, dict)}
    assert apart(shader(calibration, 60), ours(display), 60) < 1e-6


flags = st.booleans().map(float)
calibrations = st.fixed_dictionaries({
    "screenW": st.integers(8, 300).map(float), "screenH": st.integers(8, 300).map(float),
    "DPI": st.floats(50, 700), "slope": st.floats(0.8, 30) | st.floats(-30, -0.8),
    "center": st.floats(-2, 2), "pitch": st.floats(5, 90), "viewCone": st.floats(10, 100),
    "invView": flags, "flipImageX": flags, "flipImageY": flags, "flipSubp": flags})
offsets = st.floats(-0.6, 0.6)
cells = st.lists(st.fixed_dictionaries({f"{c}Offset{a}": offsets for c in "RGB" for a in "XY"}),
                 min_size=1, max_size=4)


@WIDE
@given(calibrations, st.integers(2, 200))
def test_random_panels_follow_the_shader_and_survive_the_way_back(calibration, views):
    display = display_of(calibration, views=views)
    assert apart(ours(display), shader(calibration, views), views) < 1e-6
    back = display.looking_glass(calibration["DPI"])
    again = display_of(back, views=views)
    assert apart(ours(again), ours(display), views) < 1e-6
    for key in ("pitch", "slope", "DPI", "screenW", "invView", "flipImageX", "flipSubp"):
        assert math.isclose(back[key]["value"], calibration[key], rel_tol=1e-9), key
    turn = back["center"]["value"] - calibration["center"]
    assert abs(turn - round(turn)) < 1e-6


@pytest.mark.parametrize("form", ["bare", "text", "value"])
def test_a_panels_own_quilt_comes_before_our_table(form):
    quilt = {"quiltAspect": 1.78, "quiltX": 7680, "quiltY": 4320, "tileX": 8, "tileY": 6}
    entry = {"bare": quilt, "text": json.dumps(quilt), "value": {"value": quilt}}[form]
    display = display_of({**CLASSIC, "serial": "LKG-J00001", "defaultQuilt": entry})
    assert display.quilt == (8, 6) and display.quilt_size == (7680, 4320) and display.views == 48
    for broken in ("{", {}, {**quilt, "tileX": 0}, {**quilt, "quiltX": "wide"}, 7):
        entries = {**CLASSIC, "serial": "LKG-J00001", "defaultQuilt": broken}
        assert display_of(entries).quilt == (7, 7)


@pytest.mark.slow  # chosen ones: here, too
@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(PANELS)), st.data())
def test_whatever_a_calibration_says_it_is_a_panel_or_one_line(panel, data):
    calibration = dict(PANELS[panel])
    for key in data.draw(st.lists(st.sampled_from(sorted(calibration)), max_size=3)):
        calibration[key] = data.draw(
            st.floats() | st.integers(-10 ** 30, 10 ** 30) | st.text(max_size=3) | st.none()
            | st.lists(st.none(), max_size=2) | st.sampled_from([0.0, 1e-300, 1e300, -1e-9]))
    try:
        display_of(calibration)
    except UserError as error:
        assert "\n" not in str(error)


@WIDE
@given(calibrations, cells, st.integers(0, 4), st.integers(2, 200))
def test_random_panels_with_cells_follow_the_shader(calibration, rows, mode, views):
    calibration = {**calibration, "flipImageX": 0.0, "flipImageY": 0.0, "subpixelCells": rows,
                   "CellPatternMode": mode}
    display = display_of({**calibration, "flipSubp": 0.0}, views=views)
    assert apart(ours(display), shader({**calibration, "flipSubp": 0.0}, views), views) < 1e-6
    again = display_of(display.looking_glass(), views=views)
    assert apart(ours(again), ours(display), views) < 1e-6
    assert again.cells == display.cells
    assert again.cell_pattern == display.cell_pattern


@WIDE
@given(st.integers(8, 300), st.integers(8, 300), st.floats(1.5, 60.0), st.floats(0.01, 1.2),
       st.booleans(), st.floats(0, 50), st.integers(2, 200), st.booleans(), st.booleans(),
       st.booleans(), st.sampled_from(["RGB", "BGR"]))
def test_random_displays_convert_there_and_back(width, height, pitch, slant, left, offset, views,
                                                inverted, flip_x, flip_y, order):
    display = Display(width, height, views, pitch, -slant if left else slant, offset % pitch,
                      order, inverted=inverted, flip_x=flip_x, flip_y=flip_y)
    again = display_of(display.looking_glass(), views=views)
    assert apart(ours(again), ours(display), views) < 1e-6
    assert (again.flip_x, again.flip_y, again.subpixels) == (flip_x, flip_y, order)


def test_a_negative_pitch_runs_the_views_the_other_way():
    calibration = {**PORTRAIT, "pitch": -52.59, "screenW": 200.0, "screenH": 100.0}
    assert apart(ours(display_of(calibration, views=48)), shader(calibration, 48), 48) < 1e-6


# -- flips and cells ------------------------------------------------------------------------------


@pytest.mark.parametrize(("flip_x", "flip_y"), [(True, False), (False, True), (True, True)])
def test_a_mirroring_panel_gets_its_picture_mirrored(tmp_path, flip_x, flip_y):
    display = Display(30, 20, 6, 7.3, 0.1, flip_x=flip_x, flip_y=flip_y)
    views = np.zeros((6, 20, 30, 3), np.uint8)
    views[:, :10, :15] = 200  # upper left as seen
    image = interlace(views, display, InterlaceConfig(sample="nearest"))
    assert image[:10, :15].min() == 200
    write_coded(tmp_path / "coded.png", image, display)
    sent = read_image(tmp_path / "coded.png")
    corner = sent[10:] if flip_y else sent[:10]
    corner = corner[:, 15:] if flip_x else corner[:, :15]
    assert corner.min() == 200
    assert np.array_equal(read_coded(tmp_path / "coded.png", display), image)


def test_cells_move_the_sub_pixels_and_the_mask():
    display = display_of({**CELLS, "screenW": 64.0, "screenH": 30.0}, views=300)
    places = display.places()
    # The lowest row has the first cell: red 0.31 left of the middle and a quarter above it.
    lowest = (display.height - 1) % 4
    assert np.allclose(places[lowest, 0], [[0.19, 0.25], [0.78, 0.25], [0.5, 0.75]])
    assert np.allclose(places[(lowest - 1) % 4, 0, 0], [0.19, 0.75])
    mask = ViewMask.build(display, cache=False)
    assert np.array_equal(mask.views, ours(display).astype(int))
    plain = dataclasses.replace(display, cells=(), cell_pattern="single")
    assert not np.array_equal(mask.views, ViewMask.build(plain, cache=False).views)


@pytest.mark.parametrize("change", [{"cells": ((0.1,) * 6,)}, {"cell_pattern": "rows"},
                                    {"cells": ((0.0,) * 6, (0.2,) * 6)}])
def test_the_hash_tells_cells_apart(change):
    display = Display(60, 40, 12, 7.3, cells=((0.0,) * 6, (0.1,) * 6))
    assert dataclasses.replace(display, **change).hash() != display.hash()


# -- validation and files -------------------------------------------------------------------------


@pytest.mark.parametrize(("change", "complaint"), [
    ({"width": 0}, "width"), ({"height": 70000}, "height"), ({"views": 0}, "views"),
    ({"pitch": 0.5}, "pitch"), ({"pitch": math.nan}, "pitch"), ({"slant": 1.6}, "slant"),
    ({"offset": math.inf}, "offset"), ({"subpixels": "RBG"}, "RGB or BGR"), ({"cone": 0}, "cone"),
    ({"cone": math.nan}, "cone"), ({"distance": 0}, "distance"), ({"gamma": 9}, "gamma"),
    ({"eye_height": math.nan}, "eye_height"), ({"panel_height": -1}, "panel_height"),
    ({"quilt": (8, 0)}, "quilt"), ({"quilt_size": (3, 3)}, "quilt"),
    ({"cells": ((1.0,),)}, "six numbers"), ({"cells": ((9.0,) * 6,)}, "cells"),
    ({"cell_pattern": "zigzag"}, "checkerboard"),
    ({"cells": ((0.0,) * 6,), "flip_x": True}, "flipped"),
    ({"cells": ((0.0,) * 6,), "subpixels": "BGR"}, "RGB")])
def test_impossible_displays_are_told(change, complaint):
    with pytest.raises(UserError, match=complaint):
        dataclasses.replace(Display(60, 40, 12, 7.3, name="mine"), **change)


@pytest.mark.parametrize(("text", "complaint"), [
    ("cells = 3", "rows of six"), ("cells = [[0, 0, 0, 0, 0, 'a']]", "not a number"),
    ("cells = [[0.1]]", "six numbers"), ("flip_x = 1", "true or false"),
    ("quilt = [8]", "two whole numbers"), ("quilt = 8", "two whole numbers"),
    ("views = 4.5", "whole number"), ("slant_degrees = 'steep'", "not a number"),
    ("slant = 0.1\nslant_degrees = 6", "both"), ("name = 3", "not a text")])
def test_bad_entries_of_a_display_file_are_told(tmp_path, text, complaint):
    given = "" if text.startswith("views") else "views = 4\n"
    (tmp_path / "bad.toml").write_text(f"width = 90\nheight = 90\npitch = 4\n{given}{text}\n")
    with pytest.raises(UserError, match=complaint):
        Display.load(tmp_path / "bad.toml")


@pytest.mark.parametrize(("change", "complaint"), [
    ({"slope": 0}, "slope"), ({"DPI": -3}, "DPI"), ({"pitch": "wide"}, "'pitch' is not a number"),
    ({"pitch": math.nan}, "'pitch' is not a number"), ({"pitch": 0}, "pitch must not be 0"),
    ({"screenW": 0}, "screenW"), ({"center": None}, "lacks 'center'"),
    ({"subpixelCells": [3]}, "subpixelCells"), ({"subpixelCells": [{}]}, "ROffsetX"),
    ({"subpixelCells": CELLS["subpixelCells"], "CellPatternMode": 7}, "CellPatternMode 7")])
def test_bad_calibrations_are_told(change, complaint):
    with pytest.raises(UserError, match=complaint):
        display_of({**CLASSIC, **change})


def test_a_display_file_keeps_every_bit(tmp_path):
    display = dataclasses.replace(display_of(CELLS), gamma=2.4, note='a "note"', flip_x=False)
    display.save(tmp_path / "panel.toml")
    assert Display.load(tmp_path / "panel.toml") == display


def test_a_person_can_write_a_display_file(tmp_path):
    (tmp_path / "desk.toml").write_text(
        "width = 1920\nheight = 1080\nviews = 28\npitch = 14\nslant_degrees = -9.5\n"
        "subpixels = 'BGR'\n")
    display = Display.resolve(tmp_path / "desk.toml")
    assert display.name == "desk"
    assert math.isclose(math.degrees(display.slant), -9.5)
    assert not display.calibrated


def test_presets_are_marked_uncalibrated():
    for name in Display.names():
        display = Display.preset(name)
        assert not display.calibrated
        assert "uncalibrated" in display.summary()
        if name.startswith("lookingglass"):
            assert "visual.json" in display.note
            assert display.panel_height > 0.1


def test_an_imported_calibration_is_marked_calibrated(tmp_path, capsys):
    wrapped = {key: {"value": value} if isinstance(value, float) else value
               for key, value in CELLS.items()}
    (tmp_path / "visual.json").write_text(json.dumps({**wrapped, "serial": "LKG-J01234"}))
    assert main(["display", "import", str(tmp_path / "visual.json"), "--out",
                 str(tmp_path / "mine.toml")]) == 0
    display = Display.load(tmp_path / "mine.toml")
    assert display.calibrated
    assert display.name == "LKG-J01234"
    assert (display.quilt, display.views) == ((7, 7), 49)
    assert "uncalibrated" not in capsys.readouterr().out
    read = display_of(CELLS, views=49)  # as the maker's shader has it, see above
    for name in ("width", "height", "pitch", "slant", "offset", "cells", "cell_pattern", "flip_x",
                 "flip_y", "inverted", "subpixels"):
        assert getattr(display, name) == getattr(read, name), name
