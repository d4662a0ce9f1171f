"""LLFF (``poses_bounds.npy``) and NSVF (``rgb/``, ``pose/``, ``intrinsics.txt``) data sets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from ..files import read_image
from .capture import Capture
from .distortion import Lens

__all__ = ["load_llff", "load_nsvf"]

_SUFFIXES = {".png", ".jpg", ".jpeg", ".webp"}


def _pictures(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir()
                  if path.suffix.lower() in _SUFFIXES and not path.name.startswith("."))


def load_llff(folder: Path, holdout: int) -> Capture:
    """Read an LLFF data set.

    ``poses_bounds.npy`` has 17 numbers a picture: a [3, 5] matrix whose columns are the camera's
    down, right and backward axes, its position, and (height, width, focal length); then the near
    and far depth, which are not needed. The pictures lie in ``images`` or, reduced, ``images_N``.

    Parameters
    ----------
    folder
        The data set.
    holdout
        Every ``holdout``-th picture becomes a test view; 0 holds out none.

    Raises
    ------
    UserError
        If the file is damaged or does not fit the pictures.
    """
    from .formats import assemble

    source = folder / "poses_bounds.npy"
    try:
        table = np.load(source, allow_pickle=False).astype(np.float64)
        matrices = table[:, :15].reshape(-1, 3, 5)
    except (OSError, ValueError, IndexError) as error:
        raise UserError(f"{source} is no LLFF camera file: {error}") from error
    folders = [path for path in (folder / "images", *sorted(folder.glob("images_*")))
               if path.is_dir() and len(_pictures(path)) == len(matrices)]
    if not folders:
        raise UserError(f"{source} lists {len(matrices)} cameras, but {folder / 'images'} does not "
                        "hold as many pictures")
    files = _pictures(folders[0])
    poses = np.tile(np.eye(4), (len(matrices), 1, 1))
    poses[:, :3, 0], poses[:, :3, 1] = matrices[:, :, 1], matrices[:, :, 0]
    poses[:, :3, 2], poses[:, :3, 3] = -matrices[:, :, 2], matrices[:, :, 3]
    pictures = [read_image(file) for file in files]
    lenses = []
    for matrix, picture in zip(matrices, pictures):
        height, width, focal = (float(value) for value in matrix[:, 4])
        lenses.append(Lens(round(width), round(height), (focal, focal), (width / 2, height / 2))
                      .resized(picture.shape[1], picture.shape[0]))
    return assemble(poses, lenses, pictures, [file.name for file in files], None, holdout)


def _nsvf_intrinsics(file: Path) -> NDArray[np.float64]:
    """(fx, fy, cx, cy) from either form of ``intrinsics.txt``: a 4x4 matrix, or "f cx cy 0"."""
    try:
        rows = [[float(value) for value in line.split()]
                for line in file.read_text().splitlines() if line.strip()]
        if len(rows) >= 3 and len(rows[0]) == len(rows[1]) and len(rows[0]) >= 3:
            return np.array([rows[0][0], rows[1][1], rows[0][2], rows[1][2]])
        return np.array([rows[0][0], rows[0][0], rows[0][1], rows[0][2]])
    except (OSError, ValueError, IndexError) as error:
        raise UserError(f"can't read the camera in {file}: {error}") from error


def load_nsvf(folder: Path, holdout: int) -> Capture:
    """Read an NSVF data set.

    Poses are camera-to-world with OpenCV axes, one text file a picture; the names' prefix says the
    split: ``0_`` training, ``1_`` validation, ``2_`` test. Without such prefixes every
    ``holdout``-th picture is a test view.

    Parameters
    ----------
    folder
        The data set.
    holdout
        See above; 0 holds out none.

    Raises
    ------
    UserError
        If a file is missing or damaged.
    """
    from .formats import assemble

    fx, fy, cx, cy = _nsvf_intrinsics(folder / "intrinsics.txt")
    files = [file for file in _pictures(folder / "rgb")
             if (folder / "pose" / f"{file.stem}.txt").is_file()]
    if not files:
        raise UserError(f"{folder / 'rgb'} has no picture with a file of its name in "
                        f"{folder / 'pose'}")
    poses, lenses, pictures = [], [], []
    for file in files:
        try:
            pose = np.loadtxt(folder / "pose" / f"{file.stem}.txt").reshape(4, 4)
        except (OSError, ValueError) as error:
            raise UserError(f"the pose of {file.name} can't be read: {error}") from error
        picture = read_image(file)
        poses.append(pose)
        pictures.append(picture)
        lenses.append(Lens(picture.shape[1], picture.shape[0], (fx, fy), (cx, cy)))
    prefixes = [file.name.split("_")[0] for file in files]
    split = set(prefixes) <= {"0", "1", "2"} and len(set(prefixes)) > 1
    held = np.array([prefix != "0" for prefix in prefixes]) if split else None
    return assemble(np.array(poses), lenses, pictures, [file.name for file in files], held, holdout)
