"""What `inspect` tells of files and folders: what they are, how they are read, what is left out."""

import json

import numpy as np
import pytest
from PIL import Image, ImageCms

from lfportrait.cli.dispatch import main
from lfportrait.job import inspect, inspection_lines
from lfportrait.media.pictures import fault_of, open_header, read_image
from lfportrait.share import write_video


def photo(path, size=(160, 120), orientation=1, seed=0, **options):
    """A photo of noise by a phone."""
    exif = Image.Exif()
    exif[0x0112], exif[0x010F], exif[0x0110] = orientation, "Maker", "Phone"
    exif.get_ifd(0x8769)[0xA405] = 36
    noise = np.random.default_rng(seed).integers(0, 255, (size[1], size[0], 3), np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(noise).save(path, exif=exif, **options)
    return path


def lines(path):
    return "\n".join(inspection_lines(inspect(path)))


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".webp"])
def test_the_size_is_that_of_the_picture_that_is_read(tmp_path, orientation, suffix):
    path = photo(tmp_path / f"a{suffix}", orientation=orientation)
    facts = inspect(path).facts
    height, width = read_image(path).shape[:2]
    assert facts.upright == (width, height) and facts.stored == (160, 120)
    assert facts.orientation == orientation and facts.noted.lens.startswith("Maker Phone")
    assert suffix == ".tif" or facts.noted.focal == 1.0  # Pillow writes a TIFF without it


def test_colors_are_told_with_what_says_so(tmp_path):
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
    unfit = inspect(photo(tmp_path / "a.jpg", icc_profile=profile)).facts
    assert unfit.colors == "sRGB" and "does not fit" in unfit.colors_by
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    fit = inspect(photo(tmp_path / "b.jpg", icc_profile=srgb)).facts
    assert "sRGB" in fit.colors and fit.colors_by == "its ICC profile"
    assert "sRGB, as the file says nothing" in lines(photo(tmp_path / "c.jpg"))


def test_a_folder_tells_what_is_left_out_and_why(tmp_path):
    for number in range(4):
        photo(tmp_path / f"p{number}.jpg", seed=number)
    photo(tmp_path / "p4.jpg", (120, 160), orientation=6, seed=9)
    (tmp_path / "copy.jpg").write_bytes((tmp_path / "p1.jpg").read_bytes())
    (tmp_path / "p2-edited.jpg").write_bytes((tmp_path / "p3.jpg").read_bytes() + b"x")
    (tmp_path / "r.cr2").write_bytes(b"II*\0" + bytes(100))
    (tmp_path / "._p0.jpg").write_bytes(b"\0\x05\x16\x07")
    (tmp_path / "notes.txt").write_text("hello")
    data = (tmp_path / "p0.jpg").read_bytes()
    (tmp_path / "cut.jpg").write_bytes(data[:len(data) // 2])
    text = lines(tmp_path)
    assert "5 of 6 can be read" in text
    for part in ("p1.jpg: copies of other photos", "p2-edited.jpg: edited copies",
                 "r.cr2: raw photos", "._p0.jpg: left there by a system", "notes.txt: no picture",
                 "cut.jpg: image file is truncated", "as stored: 4; turned clockwise"):
        assert part in text
    assert "160 x 120" in text and "stored 120 x 160" in text


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".tif", ".heic", ".gif", ".bmp"])
def test_faults_are_those_that_reading_finds(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    if suffix == ".heic":
        pytest.importorskip("pillow_heif").register_heif_opener()
    photo(path)
    assert fault_of(path) == ""
    data = path.read_bytes()
    for share in (0.3, 0.7, 0.95):
        path.write_bytes(data[:int(share * len(data))])
        try:
            read_image(path)
        except Exception:
            assert fault_of(path)
        else:
            assert fault_of(path) == ""


def test_erased_parts_are_found(tmp_path):
    path = photo(tmp_path / "a.jpg", (640, 480))
    data = bytearray(path.read_bytes())
    half = len(data) // 2
    data[half:-2] = bytes(len(data) - half - 2)
    path.write_bytes(data)
    assert "gone from" in fault_of(path)
    data[half:-2] = b"\xff" * (len(data) - half - 2)
    path.write_bytes(data)
    assert "gone from" in fault_of(path)


def test_the_notes_of_a_png_are_read_without_decoding_it(tmp_path):
    path = photo(tmp_path / "a.png", orientation=1)
    Image.open(path).save(path)  # without EXIF data
    with open_header(path) as picture:
        assert not picture.getexif() and picture.tile
    late = photo(tmp_path / "b.png", orientation=6).read_bytes()
    at = late.index(b"eXIf") - 4
    length = int.from_bytes(late[at:at + 4], "big") + 12
    end = late.index(b"IEND") - 4
    moved = late[:at] + late[at + length:end] + late[at:at + length] + late[end:]
    (tmp_path / "b.png").write_bytes(moved)
    assert inspect(tmp_path / "b.png").facts.upright == (120, 160)


def test_a_data_set_tells_its_cameras_and_masks(tmp_path):
    frames = []
    for number in range(3):
        photo(tmp_path / "images" / f"{number}.jpg", seed=number)
        frames.append({"file_path": f"images/{number}.jpg", "transform_matrix": np.eye(4).tolist()})
    frames.append({"file_path": "images/gone.jpg", "transform_matrix": np.eye(4).tolist()})
    (tmp_path / "masks").mkdir()
    Image.new("L", (160, 120), 255).save(tmp_path / "masks" / "1.jpg.png")
    (tmp_path / "transforms.json").write_text(json.dumps(
        {"fl_x": 200, "k1": 0.1, "frames": frames}))
    found = inspect(tmp_path)
    assert found.facts.masks == 1 and found.facts.lenses == {"opencv": 3}
    assert len(found.facts.pictures) == 3
    assert any("1 pictures named in" in note for note in found.notes)
    assert "transforms.json" in lines(tmp_path) and "of 1 views" in lines(tmp_path)
    (tmp_path / "transforms.json").write_text("{}")
    assert "not read" in lines(tmp_path)


def test_a_video_tells_its_length_and_a_damaged_one_its_fault(tmp_path):
    path = tmp_path / "v.mp4"
    write_video(path, [np.full((48, 64, 3), shade, np.uint8) for shade in range(0, 200, 10)], 25.0)
    facts = inspect(path).facts
    assert (facts.stored, facts.upright, facts.frames) == ((64, 48), (64, 48), 20)
    assert facts.rate == 25 and facts.seconds == pytest.approx(0.8, abs=0.05)
    path.write_bytes(path.read_bytes()[:200])
    assert inspect(path).facts.fault


def test_quilts_tell_their_layout_and_where_it_is_said(tmp_path):
    assert "3 x 2 views of aspect 0.75, by its name" in lines(photo(tmp_path / "q_qs3x2a0.75.png"))
    assert "without an aspect" in lines(photo(tmp_path / "q_qs3x2.png"))
    side = photo(tmp_path / "plain.png")
    side.with_name("plain.png.json").write_text(json.dumps(
        {"quilt_settings": {"viewX": 4, "viewY": 3, "aspect": 1.5}}))
    assert "4 x 3 views of aspect 1.5, by plain.png.json" in lines(side)
    assert "two layouts" in lines(photo(tmp_path / "q_qs3x2_qs4x4.png"))


def test_the_command_takes_several_paths_and_writes_figures(tmp_path, capsys):
    photo(tmp_path / "set" / "a.jpg")
    broken = tmp_path / "b.jpg"
    broken.write_bytes(b"\xff\xd8\xff\xe0 nothing")
    figures = tmp_path / "figures.json"
    assert main(["inspect", str(tmp_path / "set"), str(broken), "--json", str(figures)]) == 0
    printed = capsys.readouterr().out
    assert "a folder of photos, 1" in printed and "not read" in printed
    kinds = [one["kind"] for one in json.loads(figures.read_text())["inspected"]]
    assert kinds == ["a folder of photos", "a picture"]
    assert main(["inspect", str(broken), str(tmp_path / "none")]) == 2
    told = capsys.readouterr()
    assert not told.out and "there is no file or folder" in told.err
    assert main(["inspect"]) == 2
