"""Hot loops that measure the machine's speed, in Numba."""

from lfportrait import lanes as lanes  # sets Numba's threading layer before kernels are compiled
