"""Speed side by side: encode, reconstruct, transfer, stylize; each with the quality beside it."""

from .run import BENCHES, bench, bench_encode, bench_reconstruct, bench_stylize
from .transfer import bench_transfer, transfer_table

__all__ = ["BENCHES", "bench", "bench_encode", "bench_reconstruct", "bench_stylize",
           "bench_transfer", "transfer_table"]
