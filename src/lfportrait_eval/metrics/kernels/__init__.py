"""Hot loops of the metrics, in Numba: nearest patches."""

from lfportrait import lanes as lanes  # sets Numba's threading layer before kernels are compiled
