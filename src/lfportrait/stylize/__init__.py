"""Optimising a field to a style: features, losses, colour fit (Shen et al. 2023, 2.1-2.2)."""

from typing import TYPE_CHECKING, Any

__all__ = ["StylizeConfig", "load_network", "stylize", "stylize_with_figures"]

if TYPE_CHECKING:
    from .networks import load_network
    from .optimize import StylizeConfig, stylize, stylize_with_figures


def __getattr__(name: str) -> Any:
    # torch takes seconds to import: only when something of this stage is used.
    if name in ("StylizeConfig", "stylize", "stylize_with_figures"):
        from . import optimize

        return getattr(optimize, name)
    if name == "load_network":
        from .networks import load_network

        return load_network
    raise AttributeError(name)
