"""Quality metrics of a finished job.

`consistency` measures whether views agree, `likeness` whether the head is still the person,
`features` (and `perceptual`, LPIPS) and `patches` how near the style is, `repeats`, by the head's
`regions`, and `sharpness` what became of its paint; `views` are what is measured.
"""

from .consistency import consistency, pair_error, view_pairs, warp
from .features import (
    feature_distance,
    frechet_distance,
    inception_features,
    kernel_distance,
    style_distance,
)
from .job import evaluate_field, evaluate_job, landmarks_kept, without_nan
from .likeness import contour_correlation, identity, landmark_error
from .patches import PatchIndex, patch_fidelity
from .perceptual import lpips
from .regions import RowLabels, exemplar_regions, region_repeats
from .repeats import Repeat, repeat_ratio, repeats, strongest_repeat
from .sharpness import gradient_energy, sharpness
from .views import Arc, arc_cameras, face_unit, head_cameras, views_fidelity

__all__ = ["Arc", "PatchIndex", "Repeat", "RowLabels", "arc_cameras", "consistency",
           "contour_correlation", "evaluate_field", "evaluate_job", "exemplar_regions", "face_unit",
           "feature_distance", "frechet_distance", "gradient_energy", "head_cameras", "identity",
           "inception_features", "kernel_distance", "landmark_error", "landmarks_kept", "lpips",
           "pair_error", "patch_fidelity", "region_repeats", "repeat_ratio", "repeats", "sharpness",
           "strongest_repeat", "style_distance", "view_pairs", "views_fidelity", "warp",
           "without_nan"]
