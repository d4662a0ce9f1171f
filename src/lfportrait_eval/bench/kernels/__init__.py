"""Hot loops that tell how fast the machine is, in Numba."""

from lfportrait import lanes as lanes  # sets Numba's threading layer before kernels are compiled
