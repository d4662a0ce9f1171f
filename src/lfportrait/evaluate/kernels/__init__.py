"""Hot loops of the measurements, in Numba: nearest patches, and what the machine can do."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
