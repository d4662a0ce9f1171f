"""Damaged and strange files of every kind: what is read, or one line; never a traceback.

Each test takes a good file, changes a few things in it at random, and reads it.
"""

import json
import os
import warnings
from pathlib import Path

import numpy as np
import pytest

from lfportrait.capture import Capture
from lfportrait.errors import UserError
from lfportrait.face import read_landmarks
from lfportrait.field import VoxelField
from lfportrait.lightfield import Display
from tests.capture.test_camera import rig
from tests.capture.test_capture import colmap_model, write_transforms
from tests.capture.test_phones import polycam, record3d
from tests.capture.test_programs import (
    bundler,
    centred,
    meshroom,
    metashape,
    openmvg,
    photos,
    reality_capture,
    visualsfm,
)
from tests.fields import shell_field
from tests.inputs import DESIGN, JOBS, landmarks_text
from tests.mutations import bytes_changed, changed, strange_array


def rounds(count):
    """So many changes, one after the other; of quick tests a third.

    `scripts/fuzz_readers.py` goes on where these end.
    """
    return range(count if os.environ.get("LFPORTRAIT_SLOW") == "1" else count // 3)


def one_line(read, *given):
    """Read; a mistake in the file is one line."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            read(*given)
        except UserError as error:
            assert "\n" not in str(error).strip(), error
            return False
    return True


def each_damaged(folder, files, count, random):
    """Load a data set so many times, each time with one of its files damaged."""
    good = {path: path.read_bytes() for path in files}
    for _ in rounds(count):
        path = files[random.integers(len(files))]
        path.write_bytes(bytes_changed(good[path], random))
        one_line(Capture.load, folder)
        path.write_bytes(good[path])


def test_transforms(tmp_path):
    write_transforms(tmp_path, rig(8, 3), {"fl_x": 110, "fl_y": 110, "cx": 40, "cy": 30, "w": 80,
                                           "h": 60, "k1": 0.1, "camera_model": "OPENCV"})
    file, random = tmp_path / "transforms.json", np.random.default_rng(0)
    good = json.loads(file.read_text())
    read = 0
    for _ in range(60):
        file.write_text(json.dumps(changed(good, random)))
        read += one_line(Capture.load, tmp_path)
    for _ in rounds(50):
        file.write_bytes(bytes_changed(json.dumps(good).encode(), random))
        one_line(Capture.load, tmp_path)
    assert read > 2


def test_own_captures(tmp_path):
    from tests.capture.test_capture import make_capture

    make_capture(3).save(tmp_path / "capture")
    file, random = tmp_path / "capture" / "transforms.json", np.random.default_rng(1)
    good = json.loads(file.read_text())
    for _ in rounds(75):
        file.write_text(json.dumps(changed(good, random)))
        one_line(Capture.load, tmp_path / "capture")


@pytest.mark.slow  # other formats: here
@pytest.mark.parametrize("text", [False, True])
def test_colmap_models(tmp_path, text):
    model = tmp_path / "sparse"
    colmap_model(model, "OPENCV", rig(3, 3), text)
    from lfportrait.files import write_image

    for view in range(3):
        write_image(tmp_path / "images" / f"a photo {view:02d}.png",
                    np.zeros((60, 80, 3), np.uint8))
    each_damaged(tmp_path, sorted(model.iterdir()), 125, np.random.default_rng(2))


@pytest.mark.slow  # other formats: here
@pytest.mark.parametrize("write", [metashape, bundler, visualsfm, meshroom, openmvg,
                                   reality_capture])
def test_cameras_of_programs(tmp_path, write):
    photos(tmp_path, centred())
    write(tmp_path, centred())
    files = sorted(path for path in tmp_path.iterdir() if path.is_file())
    each_damaged(tmp_path, files, 100, np.random.default_rng(3))


@pytest.mark.parametrize("write", [meshroom, openmvg])
def test_documents_of_programs(tmp_path, write):
    photos(tmp_path, centred())
    write(tmp_path, centred())
    file = next(path for path in tmp_path.iterdir() if path.is_file())
    good, random = json.loads(file.read_text()), np.random.default_rng(8)
    for _ in rounds(75):
        file.write_text(json.dumps(changed(good, random)))
        one_line(Capture.load, tmp_path)


@pytest.mark.parametrize("write", [polycam, record3d])
def test_exports_of_phones(tmp_path, write):
    write(tmp_path, centred(), False)
    files = sorted(path for path in tmp_path.rglob("*") if path.is_file()
                   and path.suffix != ".jpg")
    random = np.random.default_rng(9)
    each_damaged(tmp_path, files, 50, random)
    good = json.loads(files[0].read_text())
    for _ in rounds(50):
        files[0].write_text(json.dumps(changed(good, random)))
        one_line(Capture.load, tmp_path)


def test_jobs(tmp_path):
    from lfportrait.job.batch import load_jobs

    (tmp_path / "anna").mkdir()
    good = JOBS
    path, random = tmp_path / "jobs.toml", np.random.default_rng(10)
    for _ in rounds(100):
        path.write_bytes(bytes_changed(good, random))
        one_line(load_jobs, path)
    values = [b"true", b"-1", b"1e999", b"nan", b"[]", b"{}", b'""', b'"\\u0000"', b"1979-05-27",
              b'["x", 1]', b"0x7fffffffffffffffff", b'"../../.."']
    lines = good.splitlines()
    for _ in rounds(75):
        changed_lines = list(lines)
        number = random.integers(len(lines))
        key = lines[number].split(b" = ")[0]
        changed_lines[number] = (key + b" = " if b"=" in lines[number] else b"x = ") + values[
            random.integers(len(values))]
        path.write_bytes(b"\n".join(changed_lines))
        one_line(load_jobs, path)


def test_answers_to_a_study(tmp_path):
    from lfportrait_eval.study import read_answers
    from tests.lfportrait_eval.study.people import answer

    design = DESIGN
    (tmp_path / "study.json").write_text(json.dumps(design))
    good = answer(design, 0, lambda *_: "left")
    file, random = tmp_path / "a.json", np.random.default_rng(11)
    file.write_text(json.dumps(good))
    assert one_line(read_answers, [file], tmp_path)
    for _ in rounds(100):
        file.write_text(json.dumps(changed(good, random)))
        one_line(read_answers, [file], tmp_path)
        one_line(read_answers, [file])
    file.write_text(json.dumps(good))
    for _ in rounds(75):
        (tmp_path / "study.json").write_text(json.dumps(changed(design, random)))
        one_line(read_answers, [file], tmp_path)


def test_fields(tmp_path):
    path, random = tmp_path / "f.npz", np.random.default_rng(4)
    shell_field(size=8).save(path)
    with np.load(path) as data:
        good = dict(data)
    for _ in rounds(100):
        arrays = dict(good)
        for _ in range(random.integers(1, 3)):
            name = sorted(arrays)[random.integers(len(arrays))]
            arrays[name] = strange_array(arrays[name], random)
        np.savez(path, **arrays)
        one_line(VoxelField.load, path)
    content = path.read_bytes()
    for _ in rounds(50):
        path.write_bytes(bytes_changed(content, random))
        one_line(VoxelField.load, path)


def test_displays(tmp_path):
    path, random = tmp_path / "panel.toml", np.random.default_rng(5)
    Display.preset("lookingglass-16").save(path)
    good = path.read_bytes()
    for _ in rounds(75):
        path.write_bytes(bytes_changed(good, random))
        one_line(Display.load, path)


def test_landmarks(tmp_path):
    path, random = tmp_path / "x.landmarks.txt", np.random.default_rng(6)
    good = landmarks_text(random, 0, 500).encode()
    for _ in rounds(100):
        path.write_bytes(bytes_changed(good, random))
        one_line(read_landmarks, path)


def test_exemplars_pictures(tmp_path):
    from lfportrait.files import write_image
    from lfportrait.media.pictures import read_image

    random = np.random.default_rng(7)
    for suffix in (".png", ".jpg", ".tif", ".webp"):
        path = Path(tmp_path / f"p{suffix}")
        write_image(path, random.integers(0, 256, (12, 16, 3), np.uint8))
        good = path.read_bytes()
        for _ in rounds(60):
            path.write_bytes(bytes_changed(good, random))
            one_line(read_image, path)


def test_exemplars(tmp_path):
    from lfportrait.example import Exemplar
    from lfportrait.files import write_image

    random = np.random.default_rng(12)
    path = tmp_path / "a.png"
    write_image(path, random.integers(0, 256, (40, 30, 3), np.uint8))
    (tmp_path / "a.landmarks.txt").write_text(landmarks_text(random, 5, 25))
    write_image(tmp_path / "a.mask.png", np.full((40, 30, 3), 255, np.uint8))
    files = sorted(tmp_path.iterdir())
    good = {file: file.read_bytes() for file in files}
    for _ in rounds(100):
        file = files[random.integers(len(files))]
        file.write_bytes(bytes_changed(good[file], random))
        one_line(Exemplar.load, path)
        file.write_bytes(good[file])
