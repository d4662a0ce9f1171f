"""Metrics of a finished job, consistency between views, and speed side by side."""

from .bench import BENCHES, bench, bench_encode, bench_reconstruct, bench_stylize
from .bench_transfer import bench_transfer, transfer_table
from .consistency import consistency, pair_error, view_pairs, warp
from .features import (
    feature_distance,
    frechet_distance,
    inception_features,
    kernel_distance,
    lpips,
    style_distance,
)
from .job import evaluate_field, evaluate_job
from .likeness import contour_correlation, identity, landmark_error
from .patches import PatchIndex, patch_fidelity

__all__ = ["BENCHES", "PatchIndex", "bench", "bench_encode", "bench_reconstruct",
           "bench_stylize", "bench_transfer", "consistency", "contour_correlation",
           "evaluate_field", "evaluate_job", "feature_distance", "frechet_distance", "identity",
           "inception_features", "kernel_distance", "landmark_error", "lpips", "pair_error",
           "patch_fidelity", "style_distance", "transfer_table", "view_pairs", "warp"]
