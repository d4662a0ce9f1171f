"""Commands that code for a display: ``encode`` and ``simulate``."""

from __future__ import annotations

import time
from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from ..errors import UserError
from ..files import write_image
from ..lightfield import (
    Display,
    EncodeConfig,
    QuiltLayout,
    lossless,
    read_coded,
    write_coded,
)
from ..share import SequenceConfig, write_quilt, write_sequence
from .common import Common

__all__ = ["Encode", "Simulate"]


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
