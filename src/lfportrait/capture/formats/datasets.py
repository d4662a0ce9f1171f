"""LLFF (``poses_bounds.npy``) and NSVF (``rgb/``, ``pose/``, ``intrinsics.txt``) data sets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...files import UNREADABLE_ARRAYS
from ...media.folders import list_pictures, stem_key, visible
from ...media.pictures import open_picture
from ..distortion import Lens
from .assembly import DataSet, Shot
from .capture_format import CaptureFormat
from .placed import warn_unmatched

__all__ = ["Llff", "Nsvf"]

# Pixels along the longer side beyond which a reduced copy is preferred.
_LARGEST_SIDE = 1600


def _pictures(folder: Path) -> list[Path]:
    return list_pictures(folder).files


def _llff_pictures(folder: Path, count: int) -> list[Path]:
    """The pictures to read, ``count`` of them: the largest copies that are not too large.

    Photos come at full size in ``images`` and reduced N times in ``images_N``.
    """
    best: tuple[float, list[Path]] | None = None
    for place in visible(folder):
        if place.name != "images" and not place.name.startswith("images_"):
            continue
        # The programs that write these files sort names letter by letter.
        files = sorted(_pictures(place), key=lambda path: path.name)
        if len(files) != count:
            continue
        try:
            with open_picture(files[0]) as picture:
                side = max(picture.size)
        except (OSError, ValueError, SyntaxError):
            continue
        # Up to the limit larger is better, beyond it smaller is.
        rank = float(side) if side <= _LARGEST_SIDE else -float(side)
        if best is None or rank > best[0]:
            best = rank, files
    if best is None:
        raise UserError(f"{folder / 'poses_bounds.npy'} lists {count} cameras, but "
                        f"{folder / 'images'} does not hold as many pictures")
    return best[1]


class Llff(CaptureFormat):
    """LLFF.

    ``poses_bounds.npy`` has 17 numbers a picture: a [3, 5] matrix whose columns are the camera's
    down, right and backward axes, its position, and (height, width, focal length); then the near
    and far depth, which are not needed. The pictures lie in ``images`` or, reduced, ``images_N``.
    Held out are every so many pictures from the first on, as is the custom with these data sets.
    """

    name, files = "LLFF", "poses_bounds.npy"

    def recognises(self, path: Path) -> bool:
        """See `CaptureFormat.recognises`."""
        return (path / self.files).is_file()

    def read(self, path: Path, holdout: int) -> DataSet:
        """See `CaptureFormat.read`."""
        source = path / "poses_bounds.npy"
        try:
            table = np.load(source, allow_pickle=False).astype(np.float64)
            matrices = table[:, :15].reshape(-1, 3, 5)
        except UNREADABLE_ARRAYS as error:
            raise UserError(f"{source} is not an LLFF camera file: {error}") from error
        if not (len(matrices) and np.isfinite(matrices).all() and (matrices[:, :, 4] > 0).all()
                and (np.round(matrices[:, :2, 4]) >= 1).all()):
            raise UserError(f"{source} is not an LLFF camera file: sizes and focal lengths must be "
                            "positive numbers")
        files = _llff_pictures(path, len(matrices))
        poses = np.tile(np.eye(4), (len(matrices), 1, 1))
        poses[:, :3, 0], poses[:, :3, 1] = matrices[:, :, 1], matrices[:, :, 0]
        poses[:, :3, 2], poses[:, :3, 3] = -matrices[:, :, 2], matrices[:, :, 3]
        split = 1 < holdout <= len(files) // 2
        shots = []
        for number, (file, pose, matrix) in enumerate(zip(files, poses, matrices)):
            height, width, focal = (float(value) for value in matrix[:, 4])
            lens = Lens(round(width), round(height), (focal, focal), (width / 2, height / 2))
            shots.append(Shot(file, file.name, pose, lens.resized, (lens.width, lens.height),
                              test=number % holdout == 0 if split else None))
        return DataSet(self.name, shots, source)


def _nsvf_intrinsics(file: Path) -> NDArray[np.float64]:
    """(fx, fy, cx, cy) from either form of ``intrinsics.txt``: a 4x4 matrix, or "f cx cy 0"."""
    try:
        rows = [[float(value) for value in line.split()]
                for line in file.read_text("utf-8-sig").splitlines() if line.strip()]
        if len(rows) >= 3 and len(rows[0]) == len(rows[1]) and len(rows[0]) >= 3:
            return np.array([rows[0][0], rows[1][1], rows[0][2], rows[1][2]])
        return np.array([rows[0][0], rows[0][0], rows[0][1], rows[0][2]])
    except (OSError, ValueError, IndexError) as error:
        raise UserError(f"can't read the camera in {file}: {error}") from error


def _nsvf_box(file: Path) -> NDArray[np.float64] | None:
    """The subject's box [2, 3] from ``bbox.txt``: lowest corner, highest corner, voxel size."""
    if not file.is_file():
        return None
    try:
        numbers = file.read_text("utf-8-sig").split()[:6]
        box = np.array([float(value) for value in numbers]).reshape(2, 3)
    except (OSError, ValueError) as error:
        raise UserError(f"can't read the box in {file}: {error}") from error
    if not (np.isfinite(box).all() and (box[1] > box[0]).all()):
        raise UserError(f"the box in {file} is empty; correct or remove the file")
    return box


def _nsvf_folders(path: Path) -> tuple[Path, Path] | None:
    """The folders of pictures and of poses of an NSVF data set, or None if it is none."""
    pictures = [path / name for name in ("rgb", "images", "image") if (path / name).is_dir()]
    poses = [path / name for name in ("pose", "poses") if (path / name).is_dir()]
    return (pictures[0], poses[0]) if pictures and poses else None


class Nsvf(CaptureFormat):
    """NSVF.

    Poses are camera-to-world with OpenCV axes, one text file a picture; the names' prefix says the
    split: ``0_`` training, ``1_`` validation, ``2_`` test. ``bbox.txt``, if there is one, gives the
    subject's position, for a world that is not normalised.
    """

    name, files = "NSVF", "pose/ folder"

    def recognises(self, path: Path) -> bool:
        """See `CaptureFormat.recognises`."""
        return _nsvf_folders(path) is not None

    def read(self, path: Path, holdout: int) -> DataSet:
        """See `CaptureFormat.read`."""
        folders = _nsvf_folders(path)
        assert folders is not None
        rgb, pose_folder = folders
        fx, fy, cx, cy = _nsvf_intrinsics(path / "intrinsics.txt")
        box = _nsvf_box(path / "bbox.txt")
        pictures = _pictures(rgb)
        poses = {stem_key(file): file for file in visible(pose_folder)
                 if file.suffix.lower() == ".txt"}
        files = [file for file in pictures if stem_key(file) in poses]
        if not files:
            raise UserError(f"{rgb} has no picture with a file of its name in {pose_folder}")
        warn_unmatched({stem_key(file) for file in pictures}, poses.keys(), rgb, pose_folder)
        prefixes = {file.name.split("_")[0] for file in files}
        split = prefixes <= {"0", "1", "2"} and len(prefixes) > 1
        shots = []
        for file in files:
            try:
                pose = np.loadtxt(poses[stem_key(file)], encoding="utf-8-sig").reshape(4, 4)
            except (OSError, ValueError) as error:
                raise UserError(f"the pose of {file.name} can't be read: {error}") from error
            shots.append(Shot(file, file.name, pose,
                              lambda width, height: Lens(width, height, (fx, fy), (cx, cy)),
                              test=not file.name.startswith("0_") if split else None))
        return DataSet(self.name, shots, rgb, box)
