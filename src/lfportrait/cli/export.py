"""The command ``export``: fields in other programs' files."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any

import tyro

from ..field import VoxelField
from ..share import ExportConfig, export_field
from .common import Common

__all__ = ["Export"]


@dataclass
class Export(Common):
    """Write a field as a point cloud, a coloured mesh or svox2's checkpoint."""

    field: tyro.conf.Positional[Path]
    """Field file (.npz)."""
    out: Path
    """File: .ply (points or a mesh), .obj, .glb (a mesh) or .npz (svox2's checkpoint)."""
    config: Annotated[ExportConfig, tyro.conf.arg(name="")] = option(default_factory=ExportConfig)
    """Export."""

    def run(self) -> dict[str, Any]:
        """Convert and write."""
        with self.progress("export") as progress:
            progress.update(0, self.out.name)
            figures = export_field(VoxelField.load(self.field), self.out, self.config)
        if not self.quiet:
            counts = ", ".join(f"{figures[name]:,} {name}" for name in figures if name != "bytes")
            print(f"{self.out}: {counts}, {figures['bytes'] / 1e6:.1f} MB")
        return figures
