"""Pictures for two eyes, and flat videos: where near and far lie in them."""

import numpy as np
import pytest
from PIL import Image

from lfportrait.errors import UserError
from lfportrait.field import VoxelField
from lfportrait.lightfield import EncodeConfig
from lfportrait.share import ExportContext, FrameConfig, export_field
from lfportrait.share.frames.export import FLAT, Flat, anaglyph_of
from tests.fields import head_field
from tests.share.frames.fields import ball_x, marked_field
from tests.share.frames.test_quilts import decoded

SMALL = FrameConfig(pixels=(150, 200))


def read(path):
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))


def test_a_pair_has_the_left_eye_on_the_left(tmp_path):
    path = tmp_path / "x_2x1.jpg"
    figures = export_field(marked_field(), path, SMALL)
    picture = read(path)
    assert picture.shape == (200, 300, 3)
    left, right = ball_x(picture[:, :150]), ball_x(picture[:, 150:])
    assert left > 0 > right  # crossed: the ball is before the picture
    far, near = figures["parallax_percent"]
    # The wall, at the head's middle, lies in the picture's plane.
    assert 100 * (left - right) == pytest.approx(near, rel=0.2) and abs(far) < 1


def test_the_angle_between_the_eyes_is_what_is_asked_for(tmp_path):
    def apart(**options):
        path = tmp_path / "x_2x1.png"
        export_field(marked_field(), path, FrameConfig(pixels=(450, 600), **options))
        picture = read(path)
        return ball_x(picture[:, :450]) - ball_x(picture[:, 450:])

    usual = apart()
    assert apart(eye_distance=31.5) == pytest.approx(usual / 2, rel=0.1)
    assert apart(view_distance=1100.0) == pytest.approx(usual / 2, rel=0.1)
    assert apart(eye_distance=0.0) == 0


def test_a_displays_size_sets_the_eyes_apart(tmp_path):
    near = export_field(marked_field(), tmp_path / "a_2x1.png", FrameConfig(
        pixels=(90, 160), display="lookingglass-go"))["parallax_percent"][1]
    far = export_field(marked_field(), tmp_path / "b_2x1.png", FrameConfig(
        pixels=(90, 160), display="lookingglass-32-portrait"))["parallax_percent"][1]
    assert near > 2 * far  # the same eyes before a screen several times as large


def test_an_anaglyph_keeps_white_and_parts_the_eyes():
    grey = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    assert np.abs(anaglyph_of(grey, grey).astype(int) - grey).max() <= 1
    white, black = np.full((4, 4, 3), 255, np.uint8), np.zeros((4, 4, 3), np.uint8)
    red, cyan = anaglyph_of(white, black)[0, 0], anaglyph_of(black, white)[0, 0]
    assert red[0] > 200 and red[1:].max() < 60
    assert cyan[0] < 60 and cyan[1:].min() > 200


def test_an_anaglyph_shows_each_eye_its_own(tmp_path):
    white = marked_field()
    white = VoxelField(white.links, white.density, np.full_like(white.sh, 1.2))
    path = tmp_path / "x_anaglyph.png"
    export_field(white, path, SMALL, ExportContext(EncodeConfig(focus=-1.0)))
    picture = read(path).astype(int)
    columns = np.nonzero(picture.max(axis=(0, 2)) > 128)[0]
    # All of it behind the picture: what the left eye sees lies further left.
    middle = picture[picture.shape[0] // 2]
    assert middle[columns[0] + 1, 0] > 150 > middle[columns[0] + 1, 2]
    assert middle[columns[-1] - 1, 2] > 150 > middle[columns[-1] - 1, 0]


def test_depth_is_right_of_the_color_and_white_near(tmp_path):
    path = tmp_path / "x_rgbd.png"
    export_field(marked_field(), path, SMALL)
    picture = read(path)
    color, depth = picture[:, :150].astype(int), picture[:, 150:]
    assert depth.shape == color.shape and (depth == depth[..., :1]).all()
    depth = depth[..., 0]
    ball = (color[..., 0] > 128) & (color[..., 2] < 100)
    wall = (color[..., 2] > 128) & (color[..., 0] < 100)
    assert depth[ball].max() == 255 and np.median(depth[ball]) > 200
    assert 1 <= np.median(depth[wall]) < 60
    assert (depth[color.max(axis=-1) == 0] == 0).all()


def test_a_flat_video_is_what_the_panel_plays(tmp_path):
    """HEVC, BT.709, 4:2:0; the head inside the safe areas in all frames, on white."""
    path = tmp_path / "flat.mp4"
    figures = export_field(head_field(64), path, FrameConfig(pixels=(216, 384), frames=4, sway=30))
    assert figures["kind"] == "flat" and FLAT == (2160, 3840)
    facts, frames = decoded(path)
    assert (facts["codec"], facts["pixels"], facts["tag"], facts["matrix"]) == (
        "hevc", "yuv420p", "hvc1", 1)
    assert facts["rate"] == 30 and len(frames) == 4 and frames[0].shape == (384, 216, 3)
    free = []
    for frame in frames:
        assert frame[0, 0].min() > 250
        rows, columns = np.nonzero((frame < 230).any(axis=-1))
        free.append((rows.min(), 383 - rows.max(), columns.min(), 215 - columns.max()))
    top, bottom, left, right = np.min(free, axis=0)
    assert top >= 34 and bottom >= 9 and left >= 9 and right >= 9
    # As large as they allow, but for two of this field's large voxels: it meets two of them.
    assert bottom <= 22 and (top <= 47 or min(left, right) <= 22)


def test_a_flat_video_lies_on_its_side_for_the_panels_player(tmp_path):
    field = marked_field()
    upright = Flat.of(field, EncodeConfig(), FrameConfig(pixels=(90, 160)))
    lying = Flat.of(field, EncodeConfig(), FrameConfig(pixels=(90, 160), media_player=True))
    assert lying.size == (160, 90)
    frame = upright.picture(field, upright.encode)
    assert np.array_equal(lying.picture(field, lying.encode), np.rot90(frame))  # to the left


def test_pairs_move_too(tmp_path):
    path = tmp_path / "x_2x1.mp4"
    export_field(marked_field(), path, FrameConfig(pixels=(120, 160), frames=2))
    facts, frames = decoded(path)
    assert facts["codec"] == "h264" and frames[0].shape == (160, 240, 3)
    assert ball_x(frames[0][:, :120]) > 0 > ball_x(frames[0][:, 120:])


def test_the_head_fills_the_frame_but_no_more(tmp_path):
    path = tmp_path / "x_2x1.png"
    field = head_field(32)
    for encode in (EncodeConfig(), EncodeConfig(focus=-0.5), EncodeConfig(depth_scale=0.5)):
        export_field(field, path, SMALL, ExportContext(encode))
        picture = read(path)
        for eye in (picture[:, :150], picture[:, 150:]):
            rows, columns = np.nonzero(eye.max(axis=-1) > 30)
            free = rows.min(), 199 - rows.max(), columns.min(), 149 - columns.max()
            assert min(free) >= 4
            # One of the two directions is used up.
            assert max(free[:2]) < 30 or max(free[2:]) < 30
    with pytest.raises(UserError, match="does not fit"):
        export_field(field, path, SMALL, ExportContext(EncodeConfig(focus=5)))
