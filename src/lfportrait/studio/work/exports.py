"""An export in a process of its own: a version's field as a file of any kind."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

from ...errors import UserError
from ...field import VoxelField
from ...files import atomic_path
from ...leftovers import part_folder
from ...lightfield import (
    Display,
    EncodeConfig,
    ViewMask,
    composed,
    encode_with_figures,
    quilt_of,
    write_coded,
)
from ...progress import Progress
from ...share import (
    ExportConfig,
    FrameConfig,
    PageConfig,
    export_field,
    export_frame,
    sweep_frames,
    write_page,
    write_quilt,
    write_video,
)
from ...share.mesh import plain_stem
from ...stylize import load_styled
from ..exports import forget_unfinished
from ..names import id_of
from ..orders import Order
from .sitting import Look, Sitting
from .telling import Teller

__all__ = ["export"]

_MESH, _SPLATS = ExportConfig(kind="mesh"), ExportConfig(kind="splats")
_SOLIDS = {"glb": _MESH, "usdz": _MESH, "obj": _MESH, "ply": ExportConfig(kind="points"),
           "splats_ply": _SPLATS, "spz": _SPLATS, "sog": _SPLATS, "checkpoint": ExportConfig()}
"""What the files hold, whatever they are called: a name with "splat" in it asks for nothing."""
_FRAMES = ("stereo", "anaglyph", "rgbd", "flat")


def export(order: Order, teller: Teller) -> dict[str, Any]:
    """Write the file; its figures."""
    more = order.more
    path, kind, options = Path(more["target"]), str(more["kind"]), dict(more["options"])
    forget_unfinished(path)  # of an earlier run
    teller.tell("stages", [("export", 10.0)])
    with teller.stage("export") as progress:
        progress.update(0, path.name)
        look = Look(more["look"])
        fine = look.styled is not None and not look.mix
        if kind == "field" and fine:
            assert look.styled is not None
            with atomic_path(path) as temporary:
                shutil.copyfile(look.styled, temporary)
            figures: dict[str, Any] = {}
        else:
            # As the commands read it: from the file, with the numbers that it keeps.
            field = load_styled(look.styled) if fine else Sitting().on_panel(look)
            figures = _written(field, path, kind, options, order, progress)
    out = Path(figures.pop("out", path))
    return {"export": id_of(out.name), "file": out.name, "kind": kind, "fine": fine,
            "version": more.get("version"),
            "figures": _plain(figures)}


def _written(field: VoxelField, path: Path, kind: str, options: dict[str, Any], order: Order,
             progress: Progress) -> dict[str, Any]:
    """Write one kind of file."""
    coding = EncodeConfig(**order.more["placement"])
    if kind in ("coded", "quilt"):
        return _coded(field, path, kind, order.panel(), coding)
    if kind == "page":
        return write_page(field, path, PageConfig(**options))
    if kind == "field":
        field.save(path)
        return {}
    if kind == "sweep":
        write_video(path, sweep_frames(field, order.panel().cone, options["frames"],
                                       options["size"], background=coding.background,
                                       ground=coding))
        return {}
    if kind == "print":
        return _printed(field, path, options, progress)
    if kind in _SOLIDS:
        progress.total = 100
        write = _together if kind == "obj" else export_field
        return write(field, path, _SOLIDS[kind],
                     lambda share, text: progress.update(round(100 * share), text))
    if kind == "hop":
        return export_frame(field, path, FrameConfig(display=order.display),
                            composed(field, order.panel(), coding))
    if kind in _FRAMES:
        def step(number: int, count: int) -> None:
            progress.total = count
            progress.update(number, f"frame {number + 1} of {count}")

        # Frames place a head by their own screen.
        return export_frame(field, path, FrameConfig(**options), step=step)
    raise UserError(f"there is no export {kind!r}")


def _coded(field: VoxelField, path: Path, kind: str, panel: Display,
           coding: EncodeConfig) -> dict[str, Any]:
    """The coded picture or the quilt, by the same calls as `lfportrait make`."""
    config = composed(field, panel, coding)
    if kind == "quilt":
        from ...lightfield import QuiltLayout

        picture, name = quilt_of(field, panel, config)
        layout = QuiltLayout.of_name(name)
        assert layout is not None
        stem = path.stem.removesuffix("_qs")
        out = path.with_name(f"{stem}_{name.removeprefix('quilt_')}")
        write_quilt(out, picture, layout)
        return {"out": out, "views": layout.count, "display": panel.name}
    image, figures = encode_with_figures(field, panel, config, mask=ViewMask.build(panel))
    write_coded(path, image, panel)
    return {**figures, "display": panel.name}


def _together(field: VoxelField, path: Path, config: ExportConfig,
              tell: Callable[[float, str], None]) -> dict[str, Any]:
    """An OBJ with its material and its picture in one .zip: none of them is of use alone."""
    with part_folder(path) as folder:
        # A plain name for all three: an OBJ calls its material by one (`plain_stem`).
        figures = export_field(field, folder / f"{plain_stem(path.stem)}.obj", config,
                               lambda share, text: tell(0.9 * share, text))
        tell(0.9, path.name)
        with atomic_path(path) as temporary, ZipFile(temporary, "w", ZIP_DEFLATED) as together:
            for part in sorted(folder.iterdir()):
                together.write(part, part.name)
    return {**figures, "bytes": path.stat().st_size}


def _printed(field: VoxelField, path: Path, options: dict[str, Any],
             progress: Progress) -> dict[str, Any]:
    """A lenticular print."""
    from ...lightfield.prints import PrintConfig, PrintSheet, check_file, fitted, write_print

    size = {"size": options["size"]} if options["size"] else {}
    sheet = PrintSheet.of(PrintConfig(lpi=options["lpi"], dpi=options["dpi"], **size))
    check_file(path, sheet.display.width, sheet.display.height)
    progress.total = sheet.display.height
    coding, depth = fitted(field, sheet)
    return {**write_print(field, sheet, path, progress, coding=coding),
            "depth_mm": depth.figures()}


def _plain(value: Any) -> Any:
    """Figures as JSON takes them."""
    if isinstance(value, dict):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, Path):
        return str(value)
    return value.item() if hasattr(value, "item") else value
