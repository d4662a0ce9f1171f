"""The skin of a field, from the file beside the field or computed and kept there."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..capture import Capture
from ..errors import UserError
from ..example import Skin
from ..example.skin import as_stored, load_skin, save_skin, skin_key
from ..field import VoxelField
from .config import check_pixels

__all__ = ["kept_skin"]


def kept_skin(path: Path, field: VoxelField | Callable[[], VoxelField], capture: Capture,
              pixels: float, kept: Path | None = None) -> Skin:
    """The skin of the field that was read from ``path``.

    Its file, ``NAME.skin.npz``, lies beside the field's; where it is missing, or was made of
    another field, other landmarks or at another resolution, the skin is computed and written. If
    nothing can be written there, it is computed each time.

    Parameters
    ----------
    path
        The field's file.
    field
        The field, or what gives it: it is needed only where there is no skin yet.
    capture
        Its capture, with landmarks.
    pixels
        Pixels per world unit.
    kept
        The skin's file, where it is not to lie beside the field's.

    Raises
    ------
    UserError
        If the capture has no landmarks, or ``pixels`` is out of range.
    """
    if capture.landmarks is None:
        raise UserError("the capture has no facial landmarks; run `lfportrait calibrate` on the "
                        "photos, or use --method arf")
    check_pixels(pixels)
    from .. import models

    state = path.stat()
    key = skin_key(state.st_size, state.st_mtime_ns, capture.landmarks, capture.cameras.pose,
                   pixels, not models.missing(["hair-segmentation"]))
    beside = kept or path.with_suffix(".skin.npz")
    skin = load_skin(beside, key)
    if skin is None:
        whole = field if isinstance(field, VoxelField) else field()
        # A file keeps rounded numbers: this run continues with the numbers that the next one reads.
        skin = as_stored(Skin.of(whole, capture.landmarks, capture.cameras, pixels), key)
        with suppress(OSError, UserError):
            save_skin(skin, beside, key)
    return skin
