"""Data sets that know their cameras already: a reader for each format, and what tells them apart.

`detect` finds the format; `transforms` reads NeRF's, instant-ngp's and nerfstudio's, `colmap`
COLMAP's models, `programs` Metashape's, Bundler's and VisualSfM's files, `datasets` LLFF and NSVF.
All end in `assembly`.
"""

from .assembly import Views, assemble, held_out_views, with_mask
from .colmap import ColmapImage, lens_of, load_colmap, read_model
from .detect import is_calibrated, load_views
from .transforms import load_transforms, transform_files

__all__ = ["ColmapImage", "Views", "assemble", "held_out_views", "is_calibrated", "lens_of",
           "load_colmap", "load_transforms", "load_views", "read_model", "transform_files",
           "with_mask"]
