"""The field's file: svox2's checkpoint with two keys more.

svox2 keeps ``radius``, ``center``, ``links`` [X, Y, Z], ``density_data`` [N, 1], ``sh_data``
float16 [N, 3 B], ``basis_type`` (1 = spherical harmonics); ours has the links transposed to
[Z, Y, X] in memory and adds ``frame`` and ``lfportrait_version`` to the file.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..errors import UserError
from ..files import atomic_write
from .grid import VoxelField

__all__ = ["load_field", "save_field"]


def save_field(field: VoxelField, path: Any) -> None:
    """Write a field; coefficients are rounded to float16, as svox2 does."""
    if Path(path).suffix != ".npz":
        raise UserError(f"a field is written as .npz, not {Path(path).name}")
    with atomic_write(path) as stream:
        np.savez(stream, radius=field.radius.astype(np.float32),
                 center=field.center.astype(np.float32),
                 links=np.ascontiguousarray(field.links.transpose(2, 1, 0)),
                 density_data=field.density[:, None].astype(np.float32),
                 sh_data=np.clip(field.sh.reshape(len(field.sh), -1), -6e4, 6e4
                                 ).astype(np.float16),
                 basis_type=np.int64(1), frame=field.frame,
                 lfportrait_version=np.str_(__version__))


def load_field(path: Any) -> VoxelField:
    """Read a field.

    Raises
    ------
    UserError
        If the file is missing, damaged, not a field, or holds what we don't render (a background).
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
    except FileNotFoundError as error:
        raise UserError(f"no such field file: {path}") from error
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, AttributeError) as error:
        raise UserError(f"{path} is not a field (.npz written by lfportrait or svox2), or it is "
                        f"damaged: {error}") from error
    if "data" in arrays and "density_data" not in arrays:  # svox2's old form
        arrays["density_data"], arrays["sh_data"] = arrays["data"][:, :1], arrays["data"][:, 1:]
    missing = [name for name in ("radius", "center", "links", "density_data", "sh_data")
               if name not in arrays]
    if missing:
        raise UserError(f"{path} is not a field: it has no {', '.join(missing)}")
    if int(arrays.get("basis_type", 1)) != 1:
        raise UserError(f"{path} uses a colour basis other than spherical harmonics, which "
                        "lfportrait does not read")
    links, density, sh = arrays["links"], arrays["density_data"].reshape(-1), arrays["sh_data"]
    if links.ndim != 3 or sh.ndim != 2 or len(sh) != len(density) or sh.shape[1] not in (3, 12, 27):
        raise UserError(f"{path} is not a field: links {links.shape}, density {density.shape} and "
                        f"colour {sh.shape} do not fit together")
    if links.max(initial=-1) >= len(density):
        raise UserError(f"{path} is damaged: its links point beyond its {len(density)} voxels")
    return VoxelField(np.maximum(np.ascontiguousarray(links.transpose(2, 1, 0), np.int32), -1),
                      np.ascontiguousarray(density, np.float32),
                      sh.astype(np.float32).reshape(len(sh), 3, -1),
                      np.broadcast_to(arrays["center"], (3,)).astype(np.float64),
                      np.broadcast_to(arrays["radius"], (3,)).astype(np.float64),
                      arrays.get("frame", np.eye(4)).astype(np.float64))
