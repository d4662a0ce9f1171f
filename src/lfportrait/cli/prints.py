"""The command ``print``: lenticular prints, their test pages, previews and lenses."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tyro

from ..errors import UserError
from ..lightfield.prints import (
    PrintConfig,
    PrintSheet,
    SheetView,
    check_file,
    fitted,
    write_lenses,
    write_pitch_test,
    write_print,
)
from .common import Common

__all__ = ["Print"]


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
        """Code and write."""
        if self.pitch_test:
            figures = write_pitch_test(self.config, self.out, self.pitch_range)
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
        """The print and what goes with it."""
        from ..field import VoxelField

        sheet = PrintSheet.of(self.config)
        check_file(self.out, sheet.display.width, sheet.display.height)
        if self.lenses is not None:
            check_file(self.lenses, sheet.display.width, sheet.display.height, grey=True)
        voxels = VoxelField.load(path)
        with self.progress("print", sheet.display.height) as progress:
            coding, depth = fitted(voxels, sheet)
            figures = write_print(voxels, sheet, self.out, progress, coding=coding)
        figures["depth_mm"] = depth.figures()
        self._say("\n".join([sheet.summary(), *depth.lines()]))
        if warning := depth.warning():
            warnings.warn(warning, stacklevel=1)
        if self.preview:
            figures["preview"] = self._preview(SheetView.of(voxels, sheet, coding,
                                                            self.preview_height))
        if self.lenses is not None:
            figures["lenses"] = write_lenses(sheet, self.lenses, self.lens_profile)
            self._say(f"{self.lenses}: white is {figures['lenses']['height_mm']:.3f} mm high, "
                      f"lenses {figures['lenses']['lens_mm']:.3f} mm of it")
        if self.save_display is not None:
            sheet.display.save(self.save_display)
        return figures

    def _preview(self, view: SheetView) -> list[Path]:
        """Write the preview's picture and sweep."""
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
