"""Hot loops of the capture stage, in Numba: views that vote on points of space."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
