"""Coded pictures as commands: of a field (``encode``), of views (``interlace``), and back.

``deinterlace`` takes coded pictures apart, ``simulate`` shows what an eye sees.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import tyro

from ..errors import UserError
from ..files import write_image
from ..lightfield import (
    Display,
    EncodeConfig,
    InterlaceConfig,
    QuiltHint,
    QuiltLayout,
    assemble_quilt,
    each_view,
    interlace,
    layout_for,
    lossless,
    read_coded,
    read_views,
    write_coded,
)
from ..share import QUILTS, QuiltName, SequenceConfig, write_quilt, write_sequence
from .common import Common


@dataclass
class Encode(Common):
    """Code a field's light field for a display, one ray per sub-pixel; still or moving."""

    field: tyro.conf.Positional[Path]
    """Field file (.npz)."""
    display: str = "generic-4k"
    """Display preset (`lfportrait display list`) or a display or calibration file."""
    out: Path = Path("lightfield.png")
    """File for the coded picture; a name ending in .png keeps every sub-pixel. With --frames: a
    video (.mp4, .mov, .mkv), or a folder for pictures, which is resumed after an interruption.
    """
    quilt: Path | None = None
    """Also write a quilt; a name such as portrait_qs8x6a0.75.png sets columns, rows and aspect."""
    usual: ClassVar[tuple[str, ...]] = ("compose", "size", "focus", "ground", "background",
                                        "draft", "frames", "fps")
    config: Annotated[EncodeConfig, tyro.conf.arg(name="")] = option(default_factory=EncodeConfig)
    """Coding."""
    sequence: Annotated[SequenceConfig, tyro.conf.arg(name="")] = option(
        default_factory=SequenceConfig)
    """Motion."""

    def run(self) -> dict[str, Any]:
        """Code and write."""
        from ..field import VoxelField
        from ..lightfield import composed, encode_with_figures, quilt_of

        if self.sequence.frames:
            return self._moving()
        lossless(self.out)
        panel = Display.resolve(self.display)
        voxels = VoxelField.load(self.field)
        config = composed(voxels, panel, self.config)
        with self.progress("encode") as progress:
            progress.update(0, f"{panel.width} x {panel.height}, {panel.views} views")
            image, figures = encode_with_figures(voxels, panel, config, device=self.device)
        write_coded(self.out, image, panel)
        if self.quilt is not None:
            picture, name = quilt_of(voxels, panel, config, name=self.quilt.name,
                                      device=self.device)
            layout = QuiltLayout.of_name(self.quilt.name, panel) or QuiltLayout.of_name(name)
            assert layout is not None
            write_quilt(self.quilt, picture, layout)
        return figures

    def _moving(self) -> dict[str, Any]:
        from ..field import VoxelField

        if self.quilt is not None:
            raise UserError("--quilt is for pictures that stand still; leave out --frames")
        panel = Display.resolve(self.display)
        voxels = VoxelField.load(self.field)
        start = time.perf_counter()
        with self.progress("encode", self.sequence.frames) as progress:
            figures = write_sequence(voxels, panel, self.config, self.sequence, self.out,
                                     progress.step)
        figures["seconds"] = {"sequence": round(time.perf_counter() - start, 3)}
        return figures | {"display": panel.name, "views": panel.views,
                          "subpixels": 3 * panel.width * panel.height}


@dataclass
class Simulate(Common):
    """Simulate the view of an eye in front of the display that shows a coded picture."""

    lightfield: tyro.conf.Positional[Path]
    """Coded picture."""
    display: str = "generic-4k"
    """The display that it was coded for."""
    eye: tuple[float, ...] = (0.0,)
    """Eye position X [Y] in half panel heights, at the viewing distance; x to the right."""
    crosstalk: float = 0.0
    """Cross-talk: sigma, in views, of the lobe that mixes in neighbouring views; 0 = none."""
    out: Path = Path("view.png")
    """File for the picture."""

    def run(self) -> dict[str, Any]:
        """Simulate and write."""
        from ..lightfield import simulate

        if len(self.eye) not in (1, 2):
            raise UserError("--eye takes X or X Y")
        panel = Display.resolve(self.display)
        image = simulate(read_coded(self.lightfield, panel), panel, self.eye,
                         crosstalk=self.crosstalk)
        write_image(self.out, image)
        return {}


_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")


@dataclass
class Interlace(Common):
    """Code a quilt, or a folder of views, for a display."""

    source: tyro.conf.Positional[Path]
    """Quilt, whose name gives columns, rows and aspect (portrait_qs8x6a0.75.png), or else its side
    file or EXIF; or a folder with one picture for each view, sorted by name from left to right."""
    display: str = "generic-4k"
    """Display preset (`lfportrait display list`) or a display or calibration file."""
    out: Path = Path("lightfield.png")
    """File for the coded picture; a name ending in .png keeps every sub-pixel."""
    columns: int = 0
    """Columns of the quilt; they come before what the quilt says."""
    rows: int = 0
    """Rows of the quilt."""
    aspect: float = 0.0
    """Aspect (width over height) of a view's content, if the quilt does not give it."""
    views: int = 0
    """Use only the first N views; 0 = all."""
    config: Annotated[InterlaceConfig, tyro.conf.arg(name="")] = option(
        default_factory=InterlaceConfig)
    """Sampling."""

    def run(self) -> dict[str, Any]:
        """Code and write."""
        lossless(self.out)
        panel = Display.resolve(self.display)
        asked = QuiltHint.of_options(self.columns, self.rows, self.aspect)
        layout = (QuiltLayout.of_name(self.source.name, panel) if self.source.is_dir()
                  else layout_for(self.source, panel, asked=asked))
        start = time.perf_counter()
        views, aspect = read_views(self.source, panel, layout=layout, views=self.views)
        loaded = time.perf_counter()
        image = interlace(views, panel, self.config, aspect=self.aspect or aspect)
        coded = time.perf_counter()
        write_coded(self.out, image, panel)
        return {"views": len(views), "view_size": [views.shape[2], views.shape[1]],
                "aspect": self.aspect or aspect, "display": panel.name,
                "subpixels": 3 * panel.width * panel.height,
                "seconds": {"load": round(loaded - start, 4),
                            "interlace": round(coded - loaded, 4)}}


@dataclass
class Deinterlace(Common):
    """Convert a coded picture into a quilt or a folder of views."""

    lightfield: tyro.conf.Positional[Path]
    """Coded picture."""
    display: str = "generic-4k"
    """The display that it was coded for."""
    out: Path = Path("views")
    """Folder for the views (0000.png is the leftmost), or, if the name ends in .png, a quilt; a
    name such as portrait_qs8x6a0.75.png sets its columns and rows."""
    views: int = 0
    """Number of views for a folder; by default that of the display."""
    size: tuple[int, int] = (0, 0)
    """Width and height of the views of a folder, or of the quilt; by default the panel's, or its
    customary quilt's."""

    def run(self) -> dict[str, Any]:
        """Take apart and write."""
        panel = Display.resolve(self.display)
        if min(self.size) < 0 or max(self.size) > 65536 or (self.size[0] > 0) != (self.size[1] > 0):
            raise UserError("--size takes a width and a height of 1 to 65536 pixels")
        quilt = self.out.suffix.lower() in _PICTURES
        if quilt and self.views:
            raise UserError("the quilt's name sets its number of views; leave out --views")
        if not 0 <= self.views <= 1024:
            raise UserError(f"--views must be 1 to 1024, not {self.views}")
        start = time.perf_counter()
        image = read_coded(self.lightfield, panel)
        if quilt:
            layout = QuiltLayout.of_name(self.out.name, panel)
            if layout is None:
                layout = QuiltLayout.of_display(panel)
            out = QuiltName.completed(self.out, layout)
            size = self.size if self.size[0] else panel.quilt_size
            width, height = size[0] // layout.columns, size[1] // layout.rows
            tiles = np.stack(list(each_view(image, panel, count=layout.count, width=width,
                                            height=height)))
            picture = assemble_quilt(tiles, layout, size)
            if out.suffix.lower() in QUILTS:
                write_quilt(out, picture, layout)
            else:
                write_image(out, picture)
            count = layout.count
        else:
            count, out = self.views or panel.views, self.out
            width, height = self.size if self.size[0] else (panel.width, panel.height)
            with self.progress("deinterlace", count) as progress:
                for index, view in enumerate(each_view(image, panel, count=count, width=width,
                                                       height=height)):
                    write_image(out / f"{index:04d}.png", view)
                    progress.update(index + 1)
        if not self.quiet:
            print(f"{out}: {count} views of {width} x {height}")
        return {"views": count, "view_size": [width, height], "display": panel.name, "out": out,
                "seconds": {"deinterlace": round(time.perf_counter() - start, 4)}}
