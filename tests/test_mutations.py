"""Damaged and strange files of every kind: what is read, or one line; never a traceback.

Each test takes a good file, changes a few things in it at random, and reads it.
"""

import copy
import json
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

STRANGE = [None, True, -1, 0, 1, 7, 1e300, -1e-300, float("nan"), float("inf"), 2 ** 70, "", "x",
           "..", "\u00e9\n", [], [[]], [1, 2], {}, {"a": 1}, [None] * 5, [[1e9] * 4] * 4]


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


def places(data, path=()):
    """All places in a nested document."""
    yield path
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(
        data, list) else ()
    for key, value in items:
        yield from places(value, (*path, key))


def changed(data, random):
    """A nested document with one to three places changed."""
    data = json.loads(json.dumps(data))
    for _ in range(random.integers(1, 4)):
        found = [path for path in places(data) if path]
        if not found:
            break
        path = found[random.integers(len(found))]
        holder = data
        for key in path[:-1]:
            holder = holder[key]
        if random.random() < 0.2:
            del holder[path[-1]]
        else:
            holder[path[-1]] = copy.deepcopy(STRANGE[random.integers(len(STRANGE))])
    return data


def bytes_changed(content, random):
    """Bytes with some flipped, cut off, doubled or put in."""
    content = bytearray(content)
    for _ in range(random.integers(1, 6)):
        at = int(random.integers(len(content) + 1)) if content else 0
        kind = random.integers(4)
        if kind == 0 and at < len(content):
            content[at] = random.integers(256)
        elif kind == 1 and random.random() < 0.3:
            del content[at:]
        elif kind == 2:
            content[at:at] = content[at:at + int(random.integers(40))]
        else:
            content[at:at] = random.bytes(int(random.integers(9)))
    return bytes(content)


def each_damaged(folder, files, count, random):
    """Load a data set so many times, each time with one of its files damaged."""
    good = {path: path.read_bytes() for path in files}
    for _ in range(count):
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
    for _ in range(250):
        file.write_text(json.dumps(changed(good, random)))
        read += one_line(Capture.load, tmp_path)
    for _ in range(50):
        file.write_bytes(bytes_changed(json.dumps(good).encode(), random))
        one_line(Capture.load, tmp_path)
    assert read > 10


def test_own_captures(tmp_path):
    from tests.capture.test_capture import make_capture

    make_capture(3).save(tmp_path / "capture")
    file, random = tmp_path / "capture" / "transforms.json", np.random.default_rng(1)
    good = json.loads(file.read_text())
    for _ in range(150):
        file.write_text(json.dumps(changed(good, random)))
        one_line(Capture.load, tmp_path / "capture")


@pytest.mark.parametrize("text", [False, True])
def test_colmap_models(tmp_path, text):
    model = tmp_path / "sparse"
    colmap_model(model, "OPENCV", rig(3, 3), text)
    from lfportrait.files import write_image

    for view in range(3):
        write_image(tmp_path / "images" / f"a photo {view:02d}.png",
                    np.zeros((60, 80, 3), np.uint8))
    each_damaged(tmp_path, sorted(model.iterdir()), 250, np.random.default_rng(2))


@pytest.mark.parametrize("write", [metashape, bundler, visualsfm, meshroom, openmvg,
                                   reality_capture])
def test_cameras_of_programs(tmp_path, write):
    photos(tmp_path, centred())
    write(tmp_path, centred())
    files = sorted(path for path in tmp_path.iterdir() if path.is_file())
    each_damaged(tmp_path, files, 200, np.random.default_rng(3))


@pytest.mark.parametrize("write", [meshroom, openmvg])
def test_documents_of_programs(tmp_path, write):
    photos(tmp_path, centred())
    write(tmp_path, centred())
    file = next(path for path in tmp_path.iterdir() if path.is_file())
    good, random = json.loads(file.read_text()), np.random.default_rng(8)
    for _ in range(150):
        file.write_text(json.dumps(changed(good, random)))
        one_line(Capture.load, tmp_path)


@pytest.mark.parametrize("write", [polycam, record3d])
def test_exports_of_phones(tmp_path, write):
    write(tmp_path, centred(), False)
    files = sorted(path for path in tmp_path.rglob("*") if path.is_file()
                   and path.suffix != ".jpg")
    random = np.random.default_rng(9)
    each_damaged(tmp_path, files, 100, random)
    good = json.loads(files[0].read_text())
    for _ in range(100):
        files[0].write_text(json.dumps(changed(good, random)))
        one_line(Capture.load, tmp_path)


def test_jobs(tmp_path):
    from lfportrait.job.batch import load_jobs

    (tmp_path / "anna").mkdir()
    good = b"""title = "week"
[defaults]
seed = 3
stylize.strength = 0.5
[[sitter]]
name = "anna"
photos = "anna"
styles = ["soft"]
sweeps = true
[[style]]
name = "soft"
painting = "fauve"
[[display]]
panel = "generic-1080p"
encode.size = 0.6
"""
    path, random = tmp_path / "jobs.toml", np.random.default_rng(10)
    for _ in range(400):
        path.write_bytes(bytes_changed(good, random))
        one_line(load_jobs, path)
    values = [b"true", b"-1", b"1e999", b"nan", b"[]", b"{}", b'""', b'"\\u0000"', b"1979-05-27",
              b'["x", 1]', b"0x7fffffffffffffffff", b'"../../.."']
    lines = good.splitlines()
    for _ in range(300):
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

    questions = [{"name": "style", "text": "Which is more like the painting?"}]
    entries = [{"sitter": "anna", "style": "ink", "method": name} for name in ("skin", "arf")]
    design = {"format": "lfportrait study", "study": "s1", "questions": questions,
              "entries": entries, "pairs": [[0, 1]], "sheets": [[[0, 0]]], "repeats": 1}
    (tmp_path / "study.json").write_text(json.dumps(design))
    good = answer(design, 0, lambda *_: "left")
    file, random = tmp_path / "a.json", np.random.default_rng(11)
    file.write_text(json.dumps(good))
    assert one_line(read_answers, [file], tmp_path)
    for _ in range(400):
        file.write_text(json.dumps(changed(good, random)))
        one_line(read_answers, [file], tmp_path)
        one_line(read_answers, [file])
    file.write_text(json.dumps(good))
    for _ in range(300):
        (tmp_path / "study.json").write_text(json.dumps(changed(design, random)))
        one_line(read_answers, [file], tmp_path)


def test_fields(tmp_path):
    path, random = tmp_path / "f.npz", np.random.default_rng(4)
    shell_field(size=8).save(path)
    with np.load(path) as data:
        good = dict(data)
    for _ in range(400):
        arrays = dict(good)
        for _ in range(random.integers(1, 3)):
            name = sorted(arrays)[random.integers(len(arrays))]
            arrays[name] = strange_array(arrays[name], random)
        np.savez(path, **arrays)
        one_line(VoxelField.load, path)
    content = path.read_bytes()
    for _ in range(100):
        path.write_bytes(bytes_changed(content, random))
        one_line(VoxelField.load, path)


def strange_array(array, random):
    """An array of another type, shape or with other values."""
    kinds = [
        lambda: np.array("text"), lambda: np.ones(3), lambda: np.zeros(0),
        lambda: array.astype(np.complex64) if array.dtype.kind != "U" else array,
        lambda: array[None], lambda: array.ravel()[:1], lambda: array.ravel(),
        lambda: np.full(array.shape, np.nan), lambda: np.full(array.shape, 1e30),
        lambda: np.full(array.shape, -5), lambda: np.full(array.shape, 2 ** 40),
        lambda: np.datetime64("2020-01-01"), lambda: np.array([True, False])]
    return kinds[random.integers(len(kinds))]()


def test_displays(tmp_path):
    path, random = tmp_path / "panel.toml", np.random.default_rng(5)
    Display.preset("lookingglass-16").save(path)
    good = path.read_bytes()
    for _ in range(300):
        path.write_bytes(bytes_changed(good, random))
        one_line(Display.load, path)


def test_landmarks(tmp_path):
    path, random = tmp_path / "x.landmarks.txt", np.random.default_rng(6)
    good = "\n".join(f"{x} {y}" for x, y in random.uniform(0, 500, (68, 2)).round(2)).encode()
    for _ in range(200):
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
        for _ in range(60):
            path.write_bytes(bytes_changed(good, random))
            one_line(read_image, path)


def test_exemplars(tmp_path):
    from lfportrait.example import Exemplar
    from lfportrait.files import write_image

    random = np.random.default_rng(12)
    path = tmp_path / "a.png"
    write_image(path, random.integers(0, 256, (40, 30, 3), np.uint8))
    (tmp_path / "a.landmarks.txt").write_text("\n".join(
        f"{x} {y}" for x, y in random.uniform(5, 25, (68, 2)).round(2)))
    write_image(tmp_path / "a.mask.png", np.full((40, 30, 3), 255, np.uint8))
    files = sorted(tmp_path.iterdir())
    good = {file: file.read_bytes() for file in files}
    for _ in range(200):
        file = files[random.integers(len(files))]
        file.write_bytes(bytes_changed(good[file], random))
        one_line(Exemplar.load, path)
        file.write_bytes(good[file])
