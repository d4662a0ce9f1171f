"""Exports of phones' scanning apps: ARKit's cameras, pictures that lie as the sensor does."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lfportrait.capture import Camera, Capture, is_calibrated
from lfportrait.errors import UserError
from lfportrait.files import write_image

from .test_camera import rig
from .test_capture import MARKER, spot, spot_error
from .test_programs import centred

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
# The pose of a sensor whose picture must be turned clockwise once, from the upright camera's.
SIDEWAYS = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def polycam(folder: Path, cameras: Camera, sideways: bool, kind: str = "corrected_") -> None:
    for view, pose in enumerate(cameras.pose):
        name, picture, size = f"{1000 + view}", spot(cameras, view), (80, 60)
        if sideways:
            picture, size, pose = np.rot90(picture), (60, 80), pose @ SIDEWAYS
        write_image(folder / "keyframes" / f"{kind}images" / f"{name}.jpg",
                    np.ascontiguousarray(picture), quality=98)
        turned = pose @ FLIP
        record = {f"t_{row}{column}": turned[row, column] for row in range(3)
                  for column in range(4)}
        record |= {"fx": 110, "fy": 110, "cx": size[0] / 2, "cy": size[1] / 2, "width": size[0],
                   "height": size[1], "blur_score": 80}
        path = folder / "keyframes" / f"{kind}cameras" / f"{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(record))


def record3d(folder: Path, cameras: Camera, sideways: bool, own: bool = False) -> None:
    size = (60, 80) if sideways else (80, 60)
    poses = []
    for view, pose in enumerate(cameras.pose):
        picture = spot(cameras, view)
        if sideways:
            picture, pose = np.rot90(picture), pose @ SIDEWAYS
        write_image(folder / "rgb" / f"{view}.jpg", np.ascontiguousarray(picture), quality=98)
        poses.append([*Rotation.from_matrix((pose @ FLIP)[:3, :3]).as_quat(), *pose[:3, 3]])
    k = [110.0, 0, 0, 0, 110, 0, size[0] / 2, size[1] / 2, 1]
    data = {"w": size[0], "h": size[1], "fps": 30, "poses": poses,
            "K": [0.0] * 9 if own else k}
    if own:
        data["perFrameIntrinsicCoeffs"] = [[110, 110, size[0] / 2, size[1] / 2]] * len(poses)
    (folder / "metadata").write_text(json.dumps(data))


@pytest.mark.parametrize("sideways", [False, True])
@pytest.mark.parametrize("write", [polycam, record3d])
def test_cameras_are_those_that_were_written_and_pictures_upright(tmp_path, write, sideways):
    cameras = centred()
    write(tmp_path, cameras, sideways)
    assert is_calibrated(tmp_path)
    found = Capture.load(tmp_path)
    assert [picture.shape for picture in found.images] == [(60, 80, 3)] * 6
    assert np.allclose(found.cameras.focal, 110) and np.allclose(found.cameras.center, [40, 30])
    wanted = cameras.transformed(found.frame)
    assert np.allclose(found.cameras.pose, wanted.pose, atol=1e-6)
    assert spot_error(found, MARKER) < 0.5


def test_a_frames_own_lens_comes_before_the_files(tmp_path):
    record3d(tmp_path, rig(3, 6), False, own=True)
    assert np.allclose(Capture.load(tmp_path).cameras.focal, 110)


@pytest.mark.parametrize("spoil", ["missing", "text", "nothing"])
def test_what_cannot_be_read_is_one_line(tmp_path, spoil):
    polycam(tmp_path, centred(), False, "")
    file = next((tmp_path / "keyframes" / "cameras").iterdir())
    data = json.loads(file.read_text())
    if spoil == "missing":
        del data["t_12"]
    elif spoil == "text":
        data["fx"] = "wide"
    else:
        data = []
    file.write_text(json.dumps(data))
    with pytest.raises(UserError, match="can't be read") as told:
        Capture.load(tmp_path)
    assert "\n" not in str(told.value)


def test_pictures_without_cameras_and_cameras_without_pictures_are_counted(tmp_path):
    polycam(tmp_path / "p", centred(), False)
    folder = tmp_path / "p" / "keyframes"
    (folder / "corrected_images" / "1000.jpg").unlink()
    (folder / "corrected_cameras" / "1001.json").unlink()
    record3d(tmp_path / "r", centred(), False)
    (tmp_path / "r" / "rgb" / "5.jpg").rename(tmp_path / "r" / "rgb" / "9.jpg")
    for part, count, cameras in (("p", 5, 5), ("r", 6, 6)):
        with pytest.warns(UserWarning) as told:
            found = Capture.load(tmp_path / part)
        assert len(found) == count - 1
        lines = [str(one.message) for one in told]
        assert len(lines) == 2
        assert lines[0].startswith(f"1 of {count} photos in ") and "have no camera" in lines[0]
        assert lines[1].startswith(f"1 of {cameras} cameras in ") and "have no photo" in lines[1]
