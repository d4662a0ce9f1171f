"""People at random between two that are modelled."""

from __future__ import annotations

from typing import Any

import numpy as np

from .head_model import HeadModel
from .people import PAINTED, SITTER

__all__ = ["random_person"]


def random_person(random: np.random.Generator) -> HeadModel:
    """A head each of whose features lies between those of `SITTER` and of `PAINTED`.

    Parameters
    ----------
    random : Where the choices come from.
    """
    features: dict[str, Any] = {}
    for name in SITTER._fields:
        one, other = (np.asarray(getattr(model, name)) for model in (SITTER, PAINTED))
        if np.array_equal(one, other):
            continue  # Draw nothing: what neither has must not change the others' choices.
        value = one + random.random() * (other - one)
        features[name] = tuple(value.tolist()) if value.ndim else float(value)
    return SITTER._replace(**features)
