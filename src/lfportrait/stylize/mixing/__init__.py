"""Change the strength and style of a stylised field, also per region, without training.

`styled_field` holds the colors of the photo and of the paintings and mixes them, `tones` are
the curves and color differences of a mix, `options` its command line.
"""

from .options import MixConfig
from .styled_field import StyledField, load_styled

__all__ = ["MixConfig", "StyledField", "load_styled"]
