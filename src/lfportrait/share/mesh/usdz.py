"""USDZ: a scene as text and its picture, in a zip file without compression.

Apple's Quick Look takes colors from pictures alone. Each file's content begins at a multiple of 64
bytes, so that readers can map it. The material glows in the picture's colors and reflects nothing:
the photos' light is in them already.
"""

from __future__ import annotations

import io
import zipfile
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...version import __version__
from .baking import TexturedMesh
from .pictures import jpeg

__all__ = ["write_usdz"]

ALIGNED = 64
HEADER = 30
"""Bytes of a zip member's header without its name and extra field."""
PADDING = 0x1986
"""The kind of an extra field that only takes room, as USD's own writer has it."""
EPOCH = (1980, 1, 1, 0, 0, 0)

_MATERIAL = """
    def Material "Painted"
    {
        token outputs:surface.connect = </Portrait/Painted/Surface.outputs:surface>

        def Shader "Surface"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0, 0, 0)
            color3f inputs:emissiveColor.connect = </Portrait/Painted/Picture.outputs:rgb>
            float inputs:metallic = 0
            float inputs:roughness = 1
            color3f inputs:specularColor = (0, 0, 0)
            int inputs:useSpecularWorkflow = 1
            token outputs:surface
        }

        def Shader "Picture"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @portrait.jpg@
            token inputs:sourceColorSpace = "sRGB"
            float2 inputs:st.connect = </Portrait/Painted/Places.outputs:result>
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float3 outputs:rgb
        }

        def Shader "Places"
        {
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }
    }
"""


def write_usdz(stream: BinaryIO, place: NDArray[np.float32], normals: NDArray[np.float32],
               mesh: TexturedMesh, unit: float = 1.0) -> None:
    """Write a mesh with its picture; ``unit`` is the length in metres of one of ``place``."""
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        _add(archive, "portrait.usda", _text(place, normals, mesh, unit))
        _add(archive, "portrait.jpg", jpeg(mesh.picture))


def _add(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    """Add a file whose content is aligned."""
    member = zipfile.ZipInfo(name, EPOCH)
    start = archive.fp.tell() + HEADER + len(name) + 4  # type: ignore[union-attr]
    room = -start % ALIGNED
    member.extra = PADDING.to_bytes(2, "little") + room.to_bytes(2, "little") + bytes(room)
    archive.writestr(member, content)


def _text(place: NDArray[np.float32], normals: NDArray[np.float32], mesh: TexturedMesh,
          unit: float) -> bytes:
    """The scene in USD's text form."""
    low, high = place.min(axis=0), place.max(axis=0)
    extent = ", ".join(f"({x:.6g}, {y:.6g}, {z:.6g})" for x, y, z in (low, high))
    out = io.BytesIO()
    out.write(f"""#usda 1.0
(
    customLayerData = {{ string creator = "lfportrait {__version__}" }}
    defaultPrim = "Portrait"
    metersPerUnit = {unit:.9g}
    upAxis = "Y"
)

def Xform "Portrait"
{{
    def Mesh "Head" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        uniform token subdivisionScheme = "none"
        uniform bool doubleSided = 1
        rel material:binding = </Portrait/Painted>
        float3[] extent = [{extent}]
        int[] faceVertexCounts = [""".encode())
    out.write(b"3," * (len(mesh.faces) - 1) + b"3]\n        int[] faceVertexIndices = [")
    out.write(",".join(map(str, mesh.faces.reshape(-1).tolist())).encode())
    out.write(b"]\n        point3f[] points = [")
    _rows(out, place, "(%.5g,%.5g,%.5g),")
    out.write(b"]\n        normal3f[] normals = [")
    _rows(out, normals, "(%.3g,%.3g,%.3g),")
    out.write(b'] (\n            interpolation = "vertex"\n        )\n'
              b"        texCoord2f[] primvars:st = [")
    # Rows of USD's pictures are counted from below.
    _rows(out, np.column_stack([mesh.places[:, 0], 1 - mesh.places[:, 1]]), "(%.6g,%.6g),")
    out.write(b'] (\n            interpolation = "vertex"\n        )\n    }\n')
    out.write(_MATERIAL.encode() + b"}\n")
    return out.getvalue()


def _rows(out: io.BytesIO, rows: NDArray[np.floating], pattern: str) -> None:
    """Rows of numbers, without the last one's comma."""
    out.write((pattern * len(rows) % tuple(rows.reshape(-1).tolist()))[:-1].encode())
