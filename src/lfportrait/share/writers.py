"""Writers of exports: 3D files, and what commands of their own make, too (pages, panels, prints).

A field goes to other programs as points, meshes, Gaussian splats, and as svox2's checkpoint.
"""

from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from ..arrays import Float32
from ..errors import UserError
from ..field import VoxelField, field_mesh, field_points, save_checkpoint
from ..files import atomic_path, atomic_write
from ..lightfield import Display, ViewMask, composed, encode_with_figures, write_coded
from ..lightfield.prints import PrintConfig, PrintSheet, check_file, fitted, write_print
from ..temporary import part_folder
from . import mesh as meshes
from .kinds import METRES, ExportConfig, ExportContext, NoParameters, PageConfig, SweepConfig
from .page.assembly import write_page
from .splats.cloud import SPLAT_WRITERS, framed, is_down
from .splats.fitting import field_splats
from .video import good_cone, sweep_frames, write_video

_SEEN_LEVEL, _SEEN_SMOOTH = 0.15, 0.8
"""Of a surface with a texture. A ray that grazes a head goes a long way through its soft outer
layer: of all levels this one has the outline that the field shows, and thin ears remain."""


def write_checkpoint(field: VoxelField, path: Path, config: ExportConfig,
                     context: ExportContext) -> dict[str, Any]:
    """Svox2's checkpoint."""
    if config.world == "source":
        raise UserError("a checkpoint's lattice can't be turned into the source's coordinates; "
                        "leave --world at portrait")
    save_checkpoint(field, path)
    return {"voxels": len(field.density)}


def write_points(field: VoxelField, path: Path, config: ExportConfig,
                 context: ExportContext) -> dict[str, Any]:
    """Lattice points with color and normal."""
    points = field_points(field, *(() if config.level is None else (config.level,)))
    place, normals = _placed(points.positions, points.normals, field, config)
    with atomic_write(path) as stream:
        meshes.write_ply(stream, place, normals, points)
    return {"points": len(points.positions)}


def write_mesh(field: VoxelField, path: Path, config: ExportConfig,
               context: ExportContext) -> dict[str, Any]:
    """The surface, with its painting as a picture or colors at its vertices."""
    suffix = path.suffix.lower()
    if (suffix, config.texture) in ((".ply", "yes"), (".usdz", "no")):
        raise UserError(f"--texture {config.texture} does not go with {suffix} files; leave it at "
                        "auto")
    painted = config.texture == "yes" or suffix == ".usdz" or (
        config.texture == "auto" and field.texture is not None and suffix != ".ply")
    context.tell(0.0, "surface")
    level, smooth = config.level, config.smooth
    if painted and level is None and field.background is None:
        level = _SEEN_LEVEL
    if smooth is None:
        smooth = _SEEN_SMOOTH if painted else 1.5
    mesh = field_mesh(field, level, smooth=smooth)
    figures = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
    if painted:
        context.tell(0.4, "texture")
        textured = meshes.bake_texture(field, mesh)
        figures["texels"] = textured.picture.shape[0] * textured.picture.shape[1]
        place, normals = _placed(textured.vertices, textured.normals, field, config)
        context.tell(0.8, path.name)
        if suffix == ".obj":
            parts = meshes.write_textured_obj(path, place, normals, textured)
            return {**figures, "bytes": sum(part.stat().st_size for part in parts)}
        with atomic_write(path) as stream:
            if suffix == ".glb":
                meshes.write_glb(stream, place, normals, textured)
            else:
                meshes.write_usdz(stream, place, normals, textured, _unit(field, config))
        return figures
    place, normals = _placed(mesh.vertices, mesh.normals, field, config)
    write: Any = {".ply": meshes.write_ply, ".obj": meshes.write_colored_obj,
                  ".glb": meshes.write_glb}[suffix]
    with atomic_write(path) as stream:
        write(stream, place, normals, mesh)
    return figures


def write_obj(field: VoxelField, path: Path, config: ExportConfig,
              context: ExportContext) -> dict[str, Any]:
    """An OBJ; in a .zip with its material and its picture: none of them is of use alone."""
    if path.suffix.lower() != ".zip":
        return write_mesh(field, path, config, context)
    with part_folder(path) as folder:
        # A plain name for all three: an OBJ calls its material by one (`plain_stem`).
        figures = write_mesh(field, folder / f"{meshes.plain_stem(path.stem)}.obj", config, context)
        context.tell(0.9, path.name)
        with atomic_path(path) as temporary, ZipFile(temporary, "w", ZIP_DEFLATED) as together:
            for part in sorted(folder.iterdir()):
                together.write(part, part.name)
    return {**figures, "bytes": path.stat().st_size}


def write_splats(field: VoxelField, path: Path, config: ExportConfig,
                 context: ExportContext) -> dict[str, Any]:
    """Gaussian splats."""
    suffix, up = path.suffix.lower(), config.splats.up
    if config.world == "source" and up != "auto":
        raise UserError(f"--splats.up {up} does not go with --world source, whose coordinates are "
                        "kept as they are; leave one of them away")
    is_down(suffix, up)  # what can't be written is refused before the fit
    splats, psnr = field_splats(field, config.splats, context.tell)
    splats = (splats.moved(np.linalg.inv(field.frame)) if config.world == "source"
              else framed(splats, suffix, up))
    with atomic_write(path) as stream:
        SPLAT_WRITERS[suffix](stream, splats)
    return {"splats": len(splats), "psnr": psnr}


def _unit(field: VoxelField, config: ExportConfig) -> float:
    """Length in metres of a unit of the coordinates that are asked for."""
    if config.world == "portrait":
        return 1.0
    return METRES * float(np.cbrt(np.linalg.det(field.frame[:3, :3])))


def _placed(points: Float32, normals: Float32, field: VoxelField,
            config: ExportConfig) -> tuple[Float32, Float32]:
    """Points and normals in the coordinates that are asked for, those of the portrait in metres."""
    if config.world == "portrait":
        return points * np.float32(METRES), normals
    back = np.linalg.inv(field.frame)
    turn = back[:3, :3] / np.cbrt(np.linalg.det(back[:3, :3]))
    return ((points @ back[:3, :3].T + back[:3, 3]).astype(np.float32),
            (normals @ turn.T).astype(np.float32))


def write_coded_picture(field: VoxelField, path: Path, parameters: NoParameters,
                        context: ExportContext) -> dict[str, Any]:
    """The coded picture, by the same calls as `lfportrait make`."""
    panel = Display.resolve(context.display)
    image, figures = encode_with_figures(field, panel, composed(field, panel, context.encode),
                                         mask=ViewMask.build(panel))
    write_coded(path, image, panel)
    return {**figures, "display": panel.name}


def write_html(field: VoxelField, path: Path, parameters: PageConfig,
               context: ExportContext) -> dict[str, Any]:
    """The page."""
    return write_page(field, path, parameters, context.encode)


def write_sweep(field: VoxelField, path: Path, parameters: SweepConfig,
                context: ExportContext) -> dict[str, Any]:
    """The video in which the head turns as far as the panel's views go."""
    cone = good_cone(field, Display.resolve(context.display).cone)
    write_video(path, sweep_frames(field, cone, parameters.frames, parameters.size,
                                   background=context.encode.background, ground=context.encode))
    return {}


def write_lenticular(field: VoxelField, path: Path, parameters: PrintConfig,
                     context: ExportContext) -> dict[str, Any]:
    """The lenticular print."""
    sheet = PrintSheet.of(parameters)
    check_file(path, sheet.display.width, sheet.display.height)
    context.progress.total = sheet.display.height
    coding, depth = fitted(field, sheet)
    return {**write_print(field, sheet, path, context.progress, coding=coding),
            "depth_mm": depth.figures()}


def write_field(field: VoxelField, path: Path, parameters: NoParameters,
                context: ExportContext) -> dict[str, Any]:
    """The field's own file, with all its styles."""
    field.save(path)
    return {}
