"""NeRF-style ``transforms*.json``, as NeRF, instant-ngp and nerfstudio write them."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from ...errors import UserError
from ...files import read_json
from ...media.folders import Finder, visible
from ..distortion import Lens
from .assembly import DataSet, Shot
from .capture_format import CaptureFormat
from .graphs import is_graph
from .placed import brown, fisheye

__all__ = ["Transforms", "transform_files"]

_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


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
    """The distortion terms of a frame that are not zero, by their names.

    nerfstudio may list them instead (``distortion_params``: k1 to k4, p1, p2).
    """
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
    fx, fy = value("fl_x"), value("fl_y")
    for axis, size in (("x", stated[0]), ("y", stated[1])):
        angle = value(f"camera_angle_{axis}")
        if angle is not None:
            focal = 0.5 * size / np.tan(0.5 * angle)
            if axis == "x":
                fx = fx or focal
            else:
                fy = fy or focal
    if fx is None and fy is None:
        raise UserError("transforms.json gives no focal length (fl_x or camera_angle_x)")
    fx, fy = fx or fy, fy or fx
    assert fx is not None and fy is not None
    cx = value("cx", stated[0] / 2)
    cy = value("cy", stated[1] / 2)
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
    """The picture of that name, with or without its suffix, or a reduced copy of it.

    nerfstudio keeps those in ``images_2``, ``images_4`` and ``images_8``.
    """
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
        """See `CaptureFormat.recognises`."""
        return bool(transform_files(path))

    def read(self, path: Path, holdout: int) -> DataSet:
        """See `CaptureFormat.read`."""
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
    return Shot(path, path.name, pose @ _TO_OPENCV, partial(_lens, frame, data), size,
                (path.parent.parent / "masks", path.parent / "masks"),
                mask=(file.parent / _forward(str(frame["mask_path"])) if frame.get("mask_path")
                      else None), test=_split_of(data, name, file, several))
