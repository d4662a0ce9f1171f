"""Readers of calibrated data sets, one for each format, and the detection of the format.

A format is a class above `CaptureFormat`; `registry` lists them and finds the one of a folder.
`transforms` reads NeRF's, instant-ngp's and nerfstudio's, and keeps captures of our own; `colmap`
reads COLMAP's models, `programs` the files of Metashape, RealityCapture, Meshroom and their kin (by
`placed`), `datasets` LLFF, NSVF, and what Polycam and Record3D export. All end in `assembly`, which
also decides which way up a picture is.
"""

from .assembly import (
    CaptureFormat,
    DataSet,
    Shot,
    Views,
    assemble,
    held_out_views,
    mask_of,
    read_shots,
    turned_upright,
)
from .colmap import ColmapImage, lens_of, read_model
from .registry import capture_formats, find_views, is_calibrated, load_views, save_views

__all__ = ["CaptureFormat", "ColmapImage", "DataSet", "Shot", "Views", "assemble",
           "capture_formats", "find_views", "held_out_views", "is_calibrated", "lens_of",
           "load_views", "mask_of", "read_model", "read_shots", "save_views", "turned_upright"]
