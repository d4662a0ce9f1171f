"""A page takes over the color of a painted ground."""

import dataclasses
import re

import numpy as np
import pytest

from lfportrait.field import Backdrop, head_points
from lfportrait.share import write_page
from tests.fields import head_field


def luma(color):
    values = [int(color[k:k + 2], 16) / 255 for k in (1, 3, 5)]
    return float(np.dot(values, [0.299, 0.587, 0.114]))


@pytest.mark.parametrize("color", [(30, 60, 50), (235, 220, 180), (128, 40, 20), (0, 0, 0)])
def test_the_pages_ground_has_its_hue_and_text_stays_legible(tmp_path, color):
    field = head_field(24)
    picture = np.full((8, 8, 3), color, np.uint8)
    drop = Backdrop(picture, 2.0, np.array([0.0, 0.5, 1.0]), head_points(field))
    write_page(dataclasses.replace(field, backdrop=drop), tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text("utf-8")
    light = np.dot(color, [0.299, 0.587, 0.114]) > 127
    assert f'data-ground="{"light" if light else "dark"}"' in page
    assert f'aria-label="Light ground" aria-pressed="{str(bool(light)).lower()}"' in page
    ground = re.findall(r"--ground: (#[0-9a-f]{6}); --glow", page)[-1]
    assert luma(ground) > 0.85 if light else luma(ground) < 0.2
    order = np.argsort([int(ground[k:k + 2], 16) for k in (1, 3, 5)], kind="stable")
    assert order.tolist() == np.argsort(color, kind="stable").tolist()


def test_without_one_it_is_as_ever(tmp_path):
    write_page(head_field(24), tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text("utf-8")
    assert 'data-ground="dark"' in page and page.count("--ground: #") == 2
