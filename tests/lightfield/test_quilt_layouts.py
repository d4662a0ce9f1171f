"""The layout of a quilt: one answer for all commands, wherever it is said."""

import dataclasses
import json
import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.files import write_image
from lfportrait.lightfield import (
    Display,
    QuiltHint,
    QuiltLayout,
    assemble_quilt,
    interlace,
    layout_for,
    layout_of_file,
)
from lfportrait.media.pictures import read_image
from lfportrait.share import write_quilt

PANEL = Display(90, 48, views=12, pitch=7.3, slant=math.radians(9), offset=2.1, cone=50, distance=3,
                quilt=(8, 6), quilt_size=(240, 96), name="small")
LAYOUT = QuiltLayout(11, 6, 1.875)
TILES = np.random.default_rng(0).integers(0, 256, (66, 16, 20, 3), dtype=np.uint8)
QUILT = assemble_quilt(TILES, LAYOUT)
BLOCK = json.dumps({"LKGRows": 6, "LKGColumns": 11, "LKGAspect": 1.875, "LKGType": "quilt"})


def plain(folder, name="anna.png"):
    """A quilt with nothing but its pixels."""
    write_image(folder / name, QUILT)
    return folder / name


def side(path, columns=11, rows=6, aspect=1.875):
    path.write_text(json.dumps({"quilt_settings": {"viewX": columns, "viewY": rows,
                                                   "aspect": aspect}}))


def inside(folder, name):
    """A quilt that says its layout only in its EXIF."""
    write_quilt(folder / name, QUILT, LAYOUT)
    Path(f"{folder / name}.json").unlink()
    return folder / name


def quietly(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return layout_of_file(path, **options)


# -- where it is said -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["anna.png", "anna.jpg", "anna.webp", "anna_qs11x6.png",
                                  "anna_qs.png"])
def test_a_renamed_quilt_is_known_by_its_exif(tmp_path, name):
    assert quietly(inside(tmp_path, name)) == LAYOUT


@pytest.mark.parametrize("beside", ["anna.png.json", "anna.json"])
def test_a_renamed_quilt_is_known_by_its_side_file(tmp_path, beside):
    path = plain(tmp_path)
    side(tmp_path / beside)
    assert quietly(path) == LAYOUT


def test_the_block_is_found_where_other_programs_put_it(tmp_path):
    picture = Image.fromarray(QUILT)
    text = PngImagePlugin.PngInfo()
    text.add_text("Comment", BLOCK)
    picture.save(tmp_path / "text.png", pnginfo=text)
    utf16 = Image.Exif()
    utf16.get_ifd(0x8769)[0x9286] = b"UNICODE\0" + BLOCK.encode("utf-16-be")
    picture.save(tmp_path / "utf16.jpg", exif=utf16)
    quoted = BLOCK.replace('"', "&quot;")
    xmp = f"<x:xmpmeta><exif:UserComment><rdf:li>{quoted}</rdf:li></exif:UserComment></x:xmpmeta>"
    picture.save(tmp_path / "xmp.webp", xmp=xmp.encode(), lossless=True)
    for name in ("text.png", "utf16.jpg", "xmp.webp"):
        assert quietly(tmp_path / name) == LAYOUT, name


@pytest.mark.parametrize(("name", "layout"), [
    ("A_QS11X6A1.875.PNG", LAYOUT), ("faqs_qs11x6a1.875.png", LAYOUT),
    ("a_qs11x6a1,875.png", LAYOUT), ("a_qs11x6a.5.png", QuiltLayout(11, 6, 0.5)),
    ("a_qs11x6a1.875z1.2f0.png", LAYOUT), ("a_qs11x6a1.875_qs11x6a1.875.png", LAYOUT),
    ("a_qs11x6_b_qs11x6a1.875.png", LAYOUT), ("a_qs11x6.png", None), ("a_qs.png", None),
    ("a_qsab.png", None)])
def test_names(name, layout):
    assert QuiltLayout.of_name(name) == layout


def test_a_name_without_an_aspect_has_the_panels():
    assert QuiltLayout.of_name("a_qs11x6.png", PANEL) == LAYOUT


def test_a_name_with_two_layouts_is_refused():
    with pytest.raises(UserError, match=r"two layouts \(qs4x3a1 and qs11x6a1.875\)"):
        QuiltLayout.of_name("a_qs4x3a1_qs11x6a1.875.png")


# -- which counts ---------------------------------------------------------------------------------


def test_the_order_is_option_name_side_file_exif_and_contradictions_are_told(tmp_path):
    path = inside(tmp_path, "a_qs4x3a1.875.png")
    with pytest.warns(UserWarning, match="by its name: 4 x 3 .* by its EXIF: 11 x 6") as told:
        assert layout_of_file(path) == QuiltLayout(4, 3, 1.875)
    assert len(told) == 1
    path = path.rename(tmp_path / "a.png")
    side(tmp_path / "a.png.json", 5, 9, 1.0)
    with pytest.warns(UserWarning, match="by a.png.json: 5 x 9"):
        assert layout_of_file(path) == QuiltLayout(5, 9, 1.0)
    asked = QuiltHint.of_options(2, 3, 0.0)
    with pytest.warns(UserWarning, match="by the options: 2 x 3"):
        # The aspect of another layout is not taken for it.
        assert layout_of_file(path, PANEL, asked=asked) == QuiltLayout(2, 3, PANEL.aspect)


def test_what_agrees_is_not_told(tmp_path):
    path = inside(tmp_path, "a_qs11x6a1.88.png")
    side(tmp_path / f"{path.name}.json")
    assert quietly(path) == QuiltLayout(11, 6, 1.88)
    assert quietly(path, asked=QuiltHint.of_options(11, 6, 0.0)) == QuiltLayout(11, 6, 1.88)


@pytest.mark.parametrize("text", ["{", "[]", '{"hello": 1}', '{"quilt_settings": null}',
                                  '{"quilt_settings": {"viewX": 0, "viewY": 6}}',
                                  '{"quilt_settings": {"viewX": Infinity, "viewY": 6}}'])
def test_a_broken_side_file_is_told_and_the_next_place_counts(tmp_path, text):
    path = inside(tmp_path, "anna.png")
    (tmp_path / "anna.json").write_text(text)  # may be somebody else's
    assert quietly(path) == LAYOUT
    (tmp_path / "anna.png.json").write_text(text)
    with pytest.warns(UserWarning, match="anna.png.json beside anna.png is left out"):
        assert layout_of_file(path) == LAYOUT


# -- when nothing is said -------------------------------------------------------------------------


@pytest.mark.parametrize("comment", [b"ASCII\0\0\0Made with {x}", b"",
                                     b'{"LKGColumns": "many"}'])
def test_other_programs_comments_are_no_layout(tmp_path, comment):
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x9286] = comment
    Image.fromarray(QUILT).save(tmp_path / "a.jpg", exif=exif)
    with pytest.raises(UserError, match=r"nothing gives the layout .* --columns and --rows"):
        layout_for(tmp_path / "a.jpg", PANEL)


def test_the_panels_own_layout_is_assumed_only_for_its_own_size(tmp_path):
    path = plain(tmp_path)
    with pytest.raises(UserError, match="nothing gives the layout"):
        layout_for(path, PANEL)
    with pytest.warns(UserWarning, match="taken for 8 x 6 views"):
        assert layout_for(path, dataclasses.replace(PANEL, quilt_size=(220, 96))) == QuiltLayout(
            8, 6, PANEL.aspect)


def test_a_damaged_picture_is_told_as_such(tmp_path):
    (tmp_path / "a.png").write_text("no picture")
    with pytest.raises(UserError, match="can't read the picture"):
        layout_for(tmp_path / "a.png", PANEL)


# -- commands -------------------------------------------------------------------------------------


@pytest.fixture
def panel(tmp_path):
    PANEL.save(tmp_path / "small.toml")
    return tmp_path / "small.toml"


def coded(path, panel, *words):
    out = path.with_name("coded.png")
    code = main(["interlace", str(path), "--display", str(panel), "--out", str(out), "--quiet",
                 *map(str, words)])
    return read_image(out) if code == 0 else None


def test_interlace_cuts_a_renamed_quilt_as_its_layout_says(tmp_path, panel, capsys):
    wanted = interlace(TILES, PANEL)
    assert np.array_equal(coded(inside(tmp_path, "anna.png"), panel), wanted)
    assert np.array_equal(coded(plain(tmp_path, "A_QS11X6A1.875.PNG"), panel), wanted)
    assert np.array_equal(coded(plain(tmp_path, "b_qs11x6.png"), panel), wanted)
    assert np.array_equal(coded(plain(tmp_path, "c.png"), panel, "--columns", 11, "--rows", 6),
                          wanted)
    assert capsys.readouterr().err == ""
    assert coded(plain(tmp_path, "d.png"), panel) is None
    assert "nothing gives the layout" in capsys.readouterr().err


def test_interlace_tells_of_a_size_that_does_not_fit(tmp_path, panel, capsys):
    write_image(tmp_path / "a_qs11x6a1.875.png", QUILT[:95, :218])
    assert coded(tmp_path / "a_qs11x6a1.875.png", panel) is not None
    assert "9 at the right and 5 at the top are left out" in capsys.readouterr().err
    assert coded(plain(tmp_path, "b_qs6x11a1.875.png"), panel) is not None
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and "tiles of the aspect 4.5" in lines[0]


def test_customary_quilts_with_a_rest_at_the_edge_are_not_told_of(tmp_path, panel, capsys):
    write_image(tmp_path / "a_qs5x9a1.778.png", np.zeros((4096, 4096, 3), np.uint8), fast=True)
    assert coded(tmp_path / "a_qs5x9a1.778.png", panel) is not None
    assert capsys.readouterr().err == ""


def test_a_video_is_not_taken_for_a_picture(tmp_path, panel, capsys):
    (tmp_path / "a_qs11x6a1.875.mp4").write_bytes(b"")
    assert coded(tmp_path / "a_qs11x6a1.875.mp4", panel) is None
    assert "lfportrait cast" in capsys.readouterr().err


def test_a_quilt_taken_out_of_a_coded_picture_says_its_layout(tmp_path, panel):
    write_image(tmp_path / "coded.png", interlace(TILES, PANEL))
    assert main(["deinterlace", str(tmp_path / "coded.png"), "--display", str(panel), "--out",
                 str(tmp_path / "q_qs4x3.png"), "--quiet"]) == 0
    path = tmp_path / "q_qs4x3a1.875.png"
    assert json.loads(Path(f"{path}.json").read_text())["quilt_settings"]["viewX"] == 4
    assert quietly(path.rename(tmp_path / "renamed.png")) == QuiltLayout(4, 3, 1.875)
