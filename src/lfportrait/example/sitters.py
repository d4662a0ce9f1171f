"""Photos to train a network of one style on: a folder of portraits, or embedded heads at random."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..errors import UserError
from ..files import read_image

__all__ = ["Sitting", "embedded_sittings", "folder_sittings", "varied"]

Sitting = tuple[NDArray[np.uint8], NDArray[np.float64]]
"""A photo, uint8 [H, W, 3], and its landmarks [68, 2]."""

SUFFIXES = {".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"}


def folder_sittings(folder: Path) -> list[Sitting]:
    """The photos of a folder in which a face is found.

    Raises
    ------
    UserError
        If the folder is missing or no photo in it shows a face.
    """
    from ..face import detect_landmarks

    if not folder.is_dir():
        raise UserError(f"no such folder of photos to train on: {folder}")
    found = []
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in SUFFIXES:
            continue
        photo = np.ascontiguousarray(read_image(path)[..., :3])
        landmarks = detect_landmarks(photo)
        if landmarks is not None:
            found.append((photo, landmarks))
    if not found:
        raise UserError(f"no photo in {folder} shows a face; give a folder with portraits")
    return found


def embedded_sittings(count: int, height: int, seed: int) -> list[Sitting]:
    """Photos of modelled heads: people, views and backgrounds at random.

    Parameters
    ----------
    count
        Number of photos.
    height
        Of a photo in pixels; it is three quarters as wide.
    seed
        Of all choices.
    """
    # The demo stage stands above this one, so it is imported when it is asked for, not before.
    from ..capture import Camera
    from ..demo import PAINTED, SITTER, landmarks, photograph

    random = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        features: dict[str, Any] = {}
        for name in SITTER._fields:
            one, other = (np.asarray(getattr(model, name)) for model in (SITTER, PAINTED))
            value = one + random.random() * (other - one)
            features[name] = tuple(value.tolist()) if value.ndim else float(value)
        person = SITTER._replace(**features)
        distance = random.uniform(3.6, 4.6)
        camera = Camera.arc(random.uniform(-25, 25, 1), distance=distance, width=height * 3 // 4,
                            height=height, focal=2.2 * height)
        shot = photograph(person, camera).image
        alpha = shot[..., 3:].astype(np.float32) / 255
        ground = random.uniform(40, 240, 3) + random.normal(0, 4, shot[..., :3].shape)
        photo = np.clip(shot[..., :3] * alpha + ground * (1 - alpha), 0, 255).astype(np.uint8)
        made.append((photo, camera.project(landmarks(person))[0][0]))
    return made


def varied(sitting: Sitting, side: int, random: np.random.Generator) -> Sitting:
    """A photo a little turned, moved and enlarged, its longer side ``side`` pixels.

    Parameters
    ----------
    sitting
        The photo and its landmarks.
    side
        Longer side of the result in pixels; the shape stays.
    random
        Where the choices come from.
    """
    photo, landmarks = sitting
    height, width = photo.shape[:2]
    scale = side / max(height, width)
    size = max(round(width * scale), 16), max(round(height * scale), 16)
    angle, zoom = np.radians(random.uniform(-8, 8)), scale * random.uniform(0.9, 1.15)
    turn = zoom * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    middle = np.array([width, height]) / 2
    goal = np.array(size) / 2 + random.uniform(-0.04, 0.04, 2) * size
    back = np.linalg.inv(turn)
    offset = middle - back @ goal
    # Halving first keeps the bilinear look-up from skipping pixels.
    half = max(1, int(1 / zoom))
    small = Image.fromarray(photo).reduce(half) if half > 1 else Image.fromarray(photo)
    # What lies beyond the border is its reflection.
    border = max(size) // 2
    padded = np.pad(np.asarray(small), ((border, border), (border, border), (0, 0)), "reflect" if
                    min(small.size) > border else "edge")
    coefficients = np.column_stack([back, offset]) / half
    coefficients[:, 2] += border
    turned = Image.fromarray(padded).transform(
        size, Image.Transform.AFFINE, tuple(coefficients.ravel()), Image.Resampling.BICUBIC)
    return np.asarray(turned), (landmarks - middle) @ turn.T + goal
