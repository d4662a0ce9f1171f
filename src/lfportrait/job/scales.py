"""How large the demo's job is: in full, and quick."""

from __future__ import annotations

from typing import NamedTuple

from ..field import ReconstructConfig
from ..stylize import StylizeConfig
from .steps import MakeConfig

__all__ = ["FULL", "QUICK", "Scale"]


class Scale(NamedTuple):
    """How large the demo is."""

    size: int
    """Width and height of the capture's pictures in pixels."""
    views: int
    """Number of cameras."""
    exemplar: int
    """Height of the painting in pixels; it is three quarters as wide."""
    display: str
    """Preset of the display."""
    config: MakeConfig
    """Parameters of the stages, with the embedded networks."""


FULL = Scale(384, 60, 1024, "generic-4k", MakeConfig(
    reconstruct=ReconstructConfig(resolutions=(64, 128, 256), rays=(0.5, 2.5, 6.0)),
    stylize=StylizeConfig(content_network="embedded", style_network="embedded")))
QUICK = Scale(256, 32, 768, "generic-1080p", MakeConfig(
    reconstruct=ReconstructConfig(resolutions=(80, 160), rays=(0.4, 1.4)),
    stylize=StylizeConfig(pixels=256.0, steps=7, content_network="embedded",
                          style_network="embedded"),
    sweep_size=384))
