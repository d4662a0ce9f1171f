"""Sixteen numbers at once (SIMD) for kernels in Numba, and how such kernels are compiled.

A kernel is a factory over a namespace of operations: `vectors` gives it 16 lanes (SIMD), `one_lane`
plain numbers, which makes a scalar twin that is easy to debug. `types` tells Numba what lanes are;
`interleaved` and `shuffles` add loads, stores and orders that pictures and short rows need;
`cache_keys`, `compiling` and `decorators` are about compiling, `threads` about sharing out a
kernel's lines, `host` about the machine.

No kernel here uses Numba's own threads, but one that a user brings may, and Numba loads them when
it is asked how many there are: OpenMP's where there is one, because the fallback may not be entered
from two Python threads at once (a viewer does that).
"""

import numba

setattr(numba.config, "THREADING_LAYER_PRIORITY", ["omp", "tbb", "workqueue"])  # noqa: B010
