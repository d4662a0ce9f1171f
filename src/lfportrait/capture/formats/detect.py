"""Which format a calibrated data set is in, and its reader."""

from __future__ import annotations

from pathlib import Path

from ...errors import UserError
from .assembly import Views
from .colmap import load_colmap
from .datasets import load_llff, load_nsvf, nsvf_folders
from .transforms import load_transforms, transform_files

__all__ = ["is_calibrated", "load_views"]


def _colmap_folder(path: Path) -> Path | None:
    for folder in (path, path / "sparse" / "0", path / "sparse", path / "colmap" / "sparse" / "0"):
        if any((folder / f"cameras.{kind}").is_file() for kind in ("bin", "txt")):
            return folder
    return None


def is_calibrated(path: Path) -> bool:
    """Whether a folder or file is a data set with cameras (and not plain photos or a video)."""
    if transform_files(path):
        return True
    return path.is_dir() and (_colmap_folder(path) is not None
                              or (path / "poses_bounds.npy").is_file()
                              or nsvf_folders(path) is not None)


def load_views(path: Path, holdout: int) -> Views:
    """Read any calibrated data set of another program (see `Capture.load`).

    Raises
    ------
    UserError
        If ``path`` is no data set, or a damaged one.
    """
    if not path.exists():
        raise UserError(f"there is no folder or file {path}; name the folder of a capture")
    files = transform_files(path)
    if files:
        return load_transforms(files, holdout)
    colmap = _colmap_folder(path) if path.is_dir() else None
    if colmap is not None:
        return load_colmap(colmap, path, holdout)
    if (path / "poses_bounds.npy").is_file():
        return load_llff(path, holdout)
    if nsvf_folders(path) is not None:
        return load_nsvf(path, holdout)
    raise UserError(f"{path} is no calibrated capture: it has no transforms.json, COLMAP model, "
                    "poses_bounds.npy or pose/ folder; run `lfportrait calibrate` on plain photos")
