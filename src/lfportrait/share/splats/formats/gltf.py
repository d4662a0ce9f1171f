"""Splats in a binary glTF by the extension ``KHR_gaussian_splatting``."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from ....color import linear_light
from ....field import C0
from ...gltf import Glb
from ..cloud import Splats

__all__ = ["write_glb"]

NAME = "KHR_gaussian_splatting"


def write_glb(stream: BinaryIO, splats: Splats) -> None:
    """Write splats; programs without the extension show them as colored points."""
    glb = Glb([NAME])
    attributes = {"POSITION": glb.add(splats.positions, bounds=True),
                  "COLOR_0": glb.add(_fallback(splats), normalized=True),
                  f"{NAME}:ROTATION": glb.add(np.roll(splats.turns, -1, axis=1)),
                  f"{NAME}:SCALE": glb.add(splats.scales),
                  f"{NAME}:OPACITY": glb.add(splats.opacity)}
    for place in range(splats.sh.shape[2]):
        degree = int(np.sqrt(place))
        attributes[f"{NAME}:SH_DEGREE_{degree}_COEF_{place - degree ** 2}"] = glb.add(
            splats.sh[:, :, place])
    # Colors are mixed as sRGB, as the field's are.
    glb.scene["meshes"] = [{"primitives": [{
        "attributes": attributes, "mode": 0,
        "extensions": {NAME: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display",
                              "sortingMethod": "cameraDistance", "projection": "perspective"}}}]}]
    glb.write(stream)


def _fallback(splats: Splats) -> np.ndarray:
    """Colors and opacities of points, linear light, uint8 [N, 4]."""
    color = linear_light(np.clip(C0 * splats.sh[:, :, 0] + 0.5, 0, 1))
    return np.rint(255 * np.column_stack([color, splats.opacity])).astype(np.uint8)
