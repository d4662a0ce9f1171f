"""Sizes of a run of the tables."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FULL", "QUICK", "Sizes"]


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
