"""The commands ``display``: presets, files and test patterns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from ..errors import UserError
from ..lightfield import Display, EncodeConfig
from .common import Common

__all__ = ["DisplayImport", "DisplayList", "DisplayPattern", "DisplayShow"]


@dataclass
class DisplayList(Common):
    """List the display presets.

    `lfportrait display show`, `display pattern` and `display import` are about one display.
    """

    def run(self) -> dict[str, Any]:
        """Print a line for each."""
        print("\n".join(Display.preset(name).summary() for name in Display.names()))
        return {"displays": Display.names()}


@dataclass
class DisplayShow(Common):
    """Show a display's parameters, and the depth that it has for a head."""

    name: tyro.conf.Positional[str]
    """Display preset, or a display or calibration file."""
    size: float = EncodeConfig.size
    """Height of the head over the panel's height, for the depth budget."""
    focus: float = EncodeConfig.focus
    """How far the head's middle lies in front of the panel, in half panel heights."""
    depth_scale: float = EncodeConfig.depth_scale
    """Depth of the head over its true depth."""

    def run(self) -> dict[str, Any]:
        """Print both."""
        from ..lightfield import DepthReport

        panel = Display.resolve(self.name)
        report = DepthReport.of(panel, EncodeConfig(
            size=self.size, focus=self.focus, depth_scale=self.depth_scale))
        print(panel.to_toml() + "\n# Depth budget for a head of size "
              f"{self.size:g} at focus {self.focus:g}:")
        print("\n".join(f"#   {line}" for line in report.lines()))
        return {"display": panel.name, "depth": report.figures()}


@dataclass
class DisplayPattern(Common):
    """Draw a test pattern, coded for a display."""

    name: tyro.conf.Positional[str]
    """Display preset, or a display or calibration file."""
    kind: str = "views"
    """views (each view's number), slant (pitch, slant and offset), fringe (order of the sub-pixels)
    or depth (grids at five depths)."""
    out: Path | None = None
    """File for the pattern (.png)."""

    def run(self) -> dict[str, Any]:
        """Draw and write."""
        from ..lightfield import lossless, pattern, write_coded

        panel = Display.resolve(self.name)
        if self.out is None:
            raise UserError("give an output file for the pattern: --out FILE.png")
        lossless(self.out)
        write_coded(self.out, pattern(panel, self.kind), panel)
        return {"display": panel.name, "pattern": self.kind}


@dataclass
class DisplayImport(Common):
    """Make a display file of a calibration file (visual.json of a Looking Glass)."""

    name: tyro.conf.Positional[str]
    """Calibration file."""
    out: Path | None = None
    """Display file (.toml); by default the display's name in this folder."""

    def run(self) -> dict[str, Any]:
        """Read and write."""
        panel = Display.load(Path(self.name))
        target = self.out or Path(f"{panel.name}.toml")
        panel.save(target)
        print(f"{target}: {panel.summary()}")
        return {"display": panel.name, "file": target}
