"""The command ``restyle``: mix the photo's and the paintings' colors in a stylised field.

It has a file of its own because the other commands of the style import torch, which takes longer
than mixing.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from dataclasses import field as option
from pathlib import Path
from typing import Annotated, Any

import tyro

from ..stylize import MixConfig, StyledField
from .common import Common


@dataclass
class Restyle(Common):
    """Change the strength, likeness, regions or style of a stylised field."""

    field: tyro.conf.Positional[Path]
    """Stylised field (.npz), from `lfportrait stylize` or from this command."""
    out: Path = Path("mixed.npz")
    """File for the field in its new colors; all styles stay in it."""
    config: Annotated[MixConfig, tyro.conf.arg(name="")] = option(default_factory=MixConfig)
    """Mix."""

    def run(self) -> dict[str, Any]:
        """Mix and save."""
        asked = self.config.arguments()
        begin = time.perf_counter()
        styled = StyledField.load(self.field)
        loaded = time.perf_counter()
        mixed = styled.mix(**asked)
        ready = time.perf_counter()
        mixed.save(self.out)
        end = time.perf_counter()
        return {"seconds": {"load": round(loaded - begin, 3), "mix": round(ready - loaded, 3),
                            "save": round(end - ready, 3)},
                "styles": list(mixed.styles), "regions": list(mixed.regions),
                "mix": mixed.mixture, "voxels": len(mixed.density)}
