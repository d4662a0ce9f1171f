"""Sixteen numbers at once (SIMD) for kernels in Numba, and how such kernels are compiled.

A kernel is a factory over a namespace of operations: `vectors` gives it 16 lanes (SIMD), `one_lane`
plain numbers, which makes a scalar twin that is easy to debug. `types` tells Numba what lanes are;
`interleaved` and `shuffles` add loads, stores and orders that pictures and short rows need;
`cache_keys` and `reference_counts` are about compiling, `host` about the machine.

Numba's threading layer is OpenMP where there is one, because its fallback may not be entered from
two Python threads at once (a viewer does that).
"""

import numba

setattr(numba.config, "THREADING_LAYER_PRIORITY", ["omp", "tbb", "workqueue"])  # noqa: B010
