"""A rival by its parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arf import paint_by_features
from .config import ArfConfig, RefNprConfig, StylizedNerfConfig
from .photo_views import RivalTask
from .ref_npr import paint_by_reference
from .stylized_nerf import paint_by_mutual_teaching

__all__ = ["RivalConfig", "stylize_as_rival"]

RivalConfig = ArfConfig | StylizedNerfConfig | RefNprConfig


def stylize_as_rival(task: RivalTask, config: RivalConfig,
                     ) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Colours of a field's rows, float32 [N, 3], by the rival that a configuration belongs to."""
    if isinstance(config, ArfConfig):
        return paint_by_features(task, config)
    if isinstance(config, StylizedNerfConfig):
        return paint_by_mutual_teaching(task, config)
    return paint_by_reference(task, config)
