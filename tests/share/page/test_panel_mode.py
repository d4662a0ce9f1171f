"""Panel mode in a real browser: the coded picture is that of `encode`, or is refused."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from lfportrait.lightfield import Display, EncodeConfig, encode
from tests.share.page.browser import Opened, decibels

pytestmark = pytest.mark.slow  # in a browser; the picture itself: tests/lightfield

PANELS = ("generic-1080p", "lookingglass-portrait", "lookingglass-16-portrait",
          "lookingglass-32-landscape")
SMALL = Display(97, 61, views=9, pitch=7.3, slant=0.17, offset=2.2, name="small")
CELLS = ((-0.25, -0.3, 0.1, 0.28, 0.25, 0.0), (0.2, -0.3, 0.25, 0.2, -0.25, 0.1))


@pytest.fixture(scope="module")
def opened(opened):
    opened.show(0, 1, 1)
    return opened


@pytest.fixture(scope="module")
def pure_opened(browser, pure_page):
    with Opened(browser, pure_page) as each:
        yield each


@pytest.mark.parametrize("name", PANELS)
def test_the_coded_picture_is_the_encoders(opened, head, name):
    panel = Display.preset(name).scaled(320, 180)
    wanted = encode(head, panel, EncodeConfig(method="direct"))
    drawn = panel.to_panel(opened.coded(panel))
    seen = wanted.max(axis=2) > 0
    assert seen.mean() > 0.1
    assert decibels(drawn[seen] / 255, wanted[seen] / 255) > 45
    # Coding by slices has its own samples; the page is as near to it as direct casting is.
    slices = encode(head, panel)[seen] / 255
    assert decibels(drawn[seen] / 255, slices) > decibels(wanted[seen] / 255, slices) - 0.5


def test_focus_depth_turn_and_place_are_the_encoders(opened, head):
    config = EncodeConfig(size=0.9, shift_x=0.1, shift_y=0.05, focus=0.3, turn=20, depth_scale=0.6,
                          method="direct", background=0.5)
    panel = SMALL.scaled(240, 160)
    drawn = opened.coded(panel, size=0.9, shiftX=0.1, shiftY=0.05, focus=0.3,
                         turn=math.radians(20), depth=0.6, ground=[0.5, 0.5, 0.5])
    assert decibels(drawn / 255, encode(head, panel, config) / 255) > 45


@pytest.mark.parametrize("blend", ["continuous", "filtered"])
def test_views_between_views_are_the_encoders(opened, head, blend):
    panel = SMALL.scaled(240, 160)
    wanted = encode(head, panel, EncodeConfig(blend=blend, method="direct"))
    drawn = opened.coded(panel, **{blend: True})
    assert decibels(drawn / 255, wanted / 255) > 45


def lit_alike(drawn, wanted):
    """Where a sub-pixel is lit in both pictures, or in neither."""
    return (drawn > 127) == (wanted > 127)


@pytest.mark.parametrize("change", [
    {}, {"subpixels": "BGR"}, {"flip_x": True}, {"flip_y": True}, {"inverted": True},
    {"slant": -0.3}, {"cells": CELLS, "cell_pattern": "columns"},
    {"cells": CELLS, "cell_pattern": "checkerboard"}, {"cells": CELLS, "cell_pattern": "rows"},
    {"cells": (*CELLS, *CELLS), "cell_pattern": "staggered"}])
def test_every_sub_pixel_has_its_view_its_color_and_its_place(pure_opened, pure, change):
    panel = replace(SMALL, **change)
    config = EncodeConfig(shift_x=0.2, shift_y=0.1, method="direct")
    wanted = encode(pure, panel, config)
    drawn = panel.to_panel(pure_opened.coded(panel, shiftX=0.2, shiftY=0.1))
    pure_colors = (wanted == 0) | (wanted == 255)
    assert 0.05 < (wanted == 255).mean() < 0.5 and pure_colors.mean() > 0.8
    assert lit_alike(drawn, wanted)[pure_colors].mean() > 0.9998
    # The check can fail: the neighbour's sub-pixels are others'.
    assert lit_alike(np.roll(drawn, 1, 1), wanted)[pure_colors].mean() < 0.99


def test_a_calibration_of_the_maker_is_read_as_on_the_command_line(pure_opened, pure):
    panel = Display.preset("lookingglass-portrait").scaled(120, 160)
    calibration = panel.looking_glass(dpi=324)
    panel = Display.from_looking_glass(calibration)
    wanted = encode(pure, panel, EncodeConfig(method="direct"))
    drawn = pure_opened.coded(panel, "visual.json", json.dumps(calibration))
    pure_colors = (wanted == 0) | (wanted == 255)
    assert lit_alike(drawn, wanted)[pure_colors].mean() > 0.9998


@pytest.mark.parametrize(("name", "text", "told"), [
    ("a.toml", "width = 4\nheight = 'x'\nviews = 3\npitch = 2", "height must be a number"),
    ("a.toml", "width 4", "cannot be read"),
    ("a.toml", "cells = [[1, 2]", "within a list"),
    ("a.toml", "width = 4\nheight = 4\nviews = 3\npitch = 0.1", "pitch must be a number from 1"),
    ("visual.json", "{", "not valid JSON"),
    ("visual.json", '{"screenW": {"value": 4}}', "screenH is not a number")])
def test_files_that_are_no_displays_are_told(opened, name, text, told):
    read = """([name, text]) => {
      try { lfportrait.readDisplay(name, text); return ""; } catch (error) { return error.message; }
    }"""
    assert told in opened.run(read, [name, text])


def start(each, tmp_path, panel):
    """Choose a display file and press the button."""
    panel.save(tmp_path / "mine.toml")
    each.press("#open-panel")
    each.page.set_input_files("#display-file", tmp_path / "mine.toml")
    each.page.wait_for_selector(
        f"#display-message:has-text('{panel.width} x {panel.height} pixels')")
    each.page.click("#start-panel")


def test_a_window_of_the_panels_size_shows_it_and_another_is_refused(browser, page, head, tmp_path):
    with Opened(browser, page, width=300, height=200, reduced_motion="reduce") as each:
        start(each, tmp_path, SMALL.scaled(320, 190))
        each.page.wait_for_selector("#message:not([hidden])")
        assert "No panel mode" in each.told()
        assert "320 x 190 pixels, this window 300 x 200" in each.told()
        assert each.page.query_selector("body.coded") is None
        panel = SMALL.scaled(300, 200)
        start(each, tmp_path, panel)
        each.page.wait_for_selector("body.coded")
        each.page.wait_for_selector("html[data-coded]", state="attached")
        drawn = each.canvas()
        assert drawn.shape[:2] == (panel.height, panel.width)
        wanted = encode(head, panel, EncodeConfig(method="direct"))
        assert decibels(drawn / 255, wanted / 255) > 45
        each.page.keyboard.press("Escape")
        each.page.wait_for_selector("body:not(.coded)")


def test_a_window_that_is_scaled_is_refused(browser, page, tmp_path):
    with Opened(browser, page, width=160, height=110, device_scale_factor=2) as each:
        start(each, tmp_path, SMALL.scaled(160, 110))
        each.page.wait_for_selector("#message:not([hidden])")
        assert "No panel mode" in each.told() and "200 %" in each.told()
        assert each.page.query_selector("body.coded") is None
