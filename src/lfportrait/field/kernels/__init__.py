"""Hot loops of the field, in Numba: bricks, marching, training, votes of depth maps."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
