"""Calibrated data sets of other programs: which format one is in, and a reader for each."""

from .assembly import Views, assemble, with_mask
from .colmap import ColmapImage, lens_of, load_colmap, read_model
from .detect import is_calibrated, load_views
from .transforms import load_transforms, transform_files

__all__ = ["ColmapImage", "Views", "assemble", "is_calibrated", "lens_of", "load_colmap",
           "load_transforms", "load_views", "read_model", "transform_files", "with_mask"]
