"""Columns, rows and aspect of quilts: in their names, beside them and inside them."""

from .files import layout_for, layout_of_file
from .layout import QuiltHint, QuiltLayout, quilt_part, warn_of_misfit

__all__ = ["QuiltHint", "QuiltLayout", "layout_for", "layout_of_file", "quilt_part",
           "warn_of_misfit"]
