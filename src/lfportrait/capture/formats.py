"""Reading calibrated data sets: which format one is in, and NeRF-style ``transforms*.json``."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..errors import UserError
from ..files import read_image, read_json
from .camera import Camera
from .capture import Capture
from .distortion import Lens, undistort
from .frame import looks_normalised, portrait_frame_from_cameras

__all__ = ["assemble", "is_calibrated", "load_capture", "nsvf_folders", "with_mask"]

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
                              or nsvf_folders(path) is not None)


def nsvf_folders(path: Path) -> tuple[Path, Path] | None:
    """The folders of pictures and of poses of an NSVF data set, or None if it is none."""
    pictures = [path / name for name in ("rgb", "images", "image") if (path / name).is_dir()]
    poses = [path / name for name in ("pose", "poses") if (path / name).is_dir()]
    return (pictures[0], poses[0]) if pictures and poses else None


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
    if nsvf_folders(path) is not None:
        from .datasets import load_nsvf

        return load_nsvf(path, holdout)
    raise UserError(f"{path} is no calibrated capture: it has no transforms.json, COLMAP model, "
                    "poses_bounds.npy or pose/ folder; run `lfportrait calibrate` on plain photos")


# Camera models by the names that nerfstudio and COLMAP give them; others are refused.
_PERSPECTIVE = {"", "OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE",
                "FULL_OPENCV"}
_FISHEYE = {"OPENCV_FISHEYE", "FISHEYE", "SIMPLE_FISHEYE", "SIMPLE_RADIAL_FISHEYE",
            "RADIAL_FISHEYE"}


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
    fisheye = bool(frame.get("is_fisheye", shared.get("is_fisheye", False))) or model in _FISHEYE
    count = 4 if fisheye else 6
    k = tuple(value(f"k{i}", 0.0) or 0.0 for i in range(1, count + 1))
    return Lens(width, height, (fx * ratio[0], fy * ratio[1]), (cx * ratio[0], cy * ratio[1]),
                "fisheye" if fisheye else "opencv", k,
                (value("p1", 0.0) or 0.0, value("p2", 0.0) or 0.0))


def _picture_path(folder: Path, name: str) -> Path | None:
    """The picture of that name, with or without its suffix, or a reduced copy of it.

    nerfstudio keeps those in ``images_2``, ``images_4`` and ``images_8``.
    """
    full = folder / name
    reduced = [full.parent.with_name(f"{full.parent.name}_{factor}") / full.name
               for factor in (2, 4, 8)] if full.parent.name else []
    for place in (full, *reduced):
        for candidate in (place, *(place.with_name(place.name + suffix) for suffix in _SUFFIXES)):
            if candidate.is_file():
                return candidate
    return None


def with_mask(picture: NDArray[np.uint8], places: Iterable[Path]) -> NDArray[np.uint8]:
    """The picture with the first mask file that exists as alpha (white is kept).

    A mask of another size, for a reduced picture, is resized; one of another shape is an error.
    """
    if picture.shape[2] == 4:
        return picture
    height, width = picture.shape[:2]
    for place in places:
        if place.is_file():
            mask = read_image(place)[..., :3].max(axis=2)
            if mask.shape != (height, width):
                if abs(mask.shape[0] * width - mask.shape[1] * height) > 2 * max(mask.shape):
                    raise UserError(f"the mask {place} is not of its picture's size")
                mask = np.asarray(Image.fromarray(mask).resize((width, height),
                                                               Image.Resampling.BOX))
            return np.dstack([picture, mask])
    return picture


def _mask_places(root: Path, path: Path, frame: dict[str, Any]) -> list[Path]:
    """Where a frame's mask may lie.

    ``mask_path`` names it (nerfstudio), or it has the picture's name in ``masks`` beside the
    picture's folder.
    """
    places = [folder / "masks" / f"{path.stem}.png" for folder in (path.parent.parent, path.parent)]
    if frame.get("mask_path"):
        places.insert(0, root / str(frame["mask_path"]))
    return places


def _split_of(data: dict[str, Any], name: str, file: Path, several: bool) -> bool | None:
    """Whether a picture is a test view, by the file's lists or its name; None: it does not say."""
    def listed(key: str) -> bool:
        names = data.get(f"{key}_filenames")
        return isinstance(names, list) and name in names

    if any(isinstance(data.get(f"{key}_filenames"), list) for key in ("test", "val")):
        return listed("test") or listed("val")
    return "train" not in file.stem if several else None


def _load_transforms(files: list[Path], holdout: int) -> Capture:
    """Read one or several ``transforms*.json`` (NeRF-Blender, instant-ngp, nerfstudio)."""
    entries: list[tuple[Path, NDArray[np.float64], dict[str, Any], dict[str, Any], Path,
                        bool | None]] = []
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
            entries.append((path, pose, frame, data, file.parent,
                            _split_of(data, name, file, len(files) > 1)))
        if missing:
            warnings.warn(f"{missing} pictures named in {file} are not there", stacklevel=2)
    if not entries:
        raise UserError(f"none of the pictures named in {files[0]} exist")
    entries.sort(key=lambda entry: (bool(entry[5]), entry[0].name))
    lenses, pictures, poses, names, held = [], [], [], [], []
    for path, pose, frame, data, root, test in entries:
        try:
            picture = read_image(path)
        except UserError as error:
            warnings.warn(f"{error}; left out", stacklevel=2)
            continue
        picture = with_mask(picture, _mask_places(root, path, frame))
        try:
            lenses.append(_lens(frame, data, picture.shape[1], picture.shape[0]))
        except (TypeError, ValueError) as error:
            raise UserError(f"the camera of {path.name} can't be read: {error}") from error
        pictures.append(picture)
        poses.append(pose @ _TO_OPENCV)
        names.append(path.name)
        held.append(bool(test))
    if not poses:
        raise UserError(f"none of the pictures named in {files[0]} can be read")
    if len({Path(name).stem for name in names}) < len(names):
        names = [f"{index:04d}_{name}" for index, name in enumerate(names)]
    return assemble(np.array(poses), lenses, pictures, names,
                    None if any(entry[5] is None for entry in entries) else np.array(held),
                    holdout)


def _rigid(poses: NDArray[np.float64], names: list[str]) -> NDArray[np.float64]:
    """Poses whose rotations are exact; a common scale in them, as some exporters leave, goes."""
    u, sizes, vt = np.linalg.svd(np.where(np.isfinite(poses), poses, 0.0)[:, :3, :3])
    rotation = u @ vt
    good = (np.isfinite(poses).all((1, 2)) & (sizes[:, 2] > 0.98 * sizes[:, 0])
            & (sizes[:, 2] > 1e-6) & (np.linalg.det(rotation) > 0))
    if not good.all():
        raise UserError(f"the pose of {names[int(np.argmin(good))]} is no rotation with a "
                        "position; are the cameras' axes right?")
    result = np.tile(np.eye(4), (len(poses), 1, 1))
    result[:, :3, :3], result[:, :3, 3] = rotation, poses[:, :3, 3]
    return result


def _check(lens: Lens, name: str) -> None:
    numbers = (*lens.focal, *lens.center, *lens.k, *lens.p, *lens.s)
    if not (np.isfinite(numbers).all() and min(lens.focal) > 0):
        raise UserError(f"the camera of {name} makes no sense: focal length "
                        f"{lens.focal[0]:g} x {lens.focal[1]:g} pixels, centre "
                        f"{lens.center[0]:g}, {lens.center[1]:g}")


def assemble(poses: NDArray[np.float64], lenses: list[Lens],
             pictures: Iterable[NDArray[np.uint8]], names: list[str],
             held_out: NDArray[np.bool_] | None, holdout: int,
             box: NDArray[np.float64] | None = None) -> Capture:
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
    box
        float64 [2, 3], lowest and highest corner of the subject in the source's world, where known.

    Raises
    ------
    UserError
        If a pose or a lens makes no sense.
    """
    poses = _rigid(poses, names)
    images: list[NDArray[np.uint8]] = []
    alphas: list[NDArray[np.uint8]] = []
    for picture, lens, name in zip(pictures, lenses, names):
        _check(lens, name)
        flat, inside = undistort(picture, lens)
        images.append(np.ascontiguousarray(flat[..., :3]))
        if picture.shape[2] == 4:
            alphas.append(np.ascontiguousarray(flat[..., 3] * inside))
    straight = [lens.pinhole() for lens in lenses]
    cameras = Camera(poses, np.array([lens.focal for lens in straight]),
                     np.array([lens.center for lens in straight]),
                     np.array([lens.width for lens in straight]),
                     np.array([lens.height for lens in straight]))
    frame = np.eye(4)
    if not looks_normalised(cameras):
        frame = portrait_frame_from_cameras(cameras, box)
        cameras = cameras.transformed(frame)
    if held_out is None:
        held_out = np.zeros(len(images), bool)
        if holdout > 1 and len(images) >= 2 * holdout:
            held_out[holdout // 2::holdout] = True
    return Capture(cameras, images, alphas if len(alphas) == len(images) else None, names,
                   held_out, frame)
