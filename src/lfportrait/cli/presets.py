"""What to choose from, and add to: the commands ``display`` (panels) and ``styles`` (paintings).

They list the presets; check, convert and prepare displays and paintings of one's own; and write a
panel's test patterns. Lists are quick: nothing slow is imported before it is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from ..errors import UserError
from ..files import picture_format, write_image
from ..lightfield import Display, EncodeConfig
from ..plugins import provided_styles
from .common import Common


@dataclass
class DisplayList(Common):
    """List the display presets.

    `lfportrait display show`, `display pattern` and `display import` are about one display.
    """

    def run(self) -> dict[str, Any]:
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
        panel = Display.load(Path(self.name))
        target = self.out or Path(f"{panel.name}.toml")
        panel.save(target)
        print(f"{target}: {panel.summary()}")
        return {"display": panel.name, "file": target}


@dataclass
class Styles(Common):
    """List the installed exemplars, or write one with its landmarks.

    `lfportrait styles add IMAGE` and `lfportrait styles check IMAGE` are for paintings of your own.
    """

    name: str = ""
    """Style to write with --out."""
    out: Path | None = None
    """Picture file for the style; the landmarks go beside it."""

    def run(self) -> dict[str, Any]:
        names = list(provided_styles())
        if self.out is not None:
            from ..example import Exemplar
            from ..face import write_landmarks

            exemplar = Exemplar.load(self.name or names[0])
            write_image(self.out, exemplar.image)
            write_landmarks(self.out.with_suffix(".landmarks.txt"), exemplar.landmarks)
        elif self.name:
            raise UserError("give an output file for the style: --out FILE.png")
        else:
            print("\n".join(names))
        return {"styles": names}


@dataclass
class _OfPainting(Common):
    """What both commands for a painting are given."""

    image: tyro.conf.Positional[Path]
    """The painting."""
    face: int = 0
    """Number of the face where a painting shows several, the largest is 1; 0 = the largest."""
    at: tuple[float, float] | None = None
    """Place X Y in pixels on the face, if it is not found or a pattern is taken for one."""

    def check(self) -> None:
        """Raise `UserError` for a face of no number."""
        if self.face < 0:
            raise UserError("faces are numbered from 1; --face 0 is the largest")


@dataclass
class StylesAdd(_OfPainting):
    """Find the landmarks of a painting and write them beside it.

    They go to NAME.landmarks.txt, one "x y" a line, to be corrected by hand where they are off, and
    are drawn with the mesh of the face's pose in NAME.landmarks.png. Where the file exists already
    it is read and drawn again.
    """

    def run(self) -> dict[str, Any]:
        from ..job import add_style

        self.check()
        found = add_style(self.image, self.face, self.at)
        print("\n".join(found.pop("said")))
        return found


@dataclass
class StylesCheck(_OfPainting):
    """Check a painting before it is used, on one page.

    The page shows how the face is turned, what is mirrored, what the painting has no paint for, how
    large it is beside what displays show, and a preview on the embedded head.
    """

    out: Path | None = None
    """Picture file for the page; by default NAME.check.png beside the painting."""

    def run(self) -> dict[str, Any]:
        from ..job import check_style, style_picture

        self.check()
        # A built-in exemplar has no folder: its page goes into this one.
        out = self.out or self.image.with_suffix(".check.png")
        picture_format(out)
        with self.progress("check") as progress:
            progress.update(0, f"paint the embedded head after {self.image.stem}")
            check = check_style(self.image, self.face, self.at)
        write_image(out, style_picture(check), sheet=True)
        print("\n".join(text for _, text in check.facts))
        print(f"wrote {out}")
        return {"image": str(self.image), "page": str(out), "faces": max(len(check.faces), 1),
                **check.figures}
