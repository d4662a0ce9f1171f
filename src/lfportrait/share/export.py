"""Export a field: point clouds, colored meshes, svox2's checkpoint.

PLY and OBJ hold sRGB colors a vertex, as their readers expect. A GLB's vertex colors are linear
light, and its material is unlit: the photos' light is in the colors already.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from ..color import linear_light
from ..errors import UserError
from ..field import Mesh, PointCloud, VoxelField, field_mesh, field_points, save_checkpoint
from ..files import atomic_write
from ..version import __version__

__all__ = ["ExportConfig", "export_field"]

_SUFFIXES = (".ply", ".obj", ".glb", ".npz")


@dataclass(frozen=True)
class ExportConfig:
    """Parameters of export."""

    kind: Literal["auto", "points", "mesh"] = "auto"
    """Content of a PLY file: points or a mesh; auto: points. OBJ and GLB files contain a mesh."""
    world: Literal["portrait", "source"] = "portrait"
    """Coordinates: the portrait frame (+y up, +z out of the face, the head within -1 to 1), or
    those of the source capture."""
    opacity: float = 0.1
    """Points: minimum opacity along one voxel."""
    point_color: Literal["mean", "seen"] = "mean"
    """Points: mean color over all directions (degree 0), or the color seen from the front and
    outside."""
    surface: Literal["auto", "outer", "density"] = "auto"
    """Mesh: outer: the surface seen from outside; density: an isosurface of the density, with inner
    walls; auto: density for a field with a background."""
    level: float | None = None
    """Mesh: opacity at the surface, 0 to 1; by default 0.5, accumulated from outside, or 0.1 per
    voxel (surface density)."""
    smooth: float = 1.5
    """Mesh: sigma in voxels of the Gaussian that smooths the opacity first."""
    least_piece: float = 0.05
    """Mesh: remove connected pieces smaller than this share of the largest one."""


def export_field(field: VoxelField, path: Path, config: ExportConfig | None = None,
                 ) -> dict[str, Any]:
    """Write a field in the format that the file's suffix names.

    Parameters
    ----------
    field
        The field.
    path
        ``.ply`` (points or a mesh), ``.obj``, ``.glb`` (a mesh), ``.npz`` (svox2's checkpoint).
    config
        Parameters.

    Returns
    -------
    figures
        ``points``, ``vertices`` and ``faces``, or ``voxels``; ``bytes`` of the file.

    Raises
    ------
    UserError
        If the suffix is unknown, does not go with the parameters, or nothing is to be written.
    """
    config = config or ExportConfig()
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise UserError(f"can't export to {path.name}: its name must end in .html, "
                        f"{', '.join(_SUFFIXES[:-1])} or {_SUFFIXES[-1]}")
    if config.kind == "points" and suffix != ".ply":
        raise UserError(f"points are written as .ply, not {suffix}")
    if suffix == ".npz":
        if config.world == "source":
            raise UserError("a checkpoint's lattice can't be turned into the source's coordinates; "
                            "leave --world at portrait")
        save_checkpoint(field, path)
        figures: dict[str, Any] = {"voxels": len(field.density)}
    elif suffix == ".ply" and config.kind != "mesh":
        points = field_points(field, config.opacity, config.point_color)
        place, normals = _placed(points.positions, points.normals, field, config)
        with atomic_write(path) as stream:
            _write_ply(stream, place, normals, points)
        figures = {"points": len(points.positions)}
    else:
        mesh = field_mesh(field, config.level, config.surface, config.smooth, config.least_piece)
        place, normals = _placed(mesh.vertices, mesh.normals, field, config)
        writer = {".ply": _write_ply, ".obj": _write_obj, ".glb": _write_glb}[suffix]
        with atomic_write(path) as stream:
            writer(stream, place, normals, mesh)
        figures = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
    return {**figures, "bytes": path.stat().st_size}


def _placed(points: NDArray[np.float32], normals: NDArray[np.float32], field: VoxelField,
            config: ExportConfig) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points and normals in the coordinates that are asked for."""
    if config.world == "portrait":
        return points, normals
    back = np.linalg.inv(field.frame)
    turn = back[:3, :3] / np.cbrt(np.linalg.det(back[:3, :3]))
    return ((points @ back[:3, :3].T + back[:3, 3]).astype(np.float32),
            (normals @ turn.T).astype(np.float32))


def _write_ply(stream: BinaryIO, place: NDArray[np.float32], normals: NDArray[np.float32],
               item: PointCloud | Mesh) -> None:
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


def _write_obj(stream: BinaryIO, place: NDArray[np.float32], normals: NDArray[np.float32],
               mesh: Mesh) -> None:
    """OBJ with a color behind each position, as Blender and MeshLab write it."""
    stream.write(f"# lfportrait {__version__}\n".encode())
    np.savetxt(stream, np.hstack([place, mesh.colors / 255.0]), "v %.6f %.6f %.6f %.4f %.4f %.4f")
    np.savetxt(stream, normals, "vn %.4f %.4f %.4f")
    np.savetxt(stream, np.repeat(mesh.faces + 1, 2, axis=1), "f %d//%d %d//%d %d//%d")


def _linear(color: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """SRGB bytes as linear light in 16 bits, with a fourth channel of ones."""
    table = (linear_light(np.arange(256) / 255.0) * 65535.0 + 0.5).astype(np.uint16)
    return np.column_stack([table[color], np.full(len(color), 65535, np.uint16)])


def _write_glb(stream: BinaryIO, place: NDArray[np.float32], normals: NDArray[np.float32],
               mesh: Mesh) -> None:
    """Binary glTF 2.0: one mesh with vertex colors and an unlit material."""
    parts = [place.astype("<f4"), normals.astype("<f4"), _linear(mesh.colors).astype("<u2"),
             mesh.faces.astype("<u4").ravel()]
    arrays, at = [], 0
    for part in parts:
        # Targets: 34962 vertices, 34963 indices.
        arrays.append({"buffer": 0, "byteOffset": at, "byteLength": part.nbytes,
                       "target": 34963 if part is parts[3] else 34962})
        at += part.nbytes
    vertices = len(place)
    # Component types: 5126 float, 5123 unsigned short, 5125 unsigned int.
    scene = {
        "asset": {"version": "2.0", "generator": f"lfportrait {__version__}"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "name": "portrait"}],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True,
                       "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2},
                                    "indices": 3, "material": 0}]}],
        "buffers": [{"byteLength": at}], "bufferViews": arrays,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3",
             "min": place.min(axis=0).tolist(), "max": place.max(axis=0).tolist()},
            {"bufferView": 1, "componentType": 5126, "count": vertices, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5123, "count": vertices, "type": "VEC4",
             "normalized": True},
            {"bufferView": 3, "componentType": 5125, "count": mesh.faces.size, "type": "SCALAR"}],
    }
    text = json.dumps(scene, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    stream.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + at))
    stream.write(struct.pack("<I4s", len(text), b"JSON") + text)
    stream.write(struct.pack("<I4s", at, b"BIN\0"))
    for part in parts:
        stream.write(part.tobytes())
