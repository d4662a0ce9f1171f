"""Sitters: a capture, its field, and the views in which all methods are measured.

The real field is rendered once in two sets of views. The arc (a light-field display's cone) shows
whether neighbouring views agree; the close views, which the head fills from one profile's half to
the other's, show paint as large as an exemplar does.
"""

from __future__ import annotations

import functools
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait.capture import Camera, Capture
from lfportrait.errors import UserError
from lfportrait.example import Skin, face_size
from lfportrait.face import fit_to_surface
from lfportrait.field import ReconstructConfig, Rendering, VoxelField, reconstruct_with_figures
from lfportrait.media.folders import files_below
from lfportrait.progress import Progress
from lfportrait.stages import fingerprint_files
from lfportrait.stylize import kept_skin

from ..metrics.views import Arc, head_cameras

__all__ = ["CLOSE_DEGREES", "SHOWN", "Sitter", "Source", "bytes_of", "landmarks_in", "sources_of"]

CLOSE_DEGREES = (-45.0, -20.0, 0.0, 20.0, 45.0)
"""Yaws of the close views."""
SHOWN = (0, 2, 4)
"""Those that are shown as pictures."""

Opener = Callable[[Path], Capture]
"""Makes a capture of what a user named."""


def bytes_of(image: NDArray[Any]) -> NDArray[np.uint8]:
    """A picture in [0, 1] as uint8; uint8 as it is."""
    if image.dtype == np.uint8:
        return np.asarray(image, np.uint8)
    return np.asarray(np.clip(image, 0.0, 1.0) * 255.0 + 0.5, np.uint8)


def landmarks_in(cameras: Camera, view: int, landmarks: NDArray[np.floating],
                 ) -> NDArray[np.float64]:
    """Landmarks [68, 3] in space as pixels [68, 2] of a view."""
    pixels, _ = cameras[view].project(np.asarray(landmarks, np.float64))
    return np.asarray(pixels[0], np.float64)


@dataclass(frozen=True)
class Source:
    """Source of a sitter, as the user named it.

    Attributes
    ----------
    name
        Of the sitter.
    capture
        Photos, a data set or a capture.
    field
        A field that was reconstructed from it; None: it is reconstructed once and kept.
    """

    name: str
    capture: Path
    field: Path | None = None

    def key(self) -> str:
        """Hash of the files."""
        files = [self.capture] if self.capture.is_file() else files_below(self.capture)
        return fingerprint_files(files + ([self.field] if self.field else []))


def sources_of(captures: tuple[str, ...], fields: tuple[str, ...] = ()) -> list[Source]:
    """Sitters from words of the command line.

    Parameters
    ----------
    captures
        ``CAP``, ``NAME=CAP`` or ``NAME=CAP:FIELD`` each.
    fields
        Field files in the order of the captures, where they are not named there.

    Raises
    ------
    UserError
        If there is none, a file is missing or a name is used twice.
    """
    if not captures:
        raise UserError("name the sitters: --capture NAME=CAPTURE[:FIELD] ...")
    if len(fields) > len(captures):
        raise UserError(f"there are {len(fields)} fields for {len(captures)} captures")
    found = []
    for number, word in enumerate(captures):
        name, _, rest = word.rpartition("=") if not Path(word).exists() else ("", "", word)
        path, given = Path(rest), fields[number] if number < len(fields) else ""
        if not path.exists() and ":" in rest:
            text, _, given = rest.rpartition(":")
            path = Path(text)
        if not path.exists():
            raise UserError(f"there is no capture {path}; write --capture NAME=CAPTURE[:FIELD]")
        if given and not Path(given).is_file():
            raise UserError(f"there is no field {given}")
        found.append(Source(name or path.stem, path, Path(given) if given else None))
    names = [source.name for source in found]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UserError(f"two sitters are called {twice!r}; name them: --capture NAME=CAPTURE")
    wrong = next((name for name in names if "/" in name or name.startswith(".")), None)
    if wrong is not None:
        raise UserError(f"{wrong!r} is not a valid sitter name; leave out slashes and leading dots")
    return found


class Sitter:
    """A sitter that is ready to be painted; what takes long is computed when first needed.

    Parameters
    ----------
    name
        Of the sitter.
    field, capture
        The real field, and its capture with landmarks.
    file
        The field's file, for the skin that is kept beside it.
    pixels
        Of the skin per world unit.
    views, cone, render_size, close_size
        Of the arc, in degrees and pixels, and of the close views.
    device
        Where networks compute, a choice of ``--device``.
    """

    def __init__(self, name: str, field: VoxelField, capture: Capture, file: Path, *,
                 pixels: float, views: int, cone: float, render_size: int,
                 close_size: int, device: str = "auto") -> None:
        if capture.landmarks is None:
            raise UserError(f"the sitter {name!r} has no facial landmarks; run `lfportrait "
                            "calibrate` on the photos")
        self.name, self.field, self.capture, self.file = name, field, capture, file
        self.device = device
        self.landmarks = np.asarray(capture.landmarks, np.float64)
        self._pixels, self._arc = pixels, (cone, views, render_size)
        self.close_cameras = head_cameras(self.landmarks, CLOSE_DEGREES, close_size, room=1.1,
                                          back=0.2)

    @functools.cached_property
    def skin(self) -> Skin:
        """The skin of the field."""
        return kept_skin(self.file, self.field, self.capture, self._pixels)

    @functools.cached_property
    def arc(self) -> Arc:
        """The real field along the arc."""
        return Arc.of(self.field, *self._arc)

    @functools.cached_property
    def close(self) -> list[Rendering]:
        """The real field in the close views."""
        return [self.field.render(self.close_cameras, view)
                for view in range(len(self.close_cameras))]

    @property
    def unit(self) -> float:
        """Size of the face in the close view from the front, in pixels."""
        return face_size(landmarks_in(self.close_cameras, len(CLOSE_DEGREES) // 2, self.landmarks))


def linked(source: Path, target: Path) -> None:
    """Let ``target`` be the file ``source``: a link where the system makes one, else a copy."""
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    try:
        os.symlink(source.absolute(), target)
    except OSError:
        shutil.copyfile(source, target)


def field_of(capture: Capture, target: Path, config: ReconstructConfig,
             progress: Progress | None) -> dict[str, Any]:
    """Reconstruct a capture's field into a file; figures."""
    field, figures = reconstruct_with_figures(capture, config, progress, fit_head=fit_to_surface)
    target.parent.mkdir(parents=True, exist_ok=True)
    field.save(target)
    return figures
