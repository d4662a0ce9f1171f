"""The commands ``export`` (page, 3D files, frames) and ``view`` (in the browser)."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from ..errors import UserError
from ..field import VoxelField
from ..lightfield import EncodeConfig
from ..share import (
    ExportConfig,
    FrameConfig,
    PageConfig,
    export_field,
    export_frame,
    kind_of,
    serve_page,
    write_page,
)
from ..stylize import load_styled
from ..temporary import temporary_folder
from .common import Common

__all__ = ["Export", "View"]


@dataclass
class Export(Common):
    """Export a field as a page, a 3D file, or a picture or video for a frame.

    3D files: points, a textured mesh, Gaussian splats, a checkpoint. For frames: quilts, packages,
    stereo pairs, color and depth, anaglyphs, flat videos.
    """

    field: tyro.conf.Positional[Path]
    """Field file (.npz)."""
    out: Path
    """File: .html (a self-contained page), .ply (points, a mesh or splats), .glb (a mesh or
    splats), .usdz, .obj (a mesh), .spz, .sog (splats), .npz (svox2 checkpoint); a .ply or .glb
    whose name contains "splat" holds Gaussian splats. For frames: .hop (Looking Glass Studio), .mp4
    (flat video); a picture's name says what it holds: NAME_qs8x6a0.75.webp (quilt), NAME_2x1.jpg
    (stereo pair), NAME_rgbd.png, NAME_anaglyph.png."""
    usual: ClassVar[tuple[str, ...]] = (
        "kind", "title", "artist", "date", "display", "pixels", "eye-distance", "backdrop",
        "frames", "sway", "media-player")
    config: Annotated[ExportConfig, tyro.conf.arg(name="")] = option(default_factory=ExportConfig)
    """Export."""
    page: Annotated[PageConfig, tyro.conf.arg(name="")] = option(default_factory=PageConfig)
    """Page."""
    frame: Annotated[FrameConfig, tyro.conf.arg(name="")] = option(default_factory=FrameConfig)
    """Frames."""
    encode: EncodeConfig = option(default_factory=EncodeConfig)
    """Placement of the head for frames; ground of frames and pages."""

    def run(self) -> dict[str, Any]:
        """Convert and write."""
        if kind_of(self.out) is not None:
            return self._for_a_frame()
        with self.progress("export", 100) as progress:
            progress.update(0, self.out.name)
            if self.out.suffix.lower() in (".html", ".htm"):
                return self._written(write_page(load_styled(self.field), self.out, self.page,
                                                self.encode))
            figures = export_field(
                VoxelField.load(self.field), self.out, self.config,
                lambda share, text: progress.update(int(100 * share), text))
        if not self.quiet:
            counts = ", ".join(f"{figures[name]:,} {name}" for name in figures
                               if name not in ("bytes", "psnr"))
            near = f", {figures['psnr']:.1f} dB to the field" if "psnr" in figures else ""
            print(f"{self.out}: {counts}{near}, {figures['bytes'] / 1e6:.1f} MB")
        return figures

    def _for_a_frame(self) -> dict[str, Any]:
        """Write a quilt, a pair, a video; say what it is."""
        with self.progress("export") as progress:
            progress.update(0, self.out.name)

            def step(number: int, count: int) -> None:
                progress.update(number, f"frame {number + 1} of {count}")

            figures = export_frame(VoxelField.load(self.field), self.out, self.frame, self.encode,
                                   step=step)
        if not self.quiet:
            far, near = figures.get("parallax_percent", (0, 0))
            said = [f"{figures['size'][0]} x {figures['size'][1]}",
                    *([f"{figures['views']} views for {figures['display']}"]
                      if "views" in figures else []),
                    *([f"{figures['frames']} frames, {figures['codec']}"]
                      if "frames" in figures else []),
                    *([f"parallax {near:g} % of the width in front, {-far:g} % behind"]
                      if "parallax_percent" in figures else [])]
            print(f"{figures['out']}: {', '.join(said)}, {figures['bytes'] / 1e6:.1f} MB")
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
        with temporary_folder() as folder:
            path = folder / "portrait.html"
            with self.progress("view") as progress:
                progress.update(0, "page")
                figures = write_page(voxels, path, self.page)
            serve_page(path, self.port, browse=self.browser, ready=announce)
        return figures
