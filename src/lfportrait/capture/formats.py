"""Reading calibrated data sets: which format one is in, and NeRF-style ``transforms*.json``."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from ..files import read_image, read_json
from .camera import Camera
from .capture import Capture
from .distortion import Lens, undistort
from .frame import looks_normalised, portrait_frame_from_cameras

__all__ = ["assemble", "is_calibrated", "load_capture"]

_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_SUFFIXES = (".png", ".jpg", ".jpeg", ".JPG", ".PNG", ".webp")


def _transform_files(path: Path) -> list[Path]:
    if path.is_file() and path.suffix == ".json":
        return [path]
    if not path.is_dir():
        return []
    own = path / "transforms.json"
    if own.is_file():
        return [own]
    return sorted(path.glob("transforms_*.json"))


def _colmap_folder(path: Path) -> Path | None:
    for folder in (path, path / "sparse" / "0", path / "sparse", path / "colmap" / "sparse" / "0"):
        if any((folder / f"cameras.{kind}").is_file() for kind in ("bin", "txt")):
            return folder
    return None


def is_calibrated(path: Path) -> bool:
    """Whether a folder or file is a data set with cameras (and not plain photos or a video)."""
    if _transform_files(path):
        return True
    return path.is_dir() and (_colmap_folder(path) is not None
                              or (path / "poses_bounds.npy").is_file()
                              or ((path / "pose").is_dir() and (path / "rgb").is_dir()))


def load_capture(path: Path, holdout: int) -> Capture:
    """Read any calibrated data set (see `Capture.load`)."""
    if not path.exists():
        raise UserError(f"there is no folder or file {path}; name the folder of a capture")
    files = _transform_files(path)
    if files:
        first = read_json(files[0])
        if isinstance(first, dict) and first.get("generator") == "lfportrait":
            return Capture._read_own(files[0].parent)
        return _load_transforms(files, holdout)
    colmap = _colmap_folder(path) if path.is_dir() else None
    if colmap is not None:
        from .colmap import load_colmap

        return load_colmap(colmap, path, holdout)
    if (path / "poses_bounds.npy").is_file():
        from .datasets import load_llff

        return load_llff(path, holdout)
    if (path / "pose").is_dir() and (path / "rgb").is_dir():
        from .datasets import load_nsvf

        return load_nsvf(path, holdout)
    raise UserError(f"{path} is no calibrated capture: it has no transforms.json, COLMAP model, "
                    "poses_bounds.npy or pose/ folder; run `lfportrait calibrate` on plain photos")


def _lens(frame: dict[str, Any], shared: dict[str, Any], width: int, height: int) -> Lens:
    """Intrinsics of one frame: its own values before the file's, for a picture of this size."""
    def value(name: str, default: float | None = None) -> float | None:
        found = frame.get(name, shared.get(name, default))
        return None if found is None else float(found)

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
    fisheye = bool(frame.get("is_fisheye", shared.get("is_fisheye", False))) or "FISHEYE" in str(
        frame.get("camera_model", shared.get("camera_model", "")))
    count = 4 if fisheye else 6
    k = tuple(value(f"k{i}", 0.0) or 0.0 for i in range(1, count + 1))
    return Lens(width, height, (fx * ratio[0], fy * ratio[1]), (cx * ratio[0], cy * ratio[1]),
                "fisheye" if fisheye else "opencv", k,
                (value("p1", 0.0) or 0.0, value("p2", 0.0) or 0.0))


def _picture_path(folder: Path, name: str) -> Path | None:
    for candidate in (folder / name, *(folder / f"{name}{suffix}" for suffix in _SUFFIXES)):
        if candidate.is_file():
            return candidate
    return None


def _with_mask(path: Path, frame: dict[str, Any], picture: NDArray[np.uint8],
               ) -> NDArray[np.uint8]:
    """The picture with its mask file as alpha.

    A mask is named by ``mask_path`` (nerfstudio; white is kept) or lies in ``masks`` beside the
    picture's folder, under the picture's name.
    """
    if picture.shape[2] == 4:
        return picture
    places = [folder / "masks" / f"{path.stem}.png" for folder in (path.parent.parent, path.parent)]
    if frame.get("mask_path"):
        depth = len(Path(str(frame["file_path"])).parts)
        root = path.parents[min(depth, len(path.parents)) - 1]
        places.insert(0, root / str(frame["mask_path"]))
    for place in places:
        if place.is_file():
            mask = read_image(place)[..., :3].max(axis=2)
            if mask.shape != picture.shape[:2]:
                raise UserError(f"the mask {place} is not of its picture's size")
            return np.dstack([picture, mask])
    return picture


def _load_transforms(files: list[Path], holdout: int) -> Capture:
    """Read one or several ``transforms*.json`` (NeRF-Blender, instant-ngp, nerfstudio)."""
    entries: list[tuple[Path, NDArray[np.float64], dict[str, Any], dict[str, Any], bool]] = []
    split = len(files) > 1
    for file in files:
        data = read_json(file)
        if not isinstance(data, dict) or not isinstance(data.get("frames"), list):
            raise UserError(f"{file} has no list of frames; is it a NeRF transforms file?")
        missing = 0
        for frame in data["frames"]:
            try:
                pose = np.array(frame["transform_matrix"], np.float64)
                name = str(frame["file_path"])
            except (KeyError, TypeError, ValueError) as error:
                raise UserError(f"{file}: a frame lacks {error}") from error
            if pose.shape == (3, 4):
                pose = np.vstack([pose, [0, 0, 0, 1]])
            if pose.shape != (4, 4) or not np.isfinite(pose).all():
                raise UserError(f"{file}: the transform_matrix of {name} is not 4x4")
            path = _picture_path(file.parent, name)
            if path is None:
                missing += 1
                continue
            entries.append((path, pose, frame, data, split and "train" not in file.stem))
        if missing:
            warnings.warn(f"{missing} pictures named in {file} are not there", stacklevel=2)
    if not entries:
        raise UserError(f"none of the pictures named in {files[0]} exist")
    entries.sort(key=lambda entry: (entry[4], entry[0].name))
    lenses, pictures, poses, names, held = [], [], [], [], []
    for path, pose, frame, data, test in entries:
        try:
            picture = read_image(path)
        except UserError as error:
            warnings.warn(f"{error}; left out", stacklevel=2)
            continue
        picture = _with_mask(path, frame, picture)
        lenses.append(_lens(frame, data, picture.shape[1], picture.shape[0]))
        pictures.append(picture)
        poses.append(pose @ _TO_OPENCV)
        names.append(path.name)
        held.append(test)
    if not poses:
        raise UserError(f"none of the pictures named in {files[0]} can be read")
    if len({Path(name).stem for name in names}) < len(names):
        names = [f"{index:04d}_{name}" for index, name in enumerate(names)]
    return assemble(np.array(poses), lenses, pictures, names,
                    np.array(held) if split else None, holdout)


def assemble(poses: NDArray[np.float64], lenses: list[Lens],
             pictures: Iterable[NDArray[np.uint8]], names: list[str],
             held_out: NDArray[np.bool_] | None, holdout: int) -> Capture:
    """A capture in the portrait frame from poses, lenses and photos.

    Photos are undistorted; where the lens leaves corners uncovered they are transparent only if the
    photo had an alpha channel. A data set that is normalised already keeps its frame.

    Parameters
    ----------
    poses
        float64 [V, 4, 4], camera-to-world, OpenCV axes, in the source's world.
    lenses, pictures, names
        One a view; pictures uint8 [H, W, 3 or 4].
    held_out
        bool [V], or None: every ``holdout``-th view is held out.
    holdout
        See ``held_out``; 0 holds out none.
    """
    images: list[NDArray[np.uint8]] = []
    alphas: list[NDArray[np.uint8]] = []
    for picture, lens in zip(pictures, lenses):
        flat, inside = undistort(picture, lens)
        images.append(np.ascontiguousarray(flat[..., :3]))
        if picture.shape[2] == 4:
            alphas.append(np.ascontiguousarray(flat[..., 3] * inside))
    cameras = Camera(poses, np.array([lens.focal for lens in lenses]),
                     np.array([lens.center for lens in lenses]),
                     np.array([lens.width for lens in lenses]),
                     np.array([lens.height for lens in lenses]))
    frame = np.eye(4)
    if not looks_normalised(cameras):
        frame = portrait_frame_from_cameras(cameras)
        cameras = cameras.transformed(frame)
    if held_out is None:
        held_out = np.zeros(len(images), bool)
        if holdout > 1 and len(images) >= 2 * holdout:
            held_out[holdout // 2::holdout] = True
    return Capture(cameras, images, alphas if len(alphas) == len(images) else None, names,
                   held_out, frame)
