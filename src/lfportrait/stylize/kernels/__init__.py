"""Hot loops of the stylisation, in Numba: products with a view's sparse weights."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
