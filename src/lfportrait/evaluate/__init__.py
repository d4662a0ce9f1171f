"""How good a result is, and how fast it came: figures of a finished job.

`consistency` tells whether views agree, `likeness` whether the head is still the person, `features`
and `patches` how near the style is; `transfer_quality` and `strokes` measure the transfer alone;
`bench` measures speed.
"""

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

__all__ = ["PatchIndex", "consistency", "contour_correlation",
           "evaluate_field", "evaluate_job", "feature_distance", "frechet_distance", "identity",
           "inception_features", "kernel_distance", "landmark_error", "lpips", "pair_error",
           "patch_fidelity", "style_distance", "view_pairs", "warp"]
