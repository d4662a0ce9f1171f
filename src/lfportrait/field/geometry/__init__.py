"""Geometry from photos before training: hulls, depth, solids.

`sweep` finds depth maps, `fused_depth` makes a solid of them, `mattes` follows its outlines and the
field's; `clean_plates` shows what is behind the person; `exposure` compares the photos' brightness;
`head_surface` begins with the usual proportions of a bust; `start` makes the first lattice.
"""

from .clean_plates import plate_mattes
from .head_surface import bust_chart, bust_distance
from .mattes import cut_out, trim

__all__ = ["bust_chart", "bust_distance", "cut_out", "plate_mattes", "trim"]
