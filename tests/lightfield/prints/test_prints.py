"""Prints as an eye sees them, their depth, marks, test pages, lenses, and the command."""

import dataclasses
import json
import math
import tracemalloc

import cv2
import numpy as np
import pytest
from PIL import Image

from lfportrait.cli import main
from lfportrait.errors import UserError
from lfportrait.lightfield import (
    Display,
    EncodeConfig,
    ViewMask,
    encode,
    encode_rows,
    ground_of,
    render_view,
    simulate,
)
from lfportrait.lightfield.prints import (
    PrintConfig,
    PrintSheet,
    SheetView,
    fitted,
    pages,
    through_lenses,
    write_print,
)
from lfportrait.lightfield.prints.pages import TrialPage, lens_heights, write_lenses
from lfportrait.metrics import psnr
from tests.fields import head_field, shell_field
from tests.lightfield.test_ground import analytic, checkered, nothing

SHEETS = [(40, 600, "24x32mm"), (60.12, 720, "25x30mm"), (75, 1440, "25x25mm")]
EACH = [SHEETS[0], *(pytest.param(*sheet, marks=pytest.mark.slow) for sheet in SHEETS[1:])]
PLAIN = {"bleed": 0.0, "margin": 0.0}


def smooth_field():
    """A solid shell whose color changes smoothly: a lens shows one color."""
    field = shell_field(basis=1, size=48, density=60.0)
    field.density[:] = 60.0
    return field.with_sh((0.8 * field.lattice_points())[:, :, None])


@pytest.mark.parametrize("lpi, dpi, size", EACH)
def test_the_eye_sees_the_right_view_at_nine_places(lpi, dpi, size):
    field = smooth_field()
    sheet = PrintSheet.of(PrintConfig(lpi=lpi, dpi=dpi, size=size, **PLAIN))
    display = sheet.display
    config, _ = fitted(field, sheet)
    image = encode(field, display, config, mask=ViewMask.build(display, cache=False))
    # Nearer to the edge of the viewing angle an eye sees something of the other edge, too.
    views = [round(place) for place in np.linspace(0.1, 0.9, 9) * (display.views - 1)]
    rendered = [render_view(field, display, view, config) for view in views]
    # Every third row tells as much as all of them.
    some = [picture[::3] / np.float32(255) for picture in rendered]
    for number, view in enumerate(views):
        seen = simulate(image, display, (display.eyes()[view],))[::3]
        scores = [psnr(seen, other) for other in some]
        assert scores[number] > 28 and int(np.argmax(scores)) == number
        # The quicker eye of the preview agrees: a lens at a time.
        lenses = through_lenses(image, display, display.eyes()[view])[:, 1:-1]
        target = through_lenses(rendered[number], display, display.eyes()[view])[:, 1:-1]
        assert psnr(lenses, target) > 28


def test_every_pixel_is_a_ray_of_its_own_direction():
    field = shell_field(size=32, basis=1)
    sheet = PrintSheet.of(PrintConfig(lpi=60.12, dpi=720, size="25x25mm", **PLAIN))
    display, config = sheet.display, EncodeConfig(blend="continuous", depth_scale=0.3)
    rows = encode_rows(field, display, config, 300, 4)
    # One view of a display that has the eye of one pixel in its middle.
    for column in np.random.default_rng(1).integers(200, display.width - 200, 12):
        share = display.phase(0, column, 0) / display.pitch
        eye = display.eye_reach * (2 * share - 1)
        one = dataclasses.replace(display, views=1)
        object.__setattr__(one, "eyes", lambda eye=eye: np.array([eye]))
        truth = render_view(field, one, 0, config)[300:304, column]
        assert np.abs(truth.astype(int) - rows[:, column]).max() <= 3


@pytest.mark.parametrize("method", ["slices", "direct"])
@pytest.mark.parametrize("name", ["print", "slanted", "lookingglass-go", "lookingglass-16-2024"])
def test_rows_are_those_of_the_whole_picture(method, name):
    field = shell_field(size=24, basis=1)
    if name in ("print", "slanted"):
        display = PrintSheet.of(PrintConfig(lpi=30, dpi=120, size="30x40mm", **PLAIN,
                                            slant=3.0 if name == "slanted" else 0.0)).display
    elif name in Display.names():
        display = Display.preset(name).scaled(64, 48)
    else:
        display = Display(64, 48, 40, 7.3, slant=0.2, cells=((-.3, .1, 0, 0, .3, -.1),
                                                            (.2, .2, 0, 0, -.2, .2)),
                          cell_pattern="rows")
    for blend in ("nearest", "continuous", "filtered"):
        config = EncodeConfig(method=method, blend=blend)
        whole = encode(field, display, config, mask=ViewMask.build(display, cache=False))
        for first, count, apart in ((0, 16, 1), (13, 10, 1), (3, 9, 4)):
            rows = encode_rows(field, display, config, first, count, apart)
            assert np.array_equal(rows, whole[first:first + (count - 1) * apart + 1:apart])
    with pytest.raises(ValueError, match="panel"):
        encode_rows(field, display, None, display.height - 1, 2)


@pytest.mark.parametrize("lpi, dpi, size", EACH)
def test_the_ground_lies_at_its_depth_and_goes_on_through_the_bleed(lpi, dpi, size, tmp_path):
    field = checkered(nothing())
    sheet = PrintSheet.of(PrintConfig(lpi=lpi, dpi=dpi, size=size, bleed=2.0, margin=0.0,
                                      marks=False))
    display = sheet.display
    config = EncodeConfig(blend="continuous", shadow=0.0, ground_blur=0.0)
    write_print(field, sheet, tmp_path / "print.png", coding=config)
    with Image.open(tmp_path / "print.png") as file:
        page = np.asarray(file)
    share = ground_of(field, display, config).depth / display.distance
    for eye in display.eyes()[[60, 128, 196]]:
        seen = through_lenses(page, display, eye)[:, 1:-1]
        wide, near = (through_lenses((255 * analytic(
            field, display, config, eye + more, display.width, display.height) + 0.5
            ).astype(np.uint8), display, eye)[:, 1:-1] for more in (0.0, 0.02))
        # A lens is as wide as all its directions: the ground moves by a part of one.
        assert psnr(seen, wide) > 28
        slope = (near - wide) / 0.02
        aside = float(((seen - wide) * slope).sum() / np.square(slope).sum())
        lens = 2 * display.pitch / (3 * display.height)
        assert abs(aside) * share / (1 + share) < 0.1 * lens
    assert np.abs(np.diff(page[[0, -1]].astype(int), axis=1)).max() > 0 and page[0].min() > 5


def test_the_head_is_kept_within_the_depth_budget():
    field = head_field()
    for lpi, dpi, size in [*SHEETS, (75, 1440, "8x10in")]:
        sheet = PrintSheet.of(PrintConfig(lpi=lpi, dpi=dpi, size=size))
        config, depth = fitted(field, sheet)
        assert 0.9 < depth.parallax <= 1 + 1e-9 or config.depth_scale == 1
        assert depth.head_front - depth.head_back <= depth.budget + 1e-9
        assert depth.head_back < 0 and not depth.warning()
        assert config.depth_scale == depth.depth_scale <= 1
        assert "2 N t / n" in depth.lines()[0]
    twice = PrintSheet.of(dataclasses.replace(sheet.config, relief=2.0))
    assert fitted(field, twice)[1].parallax > 1.5
    assert "blur" in fitted(field, twice)[1].lines()[-1]


def test_heads_keep_their_size_whatever_the_border():
    field = head_field()
    sizes = []
    for bleed, margin in ((0, 0), (5, 10), (0, 30)):
        sheet = PrintSheet.of(PrintConfig(lpi=40, dpi=300, size="60x80mm", bleed=bleed,
                                          margin=margin))
        config, _ = fitted(field, sheet)
        picture = through_lenses(encode(field, sheet.display, config, mask=ViewMask.build(
            sheet.display, cache=False)), sheet.display, 0.0)
        sizes.append(((picture.max(2) > 0.05).any(1)[:sheet.trim.bottom]).sum())
    assert np.ptp(sizes) <= 3


def test_what_is_cut_in_front_of_the_paper_is_warned_of():
    field = head_field()
    config = PrintConfig(lpi=60, dpi=300, size="60x80mm", head=1.3)
    sheet = PrintSheet.of(config)
    _, depth = fitted(field, sheet)
    # By default what touches an edge lies behind.
    assert not depth.touching
    _, forward = fitted(field, PrintSheet.of(dataclasses.replace(config, focus=6.0)))
    assert "bottom" in forward.touching
    warning = forward.warning()
    assert "--focus" in warning and "bottom edge" in warning
    back = dataclasses.replace(config, focus=forward.behind)
    assert not fitted(field, PrintSheet.of(back))[1].touching


def test_heads_that_cannot_be_shown_are_refused():
    field = head_field(24)
    with pytest.raises(UserError, match="nothing of the head"):
        fitted(field, PrintSheet.of(PrintConfig(lpi=60, shift_x=3.0)))
    with pytest.raises(UserError, match="flat"):
        fitted(field, PrintSheet.of(PrintConfig(lpi=90, dpi=180, size="2000x2000mm")))


@pytest.mark.slow  # a whole page; rows of the picture: above
def test_pages_are_written_in_bands(tmp_path, monkeypatch):
    field = shell_field(size=24, basis=1)
    sheet = PrintSheet.of(PrintConfig(lpi=30, dpi=200, size="200x300mm"))
    write_print(field, PrintSheet.of(PrintConfig(lpi=30, dpi=60, size="50x50mm")),
                tmp_path / "small.tiff")
    monkeypatch.setattr(pages, "_BAND", 1 << 20)
    coding, _ = fitted(field, sheet)
    tracemalloc.start()
    figures = write_print(field, sheet, tmp_path / "p.tiff", coding=coding)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # A few bands, and what Python keeps, against 13 MiB of pixels.
    assert figures["bytes"] > 13 << 20 and most < 0.7 * figures["bytes"]
    whole = encode(field, sheet.display, coding, mask=ViewMask.build(sheet.display, cache=False))
    picture, read = sheet.picture, np.asarray(Image.open(tmp_path / "p.tiff"))
    inside = (slice(picture.top, picture.bottom), slice(picture.left, picture.right))
    assert np.array_equal(read[inside], whole[inside])


@pytest.mark.slow  # a whole page
def test_marks_tell_where_the_sheet_lies_and_where_to_cut(tmp_path):
    field = head_field(24)
    config = PrintConfig(lpi=40, dpi=600, size="60x80mm")
    sheet = PrintSheet.of(config)
    write_print(field, sheet, tmp_path / "p.png")
    page = np.asarray(Image.open(tmp_path / "p.png"))
    picture, trim = sheet.picture, sheet.trim
    strip = page[picture.top // 3, picture.left:picture.right]
    assert set(np.unique(strip)) == {0, 255} and 0.4 < (strip == 0).mean() < 0.6
    # Straight in front the strips above, below and at the sides are black; to the side, white.
    for eye, value in ((0.0, 0.0), (0.5 * sheet.display.eye_reach * 1.9, 1.0)):
        seen = through_lenses(page, sheet.display, eye)
        lens = sheet.pixels_per_lens
        columns = slice(math.ceil(picture.left / lens) + 2, int(picture.right / lens) - 2)
        for row in (picture.top // 3, sheet.display.height - picture.top // 3):
            assert np.abs(seen[row, columns] - value).mean() < 0.02
        side = seen[sheet.display.height // 2, 2:5]
        assert np.abs(side - value).mean() < 0.35
    # Lines at the corners.
    row = round(0.85 * picture.top)
    dark = np.flatnonzero(page[row, :, 0] == 0)
    assert abs(dark.min() - trim.left) < 4 and abs(dark.max() - trim.right) < 4
    assert (page[0] == 255).all() and (page[:, 0] == 255).all()
    bare = PrintSheet.of(dataclasses.replace(config, marks=False))
    write_print(field, bare, tmp_path / "bare.png")
    page = np.asarray(Image.open(tmp_path / "bare.png"))
    assert (page[:picture.top] == 255).all() and (page[:, :picture.left] == 255).all()
    mirrored = PrintSheet.of(dataclasses.replace(config, marks=False, mirror=True))
    write_print(field, mirrored, tmp_path / "m.tiff")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "m.tiff"))[:, ::-1], page)


@pytest.mark.parametrize("number, row", [(10, 2), (13, 5), (6, 8)])
def test_the_test_page_shows_pitch_and_phase(number, row):
    config = PrintConfig(lpi=60.12, dpi=720, size="150x150mm")
    page = TrialPage.of(config)
    ink = [page.rows(top + height // 2, 1) for top, height in (
        (line.top, line.height) for line in page.lines if line.sheet is not None)]
    ink = np.repeat(np.concatenate(ink)[..., None], 3, 2)

    def even(config, rows):
        """How much of each row is black to an eye in front of the middle."""
        sheet = PrintSheet.of(config, bare=True).display
        seen = through_lenses(ink[rows], sheet, 0.0)[:, 60:-14, 0]
        return (seen < 0.5).mean(1)

    # A sheet of another pitch than was thought, that lies right.
    black = even(dataclasses.replace(config, lpi=page.pitches[number]), slice(0, 21))
    assert int(np.argmax(black)) == number and black[number] > 0.98
    # One of the right pitch that lies beside its place.
    phase = page.phases[row]
    black = even(dataclasses.replace(config, phase=phase), slice(21, 31))
    assert black[row] > 0.98 and black[(row + 5) % 10] < 0.02


def test_the_test_page_is_made_of_whole_bands():
    page = TrialPage.of(PrintConfig(lpi=60, dpi=300, size="100x120mm"))
    whole = page.rows(0, page.sheet.display.height)
    parts = np.concatenate([page.rows(first, min(37, len(whole) - first))
                            for first in range(0, len(whole), 37)])
    assert np.array_equal(whole, parts)
    with pytest.raises(UserError, match="at least 100"):
        TrialPage.of(PrintConfig(lpi=60, size="50x120mm"))
    with pytest.raises(UserError, match="pitch-range"):
        TrialPage.of(PrintConfig(lpi=60), 50.0)


@pytest.mark.parametrize("lpi", [30, 40, 60])
@pytest.mark.parametrize("profile", ["arc", "sine"])
def test_lenses_are_sharp_on_the_ink(lpi, profile):
    sheet = PrintSheet.of(PrintConfig(lpi=lpi, dpi=1440, size="30x30mm", index=1.5, **PLAIN))
    heights = lens_heights(sheet, profile, np.zeros(1, np.int64))[0]
    lens = 25.4 / lpi
    x = (np.arange(len(heights)) - (len(heights) - 1) / 2) * 25.4 / 1440
    assert heights.max() == pytest.approx(sheet.thickness, rel=1e-3)
    # Rays from straight in front, bent by the surface, meet near the axis at the ink.
    inside = np.abs(x) < lens / 8
    slope = np.gradient(heights, x)[inside]
    normal = np.arctan(slope)
    # Angle to the vertical after refraction, towards the axis.
    bent = normal - np.arcsin(np.sin(normal) / 1.5)
    landed = x[inside] + heights[inside] * np.tan(bent)
    assert np.abs(landed).max() < 0.06 * lens
    # The lenses stand where the print's are: the lowest where the phase begins anew.
    phase = sheet.display.phase(0, np.arange(len(heights)), 0) / sheet.display.pitch
    assert np.all(heights[np.abs(phase - 0.5) < 0.1] > heights[np.abs(phase - 0.5) > 0.4].max())


@pytest.mark.parametrize("size", ["100x100mm", "a5-landscape", "8x10in"])
def test_words_fit_on_every_test_page(size):
    page = TrialPage.of(PrintConfig(lpi=60.12, dpi=300, size=size))
    edge = page.sheet.pixels(5.0)
    ink = page.rows(0, page.sheet.display.height) < 255
    for line in page.lines:
        part = ink[line.top:line.top + line.height]
        assert not part[:, :edge - 1].any() and not part[:, -edge + 1:].any()
        if line.sheet is None:
            # The last letter is whole: there is white behind it, and some ink before.
            assert part.any() and not part[:, -edge - 2:].any()


def test_the_height_map_has_sixteen_bits(tmp_path):
    sheet = PrintSheet.of(PrintConfig(lpi=40, dpi=1440, size="20x20mm"))
    figures = write_lenses(sheet, tmp_path / "l.png")
    read = cv2.imread(str(tmp_path / "l.png"), cv2.IMREAD_UNCHANGED)
    assert read.dtype == np.uint16 and read.max() > 65000 and len(np.unique(read)) > 15
    assert read.shape == (sheet.display.height, sheet.display.width)
    heights = lens_heights(sheet, "arc", np.zeros(1, np.int64))[0]
    assert np.abs(read[5] / 65535 * figures["height_mm"] - heights).max() < 1e-4
    thin = PrintSheet.of(PrintConfig(lpi=40, angle=50, thickness=0.6))
    with pytest.raises(UserError, match="at least"):
        write_lenses(thin, tmp_path / "thin.png")
    assert not (tmp_path / "thin.png").exists()


@pytest.mark.slow  # a whole page
def test_the_preview_is_the_head_seen_through_the_sheet():
    field = smooth_field()
    sheet = PrintSheet.of(PrintConfig(lpi=60, dpi=600, size="60x75mm"))
    coding, _ = fitted(field, sheet)
    view = SheetView.of(field, sheet, coding, 300)
    assert 290 <= len(view.rows) <= 600
    trim, display = sheet.trim, sheet.display
    for share in (-0.3, 0.0, 0.3):
        picture = view.picture(share)
        assert picture.shape[0] / picture.shape[1] == pytest.approx(75 / 60, rel=0.01)
        reach = 2 * math.tan(math.radians(display.cone) * share) / math.tan(
            math.radians(display.cone) / 2)
        number = round(display.views * (0.5 + reach / 4) - 0.5)
        truth = render_view(field, display, number, coding)[trim.top:trim.bottom,
                                                            trim.left:trim.right]
        truth = cv2.resize(truth, picture.shape[1::-1], interpolation=cv2.INTER_AREA) / 255
        assert psnr(picture, truth) > 26
    frames = list(view.sweep(8))
    assert len(frames) == 8 and not np.array_equal(frames[1], frames[5])


@pytest.fixture
def field_file(tmp_path):
    head_field().save(tmp_path / "field.npz")
    return str(tmp_path / "field.npz")


SMALL = ["--lpi", "40", "--dpi", "300", "--size", "60x80mm"]


@pytest.mark.slow  # a test page by the command: below
def test_the_command_writes_a_print_and_what_goes_with_it(tmp_path, field_file, capsys):
    out = tmp_path / "print.tiff"
    assert main(["print", field_file, *SMALL, "--out", str(out), "--preview", "--preview-height",
                 "200", "--lenses", str(tmp_path / "lenses.png"), "--save-display",
                 str(tmp_path / "print.toml"), "--json", str(tmp_path / "run.json")]) == 0
    assert "pixels a lens" in capsys.readouterr().out
    run = json.loads((tmp_path / "run.json").read_text())
    with Image.open(out) as page:
        assert page.size == (run["width"], run["height"])
    assert run["depth_mm"]["parallax"] <= 1.01 and run["seconds"]["page"] > 0
    assert (tmp_path / "print-seen.png").is_file() and (tmp_path / "print-seen.mp4").is_file()
    # The display file makes the page a coded picture like any other.
    assert main(["simulate", str(out), "--display", str(tmp_path / "print.toml"), "--out",
                 str(tmp_path / "seen.png")]) == 0
    assert Display.load(tmp_path / "print.toml").pitch == pytest.approx(22.5)


def test_the_command_writes_a_test_page_without_a_field(tmp_path):
    out = tmp_path / "test.png"
    assert main(["print", "--pitch-test", "--lpi", "60", "--dpi", "300", "--size", "a5", "--out",
                 str(out), "--json", str(tmp_path / "run.json")]) == 0
    assert len(json.loads((tmp_path / "run.json").read_text())["pitches"]) == 21
    with Image.open(out) as page:
        assert page.info["dpi"] == pytest.approx((300, 300), rel=1e-4)


@pytest.mark.parametrize("words", [
    [], ["--size", "8x10"], ["--dpi", "70"], ["--out", "print.jpg"], ["--size", "a0", "--dpi",
    "3000"], ["--lenses", "lenses.jpg"], ["--preview", "--preview-height", "3"],
    ["--size", "1000x1500mm", "--dpi", "1200"]])
def test_mistakes_take_one_line_and_leave_no_file(tmp_path, field_file, words, capsys,
                                                  monkeypatch):
    monkeypatch.chdir(tmp_path)
    start = ["print", field_file] if words else ["print"]
    assert main([*start, *SMALL, *words]) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("lfportrait: ") and "\n" not in error
    assert sorted(path.name for path in tmp_path.iterdir()) == ["field.npz"]


def test_a_head_cut_in_front_of_the_paper_is_warned_of(tmp_path, field_file, capsys):
    assert main(["print", field_file, *SMALL, "--head", "1.3", "--focus", "8", "--out",
                 str(tmp_path / "p.tiff")]) == 0
    assert "warning: the head is cut at the" in capsys.readouterr().err
