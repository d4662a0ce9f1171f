"""Photos and videos in, calibrated captures out; and what is said about bad ones."""

import functools
import json
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from lfportrait.capture import CalibrateConfig, Camera, calibrate, read_source
from lfportrait.capture.photos import read_photos
from lfportrait.errors import UserError
from lfportrait.files import write_image
from lfportrait.progress import Progress

FAST = CalibrateConfig(features=1500, camera_model="SIMPLE_PINHOLE")
ROUGH = replace(FAST, features=700)
"""Where it is enough that photos find each other: half of the work, a quarter of a degree off."""


@functools.cache  # a room's pictures look up the same ones in every view
def texture(seed: int, size: int = 512) -> np.ndarray:
    """A picture full of corners at several scales, float [size, size, 3]."""
    random = np.random.default_rng(seed)
    result = np.zeros((size, size, 3))
    for cell in (64, 16, 6):
        noise = random.uniform(0, 1, (size // cell + 1, size // cell + 1, 3))
        result += np.kron(noise, np.ones((cell, cell, 1)))[:size, :size]
    return ndimage.gaussian_filter(result / 3, (0.8, 0.8, 0))


def looked_up(picture: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A picture's colors [N, 3] at places [N, 2] (row, column)."""
    shape = -(-len(places) // 512), 512  # OpenCV takes no lines of more than 32767
    row, column = (np.resize(axis, shape).astype(np.float32) for axis in places.T)
    return cv2.remap(picture, column, row, cv2.INTER_LINEAR).reshape(-1, 3)[:len(places)]


def room_picture(cameras: Camera, view: int, seed: int = 0, walls: bool = True) -> np.ndarray:
    """What a camera sees of a corner of a room: back wall z = -1, floor y = -1, a box in front.

    Without walls it is black about the box.
    """
    origins, directions = cameras.rays(view)
    image = np.zeros((len(origins), 3))
    nearest = np.full(len(origins), np.inf)
    # (axis, level, extent along the other two axes)
    for number, (axis, level, reach) in enumerate(((2, -1.0, 6.0), (1, -1.0, 6.0), (0, 0.5, 0.5),
                                                   (2, 0.5, 0.5), (1, 0.5, 0.5))):
        if reach > 1 and not walls:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (level - origins[:, axis]) / directions[:, axis]
        points = origins + distance[:, None] * directions
        others = [i for i in range(3) if i != axis]
        hit = (distance > 0) & (distance < nearest) & (np.abs(points[:, others]) < reach).all(1)
        if not hit.any():
            continue
        nearest[hit] = distance[hit]
        place = ((points[hit][:, others] + reach) / (2 * reach) * (4 if reach > 1 else 1) % 1) * 511
        image[hit] = looked_up(texture(10 * seed + number), place)
    shape = int(cameras.height[view]), int(cameras.width[view]), 3
    return np.uint8(np.clip(image.reshape(shape), 0, 1) * 255)


def room_cameras(count: int, width: int = 360, height: int = 270) -> Camera:
    yaw = np.radians(np.linspace(-5, 50, count))
    away = 4 * np.stack([np.sin(yaw), 0.35 + 0.1 * np.cos(3 * yaw), np.cos(yaw)], 1)
    return Camera.look_at(away, np.zeros(3), width=width, height=height, focal=1.2 * width)


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Camera]:
    folder = tmp_path_factory.mktemp("room")
    cameras = room_cameras(8)
    for view in range(len(cameras)):
        write_image(folder / f"photo{view}.jpg", room_picture(cameras, view), quality=95)
    return folder, cameras


def pose_errors(found: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (degrees) and position errors (share of the distance) after a similarity fit.

    The frames are turned onto each other by the cameras' own rotations: places on an arc leave a
    turn about its chord open, by ten times their errors.
    """
    a, b = found[:, :3, 3], true[:, :3, 3]
    u, _, vt = np.linalg.svd(np.einsum("vij,vkj->ik", true[:, :3, :3], found[:, :3, :3]))
    rotation = u @ vt
    turned = (a - a.mean(0)) @ rotation.T
    scale = (turned * (b - b.mean(0))).sum() / (turned**2).sum()
    moved = scale * turned + b.mean(0)
    turn = np.einsum("vij,vik->vjk", rotation @ found[:, :3, :3], true[:, :3, :3])
    angle = np.degrees(np.arccos(np.clip((np.trace(turn, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    return angle, np.linalg.norm(moved - b, axis=1) / np.linalg.norm(b, axis=1)


def test_cameras_of_a_rendered_room_are_recovered(room: tuple[Path, Camera]) -> None:
    folder, cameras = room
    capture = calibrate(folder, FAST)
    assert capture.names == [f"photo{view}.jpg" for view in range(8)]
    angle, position = pose_errors(capture.cameras.pose, cameras.pose)
    assert np.median(angle) < 0.1
    assert np.median(position) < 0.003
    assert np.allclose(capture.cameras.focal, 1.2 * 360, rtol=0.02)
    assert capture.figures["registered"] == capture.figures["photos"] == 8
    assert capture.figures["reprojection_error_px"] < 1
    # In the portrait frame: upright, the cameras in front, what they look at in the middle.
    assert (-capture.cameras.pose[:, :3, 1]).mean(0)[1] > 0.8
    assert capture.cameras.position.mean(0)[2] > 1
    middle = capture.cameras.project(np.zeros((1, 3)))[0][:, 0]
    assert np.abs(middle - [180, 135]).max() < 15


@pytest.mark.slow  # by points: calibration/test_head_motion.py
def test_a_camera_that_stands_still_before_what_turns(tmp_path: Path,
                                                       capsys: pytest.CaptureFixture[str]) -> None:
    cameras = room_cameras(6, 400, 400)
    behind = np.uint8(texture(99)[:400, :400] * 255)
    for view in range(len(cameras)):
        box = room_picture(cameras, view, walls=False)
        write_image(tmp_path / f"{view}.jpg", np.where(box.any(-1, keepdims=True), box, behind),
                    quality=95)
    capture = calibrate(tmp_path, ROUGH, Progress("calibrate"))
    assert "the camera did not move" in capsys.readouterr().err
    angle, position = pose_errors(capture.cameras.pose, cameras.pose)
    assert len(angle) == 6
    assert np.median(angle) < 0.5
    assert np.median(position) < 0.02


@pytest.mark.slow  # calibrates once more
def test_the_same_photos_give_the_same_cameras(room: tuple[Path, Camera],
                                               tmp_path: Path) -> None:
    for view in range(5):
        shutil.copy(room[0] / f"photo{view}.jpg", tmp_path)
    first, second = calibrate(tmp_path, ROUGH), calibrate(tmp_path, ROUGH)
    assert len(first) == 5
    assert np.array_equal(first.cameras.pose, second.cameras.pose)
    assert np.array_equal(first.cameras.focal, second.cameras.focal)
    assert first.figures == second.figures


@pytest.mark.slow  # calibrates once more
def test_a_stranger_among_the_photos_is_left_out(room: tuple[Path, Camera],
                                                 tmp_path: Path) -> None:
    shutil.copytree(room[0], tmp_path / "photos")
    write_image(tmp_path / "photos" / "a_stranger.png", texture(99)[:270, :360])
    (tmp_path / "photos" / "broken.jpg").write_bytes(b"\xff\xd8\xff\xe0 no more")
    with pytest.warns(UserWarning) as caught:
        # A quite different picture may look blurred beside the others; here it is to be tried.
        capture = calibrate(tmp_path / "photos", replace(ROUGH, blur_threshold=0))
    messages = " ".join(str(warning.message) for warning in caught)
    assert "broken.jpg can't be read" in messages
    assert "a_stranger.png" in messages
    assert len(capture) == 8
    assert capture.figures["left_out"] == ["a_stranger.png"]


def test_photos_that_do_not_overlap(tmp_path: Path) -> None:
    for number in range(5):
        write_image(tmp_path / f"{number}.png", texture(20 + number)[:180, :240])
    with pytest.raises(UserError, match=r"do not overlap enough: .* of 5"):
        calibrate(tmp_path, ROUGH)


def test_missing_empty_and_too_few_photos(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="there is no folder"):
        calibrate(tmp_path / "missing")
    with pytest.raises(UserError, match="no photos"):
        calibrate(tmp_path)
    (tmp_path / "notes.txt").write_text("not a photo")
    with pytest.raises(UserError, match="no photos"):
        calibrate(tmp_path)
    for count in (1, 2):
        write_image(tmp_path / f"{count}.png", texture(count, 64))
        with pytest.raises(UserError, match=rf"only {count} usable photo"):
            calibrate(tmp_path)
    with pytest.raises(UserError, match="neither a photo"):
        calibrate(tmp_path / "notes.txt")


def test_unreadable_photos(tmp_path: Path) -> None:
    (tmp_path / "a.heic").write_bytes(b"heic")
    none = r"none of the 1 pictures"
    with pytest.warns(UserWarning, match=r"a\.heic"), pytest.raises(UserError, match=none):
        read_photos(tmp_path)
    (tmp_path / "a.heic").rename(tmp_path / "b.jpg")
    with pytest.warns(UserWarning, match=r"b\.jpg"), pytest.raises(UserError, match=none):
        read_photos(tmp_path)
    good = texture(1, 64)
    write_image(tmp_path / "c.jpg", good)
    (tmp_path / "b.jpg").unlink()
    half = (tmp_path / "c.jpg").read_bytes()
    (tmp_path / "d.jpg").write_bytes(half[:len(half) // 2])
    with pytest.warns(UserWarning, match=r"d\.jpg"):
        assert [photo.name for photo in read_photos(tmp_path)] == ["c.jpg"]


def test_photos_are_turned_upright_reduced_and_keep_their_focal_length(tmp_path: Path) -> None:
    image = np.zeros((40, 80, 3), np.uint8)
    image[:, :40] = (255, 0, 0)
    exif = Image.Exif()
    exif[0x0112] = 6  # the camera was held so that the picture must be turned clockwise
    exif.get_ifd(0x8769)[0xA405] = 54
    Image.fromarray(image).save(tmp_path / "a.png", exif=exif)
    photo, = read_photos(tmp_path, max_side=40)
    assert photo.image.shape == (40, 20, 3)
    assert photo.image[5, 10, 0] > 200
    assert photo.image[35, 10, 0] < 50
    assert photo.focal == pytest.approx(54 / 36 * 40)
    assert read_source(tmp_path)[0].image.shape == (80, 40, 3)


def test_of_equal_stems_one_is_taken(tmp_path: Path) -> None:
    """A capture stores every picture as STEM.png, and twins would be held out beside themselves."""
    for suffix in ("jpg", "png"):
        write_image(tmp_path / f"a.{suffix}", texture(1, 32))
    with pytest.warns(UserWarning, match="another format"):
        names = [photo.name for photo in read_photos(tmp_path)]
    assert names == ["a.jpg"]


@pytest.mark.slow  # a rendered room is calibrated above
def test_photos_of_a_phone_held_both_ways_share_their_lens(room: tuple[Path, Camera],
                                                           tmp_path: Path) -> None:
    """HEIC and JPEG, upright by their note (EXIF) or by a program that forgot it."""
    pillow_heif = pytest.importorskip("pillow_heif")
    pillow_heif.register_heif_opener()
    for view in range(8):
        picture = Image.open(room[0] / f"photo{view}.jpg")
        exif = Image.Exif()
        if view in (1, 2):
            exif[0x0112] = 6  # the phone was held upright, its sensor's picture lies on its side
        elif view == 5:
            picture = picture.transpose(Image.Transpose.ROTATE_270)
        if view % 2:
            picture.save(tmp_path / f"photo{view}.heic", exif=exif.tobytes(), quality=95)
        else:
            picture.save(tmp_path / f"photo{view}.jpg", exif=exif, quality=95)
    capture = calibrate(tmp_path, ROUGH)
    assert capture.figures["registered"] == 8
    assert capture.figures["lenses"] == 1
    assert [image.shape[:2] for image in capture.images] == [
        (360, 270) if view in (1, 2, 5) else (270, 360) for view in range(8)]
    true = room[1].pose.copy()
    turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # their pictures are turned clockwise
    true[[1, 2, 5], :3, :3] = true[[1, 2, 5], :3, :3] @ turn
    angle, position = pose_errors(capture.cameras.pose, true)
    assert angle.max() < 0.5
    assert position.max() < 0.02
    assert np.ptp(capture.cameras.focal) < 1e-6


@pytest.mark.slow  # a rendered room is calibrated above
@pytest.mark.data
def test_cameras_of_real_looking_photos(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "lee_photos"
    data = json.loads((source / "transforms_train.json").read_text())
    true = {Path(frame["file_path"]).name: np.array(frame["transform_matrix"])
            for frame in data["frames"]}
    for name in sorted(true)[20:40:2]:
        shutil.copy(source / "images" / name, tmp_path / name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        capture = calibrate(tmp_path, CalibrateConfig(max_side=640, features=2500))
    assert len(capture) == 10
    poses = np.array([true[name] for name in capture.names]) @ np.diag([1.0, -1, -1, 1])
    angle, position = pose_errors(capture.cameras.pose, poses)
    assert np.median(angle) < 0.2
    assert np.median(position) < 0.005
