"""Hot loops of the field, in Numba: casting rays through voxels, forward and backward."""

from ... import simd as simd  # sets Numba's threading layer before any kernel is compiled
