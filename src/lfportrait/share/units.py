"""How large a head is in files whose unit is the metre."""

__all__ = ["METRES"]

METRES = 0.1
"""Of a unit of the portrait frame: a head, which lies within -1 to 1, is 20 cm high."""
