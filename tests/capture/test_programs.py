"""Cameras that other programs wrote are the cameras that were written."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lfportrait.capture import Camera, Capture, is_calibrated
from lfportrait.errors import UserError
from lfportrait.files import write_image

from .test_camera import rig
from .test_capture import MARKER, TO_NERF, spot, spot_error

COUNT = 6
K1, K2, P1, P2 = -0.08, 0.03, 0.002, -0.003


def centred(seed: int = 3) -> Camera:
    cameras = rig(seed, COUNT)
    focal = np.full((COUNT, 2), 110.0)
    return Camera(cameras.pose, focal, np.tile([40.0, 30.0], (COUNT, 1)), np.full(COUNT, 80),
                  np.full(COUNT, 60))


def photos(folder: Path, cameras: Camera, suffix: str = ".png") -> None:
    for view in range(COUNT):
        write_image(folder / "images" / f"IMG.{view:02d}{suffix}", spot(cameras, view))


def reference(folder: Path, cameras: Camera, **lens: float) -> Capture:
    """The same cameras by way of a transforms.json."""
    photos(folder, cameras)
    frames = [{"file_path": f"images/IMG.{view:02d}.png",
               "transform_matrix": (cameras.pose[view] @ TO_NERF).tolist()}
              for view in range(COUNT)]
    values = {"fl_x": 110, "fl_y": 110, "cx": 40, "cy": 30, "w": 80, "h": 60, **lens}
    (folder / "transforms.json").write_text(json.dumps({**values, "frames": frames}))
    return Capture.load(folder)


def metashape(folder: Path, cameras: Camera) -> None:
    """Two chunks' worth of traps: labels without suffix, a chunk's transform, unaligned cameras."""
    turn, shift, scale = Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix(), [1.0, 2.0, 3.0], 2.5
    rows = []
    for view in range(COUNT):
        local = np.eye(4)
        local[:3, :3] = turn.T @ cameras.pose[view, :3, :3]
        local[:3, 3] = turn.T @ (cameras.pose[view, :3, 3] - shift) / scale
        numbers = " ".join(map(repr, local.ravel().tolist()))
        rows.append(f'<camera id="{view}" sensor_id="{view % 2}" label="IMG.{view:02d}">'
                    f"<transform>{numbers}</transform></camera>")
    rows.append('<camera id="90" sensor_id="0" label="not aligned"/>')
    rows.append('<camera id="91" sensor_id="0" label="off" enabled="0"><transform>'
                + " ".join("1" * 16) + "</transform></camera>")
    size = '<resolution width="80" height="60"/>'
    lens = (f"<f>110</f><cx>0.5</cx><cy>-0.25</cy><k1>{K1}</k1><k2>{K2}</k2><p1>{P2}</p1>"
            f"<p2>{P1}</p2>")
    sensors = "".join(
        f'<sensor id="{number}" type="frame">{size}<calibration type="frame" class="initial">{size}'
        f'<f>999</f></calibration><calibration type="frame" class="adjusted">{size}{lens}'
        "</calibration></sensor>" for number in range(2))
    (folder / "cameras.xml").write_text(
        f'<?xml version="1.0" encoding="UTF-8"?><document version="2.0.0"><chunk label="1">'
        f"<sensors>{sensors}</sensors><cameras>{''.join(rows)}</cameras><transform>"
        f"<rotation>{' '.join(map(repr, turn.ravel().tolist()))}</rotation>"
        f"<translation>1 2 3</translation><scale>{scale}</scale></transform></chunk></document>")


def bundler(folder: Path, cameras: Camera) -> None:
    rows = ["# Bundle file v0.3", f"{COUNT + 1} 0", *["0 0 0", *["0 0 0"] * 4]]
    for pose in cameras.pose:
        matrix = np.diag([1.0, -1, -1, 1]) @ np.linalg.inv(pose)
        rows += [f"110 {K1} {K2}", *(" ".join(map(repr, row[:3].tolist())) for row in matrix[:3]),
                 " ".join(map(repr, matrix[:3, 3].tolist()))]
    (folder / "bundle.out").write_text("\n".join(rows) + "\n")
    names = ["images/lost.jpg", *(f"images/IMG.{view:02d}.png 0 110" for view in range(COUNT))]
    (folder / "list.txt").write_text("\n".join(names) + "\n")


def visualsfm(folder: Path, cameras: Camera) -> None:
    rows = ["NVM_V3 ", "", str(COUNT)]
    for view, pose in enumerate(cameras.pose):
        x, y, z, w = Rotation.from_matrix(pose[:3, :3].T).as_quat()
        numbers = " ".join(map(repr, [110.0, *map(float, (w, x, y, z)),
                                      *pose[:3, 3].tolist(), 0.0, 0]))
        rows.append(f"images\\img.{view:02d}.PNG\t{numbers}")
    (folder / "model.nvm").write_text("\n".join([*rows, "", "0", ""]))


@pytest.mark.parametrize(("write", "lens"), [
    (metashape, {"k1": K1, "k2": K2, "p1": P1, "p2": P2, "cx": 40.5, "cy": 29.75}),
    (bundler, {"k1": K1, "k2": K2}), (visualsfm, {})])
def test_cameras_are_those_that_were_written(tmp_path, write, lens):
    cameras = centred()
    wanted = reference(tmp_path / "plain", cameras, **lens)
    photos(tmp_path / "set", cameras)
    write(tmp_path / "set", cameras)
    assert is_calibrated(tmp_path / "set")
    found = Capture.load(tmp_path / "set")
    assert found.names == wanted.names
    for name in ("pose", "focal", "center", "width", "height"):
        assert np.allclose(getattr(found.cameras, name), getattr(wanted.cameras, name), atol=1e-6)
    assert all(np.array_equal(one, other) for one, other in zip(found.images, wanted.images))
    file = next(path for path in (tmp_path / "set").iterdir()
                if path.suffix in (".xml", ".out", ".nvm"))
    assert len(Capture.load(file)) == COUNT
    if not lens:
        assert spot_error(found, MARKER) < 0.3


def test_visualsfms_distortion_is_undone(tmp_path):
    """Its one term straightens; ours bend."""
    from lfportrait.capture.formats.programs import _undoing

    for radial in (-0.15, 0.05, 0.2):
        bent = np.linspace(0, 0.65, 50)
        straight = bent * (1 + radial * bent ** 2)
        k = _undoing(radial)
        again = straight * (1 + sum(term * straight ** (2 * n + 2) for n, term in enumerate(k)))
        assert np.abs(again - bent).max() < 1e-3
    assert _undoing(0.0) == ()


@pytest.mark.parametrize(("spoil", "message"), [
    ("not xml", "can't be read"), ("entities", "entities"), ("skew", "skew"), ("size", "turn the"),
    ("nothing", "no aligned cameras"), ("photos", "none of the photos"), ("cut", "can't be read")])
def test_what_cannot_be_read_is_one_line(tmp_path, spoil, message):
    cameras = centred()
    photos(tmp_path, cameras)
    metashape(tmp_path, cameras)
    file = tmp_path / "cameras.xml"
    text = file.read_text()
    if spoil == "photos":
        for path in (tmp_path / "images").iterdir():
            path.rename(path.with_name(f"x{path.name}"))
    file.write_text({
        "not xml": "hello", "entities": text.replace("<document", "<!DOCTYPE x><document"),
        "skew": text.replace("<f>110", "<b2>0.1</b2><f>110"),
        "size": text.replace('width="80" height="60"', 'width="60" height="80"'),
        "nothing": text.replace("transform>", "other>"), "cut": text[:-200]}.get(spoil, text))
    with pytest.raises(UserError, match=message) as told:
        Capture.load(tmp_path)
    assert "\n" not in str(told.value)
