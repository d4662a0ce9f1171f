"""Gaussian splats of a field: laid on its surface, fitted to its views, written for other programs.

`placing` lays one on each visible surface point, `fitting` moves them until they look like the
field, `cloud` renders them, `frames` turns them as a file is to hold them, `formats` writes them.
"""

from .cloud import Splats, render_splats
from .field_splats import field_splats
from .formats import WRITERS as SPLAT_WRITERS
from .frames import framed, is_down

__all__ = ["SPLAT_WRITERS", "Splats", "field_splats", "framed",
           "is_down", "render_splats"]
