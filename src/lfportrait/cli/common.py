"""Options that every command has."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from ..progress import Progress

__all__ = ["Common"]


@dataclass(kw_only=True)
class Common:
    """Options that every command has."""

    device: Annotated[str, tyro.conf.arg(metavar="auto|cpu|gpu|gpu:NAME")] = "auto"
    """Where to compute; this version does on the CPU."""
    seed: int = 0
    """Seed of all random choices; the same seed on the same machine gives the same files."""
    quiet: bool = False
    """Print no progress."""
    json: Path | None = None
    """Write the figures of the run (times, sizes, metrics) to this file."""

    def progress(self, title: str, total: int = 0) -> AbstractContextManager[Progress]:
        """A progress line, silent with ``--quiet``; it tells of kernels that are compiled, too."""
        from ..lanes.compiling import compiling_progress

        return compiling_progress(title, total, not self.quiet)

    def run(self) -> dict[str, Any]:
        """Do it.

        Returns
        -------
        figures
            What ``--json`` writes.
        """
        raise NotImplementedError

    def exit_code(self, figures: dict[str, Any]) -> int:
        """The exit code of a run that came to its end with these figures: 0."""
        return 0
