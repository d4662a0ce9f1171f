"""Extrapolate the light of the painted part to its surroundings."""

__all__ = ["BLUR", "CELL", "REACH"]

CELL = 0.03
"""Side of the cells that light is carried in, over the face's height."""
BLUR, REACH = 1.5, 12.0
"""Sigma of its blur, and how far it is carried, in cells."""
