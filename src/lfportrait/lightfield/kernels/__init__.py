"""Hot loops of the coding, in Numba: sub-pixels of a panel, slices of a field."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
