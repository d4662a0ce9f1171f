"""Speed benchmarks, with baselines and quality: encode, print, reconstruct, transfer, stylize."""

from .encode import bench_masks
from .print import bench_print
from .run import BENCHES, bench, bench_encode, bench_reconstruct, bench_stylize
from .transfer import METHODS, bench_transfer, transfer_table

__all__ = [
           "BENCHES",
           "METHODS",
           "bench",
           "bench_encode",
           "bench_masks",
           "bench_print",
           "bench_reconstruct",
           "bench_stylize",
           "bench_transfer",
           "transfer_table",
]
