"""Refinement of a field's colors by the losses (Shen et al. 2023, Eq. 4-7, 9), view by view.

The losses' weights are calibrated: at the paper's values, each term's gradient has a set share of
the norm of that of the fit to the examples. What does not change from step to step - features of
the real views, and of the examples - is computed once a view.

With it comes the paper's way to stylise a field (2.2), for comparisons: views on arcs are rendered,
each is painted by example, the field's colors are fitted to all of them, and refined. Views decide
independently which chunks to take, so the fit averages them: the skin (`skin`) is sharper.

`rehearse` takes every step of a stylisation on tiny data, to compile the kernels.
"""

import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from .. import models
from ..arrays import Float32
from ..capture import Capture
from ..device import TorchDevice, device_name, torch_device
from ..errors import UserError
from ..example import Exemplar, Painting, Skin, SurfaceGuide, Transfer, rehearse_painting
from ..field import VoxelField
from ..files import write_image
from ..measure import give_back_memory
from ..progress import Progress
from .config import StylizeConfig
from .fit import ColorModel, StyleView, prepare_view, style_cameras
from .kernels import adam_step
from .losses import (
    FeatureNetwork,
    content_loss,
    has_half_numbers,
    laplacian_loss,
    load_network,
    nearest_neighbour_loss,
    stacked,
)
from .skin import chart_views, look_up_rows, show_painting, surface_texture

Constants = dict[tuple[int, str], torch.Tensor]

_LARGE = 224  # Pixels from which on a picture is reduced for the content: the networks' own size.


class Refinement:
    """The losses' steps over the views.

    Parameters
    ----------
    model : The colors; changed in place.
    views : What they should show.
    config : Weights, networks, steps.
    constants : Content features of the real views, by view and network, which no step and no
        style changes: kept here for further refinements of the same views.
    device : Where the networks compute, a choice of ``--device``. The colors stay in the main
        memory: a step takes one render there and one gradient back.
    """

    def __init__(self, model: ColorModel, views: list[StyleView], config: StylizeConfig,
                 constants: Constants | None = None, device: str = "auto") -> None:
        self.constants: Constants = {} if constants is None else constants
        self.model, self.views, self.config = model, views, config
        self.scale: dict[str, float] = {}
        self.device = torch_device(device)

    def _load(self, device: TorchDevice) -> None:
        """Load the networks to a device; what was computed on another is forgotten."""
        self.device, place = device, device.place
        self._wanted: dict[int, torch.Tensor] = {}
        self.names, self.content, self.style = self.load(self.config, place)
        self.half = place == "cpu" and has_half_numbers() and self.names["style"] != "embedded"

    def _tensor(self, picture: Float32) -> torch.Tensor:
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
        shared = self.content is self.style  # its features serve both terms, at the full size
        known = id(view), f"{self.names['content']} on {self.device.place}"
        if known not in self.constants:
            with torch.no_grad():
                self.constants[known] = stacked(
                    self.content(content if shared else _reduced(content)))
        features = stacked(self.style(image))
        inside = _inside(view, features)
        if id(view) not in self._wanted:
            with torch.no_grad():
                self._wanted[id(view)] = stacked(self.style(wanted))[:, inside].T
        found = features if shared else stacked(self.content(_reduced(image)))
        inside_content = _inside(view, found)
        return {
            "style": nearest_neighbour_loss(features[:, inside].T, self._wanted[id(view)],
                                            half=self.half),
            "content": content_loss(found, self.constants[known], inside_content),
            "laplacian": laplacian_loss(
                image[0], wanted[0] if self.config.lap_reference == "example" else content[0]),
            "fit": (image - wanted).square().mean()}

    def _shares(self) -> dict[str, float]:
        """Wanted gradient norm of each term, relative to the anchor's."""
        config = self.config
        # 0.001, 0.005 and 10 are the paper's weights (Eq. 9): with them each term has the share
        # that stands before its weight.
        return {"fit": 1.0, "content": 0.1 * config.alpha / 0.001,
                "style": 0.5 * config.beta / 0.005, "laplacian": 0.5 * config.gamma / 10.0}

    @property
    def probe(self) -> StyleView:
        """The view by which terms are weighed, and losses are measured before and after."""
        return self.views[len(self.views) // 2]

    def _gradients(self, view: StyleView) -> tuple[dict[str, float], dict[str, torch.Tensor]]:
        """Losses of each term for the colors as they are, and their gradients by the image."""
        image = self._tensor(self.model.picture(view)).requires_grad_(True)
        losses, gradients = {}, {}
        terms = self._terms(view, image)
        for name, loss in terms.items():
            gradients[name], = torch.autograd.grad(loss, image, retain_graph=True)
            losses[name] = float(loss.detach())
        return losses, gradients

    def _calibrate(self) -> tuple[dict[str, Any], torch.Tensor]:
        """Scale each term so that its gradient has its share of the norm of a flat unit step.

        Returns figures, and the probe's gradient of all terms together: the first step's.
        """
        losses, gradients = self._gradients(self.probe)
        norms = {name: float(gradient.norm()) for name, gradient in gradients.items()}
        self.scale = {name: share / max(norms[name], 1e-12)
                      for name, share in self._shares().items() if name in norms}
        slope = torch.stack([self.scale[name] * one for name, one in gradients.items()]).sum(dim=0)
        return {"losses": losses, "gradient_norms": norms, "scales": dict(self.scale)}, slope

    def run(self, progress: Progress | None) -> dict[str, Any]:
        """Take the steps; returns losses before and after, and gradient norms before.

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
        self.constants.clear()
        self.model.colors[:] = colors
        if progress is not None:
            progress.update(done, "networks on the CPU")
        self._load(TorchDevice())
        return self._steps(progress)

    def _order(self) -> list[StyleView]:
        """The view of each step: the probe, the others at random, then all, again and again."""
        generator = np.random.Generator(np.random.Philox(key=[self.config.seed, 1]))
        first = len(self.views) // 2
        order = [first, *(one for one in generator.permutation(len(self.views)) if one != first)]
        while len(order) < self.config.refinements:
            order += list(generator.permutation(len(self.views)))
        return [self.views[one] for one in order[:self.config.refinements]]

    def _slope(self, view: StyleView) -> tuple[torch.Tensor, float]:
        """The gradient of all terms by a view's image, [1, 3, h, w], and the style's loss."""
        image = self._tensor(self.model.picture(view)).requires_grad_(True)
        terms = self._terms(view, image)
        # Eq. 9, with the fit to the painted views as a fourth term.
        loss = torch.stack([self.scale[name] * value for name, value in terms.items()]).sum()
        slope, = torch.autograd.grad(loss, image)
        return slope, float(terms["style"].detach())

    def _steps(self, progress: Progress | None) -> dict[str, Any]:
        config, model = self.config, self.model
        before, slope = self._calibrate()
        mean, square = np.zeros_like(model.colors), np.zeros_like(model.colors)
        gradient = np.zeros((3, len(model.colors)), np.float32)
        for step, view in enumerate(self._order()):
            if step == 0:  # it was measured just now
                style = before["losses"]["style"]
            else:
                slope, style = self._slope(view)
            picture = slope[0].permute(1, 2, 0).cpu().numpy() * view.trusted[..., None]
            del slope
            model.pulled_back(view, np.ascontiguousarray(picture), gradient)
            rate = config.rate * 0.1 ** (step / max(1, config.refinements))
            adam_step(model.colors, gradient, mean, square, np.float32(rate), step + 1)
            # The next view is of another size: this one's memory is in pieces that are too small.
            del picture
            give_back_memory()
            if progress is not None:
                progress.update(progress.done + 1, f"refine {step + 1} of {config.refinements}: "
                                f"style {style:.4f}")
        with torch.no_grad():
            after = self._terms(self.probe, self._tensor(model.picture(self.probe)))
        return {"networks": self.names, "device": device_name(self.device),
                "steps": config.refinements, "before": before,
                "after": {"losses": {name: float(loss) for name, loss in after.items()}}}


def _failing(error: RuntimeError) -> str:
    """Why a GPU can't go on, in words; empty for errors of other kinds."""
    if "out of memory" in str(error).lower() or type(error).__name__ == "OutOfMemoryError":
        return "has too little memory"
    # Versions before 2.8 raise what can't be distinguished from other errors.
    return "was lost" if type(error).__name__ == "AcceleratorError" else ""


def _reduced(picture: torch.Tensor) -> torch.Tensor:
    """What the content is compared in: a large picture [1, 3, h, w] at half its size, for speed."""
    return torch.nn.functional.avg_pool2d(picture, 2) if min(picture.shape[-2:]) >= _LARGE else (
        picture)


def _inside(view: StyleView, features: torch.Tensor) -> torch.Tensor:
    """Places of a feature map [C, h, w] that show the head, bool [h, w]."""
    share = torch.nn.functional.interpolate(torch.from_numpy(view.alpha)[None, None],
                                            size=features.shape[-2:], mode="area")
    return (share[0, 0] > 0.3).to(features.device)


def stylize_views(field: VoxelField, capture: Capture, exemplar: Exemplar, config: StylizeConfig,
                  progress: Progress | None, dump: Path | None, device: str = "auto",
                  ) -> tuple[Float32, dict[str, Any]]:
    """Colors of a field's rows, float32 [N, 3], by painted views, and figures.

    The networks of the refinement compute on ``device``.
    """
    start = time.perf_counter()
    views, transfer_seconds = _prepare(field, capture, exemplar, config, progress, dump)
    prepared = time.perf_counter()
    model = ColorModel(field, config.background)
    errors = model.fit(views, config.iterations, progress)
    fitted = time.perf_counter()
    figures: dict[str, Any] = {"views": len(views), "transfer": transfer_seconds,
                               "fit": {"rmse": [round(float(np.sqrt(e)), 5) for e in errors]}}
    if config.refinements > 0:
        figures["refinement"] = Refinement(model, views, config, device=device).run(progress)
    refined = time.perf_counter()
    figures["unseen_share"] = round(model.fill_unseen(), 4)
    figures["seconds"] = {"views": round(prepared - start, 3), "fit": round(fitted - prepared, 3),
                          "refine": round(refined - fitted, 3)}
    if dump is not None:
        for index, view in enumerate(views[::3]):
            write_image(dump / f"view_{index:02d}.png", np.concatenate(
                [view.content, view.example, model.picture(view)], axis=1))
    return model.colors, figures


def _prepare(field: VoxelField, capture: Capture, exemplar: Exemplar, config: StylizeConfig,
             progress: Progress | None, dump: Path | None,
             ) -> tuple[list[StyleView], dict[str, float]]:
    """Render and transfer all views."""
    cameras = style_cameras(field, config.size, config.arc, config.views, config.pitches)
    # By landmarks alone, as published.
    transfer = Transfer(exemplar, replace(config.transfer, seed=config.seed, aside=90.0))
    guide = None
    if config.guide == "surface":
        assert capture.landmarks is not None
        guide = SurfaceGuide(capture.landmarks, exemplar, transfer.regions)
    views: list[StyleView] = []
    seconds = {"table_seconds": 0.0, "guides_seconds": 0.0, "synthesis_seconds": 0.0}
    total = len(cameras) + config.refinements
    for index in range(len(cameras)):
        view = prepare_view(field, cameras, index, transfer, guide, capture.landmarks,
                            config.background)
        if view is not None:
            if view.result is not None:
                for name in ("guides_seconds", "synthesis_seconds"):
                    seconds[name] += view.result.seconds[name]
                seconds["table_seconds"] = view.result.seconds["table_seconds"]
                if dump is not None and index % 3 == 0:
                    view.result.dump(dump / f"transfer_{index // 3:02d}")
                view.result = None
            views.append(view)
        if progress is not None:
            progress.total = total
            progress.update(index + 1, f"transfer by example: view {index + 1} of {len(cameras)}")
    if not views:
        raise UserError("the field is empty: no view shows anything to stylise")
    return views, {name: round(value, 3) for name, value in seconds.items()}


def rehearse(field: VoxelField, capture: Capture) -> None:
    """Run through a stylisation on the skin of a tiny capture, the painting of the face left out.

    The face's kernels are those of the transfer, which can be compiled at the same time elsewhere.
    """
    assert capture.landmarks is not None
    skin = Skin.of(field, capture.landmarks, capture.cameras, pixels=64.0, networks=False)
    rehearse_painting(skin)
    painting = Painting(skin, np.ascontiguousarray(skin.atlas.color), 1, {})
    model, views = ColorModel(field, 1.0), chart_views(field, skin, 1.0)
    look_up_rows(model, painting)
    show_painting(views, painting, 1.0)
    model.fit(views, 1)
    shown = model.shown(field)
    replace(shown, texture=surface_texture(shown, painting)).render(capture.cameras, 0)
    Refinement(model, views, StylizeConfig(
        steps=1, content_network="embedded", style_network="embedded"),
        device="cpu").run(None)
