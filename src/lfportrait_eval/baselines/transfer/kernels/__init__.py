"""Hot loops of the published methods of transfer, in Numba: FaceBlit's table and flood fill."""

from lfportrait import lanes as lanes  # sets Numba's threading layer before kernels are compiled
