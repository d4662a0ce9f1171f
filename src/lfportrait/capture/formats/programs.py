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
from abc import abstractmethod
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np

from ...errors import UserError
from ...media.folders import folders_below, is_junk, natural_key, visible
from ...media.kinds import PHOTOS
from .assembly import DataSet, Shot
from .capture_format import CaptureFormat
from .graphs import is_graph, read_graph
from .metashape import read_metashape
from .placed import Placed
from .tables import is_camera_table, read_bundler, read_camera_table, read_visualsfm

__all__ = ["Bundler", "CameraTable", "Meshroom", "Metashape", "OpenMvg", "VisualSfm"]

class _Program(CaptureFormat):
    """A photogrammetry program's file with cameras, which lies beside the photos."""

    patterns: ClassVar[tuple[str, ...]]
    """Names that it may have in a data set's folder; the suffix of the first is that of all."""

    @abstractmethod
    def placed(self, file: Path) -> list[Placed]:
        """The photos that the file names."""

    def is_cameras(self, file: Path) -> bool:
        """Whether a file of this suffix holds cameras: tables and JSON may hold other things."""
        return True

    def _file(self, path: Path) -> Path | None:
        """The file that ``path`` is, or that lies in this folder."""
        suffix = Path(self.patterns[0]).suffix
        if path.is_file():
            return path if path.suffix.lower() == suffix and self.is_cameras(path) else None
        files = (file for pattern in self.patterns if path.is_dir()
                 for file in sorted(path.glob(pattern)))
        return next((one for one in files if not is_junk(one) and self.is_cameras(one)), None)

    def recognises(self, path: Path) -> bool:
        return self._file(path) is not None

    def read(self, path: Path, holdout: int) -> DataSet:
        file = self._file(path)
        assert file is not None
        try:
            shots = self.placed(file)
        except OSError as error:
            raise UserError(f"can't read {file}: {error.strerror or error}") from error
        except (ValueError, LookupError, AttributeError, TypeError, OverflowError,
                np.linalg.LinAlgError, ElementTree.ParseError) as error:
            raise UserError(f"{file} can't be read: {' '.join(str(error).split())}") from error
        if not shots:
            raise UserError(f"{file} has no aligned cameras")
        found = _photos(file.parent)
        known = [(shot, photo) for shot in shots
                 if (photo := _photo(shot.name, found)) is not None]
        if not known:
            raise UserError(f"none of the photos named in {file} were found; put them into "
                            f"{file.parent / 'images'}")
        if len(known) < len(shots):
            warnings.warn(f"{len(shots) - len(known)} photos named in {file} are not there",
                          stacklevel=2)
        known.sort(key=lambda one: natural_key(one[1]))
        bases = [photo.name for _, photo in known]
        views = [Shot(photo, photo.name if bases.count(photo.name) == 1
                      else f"{photo.parent.name}_{photo.name}", shot.pose, shot.lens, shot.size,
                      (file.parent / "masks", photo.parent.parent / "masks"))
                 for shot, photo in known]
        return DataSet(self.name, views, file)


class Metashape(_Program):
    """Agisoft Metashape."""

    name, files, patterns = "Metashape", "cameras.xml", ("cameras.xml",)
    placed = staticmethod(read_metashape)


class Bundler(_Program):
    """Bundler, with the photos' names in ``list.txt``."""

    name, files, patterns = "Bundler", "bundle.out", ("bundle.out", "bundle/bundle.out")
    placed = staticmethod(read_bundler)


class VisualSfm(_Program):
    """VisualSfM."""

    name, files, patterns = "VisualSfM", ".nvm", ("*.nvm",)
    placed = staticmethod(read_visualsfm)


class Meshroom(_Program):
    """Meshroom (AliceVision)."""

    name, files, patterns = "Meshroom", ".sfm", ("*.sfm",)
    placed = staticmethod(read_graph)


class OpenMvg(_Program):
    """The same as JSON, and OpenMVG's."""

    name, files, patterns = "Meshroom or OpenMVG", "sfm_data.json", ("*.json",)
    placed, is_cameras = staticmethod(read_graph), staticmethod(is_graph)


class CameraTable(_Program):
    """The CSV of RealityCapture and RealityScan, and tables like it."""

    name, files, patterns = "RealityCapture or a camera table", "camera table (.csv)", ("*.csv",)
    placed, is_cameras = staticmethod(read_camera_table), staticmethod(is_camera_table)


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
