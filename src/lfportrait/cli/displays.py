"""The command ``display``: presets, files and test patterns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro

from ..errors import UserError
from ..lightfield import Display, EncodeConfig
from .common import Common

__all__ = ["DisplayCommand"]


@dataclass
class DisplayCommand(Common):
    """List, show and import displays; draw test patterns coded for a panel."""

    action: tyro.conf.Positional[Literal["list", "show", "pattern", "import"]]
    """What to do."""
    name: tyro.conf.Positional[str] = ""
    """Display preset or file (show, pattern); calibration file (import)."""
    kind: str = "views"
    """Pattern: views (each view's number), slant (pitch, slant and offset), fringe (order of the
    sub-pixels) or depth (grids at five depths)."""
    out: Path | None = None
    """File for the pattern (.png) or the imported display (.toml)."""
    size: float = EncodeConfig.size
    """show: height of the head over the panel's height, for the depth budget."""
    focus: float = EncodeConfig.focus
    """show: how far the head's middle lies in front of the panel, in half panel heights."""
    depth_scale: float = EncodeConfig.depth_scale
    """show: depth of the head over its true depth."""

    def run(self) -> dict[str, Any]:
        """Do what ``action`` says."""
        if self.action == "list":
            rows = [Display.preset(name).summary() for name in Display.names()]
            print("\n".join(rows))
            return {"displays": Display.names()}
        if not self.name:
            raise UserError(f"name the display: lfportrait display {self.action} NAME")
        if self.action == "import":
            panel = Display.load(Path(self.name))
            target = self.out or Path(f"{panel.name}.toml")
            panel.save(target)
            print(f"{target}: {panel.summary()}")
            return {"display": panel.name, "file": target}
        panel = Display.resolve(self.name)
        if self.action == "show":
            from ..lightfield import DepthReport

            report = DepthReport.of(panel, EncodeConfig(
                size=self.size, focus=self.focus, depth_scale=self.depth_scale))
            print(panel.to_toml() + "\n# Depth budget for a head of size "
                  f"{self.size:g} at focus {self.focus:g}:")
            print("\n".join(f"#   {line}" for line in report.lines()))
            return {"display": panel.name, "depth": report.figures()}
        from ..lightfield import lossless, pattern, write_coded

        if self.out is None:
            raise UserError("say where to write the pattern with --out FILE.png")
        lossless(self.out)
        write_coded(self.out, pattern(panel, self.kind), panel)
        return {"display": panel.name, "pattern": self.kind}
