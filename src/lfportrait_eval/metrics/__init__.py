"""Quality metrics of a finished job.

`views` are what is measured: whether they agree, and whether the head is still the person;
`features` (with LPIPS) and `patches` say how near the style is, `repeats` what became of the paint,
by the head's regions.
"""

from .features import (
    feature_distance,
    frechet_distance,
    inception_features,
    kernel_distance,
    lpips,
    style_distance,
)
from .job import evaluate_field, evaluate_job, landmarks_kept, without_nan
from .patches import PatchIndex, patch_fidelity
from .repeats import (
    Repeat,
    RowLabels,
    exemplar_regions,
    gradient_energy,
    region_repeats,
    sharpness,
    strongest_repeat,
)
from .views import (
    Arc,
    arc_cameras,
    consistency,
    contour_correlation,
    face_unit,
    head_cameras,
    identity,
    landmark_error,
    pair_error,
    view_pairs,
    views_fidelity,
    warp,
)

__all__ = ["Arc", "PatchIndex", "Repeat", "RowLabels", "arc_cameras", "consistency",
           "contour_correlation", "evaluate_field", "evaluate_job", "exemplar_regions", "face_unit",
           "feature_distance", "frechet_distance", "gradient_energy", "head_cameras", "identity",
           "inception_features", "kernel_distance", "landmark_error", "landmarks_kept", "lpips",
           "pair_error", "patch_fidelity", "region_repeats", "sharpness",
           "strongest_repeat", "style_distance", "view_pairs", "views_fidelity", "warp",
           "without_nan"]
