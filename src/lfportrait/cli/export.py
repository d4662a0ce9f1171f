"""The commands ``export`` (page, 3D files, frames) and ``view`` (in the browser)."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from ..capture import capture_formats
from ..errors import UserError
from ..lightfield import EncodeConfig
from ..share import (
    ExportConfig,
    ExportContext,
    FrameConfig,
    NoParameters,
    PageConfig,
    export_of,
    exports,
    own_exports,
    serve_page,
    write_page,
)
from ..stylize import load_styled
from ..temporary import temporary_folder
from .common import Common

__all__ = ["Export", "Formats", "View"]

_OURS = ExportConfig, PageConfig, FrameConfig, NoParameters
"""Parameters that stand among the command's options without the name of a kind before them."""


_NAMES = ", ".join(f"{name} ({kind.title})" for kind in own_exports()
                   for name in (f"{kind.mark}{kind.written[0]}",)
                   if kind.command == "export" and kind.claim(Path(f"x{name}")))


@dataclass
class Export(Common):
    """Export a field as a page, a 3D file, or a picture or video for a frame.

    3D files: points, a textured mesh, Gaussian splats, a checkpoint. For frames: quilts, packages,
    stereo pairs, color and depth, anaglyphs, flat videos. `lfportrait formats` lists all.
    """

    field: tyro.conf.Positional[Path]
    """Field file (.npz)."""
    out: Annotated[Path, tyro.conf.arg(help=f"File; its name says what it holds: {_NAMES}.")]
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

    @classmethod
    def sections(cls) -> dict[str, type]:
        """The parameters of kinds that have their own."""
        return {one.name: one.parameters for one in exports().values()
                if one.command == "export" and one.parameters not in _OURS}

    def run(self) -> dict[str, Any]:
        """Convert and write."""
        export = export_of(self.out, self.config.kind)
        given = (self.config, self.page, self.frame, *self.given)
        parameters = next((one for one in given if type(one) is export.parameters), None)
        with self.progress("export") as progress:
            progress.update(0, self.out.name)
            figures = export.make(load_styled(self.field), self.out, parameters,
                                  ExportContext(self.encode, progress=progress))
        if not self.quiet:
            print(f"{figures['out']}: {', '.join(export.facts(figures))}, "
                  f"{figures['bytes'] / 1e6:.1f} MB")
        return figures


@dataclass
class Formats(Common):
    """List what portraits are exported as, and which captures of other programs are read."""

    def run(self) -> dict[str, Any]:
        """Look and print."""
        kinds, captures = exports().values(), capture_formats().values()
        rows = [(one.name, f"{one.mark}{' '.join(one.written)}", f"{one.title}: {one.purpose}" + (
            "" if one.command == "export" else f" (lfportrait {one.command})")) for one in kinds]
        wide = [max(len(row[column]) for row in rows) for column in (0, 1)]
        print("exports", *(f"  {name:<{wide[0]}}  {ends:<{wide[1]}}  {text}"
                           for name, ends, text in rows), sep="\n")
        wide[0] = max(len(one.name) for one in captures)
        print("captures", *(f"  {one.name:<{wide[0]}}  {one.files}{' (written, too)' * one.writes}"
                            for one in captures), sep="\n")
        return {"exports": [{**one.entry(), "command": one.command, "contents": one.kind,
                             "suffixes": one.written} for one in kinds],
                "captures": [{"name": one.name, "files": one.files, "writes": one.writes}
                             for one in captures]}


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
