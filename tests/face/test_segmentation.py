"""Mattes from the segmentation networks, and from stand-ins of their shapes."""

import hashlib
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from lfportrait import models
from lfportrait.errors import UserError
from lfportrait.face import segmentation
from lfportrait.media.pictures import read_image
from lfportrait.models import ModelFile

REGISTRY = {name: models.REGISTRY[name] for name in (
    "person-segmentation", "hair-segmentation", "multiclass-segmentation")}


@pytest.fixture
def shelf(tmp_path, monkeypatch):
    """An empty folder of models, and a function that puts a stand-in of a network there."""
    monkeypatch.setattr(models, "cache_folder", lambda: tmp_path / "cache")
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(tmp_path))

    def put(name, content):
        entry = REGISTRY[name][0]
        (tmp_path / entry.file).write_bytes(content)
        digest = hashlib.sha256(content).hexdigest()
        monkeypatch.setitem(models.REGISTRY, name, (ModelFile(entry.file, digest, "", ""),))
    return put


def six_parts(confidences=False, classes=6):
    """A network [1, 256, 256, 3] -> [1, 256, 256, 6] that reads the class off the red channel.

    Logit ``c`` is highest where red is ``c / 5``; it works at half size and is resized, like the
    real one.
    """
    from tests.tflite_files import TfliteFile, convolution

    file = TfliteFile()
    x, out = file.tensor(1, 256, 256, 3), file.tensor(1, 256, 256, classes)
    small, logits = file.tensor(1, 128, 128, 3), file.tensor(1, 128, 128, classes)
    centres = np.linspace(0, 1, classes)
    filters = np.zeros((classes, 1, 1, 3), np.float32)
    filters[:, 0, 0, 0] = 400 * centres  # -200 (x - c)^2, without what all classes share
    file.step("AVERAGE_POOL_2D", [x], small, "Pool2DOptions", strideW=2, strideH=2, filterWidth=2,
              filterHeight=2)
    convolution(file, small, filters, np.float32(-200 * centres ** 2), logits)
    if confidences:
        shares = file.tensor(1, 128, 128, classes)
        file.step("SOFTMAX", [logits], shares, "SoftmaxOptions", beta=1.0)
        logits = shares
    file.step("RESIZE_BILINEAR", [logits, file.constant(np.int32([256, 256]))], out,
              "ResizeBilinearOptions", halfPixelCenters=True)
    return file.content([x], [out])


def bands(height=120, width=160):
    """A picture whose columns show the six classes from left to right, and the classes [W]."""
    classes = np.arange(width) * 6 // width
    image = np.zeros((height, width, 3), np.uint8)
    image[..., 0] = classes * 51
    return image, classes


@pytest.mark.parametrize("confidences", [False, True])
def test_the_network_of_six_parts_gives_all_maps(shelf, confidences):
    shelf("multiclass-segmentation", six_parts(confidences))
    image, classes = bands()
    maps = segmentation.parts(image)
    assert list(maps) == ["background", "hair", "body-skin", "face-skin", "clothes", "others"]
    assert sum(maps.values()) == pytest.approx(np.ones(image.shape[:2]), abs=1e-5)
    for index, values in enumerate(maps.values()):
        assert values.shape == image.shape[:2] and values.dtype == np.float32
        middle = np.nonzero(classes == index)[0][8:-8]
        assert values[:, middle].min() > 0.95


def test_a_network_that_describes_itself_is_taken_as_it_is(shelf):
    content, channels = segmentation._described(six_parts(), 256)
    assert channels == 3 and segmentation._described(content, 64) == (content, 3)
    shelf("multiclass-segmentation", content)
    image, classes = bands()
    found = np.stack(list(segmentation.parts(image).values())).argmax(axis=0)
    assert (found == classes).mean() > 0.95


def test_person_and_hair_come_from_the_six_parts_where_they_are(shelf):
    shelf("multiclass-segmentation", six_parts())
    image, _ = bands()
    maps = segmentation.parts(image)
    person, hair = segmentation.mattes(image)
    assert person == pytest.approx(1 - maps["background"], abs=1e-6)
    assert np.array_equal(hair, maps["hair"])
    assert np.array_equal(segmentation.person_matte(image), person)
    assert np.array_equal(segmentation.hair_mask(image, size=384), hair)
    # A picture that lies on its side is turned before, and the result turned back.
    lying = np.ascontiguousarray(np.rot90(image))
    assert segmentation.person_matte(lying, np.array([-1.0, 0])) == pytest.approx(
        np.rot90(person), abs=1e-6)


def test_another_number_of_classes_is_refused(shelf):
    shelf("multiclass-segmentation", six_parts(classes=2))
    with pytest.raises(UserError, match=r"has 2 classes instead of 6"):
        segmentation.parts(bands()[0])


def constant(channels, bias):
    """A network whose output is the same everywhere."""
    from tests.tflite_files import TfliteFile, convolution

    file = TfliteFile()
    x, out = file.tensor(1, 256, 256, channels), file.tensor(1, 256, 256, len(bias))
    convolution(file, x, np.zeros((len(bias), 1, 1, channels), np.float32), np.float32(bias), out)
    return file.content([x], [out])


def test_two_networks_without_the_six_parts(shelf):
    shelf("person-segmentation", constant(3, [0.25]))
    shelf("hair-segmentation", constant(4, [0.0, 2.0]))
    image = bands()[0]
    person, hair = segmentation.mattes(image, size=64)
    assert person == pytest.approx(np.full(image.shape[:2], 0.25), abs=1e-6)
    assert hair == pytest.approx(np.full(image.shape[:2], 1 / (1 + np.exp(-2))), abs=1e-6)
    assert np.array_equal(segmentation.person_matte(image), person)
    assert np.array_equal(segmentation.hair_mask(image, size=64), hair)


def test_threads_share_the_networks(shelf):
    """The first call makes them, whoever makes it; standard error is there afterwards."""
    shelf("person-segmentation", constant(3, [0.25]))
    shelf("hair-segmentation", constant(4, [0.0, 2.0]))
    image = bands()[0]
    before = os.fstat(2)
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda _: segmentation.mattes(image, size=64), range(12)))
    assert all(np.array_equal(one, two) for result in results
               for one, two in zip(result, results[0]))
    assert os.path.samestat(before, os.fstat(2))


def listed_step(row, x, got):
    """One operation of such a list by its definition, nothing shared with the player."""
    functional, kind = torch.nn.functional, row["op"]
    if kind in ("CONV_2D", "DEPTHWISE_CONV_2D"):
        deep, spread = kind == "DEPTHWISE_CONV_2D", row.get("dilation", 1)
        filters = got[1].permute(3, 0, 1, 2) if deep else got[1].permute(0, 3, 1, 2)
        if row["padding"] == "SAME":
            pads = []
            for size, reach in zip((x.shape[3], x.shape[2]), reversed(filters.shape[2:])):
                reach = (reach - 1) * spread + 1
                total = max((-(-size // row["stride"]) - 1) * row["stride"] + reach - size, 0)
                pads += [total // 2, total - total // 2]
            x = functional.pad(x, pads)
        return functional.conv2d(x, filters, got[2], row["stride"], dilation=spread,
                                 groups=x.shape[1] if deep else 1)
    if kind == "Convolution2DTransposeBias":
        full = functional.conv_transpose2d(x, got[1].permute(3, 0, 1, 2), None, 2)
        return full[..., :2 * x.shape[2], :2 * x.shape[3]] + got[2][None, :, None, None]
    return {
        "RESIZE_BILINEAR": lambda: functional.interpolate(
            x, size=row["size"], mode="bilinear", align_corners=row["align"]),
        "AVERAGE_POOL_2D": lambda: functional.avg_pool2d(x, row["k"], row["stride"]),
        "MaxPoolingWithArgmax2D": lambda: functional.max_pool2d(x, 2, 2, return_indices=True),
        "MaxUnpooling2D": lambda: functional.max_unpool2d(x, got[1], 2, 2),
        "CONCATENATION": lambda: torch.cat(got, dim=1),
        "ADD": lambda: x + got[1], "MUL": lambda: x * got[1],
        "PRELU": lambda: functional.prelu(x, got[1].reshape(-1)),
        "RELU": lambda: torch.relu(x), "HARD_SWISH": lambda: functional.hardswish(x),
        "LOGISTIC": lambda: torch.sigmoid(x)}[kind]()


def play_list(listed, weights, frame):
    """Play such a list on [1, C, H, W]; its steps have no activations fused."""
    values = {listed["input"]["tensor"]: frame}

    def get(number):
        return values[number] if number in values else weights[f"t{number}"].float()

    for row in listed["ops"]:
        assert row.get("act", 0) == 0
        names = row["in"][:1] if row["op"] == "RESIZE_BILINEAR" else row["in"]
        got = [get(number) for number in names]
        result = listed_step(row, got[0], got)
        values.update(zip(row["out"], result if isinstance(result, tuple) else (result,)))
    return values[listed["output"]["tensor"]]


@pytest.mark.data
@pytest.mark.parametrize(("name", "file", "size"), [
    ("person-segmentation", "selfie_segmentation", 256),
    ("hair-segmentation", "hair_segmentation", 512),
    ("hair-segmentation", "hair_segmentation", 256)])
def test_the_official_files_give_the_results_of_an_earlier_packing(
        shared_data, shared_weights, monkeypatch, name, file, size):
    """The same steps, played one by one; the packing's weights are half floats."""
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    picture = read_image(shared_data / "faceblit_reference" / "target1.png")[..., :3]
    frame = segmentation._resized(picture, size)
    if name == "hair-segmentation":
        frame = np.dstack([frame, np.zeros((size, size), np.uint8)])
    listed = json.loads((shared_weights / f"{file}.graph.json").read_text())
    packed = load_file(str(shared_weights / f"{file}.safetensors"))
    values = torch.from_numpy(frame / np.float32(255))[None].permute(0, 3, 1, 2)
    with torch.no_grad():
        expected = play_list(listed, packed, values)[0].permute(1, 2, 0).numpy()
    found = segmentation._run(name, frame)
    if name == "hair-segmentation":
        expected, found = (segmentation._softmax(values)[..., 1:] for values in (expected, found))
    assert np.abs(found - expected).mean() < 1e-3
    assert np.abs(found - expected).max() < 0.03


@pytest.mark.data
def test_the_mattes_of_a_portrait_make_sense(shared_data, shared_weights, monkeypatch):
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    picture = read_image(shared_data / "faceblit_reference" / "target1.png")[..., :3]
    person, hair = segmentation.mattes(picture, size=384)
    assert person.shape == hair.shape == picture.shape[:2]
    assert 0.4 < person.mean() < 0.8 and 0.03 < hair.mean() < 0.3
    assert (hair > 0.5)[person < 0.2].mean() < 0.01


@pytest.mark.data
def test_a_picture_that_was_seen_before_is_not_looked_at_again(shared_data, shared_weights,
                                                               monkeypatch):
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    picture = read_image(shared_data / "faceblit_reference" / "target1.png")[..., :3]
    segmentation._output.cache_clear()
    first = segmentation.mattes(picture, size=256)
    monkeypatch.setattr(segmentation, "_segmenter", lambda path, size: pytest.fail("looked again"))
    for before, after in zip(first, segmentation.mattes(picture.copy(), size=256)):
        np.testing.assert_array_equal(before, after)


def test_who_first_makes_a_task_is_let_go_of():
    # MediaPipe keeps an error of its own import; in this process it may be imported already.
    program = """
import weakref
from lfportrait.face import segmentation
class Large: pass
def call():
    large = Large()
    segmentation.made(lambda: Large(), lambda task: None)
    return weakref.ref(large)
assert call()() is None
"""
    subprocess.run([sys.executable, "-c", program], check=True)
