"""Hot loops of the measurements, in Numba: nearest patches, and how fast the machine is."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
