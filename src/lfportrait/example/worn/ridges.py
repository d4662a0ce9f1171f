"""A small upright picture of a face, and the thin lines in it by their direction.

A line is a ridge where the picture is darker (or lighter) than on *both* sides of it, a line's
width away: an edge between two tones, which is no line, does not answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...face import FacePose
from ..guides.filters import disk

__all__ = ["DIRECTIONS", "UNIT", "UprightFace", "ridges", "upright"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

UNIT = 200.0
"""Pixels a unit of the generic head, whose eyes are 0.36 apart: a rim is 2 to 6 pixels wide."""
SHAPE = 170, 260
"""Height and width of the upright picture."""
ORIGIN = np.array([130.0, 62.0])
"""Where the middle between the eyes lies in it, (x, y)."""
DIRECTIONS = 16
"""Of lines, over half a turn."""
WIDTHS = ((2.6, 0.8), (4.5, 1.3))
"""Pixels from a line to what lies beside it, and the blur before they are compared."""
AROUND = 14.0
"""Sigma in pixels of the neighbourhood whose lines a line is compared with."""
STANDS_OUT = 2.5
"""A line that is this many times stronger than its neighbourhood answers in full."""
FAINT = 0.012
"""Lines of less contrast than this, of 1, are the grain of canvas and paper."""
LIDS = 0.022
"""Lines nearer to an eye than this, in the head's units, may be its lids."""
UNKNOWN = 0.5
"""What a place that may be a lid answers."""


@dataclass(frozen=True)
class UprightFace:
    """A face without its roll, `UNIT` pixels a unit of the head.

    Attributes
    ----------
    pose
        Of the face in the picture.
    rotation
        float64 [3, 3], of the pose, without its roll.
    matrix
        float64 [2, 3], from the picture's pixels to the upright ones.
    grey
        float32 `SHAPE` in [0, 1].
    eyes
        bool `SHAPE`: eyes and lids.
    eye_middles
        float64 [2, 2], (x, y) of the left and the right one in the picture.
    """

    pose: FacePose
    rotation: Float64
    matrix: Float64
    grey: Float32
    eyes: NDArray[np.bool_]
    eye_middles: Float64

    def places(self, points: Float64) -> Float64:
        """Upright pixels [..., 2] of points [..., 3] of the generic head."""
        return self.moved(self.pose.project(points))

    def moved(self, pixels: Float64) -> Float64:
        """Upright pixels [..., 2] of the picture's [..., 2]."""
        return np.asarray(pixels @ self.matrix[:, :2].T + self.matrix[:, 2], np.float64)

    def back(self, places: Float64) -> Float64:
        """The picture's pixels [..., 2] of upright ones [..., 2]."""
        inverse = np.linalg.inv(self.matrix[:, :2])
        return np.asarray((places - self.matrix[:, 2]) @ inverse.T, np.float64)

    def seen(self, offsets: Float64) -> Float64:
        """Upright pixels [..., 2] of offsets [..., 2] in the plane of the face."""
        return np.asarray(UNIT * (offsets @ self.rotation[:2, :2].T) * [1.0, -1.0], np.float64)


def upright(image: NDArray[np.uint8], landmarks: Float64, pose: FacePose) -> UprightFace:
    """The upright face of a picture, uint8 [H, W, 3], with its landmarks, [68, 2], and pose."""
    factor = UNIT / pose.scale
    angle = np.radians(pose.roll)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = factor * np.array([[cos, -sin], [sin, cos]])
    middle = landmarks[36:48].mean(axis=0)
    matrix = np.c_[turn, ORIGIN - turn @ middle]
    rotation = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) @ pose.rotation
    height, width = SHAPE
    # What is reduced is averaged first: a thin line would fall between the pixels that are read.
    corners = (np.array([[0, 0], [width, 0], [0, height], [width, height]])
               - matrix[:, 2]) @ np.linalg.inv(turn).T
    low = np.clip(np.floor(corners.min(axis=0)).astype(int) - 2, 0,
                  np.array(image.shape[1::-1]) - 1)
    high = np.maximum(np.ceil(corners.max(axis=0)).astype(int) + 2, low + 1)
    part = cv2.cvtColor(np.ascontiguousarray(image[low[1]:high[1], low[0]:high[0]]),
                        cv2.COLOR_RGB2GRAY)
    to = matrix.copy()
    to[:, 2] += turn @ low
    if factor < 0.8:
        size = tuple(max(round(n * factor / 0.95), 1) for n in part.shape[::-1])
        to[:, :2] /= np.divide(size, part.shape[::-1])
        part = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
    grey = cv2.warpAffine(part.astype(np.float32) / 255, to, (width, height),
                          flags=cv2.INTER_LINEAR if factor < 1 else cv2.INTER_CUBIC,
                          borderMode=cv2.BORDER_REPLICATE)
    eyes = np.zeros(SHAPE, np.uint8)
    points = landmarks @ turn.T + matrix[:, 2]
    for one in (points[36:42], points[42:48]):
        cv2.fillPoly(eyes, [np.round(one * 16).astype(np.int32)], 1, shift=4)
    near = cv2.dilate(eyes, disk(LIDS * UNIT))
    return UprightFace(pose, rotation, matrix, np.asarray(grey, np.float32), near > 0,
                       np.stack([points[36:42].mean(axis=0), points[42:48].mean(axis=0)]))


def ridges(face: UprightFace) -> Float32:
    """How much a place is a thin line across each direction.

    Returns
    -------
    float32 [2, DIRECTIONS, h, w] in [0, 1]: dark lines and light ones, by the direction of their
    normal (n / DIRECTIONS of half a turn from x towards y), against the lines around them.
    """
    found = np.zeros((2, DIRECTIONS, *SHAPE), np.float32)
    for away, sigma in WIDTHS:
        grey = np.asarray(cv2.GaussianBlur(face.grey, (0, 0), sigma), np.float32)
        for number in range(DIRECTIONS):
            angle = np.pi * number / DIRECTIONS
            step = away * np.cos(angle), away * np.sin(angle)
            sides = [_shifted(grey, sign * step[0], sign * step[1]) for sign in (1, -1)]
            dark = np.minimum(*sides) - grey
            light = grey - np.maximum(*sides)
            np.maximum(found[0, number], dark, out=found[0, number])
            np.maximum(found[1, number], light, out=found[1, number])
    around = cv2.GaussianBlur(found.sum(axis=0).mean(axis=0), (0, 0), AROUND)
    found /= STANDS_OUT * around + np.float32(FAINT)
    np.minimum(found, 1, out=found)
    found[..., face.eyes] = UNKNOWN
    return found


def _shifted(grey: Float32, x: float, y: float) -> Float32:
    """A picture moved by a part of pixels, its edge repeated."""
    return np.asarray(cv2.warpAffine(grey, np.array([[1, 0, -x], [0, 1, -y]]), grey.shape[::-1],
                                     borderMode=cv2.BORDER_REPLICATE), np.float32)
