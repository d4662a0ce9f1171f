"""The published methods that color a field, as the entry points name them.

Their modules import torch, so they are imported when they paint.
"""

from __future__ import annotations

from typing import Any

from lfportrait.arrays import Float32
from lfportrait.stylize import FieldMethod, FieldTask

from ..config import ArfConfig, RefNprConfig, StylizedNerfConfig

Painted = tuple[Float32, dict[str, Any]]


def _arf(task: FieldTask, config: ArfConfig) -> Painted:
    from .arf import paint_by_features

    return paint_by_features(task, config)


def _stylized_nerf(task: FieldTask, config: StylizedNerfConfig) -> Painted:
    from .stylized_nerf import paint_by_mutual_teaching

    return paint_by_mutual_teaching(task, config)


def _ref_npr(task: FieldTask, config: RefNprConfig) -> Painted:
    from .ref_npr import paint_by_reference

    return paint_by_reference(task, config)


ARF = FieldMethod(ArfConfig, _arf, needs_face=False)
STYLIZED_NERF = FieldMethod(StylizedNerfConfig, _stylized_nerf, needs_face=False,
                            networks=("adain",))
REF_NPR = FieldMethod(RefNprConfig, _ref_npr)
