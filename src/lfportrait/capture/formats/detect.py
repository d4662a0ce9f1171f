"""Detect the format of a calibrated data set and read it."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from ...errors import UserError
from .assembly import DataSet, Views, read_shots
from .colmap import find_colmap, photo_count
from .datasets import find_llff, find_nsvf, nsvf_folders
from .phones import find_polycam, find_record3d, polycam_folders, record3d_files
from .programs import find_program, program_file
from .transforms import find_transforms, transform_files

__all__ = ["find_views", "is_calibrated", "load_views"]


def _colmap_models(path: Path) -> list[Path]:
    """Folders with a COLMAP model: where COLMAP and programs that call it leave them."""
    found = []
    for part in ("", "sparse", "colmap/sparse", "dense/sparse", "dense/0/sparse",
                 "distorted/sparse", "colmap"):
        folder = path / part
        numbered = (sorted((one for one in folder.iterdir() if one.is_dir() and one.name.isdigit()),
                           key=lambda one: int(one.name)) if folder.is_dir() else [])
        found += [place for place in (folder, *numbered)
                  if any((place / f"cameras.{kind}").is_file() for kind in ("bin", "txt"))]
        if found:
            break
    return found


def _largest_model(models: list[Path], root: Path) -> Path:
    """The model with the most photos; a line says so where there are others."""
    if len(models) == 1:
        return models[0]
    counts = [photo_count(model) for model in models]
    best = int(np.argmax(counts))
    warnings.warn(f"{root} has {len(models)} COLMAP models; the largest, "
                  f"{models[best].relative_to(root)} with {counts[best]} photos, is taken",
                  stacklevel=2)
    return models[best]


def is_calibrated(path: Path) -> bool:
    """Whether a folder or file is a data set with cameras (and not plain photos or a video)."""
    if transform_files(path) or program_file(path) is not None:
        return True
    return path.is_dir() and (bool(_colmap_models(path))
                              or (path / "poses_bounds.npy").is_file()
                              or nsvf_folders(path) is not None
                              or polycam_folders(path) is not None
                              or record3d_files(path) is not None)


def load_views(path: Path, holdout: int) -> Views:
    """Read any calibrated data set of another program (see `Capture.load`).

    Raises
    ------
    UserError
        If ``path`` is no data set, or a damaged one.
    """
    return read_shots(find_views(path, holdout), holdout)


def find_views(path: Path, holdout: int = 0) -> DataSet:
    """The shots of any calibrated data set; no picture is decoded.

    Parameters
    ----------
    path
        As in `Capture.load`.
    holdout
        Every ``holdout``-th picture becomes a test view where the format's custom says which.

    Raises
    ------
    UserError
        If ``path`` is no data set, or a damaged one.
    """
    if not path.exists():
        raise UserError(f"there is no folder or file {path}; name the folder of a capture")
    files = transform_files(path)
    if files:
        return find_transforms(files)
    models = _colmap_models(path) if path.is_dir() else []
    if models:
        return find_colmap(_largest_model(models, path), path)
    if (path / "poses_bounds.npy").is_file():
        return find_llff(path, holdout)
    if nsvf_folders(path) is not None:
        return find_nsvf(path)
    if polycam_folders(path) is not None:
        return find_polycam(path)
    if record3d_files(path) is not None:
        return find_record3d(path)
    file = program_file(path)
    if file is not None:
        return find_program(file)
    raise UserError(f"{path} is not a calibrated capture: it has no transforms.json, COLMAP model, "
                    "cameras.xml, .sfm, sfm_data.json, camera table (.csv), bundle.out, .nvm, "
                    "poses_bounds.npy, pose/ folder or export of Polycam or Record3D; run "
                    "`lfportrait calibrate` on plain photos")
