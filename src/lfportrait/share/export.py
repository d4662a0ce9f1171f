"""Export a field to other programs: points, meshes, Gaussian splats, svox2's checkpoint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import UserError
from ..field import VoxelField, field_mesh, field_points, save_checkpoint
from ..files import atomic_write
from . import mesh as meshes
from .splats import SPLAT_WRITERS, SplatConfig, field_splats, framed, is_down
from .units import METRES

__all__ = ["ExportConfig", "export_field"]

_CONTENTS = {".ply": ("points", "mesh", "splats"), ".glb": ("mesh", "splats"), ".obj": ("mesh",),
             ".usdz": ("mesh",), ".spz": ("splats",), ".sog": ("splats",),
             ".npz": ("checkpoint",)}
"""What a file with a suffix can hold; the first is the usual."""

_SEEN_LEVEL, _SEEN_SMOOTH = 0.15, 0.8
"""Of a surface with a texture. A ray that grazes a head goes a long way through its soft outer
layer: of all levels this one has the outline that the field shows, and thin ears remain."""

_Told = Callable[[float, str], None]


@dataclass(frozen=True)
class ExportConfig:
    """Parameters of export."""

    kind: Literal["auto", "points", "mesh", "splats"] = "auto"
    """Content of the file. auto: splats in SPZ and SOG files, and in PLY and GLB files whose name
    contains "splat"; points in other PLY files; a mesh in GLB, USDZ and OBJ files."""
    world: Literal["portrait", "source"] = "portrait"
    """Coordinates: the portrait frame (+y up, +z out of the face; points and meshes in metres,
    20 cm high; splats see ``--splats.up``), or those of the source capture as they are."""
    opacity: float = 0.1
    """Points: minimum opacity along one voxel."""
    point_color: Literal["mean", "seen"] = "mean"
    """Points: mean color over all directions (degree 0), or the color seen from the front and
    outside."""
    surface: Literal["auto", "outer", "density"] = "auto"
    """Mesh: outer: the surface seen from outside; density: an isosurface of the density, with inner
    walls; auto: density for a field with a background."""
    level: float | None = None
    """Mesh: opacity at the surface, 0 to 1; by default 0.5, accumulated from outside (0.15 with a
    texture), or 0.1 per voxel (surface density)."""
    smooth: float | None = None
    """Mesh: sigma in voxels of the Gaussian that smooths the opacity first; by default 1.5, with a
    texture 0.8."""
    least_piece: float = 0.05
    """Mesh: remove connected pieces smaller than this share of the largest one."""
    texture: Literal["auto", "yes", "no"] = "auto"
    """Mesh in a GLB or OBJ file: colors as a picture (yes) or at the vertices (no). auto: a picture
    if the field is painted. USDZ files always have a picture, PLY files never."""
    splats: SplatConfig = option(default_factory=SplatConfig)
    """Splats."""


def export_field(field: VoxelField, path: Path, config: ExportConfig | None = None,
                 tell: _Told = lambda share, text: None) -> dict[str, Any]:
    """Write a field in the format that the file's suffix names.

    Parameters
    ----------
    field
        The field.
    path
        ``.ply`` (points, a mesh or splats), ``.obj``, ``.usdz`` (a mesh), ``.glb`` (a mesh or
        splats), ``.spz``, ``.sog`` (splats), ``.npz`` (svox2's checkpoint).
    config
        Parameters.
    tell
        Told how much is done, 0 to 1, and what is being done.

    Returns
    -------
    figures
        ``points``, ``vertices`` and ``faces``, ``splats`` and their ``psnr`` to the field's views,
        or ``voxels``; ``bytes`` of the file, with those beside it.

    Raises
    ------
    UserError
        If the suffix is unknown, does not go with the parameters, or nothing is to be written.
    """
    config = config or ExportConfig()
    kind = _kind(path, config)
    write = {"checkpoint": _checkpoint, "points": _points, "mesh": _mesh, "splats": _splats}[kind]
    figures, paths = write(field, path, config, tell)
    return {**figures, "bytes": sum(written.stat().st_size for written in paths)}


def _kind(path: Path, config: ExportConfig) -> str:
    """What the file is to hold."""
    suffix = path.suffix.lower()
    if suffix not in _CONTENTS:
        *names, last = _CONTENTS
        raise UserError(f"can't export to {path.name}: its name must end in .html, "
                        f"{', '.join(names)} or {last}")
    possible = _CONTENTS[suffix]
    if suffix == ".npz":
        if config.world == "source":
            raise UserError("a checkpoint's lattice can't be turned into the source's coordinates; "
                            "leave --world at portrait")
        return "checkpoint"
    if config.kind == "auto":
        named = "splats" in possible and "splat" in path.stem.lower()
        return "splats" if named else possible[0]
    if config.kind not in possible:
        fitting = [name for name, kinds in _CONTENTS.items() if config.kind in kinds]
        raise UserError(f"{config.kind} {'is' if config.kind == 'mesh' else 'are'} written as "
                        f"{' or '.join(fitting)}, not {suffix}")
    return config.kind


_Written = tuple[dict[str, Any], list[Path]]


def _checkpoint(field: VoxelField, path: Path, config: ExportConfig, tell: _Told) -> _Written:
    save_checkpoint(field, path)
    return {"voxels": len(field.density)}, [path]


def _points(field: VoxelField, path: Path, config: ExportConfig, tell: _Told) -> _Written:
    points = field_points(field, config.opacity, config.point_color)
    place, normals = _placed(points.positions, points.normals, field, config)
    with atomic_write(path) as stream:
        meshes.write_ply(stream, place, normals, points)
    return {"points": len(points.positions)}, [path]


def _mesh(field: VoxelField, path: Path, config: ExportConfig, tell: _Told) -> _Written:
    suffix = path.suffix.lower()
    if (suffix, config.texture) in ((".ply", "yes"), (".usdz", "no")):
        raise UserError(f"--texture {config.texture} does not go with {suffix} files; leave it at "
                        "auto")
    painted = config.texture == "yes" or suffix == ".usdz" or (
        config.texture == "auto" and field.texture is not None and suffix != ".ply")
    tell(0.0, "surface")
    level, smooth = config.level, config.smooth
    if painted and level is None and (field.background is None or config.surface == "outer"):
        level = _SEEN_LEVEL if config.surface != "density" else None
    if smooth is None:
        smooth = _SEEN_SMOOTH if painted else 1.5
    mesh = field_mesh(field, level, config.surface, smooth, config.least_piece)
    figures, paths = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}, [path]
    if painted:
        tell(0.4, "texture")
        textured = meshes.bake_texture(field, mesh)
        figures["texels"] = textured.picture.shape[0] * textured.picture.shape[1]
        place, normals = _placed(textured.vertices, textured.normals, field, config)
        tell(0.8, path.name)
        if suffix == ".obj":
            return figures, meshes.write_textured_obj(path, place, normals, textured)
        with atomic_write(path) as stream:
            if suffix == ".glb":
                meshes.write_textured_glb(stream, place, normals, textured)
            else:
                meshes.write_usdz(stream, place, normals, textured, _unit(field, config))
        return figures, paths
    place, normals = _placed(mesh.vertices, mesh.normals, field, config)
    write: Any = {".ply": meshes.write_ply, ".obj": meshes.write_colored_obj,
                  ".glb": meshes.write_colored_glb}[suffix]
    with atomic_write(path) as stream:
        write(stream, place, normals, mesh)
    return figures, paths


def _splats(field: VoxelField, path: Path, config: ExportConfig, tell: _Told) -> _Written:
    suffix, up = path.suffix.lower(), config.splats.up
    if config.world == "source" and up != "auto":
        raise UserError(f"--splats.up {up} does not go with --world source, whose coordinates are "
                        "kept as they are; leave one of them away")
    is_down(suffix, up)  # what can't be written is told before the fit
    splats, psnr = field_splats(field, config.splats, tell)
    splats = (splats.moved(np.linalg.inv(field.frame)) if config.world == "source"
              else framed(splats, suffix, up))
    with atomic_write(path) as stream:
        SPLAT_WRITERS[suffix](stream, splats)
    return {"splats": len(splats), "psnr": psnr}, [path]


def _unit(field: VoxelField, config: ExportConfig) -> float:
    """Length in metres of a unit of the coordinates that are asked for."""
    if config.world == "portrait":
        return 1.0
    return METRES * float(np.cbrt(np.linalg.det(field.frame[:3, :3])))


def _placed(points: NDArray[np.float32], normals: NDArray[np.float32], field: VoxelField,
            config: ExportConfig) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points and normals in the coordinates that are asked for, those of the portrait in metres."""
    if config.world == "portrait":
        return points * np.float32(METRES), normals
    back = np.linalg.inv(field.frame)
    turn = back[:3, :3] / np.cbrt(np.linalg.det(back[:3, :3]))
    return ((points @ back[:3, :3].T + back[:3, 3]).astype(np.float32),
            (normals @ turn.T).astype(np.float32))
