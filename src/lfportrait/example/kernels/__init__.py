"""Hot loops of the transfer by example, in Numba: guides, look-ups, copied pieces, votes."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
