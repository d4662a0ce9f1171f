"""A head from photos in one call: what `lfportrait reconstruct photo.jpg` does, for programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...capture import CalibrateConfig, Capture, Photo, read_photos
from ...errors import UserError
from ...field import ReconstructConfig, VoxelField
from ...progress import Progress
from .portrait import portrait_capture, portrait_field

__all__ = ["head_from_photos"]

Picture = str | Path | NDArray[np.uint8]


def head_from_photos(photos: Picture | Sequence[Picture], config: ReconstructConfig | None = None,
                     *, max_side: int = CalibrateConfig.max_side,
                     progress: Progress | None = None) -> tuple[VoxelField, Capture]:
    """A closed head from one photo of a face or a few: its field, and the capture it was made of.

    A statistical head is fitted to the face; hair and body follow the outline. The photos may be of
    different days. What many photos of one moment show is made by `lfportrait.calibrate` and
    `lfportrait.reconstruct` instead.

    Parameters
    ----------
    photos : A file, a folder, or a picture uint8 [H, W, 3 or 4] in sRGB (with straight alpha, it
        is the matte); or several of these. The most frontal one decides how the head looks.
    config : Its resolution counts, and nothing else.
    max_side : Files are reduced to this many pixels on their longer side; 0 keeps them.
    progress : Progress line.

    Returns
    -------
    field : Of degree 0, in the portrait frame. It can be looked at over `PORTRAIT_CONE` degrees
        in all; further out it is guessed.
    capture : The photos with mattes, landmarks and cameras, the decisive one first:
        `lfportrait.stylize` takes both.

    Raises
    ------
    UserError : If there is no photo or one can't be read, shows no face, several or a small one,
        or one turned too far; if no head fits; or if the networks for landmarks and mattes are
        missing.
    """
    given: Sequence[Any] = (
        [photos] if isinstance(photos, (str, Path, np.ndarray)) else list(photos))
    read = [photo for number, one in enumerate(given, 1)
            for photo in _read(one, f"photo {number}", max_side)]
    if not read:
        raise UserError("there is no photo to make a head of")
    capture, _ = portrait_capture(read, progress)
    field, _ = portrait_field(capture, config, progress)
    return field, capture


def _read(photo: Any, name: str, max_side: int) -> list[Photo]:
    """The photos of a file or a folder, or a picture as one."""
    if isinstance(photo, (str, Path)):
        return read_photos(Path(photo), max_side)
    picture = np.asarray(photo)
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] not in (3, 4):
        raise UserError(f"{name} must be uint8 [H, W, 3 or 4], not {picture.dtype} "
                        f"{list(picture.shape)}")
    return [Photo(name, picture)]
