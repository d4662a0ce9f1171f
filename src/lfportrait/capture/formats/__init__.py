"""Readers of calibrated data sets, one for each format, and the detection of the format.

A format is a class above `CaptureFormat`; `registry` lists them and finds the one of a folder.
`own` keeps captures of our own, `transforms` reads NeRF's, instant-ngp's and nerfstudio's, `colmap`
COLMAP's models, `programs` the files of Metashape, RealityCapture, Meshroom and their kin, `phones`
what Polycam and Record3D export, `datasets` LLFF and NSVF. All end in `assembly`; which way up a
picture is, `orientation` decides.
"""

from .assembly import DataSet, Shot, Views, assemble, held_out_views, mask_of, read_shots
from .capture_format import CaptureFormat
from .colmap import ColmapImage, lens_of, read_model
from .orientation import turned_upright
from .registry import capture_formats, find_views, is_calibrated, load_views, save_views

__all__ = ["CaptureFormat", "ColmapImage", "DataSet", "Shot", "Views", "assemble",
           "capture_formats", "find_views", "held_out_views", "is_calibrated", "lens_of",
           "load_views", "mask_of", "read_model", "read_shots", "save_views", "turned_upright"]
