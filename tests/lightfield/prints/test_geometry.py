"""Paper, pitch and phase of prints: the numbers are exact, and nonsense is refused."""

import dataclasses
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.errors import UserError
from lfportrait.lightfield import Display
from lfportrait.lightfield.kernels.panel import eye_of
from lfportrait.lightfield.prints import PrintConfig, PrintSheet, paper_size


@pytest.mark.parametrize("text, wide, high", [
    ("8x10in", 203.2, 254), ("10 x 8 in", 254, 203.2), ("8inx10in", 203.2, 254),
    ("200x250mm", 200, 250), ("20x25.5cm", 200, 255), ("a4", 210, 297), ("A3", 297, 420),
    ("a3-landscape", 420, 297), ("a5-portrait", 148, 210), ('4×6"', 101.6, 152.4)])
def test_sizes_are_read(text, wide, high):
    assert paper_size(text) == pytest.approx((wide, high))


@pytest.mark.parametrize("text", ["", "8x10", "8in", "a7", "a4 landscape?", "-8x10in", "0x10in",
                                  "1x1mm", "9x9999mm", "nanxnanmm", "8x10furlongs", "infx8in"])
def test_other_sizes_are_refused(text):
    with pytest.raises(UserError, match=r"size|sides"):
        paper_size(text)


@pytest.mark.parametrize("changed, message", [
    ({"dpi": 100}, "at least 2"), ({"dpi": 1e9}, "dpi"), ({"dpi": math.nan}, "dpi"),
    ({"lpi": 0}, "lpi"), ({"lpi": -60}, "lpi"), ({"distance": -1}, "distance"),
    ({"distance": math.inf}, "distance"), ({"thickness": 100}, "thickness"),
    ({"angle": 180}, "angle"), ({"index": 1}, "index"), ({"bleed": -3}, "bleed"),
    ({"relief": 0}, "relief"), ({"background": 2}, "background"), ({"focus": math.nan}, "focus"),
    ({"size": "a0", "dpi": 5000}, "65536"), ({"thickness": 0.1}, "viewing angle")])
def test_nonsense_is_refused_on_one_line(changed, message):
    with pytest.raises(UserError, match=message) as error:
        PrintSheet.of(PrintConfig(**{"lpi": 60.12, **changed}))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("lpi, dpi", [(40, 600), (60.12, 720), (75, 1440)])
def test_the_pitch_is_that_of_the_sheet(lpi, dpi):
    sheet = PrintSheet.of(PrintConfig(lpi=lpi, dpi=dpi, size="4x5in", margin=0, bleed=0))
    display = sheet.display
    assert display.pitch == pytest.approx(3 * dpi / lpi, rel=1e-14)
    assert (display.width, display.height) == (4 * dpi, 5 * dpi)
    # The colors lie together; left and right are the other way round under a lens.
    assert np.ptp(display.steps()) == 0 and display.inverted and display.breadth == 3
    half = (display.width - 1) / 2
    columns = np.array([math.floor(half), math.ceil(half)])
    assert display.phase(0, columns, 0).mean() == pytest.approx(display.pitch / 2, abs=1e-9)


def exact_phase(config, width, column):
    """Phase of a pixel's middle in lenses from the left edge of its lens, as a fraction."""
    lens = Fraction(config.dpi) / Fraction(str(config.lpi))
    return ((Fraction(column) - Fraction(width - 1, 2)) / lens + Fraction(1, 2)) % 1


@pytest.mark.parametrize("lpi, dpi", [(40.15, 600), (60.12, 720), (75.33, 1440)])
def test_phase_is_exact_at_the_far_edge_of_a3(lpi, dpi):
    config = PrintConfig(lpi=lpi, dpi=dpi, size="a3-landscape")
    display = PrintSheet.of(config).display
    width, rows = display.width, display.height - 1
    panel = np.zeros(61)
    panel[9:13] = display.pitch, display.shift, display.offset, display.inverted
    eyes = display.eyes()
    for column in (0, 1, width // 3, width - 2, width - 1):
        exact = float(exact_phase(config, width, column))
        phase = 1 - display.phase(rows, column, 0) / display.pitch
        away = abs(phase % 1 - exact)
        assert min(away, 1 - away) < 1e-7
        # The kernel's eye, between the outermost of 256, of each color.
        for k in range(3):
            eye = eye_of(3 * column + k, rows, eyes, panel)
            share = 0.5 * (eye / display.eye_reach + 1)
            away = abs(1 - share - exact)
            assert min(away, 1 - away) < 0.01


@settings(max_examples=30, deadline=None)
@given(st.floats(-3, 3), st.floats(-20, 20), st.floats(30, 100), st.integers(300, 1440))
def test_phase_and_slant_move_the_lenses(phase, slant, lpi, dpi):
    config = PrintConfig(lpi=lpi, dpi=dpi, size="60x80mm", phase=phase, slant=slant)
    display = PrintSheet.of(config).display
    # Pixels around the middle: to the right by the phase, and by the slant.
    def share(row, column):
        return 1 - display.phase(row, column, 0) / display.pitch

    raw = (display.width - 1) / 2, (display.height - 1) / 2
    column, row = int(raw[0]), int(raw[1])
    lens = dpi / lpi
    expected = (0.5 - phase + (column - raw[0]) / lens
                + (row - raw[1]) * math.tan(math.radians(slant)) / lens)
    away = (share(row, column) - expected) % 1
    assert min(away, 1 - away) < 1e-6


def test_slanted_lenses_lean_as_is_said():
    display = PrintSheet.of(PrintConfig(lpi=40, dpi=600, size="60x80mm", slant=10)).display
    row, column = display.height // 2, display.width // 2
    # The same place under the same lens, 100 rows further up: to the right.
    moved = round(100 * math.tan(math.radians(10)))
    away = (display.phase(row - 100, column + moved, 0) - display.phase(row, column, 0))
    assert abs(away) < 2


def test_the_viewing_distance_changes_the_pitch_by_the_sheets_thickness():
    near = PrintConfig(lpi=60.12, distance=300, judged_at=2000, thickness=0.8)
    sheet = PrintSheet.of(near)
    # Ink under lenses p apart is seen by an eye at D if it is p (1 + t / (n D)) apart.
    grown = (1 + 0.8 / 1.56 / 300) / (1 + 0.8 / 1.56 / 2000)
    assert sheet.display.pitch == pytest.approx(3 * 720 / 60.12 * grown, rel=1e-12)
    same = dataclasses.replace(near, judged_at=300.0)
    assert PrintSheet.of(same).display.pitch == pytest.approx(3 * 720 / 60.12, rel=1e-12)


def test_angle_and_thickness_follow_from_each_other():
    by_angle = PrintSheet.of(PrintConfig(lpi=75, angle=49))
    by_thickness = PrintSheet.of(PrintConfig(lpi=75, thickness=by_angle.thickness))
    assert by_thickness.display.cone == pytest.approx(49, abs=1e-6)
    # The angle that is published for 75 lpi, 0.457 mm, n 1.557 from its ray trace: 64.6 degrees.
    published = PrintSheet.of(PrintConfig(lpi=75.4, thickness=0.457, index=1.557))
    assert published.display.cone == pytest.approx(64.6, abs=1.0)


def test_the_depth_budget_is_2_n_t_over_n():
    sheet = PrintSheet.of(PrintConfig(lpi=60, dpi=720, thickness=0.6, index=1.5))
    assert sheet.depth_budget == pytest.approx(2 * 12 * 0.6 / 1.5)
    # It is where a point moves by one lens from one direction to the next.
    step = 2 * sheet.distance * math.tan(math.radians(sheet.display.cone / 2)) / 12
    moved = step * (sheet.depth_budget / 2) / sheet.distance
    assert moved == pytest.approx(25.4 / 60, rel=0.15)


def test_borders_lie_around_the_picture():
    sheet = PrintSheet.of(PrintConfig(lpi=60, dpi=254, size="100x150mm", bleed=5, margin=10))
    assert (sheet.display.width, sheet.display.height) == (1300, 1800)
    assert (sheet.picture.left, sheet.picture.width) == (100, 1100)
    assert (sheet.trim.left, sheet.trim.width, sheet.trim.height) == (150, 1000, 1500)
    assert sheet.half_height == pytest.approx(90)


def test_a_page_is_a_display_that_files_hold():
    display = PrintSheet.of(PrintConfig(lpi=60.12)).display
    assert isinstance(display, Display) and display.panel_height > 0
    assert display.summary() and "cells" in display.to_toml()
