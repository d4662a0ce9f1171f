"""Hot loops of the published methods on a field, in Numba: RMSProp."""

from lfportrait import lanes as lanes  # sets Numba's threading layer before kernels are compiled
