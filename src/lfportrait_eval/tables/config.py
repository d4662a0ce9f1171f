"""Parameters of the paper's tables: what is compared, how large, how long."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from lfportrait.errors import UserError
from lfportrait.stylize import StylizeConfig

from .methods import FULL, METHODS, QUICK, Sizes

__all__ = ["TablesConfig"]


@dataclass(frozen=True)
class TablesConfig:
    """Methods and sizes of the comparison."""

    methods: tuple[str, ...] = ()
    """Methods to compare; by default all (field and views, see docs/comparisons.md)."""
    size: Literal["quick", "full"] = "quick"
    """quick: about a minute a portrait and method; full: the methods' own sizes, many minutes."""
    pixels: float = 0.0
    """Pixels of the skin per world unit; 0: 256 (quick), 384 (full)."""
    render_size: int = 0
    """Width and height in pixels of the views on the arc; 0: 256 (quick), 384 (full)."""
    close_size: int = 0
    """Width and height in pixels of the close views (the head fills them); 0: 384 (quick), 768
    (full)."""
    painted_size: int = 0
    """Width and height in pixels of views that are painted before a field is fitted to them; 0: 384
    (quick; fewer leave lattice points undecided), 576 (full)."""
    painted_views: int = 0
    """Painted views on each arc; 0: 7 (quick), 15 (full)."""
    painted_steps: int = -1
    """Refinement steps on the painted views; -1: 20 (quick), 90 (full)."""
    crops: int = 0
    """Crops of renders and of the exemplar, for the distances of features; 0: 24 (quick), 48."""
    network_pairs: int = 0
    """Training examples of the network that paints single views; 0: 6 (quick), 24 (full)."""
    network_seconds: float = 0.0
    """Seconds of that network's training; 0: 15 (quick), 240 (full)."""
    views: int = 16
    """Views on the arc."""
    cone: float = 40.0
    """Width of the arc in degrees."""
    speed: bool = True
    """Also measure Table 1 (the mask guide) and Fig. 6 (speed of the transfers)."""
    done_only: bool = False
    """Compute nothing: write the tables of the finished cells."""
    study: Path | None = None
    """Folder with the results of a user study (`lfportrait study results`), to be included."""
    stylize: StylizeConfig = field(default_factory=StylizeConfig)
    """Parameters of the methods that color a field; method, guide, pixels, size, views and steps
    are set by the options above."""

    def sizes(self) -> Sizes:
        """The sizes of this run: those that are given, else those of ``size``."""
        preset = QUICK if self.size == "quick" else FULL
        chosen: dict[str, Any] = {}
        for one in fields(Sizes):
            given = getattr(self, one.name)
            unset = given < 0 if one.name == "painted_steps" else given <= 0
            chosen[one.name] = getattr(preset, one.name) if unset else given
        return Sizes(**chosen)

    def chosen(self) -> tuple[str, ...]:
        """Names of the methods that are compared."""
        return self.methods or tuple(METHODS)

    def check(self) -> None:
        """Raise `UserError` where parameters are unknown or out of range."""
        unknown = [name for name in self.methods if name not in METHODS]
        if unknown:
            raise UserError(f"there is no method {unknown[0]!r}; choose from {', '.join(METHODS)}")
        if len(set(self.chosen())) < len(self.chosen()):
            raise UserError("a method is named twice in --methods")
        if self.views < 2:
            raise UserError(f"--views must be 2 or more, not {self.views}")
        if not 0.0 < self.cone <= 180.0:
            raise UserError(f"--cone must lie between 0 and 180 degrees, not at {self.cone:g}")
        sizes = self.sizes()
        for name in ("render_size", "close_size", "painted_size"):
            if getattr(sizes, name) < 32:
                raise UserError(f"--{name.replace('_', '-')} must be 32 pixels or more, "
                                f"not {getattr(sizes, name)}")
        if self.study is not None and not (self.study / "results.json").is_file():
            raise UserError(f"there are no results of a study in {self.study}; write them with "
                            "`lfportrait study results`")
        if sizes.crops < 2:
            raise UserError(f"--crops must be 2 or more, not {sizes.crops}")
