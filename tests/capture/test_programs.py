"""Cameras that other programs wrote are the cameras that were written."""

import functools
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lfportrait.capture import Camera, Capture, Lens, is_calibrated
from lfportrait.capture.formats.programs import brown, fisheye, read_metashape
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


def numbers_of(matrix: np.ndarray) -> list[str]:
    return [repr(float(value)) for value in matrix.ravel()]


def meshroom(folder: Path, cameras: Camera, version: tuple[int, ...] = (1, 2, 7)) -> None:
    """All numbers are text; one view is not aligned; the paths are another computer's."""
    late, centred_point = version >= (1, 2, 2), version >= (1, 2, 1)
    lens = {"intrinsicId": "7", "width": "80", "height": "60",
            "principalPoint": ["0.5", "-0.25"] if centred_point else ["40.5", "29.75"],
            "distortionParams": [repr(K1), repr(K2), "0"]}
    if late:
        lens |= {"type": "pinhole", "distortionType": "radialk3", "sensorWidth": "36",
                 "sensorHeight": "27", "focalLength": repr(110 / 80 * 36), "pixelRatio": "1"}
    else:
        lens |= {"type": "radial3",
                 "pxFocalLength": ["110", "110"] if version >= (1, 2, 0) else "110"}
    views = [{"viewId": str(view), "poseId": str(view), "intrinsicId": "7", "width": "80",
              "height": "60", "path": f"D:/somewhere/IMG.{view:02d}.png"}
             for view in range(COUNT)]
    poses = [{"poseId": str(view), "pose": {"transform": {
        "rotation": numbers_of(pose[:3, :3]), "center": numbers_of(pose[:3, 3])}}}
        for view, pose in enumerate(cameras.pose)]
    views.append({**views[0], "viewId": "90", "poseId": "90"})
    (folder / "cameras.sfm").write_text(json.dumps({
        "version": [str(part) for part in version], "featuresFolders": [""], "views": views,
        "intrinsics": [lens], "poses": poses}))


def meshroom_of_old(folder: Path, cameras: Camera) -> None:
    meshroom(folder, cameras, (1, 0, 0))
    (folder / "cameras.sfm").rename(folder / "sfm.json")


def openmvg(folder: Path, cameras: Camera) -> None:
    """As cereal writes it: a class is named where it is used first."""
    views = [{"key": view, "value": {"polymorphic_id": 1073741824, "ptr_wrapper": {
        "id": 2147483649 + view, "data": {
            "local_path": "", "filename": f"IMG.{view:02d}.png", "width": 80, "height": 60,
            "id_view": view, "id_intrinsic": view % 2, "id_pose": view}}}}
        for view in range(COUNT)]
    lenses = [{"key": number, "value": {
        "polymorphic_id": 2147483649 if number == 0 else 1,
        **({"polymorphic_name": "pinhole_radial_k3"} if number == 0 else {}),
        "ptr_wrapper": {"id": 2147483700 + number, "data": {
            "value0": {"width": 80, "height": 60, "focal_length": 110.0,
                       "principal_point": [40.5, 29.75]}, "disto_k3": [K1, K2, 0.0]}}}}
        for number in range(2)]
    poses = [{"key": view, "value": {"rotation": pose[:3, :3].T.tolist(),
                                     "center": pose[:3, 3].tolist()}}
             for view, pose in enumerate(cameras.pose)]
    (folder / "sfm_data.json").write_text(json.dumps({
        "sfm_data_version": "0.3", "root_path": "/elsewhere", "views": views,
        "intrinsics": lenses, "extrinsics": poses}))


def reality_capture(folder: Path, cameras: Camera) -> None:
    rows = ["#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"]
    for view, pose in enumerate(cameras.pose):
        turn = pose[:3, :3] @ np.diag([1.0, -1, -1])
        angles = Rotation.from_matrix(turn).as_euler("ZXY", degrees=True) * [-1, 1, 1]
        numbers = [*pose[:3, 3], *angles, 110 * 36 / 80, 0.5 / 80, -0.25 / 80, K1, K2, 0, 0, P1, P2]
        rows.append(",".join([f"IMG.{view:02d}.png", *(repr(float(one)) for one in numbers)]))
    (folder / "registration.csv").write_text("\ufeff" + "\n".join(rows) + "\n", encoding="utf-8")


WRITERS = [
    (meshroom, {"k1": K1, "k2": K2, "cx": 40.5, "cy": 29.75}),
    (meshroom_of_old, {"k1": K1, "k2": K2, "cx": 40.5, "cy": 29.75}),
    (openmvg, {"k1": K1, "k2": K2, "cx": 40.5, "cy": 29.75}),
    (reality_capture, {"k1": K1, "k2": K2, "p1": P1, "p2": P2, "cx": 40.5, "cy": 29.75}),
    (metashape, {"k1": K1, "k2": K2, "p1": P1, "p2": P2, "cx": 40.5, "cy": 29.75}),
    (bundler, {"k1": K1, "k2": K2}), (visualsfm, {})]


@pytest.mark.parametrize(("write", "lens"), WRITERS)
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
                if path.suffix in (".xml", ".out", ".nvm", ".sfm", ".json", ".csv"))
    assert len(Capture.load(file)) == COUNT
    if not lens:
        assert spot_error(found, MARKER) < 0.3


@functools.cache  # its photos are read, too
def real_cameras(shared_data):
    return Capture.load(shared_data / "lee_photos").cameras[np.arange(COUNT)]


@pytest.mark.data
@pytest.mark.parametrize(("write", "lens"), WRITERS)
def test_a_real_heads_cameras_are_those_that_were_written(tmp_path, shared_data, write, lens):
    real = real_cameras(shared_data)
    like = centred()
    cameras = Camera(real.pose, like.focal, like.center, like.width, like.height)
    wanted = reference(tmp_path / "plain", cameras, **lens)
    photos(tmp_path / "set", cameras)
    write(tmp_path / "set", cameras)
    found = Capture.load(tmp_path / "set")
    for name in ("pose", "focal", "center"):
        assert np.allclose(getattr(found.cameras, name), getattr(wanted.cameras, name), atol=1e-6)


def test_photos_of_several_folders_keep_their_own_cameras(tmp_path):
    """Two cameras count their photos alike: left/0001.png and right/0001.png."""
    cameras = centred()
    meshroom(tmp_path, cameras)
    text = (tmp_path / "cameras.sfm").read_text()
    for view in range(COUNT):
        name = f"{'left' if view < COUNT // 2 else 'right'}/{view % (COUNT // 2):04d}.png"
        write_image(tmp_path / "images" / name, spot(cameras, view))
        text = text.replace(f"IMG.{view:02d}.png", name)
    (tmp_path / "cameras.sfm").write_text(text)
    found = Capture.load(tmp_path)
    assert sorted(found.names) == [f"{side}_{number:04d}.png" for side in ("left", "right")
                                   for number in range(COUNT // 2)]
    assert spot_error(found, MARKER) < 1.0


def test_the_largest_of_metashapes_components_is_taken(tmp_path):
    cameras = centred()
    photos(tmp_path, cameras)
    metashape(tmp_path, cameras)
    file = tmp_path / "cameras.xml"
    text = file.read_text()
    chunk = text[text.index("<transform><rotation>"):text.index("</chunk>")]
    text = text.replace(chunk, "").replace("<cameras>", "<components>" + "".join(
        f'<component id="{number}">{chunk}</component>' for number in range(2))
        + "</components><cameras>")
    for view in range(COUNT):
        text = text.replace(f'camera id="{view}"',
                            f'camera id="{view}" component_id="{int(view < 2)}"')
    file.write_text(text)
    with pytest.warns(UserWarning, match="2 components"):
        found = Capture.load(tmp_path)
    assert found.names == [f"IMG.{view:02d}.png" for view in range(2, COUNT)]
    assert spot_error(found, MARKER) < 1.0


def test_a_fourth_radial_term_belongs_to_the_eighth_power():
    """Alone, k4 = 0.2 moves (0.5, 0) by 0.5 * 0.2 * 0.5^8; turned and resized lenses follow."""
    lens = brown(Lens(400, 300, (350.0, 350.0), (200.0, 150.0)), (0.0, 0.0, 0.0, 0.2))
    assert lens.distorts
    assert np.allclose(lens.distort(np.array([0.5, 0.0])), [0.5 * (1 + 0.2 * 0.5 ** 8), 0],
                       atol=1e-15)
    k = (-0.12, 0.04, -0.02, 0.9)
    lens = brown(Lens(400, 300, (350.0, 350.0), (201.0, 150.0), p=(0.01, -0.02)), k)
    points = np.random.default_rng(1).uniform(-0.9, 0.9, (200, 2))
    r2 = (points ** 2).sum(1, keepdims=True)
    x, y = points.T
    tangential = np.stack([2 * 0.01 * x * y - 0.02 * (r2[:, 0] + 2 * x * x),
                           0.01 * (r2[:, 0] + 2 * y * y) - 2 * 0.02 * x * y], axis=1)
    wanted = points * (1 + sum(term * r2 ** (n + 1) for n, term in enumerate(k))) + tangential
    assert np.allclose(lens.distort(points), wanted, atol=1e-12)
    clockwise = np.stack([-points[:, 1], points[:, 0]], axis=1)
    turned = lens.turned().distort(clockwise)
    assert np.allclose(turned, np.stack([-wanted[:, 1], wanted[:, 0]], axis=1), atol=1e-12)
    assert np.allclose(lens.resized(40, 30).distort(points), wanted, atol=1e-12)


def test_metashapes_fisheye_keeps_its_tangential_terms():
    """Of the bent coordinates, by the manual's formulas for fisheye cameras."""
    k, p1, p2 = (0.05, -0.02, 0.01, 0.004), 0.01, -0.02
    points = np.random.default_rng(2).uniform(-1.5, 1.5, (100, 2))
    reach = np.sqrt((points ** 2).sum(1, keepdims=True))
    flat = points * np.arctan(reach) / reach
    x, y = flat.T
    r2 = (flat ** 2).sum(1)
    radial = 1 + sum(term * r2 ** (n + 1) for n, term in enumerate(k))
    # Metashape: x' = x radial + p1 (r^2 + 2 x^2) + 2 p2 x y.
    wanted = np.stack([x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y,
                       y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y], axis=1)
    lens = fisheye(Lens(400, 300, (350.0, 350.0), (200.0, 150.0), p=(p2, p1)), k)
    assert np.allclose(lens.distort(points), wanted, atol=1e-12)


@pytest.mark.parametrize("k4", [0.0, 3.0])
def test_one_lens_is_the_same_by_every_programs_file(tmp_path, monkeypatch, k4):
    noise = np.random.default_rng(1).integers(0, 256, (60, 80, 3), np.uint8)
    monkeypatch.setitem(globals(), "spot", lambda cameras, view: noise)
    cameras = centred()
    wanted = reference(tmp_path / "plain", cameras, k1=K1, k2=K2, k3=0.02, k4=k4, p1=P1, p2=P2,
                       cx=40.5, cy=29.75)
    straight = reference(tmp_path / "straight", cameras, k1=K1, k2=K2, k3=0.02, p1=P1, p2=P2,
                         cx=40.5, cy=29.75)
    changed = not np.array_equal(wanted.images[0], straight.images[0])
    assert changed == bool(k4)
    for write, old, new in (
            (metashape, "<p1>", f"<k3>0.02</k3><k4>{k4}</k4><p1>"),
            (reality_capture, f",{K2},0.0,0.0,", f",{K2},0.02,{k4},")):
        folder = tmp_path / write.__name__
        photos(folder, cameras)
        write(folder, cameras)
        file = next(path for path in folder.iterdir() if path.suffix in (".xml", ".csv"))
        text = file.read_text(encoding="utf-8")
        assert old in text
        file.write_text(text.replace(old, new), encoding="utf-8")
        found = Capture.load(folder)
        assert np.allclose(found.cameras.focal, wanted.cameras.focal, atol=1e-9)
        assert all(np.abs(one.astype(int) - other).max() <= 1  # rounded
                   for one, other in zip(found.images, wanted.images))


def rig_of_two(folder: Path, cameras: Camera, nested: bool = False) -> np.ndarray:
    """Metashape's file where every second photo hangs on the one before it; its offset."""
    offset = np.eye(4)
    offset[:3, :3] = Rotation.from_rotvec([0.1, -0.4, 0.2]).as_matrix()
    offset[:3, 3] = 0.3, -0.1, 0.05
    metashape(folder, cameras)
    file = folder / "cameras.xml"
    text = file.read_text(encoding="utf-8")
    for view in range(1, COUNT, 2):
        start = text.index(f'<camera id="{view}"')
        end = text.index("</camera>", start) + len("</camera>")
        slave = f'<camera id="{view}" sensor_id="1" master_id="{view - 1}" label="IMG.{view:02d}"/>'
        text = text[:start] + ("" if nested else slave) + text[end:]
        if nested:
            end = text.index("</camera>", text.index(f'<camera id="{view - 1}"'))
            text = text[:end] + slave + text[end:]
    numbers = " ".join(numbers_of(offset[:3, :3])), " ".join(numbers_of(offset[:3, 3]))
    file.write_text(text.replace(
        '<sensor id="1" type="frame">',
        f'<sensor id="1" type="frame" master_id="0"><rotation>{numbers[0]}</rotation>'
        f"<location>{numbers[1]}</location>"), encoding="utf-8")
    return offset


@pytest.mark.parametrize("nested", [False, True])
def test_photos_of_a_rig_have_the_masters_pose_and_their_sensors(tmp_path, nested):
    cameras = centred()
    photos(tmp_path, cameras)
    offset = rig_of_two(tmp_path, cameras, nested)
    offset[:3, 3] *= 2.5  # the chunk's scale
    placed = {one.name: one.pose for one in read_metashape(tmp_path / "cameras.xml")}
    assert len(placed) == COUNT
    for view in range(COUNT):
        wanted = cameras.pose[view - view % 2] @ (offset if view % 2 else np.eye(4))
        assert np.allclose(placed[f"IMG.{view:02d}"], wanted, atol=1e-9)


@pytest.mark.parametrize(("old", "new"), [("<rotation>", "<turn>"), ('master_id="0"><', "><")])
def test_a_rig_without_geometry_is_said(tmp_path, old, new):
    cameras = centred()
    photos(tmp_path, cameras)
    rig_of_two(tmp_path, cameras)
    file = tmp_path / "cameras.xml"
    text = file.read_text(encoding="utf-8").replace(old, new, 1)
    file.write_text(text.replace("</rotation>", "</turn>", new == "<turn>"), encoding="utf-8")
    with pytest.warns(UserWarning, match=f"3 of {COUNT + 2} photos .* without the rig"):
        assert len(read_metashape(file)) == COUNT // 2


def test_photos_that_are_left_out_are_counted(tmp_path):
    cameras = centred()
    for write, said in ((metashape, "2 of 8 photos in .* switched off and are left out"),
                        (meshroom, "1 of 7 photos in .* are not aligned and are left out"),
                        (bundler, "1 of 7 photos in .* are not aligned and are left out")):
        folder = tmp_path / write.__name__
        photos(folder, cameras)
        write(folder, cameras)
        with pytest.warns(UserWarning, match=said) as told:
            Capture.load(folder)
        assert len(told) == 1
    photos(tmp_path, cameras)
    openmvg(tmp_path, cameras)
    file = tmp_path / "sfm_data.json"
    data = json.loads(file.read_text())
    del data["extrinsics"][4]
    file.write_text(json.dumps(data))
    with pytest.warns(UserWarning, match="1 of 6 photos in .* are not aligned and are left out"):
        assert len(Capture.load(tmp_path)) == 5


def test_only_visualsfms_first_model_is_read_and_that_is_said(tmp_path):
    cameras = centred()
    photos(tmp_path, cameras)
    visualsfm(tmp_path, cameras)
    file = tmp_path / "model.nvm"
    text = file.read_text()
    line = text.splitlines()[3]
    point = "0.1 0.2 0.3 9 9 9 1 0 0 5 5"
    head = text[:text.rstrip().rindex("0")]
    file.write_text(f"{head}2\n{point}\n{point}\n\n2\n{line}\n{line}\n1\n{point}\n\n0\n\n"
                    "#the last part of NVM file points to the PLY files\n0\n")
    with pytest.warns(UserWarning, match=f"2 of {COUNT + 2} photos in .*first model's {COUNT}"):
        assert len(Capture.load(tmp_path)) == COUNT
    file.write_text(text.replace("NVM_V3 ", "NVM_V3 FixedK 110 40 110 30 0"))
    with pytest.raises(UserError, match="FixedK"):
        Capture.load(tmp_path)


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
    ("not xml", "can't be read"), ("entities", "entities"), ("skew", "skew"),
    ("p3", "p3"), ("old", "PhotoScan before 1.2"), ("size", "was turned or cropped"),
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
        "p3": text.replace("<f>110", "<p3>0.1</p3><f>110"),
        "old": text.replace("<f>110</f>", "<fx>110</fx><fy>110</fy>"),
        "size": text.replace('width="80" height="60"', 'width="60" height="80"'),
        "nothing": text.replace("transform>", "other>"), "cut": text[:-200]}.get(spoil, text))
    with pytest.raises(UserError, match=message) as told:
        Capture.load(tmp_path)
    assert "\n" not in str(told.value)
