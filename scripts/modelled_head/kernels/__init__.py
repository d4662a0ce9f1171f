"""Hot loops of the modelled head, in Numba: its shape, photographs of it, brush strokes."""

from lfportrait import simd as simd  # sets Numba's threading layer before any kernel is compiled
