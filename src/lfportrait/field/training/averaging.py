"""Average the last states of a training (Polyak averaging).

Steps follow the errors of a few thousand rays, so that densities and colors wander about what all
rays together ask for. Their mean over the last part of the training does not (Polyak and Juditsky
1992), and rates need not fall as low for it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels.rows import add_rows, put_means
from .lattice import Lattice

__all__ = ["Average"]

STATES = 50
"""States that a whole level would give; neighbouring ones differ little."""


class Average:
    """Sums of densities and colors.

    Parameters
    ----------
    lattice
        Whose states are added.
    columns
        Values of a row that are colors, from the first on; the others are left alone.

    Attributes
    ----------
    density, rows
        float32 [N + 1] and [N + 1, columns], sums of the states.
    count
        Number of states.
    """

    def __init__(self, lattice: Lattice, columns: int) -> None:
        self.density = np.zeros_like(lattice.density)
        self.rows = np.zeros((len(lattice.rows), columns), np.float32)
        self.count = 0

    @staticmethod
    def due(before: float, done: float, share: float) -> bool:
        """Whether a state is added between two moments, in shares of a level that are done.

        ``share`` is the last part of the level that counts.
        """
        return done > 1.0 - share and int(STATES * done) > int(STATES * before)

    def add(self, lattice: Lattice) -> None:
        """Add a state."""
        self.density += lattice.density
        add_rows(self.rows, lattice.rows)
        self.count += 1

    def put(self, lattice: Lattice) -> None:
        """Give the lattice the mean of its states; nothing changes if none was added."""
        if self.count:
            np.divide(self.density, self.count, out=lattice.density)
            put_means(self.rows, self.rows.shape[1], np.float32(self.count), lattice.rows, 0)

    @property
    def state(self) -> dict[str, Any]:
        """For a checkpoint."""
        return {"average_density": self.density, "average_rows": self.rows,
                "average_count": np.array(self.count)}

    @staticmethod
    def restored(state: dict[str, Any], lattice: Lattice) -> Average | None:
        """From a checkpoint, None where it has none.

        Raises
        ------
        ValueError
            If it belongs to another lattice.
        """
        if "average_count" not in state:
            return None
        found = Average(lattice, state["average_rows"].shape[1])
        if (found.rows.shape != state["average_rows"].shape
                or found.density.shape != state["average_density"].shape):
            raise ValueError("averages of another lattice")
        found.density, found.rows = state["average_density"], state["average_rows"]
        found.count = int(state["average_count"])
        return found
