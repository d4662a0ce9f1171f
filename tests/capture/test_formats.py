"""Properties of lenses, and the forms in which cameras come: nerfstudio, LLFF, NSVF, COLMAP."""

import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.capture import Camera, Capture, Lens, is_calibrated, undistort
from lfportrait.capture.formats.assembly import assemble
from lfportrait.capture.formats.colmap import read_model
from lfportrait.capture.formats.transforms import _lens
from lfportrait.errors import UserError
from lfportrait.files import write_image
from lfportrait.media.pictures import read_images

from .test_camera import random_similarity, rig
from .test_capture import ANGLE, MARKER, TO_NERF, colmap_model, spot, spot_error, write_transforms

coefficient = st.floats(-0.2, 0.2)


@settings(max_examples=40, deadline=None)
@given(k=st.lists(coefficient, min_size=6, max_size=6), p=st.tuples(*[st.floats(-0.02, 0.02)] * 2),
       seed=st.integers(0, 1000))
def test_opencv_lenses_agree_with_opencv(k: list, p: tuple, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-0.6, 0.6, (9, 2))
    lens = Lens(100, 80, (90, 95), (48, 41), "opencv", tuple(k), p)
    matrix = np.array([[90, 0, 48], [0, 95, 41], [0, 0, 1.0]])
    wanted, _ = cv2.projectPoints(np.column_stack([points, np.ones(9)]), np.zeros(3), np.zeros(3),
                                  matrix, np.array([*k[:2], *p, *k[2:]]))
    assert np.allclose(lens.distort(points) * lens.focal + lens.center, wanted[:, 0], atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(k=st.lists(coefficient, min_size=4, max_size=4), seed=st.integers(0, 1000))
def test_fisheye_lenses_agree_with_opencv(k: list, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-2, 2, (9, 2))
    lens = Lens(100, 80, (90, 95), (48, 41), "fisheye", tuple(k))
    matrix = np.array([[90, 0, 48], [0, 95, 41], [0, 0, 1.0]])
    wanted, _ = cv2.fisheye.projectPoints(np.column_stack([points, np.ones(9)])[None], np.zeros(3),
                                          np.zeros(3), matrix, np.array(k))
    assert np.allclose(lens.distort(points) * lens.focal + lens.center, wanted[0], atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(k1=st.floats(-0.3, 0.3), k2=st.floats(-0.1, 0.1), wide=st.floats(0.4, 2.0),
       fisheye=st.booleans())
def test_straightened_pictures_show_only_what_the_photo_has(k1: float, k2: float, wide: float,
                                                           fisheye: bool) -> None:
    lens = Lens(60, 40, (60 / wide, 60 / wide), (30.5, 19.0), "fisheye" if fisheye else "opencv",
                (k1, k2))
    straight = lens.pinhole()
    zoom = straight.focal[0] / lens.focal[0]
    assert 1 <= zoom <= 1.5
    assert not straight.distorts or not lens.distorts
    photo = np.full((40, 60, 3), 200, np.uint8)
    picture, inside = undistort(photo, lens)
    assert (picture == 200).all()
    place = lens.source_pixels()
    assert ((place[inside] >= 0) & (place[inside] <= [60, 40])).all()
    if zoom > 1:
        # As little longer as can be, and enough.
        assert inside.all()
        nearly = Lens(60, 40, lens.focal, lens.center, lens.model, lens.k)
        x, y = np.meshgrid(np.arange(60) + 0.5, np.arange(40) + 0.5)
        flat = (np.stack([x, y], -1) - lens.center) / (np.array(lens.focal) * (zoom - 1e-3))
        bent = nearly.distort(flat) * lens.focal + lens.center
        # Beyond where the formula folds back there is no photo, either.
        ladder = np.linspace(0, np.sqrt((flat * flat).sum(-1)).max(), 2000)
        folds = (np.diff(nearly.distort(np.stack([ladder, 0 * ladder], -1))[:, 0]) <= 0).any()
        assert folds or ((bent < 0) | (bent > [60, 40])).any()


def test_where_a_formula_folds_back_the_photo_shows_nothing() -> None:
    # r (1 - 0.3 r^2) grows up to r = 1.054 only.
    lens = Lens(200, 200, (60.0, 60.0), (100.0, 100.0), "opencv", (-0.3,))
    _, inside = undistort(np.zeros((200, 200, 3), np.uint8), lens)
    x, y = np.meshgrid(np.arange(200) + 0.5 - 100, np.arange(200) + 0.5 - 100)
    r = np.hypot(x, y) / lens.pinhole().focal[0]
    assert inside[r < 1.04].all()
    assert not inside[r > 1.06].any()


def bent_picture(cameras: Camera, view: int, lens: Lens) -> np.ndarray:
    """A picture whose spot lies where the lens puts the marker."""
    local = cameras.pose[view, :3, :3].T @ (MARKER[0] - cameras.pose[view, :3, 3])
    x, y = lens.distort(local[:2] / local[2]) * lens.focal + lens.center
    rows, columns = np.indices((lens.height, lens.width)) + 0.5
    image = np.zeros((lens.height, lens.width, 3), np.uint8)
    image[..., 2] = 60
    near = np.clip(4 - np.hypot(columns - x, rows - y), 0, 1)
    image[..., 0] = 255 * near
    return image


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_nerfstudio_frames_with_their_own_lenses(tmp_path_factory: pytest.TempPathFactory,
                                                 seed: int) -> None:
    folder = tmp_path_factory.mktemp("nerfstudio")
    random = np.random.default_rng(seed)
    cameras = rig(seed, 6)
    frames = []
    for view, pose in enumerate(cameras.pose):
        width, height = (int(random.integers(70, 120)) for _ in range(2))
        fisheye = bool(random.integers(2))
        k = random.uniform(-0.15, 0.15, 4 if fisheye else 3)
        p = (0.0, 0.0) if fisheye else tuple(random.uniform(-0.01, 0.01, 2))
        lens = Lens(width, height, tuple(random.uniform(100, 140, 2)),
                    (width / 2 + random.uniform(-3, 3), height / 2 + random.uniform(-3, 3)),
                    "fisheye" if fisheye else "opencv", tuple(k), p)
        write_image(folder / "images" / f"f{view}.png", bent_picture(cameras, view, lens))
        times = float(random.choice([1, 2]))  # the numbers may be those of a larger original
        frames.append({
            "file_path": f"images/f{view}.png", "transform_matrix": (pose @ TO_NERF).tolist(),
            "w": width * times, "h": height * times, "fl_x": lens.focal[0] * times,
            "fl_y": lens.focal[1] * times, "cx": lens.center[0] * times,
            "cy": lens.center[1] * times, "p1": p[0], "p2": p[1],
            "camera_model": "OPENCV_FISHEYE" if fisheye else "OPENCV",
            **{f"k{i + 1}": value for i, value in enumerate(k)}})
    (folder / "transforms.json").write_text(json.dumps({
        "camera_model": "OPENCV", "fl_x": 1.0, "fl_y": 1.0, "frames": frames,
        "applied_transform": [[0, 1, 0, 5], [1, 0, 0, 0], [0, 0, -1, 0]], "applied_scale": 3.0}))
    capture = Capture.load(folder)
    # applied_transform tells where the poses came from; they are in the file's world already.
    assert np.array_equal(capture.frame, np.eye(4))
    assert spot_error(capture, MARKER) < 0.4


def test_masks_are_named_relative_to_the_file_and_may_be_larger(tmp_path: Path) -> None:
    cameras = rig(8, 3)
    write_transforms(tmp_path, cameras, {"camera_angle_x": ANGLE}, mask_path="deep/er/m.png")
    mask = np.zeros((120, 160), np.uint8)
    mask[20:60, 40:100] = 255
    write_image(tmp_path / "deep" / "er" / "m.png", mask)
    alphas = Capture.load(tmp_path).alphas
    assert alphas is not None
    assert all(np.array_equal(alpha, mask[::2, ::2]) for alpha in alphas)
    data = json.loads((tmp_path / "transforms.json").read_text())
    for frame in data["frames"]:  # an absolute picture, a relative mask
        frame["file_path"] = str((tmp_path / frame["file_path"]).resolve())
    (tmp_path / "transforms.json").write_text(json.dumps(data))
    assert Capture.load(tmp_path).alphas is not None
    write_image(tmp_path / "deep" / "er" / "m.png", mask[:80])
    with pytest.raises(UserError, match="not of its picture's size"):
        Capture.load(tmp_path)


def test_files_written_on_windows(tmp_path: Path) -> None:
    write_transforms(tmp_path, rig(8, 4), {"camera_angle_x": ANGLE}, mask_path=".\\masks\\m.png")
    write_image(tmp_path / "masks" / "m.png", np.eye(60, 80, dtype=np.uint8) * 255)
    plain = Capture.load(tmp_path)
    data = json.loads((tmp_path / "transforms.json").read_text())
    for frame in data["frames"]:
        frame["file_path"] = ".\\" + frame["file_path"].removeprefix("./").replace("/", "\\")
    data["test_filenames"] = [data["frames"][1]["file_path"]]
    (tmp_path / "transforms.json").write_text(json.dumps(data), encoding="utf-8-sig")
    capture = Capture.load(tmp_path)
    assert capture.alphas is not None and plain.alphas is not None
    assert sorted(capture.names) == sorted(plain.names) and capture.held_out.sum() == 1
    assert spot_error(capture, MARKER) < 0.3


def test_the_files_own_lists_decide_what_is_held_out(tmp_path: Path) -> None:
    cameras = rig(8, 6)
    write_transforms(tmp_path, cameras, {
        "camera_angle_x": ANGLE,
        "train_filenames": ["./images/000.png"], "val_filenames": ["./images/002.png"],
        "test_filenames": ["./images/005.png"]})
    capture = Capture.load(tmp_path)
    held = [name for name, out in zip(capture.names, capture.held_out) if out]
    assert sorted(held) == ["002.png", "005.png"]


def test_reduced_copies_stand_in_for_missing_pictures(tmp_path: Path) -> None:
    cameras = rig(8, 3)
    write_transforms(tmp_path, cameras, {"fl_x": 440, "fl_y": 440, "w": 320, "h": 240})
    (tmp_path / "images").rename(tmp_path / "images_4")
    assert spot_error(Capture.load(tmp_path), MARKER) < 0.3


@pytest.mark.parametrize(("lens", "message"), [
    ({"camera_model": "EQUIRECTANGULAR", "fl_x": 110}, "EQUIRECTANGULAR are not supported"),
    ({"fl_x": "wide"}, "can't be read"), ({"fl_x": -110}, "is invalid"),
    ({"camera_angle_x": 0.0}, "is invalid"), ({"fl_x": 110, "cx": float("nan")}, "invalid"),
    ({"fl_x": 110, "k1": [1]}, "can't be read"),
    ({"camera_model": "OMNIDIRECTIONALSTEREO_L", "fl_x": 110}, "are not supported"),
    ({"fl_x": 110, "latlong": True}, "latlong"), ({"fl_x": 110, "orthographic": True}, "orthog"),
    ({"fl_x": 110, "ftheta_p0": 0.0, "ftheta_p1": 1e-3}, "ftheta"),
    ({"fl_x": 110, "k7": 0.1}, "lens term k7"), ({"fl_x": 110, "s1": 0.1}, "lens term s1"),
    ({"fl_x": 110, "skew": 0.1}, "lens term skew"),
    ({"fl_x": 110, "k5": 0.1, "camera_model": "OPENCV_FISHEYE"}, "lens term k5"),
    ({"fl_x": 110, "distortion_params": [0.0] * 6 + [0.1]}, "distortion_params")])
def test_impossible_cameras_are_the_users_errors(tmp_path: Path, lens: dict, message: str) -> None:
    write_transforms(tmp_path, rig(8, 3), lens)
    with pytest.raises(UserError, match=message), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        Capture.load(tmp_path)


def lens_in(values: dict, frame: dict | None = None) -> Lens:
    return _lens(frame or {}, {"fl_x": 100.0, "w": 80, "h": 60, **values}, 80, 60)


def test_the_fourth_term_is_nerfstudios_unless_the_model_is_opencvs_full_one() -> None:
    point = np.array([0.5, 0.0])
    for values in ({"k4": 0.2}, {"k4": 0.2, "camera_model": "OPENCV", "k5": 0.0, "s1": 0.0},
                   {"distortion_params": [0, 0, 0, 0.2, 0, 0]}):
        assert np.allclose(lens_in(values).distort(point), [0.5 * (1 + 0.2 * 0.5 ** 8), 0])
    below = 0.5 / (1 + 0.2 * 0.5 ** 2)
    for values in ({"k4": 0.2, "camera_model": "FULL_OPENCV"}, {"k4": 0.2, "k6": 1e-12}):
        assert np.allclose(lens_in(values).distort(point), [below, 0])
    # A frame's own values come before the file's, a zero too.
    assert not lens_in({"k4": 0.2}, {"k4": 0.0}).distorts
    # A fisheye's tangential terms are of the bent coordinates, as nerfstudio has them.
    bent = np.arctan(0.5)
    found = lens_in({"is_fisheye": True, "k4": 0.2, "p2": 0.01}).distort(point)
    assert np.allclose(found, [bent * (1 + 0.2 * bent ** 8) + 3 * 0.01 * bent ** 2, 0])


def test_poses_with_a_scale_are_mended_and_impossible_ones_told() -> None:
    cameras = rig(3, 4)
    lenses = [Lens(80, 60, (110, 110), (40, 30))] * 4
    pictures = [spot(cameras, view) for view in range(4)]
    names = [f"{view}.png" for view in range(4)]
    poses = cameras.pose.copy()
    poses[:, :3, :3] *= 2.5
    capture = Capture(**assemble(poses, lenses, pictures, names, None, 0)._asdict())
    assert np.allclose(capture.cameras.pose, cameras.pose, atol=1e-12)
    for spoil in ("mirror", "shear", "zero", "nan"):
        poses = cameras.pose.copy()
        if spoil == "mirror":
            poses[2, :3, 0] *= -1
        elif spoil == "shear":
            poses[2, :3, 0] += 0.5 * poses[2, :3, 1]
        else:
            poses[2, :3, :3] = 0 if spoil == "zero" else np.nan
        with pytest.raises(UserError, match=r"pose of 2\.png"):
            assemble(poses, lenses, pictures, names, None, 0)


def write_llff(folder: Path, cameras: Camera, width: int, height: int) -> None:
    """``poses_bounds.npy`` for photos of the given full size."""
    focal = 110 * width / 80
    rows = [np.concatenate([np.stack([pose[:3, 1], pose[:3, 0], -pose[:3, 2], pose[:3, 3],
                                      np.array([height, width, focal])], axis=1).ravel(), [1, 9]])
            for pose in cameras.pose]
    np.save(folder / "poses_bounds.npy", np.array(rows))


@pytest.mark.slow  # a large picture
def test_llff_prefers_a_copy_that_is_not_too_large(tmp_path: Path) -> None:
    cameras = rig(3, 16)
    write_llff(tmp_path, cameras, 2560, 1920)
    for factor, name in ((1, "images"), (32, "images_32"), (16, "images_16"), (8, "images_8")):
        width = 2560 // factor
        for view in range(16):
            # The full size holds nothing: it must not be chosen.
            picture = (np.zeros((1920, 2560, 3), np.uint8) if factor == 1
                       else spot(cameras.scaled(width / 80), view, radius=9 / factor * 8))
            write_image(tmp_path / name / f"{view:02d}.jpg", picture, quality=50)
    capture = Capture.load(tmp_path)
    assert capture.cameras.width.tolist() == [320] * 16
    assert spot_error(capture, MARKER) < 0.6
    # Every eighth from the first on, as the published figures have it.
    assert np.flatnonzero(capture.held_out).tolist() == [0, 8]
    for path in (tmp_path / "images_8", tmp_path / "images_16", tmp_path / "images_32"):
        path.rename(tmp_path / f"not_{path.name}")
    assert Capture.load(tmp_path).cameras.width.tolist() == [2560] * 16


@pytest.mark.parametrize("spoil", ["short", "nan", "zero", "flat", "text", "empty"])
def test_damaged_llff_files_are_the_users_errors(tmp_path: Path, spoil: str) -> None:
    cameras = rig(3, 3)
    write_llff(tmp_path, cameras, 80, 60)
    for view in range(3):
        write_image(tmp_path / "images" / f"{view}.png", spot(cameras, view))
    table = np.load(tmp_path / "poses_bounds.npy")
    spoiled = {"short": table[:, :12], "flat": table[0], "empty": table[:0],
               "text": np.full((3, 17), "x"), "nan": table * np.nan,
               "zero": table * (np.arange(17) != 4)}[spoil]
    np.save(tmp_path / "poses_bounds.npy", spoiled)
    with pytest.raises(UserError, match="LLFF camera file"):
        Capture.load(tmp_path)


def write_nsvf(folder: Path, cameras: Camera, rgb: str = "rgb", pose: str = "pose") -> None:
    (folder / pose).mkdir(parents=True)
    for view, matrix in enumerate(cameras.pose):
        write_image(folder / rgb / f"0_{view:03d}.png", spot(rig(3, len(cameras)), view))
        np.savetxt(folder / pose / f"0_{view:03d}.txt", matrix)
    (folder / "intrinsics.txt").write_text("110 0 40 0\n0 110 30 0\n0 0 1 0\n0 0 0 1\n")


@pytest.mark.parametrize("folders", [("rgb", "pose"), ("images", "poses")])
def test_nsvf_boxes_give_the_frame(tmp_path: Path, folders: tuple[str, str]) -> None:
    similarity = random_similarity(5)
    cameras = rig(3, 9).transformed(similarity)
    write_nsvf(tmp_path, cameras, *folders)
    assert is_calibrated(tmp_path)
    corner = similarity[:3, 3]
    low, high = corner - np.array([1.0, 2.0, 3.0]), corner + np.array([3.0, 2.0, 1.0])
    (tmp_path / "bbox.txt").write_text(" ".join(map(str, [*low, *high, 0.4])) + "\n")
    capture = Capture.load(tmp_path)
    middle = capture.frame @ [*(low + high) / 2, 1]
    assert np.allclose(middle[:3], 0, atol=1e-9)
    scale = np.cbrt(np.linalg.det(capture.frame[:3, :3]))
    assert np.isclose(scale, 1 / 2.2)
    source = MARKER @ similarity[:3, :3].T + similarity[:3, 3]
    assert spot_error(capture, source @ capture.frame[:3, :3].T + capture.frame[:3, 3]) < 0.3
    assert capture.held_out.sum() == 0  # nine pictures of the training set, too few to hold out
    for text in ("1 2 3", "0 0 0 1 1 -1", "a b c d e f"):
        (tmp_path / "bbox.txt").write_text(text)
        with pytest.raises(UserError, match="box"):
            Capture.load(tmp_path)


def test_damaged_nsvf_sets_are_the_users_errors(tmp_path: Path) -> None:
    write_nsvf(tmp_path, rig(3, 3))
    (tmp_path / "pose" / "0_001.txt").write_text("1 0 0")
    with pytest.raises(UserError, match=r"0_001\.png"):
        Capture.load(tmp_path)
    (tmp_path / "intrinsics.txt").write_text("focal 110")
    with pytest.raises(UserError, match="camera"):
        Capture.load(tmp_path)
    (tmp_path / "intrinsics.txt").unlink()
    with pytest.raises(UserError, match=r"intrinsics\.txt"):
        Capture.load(tmp_path)


@pytest.mark.parametrize("place", ["sparse", "colmap/sparse", "dense/sparse", "distorted/sparse"])
def test_the_largest_of_several_colmap_models_is_taken(tmp_path: Path, place: str) -> None:
    for number, count in enumerate((2, 5, 3)):
        colmap_model(tmp_path / place / str(number), "PINHOLE", rig(3, count), False)
    for view in range(5):
        write_image(tmp_path / "images" / f"a photo {view:02d}.png",
                    np.zeros((60, 80, 3), np.uint8))
    assert is_calibrated(tmp_path)
    with pytest.warns(UserWarning, match=rf"3 COLMAP models; the largest, {place}/1 with 5 photos"):
        assert len(Capture.load(tmp_path)) == 5


HEAD = "# Image list with two lines of data per image:\n# Number of images: 4, mean: 0\n"
NAMES = ["a photo.png", "12", "ünïcode 1 2.png", "1.0"]
POINTS = "512.25 300.5 17 12 13.5 -1 8 9 10 11 12 13"


def text_model(folder: Path, points: list[str | None], head: str = HEAD, end: str = "\n",
               encoding: str = "utf-8") -> Path:
    """A model of four images; None leaves an image's second line out."""
    rows = []
    for number, (name, second) in enumerate(zip(NAMES, points), 1):
        rows.append(f"{number} 1 0 0 0 {number} 0 0 1 {name}")
        rows += [] if second is None else [second]
    folder.mkdir(exist_ok=True)
    for file, text in (("cameras", "# Cameras\n1 PINHOLE 80 60 110 110 40 30\n"),
                       ("images", head + "\n".join([*rows, ""]))):
        (folder / f"{file}.txt").write_bytes(text.replace("\n", end).encode(encoding))
    return folder


@pytest.mark.parametrize("points", [
    ["", "", "", ""], [None] * 4, [POINTS] * 4, [None, POINTS, "", None], [POINTS, None, None, ""]])
@pytest.mark.parametrize(("end", "encoding"), [("\n", "utf-8"), ("\r\n", "utf-8-sig")])
def test_colmap_texts_may_lack_the_lines_of_points(tmp_path: Path, points: list, end: str,
                                                   encoding: str) -> None:
    _, images = read_model(text_model(tmp_path, points, end=end, encoding=encoding))
    assert [image.name for image in images] == sorted(NAMES)
    assert [-image.pose[0, 3] for image in images] == [NAMES.index(name) + 1
                                                       for name in sorted(NAMES)]


@pytest.mark.parametrize(("points", "head", "message"), [
    ([""] * 4, HEAD.replace("4", "6"), "says that it lists 6 images, but lists 4"),
    (["", "1 2 3 4", "", ""], "", r"line 4 of images\.txt is no image"),
    (["", "1 2 x", "", ""], "", r"line 4 of images\.txt is no image")])
def test_colmap_texts_that_do_not_add_up_are_refused(tmp_path: Path, points: list, head: str,
                                                     message: str) -> None:
    with pytest.raises(UserError, match=message):
        read_model(text_model(tmp_path, points, head))


@pytest.mark.slow  # a process of its own
def test_texts_are_utf8_whatever_the_locale(tmp_path: Path) -> None:
    text_model(tmp_path, [None] * 4)
    code = ("import sys, pathlib; from lfportrait.capture.formats.colmap import read_model; "
            "print(ascii([one.name for one in read_model(pathlib.Path(sys.argv[1]))[1]]))")
    found = subprocess.run(
        [sys.executable, "-X", "utf8=0", "-c", code, str(tmp_path)], check=True, text=True,
        capture_output=True, env={**os.environ, "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"})
    assert found.stdout.strip() == ascii(sorted(NAMES))


def test_nsvf_pictures_and_poses_that_lack_each_other_are_counted(tmp_path: Path) -> None:
    write_nsvf(tmp_path, rig(3, 5))
    (tmp_path / "rgb" / "0_000.png").unlink()
    (tmp_path / "pose" / "0_001.txt").unlink()
    (tmp_path / "pose" / "0_002.txt").unlink()
    with pytest.warns(UserWarning) as told:
        assert len(Capture.load(tmp_path)) == 2
    lines = [str(one.message) for one in told]
    assert lines[0].startswith("2 of 4 photos in ") and lines[1].startswith("1 of 3 cameras in ")
    assert len(lines) == 2


def test_masks_of_colmap_sets_become_alpha(tmp_path: Path) -> None:
    colmap_model(tmp_path / "sparse" / "0", "PINHOLE", rig(3, 5), False)
    mask = np.zeros((60, 80), np.uint8)
    mask[5:40, 30:60] = 255
    for view in range(5):
        name = f"a photo {view:02d}.png"
        write_image(tmp_path / "images" / name, np.zeros((60, 80, 3), np.uint8))
        write_image(tmp_path / "masks" / (f"{name}.png" if view % 2 else name), mask)
    alphas = Capture.load(tmp_path).alphas
    assert alphas is not None
    assert all(np.array_equal(alpha, mask) for alpha in alphas)
    for path in (tmp_path / "images").iterdir():
        path.write_bytes(b"no picture")
    with pytest.warns(UserWarning), pytest.raises(UserError, match="none of the photos"):
        Capture.load(tmp_path)


def test_pictures_come_in_order_and_damaged_ones_as_errors(tmp_path):
    shades = [40, 90, 160, 220]
    paths = [tmp_path / f"{shade}.png" for shade in shades]
    for path, shade in zip(paths, shades):
        write_image(path, np.full((300 - shade, 8, 3), shade, np.uint8))
    paths[2].write_bytes(paths[2].read_bytes()[:60])
    paths.append(tmp_path / "missing.png")
    found = list(read_images(paths))
    for shade, picture in zip(shades, found):
        if shade == 160:
            assert isinstance(picture, UserError) and "160.png" in str(picture)
        else:
            assert picture.shape == (300 - shade, 8, 3) and (picture == shade).all()
    assert isinstance(found[4], UserError) and "no such file" in str(found[4])


def test_channels_that_are_opaque_throughout_are_no_mattes(tmp_path: Path) -> None:
    """Screenshots have them; a matte is transparent somewhere, and all photos have one."""
    colmap_model(tmp_path / "sparse" / "0", "PINHOLE", rig(3, 5), False)
    names = [f"a photo {view:02d}.png" for view in range(5)]
    for name in names:
        write_image(tmp_path / "images" / name, np.full((60, 80, 4), 255, np.uint8))
    assert Capture.load(tmp_path).alphas is None
    matted = np.full((60, 80, 4), 255, np.uint8)
    matted[:20, :, 3] = 0
    write_image(tmp_path / "images" / names[0], matted)
    alphas = Capture.load(tmp_path).alphas
    assert alphas is not None and not alphas[0][:20].any() and alphas[1].all()
    write_image(tmp_path / "images" / names[1], matted[..., :3])
    with pytest.warns(UserWarning, match="4 of 5 photos have an alpha channel"):
        assert Capture.load(tmp_path).alphas is None
