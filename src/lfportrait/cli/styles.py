"""The command ``styles``: installed exemplars; paintings of one's own, checked and made ready."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro

from ..errors import UserError
from ..example import provided_styles
from ..files import picture_format, write_image
from .common import Common

__all__ = ["Styles"]


@dataclass
class Styles(Common):
    """List the installed exemplars, write one with its landmarks, check and prepare a painting."""

    action: tyro.conf.Positional[Literal["list", "add", "check"]] = "list"
    """list: the installed exemplars; add IMAGE: find the landmarks of a painting, write them beside
    it (NAME.landmarks.txt, one x y a line: correct it where it is off) and draw them
    (NAME.landmarks.png) with the mesh of the face's pose. Where the file is there already it is
    read and drawn again. check IMAGE: a page (NAME.check.png) that says how the face is turned,
    what is mirrored, what the painting has no paint for, how large it is beside what displays show;
    with a preview on the embedded head."""
    image: tyro.conf.Positional[Path | None] = None
    """Painting to add or to check."""
    face: int = 0
    """Number of the face where a painting shows several, the largest is 1; 0 = the largest."""
    at: tuple[float, float] | None = None
    """Place X Y in pixels on the face, where it is overlooked or a pattern is taken for one."""
    name: str = ""
    """Style to write with --out."""
    out: Path | None = None
    """Picture file; the landmarks go beside it. For check: the page."""

    def run(self) -> dict[str, Any]:
        """List, write, add or check."""
        if self.face < 0:
            raise UserError("faces are numbered from 1; --face 0 is the largest")
        if self.action != "list":
            if self.image is None:
                raise UserError(f"say which painting: lfportrait styles {self.action} IMAGE")
            return self._add(self.image) if self.action == "add" else self._check(self.image)
        names = list(provided_styles())
        if self.out is not None:
            from ..example import Exemplar
            from ..face import write_landmarks

            exemplar = Exemplar.load(self.name or names[0])
            write_image(self.out, exemplar.image)
            write_landmarks(self.out.with_suffix(".landmarks.txt"), exemplar.landmarks)
        elif self.name:
            raise UserError("say where to write the style with --out FILE.png")
        else:
            print("\n".join(names))
        return {"styles": names}

    def _add(self, image: Path) -> dict[str, Any]:
        """Find and draw the landmarks of a painting."""
        from ..job import add_style

        found = add_style(image, self.face, self.at)
        print("\n".join(found.pop("said")))
        return found

    def _check(self, image: Path) -> dict[str, Any]:
        """Write the page about a painting, and say what it says."""
        from ..job import check_style, style_picture

        # A built-in exemplar has no folder: its page goes into this one.
        out = self.out or image.with_suffix(".check.png")
        picture_format(out)
        with self.progress("check") as progress:
            progress.update(0, f"paint the embedded head after {image.stem}")
            check = check_style(image, self.face, self.at)
        write_image(out, style_picture(check))
        print("\n".join(text for _, text in check.facts))
        print(f"wrote {out}")
        return {"image": str(image), "page": str(out), "faces": max(len(check.faces), 1),
                **check.figures}
