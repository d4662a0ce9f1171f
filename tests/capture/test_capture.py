"""Captures on disk, and the calibrated data sets that can be read."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.capture import Camera, Capture, Lens, is_calibrated, undistort
from lfportrait.capture.formats.colmap import lens_of, read_model
from lfportrait.errors import UserError
from lfportrait.files import write_image
from lfportrait.media.pictures import read_image

from .test_camera import random_similarity, rig

TO_NERF = np.diag([1.0, -1.0, -1.0, 1.0])
MARKER = np.array([[0.31, -0.12, 0.23]])  # a point with a bright spot at its place in the pictures


def spot(cameras: Camera, view: int, point: np.ndarray = MARKER, radius: float = 3.0) -> np.ndarray:
    """Picture [H, W, 3] of a red spot at the projection of a world point on dark blue."""
    (x, y), = cameras[view].project(point)[0][0]
    columns, rows = np.meshgrid(np.arange(cameras.width[view]) + 0.5,
                                np.arange(cameras.height[view]) + 0.5)
    image = np.zeros((*rows.shape, 3), np.uint8)
    image[..., 2] = 60
    image[np.hypot(columns - x, rows - y) <= radius] = (255, 0, 0)
    return image


def spot_error(capture: Capture, point: np.ndarray) -> float:
    """Largest distance in pixels between the red spots and a world point's projection."""
    worst = 0.0
    for view, image in enumerate(capture.images):
        weight = np.clip(image[..., 0].astype(float) - 100, 0, None)
        rows, columns = np.indices(weight.shape) + 0.5
        found = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
        wanted = capture.cameras[view].project(point)[0][0, 0]
        worst = max(worst, float(np.linalg.norm(found - wanted)))
    return worst


def make_capture(views: int = 10, alpha: bool = True) -> Capture:
    cameras = rig(4, views)
    random = np.random.default_rng(1)
    images = [spot(cameras, view) for view in range(views)]
    alphas = [random.integers(0, 256, (60, 80), dtype=np.uint8) for _ in range(views)]
    landmarks = random.normal(size=(68, 3))
    landmarks[5] = np.nan
    names = [f"{view:03d}.png" for view in range(views)]
    return Capture(cameras, images, alphas if alpha else None, names,
                   np.arange(views) % 4 == 0, random_similarity(7), landmarks, {"points": 3})


def test_a_capture_is_printed_as_one_line() -> None:
    assert repr(make_capture(4)) == (
        "Capture(Camera(4 views, 80 x 60), 1 held out, mattes, landmarks)")
    bare = replace(make_capture(4, alpha=False), landmarks=None, held_out=np.zeros(4, bool))
    assert repr(bare) == "Capture(Camera(4 views, 80 x 60), 0 held out)"
    cameras = replace(bare.cameras, width=np.array([80, 8, 40, 20]))
    assert repr(cameras) == "Camera(4 views, 8 x 60, 20 x 60, 40 x 60, ...)"


@pytest.mark.parametrize("alpha", [True, False])
def test_saved_captures_come_back_exactly(tmp_path: Path, alpha: bool) -> None:
    capture = make_capture(alpha=alpha)
    capture.save(tmp_path / "capture")
    assert is_calibrated(tmp_path / "capture")
    back = Capture.load(tmp_path / "capture")
    for name in ("pose", "focal", "center", "width", "height"):
        assert np.allclose(getattr(back.cameras, name), getattr(capture.cameras, name),
                           rtol=0, atol=1e-12)
    assert all(map(np.array_equal, back.images, capture.images))
    assert (back.alphas is None) is (capture.alphas is None)
    if alpha:
        assert back.alphas is not None
        assert capture.alphas is not None
        assert all(map(np.array_equal, back.alphas, capture.alphas))
    assert back.names == capture.names
    assert np.array_equal(back.held_out, capture.held_out)
    assert np.array_equal(back.landmarks, capture.landmarks, equal_nan=True)
    assert np.allclose(back.frame, capture.frame, atol=1e-12)
    assert back.figures == {"points": 3}


@pytest.mark.parametrize("alpha", [True, False])
def test_what_is_saved_is_given_as_it_would_be_read(tmp_path: Path, alpha: bool) -> None:
    capture = make_capture(alpha=alpha)
    capture = replace(capture, names=[name.replace("png", "jpg") for name in capture.names],
                      images=[np.asfortranarray(image) for image in capture.images])
    given, read = capture.saved(tmp_path / "capture"), Capture.load(tmp_path / "capture")
    for name in ("pose", "focal", "center", "width", "height"):
        assert np.array_equal(getattr(given.cameras, name), getattr(read.cameras, name))
    for ours, theirs in ((given.images, read.images), (given.alphas or [], read.alphas or [])):
        assert all(map(np.array_equal, ours, theirs))
        assert len(ours) == len(theirs)
        assert {(one.flags.c_contiguous, one.flags.writeable) for one in ours} <= {(True, True)}
    assert given.names == read.names
    assert np.array_equal(given.held_out, read.held_out)
    assert np.array_equal(given.frame, read.frame)
    assert np.array_equal(given.landmarks, read.landmarks, equal_nan=True)
    assert given.figures == read.figures


def test_saving_again_replaces_the_folder_and_leaves_nothing_else(tmp_path: Path) -> None:
    make_capture(10).save(tmp_path / "capture")
    make_capture(4).save(tmp_path / "capture")
    assert len(Capture.load(tmp_path / "capture")) == 4
    assert [path.name for path in tmp_path.iterdir()] == ["capture"]
    assert len(list((tmp_path / "capture" / "images").iterdir())) == 4


def test_saving_where_nothing_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UserError, match="can't write"):
        make_capture(3).save(tmp_path / "file" / "capture")


def test_reframed_moves_cameras_and_landmarks_together() -> None:
    capture = make_capture()
    similarity = random_similarity(3)
    moved = capture.reframed(similarity)
    assert moved.landmarks is not None
    assert capture.landmarks is not None
    before = capture.cameras.project(capture.landmarks[:5])[0]
    assert np.allclose(moved.cameras.project(moved.landmarks[:5])[0], before, atol=1e-6)
    assert np.allclose(moved.frame, similarity @ capture.frame)
    replaced = capture.reframed(similarity, np.zeros((68, 3)))
    assert np.array_equal(replaced.landmarks, np.zeros((68, 3)))


def test_pictures_are_composited_on_the_background() -> None:
    capture = make_capture()
    assert capture.alphas is not None
    alpha = capture.alphas[2][..., None] / 255.0
    expected = capture.images[2] / 255.0 * alpha + 0.25 * (1 - alpha)
    assert np.allclose(capture.image_float(2, 0.25), expected, atol=1e-6)


def write_transforms(folder: Path, cameras: Camera, lens: dict, *, suffix: str = ".png",
                     name: str = "transforms.json", first: int = 0, **frame_extra: object) -> None:
    frames = []
    for view in range(len(cameras)):
        file = f"images/{first + view:03d}"
        write_image(folder / f"{file}.png", spot(cameras, view))
        frames.append({"file_path": f"./{file}{suffix}", **frame_extra,
                       "transform_matrix": (cameras.pose[view] @ TO_NERF).tolist()})
    (folder / name).write_text(json.dumps({**lens, "frames": frames}))


ANGLE = 2 * np.arctan(80 / 2 / 110)


@pytest.mark.parametrize("lens", [
    {"camera_angle_x": ANGLE}, {"fl_x": 110, "fl_y": 110, "cx": 40, "cy": 30, "w": 80, "h": 60},
    {"fl_x": 220, "fl_y": 220, "cx": 80, "cy": 60, "w": 160, "h": 120}])
@pytest.mark.parametrize("suffix", [".png", ""])
def test_transforms_put_world_points_where_the_pictures_show_them(tmp_path: Path, lens: dict,
                                                                  suffix: str) -> None:
    cameras = rig(8, 17)
    write_transforms(tmp_path, cameras, lens, suffix=suffix)
    capture = Capture.load(tmp_path)
    assert np.array_equal(capture.frame, np.eye(4))
    assert spot_error(capture, MARKER) < 0.3
    assert capture.held_out.sum() == 2  # every 8th
    assert Capture.load(tmp_path, holdout=0).held_out.sum() == 0


def test_transforms_in_any_world_come_to_the_portrait_frame(tmp_path: Path) -> None:
    cameras = rig(8, 17)
    similarity = random_similarity(11)
    frames = []
    for view, pose in enumerate(cameras.transformed(similarity).pose):
        write_image(tmp_path / f"{view:02d}.png", spot(cameras, view))
        frames.append({"file_path": f"{view:02d}.png", "fl_x": 110, "fl_y": 110,
                       "transform_matrix": (pose @ TO_NERF).tolist()})
    (tmp_path / "transforms.json").write_text(json.dumps({"aabb_scale": 4, "frames": frames}))
    capture = Capture.load(tmp_path)
    source = MARKER @ similarity[:3, :3].T + similarity[:3, 3]
    assert spot_error(capture, source @ capture.frame[:3, :3].T + capture.frame[:3, 3]) < 0.3
    assert np.linalg.norm(capture.cameras.position, axis=1).max() < 6
    assert (-capture.cameras.pose[:, :3, 1]).mean(0)[1] > 0.9


def test_train_and_test_files_decide_what_is_held_out(tmp_path: Path) -> None:
    cameras = rig(8, 6)
    write_transforms(tmp_path, cameras[:4], {"camera_angle_x": ANGLE}, name="transforms_train.json")
    write_transforms(tmp_path, cameras[4:], {"camera_angle_x": ANGLE}, name="transforms_test.json",
                     first=4)
    capture = Capture.load(tmp_path)
    assert capture.held_out.tolist() == [False] * 4 + [True] * 2
    assert capture.training().tolist() == [0, 1, 2, 3]
    assert capture.testing().tolist() == [4, 5]
    assert len(Capture.load(tmp_path / "transforms_train.json")) == 4


def test_masks_beside_the_pictures_become_alpha(tmp_path: Path) -> None:
    cameras = rig(8, 3)
    write_transforms(tmp_path, cameras, {"camera_angle_x": ANGLE})
    mask = np.zeros((60, 80), np.uint8)
    mask[10:30, 20:50] = 255
    for view in range(3):
        write_image(tmp_path / "masks" / f"{view:03d}.png", mask)
    alphas = Capture.load(tmp_path).alphas
    assert alphas is not None
    assert all(np.array_equal(alpha, mask) for alpha in alphas)
    (tmp_path / "masks").rename(tmp_path / "elsewhere")
    assert Capture.load(tmp_path).alphas is None
    write_transforms(tmp_path, cameras, {"camera_angle_x": ANGLE}, mask_path="elsewhere/001.png")
    assert Capture.load(tmp_path).alphas is not None


def test_damaged_transforms_are_the_users_errors(tmp_path: Path) -> None:
    cameras = rig(8, 3)
    with pytest.raises(UserError, match="no folder or file"):
        Capture.load(tmp_path / "missing")
    with pytest.raises(UserError, match="not a calibrated capture"):
        Capture.load(tmp_path)
    file = tmp_path / "transforms.json"
    file.write_text("{")
    with pytest.raises(UserError, match="not valid JSON"):
        Capture.load(tmp_path)
    file.write_text('{"frames": [{"file_path": "a.png"}]}')
    with pytest.raises(UserError, match="transform_matrix"):
        Capture.load(tmp_path)
    write_transforms(tmp_path, cameras, {})
    with pytest.raises(UserError, match="focal length"):
        Capture.load(tmp_path)
    write_transforms(tmp_path, cameras, {"camera_angle_x": ANGLE})
    (tmp_path / "images" / "001.png").write_bytes(b"no picture")
    with pytest.warns(UserWarning, match=r"001\.png"):
        assert len(Capture.load(tmp_path)) == 2
    for path in (tmp_path / "images").iterdir():
        path.unlink()
    with pytest.warns(UserWarning, match="not there"), pytest.raises(UserError, match="none of"):
        Capture.load(tmp_path)


LENSES = {
    "OPENCV": (110, 112, 41, 29, -0.12, 0.05, 0.004, -0.006),
    "FULL_OPENCV": (110, 112, 41, 29, -0.12, 0.05, 0.004, -0.006, 0.02, 0.01, -0.02, 0.01),
    "OPENCV_FISHEYE": (110, 112, 41, 29, -0.05, 0.02, 0.01, -0.004),
    "SIMPLE_PINHOLE": (110, 41, 29), "PINHOLE": (110, 112, 41, 29),
    "SIMPLE_RADIAL": (110, 41, 29, -0.12), "RADIAL": (110, 41, 29, -0.12, 0.05),
    "SIMPLE_RADIAL_FISHEYE": (110, 41, 29, -0.05), "RADIAL_FISHEYE": (110, 41, 29, -0.05, 0.02),
    "THIN_PRISM_FISHEYE": (110, 112, 41, 29, -0.05, 0.02, 0.004, -0.006, 0.01, -0.004, 0.003,
                           -0.002),
    "FOV": (110, 112, 41, 29, 0.7), "SIMPLE_FISHEYE": (110, 41, 29),
    "FISHEYE": (110, 112, 41, 29),
}


@pytest.mark.parametrize("model", LENSES)
@settings(max_examples=20, deadline=None)
@given(x=st.floats(-0.5, 0.5), y=st.floats(-0.4, 0.4))
def test_lens_models_agree_with_colmap(model: str, x: float, y: float) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    lens = lens_of(model, 80, 60, LENSES[model])
    camera = pycolmap.Camera(model=model, width=80, height=60, params=list(LENSES[model]))
    wanted = camera.img_from_cam(np.array([[x, y, 1.0]]))[0]
    found = lens.distort(np.array([x, y])) * lens.focal + lens.center
    assert np.allclose(found, wanted, atol=1e-8)


@pytest.mark.parametrize("model", ["OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE", "RADIAL",
                                   "THIN_PRISM_FISHEYE"])
def test_undistorted_pictures_show_points_where_the_pinhole_sees_them(model: str) -> None:
    lens = lens_of(model, 240, 180, [3 * p if i < (3 if model == "RADIAL" else 4) else p
                                     for i, p in enumerate(LENSES[model])])
    points = np.array([[x, y] for x in (-0.25, 0.0, 0.28) for y in (-0.2, 0.05, 0.21)])
    columns, rows = np.meshgrid(np.arange(240) + 0.5, np.arange(180) + 0.5)
    for point in points:
        bent = lens.distort(point) * lens.focal + lens.center
        near = np.exp(-((columns - bent[0])**2 + (rows - bent[1])**2) / 18)
        photo = np.uint8(np.repeat(near[..., None] * 255, 3, 2))
        flat, inside = undistort(photo, lens)
        weight = flat[..., 0].astype(float)
        found = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
        assert np.allclose(found, point * lens.pinhole().focal + lens.center, atol=0.3)
        assert inside[int(found[1]), int(found[0])]


def colmap_model(folder: Path, model: str, cameras: Camera, text: bool) -> None:
    """Write a COLMAP model of the cameras by pycolmap."""
    pycolmap = pytest.importorskip("pycolmap")
    reconstruction = pycolmap.Reconstruction()
    reconstruction.add_camera_with_trivial_rig(pycolmap.Camera(
        camera_id=3, model=model, width=80, height=60, params=list(LENSES[model])))
    for view, pose in enumerate(cameras.pose):
        world_to_camera = np.linalg.inv(pose)[:3]
        image = pycolmap.Image(name=f"a photo {view:02d}.png", camera_id=3, image_id=40 - view)
        reconstruction.add_image_with_trivial_frame(image, pycolmap.Rigid3d(world_to_camera))
    folder.mkdir(parents=True)
    if text:
        reconstruction.write_text(folder)
    else:
        reconstruction.write_binary(folder)


@pytest.mark.parametrize("text", [True, False])
@pytest.mark.parametrize("model", LENSES)
def test_colmap_models_are_read_as_pycolmap_wrote_them(tmp_path: Path, model: str,
                                                       text: bool) -> None:
    cameras = rig(3, 5).transformed(random_similarity(2))
    colmap_model(tmp_path / "sparse" / "0", model, cameras, text)
    lenses, images = read_model(tmp_path / "sparse" / "0")
    assert list(lenses) == [3]
    assert lenses[3] == lens_of(model, 80, 60, LENSES[model])
    assert [image.name for image in images] == [f"a photo {view:02d}.png" for view in range(5)]
    assert np.allclose([image.pose for image in images], cameras.pose, atol=1e-9)


@pytest.mark.parametrize("text", [True, False])
def test_colmap_rigs_give_every_photo_its_own_pose(tmp_path: Path, text: bool) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 2, 2, 3
    options.num_points3D = 10
    made = pycolmap.synthesize_dataset(options)
    (made.write_text if text else made.write_binary)(tmp_path)
    _, images = read_model(tmp_path)
    poses = {image.name: image.cam_from_world().inverse().matrix()
             for image in made.images.values()}
    assert len(poses) == len(images) == 12
    assert all(np.allclose(image.pose[:3], poses[image.name], atol=1e-9) for image in images)


@pytest.mark.parametrize("place", ["sparse/0", "sparse", "."])
def test_colmap_data_sets_load_with_their_photos(tmp_path: Path, place: str) -> None:
    cameras = rig(3, 5)
    colmap_model(tmp_path / "set" / place / "model", "SIMPLE_PINHOLE", cameras, False)
    model = tmp_path / "set" / place / "model"
    for path in model.iterdir():
        path.rename(model.parent / path.name)
    pinholes = Camera(cameras.pose, cameras.focal, np.array([41.0, 29.0]), cameras.width,
                      cameras.height)
    for view in range(5):
        write_image(tmp_path / "set" / "images" / f"a photo {view:02d}.png", spot(pinholes, view))
    assert is_calibrated(tmp_path / "set")
    assert spot_error(Capture.load(tmp_path / "set"), MARKER) < 0.3


def test_damaged_colmap_models_are_the_users_errors(tmp_path: Path) -> None:
    cameras = rig(3, 5)
    colmap_model(tmp_path / "a", "PINHOLE", cameras, False)
    with pytest.raises(UserError, match="photos of the COLMAP model"):
        Capture.load(tmp_path / "a")
    data = (tmp_path / "a" / "images.bin").read_bytes()
    (tmp_path / "a" / "images.bin").write_bytes(data[:100])
    with pytest.raises(UserError, match="damaged"):
        Capture.load(tmp_path / "a")
    (tmp_path / "a" / "images.bin").unlink()
    with pytest.raises(UserError, match="missing"):
        Capture.load(tmp_path / "a")
    with pytest.raises(UserError, match="not supported"):
        lens_of("EUCM", 80, 60, (1, 1, 1, 1, 1, 1))
    with pytest.raises(UserError, match="instead of 8"):
        lens_of("OPENCV", 80, 60, (1, 1, 1, 1, 1))


def test_llff_axes_and_reduced_pictures(tmp_path: Path) -> None:
    cameras = rig(3, 5)
    rows = []
    for view, pose in enumerate(cameras.pose):
        matrix = np.stack([pose[:3, 1], pose[:3, 0], -pose[:3, 2], pose[:3, 3],
                           np.array([120.0, 160.0, 220.0])], axis=1)  # for twice the size
        rows.append(np.concatenate([matrix.ravel(), [1.0, 9.0]]))
        write_image(tmp_path / "images_2" / f"{view}.png", spot(cameras, view))
    np.save(tmp_path / "poses_bounds.npy", np.array(rows))
    assert spot_error(Capture.load(tmp_path), MARKER) < 0.3
    (tmp_path / "images_2" / "3.png").unlink()
    with pytest.raises(UserError, match="does not hold as many"):
        Capture.load(tmp_path)
    (tmp_path / "poses_bounds.npy").write_bytes(b"nothing")
    with pytest.raises(UserError, match="not an LLFF"):
        Capture.load(tmp_path)


@pytest.mark.parametrize("matrix", [True, False])
def test_nsvf_intrinsics_and_split(tmp_path: Path, matrix: bool) -> None:
    cameras = rig(3, 6)
    for view, pose in enumerate(cameras.pose):
        name = f"{view // 2}_{view:03d}"
        write_image(tmp_path / "rgb" / f"{name}.png", spot(cameras, view))
        (tmp_path / "pose").mkdir(exist_ok=True)
        np.savetxt(tmp_path / "pose" / f"{name}.txt", pose)
    lines = "110 0 40 0\n0 110 30 0\n0 0 1 0\n0 0 0 1\n" if matrix else "110 40 30 0.\n0 0 0\n1\n"
    (tmp_path / "intrinsics.txt").write_text(lines)
    capture = Capture.load(tmp_path)
    assert spot_error(capture, MARKER) < 0.3
    assert capture.held_out.tolist() == [False, False, True, True, True, True]


@pytest.mark.data
def test_distorted_photos_are_undistorted_on_load(shared_data: Path) -> None:
    capture = Capture.load(shared_data / "fox")
    data = json.loads((shared_data / "fox" / "transforms.json").read_text())
    lens = Lens(540, 960, (data["fl_x"], data["fl_y"]), (data["cx"], data["cy"]), "opencv",
                (data["k1"], data["k2"]), (data["p1"], data["p2"]))
    photo = read_image(shared_data / "fox" / "images" / capture.names[0])
    # A pixel of the pinhole picture has the color of the place where the lens put it.
    corner = np.array([10.5, 945.5])
    flat = (corner - lens.center) / capture.cameras.focal[0]
    place = lens.distort(flat) * lens.focal + lens.center
    assert np.linalg.norm(place - corner) > 1.5
    near = photo[int(place[1]) - 1:int(place[1]) + 2, int(place[0]) - 1:int(place[0]) + 2]
    assert np.abs(capture.images[0][945, 10] - near.mean((0, 1))).max() < 15
