"""Parameters of the published methods that color a field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from lfportrait.errors import UserError

from ..config import BaselineConfig

Network = Literal["auto", "vgg16", "vgg19-se", "embedded"]


@dataclass(frozen=True)
class ViewsConfig(BaselineConfig):
    """A method that fits a field to views and works with their pictures."""

    usual_size: ClassVar[int] = 256
    """Size where none is given."""
    usual_iterations: ClassVar[int] = 4
    """Iterations of the fit where none are given."""
    size: int | None = None
    """Longer side of the views in pixels; by default 256, and 384 for ARF, whose network sees them
    at half the size."""
    views: int = 24
    """Photos of the capture that are used, evenly spread around the head."""
    fit_iterations: int | None = None
    """Iterations of each fit; by default 6 for ARF, 8 for Ref-NPR (before the steps), and 4 for
    StylizedNeRF."""

    @property
    def pixels(self) -> int:
        """Longer side of the views."""
        return self.usual_size if self.size is None else self.size

    @property
    def iterations(self) -> int:
        """Iterations of each fit."""
        return self.usual_iterations if self.fit_iterations is None else self.fit_iterations

    def check(self) -> None:
        """Raise `UserError` where parameters are out of range.

        Views may be too small for the networks, or too few.
        """
        super().check()
        if self.pixels < 64:
            raise UserError("the size of a method's views must be at least 64 pixels, "
                            f"not {self.pixels}")
        if self.views < 1:
            raise UserError(f"a method needs at least one view, not {self.views}")


@dataclass(frozen=True)
class DescentConfig(ViewsConfig):
    """A fit, and steps down the losses of whole views, as ARF and Ref-NPR take."""

    network: Network = "auto"
    """Features of the losses; auto: vgg16 if its weights are at hand, else embedded."""


@dataclass(frozen=True)
class ArfConfig(DescentConfig):
    """ARF (Zhang et al. 2022): nearest-neighbour feature matching between two color transfers."""

    usual_size = 384
    usual_iterations = 6
    usual_steps = 300


@dataclass(frozen=True)
class StylizedNerfConfig(ViewsConfig):
    """StylizedNeRF (Huang et al. 2022): a painting network and the field teach each other."""

    usual_steps = 120
    rounds: int = 3
    """How often the field is fitted to the painted views; between two fits the decoder takes half
    as many steps as before the first."""
    latent: int = 2
    """Length of a view's latent code; 0: none."""

    def check(self) -> None:
        """Raise `UserError` where parameters are out of range."""
        super().check()
        if self.rounds < 1:
            raise UserError(f"--stylized-nerf.rounds must be at least 1, not {self.rounds}")
        if self.latent < 0:
            raise UserError(f"--stylized-nerf.latent must not be negative, but is {self.latent}")


@dataclass(frozen=True)
class RefNprConfig(DescentConfig):
    """Ref-NPR (Zhang et al. 2023): one painted view registered to the field."""

    usual_iterations = 8
    usual_steps = 180
