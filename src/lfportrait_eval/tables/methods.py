"""The methods that are compared: those that color a field, and those that paint single views.

All get the same field, the same views and the same landmarks. What paints single views gets renders
of the real field with the landmarks projected into them, which no detector finds as exactly, and is
cut out by the field's opacity: what is compared is the paint, not the cutting.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal

from lfportrait.example import MethodConfig, TransferConfig
from lfportrait.plugins import offered
from lfportrait.stylize import StylizeConfig

from ..baselines.transfer import FaceBlitConfig, FaceStyleConfig, NetworkConfig

__all__ = ["FULL", "METHODS", "QUICK", "MethodEntry", "Sizes", "field_config", "own_parameters",
           "view_config"]


@dataclass(frozen=True)
class MethodEntry:
    """One method.

    Attributes
    ----------
    kind
        ``field``: colors a field; ``views``: paints each view by itself.
    what
        The method in a few words.
    """

    kind: Literal["field", "views"]
    what: str


_FIELDS = {
    "skin": "ours: painted once on the head's surface",
    "paper": "Shen et al. 2023: views painted one by one, then the losses",
    "surface": "as paper, with guides that are anchored to the surface",
    "arf": "Zhang et al. 2022: nearest-neighbour features, no example",
    "stylized-nerf": "Huang et al. 2022: a painting network and the field teach each other",
    "ref-npr": "Zhang et al. 2023: one painted view carried over the field",
}
_VIEWS = {
    "views": "our transfer, each view by itself, no field",
    "faceblit": "Texler et al. 2021, each view by itself",
    "facestyle": "after Fiser et al. 2017, each view by itself",
    "network": "after Futschik et al. 2019, trained for one style, each view by itself",
}


def _field_methods() -> dict[str, MethodEntry]:
    """What `stylize` can do, methods of any package, and the paper's way with other guides."""
    names = (*_FIELDS, *(name for name in offered("lfportrait.field_methods")
                         if name not in _FIELDS))
    return {name: MethodEntry("field", _FIELDS.get(name, "see docs/methods.md"))
            for name in names}


METHODS: dict[str, MethodEntry] = {
    **_field_methods(), **{name: MethodEntry("views", what) for name, what in _VIEWS.items()}}
"""All methods by name."""


def field_config(name: str, base: StylizeConfig, sizes: Sizes, seed: int) -> StylizeConfig:
    """Parameters of a method that colors a field."""
    config = replace(base, method={"surface": "paper"}.get(name, name), seed=seed)
    # Parameters of other methods do not count.
    config = replace(config, parameters=(
        () if config.other is None else (config.parameters_of(config.other),)))
    if config.method == "skin":
        return replace(config, pixels=sizes.pixels)
    if config.method != "paper":
        # Published methods keep their own sizes.
        return config
    return replace(config, guide="surface" if name == "surface" else "view",
                   size=sizes.painted_size, views=sizes.painted_views, steps=sizes.painted_steps)


def view_config(name: str, sizes: Sizes, seed: int) -> MethodConfig:
    """Parameters of a method that paints single views."""
    if name == "faceblit":
        return FaceBlitConfig()
    if name == "facestyle":
        return FaceStyleConfig(seed=seed)
    if name == "network":
        return NetworkConfig(budget=sizes.network_seconds, size=sizes.render_size,
                             pairs=sizes.network_pairs, seed=seed)
    return TransferConfig(seed=seed)


def own_parameters(name: str, config: StylizeConfig) -> dict[str, Any]:
    """Parameters that a method's result depends on: those of the skin count for it alone."""
    return {one.name: getattr(config, one.name) for one in fields(config)
            if one.name != "skin" or name == "skin"}


@dataclass(frozen=True)
class Sizes:
    """Sizes that a run is made of.

    Attributes
    ----------
    pixels
        Of the skin per world unit.
    render_size, close_size
        Width and height in pixels of the views on the arc, and of those that the head fills.
    painted_size, painted_views, painted_steps
        Of methods that paint views before they fit a field: width and height in pixels, views on
        each of three arcs, refinement steps.
    crops
        Of renders and of the exemplar, for the distances of features.
    network_pairs, network_seconds
        Training of the network that paints single views: its examples, and seconds.
    """

    pixels: float
    render_size: int
    close_size: int
    painted_size: int
    painted_views: int
    painted_steps: int
    crops: int
    network_pairs: int
    network_seconds: float


QUICK = Sizes(256.0, 256, 384, 384, 7, 20, 24, 6, 15.0)
"""About a minute a portrait and method."""
FULL = Sizes(384.0, 384, 768, 576, 15, 90, 48, 24, 240.0)
"""The methods' own sizes."""
