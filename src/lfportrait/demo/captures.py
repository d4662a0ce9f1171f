"""The embedded capture: a modelled head, photographed from known cameras in soft light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..arrays import Float64
from ..capture import Capture
from ..errors import UserError
from ..files import read_json
from .shipped import DATA, resized

__all__ = ["demo_capture", "demo_landmarks"]

SIZE, VIEWS = 384, 60
"""Width and height of the photos in pixels, and their number."""
LEAST_SIZE, LEAST_VIEWS = 16, 4


def demo_landmarks() -> Float64:
    """The 68 landmarks of the embedded capture's head, float64 [68, 3], in its world."""
    return np.array(read_json(DATA / "capture" / "transforms.json")["landmarks"])


def demo_capture(size: int = SIZE, views: int = VIEWS) -> Capture:
    """The embedded capture.

    Its cameras stand on four arcs about the head, from below to far above; the one at eye level
    reaches from yaw -105 to 105 degrees. Fewer views are spread evenly over all arcs.

    Parameters
    ----------
    size
        Width and height of the pictures in pixels, at most 384.
    views
        Number of cameras, at most 60; every 8th is held out.

    Returns
    -------
    capture
        With straight alpha and the 68 landmarks; its frame is the portrait frame (identity).

    Raises
    ------
    UserError
        If there are no such photos.
    """
    if not LEAST_VIEWS <= views <= VIEWS:
        raise UserError(f"the demo has {VIEWS} photos; give a number from {LEAST_VIEWS} to {VIEWS} "
                        f"with --views, not {views}")
    if not LEAST_SIZE <= size <= SIZE:
        raise UserError(f"the demo's photos are {SIZE} pixels wide; give a size from {LEAST_SIZE} "
                        f"to {SIZE} with --size, not {size}")
    whole = Capture.load(DATA / "capture")
    assert whole.alphas is not None
    chosen = ((np.arange(views) + 0.5) * VIEWS / views).astype(int)
    images, alphas = [], []
    for view in chosen:
        picture = resized(np.dstack([whole.images[view], whole.alphas[view]]), size, size)
        alphas.append(np.ascontiguousarray(picture[..., 3]))
        images.append(picture[..., :3] * (picture[..., 3:] > 0))
    return replace(whole, cameras=whole.cameras[chosen].scaled(size / SIZE), images=images,
                   alphas=alphas, names=[Path(whole.names[view]).stem for view in chosen],
                   held_out=np.arange(views) % 8 == 4)
