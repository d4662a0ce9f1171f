"""Coding between the views: both methods take each sub-pixel's place and eye from the display."""

import dataclasses
import math

import numpy as np
import pytest

from lfportrait.lightfield import Display, EncodeConfig, Placement, ViewMask, encode
from lfportrait.lightfield.coding import _panel
from lfportrait.lightfield.kernels.panel import eye_of, side_of
from lfportrait.metrics import psnr
from tests.fields import shell_field
from tests.reference.raycast import cast

GLASS = {"screenW": 60, "screenH": 40, "DPI": 20, "slope": 5.0443, "center": 0.1769,
         "pitch": 7.1, "viewCone": 40.0, "invView": 1}
CELLS = [dict(zip(("ROffsetX", "ROffsetY", "GOffsetX", "GOffsetY", "BOffsetX", "BOffsetY"), row))
         for row in ((0.31, 0.25, -0.28, 0.25, 0.0, -0.25), (-0.31, -0.25, 0.28, -0.25, 0.0, 0.25))]
PANELS = {
    "plain": Display(60, 40, views=12, pitch=7.3, slant=math.radians(9), offset=2.1, cone=50,
                     distance=3),
    "inverted": Display(60, 40, views=9, pitch=6, offset=0, cone=40, distance=3, inverted=True),
    "flipped": Display.from_looking_glass(GLASS | {"flipImageX": 1, "flipSubp": 1}, views=12),
    "upside down": Display.from_looking_glass(GLASS | {"flipImageY": 1, "invView": 0}, views=12),
    "cells": Display.from_looking_glass(
        GLASS | {"subpixelCells": CELLS, "CellPatternMode": 1}, views=12),
    "staggered cells": Display.from_looking_glass(
        GLASS | {"subpixelCells": CELLS, "CellPatternMode": 3}, views=12),
}


def geometry(display):
    """Eye and place of every sub-pixel by the display's own description, float64 [H, W, 3]."""
    rows, columns = np.ogrid[:display.height, :display.width]
    view = np.stack([display.view_of(rows, columns, k) for k in range(3)], -1)
    first, last = display.eyes()[[0, -1]]
    eye = np.clip(display.eye_reach * (2 * view / display.views - 1), first, last)
    place = display.places()[rows % 4, columns % 2, :, 0]
    x = display.aspect * (2 * (columns[..., None] + place) / display.width - 1)
    return eye, x


@pytest.mark.parametrize("name", PANELS)
def test_the_kernels_take_eyes_and_places_from_the_display(name):
    display = PANELS[name]
    config = EncodeConfig(blend="continuous")
    panel = _panel(display, config, Placement.of(display, config))
    eye, x = geometry(display)
    eyes = display.eyes()
    got = np.array([[(eye_of(place, y, eyes, panel), side_of(place, y, 180, panel))
                     for place in range(180)] for y in range(40)]).reshape(40, 60, 3, 2)
    assert np.abs(got[..., 0] - eye).max() < 1e-9
    assert np.abs(got[..., 1] - x).max() < 1e-12


# Kernels for nine coefficients take seconds to compile; rays are the same as with one.
BASES = pytest.mark.parametrize("basis", [1, pytest.param(9, marks=pytest.mark.slow)])


@BASES
@pytest.mark.parametrize("name", PANELS)
def test_continuous_coding_casts_the_display_s_rays(name, basis):
    field = shell_field(size=20, density=40.0, basis=basis)
    display = PANELS[name]
    mask = ViewMask.build(display, cache=False)
    config = EncodeConfig(blend="continuous", background=0.2, method="direct")
    direct = encode(field, display, config, mask=mask)
    placement = Placement.of(display, config)
    eye, x = geometry(display)
    random = np.random.default_rng(0)
    for row, column, k in zip(random.integers(0, 40, 40), random.integers(10, 50, 40),
                              random.integers(0, 3, 40)):
        start = np.array([eye[row, column, k], display.eye_height, display.distance])
        end = np.array([x[row, column, k], 1 - 2 * (row + 0.5) / 40, 0.0])
        color, through, _, _ = cast(field, (start - placement.shift) / placement.scale, end - start)
        channel = display.channel(k)
        wanted = np.clip(color[channel] + 0.2 * through, 0, 1) * 255
        assert abs(float(direct[row, column, channel]) - wanted) <= 0.6


@BASES
@pytest.mark.parametrize("name", PANELS)
def test_both_methods_agree_between_the_views(name, basis):
    """Thin, so that the methods' steps matter little; colors turn with the place, and the view."""
    field = shell_field(size=32, density=60.0, basis=basis)
    field.density[:] = 8.0
    points = field.lattice_points()
    sh = np.zeros((len(points), 3, basis))
    sh[..., 0] = 1.2 * np.sin(9 * points)
    sh[..., 3:4] = 0.8
    field = field.with_sh(sh)
    display = PANELS[name]

    def coded(panel, method):
        return encode(field, panel, EncodeConfig(blend="continuous", method=method),
                      mask=ViewMask.build(panel, cache=False)) / 255.0

    direct = coded(display, "direct")
    assert psnr(coded(display, "slices"), direct) > 41
    # One sub-pixel to the side already shows.
    wrong = dataclasses.replace(display, offset=display.offset + 1)
    assert psnr(coded(wrong, "slices"), direct) < 28
