"""Parameters of the published methods that color a field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from lfportrait.errors import UserError

Network = Literal["auto", "vgg16", "vgg19-se", "embedded"]


@dataclass(frozen=True)
class ViewsConfig:
    """The views that a method works with."""

    size: int = 256
    """Longer side of the views in pixels."""
    views: int = 24
    """Photos of the capture that are used, evenly spread around the head."""

    def check(self) -> None:
        """Raise `UserError` where parameters are out of range.

        Views may be too small for the networks, or too few.
        """
        if self.size < 64:
            raise UserError("the size of a method's views must be at least 64 pixels, "
                            f"not {self.size}")
        if self.views < 1:
            raise UserError(f"a method needs at least one view, not {self.views}")


@dataclass(frozen=True)
class DescentConfig(ViewsConfig):
    """A fit, and steps down the losses of whole views, as ARF and Ref-NPR take."""

    method: ClassVar[str]
    """Before the options' names."""
    network: Network = "auto"
    """Features of the losses; auto: vgg16 if its weights are at hand, else embedded."""
    image_smoothness: float = 1.0
    """Weight of the total variation of the rendered view."""
    color_smoothness: float = 0.005
    """Weight of the total variation of the voxels' colors."""
    smoothed_share: float = 0.01
    """Share of the voxels that a step smooths."""

    def check(self) -> None:
        """Raise `UserError` where parameters are out of range."""
        super().check()
        if not 0.0 < self.smoothed_share <= 1.0:
            raise UserError(f"--{self.method}.smoothed-share must lie between 0 and 1, not at "
                            f"{self.smoothed_share:g}")


@dataclass(frozen=True)
class ArfConfig(DescentConfig):
    """ARF (Zhang et al. 2022): nearest-neighbour feature matching between two color transfers."""

    method = "arf"
    size: int = 384
    """Longer side of the views in pixels; the network sees them at half the size."""
    fit_iterations: int = 6
    """Iterations of the fit to the recolored photos, before the steps."""
    steps: int = 300
    """Steps of the losses, one whole view each."""
    learning_rate: float = 0.1
    """Step of RMSProp in units of the field's coefficients (0.28 of a color's)."""
    content_weight: float = 0.04
    """Weight of the content loss, on features with a mean square of 1; the original's 0.001 is for
    features that are about six times larger. The style loss has 1."""
    refit_iterations: int = 3
    """Iterations of the fit to the recolored renders, after the steps; the original has none."""


@dataclass(frozen=True)
class StylizedNerfConfig(ViewsConfig):
    """StylizedNeRF (Huang et al. 2022): a painting network and the field teach each other."""

    tune_steps: int = 120
    """Steps of the decoder before the field is fitted, one view each."""
    rounds: int = 3
    """How often the field is fitted to the painted views."""
    round_steps: int = 60
    """Steps of the decoder between two fits."""
    fit_iterations: int = 4
    """Iterations of each fit."""
    learning_rate: float = 0.00002
    """Adam's step for the decoder; at the published 0.0001 the small decoder draws stripes."""
    content_weight: float = 1.0
    """Weight of the decoder's content loss."""
    style_weight: float = 1.0
    """Weight of its style loss."""
    agreement_weight: float = 50.0
    """Weight of the agreement of neighbouring views, warped by the field's depth."""
    field_weight: float = 50.0
    """Weight of the agreement with what the field shows."""
    latent: int = 2
    """Length of a view's latent code; 0: none."""
    latent_weight: float = 0.0001
    """Weight of a code's squared length beside the mean squared error of its view."""

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

    method = "ref-npr"
    fit_iterations: int = 8
    """Iterations of the fit to the painted view and to what others see of it, before the steps."""
    steps: int = 180
    """Steps of the losses, one whole view and the painted one each."""
    learning_rate: float = 0.03
    """Step of RMSProp in units of the field's coefficients (0.28 of a color's); the original's 0.1
    leaves colored speckles where views are small."""
    painted_weight: float = 30.0
    """Weight of the squared error to the painted view, and of that to what others see of it; at the
    published 1 the steps leave the painting."""
    match_weight: float = 1.0
    """Weight of the painted features at the places whose photographed features match best."""
    color_weight: float = 15.0
    """Weight of the painted colors of coarse patches that match in the same way; the original has
    5, ReGS 15."""
    content_weight: float = 0.2
    """Weight of the content loss, on features with a mean square of 1; the original's 0.005 is for
    features that are about six times larger."""
