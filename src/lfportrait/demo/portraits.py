"""Single photos of modelled heads with exact landmarks: the embedded capture's head, and others."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..arrays import Float64, UInt8
from ..example import Sitting
from ..face import read_landmarks
from ..media.pictures import read_image
from .shipped import DATA, resized

__all__ = ["demo_photo", "embedded_sittings"]



def _portrait(path: Path, height: int) -> tuple[UInt8, Float64]:
    """A cut-out photo, uint8 [H, 3/4 H, 4], and its landmarks."""
    picture = read_image(path)
    points = np.asarray(read_landmarks(path.with_suffix(".landmarks.txt")), np.float64)
    width = height * 3 // 4
    scale = width / picture.shape[1], height / picture.shape[0]
    return resized(picture, width, height), points * scale


def demo_photo(height: int = 1024) -> tuple[UInt8, Float64]:
    """The head of the embedded capture, seen from eight degrees to its left.

    Parameters
    ----------
    height
        Of the photo in pixels, of which it has 1024; it is three quarters as wide.

    Returns
    -------
    photo, landmarks
        uint8 [H, W, 4] with straight alpha; float64 [68, 2], in pixels.
    """
    return _portrait(DATA / "people" / "sitter.webp", height)


def embedded_sittings(count: int, height: int, seed: int) -> list[Sitting]:
    """Photos of modelled heads with landmarks: 16 people in turn, backgrounds at random.

    Parameters
    ----------
    count
        Number of photos.
    height
        Of a photo in pixels; it is three quarters as wide.
    seed
        Of all choices.
    """
    random = np.random.default_rng(seed)
    files = sorted((DATA / "people").glob("person_*.webp"))
    order = random.permutation(len(files))
    made = []
    for number in range(count):
        picture, points = _portrait(files[order[number % len(order)]], height)
        alpha = picture[..., 3:].astype(np.float32) / 255
        ground = random.uniform(40, 240, 3) + random.normal(0, 4, picture[..., :3].shape)
        photo = np.clip(picture[..., :3] * alpha + ground * (1 - alpha), 0, 255).astype(np.uint8)
        made.append((photo, points))
    return made
