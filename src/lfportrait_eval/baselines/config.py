"""Parameters of the published methods, each above one base; what those of transfer hand back."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import tyro
from numpy.typing import NDArray

from lfportrait.arrays import Float32
from lfportrait.errors import UserError
from lfportrait.files import write_image


@dataclass(frozen=True)
class BaselineConfig:
    """A published method: something is optimised for a number of steps.

    Only what changes how long a method takes, or where its pictures come from, is a parameter; its
    weights and rates are constants beside its code, each with its source.
    """

    usual_steps: ClassVar[int] = 0
    """Steps where none are given."""
    steps: int | None = None
    """Steps of the optimisation: of whole views for ARF (by default 300) and Ref-NPR (180), of the
    decoder before the first fit for StylizedNeRF (120), alternations on each level for FaceStyle
    (4), training steps instead of seconds, which can be repeated, for the network."""

    @property
    def length(self) -> int:
        """Steps that are taken."""
        return self.usual_steps if self.steps is None else self.steps

    def check(self) -> None:
        """Raise `UserError` where parameters are out of range."""
        if self.length < 0:
            raise UserError(f"a method's steps must not be negative, but are {self.length}")


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


@dataclass(frozen=True)
class FaceBlitConfig:
    """FaceBlit as published, with its own weights and units (8-bit guides)."""

    background: bool = True
    """Paint the whole picture; otherwise only the face."""
    table: Literal["sweep", "exhaustive"] = "sweep"
    """exhaustive: search every window for every cell, as published; sweep: the same table,
    faster."""


@dataclass(frozen=True)
class FaceStyleConfig(BaselineConfig):
    """Guided patch synthesis after FaceStyle."""

    usual_steps = 4
    passes: int = 2
    """Passes of the search in each alternation, 1 to 6."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the random search."""


@dataclass(frozen=True)
class NetworkConfig(BaselineConfig):
    """Full-frame network of one style after Futschik et al. (2019)."""

    checkpoint: Path | None = None
    """File of the trained network: loaded if it exists, otherwise written after training."""
    photos: Path | None = None
    """Folder of training portraits; by default embedded heads and the photo itself."""
    teacher: Literal["facestyle", "styleblit"] = "facestyle"
    """Method that paints the training examples."""
    pairs: int = 24
    """Number of training examples (photos with small rotations and shifts); use hundreds for
    production."""
    budget: float = 240.0
    """Seconds of training without the teacher's time, if no steps are given."""
    size: int = 384
    """Longer side of the pictures that the network sees, in pixels."""
    width: int = 24
    """Channels of the first layer, 4 to 64."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of examples and weights."""
    device: tyro.conf.Suppress[str] = "auto"
    """Where the network computes, a choice of ``--device``."""


@dataclass
class Painted:
    """A picture stylised by a published method."""

    image: Float32  # float32 [H, W, 3] in [0, 1].
    # ``precalculation_seconds`` (once per style), ``guides_seconds`` and ``synthesis_seconds`` (per
    # picture).
    seconds: dict[str, float]
    # Intermediates by name, uint8 or float in [0, 1].
    pictures: dict[str, NDArray[Any]] = field(default_factory=dict, repr=False)

    def dump(self, folder: str | Path) -> None:
        """Write the result and every intermediate as a picture into ``folder``."""
        for name, picture in {**self.pictures, "result": self.image}.items():
            write_image(Path(folder) / f"{name}.png", picture)
