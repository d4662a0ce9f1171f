"""The command ``styles``: installed exemplars, and paintings of one's own made ready."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro

from ..errors import UserError
from ..example import provided_styles
from ..files import write_image
from .common import Common

__all__ = ["Styles"]


@dataclass
class Styles(Common):
    """List the installed exemplars, write one with its landmarks, prepare a painting of yours."""

    action: tyro.conf.Positional[Literal["list", "add"]] = "list"
    """list: the installed exemplars; add IMAGE: find the landmarks of a painting, write them beside
    it (NAME.landmarks.txt, one x y a line: correct it where it is off) and draw them
    (NAME.landmarks.png). Where the file is there already it is read and drawn again."""
    image: tyro.conf.Positional[Path | None] = None
    """Painting to add."""
    name: str = ""
    """Style to write with --out."""
    out: Path | None = None
    """Picture file; the landmarks go beside it."""

    def run(self) -> dict[str, Any]:
        """List, write or add."""
        if self.action == "add":
            if self.image is None:
                raise UserError("say which painting: lfportrait styles add IMAGE")
            from .transfers import add_style

            return add_style(self.image)
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
