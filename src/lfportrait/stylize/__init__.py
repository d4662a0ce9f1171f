"""Optimising a field to a style: features, losses, color fit (Shen et al. 2023, 2.1-2.2).

A `StyledField` keeps the colors of the photo and of the paintings: `mixing` turns them up and down
without training.
"""

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ..lazy import attach

if TYPE_CHECKING:
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

__getattr__, __dir__ = attach(__name__, __file__)


class _Stage(ModuleType):
    """The package, which can be called as its function: in ``lf.stylize(...)`` it stands for it.

    Python puts an imported package over a function of its name in the package above.
    """

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return self.stylize(*arguments, **options)


sys.modules[__name__].__class__ = _Stage
