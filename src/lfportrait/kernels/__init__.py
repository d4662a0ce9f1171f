"""Hot loops in Numba: lanes (16-lane SIMD values), ray casting, training, and the stages' kernels.

The threading layer is OpenMP where there is one, because Numba's fallback may not be entered from
two Python threads at once (a viewer does that).
"""

import numba

setattr(numba.config, "THREADING_LAYER_PRIORITY", ["omp", "tbb", "workqueue"])  # noqa: B010
