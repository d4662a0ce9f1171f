"""The painted ground in pictures for two eyes and in flat videos: its parallax and its depth."""

import dataclasses

import numpy as np
import pytest

from lfportrait.lightfield import EncodeConfig, ground_of
from lfportrait.metrics import psnr
from lfportrait.share import ExportContext, FrameConfig, export_field
from lfportrait.share.frames.export import Flat, Margins, TwoEyes, anaglyph_of, framed
from tests.fields import head_field
from tests.lightfield.test_ground import analytic, checkered
from tests.share.frames.test_eyes import read
from tests.share.frames.test_quilts import decoded

PLAIN = EncodeConfig(shadow=0.0)
SIZE = 150, 200
CONFIG = FrameConfig(pixels=SIZE)


@pytest.fixture(scope="module")
def field():
    return checkered(head_field(32))


@pytest.fixture(scope="module")
def seen(field):
    """The eyes, the placement, and for both: what is free of the head, and the ground there."""
    eyes = TwoEyes.of(CONFIG)
    ends = -eyes.baseline / 2, eyes.baseline / 2
    place = framed(field, eyes.window, PLAIN, Margins(), eyes=ends)
    sharp = dataclasses.replace(place, ground_blur=0.0)
    free = [eyes.look(field, place, eye).alpha < 1e-3 for eye in (-1.0, 1.0)]
    return eyes, place, [(empty, analytic(field, eyes.window, sharp, end, *SIZE))
                         for empty, end in zip(free, ends)]


def test_each_eye_sees_it_with_the_parallax_of_its_depth(field, seen, tmp_path):
    eyes, place, both = seen
    figures = export_field(field, tmp_path / "x_2x1.png", CONFIG, ExportContext(PLAIN))
    pair = read(tmp_path / "x_2x1.png")
    for picture, (free, ground) in zip((pair[:, :SIZE[0]], pair[:, SIZE[0]:]), both):
        assert 0.2 < free.mean() < 0.8
        assert psnr(picture[free] / 255.0, ground[free]) > 38
    free = both[0][0] & both[1][0]
    assert psnr(pair[:, :SIZE[0]][free] / 255.0, both[1][1][free]) < 25  # not the other eye's
    # The farthest that they see is the ground.
    share = ground_of(field, eyes.window, place).depth / eyes.window.distance
    shift = -eyes.baseline * share / (1 + share) / (2 * eyes.window.aspect)
    assert figures["parallax_percent"][0] == pytest.approx(100 * shift, abs=0.02)


def test_an_anaglyph_has_it_too(field, seen, tmp_path):
    eyes, place, _ = seen
    export_field(field, tmp_path / "x_anaglyph.png", CONFIG, ExportContext(PLAIN))
    left, right, _ = eyes.both(field, place)
    assert left[:8].mean() > 60  # the head does not reach there
    assert np.array_equal(read(tmp_path / "x_anaglyph.png"), anaglyph_of(left, right))


def test_beside_the_color_it_is_the_farthest(field, tmp_path):
    figures = export_field(field, tmp_path / "x_rgbd.png", CONFIG, ExportContext(PLAIN))
    picture = read(tmp_path / "x_rgbd.png")
    color, depth = picture[:, :SIZE[0]], picture[:, SIZE[0]:, 0]
    assert figures["covered"] == 1 and depth.max() == 255
    eyes = TwoEyes.of(CONFIG)
    place = framed(field, eyes.window, PLAIN, Margins(), eyes=(-eyes.baseline / 2,
                                                               eyes.baseline / 2))
    alpha = eyes.look(field, place, 0.0).alpha
    assert (depth[alpha < 1e-3] == 1).all() and depth[alpha > 0.99].min() > 40
    ground = analytic(field, eyes.window, dataclasses.replace(place, ground_blur=0.0), 0.0, *SIZE)
    assert psnr(color[alpha < 1e-3] / 255.0, ground[alpha < 1e-3]) > 38


def test_a_flat_video_shows_it_still_behind_the_head_that_turns(field, tmp_path):
    config = FrameConfig(pixels=(108, 192), frames=4, sway=20)
    export_field(field, tmp_path / "flat.mp4", config, ExportContext(PLAIN))
    frames = decoded(tmp_path / "flat.mp4")[1]
    flat = Flat.of(field, PLAIN, config)
    ground = analytic(field, flat.window, dataclasses.replace(flat.encode, ground_blur=0.0), 0.0,
                      108, 192)
    for frame in frames:
        assert psnr(frame[:14] / 255.0, ground[:14]) > 30  # above the head
    assert np.abs(frames[1].astype(int) - frames[3]).max() > 60  # it turns


@pytest.mark.parametrize("grey", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("name", ["x_2x1.png", "x_rgbd.png", "x_anaglyph.png"])
def test_who_asks_for_a_grey_level_gets_it(field, tmp_path, name, grey):
    export_field(field, tmp_path / name, FrameConfig(pixels=(60, 80), backdrop=grey),
                 ExportContext(PLAIN))
    assert np.abs(read(tmp_path / name)[0, 0] - 255.0 * grey).max() <= 1.5


def test_flat_videos_are_white_where_that_is_asked_for(field):
    white = FrameConfig(pixels=(54, 96), backdrop=1.0)
    encode = dataclasses.replace(PLAIN, background=1.0)
    flat = Flat.of(field, encode, white)
    assert flat.picture(field, flat.encode)[0, 0].min() > 250
