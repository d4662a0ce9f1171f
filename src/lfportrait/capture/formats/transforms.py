"""``transforms.json`` with NeRF's axes: as NeRF, instant-ngp and nerfstudio write it, and our own.

A `Capture` is kept in such a folder, too, with its pictures.
"""

import re
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from ...arrays import UInt8
from ...errors import UserError
from ...files import fresh_folder, read_json, write_image, write_json
from ...measure import usable_cores
from ...media.folders import Finder, visible
from ...media.pictures import read_image
from ...simd.threads import side_by_side
from ..camera import Camera
from ..lenses import Lens, load_depth, save_depth, some_depth
from .assembly import FLIP, CaptureFormat, DataSet, Shot, Views
from .programs import brown, fisheye, is_graph


def transform_files(path: Path) -> list[Path]:
    """The transforms files of a folder, or the one that ``path`` is; none where there are none.

    A JSON file of Meshroom or OpenMVG is none.
    """
    if path.is_file() and path.suffix.lower() == ".json":
        return [] if is_graph(path) else [path]
    if not path.is_dir():
        return []
    own = path / "transforms.json"
    if own.is_file():
        return [own]
    return [file for file in visible(path)
            if file.name.startswith("transforms_") and file.suffix == ".json"]


# Camera models by the names that nerfstudio and COLMAP give them; others are refused.
_PERSPECTIVE = {"", "OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE",
                "FULL_OPENCV"}
_FISHEYE = {"OPENCV_FISHEYE", "FISHEYE", "SIMPLE_FISHEYE", "SIMPLE_RADIAL_FISHEYE",
            "RADIAL_FISHEYE"}
# Instant-ngp's marks of other lenses; the second of its f-theta terms is never zero.
_OTHER_MODELS = ("latlong", "equirectangular", "orthographic", "ftheta_p1")
_TERM = re.compile(r"[kpsb]\d+|s[xy]\d+|tau_?[xy\d]|skew")


def _terms(frame: dict[str, Any], shared: dict[str, Any]) -> dict[str, float]:
    """The distortion terms of a frame that are not zero; nerfstudio may list them."""
    terms: dict[str, float] = {}
    for place in (shared, frame):
        listed = [float(term) for term in place.get("distortion_params") or []]
        if any(listed[6:]):
            raise UserError("distortion_params in transforms.json has more terms than k1 to k4, "
                            "p1 and p2; give pictures without distortion")
        terms |= dict(zip(("k1", "k2", "k3", "k4", "p1", "p2"), listed))
        terms |= {name: float(value) for name, value in place.items()
                  if _TERM.fullmatch(name) and value is not None}
    return {name: term for name, term in terms.items() if term}


def _bent(lens: Lens, model: str, is_fisheye: bool, terms: dict[str, float]) -> Lens:
    """The lens with its distortion, as the programs that write these terms bend.

    nerfstudio's k4 belongs to r^8, of a fisheye to theta^8. OpenCV's k4 to k6, of its full model,
    lie below the fraction.
    """
    rational = not is_fisheye and (model == "FULL_OPENCV" or "k5" in terms or "k6" in terms)
    known = [f"k{number}" for number in range(1, 7 if rational else 5)]
    unknown = sorted(terms.keys() - {*known, "p1", "p2"})
    if unknown:
        raise UserError(f"the lens term {unknown[0]} in transforms.json is not supported; "
                        "calibrate without it, or give pictures without distortion")
    k = tuple(terms.get(name, 0.0) for name in known)
    lens = replace(lens, p=(terms.get("p1", 0.0), terms.get("p2", 0.0)))
    if rational:
        return replace(lens, k=k)
    return (fisheye if is_fisheye else brown)(lens, (k[0], k[1], k[2], k[3]))


def _lens(frame: dict[str, Any], shared: dict[str, Any], width: int, height: int) -> Lens:
    """Intrinsics of one frame: its own values before the file's, for a picture of this size."""
    def value(name: str, default: float | None = None) -> float | None:
        found = frame.get(name, shared.get(name, default))
        return default if found is None else float(found)

    stated = value("w") or float(width), value("h") or float(height)
    ratio = width / stated[0], height / stated[1]
    focal: list[float | None] = []
    for axis, size in zip("xy", stated):
        angle = value(f"camera_angle_{axis}")
        focal.append(value(f"fl_{axis}") or (None if angle is None
                                             else 0.5 * size / np.tan(0.5 * angle)))
    fx, fy = focal[0] or focal[1], focal[1] or focal[0]
    if fx is None or fy is None:
        raise UserError("transforms.json gives no focal length (fl_x or camera_angle_x)")
    cx, cy = value("cx", stated[0] / 2), value("cy", stated[1] / 2)
    assert cx is not None and cy is not None
    model = str(frame.get("camera_model", shared.get("camera_model")) or "").upper()
    if model not in _PERSPECTIVE | _FISHEYE:
        raise UserError(f"pictures by the camera model {model} are not supported; give them as "
                        "OPENCV or OPENCV_FISHEYE")
    for name in _OTHER_MODELS:
        if frame.get(name, shared.get(name)):
            raise UserError(f"pictures with {name} are not supported; give them as OPENCV or "
                            "OPENCV_FISHEYE")
    is_fisheye = bool(frame.get("is_fisheye", shared.get("is_fisheye"))) or model in _FISHEYE
    lens = Lens(width, height, (fx * ratio[0], fy * ratio[1]), (cx * ratio[0], cy * ratio[1]))
    return _bent(lens, model, is_fisheye, _terms(frame, shared))


def _stated_size(frame: dict[str, Any], shared: dict[str, Any]) -> tuple[int, int] | None:
    """Width and height that a frame or its file notes; None where it does not."""
    width, height = (frame.get(axis, shared.get(axis)) for axis in ("w", "h"))
    if not (width and height):
        return None
    return round(float(width)), round(float(height))


def _picture_path(folder: Path, name: str, finder: Finder) -> Path | None:
    """The picture of that name, with or without its suffix, or nerfstudio's reduced copy of it."""
    parent, base = PurePosixPath(name).parent, PurePosixPath(name).name
    reduced = [parent.with_name(f"{parent.name}_{factor}") / base
               for factor in (2, 4, 8)] if parent.name not in ("", "..") else []
    for place in (PurePosixPath(name), *reduced):
        found = finder.find(folder, str(place)) or finder.find_picture(folder, str(place))
        if found is not None:
            return found
    return None


def _forward(name: str) -> str:
    """A path as Windows writes it, with slashes."""
    return name.replace("\\", "/")


def _split_of(data: dict[str, Any], name: str, file: Path, several: bool) -> bool | None:
    """Whether a picture is a test view, by the file's lists or its name; None: it does not say."""
    def listed(key: str) -> bool:
        names = data.get(f"{key}_filenames")
        return isinstance(names, list) and name in (_forward(str(one)) for one in names)

    if any(isinstance(data.get(f"{key}_filenames"), list) for key in ("test", "val")):
        return listed("test") or listed("val")
    return "train" not in file.stem if several else None


class Transforms(CaptureFormat):
    """One or several ``transforms*.json`` (NeRF-Blender, instant-ngp, nerfstudio)."""

    name = "transforms.json (NeRF, nerfstudio)"
    files = "transforms.json"

    def recognises(self, path: Path) -> bool:
        return bool(transform_files(path))

    def read(self, path: Path, holdout: int) -> DataSet:
        files, finder = transform_files(path), Finder()
        shots: list[Shot] = []
        for file in files:
            shots += _shots(file, len(files) > 1, finder)
        if not shots:
            raise UserError(f"none of the pictures named in {files[0]} exist")
        shots.sort(key=lambda shot: (bool(shot.test), shot.name))
        if len({Path(shot.name).stem for shot in shots}) < len(shots):
            shots = [replace(shot, name=f"{index:04d}_{shot.name}")
                     for index, shot in enumerate(shots)]
        return DataSet(self.name, shots, files[0])


def _shots(file: Path, several: bool, finder: Finder) -> list[Shot]:
    """The shots of a file whose pictures are there."""
    data = read_json(file)
    if not isinstance(data, dict) or not isinstance(data.get("frames"), list):
        raise UserError(f"{file} has no list of frames; is it a NeRF transforms file?")
    shots = [_shot(file, frame, data, several, finder) for frame in data["frames"]]
    missing = sum(shot is None for shot in shots)
    if missing:
        warnings.warn(f"{missing} pictures named in {file} are not there", stacklevel=3)
    return [shot for shot in shots if shot is not None]


def _shot(file: Path, frame: Any, data: dict[str, Any], several: bool, finder: Finder,
          ) -> Shot | None:
    """One frame of a file; None where its picture is missing."""
    try:
        pose = np.array(frame["transform_matrix"], np.float64)
        name = _forward(str(frame["file_path"]))
    except KeyError as error:
        raise UserError(f"{file}: a frame lacks {error}") from error
    except (TypeError, ValueError, OverflowError) as error:
        raise UserError(f"{file}: a frame can't be read: {error}") from error
    if pose.shape == (3, 4):
        pose = np.vstack([pose, [0, 0, 0, 1]])
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise UserError(f"{file}: the transform_matrix of {name} is not 4x4")
    path = _picture_path(file.parent, name, finder)
    if path is None:
        return None
    try:
        size = _stated_size(frame, data)
    except (TypeError, ValueError, OverflowError) as error:
        raise UserError(f"the camera of {path.name} can't be read: {error}") from error
    return Shot(path, path.name, pose @ FLIP, partial(_lens, frame, data), size,
                (path.parent.parent / "masks", path.parent / "masks"),
                mask=(file.parent / _forward(str(frame["mask_path"])) if frame.get("mask_path")
                      else None), test=_split_of(data, name, file, several))


class Own(Transforms):
    """Captures of our own: other programs read their cameras, too."""

    name = "lfportrait capture"

    def recognises(self, path: Path) -> bool:
        files = transform_files(path)
        with suppress(UserError):  # damaged: `Transforms` says of what
            first = read_json(files[0]) if files else None
            return isinstance(first, dict) and first.get("generator") == "lfportrait"
        return False

    def write(self, capture: Views, path: Path) -> None:
        try:
            with fresh_folder(path) as temporary:
                _write(capture, temporary)
        except OSError as error:
            raise UserError(f"can't write {path}: {error.strerror}; free some space or choose "
                            "another folder with --out") from error

    def load(self, path: Path, holdout: int) -> Views:
        return self.views(transform_files(path)[0].parent)

    def views(self, folder: Path, images: list[UInt8] | None = None,
              alphas: list[UInt8] | None = None) -> Views:
        """A capture in a folder, with these pictures if it is known what its files hold."""
        data = read_json(folder / "transforms.json")
        try:
            frames = data["frames"]
            if images is None:
                images, alphas = _read_pictures([folder / frame["file_path"] for frame in frames])
            cameras = Camera(
                np.array([frame["transform_matrix"] for frame in frames]) @ FLIP,
                np.array([[frame["fl_x"], frame["fl_y"]] for frame in frames]),
                np.array([[frame["cx"], frame["cy"]] for frame in frames]),
                np.array([frame["w"] for frame in frames]),
                np.array([frame["h"] for frame in frames]))
            landmarks = data["landmarks"]
            return Views(
                cameras, images, alphas, [Path(frame["file_path"]).name for frame in frames],
                np.array([frame["held_out"] for frame in frames], bool),
                np.array(data["portrait_frame"]),
                None if landmarks is None else np.array(
                    [[np.nan if v is None else v for v in point] for point in landmarks]),
                data.get("figures", {}),
                some_depth([load_depth(folder, frame.get("depth")) for frame in frames]))
        except (KeyError, IndexError, TypeError, ValueError, OverflowError) as error:
            raise UserError(f"{folder / 'transforms.json'} is damaged: {error!r}") from error


def _read_pictures(files: list[Path]) -> tuple[list[UInt8], list[UInt8] | None]:
    """Colors, and opacities where there are any."""
    # Decoding leaves Python to others.
    with ThreadPoolExecutor(usable_cores()) as pool:
        pictures = list(pool.map(read_image, files))
    return ([np.ascontiguousarray(picture[..., :3]) for picture in pictures],
            [np.ascontiguousarray(picture[..., 3]) for picture in pictures]
            if pictures[0].shape[2] == 4 else None)


def _write(capture: Views, folder: Path) -> None:
    frames = []
    names = [f"images/{Path(name).stem}.png" for name in capture.names]

    def write(view: int) -> None:
        picture = (capture.images[view] if capture.alphas is None
                   else np.dstack([capture.images[view], capture.alphas[view]]))
        write_image(folder / names[view], picture, fast=True)

    side_by_side(write, range(len(capture.names)), most=4)
    for view, name in enumerate(names):
        camera = capture.cameras[view]
        frames.append({
            "file_path": name, "w": int(camera.width[0]), "h": int(camera.height[0]),
            "fl_x": camera.focal[0, 0], "fl_y": camera.focal[0, 1],
            "cx": camera.center[0, 0], "cy": camera.center[0, 1],
            "transform_matrix": (camera.pose[0] @ FLIP).tolist(),
            "held_out": bool(capture.held_out[view])})
        depth = None if capture.depths is None else capture.depths[view]
        if depth is not None:
            name = f"depth/{Path(capture.names[view]).stem}.npz"
            frames[-1]["depth"] = save_depth(folder, name, depth)
    write_json(folder / "transforms.json", {
        "generator": "lfportrait", "frames": frames, "portrait_frame": capture.frame,
        "landmarks": None if capture.landmarks is None else
        [[None if np.isnan(v) else v for v in point] for point in capture.landmarks.tolist()],
        "figures": capture.figures or {}})
