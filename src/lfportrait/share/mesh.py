"""Textured meshes of a field: the surface with its painting as a picture, for GLB, USDZ and OBJ.

The picture is the atlas of a skin: views of the head from far away, side by side
(`lfportrait.example.draw_atlas`). A face belongs to the chart that shows its middle; where charts
meet, corners are doubled. What no chart sees (behind an ear, in a fold) gets small pieces of
picture of its own below the charts, with the colors of the face's corners.

Materials are unlit, they glow in the picture's colors and reflect nothing: the photos' light is in
the colors already. OBJ has its colors at vertices, or in a picture beside it; PLY holds points and
colored meshes; USDZ is a scene as text and its picture (Apple's Quick Look takes colors from
pictures alone), in a zip file without compression, where each file's content begins at a multiple
of 64 bytes, so that readers can map it.
"""

import hashlib
import io
import re
import unicodedata
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np

from ..arrays import Array, Bool, Float32, Float64, Floats, Int32, Int64, UInt8
from ..color import linear_light, to_uint8
from ..errors import UserError
from ..example import Atlas, draw_atlas
from ..field import Mesh, PointCloud, VoxelField
from ..files import aligned_member, atomic_write, image_bytes, write_bytes
from ..version import __version__
from .gltf import Glb

FINER = 1.5
"""Pixels of the picture per texel of a painted field: looking up between pixels blurs a little."""
PLAIN = 1.5  # Pixels of the picture per lattice point, where the field has no texture.
LARGEST = 4096  # Side of the picture at most: what phones show.
NEAR = 4.0  # Lattice spacings that a face may lie before a chart's surface or under it.
PIECE = 4
"""Side in pixels of the piece of a face that no chart shows; its corners lie one pixel inside."""


@dataclass(frozen=True)
class TexturedMesh:
    """A mesh of V corners with a picture on it."""

    # vertices, normals: float32 [V, 3].
    vertices: Float32
    normals: Float32
    places: Float32  # float32 [V, 2], where in the picture, 0 to 1; x to the right, y down.
    faces: Int32  # int32 [F, 3], counter-clockwise from outside.
    picture: UInt8  # uint8 [H, W, 3], sRGB.


def bake_texture(field: VoxelField, mesh: Mesh) -> TexturedMesh:
    """Unwrap a mesh (`lfportrait.field.field_mesh`) of a field in the portrait frame, and paint it.

    It has less than 5 million faces.
    """
    atlas = _atlas(field)
    chart = _charts(field, atlas, mesh)
    # Where each chart shows each corner, [C, V, 2], in pixels of the atlas.
    places = atlas.cameras.project(mesh.vertices.astype(np.float64))[0] + atlas.boxes[:, None, 4:]
    fits = _inside(atlas, chart, places, mesh.faces)
    chart = np.where(fits, chart, -1)
    picture = _filled(atlas)
    seen, faces = np.flatnonzero(chart >= 0), mesh.faces
    # A corner of each chart that it is used in.
    keys = faces[seen].astype(np.int64) + len(mesh.vertices) * chart[seen, None]
    used, corners = np.unique(keys, return_inverse=True)
    origin = used % len(mesh.vertices)
    at = places[used // len(mesh.vertices), origin]
    hidden = faces[chart < 0]
    pieces, more = _pieces(mesh.colors[hidden], picture.shape[1])
    more[..., 1] += picture.shape[0]
    picture = np.concatenate([picture, pieces])
    origin = np.concatenate([origin, hidden.reshape(-1)])
    at = np.concatenate([at, more.reshape(-1, 2)])
    joined = np.empty(faces.shape, np.int32)
    joined[chart >= 0] = corners.reshape(-1, 3)
    joined[chart < 0] = len(used) + np.arange(hidden.size).reshape(-1, 3)
    size = np.array(picture.shape[1::-1])
    return TexturedMesh(mesh.vertices[origin], mesh.normals[origin],
                        (at / size).astype(np.float32), joined, picture)


def _atlas(field: VoxelField) -> Atlas:
    """The charts, as fine as the field's painting, unless the picture gets too large."""
    pixels = (PLAIN / float(field.spacing.mean()) if field.texture is None
              else FINER * field.texture.pixels)
    for _ in range(8):
        atlas = draw_atlas(field, pixels)
        # Room is left for the pieces.
        largest = max(atlas.depth.shape[1] / LARGEST, atlas.depth.shape[0] / (0.9 * LARGEST))
        if largest <= 1:
            return atlas
        pixels *= 0.98 / largest
    raise UserError("the field is too long and thin for a texture; export it with --texture no")


def _charts(field: VoxelField, atlas: Atlas, mesh: Mesh) -> Int64:
    """The chart that shows each face's middle, int64 [F]; -1 where none does."""
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    near = NEAR * float(field.spacing.max())
    places, _ = atlas.locate(middles, near, near)
    chart = np.full(len(middles), -1, np.int64)
    for number, (x0, y0, x1, y1, dx, dy) in enumerate(atlas.boxes.tolist()):
        x, y = places.T - np.array([[dx], [dy]])
        chart[(x >= x0) & (x < x1) & (y >= y0) & (y < y1)] = number
    return chart


def _inside(atlas: Atlas, chart: Int64, places: Float64, faces: Int32) -> Bool:
    """Faces whose corners lie within their chart, and that it shows from outside, bool [F]."""
    corners = places[np.maximum(chart, 0)[:, None], faces]
    x0, y0, x1, y1, dx, dy = atlas.boxes[np.maximum(chart, 0)].T[:, :, None]
    x, y = corners[..., 0] - dx, corners[..., 1] - dy
    within = ((x >= x0 + 1) & (x <= x1 - 1) & (y >= y0 + 1) & (y <= y1 - 1)).all(axis=1)
    side, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    # Rows run down: what is counter-clockwise in the world turns the other way here.
    facing = side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0] < 0
    return np.asarray((chart >= 0) & within & facing)


def _filled(atlas: Atlas) -> UInt8:
    """The charts' colors, and beside the surface those of the nearest pixel on it."""
    color = to_uint8(atlas.color)
    empty = ~np.isfinite(atlas.depth)
    # What lies on the rim is mixed with what is behind: it takes its neighbour's color, too.
    rim = cv2.dilate(empty.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    known = ~rim if not rim.all() else ~empty
    _, labels = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    nearest = np.zeros(int(labels.max()) + 1, np.int64)
    nearest[labels[known]] = np.flatnonzero(known)
    return np.asarray(color.reshape(-1, 3)[nearest[labels]], np.uint8)


def _pieces(colors: UInt8, width: int) -> tuple[UInt8, Float32]:
    """A picture [H, width, 3] of unseen faces' corners, uint8 [K, 3, 3], and their places in it."""
    across = width // PIECE
    number = np.arange(len(colors))
    left, top = number % across * PIECE, number // across * PIECE
    rows = -(-len(colors) // across)
    first, right, below = (colors[:, n].astype(np.int64) for n in range(3))
    square = np.stack([first, right, below, np.clip(right + below - first, 0, 255)], axis=1)
    # Two by two pixels between which colors run evenly, and a rim of the same.
    inner = square.reshape(-1, 2, 2, 3)
    block = inner.repeat(2, axis=1).repeat(2, axis=2).astype(np.uint8)
    blocks = np.zeros((rows * across, PIECE, PIECE, 3), np.uint8)
    blocks[:len(colors)] = block
    picture = blocks.reshape(rows, across, PIECE, PIECE, 3).swapaxes(1, 2).reshape(
        rows * PIECE, across * PIECE, 3)
    picture = np.pad(picture, [(0, 0), (0, width - across * PIECE), (0, 0)])
    corners = np.array([[1.5, 1.5], [2.5, 1.5], [1.5, 2.5]])
    places = np.stack([left, top], axis=1)[:, None] + corners
    return picture, places.astype(np.float32)


LONGEST = 60  # Letters that are kept of a name that is not plain.
_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
_ODD = re.compile(r"[^A-Za-z0-9_.-]+")


def plain_stem(stem: str) -> str:
    """A file's name without its ending, in ASCII letters, digits and ``-``, ``_``, ``.``.

    A plain name stays. Others get six digits of their hash, so that ``a b`` and ``a_b`` in one
    folder have files of their own, and the same name gives the same files again.
    """
    if _PLAIN.fullmatch(stem):
        return stem
    # Some file systems take letters apart that others keep together.
    stem = unicodedata.normalize("NFC", stem)
    letters = "".join(letter for letter in unicodedata.normalize("NFKD", stem)
                      if not unicodedata.combining(letter))
    # A reader would take a dash at the start for an option.
    kept = _ODD.sub("_", letters)[:LONGEST].strip("_.-") or "portrait"
    return f"{kept}-{hashlib.sha256(stem.encode('utf-8', 'surrogateescape')).hexdigest()[:6]}"


def jpeg(picture: UInt8) -> bytes:
    """A JPEG file of a picture [H, W, 3], at full resolution in color as well."""
    return image_bytes(picture, "JPEG", quality=94, subsampling=0)


_UNLIT = "KHR_materials_unlit"


def write_glb(stream: BinaryIO, place: Float32, normals: Float32,
              mesh: Mesh | TexturedMesh) -> None:
    """A mesh with a picture, sRGB, or with colors at its vertices, as linear light."""
    glb = Glb([_UNLIT])
    attributes = {"POSITION": glb.add(place, bounds=True), "NORMAL": glb.add(normals)}
    color: dict[str, Any] = {}
    if isinstance(mesh, TexturedMesh):
        attributes["TEXCOORD_0"] = glb.add(mesh.places)
        color = {"baseColorTexture": {"index": glb.add_jpeg(jpeg(mesh.picture))}}
    else:
        # Linear light in 16 bits, with a fourth channel of ones.
        table = (linear_light(np.arange(256) / 255.0) * 65535.0 + 0.5).astype(np.uint16)
        attributes["COLOR_0"] = glb.add(np.column_stack([
            table[mesh.colors], np.full(len(mesh.colors), 65535, np.uint16)]), normalized=True)
    indices = glb.add(mesh.faces.reshape(-1).astype(np.uint32), indices=True)
    glb.scene["materials"] = [{
        "extensions": {_UNLIT: {}}, "doubleSided": True,
        "pbrMetallicRoughness": {**color, "metallicFactor": 0.0, "roughnessFactor": 1.0}}]
    glb.scene["meshes"] = [{"primitives": [{"attributes": attributes, "indices": indices,
                                            "material": 0}]}]
    glb.write(stream)


_AT_ONCE = 1 << 14  # Lines that are formatted together.


def _write_lines(stream: BinaryIO, rows: Array, form: str) -> None:
    """Write each row [N, C] as a line of that form: what `numpy.savetxt` does a row at a time."""
    line = form + "\n"
    for first in range(0, len(rows), _AT_ONCE):
        some = rows[first:first + _AT_ONCE]
        stream.write((len(some) * line % tuple(some.ravel().tolist())).encode())


def write_colored_obj(stream: BinaryIO, place: Float32, normals: Float32, mesh: Mesh) -> None:
    """A mesh with a color behind each position, as Blender and MeshLab write it."""
    stream.write(f"# lfportrait {__version__}\n".encode())
    _write_lines(stream, np.hstack([place, mesh.colors / 255.0]), "v %.6f %.6f %.6f %.4f %.4f %.4f")
    _write_lines(stream, normals, "vn %.4f %.4f %.4f")
    _write_lines(stream, np.repeat(mesh.faces + 1, 2, axis=1), "f %d//%d %d//%d %d//%d")


def write_textured_obj(path: Path, place: Float32, normals: Float32,
                       mesh: TexturedMesh) -> list[Path]:
    """Write ``NAME.obj``, ``NAME.mtl`` and ``NAME_texture.png``, which are returned.

    The names of the material and of the picture stand in the files, in plain letters
    (`plain_stem`). The mesh, which names the others, is written last.
    """
    stem = plain_stem(path.stem)
    material, picture = path.with_name(f"{stem}.mtl"), path.with_name(f"{stem}_texture.png")
    write_bytes(picture, image_bytes(mesh.picture, "PNG", compress_level=6))
    write_bytes(material, (
        f"# lfportrait {__version__}\nnewmtl portrait\nillum 0\nKa 1 1 1\nKd 1 1 1\n"
        f"Ks 0 0 0\nmap_Ka {picture.name}\nmap_Kd {picture.name}\n").encode())
    with atomic_write(path) as stream:
        stream.write(f"# lfportrait {__version__}\nmtllib {material.name}\no portrait\n"
                     "usemtl portrait\n".encode())
        _write_lines(stream, place, "v %.6f %.6f %.6f")
        # Rows of an OBJ's pictures are counted from below.
        _write_lines(stream, np.column_stack([mesh.places[:, 0], 1 - mesh.places[:, 1]]),
                     "vt %.6f %.6f")
        _write_lines(stream, normals, "vn %.4f %.4f %.4f")
        _write_lines(stream, np.repeat(mesh.faces + 1, 3, axis=1), "f %d/%d/%d %d/%d/%d %d/%d/%d")
    return [path, material, picture]


def write_ply(stream: BinaryIO, place: Float32, normals: Float32, item: PointCloud | Mesh) -> None:
    """Binary PLY: position, normal, color, and a point's opacity or the faces."""
    columns = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    columns += [(name, "u1") for name in ("red", "green", "blue")]
    if isinstance(item, PointCloud):
        columns.append(("opacity", "<f4"))
    rows = np.empty(len(place), columns)
    for axis in range(3):
        rows["xyz"[axis]] = place[:, axis]
        rows["n" + "xyz"[axis]] = normals[:, axis]
        rows[("red", "green", "blue")[axis]] = item.colors[:, axis]
    header = ["ply", "format binary_little_endian 1.0", f"comment lfportrait {__version__}",
              f"element vertex {len(rows)}"]
    header += [f"property {'uchar' if kind == 'u1' else 'float'} {name}" for name, kind in columns]
    faces = None
    if isinstance(item, PointCloud):
        rows["opacity"] = item.opacity
    else:
        faces = np.empty(len(item.faces), [("count", "u1"), ("corners", "<i4", 3)])
        faces["count"], faces["corners"] = 3, item.faces
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    stream.write(("\n".join([*header, "end_header"]) + "\n").encode())
    stream.write(rows.tobytes())
    if faces is not None:
        stream.write(faces.tobytes())


PADDING = 0x1986  # The kind of an extra field that only takes room, as USD's own writer has it.

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


def write_usdz(stream: BinaryIO, place: Float32, normals: Float32,
               mesh: TexturedMesh, unit: float = 1.0) -> None:
    """Write a mesh with its picture; ``unit`` is the length in metres of one of ``place``."""
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, content in (("portrait.usda", _text(place, normals, mesh, unit)),
                              ("portrait.jpg", jpeg(mesh.picture))):
            archive.writestr(aligned_member(stream, name, PADDING), content)


def _text(place: Float32, normals: Float32, mesh: TexturedMesh, unit: float) -> bytes:
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


def _rows(out: io.BytesIO, rows: Floats, pattern: str) -> None:
    """Rows of numbers, without the last one's comma."""
    out.write((pattern * len(rows) % tuple(rows.reshape(-1).tolist()))[:-1].encode())
