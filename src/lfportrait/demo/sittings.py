"""Random portrait photos of modelled heads with exact landmarks, as training data."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..capture import Camera
from ..plugins import Sitting
from .people import PAINTED, SITTER, landmarks
from .studio import photograph

__all__ = ["embedded_sittings"]


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
    random = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        features: dict[str, Any] = {}
        for name in SITTER._fields:
            one, other = (np.asarray(getattr(model, name)) for model in (SITTER, PAINTED))
            if np.array_equal(one, other):
                continue  # Draw nothing: what neither has must not change the others' choices.
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
