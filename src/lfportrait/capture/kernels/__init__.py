"""Hot loops of the capture, in Numba: views that vote on which points of space are the person."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
