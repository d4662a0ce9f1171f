"""Geometry from photos before training: hulls, depth, solids.

`hull` carves by mattes, `sweep` finds depth maps, `fused_depth` and `cutout` make a solid of them
and mattes of that; `clean_plates` shows what is behind the person; `exposure` compares the photos'
brightness; `start` makes the first lattice; `bust` has the usual proportions.
"""

from .bust import bust_chart, bust_distance
from .clean_plates import plate_mattes
from .cutout import cut_out, trim

__all__ = ["bust_chart", "bust_distance", "cut_out", "plate_mattes", "trim"]
