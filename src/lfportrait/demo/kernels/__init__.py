"""Hot loops of the demo, in Numba: the modelled head, its photographs, brush strokes."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
