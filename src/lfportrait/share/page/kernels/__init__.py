"""The hot loop of the page's coding, in Numba: lattice rows predicted from their neighbours."""

from .... import lanes as lanes  # sets Numba's threading layer before any kernel is compiled
