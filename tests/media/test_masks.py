"""Masks of all programs are masks here, wherever they lie and however they are written."""

import json
import unicodedata
import warnings

import numpy as np
import pytest
from PIL import Image

from lfportrait.errors import UserError
from lfportrait.media.folders import Finder
from lfportrait.media.pictures import mask_places, read_mask

SHAPE = (60, 80)


def person():
    y, x = np.mgrid[:SHAPE[0], :SHAPE[1]]
    return np.hypot(x - 40, y - 30) < 20


def soft():
    y, x = np.mgrid[:SHAPE[0], :SHAPE[1]]
    return np.clip((24 - np.hypot(x - 40, y - 30)) / 8, 0, 1)


def paletted(index, *colors):
    picture = Image.fromarray(np.asarray(index, np.uint8), "P")
    picture.putpalette([value for color in colors for value in color])
    return picture


def written(path, picture, **options):
    picture.save(path, **options)
    return read_mask(path)


HARD = {
    "0 and 1": lambda: Image.fromarray(person().astype(np.uint8)),
    "0 and 1 in 16 bit": lambda: Image.fromarray(person().astype(np.uint16)),
    "0 and 255": lambda: Image.fromarray(np.uint8(person() * 255)),
    "0 and 255 in 16 bit": lambda: Image.fromarray((person() * 255).astype(np.uint16)),
    "0 and 65535": lambda: Image.fromarray((person() * 65535).astype(np.uint16)),
    "a palette's dark red": lambda: paletted(person(), (0, 0, 0), (128, 0, 0)),
    "a palette's white": lambda: paletted(person(), (0, 0, 0), (255, 255, 255)),
    "a palette's white first": lambda: paletted(~person(), (255, 255, 255), (0, 0, 0)),
    "a palette of 0 and 1": lambda: paletted(person(), (0, 0, 0), (1, 1, 1)),
    "one bit": lambda: Image.fromarray(person()),
    "white of three channels": lambda: Image.fromarray(np.repeat(np.uint8(person() * 255)[
        ..., None], 3, 2)),
    "colors of labels": lambda: Image.fromarray(np.uint8(person()[..., None] * (0, 128, 0))),
    "gray and alpha": lambda: Image.fromarray(np.uint8(np.dstack(
        [person() * 255, np.full(SHAPE, 255)])), "LA"),
    "black and white with alpha": lambda: Image.fromarray(np.uint8(np.dstack(
        [np.repeat((person() * 255)[..., None], 3, 2), np.full(SHAPE, 255)]))),
    "alpha of white": lambda: Image.fromarray(np.uint8(np.dstack(
        [np.full((*SHAPE, 3), 255), person() * 255]))),
    "alpha of black": lambda: Image.fromarray(np.uint8(np.dstack(
        [np.zeros((*SHAPE, 3)), person() * 255]))),
}


@pytest.mark.parametrize("kind", HARD)
def test_masks_without_edges(tmp_path, kind):
    found = written(tmp_path / "m.png", HARD[kind]())
    assert found.dtype == np.uint8 and found.shape == SHAPE
    assert np.array_equal(found, person() * 255)


def test_floating_point(tmp_path):
    assert np.array_equal(written(tmp_path / "m.tif", Image.fromarray(np.float32(person()))),
                          person() * 255)
    assert np.abs(written(tmp_path / "m.tif", Image.fromarray(np.float32(soft())))
                  - 255 * soft()).max() <= 1


def test_labels_of_a_face(tmp_path):
    labels = np.zeros(SHAPE, np.uint8)
    for number in range(1, 19):
        labels[number * 3:(number + 1) * 3, 20:60] = number
    assert np.array_equal(written(tmp_path / "m.png", Image.fromarray(labels)),
                          np.uint8(labels > 0) * 255)
    colors = np.random.default_rng(0).integers(30, 256, (19, 3), np.uint8)
    colors[0] = 0
    assert np.array_equal(written(tmp_path / "m.png", Image.fromarray(colors[labels])),
                          np.uint8(labels > 0) * 255)


@pytest.mark.parametrize("kind", ["gray", "16 bit", "alpha", "palette", "three channels", "webp"])
def test_soft_edges_are_kept(tmp_path, kind):
    values = np.uint8(np.round(soft() * 255))
    gray = Image.fromarray(values)
    picture = {
        "gray": lambda: gray, "webp": lambda: gray, "palette": lambda: gray.quantize(64),
        "16 bit": lambda: Image.fromarray(np.uint16(soft() * 65535)),
        "three channels": lambda: Image.merge("RGB", [gray] * 3),
        "alpha": lambda: Image.merge("RGBA", [Image.fromarray(np.full(SHAPE, 90, np.uint8))] * 3
                                     + [gray])}[kind]()
    found = written(tmp_path / ("m.webp" if kind == "webp" else "m.png"), picture,
                    **({"lossless": True} if kind == "webp" else {}))
    assert np.abs(found - soft() * 255).max() <= (5 if kind == "palette" else 1)


@pytest.mark.parametrize("color", [(255, 255, 255), (0, 128, 0)])
@pytest.mark.parametrize("quality", [50, 75, 95])
def test_a_jpeg_of_black_and_one_color(tmp_path, quality, color):
    image = np.uint8(person()[..., None] * color)
    found = written(tmp_path / "m.jpg", Image.fromarray(image), quality=quality)
    assert ((found > 127) == person()).mean() > 0.98


def test_an_empty_mask_is_one(tmp_path):
    for mode in ("1", "L", "I;16", "RGB", "P"):
        assert not written(tmp_path / "m.png", Image.new(mode, SHAPE[::-1], 0)).any()


def test_a_photo_is_no_mask(tmp_path):
    image = np.random.default_rng(0).integers(20, 200, (*SHAPE, 3), np.uint8)
    for picture in (Image.fromarray(image), Image.fromarray(image // 2).convert("L")):
        picture.save(tmp_path / "m.png")
        with pytest.raises(UserError, match=r"m\.png is no mask") as told:
            read_mask(tmp_path / "m.png")
        assert "\n" not in str(told.value) and "white" in str(told.value)


def test_a_mask_is_turned_upright(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    half = np.zeros(SHAPE, np.uint8)
    half[:30] = 255
    found = written(tmp_path / "m.png", Image.fromarray(half), exif=exif)
    assert found.shape == SHAPE[::-1] and (found[:, 50:] == 255).all() and not found[:, :20].any()


@pytest.mark.parametrize("name", ["x.jpg.png", "x.png", "x_mask.png", "x.mask.png", "x.jpg",
                                  "x.webp", "x.PNG", "X.png", "X.JPG.PNG", "x_Mask.png", "x.tif"])
def test_where_masks_lie(tmp_path, name):
    folder = tmp_path / "masks"
    folder.mkdir()
    (folder / f"._{name}").write_bytes(b"\0\5\x16\7")
    Image.fromarray(np.uint8(person() * 255)).save(folder / name)
    found = mask_places(Finder(), [tmp_path / "none", folder], "x.jpg")
    assert found is not None and found.name == name


@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_masks_with_accents(tmp_path, form):
    other = "NFD" if form == "NFC" else "NFC"
    Image.new("L", (4, 4)).save(tmp_path / unicodedata.normalize(form, "Zoé.jpg.png"))
    assert mask_places(Finder(), [tmp_path], unicodedata.normalize(other, "Zoé.jpg")) is not None
    assert mask_places(Finder(), [tmp_path], "Zoe.jpg") is None


@pytest.mark.parametrize("name", ["a_mask.png", "a.jpg.PNG", "A.webp"])
def test_a_captures_masks_become_its_mattes(tmp_path, name):
    from lfportrait.capture import Capture

    for folder in ("images", "masks", "elsewhere"):
        (tmp_path / folder).mkdir()
    frames = []
    for number in range(4):
        photo = "abcd"[number]
        Image.fromarray(np.full((*SHAPE, 3), 90, np.uint8)).save(
            tmp_path / "images" / f"{photo}.jpg")
        mask = name.replace("a", photo, 1) if name[0] == "a" else name.replace("A",
                                                                             photo.upper())
        # The last one lies where the file says.
        place = tmp_path / ("elsewhere" if number == 3 else "masks") / mask
        Image.fromarray(np.uint8(person())).save(place, **({"lossless": True}
                                                           if mask.endswith("webp") else {}))
        pose = np.eye(4)
        pose[:3, 3] = number - 1.5, 0, 4
        frames.append({"file_path": f"images/{photo}.JPG", "transform_matrix": pose.tolist(),
                       **({"mask_path": f"elsewhere\\{mask}"} if number == 3 else {})})
    (tmp_path / "transforms.json").write_text(json.dumps({"fl_x": 100, "frames": frames}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        capture = Capture.load(tmp_path, holdout=0)
    assert capture.alphas is not None and len(capture) == 4
    assert all(np.array_equal(alpha, person() * 255) for alpha in capture.alphas)
