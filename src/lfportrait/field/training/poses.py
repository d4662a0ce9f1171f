"""Refining the cameras while the field is trained.

Cameras from structure from motion are off by a pixel or more now and then, and a field of such
photos is blurred. A few times in each level every training photo is laid on the field's rendering
of it (`align`), and training goes on with the corrected cameras: the field gets
sharper, the next corrections better. What all corrections have in common - the whole set of cameras
turned, moved or scaled - is taken out, as the field would follow it and leave the held-out cameras
behind.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Float64
from ...capture import Capture, pose_corrections, without_drift
from ..grid import VoxelField
from .align import aligned

__all__ = ["PoseRefiner"]


_COARSE, _FINEST = (0.25, 0.5, 0.75, 1.0), (0.1, 0.25, 0.4, 0.55)
"""When cameras are corrected: shares of the rays of a coarse level, and of the finest one, the end
of which belongs to the colors."""


class PoseRefiner:
    """The cameras of a reconstruction that corrects them.

    Parameters
    ----------
    capture
        The photos with the cameras as given.
    views
        The training views.
    """

    def __init__(self, capture: Capture, views: NDArray[np.int64]) -> None:
        self.given, self.views, self.names = capture.cameras, views, capture.names
        self.found = self.given[views]
        self.level, self.rounds = 0, 0

    def due(self, level: int, done: float, finest: bool) -> bool:
        """Whether it is time for a correction when a share ``done`` of a level is trained."""
        if level != self.level:
            self.level, self.rounds = level, 0
        times = _FINEST if finest else _COARSE
        return self.rounds < len(times) and done >= times[self.rounds]

    def refine(self, field: VoxelField, capture: Capture, gains: Float64) -> Capture:
        """The capture with the training views' cameras corrected once more.

        Parameters
        ----------
        field
            The field as far as it is trained.
        capture
            The photos and the cameras so far.
        gains
            float64 [V, 3], the training photos' exposures.
        """
        self.rounds += 1
        found = aligned(field, capture, self.given, self.views, gains)
        self.found = without_drift(found, self.given[self.views])
        return self.placed(capture)

    def placed(self, capture: Capture) -> Capture:
        """The capture with the training views' cameras as they were found."""
        return _with_poses(capture, self.views, self.found.pose)

    def tested(self, field: VoxelField, capture: Capture, gains: Float64,
               some: NDArray[np.int64] | None = None) -> Capture:
        """The capture with held-out cameras laid on the field, too, which learns nothing by it.

        Parameters
        ----------
        field, capture
            The field, and the photos.
        gains
            float64 [W, 3], the held-out photos' exposures.
        some
            Numbers of held-out views, from 0; by default all.
        """
        tests = capture.testing()
        if some is not None:
            tests, gains = tests[some], gains[some]
        return _with_poses(capture, tests,
                           aligned(field, capture, self.given, tests, gains, steps=8).pose)

    def figures(self) -> dict[str, Any]:
        """For ``--json``: sizes of the corrections, and the training cameras in NeRF's axes."""
        angle, share = pose_corrections(self.given[self.views], self.found)
        flip = np.diag([1.0, -1.0, -1.0, 1.0])
        return {"median_degrees": round(float(np.median(angle)), 4),
                "largest_degrees": round(float(angle.max()), 4),
                "median_share_of_distance": round(float(np.median(share)), 6),
                "largest_share_of_distance": round(float(share.max()), 6),
                "cameras": [{"name": self.names[int(view)], "transform_matrix":
                             (pose @ flip).tolist()}
                            for view, pose in zip(self.views, self.found.pose)]}

    # -- checkpoints ------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {"poses": self.found.pose, "pose_rounds": np.array([self.level, self.rounds])}

    def restore(self, state: dict[str, Any], capture: Capture) -> Capture:
        """Go on from a checkpoint; returns the capture with its cameras.

        Raises
        ------
        KeyError
            If the checkpoint has no cameras.
        """
        self.found = replace(self.found, pose=state["poses"])
        self.level, self.rounds = (int(count) for count in state["pose_rounds"])
        return self.placed(capture)


def _with_poses(capture: Capture, views: NDArray[np.int64], poses: Float64) -> Capture:
    every = capture.cameras.pose.copy()
    every[views] = poses
    return replace(capture, cameras=replace(capture.cameras, pose=every))
