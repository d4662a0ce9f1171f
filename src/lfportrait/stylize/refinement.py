"""Refinement of a field's colors by the losses (Shen et al. 2023, Eq. 4-7, 9), view by view.

The losses' weights are calibrated: at the paper's values, each term's gradient has a set share of
the norm of that of the fit to the examples. What does not change from step to step - features of
the real views, and of the examples - is computed once a view.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from .. import models
from ..device import TorchDevice, device_name, torch_device
from ..progress import Progress
from .config import StylizeConfig
from .fit import ColorModel
from .kernels.linear import adam_step
from .losses import content_loss, laplacian_loss, nearest_neighbour_loss, stacked
from .networks import FeatureNetwork, has_half_numbers, load_network
from .views import StyleView

__all__ = ["Constants", "Refinement"]


_LARGE = 224
"""Pixels from which on a picture is reduced for the content: the networks' own size."""


class Refinement:
    """The losses' steps over the views.

    Parameters
    ----------
    model
        The colors; changed in place.
    views
        What they should show.
    config
        Weights, networks, steps.
    constants
        Content features by view of an earlier refinement of the same views (`Constants`).
    device
        Where the networks compute, a choice of ``--device``. The colors stay in the main memory: a
        step takes one render there and one gradient back.
    """

    def __init__(self, model: ColorModel, views: list[StyleView], config: StylizeConfig,
                 constants: Constants | None = None, device: str = "auto") -> None:
        self.constants = constants if constants is not None else Constants()
        self.model, self.views, self.config = model, views, config
        self.scale: dict[str, float] = {}
        self.device = torch_device(device)

    def _load(self, device: TorchDevice) -> None:
        """Load the networks to a device; what was computed on another is forgotten."""
        self.device, place = device, device.place
        self._wanted: dict[int, torch.Tensor] = {}
        self.names, self.content, self.style = self.load(self.config, place)
        self.half = place == "cpu" and has_half_numbers() and self.names["style"] != "embedded"

    def _tensor(self, picture: NDArray[np.float32]) -> torch.Tensor:
        """A picture [h, w, 3] as the networks take it, [1, 3, h, w], on their device."""
        return torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1)))[None].to(
            self.device.place)

    @staticmethod
    def load(config: StylizeConfig, place: str = "cpu",
             ) -> tuple[dict[str, str], FeatureNetwork, FeatureNetwork]:
        """Names of the networks by term, that of the content and that of the style; kept.

        ``place`` is torch's name of where they compute.
        """
        asked = {"content": (config.content_network, "vgg16"),
                 "style": (config.style_network, "resnet50")}
        names = {term: ((paper if models.available(paper) else "embedded")
                        if chosen == "auto" else chosen)
                 for term, (chosen, paper) in asked.items()}
        content, style = (load_network(names[term], True, place) for term in asked)
        return names, content, style

    def _terms(self, view: StyleView, image: torch.Tensor) -> dict[str, torch.Tensor]:
        """The losses of one render [1, 3, h, w]."""
        wanted, content = self._tensor(view.example), self._tensor(view.content)
        content_features = self.constants.content(
            view, f"{self.names['content']} on {self.device.place}",
            lambda: stacked(self.content(_reduced(content))))
        features = stacked(self.style(image))
        inside = _inside(view, features)
        if id(view) not in self._wanted:
            with torch.no_grad():
                self._wanted[id(view)] = stacked(self.style(wanted))[:, inside].T
        found = stacked(self.content(_reduced(image)))
        inside_content = _inside(view, found)
        return {
            "style": nearest_neighbour_loss(features[:, inside].T, self._wanted[id(view)],
                                            half=self.half),
            "content": content_loss(found, content_features, inside_content),
            "laplacian": laplacian_loss(
                image[0], wanted[0] if self.config.lap_reference == "example" else content[0],
                pool=self.config.lap_pool),
            "fit": (image - wanted).square().mean()}

    def _shares(self) -> dict[str, float]:
        """Wanted gradient norm of each term, relative to the anchor's."""
        config = self.config
        # 0.001, 0.005 and 10 are the paper's weights (Eq. 9): with them each term has the share
        # that stands before its weight.
        return {"fit": 1.0, "content": 0.1 * config.alpha / 0.001,
                "style": 0.5 * config.beta / 0.005, "laplacian": 0.5 * config.gamma / 10.0}

    def _gradients(self, view: StyleView) -> tuple[dict[str, float], dict[str, float],
                                                   dict[str, torch.Tensor]]:
        """Losses, gradient norms and image gradients of each term for the colors as they are."""
        image = self._tensor(self.model.picture(view)).requires_grad_(True)
        losses, norms, gradients = {}, {}, {}
        terms = self._terms(view, image)
        for name, loss in terms.items():
            gradient, = torch.autograd.grad(loss, image, retain_graph=True)
            losses[name], gradients[name] = float(loss.detach()), gradient
            norms[name] = float(gradient.norm())
        return losses, norms, gradients

    def _calibrate(self) -> dict[str, Any]:
        """Scale each term so that its gradient has its share of the norm of a flat unit step."""
        probe = self.views[len(self.views) // 2]
        losses, norms, _ = self._gradients(probe)
        self.scale = {name: share / max(norms[name], 1e-12)
                      for name, share in self._shares().items() if name in norms}
        return {"losses": losses, "gradient_norms": norms, "scales": dict(self.scale)}

    def run(self, progress: Progress | None) -> dict[str, Any]:
        """Take the steps; returns losses and gradient norms before and after.

        Where a GPU is lost, or its memory is too small, all of them are taken on the CPU.
        """
        colors, done = self.model.colors.copy(), 0 if progress is None else progress.done
        try:
            self._load(self.device)
            return self._steps(progress)
        except RuntimeError as error:
            why = _failing(error)
            if self.device.place == "cpu" or not why:
                raise
            warnings.warn(f"{self.device.name} {why}: the networks compute on the CPU",
                          stacklevel=2)
        self.constants.forget()
        self.model.colors[:] = colors
        if progress is not None:
            progress.update(done, "networks on the CPU")
        self._load(TorchDevice())
        return self._steps(progress)

    def _steps(self, progress: Progress | None) -> dict[str, Any]:
        config, model = self.config, self.model
        before = self._calibrate()
        mean, square = np.zeros_like(model.colors), np.zeros_like(model.colors)
        gradient = np.zeros((3, len(model.colors)), np.float32)
        generator = np.random.Generator(np.random.Philox(key=[config.seed, 1]))
        order: list[int] = []
        losses: dict[str, float] = {}
        for step in range(config.refinements):
            if not order:
                order = list(generator.permutation(len(self.views)))
            view = self.views[order.pop()]
            image = self._tensor(model.picture(view)).requires_grad_(True)
            terms = self._terms(view, image)
            # Eq. 9, with the fit to the painted views as a fourth term.
            loss = torch.stack([self.scale[name] * value for name, value in terms.items()]).sum()
            slope, = torch.autograd.grad(loss, image)
            picture = slope[0].permute(1, 2, 0).cpu().numpy() * view.trusted[..., None]
            model.pulled_back(view, np.ascontiguousarray(picture), gradient)
            losses = {name: float(value.detach()) for name, value in terms.items()}
            rate = config.rate * 0.1 ** (step / max(1, config.refinements))
            adam_step(model.colors, gradient, mean, square, np.float32(rate), step + 1)
            if progress is not None:
                progress.update(progress.done + 1, f"refine {step + 1} of {config.refinements}: "
                                f"style {losses['style']:.4f}")
        return {"networks": self.names, "device": device_name(self.device),
                "steps": config.refinements, "before": before, "after": {"losses": losses}}


def _failing(error: RuntimeError) -> str:
    """Why a GPU can't go on, in words; empty for errors of other kinds."""
    if "out of memory" in str(error).lower() or type(error).__name__ == "OutOfMemoryError":
        return "has too little memory"
    # Versions before 2.8 raise what can't be told from other errors.
    return "was lost" if type(error).__name__ == "AcceleratorError" else ""


class Constants:
    """Features that no step and no style changes: those of the real views."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, str], torch.Tensor] = {}

    def forget(self) -> None:
        """Give back their memory."""
        self._known.clear()

    def content(self, view: StyleView, network: str,
                compute: Callable[[], torch.Tensor]) -> torch.Tensor:
        """Content features of a view by a network on a device, computed when first asked for."""
        key = id(view), network
        if key not in self._known:
            with torch.no_grad():
                self._known[key] = compute()
        return self._known[key]


def _reduced(picture: torch.Tensor) -> torch.Tensor:
    """What the content is compared in: a picture [1, 3, h, w] at half its size, if it is large.

    The content is where things are, and the network that finds it takes half of a step.
    """
    return torch.nn.functional.avg_pool2d(picture, 2) if min(picture.shape[-2:]) >= _LARGE else (
        picture)


def _inside(view: StyleView, features: torch.Tensor) -> torch.Tensor:
    """Places of a feature map [C, h, w] that show the head, bool [h, w]."""
    share = torch.nn.functional.interpolate(torch.from_numpy(view.alpha)[None, None],
                                            size=features.shape[-2:], mode="area")
    return (share[0, 0] > 0.3).to(features.device)
