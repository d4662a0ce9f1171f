"""Photos are found though a program's file spells their names otherwise than the disk."""

import unicodedata
import warnings

import numpy as np
import pytest

from lfportrait.capture import Capture, is_calibrated

from .test_capture import write_transforms
from .test_formats import write_nsvf
from .test_phones import polycam, record3d
from .test_programs import WRITERS, centred, photos


def transforms(folder, cameras):
    write_transforms(folder, cameras, {"fl_x": 110})


def all_programs():
    return [write for write, _ in WRITERS]


def respell(folder, new):
    """Every photo of a folder by another name; ``new`` changes its name."""
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in (".png", ".jpg"):
            path.rename(path.with_name(new(path.name)))


def accented(folder, form):
    """``IMG`` with an accent in the names that a program's file has."""
    for path in folder.iterdir():
        if path.is_file():
            text = path.read_text("utf-8").replace("IMG", unicodedata.normalize(form, "ÎMG"))
            text = text.replace("img", unicodedata.normalize(form, "îmg"))
            path.write_text(text, "utf-8")


def junk_beside(folder):
    for path in list(folder.rglob("*")):
        if path.is_file():
            path.with_name(f"._{path.name}").write_bytes(b"\0\5\x16\7" + bytes(80))
            (path.parent / "@eaDir").mkdir(exist_ok=True)
            (path.parent / "@eaDir" / path.name).write_bytes(path.read_bytes())


def whole(folder, count=6):
    assert is_calibrated(folder)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(Capture.load(folder)) == count


@pytest.mark.parametrize("write", all_programs())
@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_accents_in_either_form(tmp_path, write, form):
    cameras = centred()
    photos(tmp_path, cameras)
    write(tmp_path, cameras)
    accented(tmp_path, form)
    other = unicodedata.normalize("NFD" if form == "NFC" else "NFC", "ÎMG")
    respell(tmp_path, lambda name: name.replace("IMG", other))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert len(Capture.load(tmp_path)) == 6


@pytest.mark.parametrize("write", all_programs())
@pytest.mark.parametrize("new", [str.lower, str.upper, lambda name: name.replace(".png", ".PNG")])
def test_names_in_any_case(tmp_path, write, new):
    cameras = centred()
    photos(tmp_path, cameras)
    write(tmp_path, cameras)
    respell(tmp_path, new)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert len(Capture.load(tmp_path)) == 6


@pytest.mark.parametrize("write", all_programs())
def test_junk_beside_programs_files(tmp_path, write):
    cameras = centred()
    photos(tmp_path, cameras)
    write(tmp_path, cameras)
    junk_beside(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert len(Capture.load(tmp_path)) == 6


DATA_SETS = {"transforms": transforms, "nsvf": write_nsvf,
             "polycam": lambda folder, cameras: polycam(folder, cameras, False),
             "record3d": lambda folder, cameras: record3d(folder, cameras, False)}


@pytest.mark.parametrize("kind", DATA_SETS)
def test_data_sets_with_names_in_any_case(tmp_path, kind):
    DATA_SETS[kind](tmp_path, centred())
    respell(tmp_path, str.upper)
    whole(tmp_path)


@pytest.mark.parametrize("kind", DATA_SETS)
def test_junk_beside_data_sets(tmp_path, kind):
    DATA_SETS[kind](tmp_path, centred())
    junk_beside(tmp_path)
    whole(tmp_path)


@pytest.mark.parametrize("form", ["NFC", "NFD"])
@pytest.mark.parametrize("kind", ["nsvf", "polycam"])
def test_accents_of_a_photo_and_its_cameras_file(tmp_path, kind, form):
    DATA_SETS[kind](tmp_path, centred())
    other = "NFD" if form == "NFC" else "NFC"
    for path in sorted(tmp_path.rglob("*.*")):
        if path.parent != tmp_path and path.is_file():
            used = form if path.suffix in (".png", ".jpg") else other
            path.rename(path.with_name(unicodedata.normalize(used, f"{path.stem}é{path.suffix}")))
    whole(tmp_path)


def test_pictures_of_other_endings_than_noted(tmp_path):
    transforms(tmp_path, centred())
    file = tmp_path / "transforms.json"
    file.write_text(file.read_text().replace(".png", ".JPG"))
    from PIL import Image
    for path in sorted((tmp_path / "images").iterdir()):
        Image.fromarray(np.asarray(Image.open(path))).save(path.with_suffix(".jpeg"))
        path.unlink()
    whole(tmp_path)
