"""The shaders: their texts, and what each entry point is bound to."""

from __future__ import annotations

import functools
from importlib import resources

import numpy as np

__all__ = ["BINDINGS", "STEP", "source"]

BINDINGS: dict[str, tuple[str, tuple[str, ...]]] = {
    "march": ("march", ("step", "bricks", "density", "cameras", "inputs", "packets", "blocks",
                        "samples")),
    "points": ("points", ("step", "bricks", "packets", "blocks", "samples", "corners", "records")),
    "color": ("color", ("step", "rows", "records", "packets", "blocks", "values", "page")),
    "blend": ("blend", ("step", "packets", "blocks", "samples", "corners", "values")),
    "composite": ("composite", ("step", "packets", "blocks", "samples", "sides", "cameras",
                                "inputs", "errors", "grounds")),
    "gather": ("gather", ("step", "packets", "blocks", "samples", "sides", "records", "values",
                          "heads")),
    "settle": ("settle", ("step", "density", "states", "heads", "records", "values", "lines",
                          "blocks")),
    "paint": ("paint", ("step", "rows", "records", "values", "lines", "packets", "blocks",
                        "page")),
    "vary": ("variation", ("step", "density", "", "after", "before", "slopes", "blocks")),
    "smooth_run": ("variation", ("step", "density", "states", "", "", "slopes", "blocks")),
    "vary_colors": ("colors", ("step", "rows", "rows_before", "rows_behind", "after", "before",
                               "color_slopes", "blocks", "page")),
    "smooth_colors": ("colors", ("step", "", "", "", "", "", "color_slopes", "blocks", "page",
                                 "rows", "states")),
    "shells_forward": ("shells", ("step", "packets", "blocks", "map", "spheres", "grounds")),
    "shells_backward": ("shells", ("step", "packets", "blocks", "map", "spheres", "grounds",
                                   "shell_sums")),
    "shells_step": ("shells", ("step", "", "blocks", "", "spheres", "", "shell_sums",
                               "shell_squares")),
    "largest": ("largest", ("step", "bricks", "packets", "blocks", "samples", "most")),
    "next_band": ("largest", ("", "", "", "blocks")),
    "bright": ("table", ("step", "bricks", "density", "whole", "near", "", "blocks")),
    "along_x": ("table", ("step", "", "", "", "near", "nearer", "blocks")),
    "along_y": ("table", ("step", "", "", "", "near", "nearer", "blocks")),
    "along_z": ("table", ("step", "bricks", "", "whole", "near", "nearer", "blocks")),
    "add": ("sums", ("", "given", "sums", "blocks")),
}
"""Of each entry point: its file, and the names of its bindings in their order ("": none)."""

STEP = np.dtype([
    ("size", "<u4", 3), ("tiles", "<u4"), ("bricks", "<u4", 3), ("links", "<u4"),
    ("pace", "<f4"), ("threshold", "<f4"), ("stop", "<f4"), ("near", "<f4"),
    ("alpha_weight", "<f4"), ("sparsity", "<f4"), ("narrow", "<f4"), ("share", "<f4"),
    ("rate", "<f4"), ("decay", "<f4"), ("lowest", "<f4"), ("memory", "<f4"),
    ("tv_weight", "<f4"), ("tv_scale", "<f4"), ("tv_first", "<u4"), ("tv_last", "<u4"),
    ("input", "<u4"), ("output", "<u4"), ("packet", "<u4"), ("empty", "<u4"),
    ("block_room", "<u4"), ("record_room", "<u4"), ("workers", "<u4"), ("basis", "<u4"),
    ("row", "<u4"), ("gain", "<f4"), ("layers", "<u4"), ("tv_color", "<f4"), ("high", "<u4"),
    ("grey", "<f4"), ("rate_shell", "<f4"), ("rate_shell_density", "<f4"), ("", "V96")])
"""The uniform ``Step`` of ``common.wgsl``, in slots of 256 bytes."""


@functools.cache
def source(file: str) -> str:
    """The text of a shader, with what all have in common."""
    folder = resources.files(__package__)
    return "\n".join((folder / f"{name}.wgsl").read_text(encoding="utf-8")
                     for name in ("common", file))
