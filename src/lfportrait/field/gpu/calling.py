"""Calling the device for a field: what is sent, and what comes back."""

from __future__ import annotations

from typing import Any, Protocol

from ...arrays import Float64
from ...gpu import GpuProcess
from ..kernels.bricks import Bricks
from ..texture import SurfaceTexture, TextureRows
from .atlas import field_parts
from .textures import texture_parts
from .view import ViewJob

__all__ = ["Castable", "keep_field", "views_on_gpu"]

_STAGE = "lfportrait.field.gpu"


class Castable(Protocol):
    """What is sent of a field (`lfportrait.field.VoxelField`, whose module loads this one)."""

    texture: SurfaceTexture | None

    @property
    def bricks(self) -> Bricks:
        """The layout for casting."""

    @property
    def lattice(self) -> Float64:
        """Points along x, y, z; scale and offset."""

    def texture_rows(self, footprint: float, whole: bool = False) -> TextureRows:
        """Charts of cells, projections, texels."""


def keep_field(process: GpuProcess, field: Castable, layers: int, footprint: float,
               whole: bool = True) -> tuple[str, str]:
    """Have a field and its texture on the device; returns their names there.

    Parameters
    ----------
    process, field
        The device's process, and the field.
    layers
        Eyes that its colors are kept for.
    footprint, whole
        Width of the texture's detail that is wanted (`VoxelField.texture_rows`).
    """
    bricks = field.bricks
    key = f"{bricks.token} {layers}"
    if not process.holds("fields", key):
        process.note("fields", process.call(f"{_STAGE}.atlas:upload", key,
                                            field_parts(bricks, field.lattice), layers))
    texture = field.texture
    name = "none" if texture is None else f"{bricks.token} {texture.level(footprint, whole)}"
    if not process.holds("textures", name):
        parts = None if texture is None else texture_parts(field.texture_rows(footprint, whole))
        process.note("textures", process.call(f"{_STAGE}.textures:keep_texture", name, parts))
    return key, name


def views_on_gpu(process: GpuProcess, field: Castable, job: ViewJob, footprint: float,
                 ) -> Any:
    """Render views on the device (`render_views`), where the field is sent first if it must be."""
    keys = keep_field(process, field, 1, footprint, whole=False)
    return process.call(f"{_STAGE}.view:render_views", keys, job)
