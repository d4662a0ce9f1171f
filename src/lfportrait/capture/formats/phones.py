"""Readers of phone scanning apps' exports with ARKit cameras: Polycam and Record3D.

Both have camera-to-world poses whose camera looks along -z with y up, in a world whose y is up. The
pictures lie as the sensor does, so they are turned by the world's up.

- Polycam, "raw data": ``keyframes/images`` and ``keyframes/cameras``, or ``corrected_images`` and
  ``corrected_cameras`` where it optimised them; a JSON file a picture.
- Record3D, "EXR + JPG" or r3d unpacked: ``rgb`` and ``metadata`` or ``metadata.json`` with all
  poses as quaternion (x, y, z, w) and position, K by columns.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...files import read_json
from ...media.folders import list_pictures, stem_key, visible
from ..distortion import Lens
from .assembly import DataSet, Shot
from .capture_format import CaptureFormat
from .placed import resizable, warn_unmatched

__all__ = ["Polycam", "Record3d"]

Float64 = NDArray[np.float64]

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
_UP = np.array([0.0, 1.0, 0.0])


def _polycam_folders(path: Path) -> tuple[Path, Path] | None:
    """The folders of pictures and of cameras of a Polycam export, or None if it is none."""
    for folder in (path / "keyframes", path):
        for kind in ("corrected_", ""):
            pictures, cameras = folder / f"{kind}images", folder / f"{kind}cameras"
            if pictures.is_dir() and cameras.is_dir() and _cameras(cameras):
                return pictures, cameras
    return None


def _pictures(folder: Path) -> list[Path]:
    return list_pictures(folder).files


def _cameras(folder: Path) -> list[Path]:
    """The JSON files of a folder, without what systems leave there."""
    return [path for path in visible(folder) if path.suffix.lower() == ".json"]


class Polycam(CaptureFormat):
    """Polycam's raw data."""

    name, files = "Polycam", "export of Polycam"

    def recognises(self, path: Path) -> bool:
        """See `CaptureFormat.recognises`."""
        return _polycam_folders(path) is not None

    def read(self, path: Path, holdout: int) -> DataSet:
        """See `CaptureFormat.read`."""
        folders = _polycam_folders(path)
        assert folders is not None
        pictures, cameras = folders
        shots = []
        listed = _pictures(pictures)
        files = {stem_key(file): file for file in _cameras(cameras)}
        for picture in listed:
            file = files.get(stem_key(picture))
            if file is None:
                continue
            data = read_json(file)
            with _one_line(file):
                pose = np.eye(4)
                pose[:3] = [[float(data[f"t_{row}{column}"]) for column in range(4)]
                            for row in range(3)]
                lens, size = resizable(Lens(
                    int(data["width"]), int(data["height"]), (float(data["fx"]), float(data["fy"])),
                    (float(data["cx"]), float(data["cy"]))))
            shots.append(_shot(picture, pose, lens, size))
        if not shots:
            raise UserError(f"{pictures} has no picture with a file of its name in {cameras}")
        warn_unmatched({stem_key(picture) for picture in listed}, files.keys(), pictures, cameras)
        return DataSet(self.name, shots, pictures)


def _record3d_files(path: Path) -> tuple[Path, Path] | None:
    """The folder of pictures and the metadata of a Record3D export, or None if it is none."""
    for folder in (path, path / "EXR_RGBD"):
        for name in ("metadata.json", "metadata"):
            if (folder / "rgb").is_dir() and (folder / name).is_file():
                return folder / "rgb", folder / name
    return None


class Record3d(CaptureFormat):
    """Record3D's "EXR + JPG", or r3d unpacked."""

    name, files = "Record3D", "export of Record3D"

    def recognises(self, path: Path) -> bool:
        """See `CaptureFormat.recognises`."""
        return _record3d_files(path) is not None

    def read(self, path: Path, holdout: int) -> DataSet:
        """See `CaptureFormat.read`."""
        from scipy.spatial.transform import Rotation  # a tenth of a second that few commands need

        files = _record3d_files(path)
        assert files is not None
        folder, file = files
        data = read_json(file)
        pictures = _pictures(folder)
        with _one_line(file):
            table = np.array(data["poses"], np.float64).reshape(-1, 7)
            size = int(data["w"]), int(data["h"])
            k = np.array(data["K"], np.float64).reshape(3, 3).T
            own = data.get("perFrameIntrinsicCoeffs") or []
            lenses = [Lens(*size, (float(fx), float(fy)), (float(cx), float(cy)))
                      for fx, fy, cx, cy in (own if len(own) == len(table) else
                                             [(k[0, 0], k[1, 1], k[0, 2], k[1, 2])] * len(table))]
            rotations = Rotation.from_quat(table[:, :4]).as_matrix()
        shots = []
        for picture in pictures:
            number = int(picture.stem) if picture.stem.isdecimal() else -1
            if not 0 <= number < len(table):
                continue
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = rotations[number], table[number, 4:]
            shots.append(_shot(picture, pose, *resizable(lenses[number])))
        if not shots:
            raise UserError(f"{folder} has no pictures 0.jpg, 1.jpg, ... for the poses in {file}")
        warn_unmatched({picture.stem.lstrip("0") or "0" for picture in pictures},
                       {str(number) for number in range(len(table))}, folder, file)
        return DataSet(self.name, shots, folder)


def _shot(picture: Path, pose: Float64, lens: Callable[[int, int], Lens],
          size: tuple[int, int]) -> Shot:
    masks = picture.parent.parent / "masks", picture.parent / "masks"
    return Shot(picture, picture.name, pose @ _FLIP, lens, size, masks, up=_UP)


@contextlib.contextmanager
def _one_line(file: Path) -> Iterator[None]:
    """What goes wrong with a file's values becomes one line."""
    try:
        yield
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise UserError(f"{file} can't be read: {what}") from error
