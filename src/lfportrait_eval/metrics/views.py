"""Views that are measured: on an arc framed like a sweep, or with the head filling the picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lfportrait.capture import Camera
from lfportrait.example import face_size
from lfportrait.field import Rendering, VoxelField
from lfportrait.share import sweep_cameras

from .consistency import consistency
from .likeness import contour_correlation
from .patches import PatchIndex

__all__ = ["Arc", "arc_cameras", "face_unit", "head_cameras", "views_fidelity"]

Pictures = list[NDArray[np.float32]]

FACE = 0.145
"""Size of a face (`lfportrait.example.face_size`) in a view framed like a sweep, over the width of
the picture: 0.14 to 0.15 on the heads that were measured."""


def arc_cameras(field: VoxelField, degrees: Sequence[float] | NDArray[np.floating],
                size: int) -> Camera:
    """Cameras framed like a sweep.

    Parameters
    ----------
    field
        Whose extent to frame.
    degrees
        Yaw of each camera; 0 is the front, positive yaws are towards +x.
    size
        Width and height of the pictures in pixels.
    """
    front = sweep_cameras(0.0, 1, size, field)
    # A sweep's cameras differ in yaw alone: turn the frontal one about the vertical axis.
    poses = []
    for yaw in np.radians(degrees):
        turn = np.eye(4)
        turn[0, 0] = turn[2, 2] = np.cos(yaw)
        turn[0, 2], turn[2, 0] = np.sin(yaw), -np.sin(yaw)
        poses.append(turn @ front.pose[0])
    return Camera(np.array(poses), front.focal[0], front.center[0], front.width[0],
                  front.height[0])


def head_cameras(landmarks: NDArray[np.floating], degrees: Sequence[float] | NDArray[np.floating],
                 size: int, distance: float = 4.4, *, room: float = 1.0,
                 back: float = 0.13) -> Camera:
    """Cameras whose pictures the head fills, so that strokes are as large as in an exemplar.

    Parameters
    ----------
    landmarks
        [68, 3] in space.
    degrees
        Yaw of each camera.
    size
        Width and height of the pictures in pixels.
    distance
        Of the cameras from the middle of the head, in the field's units.
    room
        Height of what is seen, over 2.3 times the distance of brows and chin.
    back
        How far the middle lies behind the landmarks' mean, in the same heights: 0.13 for views
        from the front, a quarter where profiles shall not lose the back of the head.
    """
    brows, chin = float(np.nanmean(landmarks[17:27, 1])), float(np.nanmin(landmarks[:, 1]))
    high = 2.3 * (brows - chin)
    middle = np.nanmean(landmarks, axis=0) + high * np.array([0.0, 0.1, -back])
    return Camera.arc(np.asarray(degrees, np.float64), distance=distance, width=size, height=size,
                      focal=size * distance / (room * high), target=middle)


def face_unit(field: VoxelField, size: int,
              landmarks: NDArray[np.floating] | None = None) -> float:
    """Size of the face in pixels in a frontal view framed like a sweep.

    Parameters
    ----------
    field
        The head.
    size
        Width and height of the view in pixels.
    landmarks
        [68, 3] in space; without them the size that heads usually have (`FACE`).
    """
    if landmarks is None:
        return FACE * size
    pixels, _ = arc_cameras(field, [0.0], size).project(np.asarray(landmarks, np.float64))
    return face_size(pixels[0])


@dataclass(frozen=True)
class Arc:
    """The real field seen along an arc: what stylised fields are measured against.

    Attributes
    ----------
    cameras
        V cameras in order, an odd number for a view from the front.
    real
        V renderings.
    """

    cameras: Camera
    real: list[Rendering]

    @staticmethod
    def of(field: VoxelField, cone: float = 40.0, views: int = 21, size: int = 384,
           say: Callable[[str], None] = lambda text: None) -> Arc:
        """Render an arc.

        Parameters
        ----------
        field
            The real field.
        cone
            Width of the arc in degrees.
        views
            Number of views on it, evenly apart.
        size
            Width and height of a view in pixels.
        say
            Called with what is being done.
        """
        cameras = arc_cameras(field, np.linspace(-cone / 2, cone / 2, views), size)
        real = []
        for view in range(views):
            say(f"view {view + 1} of {views}")
            real.append(field.render(cameras, view))
        return Arc(cameras, real)

    @property
    def masks(self) -> list[NDArray[np.bool_]]:
        """Where the head is, bool [H, W] each."""
        return [shot.alpha > 0.5 for shot in self.real]

    def seen(self, styled: VoxelField) -> Pictures:
        """The same views of a stylised field, float32 [H, W, 3] in [0, 1] each."""
        return [np.clip(styled.render(self.cameras, view).color, 0, 1)
                for view in range(len(self.real))]

    def consistency(self, painted: Pictures) -> dict[str, dict[str, float]]:
        """How well the stylised views agree (`consistency.consistency`)."""
        return consistency(painted, self.real, self.cameras)

    def contours(self, painted: Pictures) -> float:
        """Contours kept in the middle view, in [-1, 1] (`likeness.contour_correlation`)."""
        middle = len(self.real) // 2
        return contour_correlation(painted[middle], np.clip(self.real[middle].color, 0, 1),
                                   self.masks[middle])


def views_fidelity(styled: VoxelField, patches: PatchIndex,
                   degrees: Sequence[float] = (0.0, 45.0), size: int = 768,
                   seed: int = 0) -> float:
    """Patch fidelity of views of a stylised field, as large as an exemplar's own picture.

    Parameters
    ----------
    styled
        The stylised field.
    patches
        The exemplar's patches.
    degrees
        Yaws of the views.
    size
        Width and height of the views in pixels.
    seed
        Of the patches' places.

    Returns
    -------
    distance
        Mean over the views of `PatchIndex.fidelity` on the head (opacity over 0.5), in delta E.
    """
    cameras = arc_cameras(styled, degrees, size)
    shots = [styled.render(cameras, view) for view in range(len(cameras))]
    return float(np.mean([patches.fidelity(np.clip(shot.color, 0, 1), shot.alpha > 0.5, seed=seed)
                          for shot in shots]))
