"""Hot loops of the transfer by example, in Numba: guides, look-ups, copied pieces, votes."""

from ... import simd as simd  # sets Numba's threading layer before any kernel is compiled
