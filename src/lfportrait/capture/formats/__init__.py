"""Readers of calibrated data sets, one for each format, and the detection of the format.

A format is a subclass of `CaptureFormat`, of ours or of another package (entry points).
`transforms` reads NeRF's, instant-ngp's and nerfstudio's, and keeps captures of our own; `colmap`
reads COLMAP's models, `programs` the files of Metashape, RealityCapture, Meshroom and their kin,
`datasets` LLFF, NSVF, and what Polycam and Record3D export. All end in `assembly`, which also
decides which way up a picture is.
"""

import warnings
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from ...arrays import UInt8
from ...errors import UserError
from ...plugins import blamed, gathered
from .assembly import CaptureFormat, DataSet, Shot, Views, held_out_views
from .colmap import Colmap
from .datasets import Llff, Nsvf, Polycam, Record3d
from .programs import Bundler, CameraTable, Meshroom, Metashape, OpenMvg, VisualSfm
from .transforms import Own, Transforms

__all__ = ["CaptureFormat", "DataSet", "Shot", "Views", "capture_formats", "find_views",
           "held_out_views", "is_calibrated", "load_views", "save_views", "written_views"]

FORMATS = "lfportrait.formats"  # Group of entry points with subclasses of `CaptureFormat`.
_OWN: tuple[type[CaptureFormat], ...] = (
    Own, Transforms, Colmap, Llff, Nsvf, Polycam, Record3d, Metashape, Bundler, VisualSfm, Meshroom,
    OpenMvg, CameraTable)
"""The first that recognises a folder reads it."""


def capture_formats() -> dict[str, CaptureFormat]:
    """All formats of captures by their names, ours first.

    A broken one of another package is left out with a warning.
    """
    return gathered(FORMATS, CaptureFormat, _OWN)  # type: ignore[type-abstract]


def _format_of(path: Path) -> CaptureFormat | None:
    """The format of a folder or file; entry points are read only where it is none of ours."""
    for one in chain((kind() for kind in _OWN), (one for one in capture_formats().values()
                                                 if type(one) not in _OWN)):
        try:
            with blamed(one):
                if one.recognises(path):
                    return one
        except UserError as error:
            if type(one) in _OWN:
                raise
            warnings.warn(f"{error}; left out", stacklevel=3)
    return None


def is_calibrated(path: Path) -> bool:
    """Whether a folder or file is a data set with cameras (and not plain photos or a video)."""
    return _format_of(path) is not None


def load_views(path: Path, holdout: int) -> Views:
    """Read any calibrated data set (see `Capture.load`).

    Raises `UserError` if ``path`` is no data set, or a damaged one.
    """
    with blamed(found := _known(path)):
        return found.load(path, holdout)


def save_views(views: Views, path: Path, format: str = "") -> None:
    """Write a capture (see `Capture.save`)."""
    known = {name: one for name, one in capture_formats().items() if one.writes} if format else {}
    if format and format not in known:
        raise UserError(f"captures are not written as {format!r}, but as {', '.join(known)}")
    with blamed(writer := known.get(format) or Own()):
        writer.write(views, path)


def written_views(views: Views, path: Path) -> Views:
    """Write a capture of our own; what `load_views` would read, without decoding its pictures."""
    save_views(views, path)

    def as_read(pictures: Sequence[UInt8]) -> list[UInt8]:
        return [np.require(picture, requirements=("C", "W")) for picture in pictures]

    return Own().views(path, as_read(views.images),
                       None if views.alphas is None else as_read(views.alphas))


def find_views(path: Path) -> DataSet:
    """The shots of any calibrated data set (as in `Capture.load`); no picture is decoded.

    Raises `UserError` if ``path`` is no data set, or a damaged one.
    """
    with blamed(found := _known(path)):
        return found.read(path, 0)


def _known(path: Path) -> CaptureFormat:
    """The format of a data set, which must be one."""
    if not path.exists():
        raise UserError(f"there is no folder or file {path}; name the folder of a capture")
    found = _format_of(path)
    if found is None:
        files = list(dict.fromkeys(one.files for one in capture_formats().values()))
        raise UserError(f"{path} is not a calibrated capture: it has no {', '.join(files[:-1])} or "
                        f"{files[-1]}; run `lfportrait calibrate` on plain photos")
    return found
