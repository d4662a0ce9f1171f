"""Optimising a field to a style: features, losses, colour fit (Shen et al. 2023, 2.1-2.2)."""

from typing import TYPE_CHECKING

from ..lazy import attach

if TYPE_CHECKING:
    from .networks import load_network
    from .optimize import StylizeConfig, stylize, stylize_with_figures

__all__ = ["StylizeConfig", "load_network", "stylize", "stylize_with_figures"]

__getattr__, __dir__ = attach(__name__, __file__)
