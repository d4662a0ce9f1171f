"""What a run of hours tells: which cell is being done, how many are left, about how long."""

from __future__ import annotations

from collections.abc import Sequence

from ...progress import Progress

__all__ = ["Teller"]

CellName = tuple[str, str, str]
"""Sitter, style, method."""


class Teller:
    """The progress of a run.

    Parameters
    ----------
    progress
        The line that is drawn; None tells nothing.
    waiting
        Cells that are to be done.
    """

    def __init__(self, progress: Progress | None, waiting: Sequence[CellName]) -> None:
        self._progress, self._waiting = progress, list(waiting)
        self._total = len(self._waiting)
        self._took: dict[str, list[float]] = {}
        if progress is not None:
            progress.total = self._total

    def say(self, text: str) -> None:
        """Show what is being done."""
        if self._progress is not None:
            self._progress.update(self._progress.done, text)

    def inside(self, title: str) -> Progress:
        """A progress line for a part: what it shows stands behind ``title`` on this one."""
        return _Inside(title, self)

    def done(self, cell: CellName, seconds: float) -> None:
        """A cell is done, in so many seconds; one that was done before tells nothing."""
        if cell in self._waiting:
            self._took.setdefault(cell[2], []).append(seconds)
            self._finish(cell, f"{seconds:.0f} s")

    def failed(self, cell: CellName, reason: str) -> None:
        """A cell can't be done."""
        if cell in self._waiting:
            self._finish(cell, f"not measured: {reason}")

    def _finish(self, cell: CellName, text: str) -> None:
        self._waiting.remove(cell)
        if self._progress is not None:
            left = self.seconds_left()
            rest = f", about {left / 60:.0f} min left" if self._waiting and left else ""
            self._progress.say(f"{', '.join(cell)}: {text}; "
                               f"{self._total - len(self._waiting)} of {self._total}{rest}")
            self._progress.step(", ".join(cell))

    def seconds_left(self) -> float:
        """What the waiting cells will take: by the mean of their method, else of all."""
        known = [second for row in self._took.values() for second in row]
        if not known:
            return 0.0
        means = {method: sum(row) / len(row) for method, row in self._took.items()}
        return sum(means.get(cell[2], sum(known) / len(known)) for cell in self._waiting)


class _Inside(Progress):
    """A progress whose notes go to a teller."""

    def __init__(self, title: str, teller: Teller) -> None:
        super().__init__(title, enabled=False)
        self._teller = teller

    def update(self, done: int, note: str = "") -> None:
        """Pass the note on."""
        self.done = done
        self._teller.say(f"{self.title}: {note}" if note else self.title)
