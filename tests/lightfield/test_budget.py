"""The depth budget: against the disparity of points, and as ``display show`` tells it."""

import dataclasses
import json
import math
import tomllib

import numpy as np
import pytest

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.lightfield import DepthReport, Display, EncodeConfig

PANEL = Display(1536, 2048, 48, pitch=18.9, slant=0.14, cone=40, distance=4, panel_height=0.16)


def moves_in_lenses(display, z):
    """How far a point at depth z moves between neighbouring views, by projecting it."""
    eyes = display.eyes()[:2]
    places = eyes + (0.0 - eyes) * display.distance / (display.distance - z)
    return abs(np.diff(places)[0]) / (2 * display.aspect * display.pitch / (3 * display.width))


def test_at_its_limits_a_point_moves_by_one_lens():
    report = DepthReport.of(PANEL)
    assert report.back < 0 < report.front
    assert math.isclose(moves_in_lenses(PANEL, report.front), 1, rel_tol=1e-9)
    assert math.isclose(moves_in_lenses(PANEL, report.back), 1, rel_tol=1e-9)
    assert math.isclose(moves_in_lenses(PANEL, report.head_front), report.front_blur, rel_tol=1e-9)
    assert math.isclose(moves_in_lenses(PANEL, report.head_back), report.back_blur, rel_tol=1e-9)


# One focus is measured as the others.
@pytest.mark.parametrize("focus", [
    0.7, *(pytest.param(focus, marks=pytest.mark.slow) for focus in (-0.4, 0.0))])
def test_the_percentage_counts_the_sharp_part_of_the_head(focus):
    config = EncodeConfig(size=0.8, focus=focus)
    report = DepthReport.of(PANEL, config)
    depths = np.linspace(report.head_back, report.head_front, 20001)
    sharp = np.mean([moves_in_lenses(PANEL, z) <= 1 for z in depths])
    assert abs(report.sharp_percent - 100 * sharp) < 0.1


def test_no_focus_beats_the_best_one_and_a_head_of_the_sharp_size_is_sharp():
    report = DepthReport.of(PANEL)
    best = DepthReport.of(PANEL, EncodeConfig(focus=report.best_focus)).sharp_percent
    assert best >= max(DepthReport.of(PANEL, EncodeConfig(focus=focus)).sharp_percent
                       for focus in np.linspace(-1, 1, 81)) - 1e-9
    small = DepthReport.of(PANEL, EncodeConfig(size=report.sharp_size, focus=report.best_focus))
    assert small.sharp_percent > 99.9
    assert small.lines()[-1] == "blurs: nothing"


def test_many_views_make_the_budget_deep():
    dense = dataclasses.replace(PANEL, views=1000, cone=2)
    report = DepthReport.of(dense)
    assert report.back == -math.inf
    assert "any depth behind" in report.lines()[0]
    assert "back" not in report.figures()


def test_without_the_panels_size_depths_are_in_its_heights():
    report = DepthReport.of(dataclasses.replace(PANEL, panel_height=0.0))
    assert "half panel heights" in report.lines()[0]
    assert "front_mm" not in report.figures()


def test_display_show_prints_a_display_file_with_the_budget(tmp_path, capsys):
    assert main(["display", "show", "lookingglass-portrait", "--focus", "0.1", "--json",
                 str(tmp_path / "run.json")]) == 0
    text = capsys.readouterr().out
    # What is printed is a display file to start from.
    assert tomllib.loads(text)["width"] == 1536
    figures = json.loads((tmp_path / "run.json").read_text())["depth"]
    assert f"{figures['sharp_percent']:.0f} % of its depth is sharp" in text
    assert f"{figures['front_mm']:.1f} mm in front" in text
    assert "focus 0.1" in text
    with pytest.raises(UserError, match="size"):
        DepthReport.of(PANEL, EncodeConfig(size=0))
