"""Transfer to a video: seeds are carried from frame to frame, so that strokes do not swim.

Chunks lie in an anchor plane. For a photo that is the picture itself; in a video the plane is
carried along by optical flow (`motion`): a pixel gets the anchor of the place it came from. Where
the flow can't be trusted, or the plane is torn, it starts anew. Landmarks and the masks of person
and hair are carried, too, and corrected slowly by those that are found every few frames: their
jitter is larger than what a frame's flow is off.

Without OpenCV there is no flow: everything is found in every frame, and the plane follows the face
as a whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from ..kernels.example_video import mend, squared_changes, to_bytes
from .ahead import ahead
from .exemplar import face_size
from .guides import pixel_centres
from .motion import Flow, Motion
from .regions import Regions, find_regions
from .transfer import Transfer, face_landmarks

__all__ = ["VideoTransfer"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

FRESH = 0.25
"""Share of the detected landmarks in the carried ones."""
TORN = (0.6, 1.7)
"""Range of the anchor plane's stretch against a new one."""
DETECT = 2
"""Landmarks are detected in every so manieth frame."""
SEGMENT = 3
"""And person and hair segmented."""
FRESH_MASKS = 0.5
"""Share of the segmented masks in the carried ones."""


def _similarity(source: Float64, target: Float64) -> NDArray[np.complex128]:
    """Factors (a, b) of the similarity z -> a z + b that takes points to points best."""
    z, w = (points[:, 0] + 1j * points[:, 1] for points in (source, target))
    centred = z - z.mean()
    a = np.vdot(centred, w - w.mean()) / max(float(np.vdot(centred, centred).real), 1e-9)
    return np.array([a, w.mean() - a * z.mean()])


def _moved(points: Float64, source: Float64, target: Float64) -> Float64:
    """Points moved by the similarity that takes ``source`` to ``target``."""
    a, b = _similarity(source, target)
    z = (points[:, 0] + 1j * points[:, 1]) * a + b
    return np.stack([z.real, z.imag], axis=-1)


@dataclass(frozen=True)
class _Followed:
    """What is known of a frame before it is painted."""

    frame: NDArray[np.uint8]
    points: Float64
    anchor: Float32
    regions: Regions
    motion: Motion | None


class VideoTransfer:
    """The frames of one video, one after the other.

    Parameters
    ----------
    prepared
        The exemplar.
    carry
        False keeps the seeds where they are in the picture, for comparison.
    detect, segment
        Landmarks are detected, person and hair segmented, in every so manieth frame; between they
        are carried.

    Attributes
    ----------
    flicker
        For each frame but the first, the root mean square difference to the stylised frame before,
        warped by the flow, over the contrast of the frame; empty without OpenCV. Every second
        pixel of every second row is looked at.
    """

    def __init__(self, prepared: Transfer, carry: bool = True, detect: int = DETECT,
                 segment: int = SEGMENT) -> None:
        self.prepared = prepared
        self.carry = carry
        self.detect, self.segment = detect, segment
        self.flicker: list[float] = []
        self._flow = Flow()
        self._number = 0
        self._landmarks: Float64 | None = None
        self._first: Float64 | None = None
        self._anchor: Float32 | None = None
        self._regions: Regions | None = None
        self._painted: Float32 | None = None
        self._scale = 1.0

    def apply(self, frame: NDArray[np.uint8],
              landmarks: NDArray[np.floating] | None = None) -> Float32:
        """Stylise the next frame.

        Parameters
        ----------
        frame
            uint8 [H, W, 3], all of one size.
        landmarks
            [68, 2]; detected if None. Where no face is found those of the frame before serve.

        Returns
        -------
        float32 [H, W, 3] in [0, 1].

        Raises
        ------
        UserError
            If there is no face in the first frame.
        """
        return self._paint(self._follow(frame, landmarks))

    def frames(self, frames: Iterable[NDArray[np.uint8]]) -> Iterator[NDArray[np.uint8]]:
        """Stylise frames one after the other, the next ones being followed and painted meanwhile.

        Each of the two steps has its thread and half of the processors, so that neither waits for
        the other, nor for what takes the pictures.

        Parameters
        ----------
        frames
            uint8 [H, W, 3], all of one size; taken on another thread.

        Returns
        -------
        Iterator over uint8 [H, W, 3], the same bytes as from `apply`.
        """
        def bytes_of(made: Float32) -> NDArray[np.uint8]:
            out = np.empty(made.shape, np.uint8)
            to_bytes(made, out)
            return out

        if not _threads_share_kernels():
            yield from (bytes_of(self.apply(frame)) for frame in frames)
            return
        share = max(1, numba.get_num_threads() // 2)

        def start() -> None:
            numba.set_num_threads(share)

        followed = ahead((self._follow(frame) for frame in frames), start=start)
        yield from ahead((bytes_of(self._paint(step)) for step in followed), start=start)

    def _follow(self, frame: NDArray[np.uint8],
                landmarks: NDArray[np.floating] | None = None) -> _Followed:
        """Landmarks, regions and anchor plane of the next frame."""
        motion = self._flow.next(frame)
        points = self._points(frame, landmarks, motion)
        anchor = self._carried(frame.shape, points, motion)
        self._regions = self._segmented(frame, points, motion)
        self._landmarks, self._anchor = points, anchor
        self._number += 1
        return _Followed(frame, points, anchor, self._regions, motion)

    def _paint(self, step: _Followed) -> Float32:
        image = self.prepared.apply(step.frame, step.points, regions=step.regions,
                                    seeds_anchor=step.anchor if self.carry else None).image
        if step.motion is not None and self._painted is not None:
            self._compare(image, self._painted, step.motion)
        self._painted = image
        return image

    def _find(self, frame: NDArray[np.uint8]) -> Float64:
        from ..face import detect_landmarks

        found = detect_landmarks(frame, thorough=self._landmarks is None)
        if found is not None:
            return np.asarray(found, np.float64)
        return face_landmarks(frame) if self._landmarks is None else self._landmarks

    def _points(self, frame: NDArray[np.uint8], landmarks: NDArray[np.floating] | None,
                motion: Motion | None) -> Float64:
        """Landmarks of the frame before, moved along and corrected by those found."""
        last = self._landmarks
        if last is None or motion is None:
            return self._find(frame) if landmarks is None else np.asarray(landmarks, np.float64)
        moved = motion.onward(last)
        # The jaw lies on the border of what moves: it follows the rest of the face.
        moved[:17] = _moved(last[:17], last[17:], moved[17:])
        if landmarks is None and self._number % self.detect:
            return moved
        found = self._find(frame) if landmarks is None else np.asarray(landmarks, np.float64)
        # A leap is a face that was lost: no reason to glide there.
        if np.linalg.norm(found - moved, axis=1).mean() > 0.3 * face_size(found):
            return found
        return np.asarray(moved + FRESH * (found - moved), np.float64)

    def _segmented(self, frame: NDArray[np.uint8], points: Float64,
                   motion: Motion | None) -> Regions:
        """Person and hair of the frame before, carried along, or found, or both."""
        last = self._regions
        wanted = self._number % self.segment == 0
        if last is None or motion is None:
            return find_regions(frame, points, size=256)
        planes = [last.person] if last.hair is None else [last.person, last.hair]
        carried = motion.carry(np.stack(planes, axis=-1))
        if wanted:
            found = find_regions(frame, points, size=256)
            if (found.hair is None) != (last.hair is None):
                return found
            fresh = np.stack([found.person] if found.hair is None
                             else [found.person, found.hair], axis=-1)
            share = np.where(motion.trusted, np.float32(FRESH_MASKS), np.float32(1))
            share = share.repeat(motion.factor, 0).repeat(motion.factor, 1)
            carried += share[:frame.shape[0], :frame.shape[1], None] * (fresh - carried)
        return Regions(points, np.ascontiguousarray(carried[..., 0]),
                       np.ascontiguousarray(carried[..., 1]) if last.hair is not None else None)

    def _carried(self, shape: tuple[int, ...], points: Float64, motion: Motion | None) -> Float32:
        """The anchor plane of this frame."""
        if self._anchor is None or self._first is None:
            self._first = points
            self._scale = self.prepared.scale(points)
            return pixel_centres(shape) * np.float32(self._scale)
        if motion is None:
            pixels = pixel_centres(shape)
            a, b = _similarity(points, self._first)
            z = (pixels[..., 0] + 1j * pixels[..., 1]) * a + b
            return np.asarray(np.stack([z.real, z.imag], axis=-1) * self._scale, np.float32)
        out = np.empty_like(self._anchor)
        mend(motion.carry(self._anchor), motion.trusted, motion.factor, np.float32(self._scale),
             np.float32(TORN[0]), np.float32(TORN[1]), out)
        return out

    def _compare(self, image: Float32, before: Float32, motion: Motion) -> None:
        """Add the error against the frame before."""
        sums = np.empty((motion.trusted.shape[0], 8), np.float64)
        squared_changes(image, before, motion.back, motion.factor, motion.trusted, sums)
        total = sums.sum(axis=0)
        count = max(float(total[0]), 1.0)
        contrast = float(np.sqrt(max((total[5:] / count - (total[2:5] / count) ** 2).mean(), 0.0)))
        if contrast > 1 / 255:
            self.flicker.append(float(np.sqrt(total[1] / (3 * count))) / contrast)


def _threads_share_kernels() -> bool:
    """Whether kernels may run on several threads at once: Numba's own pool forbids it."""
    try:
        return bool(numba.threading_layer() != "workqueue")
    except ValueError:
        return False
