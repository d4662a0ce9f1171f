"""Soft regions of a portrait, and the control points that they add to the landmarks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LABELS", "Regions", "find_regions", "match_regions"]

LABELS = ("background",)
Float32 = NDArray[np.float32]


@dataclass
class Regions:
    person: Float32
    landmarks: NDArray[np.float64]

    def labels(self) -> NDArray[np.uint8]:
        return np.zeros((*self.person.shape, 0), np.uint8)

    def box(self) -> tuple[float, float, float, float]:
        low, high = self.landmarks.min(axis=0), self.landmarks.max(axis=0)
        w, h = high - low
        return low[0] - 0.3 * w, low[1] - 0.9 * h, high[0] + 0.3 * w, high[1] + 0.1 * h


def find_regions(image, landmarks, mask) -> Regions:
    h, w = image.shape[:2]
    c = (landmarks[27] + landmarks[30]) / 2
    s = np.ptp(landmarks[:, 0])
    y, x = np.mgrid[:h, :w].astype(np.float32)
    r = np.hypot((x - c[0]) / (0.65 * s), (y - c[1]) / (0.95 * s))
    return Regions(np.clip((1.15 - r) / 0.3, 0, 1).astype(np.float32), landmarks)


def match_regions(landmarks, regions, style_landmarks, style_regions, contours):
    return landmarks, style_landmarks, np.ones(68)
