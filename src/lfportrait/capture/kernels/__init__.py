"""Hot loops of the capture, in Numba: views vote on which points belong to the person."""

from ... import simd as simd  # sets Numba's threading layer before any kernel is compiled
