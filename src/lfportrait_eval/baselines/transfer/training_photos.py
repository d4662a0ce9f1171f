"""Training photos for a style network: portraits with small rotations and zooms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from lfportrait.errors import UserError
from lfportrait.media.pictures import read_image
from lfportrait.plugins import Sitting

__all__ = ["folder_sittings", "varied"]

SUFFIXES = {".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff"}


def folder_sittings(folder: Path) -> list[Sitting]:
    """The photos of a folder in which a face is found.

    Raises
    ------
    UserError
        If the folder is missing or no photo in it shows a face.
    """
    from lfportrait.face import detect_landmarks

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


def varied(sitting: Sitting, side: int, random: np.random.Generator) -> Sitting:
    """A photo with a small random rotation, shift and zoom, its longer side ``side`` pixels.

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
