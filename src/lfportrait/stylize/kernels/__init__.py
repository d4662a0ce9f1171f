"""Hot loops of the stylisation, in Numba: from colors to a view and back."""

from ... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
