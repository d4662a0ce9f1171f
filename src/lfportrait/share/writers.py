"""Writers of exports that are also made by commands of their own: pages, panels, prints, videos."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..field import VoxelField
from ..lightfield import Display, ViewMask, composed, encode_with_figures, write_coded
from ..lightfield.prints import PrintConfig, PrintSheet, check_file, fitted, write_print
from .config import SweepConfig
from .exporter import ExportContext, NoParameters
from .page import PageConfig, write_page
from .paths import good_cone, sweep_frames
from .video import write_video

__all__ = ["write_coded_picture", "write_field", "write_html", "write_lenticular", "write_sweep"]


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
