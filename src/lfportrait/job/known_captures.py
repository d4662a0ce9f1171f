"""Cached captures for stylisation: cameras and landmarks at once, pictures on access.

The contents of a calibrated data set are kept in the user's cache, keyed by the names, sizes and
dates of its files. A preview need not decode a hundred photos to know where they were taken from.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import UInt8
from ..cache import kept_arrays, key_of
from ..capture import Camera, Capture, LatePictures, is_calibrated
from ..errors import UserError
from ..files import file_state
from ..media.depth import DepthMap
from ..media.folders import files_below
from ..progress import Progress

__all__ = ["capture_of_face"]

_CAMERA = ("pose", "focal", "center", "width", "height")


def capture_of_face(photos: Path, progress: Progress | None = None) -> Capture:
    """Photos, a video or a calibrated data set as a capture with the landmarks of its face.

    Parameters
    ----------
    photos
        Folder, video file or data set.
    progress
        Progress line.

    Returns
    -------
    capture
        `prepare_capture`'s, the room behind the person included; of a calibrated data set that was
        read before, with `LatePictures`.

    Raises
    ------
    UserError
        If there is no such capture, it is damaged, or no face was found.
    """
    if not photos.exists() or not is_calibrated(photos):
        return _read(photos, progress)
    read: list[Capture] = []

    def find() -> dict[str, NDArray[Any]]:
        read.append(_read(photos, progress))
        return _told(read[0])

    kept = kept_arrays("captures", _key(photos), find)
    return read[0] if read else _late(photos, kept)


def _read(photos: Path, progress: Progress | None) -> Capture:
    # Here: what calibrates photos is not needed for those that have cameras.
    from ..capture import CalibrateConfig
    from .prepare import prepare_capture

    return prepare_capture(photos, CalibrateConfig(), keep_background=True, need_face=True,
                           progress=progress)[0]


def _key(photos: Path) -> str:
    """Hash of the data set's files, by name and state, and of what finds faces."""
    from ..face import detectors_key

    root = photos if photos.is_dir() else photos.parent
    try:
        files = sorted((str(path.relative_to(root)), file_state(path))
                       for path in files_below(root))
    except OSError as error:
        raise UserError(f"can't read {photos}: {error.strerror}") from error
    return key_of(__name__, str(photos.resolve()), files, detectors_key())


def _told(capture: Capture) -> dict[str, NDArray[Any]]:
    """All of a capture besides its pictures, as arrays."""
    assert capture.landmarks is not None
    return {**{name: getattr(capture.cameras, name) for name in _CAMERA},
            "names": np.array(capture.names), "held_out": capture.held_out,
            "frame": capture.frame, "landmarks": capture.landmarks,
            "figures": np.array(json.dumps(capture.figures)),
            "mattes": np.array(capture.alphas is not None),
            "depths": np.array(capture.depths is not None)}


def _late(photos: Path, stored: dict[str, NDArray[Any]]) -> Capture:
    """The capture that was read before, its pictures still to be decoded."""
    @functools.cache
    def again() -> Capture:
        return Capture.load(photos)

    def mattes() -> Sequence[UInt8]:
        found = again().alphas
        assert found is not None
        return found

    def depths() -> Sequence[DepthMap | None]:
        found = again().depths
        assert found is not None
        return found

    names = stored["names"].tolist()
    return Capture(
        Camera(*(stored[name] for name in _CAMERA)),
        LatePictures(len(names), lambda: again().images),
        LatePictures(len(names), mattes) if stored["mattes"] else None,
        names, stored["held_out"], stored["frame"], stored["landmarks"],
        json.loads(str(stored["figures"])),
        LatePictures(len(names), depths) if stored["depths"] else None)
