"""The command ``inspect``: what files and folders are, and how they will be read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from ..errors import UserError
from .common import Common

__all__ = ["Inspect"]


@dataclass
class Inspect(Common):
    """Tell what files and folders are and how they will be read; nothing is computed.

    Size, orientation, colors, lens, depth, cameras, masks, a quilt's layout; and what is left out.
    """

    paths: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Photos, videos, quilts, folders, data sets."""

    def run(self) -> dict[str, Any]:
        """Look and print."""
        from ..job import inspect, inspection_lines

        if not self.paths:
            raise UserError("name what to look at: lfportrait inspect FILE-OR-FOLDER ...")
        missing = [path for path in self.paths if not path.exists()]
        if missing:
            raise UserError(f"there is no file or folder {missing[0]}; check the name")
        found = []
        for number, path in enumerate(self.paths):
            found.append(inspect(path))
            if not self.quiet:
                print("\n".join([""] * bool(number) + inspection_lines(found[-1])))
        return {"inspected": [one.figures() for one in found]}
