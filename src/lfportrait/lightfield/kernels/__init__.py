"""Hot loops of the coding, in Numba: sub-pixels of a panel, and slices of a field for its rows."""

from ... import simd as simd  # sets Numba's threading layer before any kernel is compiled
