"""Any renderer's views are coded as the field's own rays are."""

from dataclasses import replace

import numpy as np
import pytest

from lfportrait.capture import Camera
from lfportrait.errors import UserError
from lfportrait.field import Rendering
from lfportrait.lightfield import Display, EncodeConfig, encode, encode_views
from lfportrait.metrics import psnr
from tests.fields import shell_field

PANEL = Display(192, 128, views=24, pitch=7.3, slant=0.17, cone=40, name="panel")
CONFIG = EncodeConfig(background=0.2, ground="black", turn=20, focus=0.1)


class Flat:
    """A wall in the plane z = 0, its color its place; keeps the cameras that it is asked for."""

    def __init__(self):
        self.cameras: list[Camera] = []

    def render(self, cameras, view=0, *, background=1.0):
        self.cameras.append(cameras)
        shape = int(cameras.height[view]), int(cameras.width[view])
        origins, directions = cameras.rays(view)
        places = origins - directions * (origins[:, 2:] / directions[:, 2:])
        color = np.float32(np.clip(0.5 + 0.2 * places, 0, 1)).reshape(*shape, 3)
        return Rendering(color, np.ones(shape, np.float32), np.ones(shape, np.float32))


def test_a_field_s_own_views_give_nearly_what_its_rays_give():
    field = shell_field(basis=1)
    colors = np.sin(3 * field.lattice_points())[:, :, None]  # even ones: views are interpolated
    field = field.with_sh(colors)
    direct = encode(field, PANEL, CONFIG) / 255
    by_views = encode_views(field, PANEL, CONFIG, height=128) / 255
    assert psnr(np.float32(by_views), np.float32(direct)) > 26


def test_what_lies_in_the_panel_s_plane_is_the_same_to_all_eyes():
    """There no view moves against another, so that the coded picture is the scene itself."""
    scene = Flat()
    coded = encode_views(scene, PANEL, EncodeConfig(shift_y=0)) / 255
    x = PANEL.aspect * (2 * (np.arange(PANEL.width) + 0.5) / PANEL.width - 1) / 0.8
    assert np.abs(coded[..., 0] - np.clip(0.5 + 0.2 * x, 0, 1)).max() < 0.02
    assert np.abs(coded[..., 2] - 0.5).max() < 0.01
    assert len(scene.cameras) == PANEL.views


def test_views_have_the_pixels_that_an_eye_sees_unless_others_are_asked_for():
    scene = Flat()
    encode_views(scene, PANEL)
    encode_views(scene, PANEL, height=50)
    first, last = scene.cameras[0], scene.cameras[-1]
    assert int(first.height[0]) == round(128 / (7.3 / 3) ** 0.5)
    assert (int(last.width[0]), int(last.height[0])) == (75, 50)


def test_what_can_not_be_coded_is_one_line():
    with pytest.raises(UserError, match="composed about a field's head"):
        encode_views(Flat(), PANEL, EncodeConfig(compose=True))

    class Wrong(Flat):
        def render(self, cameras, view=0, *, background=1.0):
            found = super().render(cameras, view)
            return replace(found, color=found.color[1:])

    with pytest.raises(UserError, match=r"\[49, 75, 3\] for a camera of 75 x 50 pixels"):
        encode_views(Wrong(), PANEL, height=50)
