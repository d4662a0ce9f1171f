"""How good a result is, and how fast it came: figures of a finished job.

`consistency` tells whether views agree, `likeness` whether the head is still the person, `features`
and `patches` how near the style is, `repeats` and `sharpness` what became of its paint;
`transfer_quality` and `strokes` measure the transfer alone; `bench` measures speed.
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
from .repeats import Repeat, repeat_ratio, repeats, strongest_repeat
from .sharpness import gradient_energy, sharpness

__all__ = ["PatchIndex", "Repeat", "consistency", "contour_correlation",
           "evaluate_field", "evaluate_job", "feature_distance", "frechet_distance",
           "gradient_energy", "identity", "inception_features", "kernel_distance",
           "landmark_error", "lpips", "pair_error", "patch_fidelity", "repeat_ratio", "repeats",
           "sharpness", "strongest_repeat", "style_distance", "view_pairs", "warp"]
