"""Meshes in binary glTF. Materials are unlit: the photos' light is in the colors already."""

from __future__ import annotations

from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...color import linear_light
from ...field import Mesh
from ..gltf import Glb
from .baking import TexturedMesh
from .pictures import jpeg

__all__ = ["write_colored_glb", "write_textured_glb"]

_UNLIT = "KHR_materials_unlit"


def write_colored_glb(stream: BinaryIO, place: NDArray[np.float32], normals: NDArray[np.float32],
                      mesh: Mesh) -> None:
    """A mesh with colors at its vertices, as linear light."""
    glb = Glb([_UNLIT])
    attributes = {"POSITION": glb.add(place, bounds=True), "NORMAL": glb.add(normals),
                  "COLOR_0": glb.add(_linear(mesh.colors), normalized=True)}
    _finish(glb, attributes, mesh.faces, {})
    glb.write(stream)


def write_textured_glb(stream: BinaryIO, place: NDArray[np.float32], normals: NDArray[np.float32],
                       mesh: TexturedMesh) -> None:
    """A mesh with a picture, sRGB."""
    glb = Glb([_UNLIT])
    attributes = {"POSITION": glb.add(place, bounds=True), "NORMAL": glb.add(normals),
                  "TEXCOORD_0": glb.add(mesh.places)}
    texture = glb.add_picture(jpeg(mesh.picture), "image/jpeg")
    _finish(glb, attributes, mesh.faces, {"baseColorTexture": {"index": texture}})
    glb.write(stream)


def _finish(glb: Glb, attributes: dict[str, int], faces: NDArray[np.int32],
            color: dict[str, Any]) -> None:
    """Describe the mesh and its material."""
    indices = glb.add(faces.reshape(-1).astype(np.uint32), indices=True)
    glb.scene["materials"] = [{
        "extensions": {_UNLIT: {}}, "doubleSided": True,
        "pbrMetallicRoughness": {**color, "metallicFactor": 0.0, "roughnessFactor": 1.0}}]
    glb.scene["meshes"] = [{"primitives": [{"attributes": attributes, "indices": indices,
                                            "material": 0}]}]


def _linear(color: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """SRGB bytes as linear light in 16 bits, with a fourth channel of ones."""
    table = (linear_light(np.arange(256) / 255.0) * 65535.0 + 0.5).astype(np.uint16)
    return np.column_stack([table[color], np.full(len(color), 65535, np.uint16)])
