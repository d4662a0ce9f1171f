"""Hot loops of the demo, in Numba: the shape of a head, photographs of it, brush strokes."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
