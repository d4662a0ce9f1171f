"""The commands ``export`` (page, 3D files, frames), ``view`` (in the browser) and ``print``.

``print`` makes lenticular prints, their test pages, previews and lenses.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tyro

from .. import share
from ..capture import capture_formats
from ..errors import UserError
from ..lightfield import EncodeConfig, prints
from ..lightfield.prints import PrintConfig, check_file
from ..share import ExportConfig, ExportContext, FrameConfig, NoParameters, PageConfig, write_page
from ..stylize import load_styled
from ..temporary import temporary_folder
from .common import Common

_OURS = ExportConfig, PageConfig, FrameConfig, NoParameters
"""Parameters that stand among the command's options without the name of a kind before them."""


_NAMES = ", ".join(f"{name} ({kind.title})" for kind in share.own_exports()
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
        return {one.name: one.parameters for one in share.exports().values()
                if one.command == "export" and one.parameters not in _OURS}

    def run(self) -> dict[str, Any]:
        export = share.export_of(self.out, self.config.kind)
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
        kinds, captures = share.exports().values(), capture_formats().values()
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
        def announce(address: str, _: Any) -> None:
            if not self.quiet:
                print(f"{address} (Ctrl-C stops)", flush=True)

        if self.field.suffix.lower() in (".html", ".htm"):
            if not self.field.is_file():
                raise UserError(f"no such file: {self.field}")
            share.serve_page(self.field, self.port, browse=self.browser, ready=announce)
            return {}
        voxels = load_styled(self.field)
        with temporary_folder() as folder:
            path = folder / "portrait.html"
            with self.progress("view") as progress:
                progress.update(0, "page")
                figures = write_page(voxels, path, self.page)
            share.serve_page(path, self.port, browse=self.browser, ready=announce)
        return figures


@dataclass(kw_only=True)
class Print(Common):
    """Code a field for a lenticular print, one ray per printed pixel."""

    field: tyro.conf.Positional[Path | None] = None
    """Field file (.npz); not needed with --pitch-test."""
    config: Annotated[PrintConfig, tyro.conf.arg(name="")]
    """Paper, lens sheet and placement of the head."""
    out: Path = Path("print.tiff")
    """File for the page: .tiff or .png."""
    pitch_test: bool = False
    """Instead, write a test page for the sheet's pitch and phase; how to read it is printed on
    it."""
    pitch_range: float = 0.0
    """Per cent by which the test page's pitches differ from --lpi at most; 0: as finely as the
    page's width can tell."""
    preview: bool = False
    """Also write what an eye sees through the sheet: NAME-seen.png, and NAME-seen.mp4, in which it
    moves from side to side."""
    preview_height: int = 960
    """Height of the preview in pixels."""
    lenses: Path | None = None
    """Also write a 16-bit height map of the lens sheet, for printers that print it in varnish."""
    lens_profile: Literal["arc", "sine"] = "arc"
    """Cross-section of its lenses: round, or smooth between them."""
    save_display: Path | None = None
    """Also write the page as a display file, for `lfportrait simulate` and others."""
    usual: ClassVar[tuple[str, ...]] = ("lpi", "dpi", "size", "distance", "angle", "thickness",
                                        "bleed", "head", "relief", "background")

    def run(self) -> dict[str, Any]:
        if self.pitch_test:
            figures = prints.write_pitch_test(self.config, self.out, self.pitch_range)
            self._say(f"{self.out}: {len(figures['pitches'])} pitches from "
                      f"{figures['pitches'][0]:.3f} to {figures['pitches'][-1]:.3f} lpi; how to "
                      "read them is printed on it")
            return figures
        if self.field is None:
            raise UserError("name the field to print, or --pitch-test for a test page")
        if not 64 <= self.preview_height <= 4096:
            raise UserError("--preview-height must lie between 64 and 4096 pixels, not "
                            f"{self.preview_height}")
        return self._printed(self.field)

    def _printed(self, path: Path) -> dict[str, Any]:
        from ..field import VoxelField

        sheet = prints.PrintSheet.of(self.config)
        check_file(self.out, sheet.display.width, sheet.display.height)
        if self.lenses is not None:
            check_file(self.lenses, sheet.display.width, sheet.display.height, grey=True)
        voxels = VoxelField.load(path)
        with self.progress("print", sheet.display.height) as progress:
            coding, depth = prints.fitted(voxels, sheet)
            figures = prints.write_print(voxels, sheet, self.out, progress, coding=coding)
        figures["depth_mm"] = depth.figures()
        self._say("\n".join([sheet.summary(), *depth.lines()]))
        if warning := depth.warning():
            warnings.warn(warning, stacklevel=1)
        if self.preview:
            figures["preview"] = self._preview(prints.SheetView.of(voxels, sheet, coding,
                                                                   self.preview_height))
        if self.lenses is not None:
            figures["lenses"] = prints.write_lenses(sheet, self.lenses, self.lens_profile)
            self._say(f"{self.lenses}: white is {figures['lenses']['height_mm']:.3f} mm high, "
                      f"lenses {figures['lenses']['lens_mm']:.3f} mm of it")
        if self.save_display is not None:
            sheet.display.save(self.save_display)
        return figures

    def _preview(self, view: prints.SheetView) -> list[Path]:
        from ..files import write_image
        from ..share import write_video

        picture, sweep = (self.out.with_name(f"{self.out.stem}-seen{suffix}")
                          for suffix in (".png", ".mp4"))
        write_image(picture, view.picture(0.0))
        with self.progress("preview") as progress:
            progress.update(0, sweep.name)
            write_video(sweep, view.sweep())
        return [picture, sweep]

    def _say(self, text: str) -> None:
        if not self.quiet:
            print(text)
