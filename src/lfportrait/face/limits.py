"""A head from one photo: how it is recognised, and how far around it can be looked at."""

__all__ = ["FIT", "MOST_TURNED", "PORTRAIT_CONE"]

PORTRAIT_CONE = 40.0
"""Degrees in all."""
MOST_TURNED = 35.0
"""Degrees that a face may be turned in its photo."""
FIT = "head_fit"
"""Key of a capture's figures under which the fit of a head is kept."""
