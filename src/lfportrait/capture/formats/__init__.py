"""Readers of calibrated data sets, one for each format, and the detection of the format.

`detect` finds the format; `transforms` reads NeRF's, instant-ngp's and nerfstudio's, `colmap`
COLMAP's models, `programs` the files of Metashape, RealityCapture, Meshroom and their kin, `phones`
what Polycam and Record3D export, `datasets` LLFF and NSVF. All end in `assembly`; which way up a
picture is, `orientation` decides.
"""

from .assembly import DataSet, Shot, Views, assemble, held_out_views, mask_of, read_shots
from .colmap import ColmapImage, lens_of, read_model
from .detect import find_views, is_calibrated, load_views
from .orientation import turned_upright
from .transforms import transform_files

__all__ = ["ColmapImage", "DataSet", "Shot", "Views", "assemble", "find_views", "held_out_views",
           "is_calibrated", "lens_of", "load_views", "mask_of", "read_model", "read_shots",
           "transform_files", "turned_upright"]
