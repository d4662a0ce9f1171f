"""The commands ``export`` (page, points, mesh, checkpoint) and ``view`` (in the browser)."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any

import tyro

from ..errors import UserError
from ..field import VoxelField
from ..share import ExportConfig, PageConfig, export_field, serve_page, write_page
from ..stylize import load_styled
from .common import Common

__all__ = ["Export", "View"]


@dataclass
class Export(Common):
    """Export a field: an HTML page, points, a textured mesh, Gaussian splats or a checkpoint."""

    field: tyro.conf.Positional[Path]
    """Field file (.npz)."""
    out: Path
    """File: .html (a self-contained page), .ply (points, a mesh or splats), .glb (a mesh or
    splats), .usdz, .obj (a mesh), .spz, .sog (splats) or .npz (svox2 checkpoint). A .ply or .glb
    file whose name contains "splat" holds Gaussian splats."""
    config: Annotated[ExportConfig, tyro.conf.arg(name="")] = option(default_factory=ExportConfig)
    """Export."""
    page: Annotated[PageConfig, tyro.conf.arg(name="")] = option(default_factory=PageConfig)
    """Page."""

    def run(self) -> dict[str, Any]:
        """Convert and write."""
        with self.progress("export", 100) as progress:
            progress.update(0, self.out.name)
            if self.out.suffix.lower() in (".html", ".htm"):
                return self._written(write_page(load_styled(self.field), self.out, self.page))
            figures = export_field(
                VoxelField.load(self.field), self.out, self.config,
                lambda share, text: progress.update(int(100 * share), text))
        if not self.quiet:
            counts = ", ".join(f"{figures[name]:,} {name}" for name in figures
                               if name not in ("bytes", "psnr"))
            near = f", {figures['psnr']:.1f} dB to the field" if "psnr" in figures else ""
            print(f"{self.out}: {counts}{near}, {figures['bytes'] / 1e6:.1f} MB")
        return figures

    def _written(self, figures: dict[str, Any]) -> dict[str, Any]:
        """Say what a page holds; return the figures."""
        if not self.quiet:
            print(f"{self.out}: {figures['rows']:,} voxels, {', '.join(figures['sets'])}, "
                  f"{figures['bytes'] / 1e6:.1f} MB")
        return figures


@dataclass
class View(Common):
    """Show a field in the browser: serves its page to this machine only. Ctrl-C stops it."""

    field: tyro.conf.Positional[Path]
    """Field file (.npz), or a page (.html)."""
    port: int = 0
    """Port on the loopback address; by default a free one."""
    browser: bool = True
    """Open the browser; otherwise only print the address."""
    page: Annotated[PageConfig, tyro.conf.arg(name="")] = option(default_factory=PageConfig)
    """Page."""

    def run(self) -> dict[str, Any]:
        """Write the page to a temporary file and serve it."""
        def announce(address: str, _: Any) -> None:
            if not self.quiet:
                print(f"{address} (Ctrl-C stops)", flush=True)

        if self.field.suffix.lower() in (".html", ".htm"):
            if not self.field.is_file():
                raise UserError(f"no such file: {self.field}")
            serve_page(self.field, self.port, browse=self.browser, ready=announce)
            return {}
        voxels = load_styled(self.field)
        with tempfile.TemporaryDirectory(prefix="lfportrait-") as folder:
            path = Path(folder) / "portrait.html"
            with self.progress("view") as progress:
                progress.update(0, "page")
                figures = write_page(voxels, path, self.page)
            serve_page(path, self.port, browse=self.browser, ready=announce)
        return figures
