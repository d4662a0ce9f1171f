"""Regions painted over by the brush: what is written, undone, erased, and painted by keys."""

import io

import numpy as np
import pytest
from PIL import Image

pytestmark = [pytest.mark.data, pytest.mark.slow]  # in a browser


@pytest.fixture
def brush(opened, shared_weights):
    own = next(style["id"] for style in opened.ask("GET", "/api/styles?project=ben")["styles"]
               if style["kind"] == "project")
    opened.path = f"/api/styles/{own}/regions?project=ben"
    opened.ask("DELETE", opened.path)
    opened.go(f"style/ben/{own}/regions")
    opened.page.wait_for_selector(".brush", timeout=120000)
    return opened


def written(brush):
    """The labels that the server has, uint8 [H, W]."""
    brush.page.wait_for_selector("header [role=status]:text('Saved')")
    about = brush.ask("GET", brush.path)
    if about["picture"] is None:
        return np.zeros((about["height"], about["width"]), np.uint8)
    data = brush.run("""async (path) => [...new Uint8Array(
      await (await fetch(path)).arrayBuffer())]""", about["picture"])
    return np.asarray(Image.open(io.BytesIO(bytes(data))).convert("L"))


def stroke(brush, by=(60, 0)):
    box = brush.page.locator(".viewport").bounding_box()
    start = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
    mouse = brush.page.mouse
    mouse.move(*start)
    mouse.down()
    mouse.move(*(start + by), steps=4)
    mouse.up()


def test_a_stroke_is_written_undone_and_erased(brush):
    brush.page.click(".kind:has-text('Hat')")
    stroke(brush)
    brush.eventually(lambda: written(brush).any())
    labels = written(brush)
    assert set(np.unique(labels)) == {0, 2}
    rows, columns = np.nonzero(labels)
    assert np.ptp(columns) > 1.3 * np.ptp(rows)  # as long as it was drawn, as wide as the brush
    brush.page.keyboard.press("Control+z")
    brush.eventually(lambda: not written(brush).any())
    brush.page.keyboard.press("Control+Shift+z")
    brush.eventually(lambda: np.array_equal(written(brush), labels))
    brush.page.click(".kind:has-text('Eraser')")
    stroke(brush)
    brush.eventually(lambda: not written(brush).any())


def test_keys_paint_too(brush):
    brush.page.locator(".brush").focus()
    for key in ("3", "]", "ArrowRight", "Space"):
        brush.page.keyboard.press(key)
    brush.eventually(lambda: written(brush).any())
    labels = written(brush)
    assert set(np.unique(labels)) == {0, 3}
    rows, columns = np.nonzero(labels)
    assert abs(np.ptp(columns) - np.ptp(rows)) <= 1  # one dab, round
    assert columns.mean() > labels.shape[1] / 2
