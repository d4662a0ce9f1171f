"""PLY of points and of colored meshes."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...field import Mesh, PointCloud
from ...version import __version__

__all__ = ["write_ply"]


def write_ply(stream: BinaryIO, place: NDArray[np.float32], normals: NDArray[np.float32],
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
