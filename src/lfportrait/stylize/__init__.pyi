from .config import StylizeConfig
from .methods import FieldMethod, FieldTask
from .mixing import MixConfig, StyledField, load_styled
from .networks import has_half_numbers, load_network
from .notices import PARTED, mouth_opening
from .on_skin import NearbyPainters, Painters, paint
from .optimize import stylize, stylize_with_figures
from .rehearsal import rehearse
from .skin_files import kept_skin
from .skin_fit import row_labels

__all__ = ["PARTED", "FieldMethod", "FieldTask", "MixConfig", "NearbyPainters", "Painters",
           "StyledField", "StylizeConfig", "has_half_numbers", "kept_skin", "load_network",
           "load_styled", "mouth_opening", "paint", "rehearse", "row_labels", "stylize",
           "stylize_with_figures"]
