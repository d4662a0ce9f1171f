"""How far a head from one photo can be looked at."""

__all__ = ["PORTRAIT_CONE"]

PORTRAIT_CONE = 40.0
"""Degrees in all."""
