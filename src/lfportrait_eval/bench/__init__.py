"""Speed benchmarks, with baselines and quality: of single stages, and of whole jobs."""

from .encode import bench_masks, bench_print
from .jobs import bench_jobs, job_tables
from .run import (
           BENCHES,
           bench,
           bench_encode,
           bench_reconstruct,
           bench_stylize,
           read_measured,
           record,
)
from .transfer import METHODS, bench_transfer, transfer_table

__all__ = [
           "BENCHES",
           "METHODS",
           "bench",
           "bench_encode",
           "bench_jobs",
           "bench_masks",
           "bench_print",
           "bench_reconstruct",
           "bench_stylize",
           "bench_transfer",
           "job_tables",
           "read_measured",
           "record",
           "transfer_table",
]
