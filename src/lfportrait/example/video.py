"""Transfer to a video: seeds are carried from frame to frame, so that strokes do not swim.

Chunks lie in an anchor plane. For a photo that is the picture itself; in a video the plane is
carried along by optical flow: a pixel gets the anchor of the place it came from. Where the flow
can't be trusted (the two directions disagree, the plane is torn) it starts anew. The landmarks are
carried, too, and corrected slowly by those that are detected, for their jitter is larger than the
face's motion between frames.

The flow is OpenCV's DIS. Without OpenCV the plane follows the face as a whole.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from .exemplar import face_size
from .guides import grey, pixel_centres
from .regions import find_regions
from .transfer import Transfer, face_landmarks

__all__ = ["VideoTransfer"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

FRESH = 0.25
"""Share of the detected landmarks in the carried ones."""
DISAGREE = 1.5
"""Largest difference of the flow there and back in pixels."""
TORN = (0.6, 1.7)
"""Range of the anchor plane's stretch against a new one."""


def _flow_network() -> Any:
    """OpenCV's DIS flow, or None where there is no OpenCV."""
    try:
        import cv2
    except ImportError:
        return None
    library: Any = cv2  # its stubs lack the flow
    return library.DISOpticalFlow_create(library.DISOPTICAL_FLOW_PRESET_FAST)


def _at(field: Float32, places: Float32) -> Float32:
    """``field`` [H, W, C] at continuous places [H, W, 2], bilinear, float32 [H, W, C]."""
    where = [places[..., 1] - 0.5, places[..., 0] - 0.5]
    return np.stack([map_coordinates(field[..., c], where, order=1, mode="nearest")
                     for c in range(field.shape[2])], axis=-1)


def _similarity(source: Float64, target: Float64) -> NDArray[np.complex128]:
    """Factors (a, b) of the similarity z -> a z + b that takes points to points best."""
    z, w = (points[:, 0] + 1j * points[:, 1] for points in (source, target))
    centred = z - z.mean()
    a = np.vdot(centred, w - w.mean()) / max(float(np.vdot(centred, centred).real), 1e-9)
    return np.array([a, w.mean() - a * z.mean()])


class VideoTransfer:
    """The frames of one video, one after the other.

    Parameters
    ----------
    prepared
        The exemplar.
    carry
        False keeps the seeds where they are in the picture, for comparison.

    Attributes
    ----------
    flicker
        For each frame but the first, the root mean square difference to the stylised frame before,
        warped by the flow, over the contrast of the frame; empty without OpenCV.
    """

    def __init__(self, prepared: Transfer, carry: bool = True) -> None:
        self.prepared = prepared
        self.carry = carry
        self.flicker: list[float] = []
        self._flow = _flow_network()
        self._before: NDArray[np.uint8] | None = None
        self._landmarks: Float64 | None = None
        self._anchor: Float32 | None = None
        self._first: Float64 | None = None
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
        found = self._find(frame) if landmarks is None else np.asarray(landmarks, np.float64)
        luma = np.asarray(grey(frame) * 255, np.uint8)
        pixels = pixel_centres(frame.shape)
        places = trusted = None
        if self._before is not None and self._flow is not None:
            places, trusted = self._motion(luma, pixels)
        points = self._steady(found, places, pixels)
        anchor = self._carried(pixels, points, places, trusted)
        regions = find_regions(frame, points, size=256)
        made = self.prepared.apply(frame, points, seeds_anchor=anchor if self.carry else None,
                                   regions=regions)
        if places is not None and trusted is not None and self._painted is not None:
            self._compare(made.image, places, trusted)
        self._before, self._landmarks, self._painted = luma, points, made.image
        self._anchor = anchor
        return made.image

    def _find(self, frame: NDArray[np.uint8]) -> Float64:
        from ..face import detect_landmarks

        found = detect_landmarks(frame, thorough=self._landmarks is None)
        if found is not None:
            return np.asarray(found, np.float64)
        return face_landmarks(frame) if self._landmarks is None else self._landmarks

    def _motion(self, luma: NDArray[np.uint8], pixels: Float32,
                ) -> tuple[Float32, NDArray[np.bool_]]:
        """Where each pixel was in the frame before, [H, W, 2], and whether that can be trusted."""
        back = self._flow.calc(luma, self._before, None)
        there = self._flow.calc(self._before, luma, None)
        places = pixels + back
        off = back + _at(there, places)
        height, width = luma.shape
        inside = (places > 0).all(axis=-1) & (places < [width, height]).all(axis=-1)
        return places, inside & (np.abs(off).max(axis=-1) < DISAGREE)

    def _steady(self, found: Float64, places: Float32 | None, pixels: Float32) -> Float64:
        """Landmarks of the frame before, moved along and corrected by the detected ones."""
        if self._landmarks is None or places is None:
            return found
        last = self._landmarks
        rows = np.clip(found[:, 1].astype(np.int64), 0, pixels.shape[0] - 1)
        columns = np.clip(found[:, 0].astype(np.int64), 0, pixels.shape[1] - 1)
        moved = last + np.median((pixels - places)[rows, columns], axis=0)
        # A leap is a cut or a face that was lost: no reason to glide there.
        if np.linalg.norm(found - moved, axis=1).mean() > 0.3 * face_size(found):
            return found
        return np.asarray(moved + FRESH * (found - moved), np.float64)

    def _carried(self, pixels: Float32, points: Float64, places: Float32 | None,
                 trusted: NDArray[np.bool_] | None) -> Float32:
        """The anchor plane of this frame."""
        if self._anchor is None or self._first is None:
            self._first = points
            self._scale = self.prepared.scale(points)
            return pixels * np.float32(self._scale)
        if places is None or trusted is None:
            a, b = _similarity(points, self._first)
            z = (pixels[..., 0] + 1j * pixels[..., 1]) * a + b
            return np.asarray(np.stack([z.real, z.imag], axis=-1) * self._scale, np.float32)
        anchor = _at(self._anchor, places)
        good = trusted.copy()
        for axis in range(2):
            stretch = np.hypot(*np.moveaxis(np.diff(anchor, axis=axis), -1, 0)) / self._scale
            whole = (stretch > TORN[0]) & (stretch < TORN[1])
            good[:whole.shape[0], :whole.shape[1]] &= whole
        return np.where(good[..., None], anchor, pixels * np.float32(self._scale))

    def _compare(self, image: Float32, places: Float32, trusted: NDArray[np.bool_]) -> None:
        """Add the error against the frame before."""
        assert self._painted is not None
        difference = (image - _at(self._painted, places))[trusted]
        contrast = float(np.sqrt(image[trusted].var(axis=0).mean())) if trusted.any() else 0.0
        if contrast > 1 / 255:
            self.flicker.append(float(np.sqrt((difference ** 2).mean())) / contrast)
