"""Progress of a long run: the current cell, the number left, the estimated time."""

from __future__ import annotations

from collections.abc import Sequence

from lfportrait.progress import Progress

__all__ = ["Teller"]

CellName = tuple[str, str, str]
"""Sitter, style, method."""


class Teller:
    """The progress of a run.

    Parameters
    ----------
    progress
        The line that is drawn; None for silence.
    waiting
        Cells that are to be done.
    """

    def __init__(self, progress: Progress | None, waiting: Sequence[CellName]) -> None:
        self._progress, self._waiting = progress, list(waiting)
        self._total = len(self._waiting)
        self._took: dict[str, list[float]] = {}

    def say(self, text: str) -> None:
        """Show what is being done, behind what is left."""
        if self._progress is not None:
            self._progress.update(0, "; ".join(filter(None, [self._left(), text])))

    def _left(self) -> str:
        """How much is done and, once it can be estimated, how long the rest takes."""
        done, seconds = self._total - len(self._waiting), self.seconds_left()
        rest = f", about {max(seconds / 60, 1):.0f} min left" if seconds else ""
        return f"{done} of {self._total}{rest}" if self._total else ""

    def inside(self, title: str) -> Progress:
        """A progress line for a part: what it shows stands behind ``title`` on this one."""
        return _Inside(title, self)

    def done(self, cell: CellName, seconds: float) -> None:
        """A cell is done, in so many seconds; one that was done before does not count."""
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
            self._progress.say(f"{', '.join(cell)}: {text}; {self._left()}")

    def seconds_left(self) -> float:
        """Estimated time of the waiting cells: by the mean of their method, else of all."""
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
