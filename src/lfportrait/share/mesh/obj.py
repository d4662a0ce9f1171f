"""Wavefront OBJ: text, with colors at vertices or with a material and a picture beside it."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ...field import Mesh
from ...files import atomic_write
from ...version import __version__
from .baking import TexturedMesh
from .names import plain_stem
from .pictures import png

__all__ = ["write_colored_obj", "write_textured_obj"]


def write_colored_obj(stream: BinaryIO, place: NDArray[np.float32], normals: NDArray[np.float32],
                      mesh: Mesh) -> None:
    """A mesh with a color behind each position, as Blender and MeshLab write it."""
    stream.write(f"# lfportrait {__version__}\n".encode())
    np.savetxt(stream, np.hstack([place, mesh.colors / 255.0]), "v %.6f %.6f %.6f %.4f %.4f %.4f")
    np.savetxt(stream, normals, "vn %.4f %.4f %.4f")
    np.savetxt(stream, np.repeat(mesh.faces + 1, 2, axis=1), "f %d//%d %d//%d %d//%d")


def write_textured_obj(path: Path, place: NDArray[np.float32], normals: NDArray[np.float32],
                       mesh: TexturedMesh) -> list[Path]:
    """A mesh with a picture: ``NAME.obj``, ``NAME.mtl`` and ``NAME_texture.png``.

    The names of the material and of the picture stand in the files, in plain letters
    (`plain_stem`).

    Returns
    -------
    paths
        Of the files; the mesh, which names the others, is written last.
    """
    stem = plain_stem(path.stem)
    material, picture = path.with_name(f"{stem}.mtl"), path.with_name(f"{stem}_texture.png")
    with atomic_write(picture) as stream:
        stream.write(png(mesh.picture))
    with atomic_write(material) as stream:
        stream.write(f"# lfportrait {__version__}\nnewmtl portrait\nillum 0\nKa 1 1 1\nKd 1 1 1\n"
                     f"Ks 0 0 0\nmap_Ka {picture.name}\nmap_Kd {picture.name}\n".encode())
    with atomic_write(path) as stream:
        stream.write(f"# lfportrait {__version__}\nmtllib {material.name}\no portrait\n"
                     "usemtl portrait\n".encode())
        np.savetxt(stream, place, "v %.6f %.6f %.6f")
        # Rows of an OBJ's pictures are counted from below.
        np.savetxt(stream, np.column_stack([mesh.places[:, 0], 1 - mesh.places[:, 1]]),
                   "vt %.6f %.6f")
        np.savetxt(stream, normals, "vn %.4f %.4f %.4f")
        np.savetxt(stream, np.repeat(mesh.faces + 1, 3, axis=1),
                   "f %d/%d/%d %d/%d/%d %d/%d/%d")
    return [path, material, picture]
