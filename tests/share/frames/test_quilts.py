"""Quilts as files: what other readers find in them, and which view lies where."""

import json
import warnings
import zipfile
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.lightfield import Display, QuiltLayout, layout_of_file
from lfportrait.share import FrameConfig, export_field, export_of, write_quilt
from lfportrait.share.frames import export
from lfportrait.share.frames.files import QuiltName, check_picture
from lfportrait.share.frames.quilts import QuiltPlan
from tests.share.frames.fields import ball_x, marked_field

SMALL = FrameConfig(pixels=(96, 96))


def tiles_of(picture, columns, rows):
    """Tiles by their place alone: rows from the bottom, then from the left."""
    height, width = picture.shape[0] // rows, picture.shape[1] // columns
    return [picture[picture.shape[0] - (row + 1) * height:picture.shape[0] - row * height,
                    column * width:(column + 1) * width]
            for row in range(rows) for column in range(columns)]


def read(path):
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))


def user_comment(path):
    """The older block as a program would find it that knows nothing of ours."""
    with Image.open(path) as picture:
        text = picture.getexif().get_ifd(0x8769)[0x9286]
    text = text.encode() if isinstance(text, str) else text
    return json.loads(text.removeprefix(b"ASCII\0\0\0"))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp"])
def test_other_readers_find_layout_and_views(tmp_path, suffix):
    path = tmp_path / f"anna_qs4x3a0.75{suffix}"
    figures = export_field(marked_field(), path, FrameConfig(pixels=(240, 240)))
    assert figures["views"] == 12 and figures["size"] == (240, 240)
    assert {item.name for item in tmp_path.iterdir()} == {path.name, f"{path.name}.json"}
    with Image.open(path) as picture:
        assert picture.format == {".png": "PNG", ".jpg": "JPEG", ".webp": "WEBP"}[suffix]
    # From the left to the right view, a ball before the panel moves from the right to the left.
    places = [ball_x(tile) for tile in tiles_of(read(path), 4, 3)]
    assert all(later < earlier for earlier, later in pairwise(places))
    assert places[0] > 0 > places[-1]
    side = json.loads((tmp_path / f"{path.name}.json").read_text())
    assert side["mediaType"] == "quilt" and side["movie"] is False
    assert side["quilt_settings"] == {"viewX": 4, "viewY": 3, "viewTotal": 12,
                                      "invertViews": False, "aspect": 0.75}
    assert user_comment(path) == {"LKGNumViews": 12, "LKGRows": 3, "LKGColumns": 4,
                                  "LKGAspect": 0.75, "LKGType": "quilt"}


def test_a_layout_is_found_in_the_name_the_side_file_or_the_exif(tmp_path):
    layout = QuiltLayout(3, 2, 0.75)
    for name in ("a_qs3x2a0.75.png", "b.png", "c.webp"):
        write_quilt(tmp_path / name, np.zeros((20, 30, 3), np.uint8), layout)
        assert layout_of_file(tmp_path / name) == layout
        (tmp_path / f"{name}.json").unlink()
        assert layout_of_file(tmp_path / name) == layout  # c: of the EXIF
    (tmp_path / "b.png.json").write_text("{")
    with pytest.warns(UserWarning, match="b.png.json beside b.png is left out"):
        assert layout_of_file(tmp_path / "b.png") == layout
    Image.new("RGB", (8, 8)).save(tmp_path / "d.png")
    assert layout_of_file(tmp_path / "d.png") is None


def test_a_video_that_is_renamed_keeps_its_layout(tmp_path):
    path = tmp_path / "x_qs3x2a0.75.mp4"
    export_field(marked_field(16), path, FrameConfig(pixels=(96, 96), frames=1))
    assert layout_of_file(path.rename(tmp_path / "y.mp4")) == QuiltLayout(3, 2, 0.75)


def test_a_quilt_shows_the_displays_window_whatever_its_tiles_are(tmp_path):
    """Tiles may be squeezed: the ball stays in the middle of a view from the middle."""
    path = tmp_path / "x_qs3x1a0.5625.png"
    export_field(marked_field(), path, FrameConfig(pixels=(240, 60)))
    middle = tiles_of(read(path), 3, 1)[1]
    assert abs(ball_x(middle)) < 0.02


@pytest.mark.parametrize(("name", "display", "layout"), [
    ("x_qs8x6a0.75.png", "lookingglass-portrait", (8, 6)),
    ("x_qs11x6a0.5625.png", "lookingglass-go", (11, 6)),
    ("x_qs12x9a0.75.png", "lookingglass-portrait", (12, 9)),
    ("x_qs.png", "lookingglass-portrait", (8, 6)),
    ("x_qs8x13.jpg", "lookingglass-portrait", (8, 13))])
def test_the_name_chooses_display_and_layout(name, display, layout):
    plan = QuiltPlan.of(name, FrameConfig())
    assert plan.display.name == Display.preset(display).name
    assert (plan.layout.columns, plan.layout.rows) == layout
    assert plan.size[0] >= 300 * layout[0] and max(plan.size) <= 8192
    assert str(QuiltName.completed(Path(name), plan.layout)) == (
        f"x{plan.layout.suffix()}{Path(name).suffix}")


def test_names_with_zoom_and_focus_are_left_as_they_are(tmp_path):
    path = tmp_path / "x_qs2x2a0.75z1.2f0.0.png"
    assert export_field(marked_field(), path, SMALL)["out"] == path
    assert QuiltName.of(path.name) == QuiltName(2, 2, 0.75)


def test_large_layouts_stay_within_what_graphics_cards_take():
    plan = QuiltPlan.of("x_qs12x9.png", FrameConfig(display="lookingglass-32"))
    assert max(plan.size) <= 8192 and plan.size[0] % 12 == plan.size[1] % 9 == 0


@pytest.mark.parametrize(("name", "words", "complaint"), [
    ("x.png", [], "can't tell what"), ("x_qs60x60a1.png", [], "2 to 108 views"),
    ("x_qs1x1a0.75.png", [], "2 to 108 views"), ("x_qs8x6a0.9.png", [], "aspect 0.9"),
    ("x_qs8x6a0.75.png", ["--display", "generic-4k"], "have 1.778"),
    ("x_qs8x6a0.75.webp", ["--pixels", "16400", "64"], "at most 16383"),
    ("x_qs8x6a0.75.jpg", ["--pixels", "65532", "64"], "at most 65500"),
    ("x_qs8x6a0.75.png", ["--pixels", "60000", "60000"], "GiB"),
    ("x_qs8x6a0.75.png", ["--pixels", "5", "5"], "needs more than"),
    ("x_qs8x6a0.75.mp4", ["--codec", "h264", "--pixels", "5000", "5000"], "H.264 goes up to 4096"),
    ("x_qs8x6a0.75.webm", ["--codec", "hevc"], "holds VP9"), ("x.webm", [], "HEVC alone"),
    ("x_rgbd.mp4", [], "as a picture"), ("x_2x1.jpg", ["--eye-distance", "-3"], "--eye-distance"),
    ("x_2x1.jpg", ["--encode.focus", "9"], "--encode.focus"),
    ("x.mp4", ["--frames", "-1"], "--frames"), ("x.mp4", ["--sway", "200"], "--sway")])
def test_mistakes_are_told_in_one_line_and_nothing_is_written(tmp_path, capsys, name, words,
                                                              complaint):
    marked_field(16).save(tmp_path / "head.npz")
    assert main(["export", str(tmp_path / "head.npz"), "--out", str(tmp_path / name), *words]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if "lfportrait:" in line]
    assert len(lines) == 1 and complaint in lines[0]
    assert [item.name for item in tmp_path.iterdir()] == ["head.npz"]


def test_formats_take_what_they_can():
    check_picture(Path("a.webp"), 16383, 10)
    check_picture(Path("a.jpg"), 65500, 10)
    with pytest.raises(UserError, match="16383"):
        check_picture(Path("a.webp"), 10, 16384)
    assert export_of(Path("a_qs8x6a0.75.mp4")).kind == "quilt"
    assert export_of(Path("a.mp4")).kind == "flat"


def test_a_package_holds_the_quilt_and_its_settings(tmp_path):
    path = tmp_path / "anna & ben.hop"
    figures = export_field(marked_field(), path, FrameConfig(pixels=(160, 120)))
    assert figures["views"] == 48 and figures["bytes"] == path.stat().st_size
    with zipfile.ZipFile(path) as package:
        assert package.testzip() is None
        names = package.namelist()
        assert names == ["anna-ben_qs8x6a0.75.png", "anna-ben_qs8x6a0.75.png.json"]
        settings = json.loads(package.read(names[1]))
        package.extract(names[0], tmp_path)
    assert settings["quilt_settings"]["viewTotal"] == 48 and settings["movie"] is False
    places = [ball_x(tile) for tile in tiles_of(read(tmp_path / names[0]), 8, 6)]
    assert places[0] > 0 > places[-1]


def decoded(path):
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = [frame.reformat(format="rgb24", src_colorspace="ITU709").to_ndarray()
                  for frame in container.decode(video=0)]
        context = stream.codec_context
        return {"codec": context.name, "pixels": stream.pix_fmt, "tag": context.codec_tag,
                "matrix": int(context.colorspace), "rate": stream.average_rate}, frames


@pytest.mark.parametrize(("name", "codec"), [
    ("x_qs3x2a0.75.mp4", "h264"), ("x_qs3x2a0.75.webm", "vp9")])
def test_quilts_move(tmp_path, name, codec):
    config = FrameConfig(pixels=(180, 160), frames=4, sway=20)
    figures = export_field(marked_field(), tmp_path / name, config)
    assert figures["frames"] == 4 and figures["codec"] == codec
    facts, frames = decoded(tmp_path / name)
    assert facts["codec"] == codec and facts["pixels"] == "yuv420p" and len(frames) == 4
    side = json.loads((tmp_path / f"{name}.json").read_text())
    assert side["movie"] is True and side["quilt_settings"]["viewTotal"] == 6
    places = [[ball_x(tile) for tile in tiles_of(frame, 3, 2)] for frame in frames]
    assert all(row[0] > row[-1] for row in places)
    assert places[1][0] > places[0][0] > places[3][0]  # it sways to the right, then to the left


def test_a_package_may_hold_a_video(tmp_path):
    path = tmp_path / "x.hop"
    export_field(marked_field(), path, FrameConfig(pixels=(160, 120), frames=2))
    with zipfile.ZipFile(path) as package:
        movie, side = package.namelist()
        settings = json.loads(package.read(side))
        package.extract(movie, tmp_path)
    assert movie == "x_qs8x6a0.75.mp4" and settings["movie"] is True
    assert len(decoded(tmp_path / movie)[1]) == 2


def test_quilts_beyond_h264_are_hevc(tmp_path, monkeypatch):
    monkeypatch.setattr(export, "_LARGEST_H264", 100)
    path = tmp_path / "x_qs3x2a0.75.mp4"
    assert export_field(marked_field(), path, FrameConfig(pixels=(180, 160), frames=2))[
        "codec"] == "hevc"
    facts, frames = decoded(path)
    assert facts["codec"] == "hevc" and facts["tag"] == "hvc1" and facts["matrix"] == 1
    assert ball_x(tiles_of(frames[0], 3, 2)[0]) > 0


def test_without_hevc_vp9_takes_its_place(tmp_path, monkeypatch):
    monkeypatch.setattr(export, "_LARGEST_H264", 100)
    monkeypatch.setattr(export, "has_encoder", lambda codec: codec != "hevc")
    path = tmp_path / "x_qs3x2a0.75.mp4"
    config = FrameConfig(pixels=(180, 160), frames=1)
    with pytest.warns(UserWarning, match="can't code HEVC"):
        export_field(marked_field(), path, config)
    assert decoded(path)[0]["codec"] == "vp9"
    with warnings.catch_warnings(), pytest.raises(UserError, match="libx265 is missing"):
        warnings.simplefilter("error")
        export_field(marked_field(), tmp_path / "flat.mp4", config)
    assert not (tmp_path / "flat.mp4").exists()


def test_encodes_quilt_has_its_layout_in_the_file_too(tmp_path):
    marked_field(16).save(tmp_path / "head.npz")
    Display(96, 64, views=6, pitch=5.3, quilt=(3, 2), quilt_size=(96, 64)).save(
        tmp_path / "panel.toml")
    assert main(["encode", str(tmp_path / "head.npz"), "--display", str(tmp_path / "panel.toml"),
                 "--out", str(tmp_path / "coded.png"), "--quiet",
                 "--quilt", str(tmp_path / "x_qs3x2a1.5.webp")]) == 0
    assert user_comment(tmp_path / "x_qs3x2a1.5.webp")["LKGNumViews"] == 6
    assert (tmp_path / "x_qs3x2a1.5.webp.json").is_file()
