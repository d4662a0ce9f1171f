"""Pictures of calibrated sets are upright, whichever pixels were calibrated."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lfportrait.capture import Camera, Capture
from lfportrait.errors import UserError
from lfportrait.files import write_image

from .test_camera import rig
from .test_capture import MARKER, TO_NERF, spot, spot_error

COUNT = 5
# EXIF's number, and quarter turns (counter-clockwise) from the upright picture to the stored one.
HELD = [(1, 0), (6, 1), (3, 2), (8, 3)]
BACK = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def upright(size: tuple[int, int] = (80, 60)) -> Camera:
    cameras = rig(3, COUNT)
    return Camera(cameras.pose, np.full((COUNT, 2), 110.0),
                  np.tile([size[0] / 2 + 3, size[1] / 2 - 2], (COUNT, 1)),
                  np.full(COUNT, size[0]), np.full(COUNT, size[1]))


def store(path: Path, picture: np.ndarray, number: int, turns: int) -> None:
    """As a phone stores it: the sensor's pixels and a note."""
    exif = Image.Exif()
    exif[0x0112] = number
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.ascontiguousarray(np.rot90(picture, turns))).save(path, exif=exif)


def transforms(folder: Path, cameras: Camera, turns: int, sizes: bool = True) -> None:
    """What a program wrote that saw the pictures so many quarter turns from upright."""
    camera = cameras
    pose, center, size = camera.pose, camera.center[0], (camera.width[0], camera.height[0])
    for _ in range(turns):
        pose = pose @ BACK
        center, size = np.array([center[1], size[0] - center[0]]), size[::-1]
    values = {"fl_x": 110, "fl_y": 110, "cx": float(center[0]), "cy": float(center[1])}
    if sizes:
        values |= {"w": int(size[0]), "h": int(size[1])}
    frames = [{"file_path": f"images/{view}.png", "transform_matrix": (one @ TO_NERF).tolist()}
              for view, one in enumerate(pose)]
    (folder / "transforms.json").write_text(json.dumps({**values, "frames": frames}))


def check(folder: Path, cameras: Camera) -> Capture:
    found = Capture.load(folder)
    assert found.images[0].shape[:2] == (cameras.height[0], cameras.width[0])
    wanted = cameras.transformed(found.frame)
    assert np.allclose(found.cameras.pose, wanted.pose, atol=1e-6)
    assert np.allclose(found.cameras.center, wanted.center, atol=1e-6)
    assert spot_error(found, MARKER) < 0.5
    return found


# Nothing tells a half turn: stored pixels are meant.
@pytest.mark.parametrize(("number", "turns", "calibrated"), [
    (*held, kind) for held in HELD for kind in ("stored", "upright", "unsaid")
    if kind != "upright" or held[1] != 2])
def test_either_kind_of_pixels_may_be_calibrated(tmp_path, number, turns, calibrated):
    cameras = upright()
    for view in range(COUNT):
        store(tmp_path / "images" / f"{view}.png", spot(cameras, view), number, turns)
    transforms(tmp_path, cameras, 0 if calibrated == "upright" else turns,
               sizes=calibrated != "unsaid")
    check(tmp_path, cameras)


def test_square_pictures_are_meant_as_stored(tmp_path):
    cameras = upright((70, 70))
    for view in range(COUNT):
        store(tmp_path / "images" / f"{view}.png", spot(cameras, view), 6, 1)
    transforms(tmp_path, cameras, 1)
    check(tmp_path, cameras)


def test_a_picture_that_was_turned_or_cropped_is_no_picture_that_is_stretched(tmp_path):
    cameras = upright()
    for view in range(COUNT):
        write_image(tmp_path / "images" / f"{view}.png", np.rot90(spot(cameras, view)).copy())
    transforms(tmp_path, cameras, 0)
    with pytest.raises(UserError, match="60 x 80 pixels, its camera 80 x 60"):
        Capture.load(tmp_path)


def test_reduced_copies_are_no_other_shape(tmp_path):
    cameras = upright()
    for view in range(COUNT):
        half = Image.fromarray(spot(cameras, view)).resize((41, 30))
        write_image(tmp_path / "images_2" / f"{view}.png", np.asarray(half))
    transforms(tmp_path, cameras, 0)
    assert len(Capture.load(tmp_path)) == COUNT


# A mask that stands on its head fits a photo without a note.
@pytest.mark.parametrize(("number", "turns", "masked", "noted"), [
    (*held, masked, noted) for held in HELD for masked in ("stored", "upright")
    for noted in (True, False) if noted or masked == "upright" or held[1] != 2])
def test_masks_lie_as_their_photos_do(tmp_path, number, turns, masked, noted):
    """Masks have no notes; a photo may have lost its own, as a museum's may."""
    cameras = upright()
    mask = np.zeros((60, 80), np.uint8)
    mask[8:40, 15:35] = 255
    for view in range(COUNT):
        picture = spot(cameras, view)
        picture[mask > 0] //= 3
        store(tmp_path / "images" / f"{view}.png", picture, *((number, turns) if noted else (1, 0)))
        write_image(tmp_path / "masks" / f"{view}.png",
                    np.ascontiguousarray(np.rot90(mask, turns if masked == "stored" else 0)))
    transforms(tmp_path, cameras, turns if noted else 0)
    alphas = check(tmp_path, cameras).alphas
    assert alphas is not None
    assert all(np.array_equal(alpha, mask) for alpha in alphas)
