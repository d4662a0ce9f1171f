"""Panels, and the wizard: what an eye sees of a wrong panel leads to the right numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest

from lfportrait.lightfield import Display, pattern, simulate
from lfportrait.studio.displays import corrected

TRUE = Display(960, 540, views=48, pitch=9.7, slant=math.radians(8), offset=3.1, cone=40,
               distance=4.0, name="true")


def seen(assumed, kind="slant", eye=0.0):
    """What an eye sees of a pattern that was coded with other numbers than the panel's."""
    return simulate(pattern(assumed, kind), TRUE, (eye,))


def bands(picture, axis):
    """Red bands along a line through the middle, and what is in the middle of the picture."""
    middle = picture.shape[1 - axis] // 2
    line = (picture[:, middle - 4:middle + 4].mean(1) if axis == 0
            else picture[middle - 4:middle + 4].mean(0))
    # Smoothed: a lens is several pixels wide.
    width = 15
    kernel = np.ones(width) / width
    red, blue = (np.convolve(line[:, channel], kernel, "same") for channel in (0, 2))
    sign = np.sign(np.where(np.abs(red - blue) > 0.15, red - blue, 0))
    sign = sign[sign != 0]
    return int((np.diff(sign) != 0).sum() + 1) / 2 if len(sign) else 0.0


def answer(assumed):
    """What an honest person says of the pattern."""
    picture = seen(assumed)
    across, down = bands(picture, 1), bands(picture, 0)
    if max(across, down) < 1:
        red, _, blue = picture.mean((0, 1))
        color = "white" if abs(red - blue) < 0.12 else "red" if red > blue else "blue"
        return {"lean": "none", "color": color}
    lean = "upright" if across >= down else "level"
    count = across if lean == "upright" else down
    return {"lean": lean, "bands": count}


# A number that is wrong by itself, and two at once.
@pytest.mark.parametrize("wrong", [
    {"slant": math.radians(7.2)}, {"pitch": 9.7 * 1.015, "offset": 0.0},
    *(pytest.param(wrong, marks=pytest.mark.slow) for wrong in (
        {"pitch": 9.7 * 1.02}, {"offset": 3.1 - 9.7 / 3}, {"pitch": 9.7 * 0.985},
        {"slant": math.radians(8.6)}, {"offset": 3.1 + 9.7 / 4}, {}))])
def test_answers_lead_to_the_panels_numbers(wrong):
    assumed, step, known = replace(TRUE, **wrong), "slant", {}
    for _ in range(10):
        if step != "slant":
            break
        assumed, step, _, known = corrected(assumed, step, answer(assumed), known)
    assert step == "views", "pitch, slant and offset are called right"
    # Less than one band is left over the panel, and the middle view is in the middle.
    assert abs(1 / assumed.pitch - 1 / TRUE.pitch) * 3 * TRUE.width < 1
    assert abs(assumed.shift - TRUE.shift) * TRUE.height / TRUE.pitch < 1
    for _ in range(4):
        if step != "views":
            break
        picture = pattern(assumed, "views")
        row, column = TRUE.height // 2, TRUE.width // 2
        # The view that the middle of the panel shows to the middle: known here from the numbers.
        spots = TRUE.view_of(row, np.arange(column - 30, column + 30)[:, None], np.arange(3))
        middle = np.abs(spots - TRUE.views / 2) < 0.5
        lit = assumed.view_of(row, np.arange(column - 30, column + 30)[:, None],
                              np.arange(3))[middle]
        assert picture.shape == (540, 960, 3)
        assumed, step, _, known = corrected(
            assumed, "views", {"lit": [int(v) for v in lit], "grows": True}, {})
    assert step == "fringe"
    spots = assumed.view_of(row, np.arange(column - 30, column + 30)[:, None],
                            np.arange(3))[middle]
    assert abs(np.median(spots) - TRUE.views / 2) < 2.0


def test_inverted_views_and_swapped_colors_are_put_right():
    found, step, _, _ = corrected(TRUE, "views", {"lit": [3], "grows": False}, {})
    assert found.inverted and step == "views"
    found, step, _, _ = corrected(TRUE, "fringe", {"edges": "colored"}, {})
    assert (found.subpixels, step) == ("BGR", "fringe")
    assert corrected(TRUE, "fringe", {"edges": "clean"}, {})[:2] == (TRUE, None)


def test_a_copy_that_was_not_changed_serves_again(page):
    order = {"copy": "generic-4k", "name": "Copy of generic-4k"}
    first = page.do("POST", "/api/displays", order)
    assert page.do("POST", "/api/displays", order)["id"] == first["id"]
    page.do("PATCH", f"/api/displays/{first['id']}", {"pitch": 5.5})
    other = page.do("POST", "/api/displays", order)
    assert other["id"] != first["id"] and other["pitch"] != 5.5


def test_panels_are_read_copied_changed_and_removed(page):
    names = [one["id"] for one in page.get("/api/displays")["displays"]]
    assert "generic-4k" in names
    made = page.do("POST", "/api/displays", {"copy": "generic-4k", "name": "Mine"})
    assert made["editable"] and made["kind"] == "file"
    path = f"/api/displays/{made['id']}"
    assert page.do("PATCH", path, {"pitch": 5.5, "views": 30})["views"] == 30
    assert Display.load(page.desk.displays.folder / "Mine.toml").pitch == 5.5
    for wrong in ({"pitch": 0}, {"views": 2.5}, {"subpixels": "GRB"}, {"slant": float("nan")},
                  {"pitch": True}):
        assert page.error("PATCH", path, wrong) == "bad_request", wrong
    assert page.error("PATCH", "/api/displays/generic-4k", {"pitch": 6}) == "exists"
    text = page.ask("GET", f"{path}/file")
    assert text.headers["content-disposition"].startswith("attachment")
    again = page.do("POST", "/api/displays", {"name": "Again", "text": text.text})
    assert again["pitch"] == 5.5 and again["hash"] == page.get(f"{path}/wizard")["display"]["hash"]
    assert page.error("POST", "/api/displays", {"text": "{}"}) == "user_error"
    assert page.error("POST", "/api/displays", {"text": "no display"}) == "user_error"
    assert page.error("POST", "/api/displays", {"copy": "../../etc/passwd"}) == "not_found"
    found = page.do("POST", f"{path}/wizard", {"step": "slant", "answer": {
        "lean": "upright", "bands": 2}})
    assert found["next"] == "slant" and found["display"]["pitch"] < 5.5
    back = page.do("POST", f"{path}/wizard", {"step": "slant", "answer": {
        "lean": "upright", "bands": 4}})
    assert back["display"]["pitch"] > 5.5, "there were more bands: the other way"
    page.do("DELETE", path)
    assert made["id"] not in [one["id"] for one in page.get("/api/displays")["displays"]]
    assert page.error("GET", f"{path}/wizard") == "not_found"
