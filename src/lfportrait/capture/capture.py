"""A capture: pictures of a head, the cameras that took them, and what is known of the head."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np

from ..arrays import Bool, Float32, Float64, Int64, UInt8
from ..media.depth import DepthMap
from .camera import Camera
from .formats import Views, load_views, save_views, written_views


@dataclass(frozen=True)
class Capture:
    """V pictures with their cameras, in the portrait frame.

    Attributes
    ----------
    cameras : V undistorted pinholes; world = portrait frame (+y up, +z out of the face, origin
        in the middle of the head, the head inside [-1, 1]^3).
    images : V pictures, uint8 [H, W, 3], sRGB; a list, or `LatePictures`.
    alphas : V mattes, uint8 [H, W] (255 = the person), or None where there are none.
    names : V picture names.
    held_out : bool [V]: True for test views, which are never trained on.
    frame : float64 [4, 4], the similarity that took the source's world to the portrait frame.
    landmarks : float64 [68, 3], facial landmarks in the world (iBUG order, NaN = unknown), or
        None.
    figures : What calibration measured, for ``--json``.
    depths : What the photos' files kept of depth, one or None a view, or None where no file had
        any. Each lies over its picture, at a size of its own; distances are in metres or in no
        known unit (`DepthMap.metric`), never in the world's, so that `reframed` leaves them.
    """

    cameras: Camera
    images: Sequence[UInt8]
    alphas: Sequence[UInt8] | None
    names: list[str]
    held_out: Bool
    frame: Float64 = field(default_factory=lambda: np.eye(4))
    landmarks: Float64 | None = None
    figures: dict[str, Any] = field(default_factory=dict)
    depths: Sequence[DepthMap | None] | None = None

    def __post_init__(self) -> None:
        count = len(self.cameras)
        if not (len(self.images) == len(self.names) == len(self.held_out) == count):
            raise ValueError("cameras, images, names and held_out must have one entry a view")
        if self.depths is not None and len(self.depths) != count:
            raise ValueError("depths must have one entry a view")
        # Late pictures have not been decoded for their size.
        for view, image in enumerate(() if isinstance(self.images, LatePictures) else self.images):
            wanted = (int(self.cameras.height[view]), int(self.cameras.width[view]))
            if image.shape[:2] != wanted:
                raise ValueError(f"{self.names[view]} is {image.shape[:2]}, its camera {wanted}")

    def __repr__(self) -> str:
        known = {"mattes": self.alphas, "landmarks": self.landmarks, "depths": self.depths}
        held_out = int(self.held_out.sum())
        return (f"Capture({self.cameras!r}, {held_out} held out"
                f"{''.join(f', {name}' for name, there in known.items() if there is not None)})")

    def __len__(self) -> int:
        return len(self.images)

    def training(self) -> Int64:
        """Indices of the views to train on, int64 [K]."""
        return np.flatnonzero(~self.held_out)

    def testing(self) -> Int64:
        """Indices of the held-out views, int64 [K]."""
        return np.flatnonzero(self.held_out)

    def image_float(self, view: int, background: float = 1.0) -> Float32:
        """One picture as float32 [H, W, 3] in [0, 1], composited on a grey ``background``."""
        image = self.images[view].astype(np.float32) / 255.0
        if self.alphas is None:
            return image
        alpha = self.alphas[view].astype(np.float32)[..., None] / 255.0
        return image * alpha + background * (1.0 - alpha)

    def reframed(self, similarity: Float64, landmarks: Float64 | None = None) -> Capture:
        """The capture in another world frame.

        Parameters
        ----------
        similarity : float64 [4, 4]: new world point = similarity applied to the old one.
        landmarks : float64 [68, 3] in the *new* frame; by default the capture's own,
            transformed.
        """
        if landmarks is None and self.landmarks is not None:
            landmarks = self.landmarks @ similarity[:3, :3].T + similarity[:3, 3]
        return replace(self, cameras=self.cameras.transformed(similarity),
                       frame=similarity @ self.frame, landmarks=landmarks)

    def save(self, folder: str | Path, format: str = "") -> None:
        """Write the capture as a folder: ``transforms.json`` (NeRF axes) and ``images/NAME.png``.

        Depth goes to ``depth/NAME.npz``. The folder appears under its name when it is complete; an
        older one is replaced.

        Parameters
        ----------
        folder : The folder.
        format : Name of another format that is written (`capture_formats`).

        Raises
        ------
        UserError : If the folder can't be written.
        """
        save_views(self._views, Path(folder), format)

    def saved(self, folder: str | Path) -> Capture:
        """Write the capture (`save`); what `load` would read, with the pictures that are here."""
        return Capture(**written_views(self._views, Path(folder))._asdict())

    @property
    def _views(self) -> Views:
        return Views(**{name: getattr(self, name) for name in Views._fields})

    @staticmethod
    def load(path: str | Path, holdout: int = 8) -> Capture:
        """Read a calibrated capture.

        Parameters
        ----------
        path : A folder that lfportrait wrote; a NeRF-Blender, instant-ngp or nerfstudio folder
            or its ``transforms*.json``; a COLMAP model; the cameras of Metashape,
            RealityCapture, Meshroom, OpenMVG, Bundler or VisualSfM; an export of Polycam or
            Record3D; an LLFF or NSVF folder.
        holdout : Every ``holdout``-th picture becomes a test view where the data set does not
            say which are; 0 holds out none.

        Raises
        ------
        UserError : If there is no such capture or it is damaged.
        """
        views = load_views(Path(path), holdout)
        return Capture(**{**views._asdict(), "figures": views.figures or {}})


Picture = TypeVar("Picture")


class LatePictures(Sequence[Picture]):
    """Pictures, or what belongs to them, made all at once when one is first asked for.

    They are uint8 [H, W, 3] or [H, W] each, or depth; there will be ``count`` of them.
    """

    def __init__(self, count: int, decode: Callable[[], Sequence[Picture]]) -> None:
        self._count, self._decode = count, decode
        self._made: Sequence[Picture] | None = None
        self._lock = threading.Lock()

    def _pictures(self) -> Sequence[Picture]:
        with self._lock:
            if self._made is None:
                self._made = self._decode()
            return self._made

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Picture: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Picture]: ...

    def __getitem__(self, index: Any) -> Any:
        return self._pictures()[index]
