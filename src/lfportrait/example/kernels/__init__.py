"""Hot loops of the transfer by example, in Numba: guides, look-ups, chunks, votes, patches."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
