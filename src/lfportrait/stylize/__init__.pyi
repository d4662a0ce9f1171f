from .config import FieldMethod, FieldTask, StylizeConfig
from .losses import has_half_numbers, load_network
from .mixing import MixConfig, StyledField, load_styled
from .refinement import rehearse
from .skin import kept_skin, row_labels
from .stylization import PARTED, NearbyPainters, Painters, paint, stylize, stylize_with_figures

__all__ = ["PARTED", "FieldMethod", "FieldTask", "MixConfig", "NearbyPainters", "Painters",
           "StyledField", "StylizeConfig", "has_half_numbers", "kept_skin", "load_network",
           "load_styled", "paint", "rehearse", "row_labels", "stylize",
           "stylize_with_figures"]
