"""Captures from the camera files of photogrammetry programs.

- Agisoft Metashape: ``cameras.xml`` (`metashape`);
- RealityCapture and RealityScan: the CSV of "internal/external camera parameters" (`tables`);
- Meshroom (AliceVision) and OpenMVG: ``cameras.sfm``, ``sfm.json``, ``sfm_data.json`` (`graphs`);
- Bundler: ``bundle.out`` with ``list.txt``; VisualSfM: ``.nvm`` (`tables`).

Each reader makes `Placed` photos of its file. They are found by their names beside the file or in
``images``, with or without folder and suffix, in any case.
"""

from __future__ import annotations

import unicodedata
import warnings
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ...errors import UserError
from ...media.folders import folders_below, is_junk, natural_key, visible
from ...media.kinds import PHOTOS
from .assembly import DataSet, Shot
from .graphs import is_graph, read_graph
from .metashape import read_metashape
from .placed import Placed
from .tables import is_camera_table, read_bundler, read_camera_table, read_visualsfm

__all__ = ["find_program", "program_file"]

_READERS: dict[str, Callable[[Path], list[Placed]]] = {
    ".xml": read_metashape, ".out": read_bundler, ".nvm": read_visualsfm,
    ".csv": read_camera_table, ".sfm": read_graph, ".json": read_graph}
_NAMES = {".xml": "Metashape", ".out": "Bundler", ".nvm": "VisualSfM",
          ".csv": "RealityCapture or a camera table", ".sfm": "Meshroom",
          ".json": "Meshroom or OpenMVG"}
_PATTERNS = ("cameras.xml", "bundle.out", "bundle/bundle.out", "*.nvm", "*.sfm", "*.json", "*.csv")


def program_file(path: Path) -> Path | None:
    """The file with a program's cameras that ``path`` is, or that lies in this folder."""
    if path.is_file():
        return path if _is_cameras(path) else None
    for pattern in _PATTERNS if path.is_dir() else ():
        for file in sorted(path.glob(pattern)):
            if not is_junk(file) and _is_cameras(file):
                return file
    return None


def _is_cameras(file: Path) -> bool:
    """Whether a file holds cameras: tables and JSON of other kinds have the same suffixes."""
    suffix = file.suffix.lower()
    if suffix == ".csv":
        return is_camera_table(file)
    if suffix == ".json":
        return is_graph(file)
    return suffix in _READERS


def find_program(file: Path) -> DataSet:
    """The shots of a photogrammetry program's file.

    Raises
    ------
    UserError
        If the file is damaged, or its photos are not found.
    """
    try:
        shots = _READERS[file.suffix.lower()](file)
    except OSError as error:
        raise UserError(f"can't read {file}: {error.strerror or error}") from error
    except (ValueError, LookupError, AttributeError, TypeError, OverflowError,
            np.linalg.LinAlgError, ElementTree.ParseError) as error:
        raise UserError(f"{file} can't be read: {' '.join(str(error).split())}") from error
    if not shots:
        raise UserError(f"{file} has no aligned cameras")
    found = _photos(file.parent)
    known = [(shot, path) for shot in shots if (path := _photo(shot.name, found)) is not None]
    if not known:
        raise UserError(f"none of the photos named in {file} were found; put them into "
                        f"{file.parent / 'images'}")
    if len(known) < len(shots):
        warnings.warn(f"{len(shots) - len(known)} photos named in {file} are not there",
                      stacklevel=2)
    known.sort(key=lambda one: natural_key(one[1]))
    bases = [path.name for _, path in known]
    views = [Shot(path, path.name if bases.count(path.name) == 1
                  else f"{path.parent.name}_{path.name}", shot.pose, shot.lens, shot.size,
                  (file.parent / "masks", path.parent.parent / "masks")) for shot, path in known]
    return DataSet(_NAMES[file.suffix.lower()], views, file)


def _photos(folder: Path) -> dict[str, list[Path]]:
    """Photos in ``images`` and beside the file, by every end of their path in lower case.

    ``left/a.jpg`` is found as ``left/a.jpg``, ``left/a``, ``a.jpg`` and ``a``.
    """
    found: dict[str, list[Path]] = {}
    for place in (folder / "images", folder, folder.parent / "images", folder.parent):
        for path in _pictures_within(place):
            parts = [_folded(part) for part in path.relative_to(place).parts]
            for first in range(len(parts)):
                name = "/".join(parts[first:])
                for key in dict.fromkeys((name, name[:-len(path.suffix)])):
                    found.setdefault(key, []).append(path)
        if found:
            break
    return found


def _pictures_within(place: Path) -> list[Path]:
    """Pictures of a folder and of the folders in it, two deep."""
    folders = [one for one in (place, *folders_below(place, 2))
               if not {"masks", "depth"} & set(one.relative_to(place).parts)]
    return [path for folder in folders for path in visible(folder)
            if path.is_file() and path.suffix.lower() in PHOTOS]


def _folded(name: str) -> str:
    """A name in any case, with accents in any form, as one."""
    return unicodedata.normalize("NFC", name).casefold()


def _photo(name: str, found: dict[str, list[Path]]) -> Path | None:
    """The photo that a program gives this name, path or label; the longest end that fits."""
    parts = _folded(name.replace("\\", "/")).split("/")
    for first in range(len(parts)):
        whole = "/".join(parts[first:])
        suffix = Path(whole).suffix
        for key in (whole, whole[:-len(suffix)] if suffix in PHOTOS else whole):
            if len(found.get(key, [])) == 1:
                return found[key][0]
    return None
