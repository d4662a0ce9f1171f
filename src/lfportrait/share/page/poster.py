"""The poster that a page shows at first: the front view, framed like the live one."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from PIL import Image

from ...capture import Camera
from ...field import VoxelField
from ...lightfield import render_views
from ..paths import DISTANCE, head_extent

__all__ = ["poster", "start_view"]

_HEIGHT = 1000
_MARGIN = 1.04


def start_view(voxels: VoxelField) -> dict[str, Any]:
    """Where the page's camera stands at first.

    Returns
    -------
    start
        ``target`` [3]; ``distance`` from it, in world units; ``reach`` and ``half``: half width and
        half height of what must fit into the window.
    """
    reach, low, high = head_extent(voxels)
    return {"target": [0.0, (low + high) / 2, 0.0], "distance": DISTANCE,
            "reach": _MARGIN * reach, "half": _MARGIN * (high - low) / 2}


def poster(voxels: VoxelField, start: dict[str, Any]) -> bytes:
    """The front view on a clear ground, as WebP."""
    near = np.sqrt(start["distance"] ** 2 - start["reach"] ** 2)
    focal = 0.5 * _HEIGHT * near / start["half"]
    width = max(2, round(_HEIGHT * start["reach"] / start["half"]))
    size = max(_HEIGHT, width)
    camera = Camera.arc(np.zeros(1), distance=start["distance"], width=size, height=size,
                        focal=focal, target=tuple(start["target"]))
    seen = next(render_views(voxels, camera, background=0.0))
    alpha = np.clip(seen.alpha, 0.0, 1.0)[..., None]
    color = np.clip(seen.color / np.maximum(alpha, 1e-6), 0.0, 1.0)
    picture = (np.concatenate([color, alpha], axis=2) * 255.0 + 0.5).astype(np.uint8)
    top, left = (size - _HEIGHT) // 2, (size - width) // 2
    buffer = io.BytesIO()
    Image.fromarray(picture[top:top + _HEIGHT, left:left + width]).save(
        buffer, "WEBP", quality=82, method=2)
    return buffer.getvalue()
