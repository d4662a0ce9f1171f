"""A loop for messengers: where its cameras go, and what players make of its files."""

from dataclasses import replace

import av
import numpy as np
import pytest
from PIL import Image

from lfportrait.errors import UserError
from lfportrait.share import ExportContext, export_field, export_of
from lfportrait.share.kinds import LoopConfig
from lfportrait.share.video import loop_cameras
from tests.fields import head_field

SMALL = LoopConfig(size=32, frames=6, fps=20)


@pytest.fixture(scope="module")
def head():
    return head_field(24)


def angles(cameras):
    """Degrees to the head's left side and up, of each camera."""
    ahead = -cameras.pose[:, :3, 2]
    return (np.degrees(np.arctan2(ahead[:, 0], ahead[:, 2])), np.degrees(np.arcsin(ahead[:, 1])))


def test_the_camera_goes_around_an_ellipse_within_the_cone(head):
    yaw, pitch = angles(loop_cameras(LoopConfig(frames=8, sway=10, rise=3), head))
    assert np.allclose((yaw / 10) ** 2 + (pitch / 3) ** 2, 1, atol=1e-3)
    assert yaw[2] == pytest.approx(10) and yaw[6] == pytest.approx(-10)
    yaw, _ = angles(loop_cameras(LoopConfig(frames=8, sway=30), replace(head, cone=40.0)))
    assert yaw.max() == pytest.approx(20)


@pytest.mark.parametrize("name", ["a.gif", "a_loop.webp", "a_LOOP.gif"])
def test_a_picture_that_moves_forever(tmp_path, head, name):
    figures = export_field(head, tmp_path / name, SMALL, ExportContext())
    assert figures["kind"] == "loop" and figures["frames"] == 6
    with Image.open(tmp_path / name) as picture:
        assert picture.n_frames == 6 and picture.size == (32, 32) and picture.info["loop"] == 0
        frames = []
        for number in range(6):
            picture.seek(number)
            picture.load()
            assert picture.info["duration"] == 50
            frames.append(np.asarray(picture.convert("RGB"), int))
    # The head turns, and the last frame goes on to the first.
    apart = [np.abs(one - other).mean() for one, other in zip(frames, frames[1:] + frames[:1])]
    assert min(apart) > 0.1 and apart[-1] < 2 * np.median(apart)


def test_a_film(tmp_path, head):
    export_field(head, tmp_path / "a_loop.mp4", SMALL, ExportContext())
    with av.open(str(tmp_path / "a_loop.mp4")) as film:
        assert film.streams.video[0].frames == 6


def test_a_name_without_the_mark_is_of_another_kind(tmp_path):
    assert export_of(tmp_path / "a.mp4").name == "flat"
    assert export_of(tmp_path / "a_loop.mp4").name == "loop"
    with pytest.raises(UserError, match=r"can't tell .*_loop"):
        export_of(tmp_path / "a.webp")


def test_choices_that_make_no_sense_are_told():
    with pytest.raises(UserError, match=r"--loop.frames must be 2 to 600, not 1"):
        LoopConfig(frames=1)
