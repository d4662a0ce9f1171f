"""A field takes on a painting's style: its colours change, its shape stays (Paper 2.1-2.2).

`views` repaints views of it by example, `fit` fits the colours to them, `optimize` refines by the
`losses` (Eq. 4, 5, 7, 9) on features of `networks`.
"""

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
