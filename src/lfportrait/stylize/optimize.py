"""Stylising a field: its density frozen, its colours fitted to the example and refined by losses.

(a) Views on an arc in front of the head are rendered from the real field (I_c) and transferred by
example (I_e), with guides and chunks anchored to the surface, so that all views paint the same
stroke in the same place. (b) The colours are fitted to all I_e at once (`fit`). (c) View by view,
the losses of Shen et al. 2023 (Eq. 9) pull the render I_r: content, VGG features of I_r against
I_c; style, nearest-neighbour features of I_r in I_e (Eq. 4, 5); Laplacian, contours of I_r against
I_e or I_c. The image's gradient comes from the networks, the colours' from the view's transposed
weights: memory does not grow with the field (deferred back-propagation, Zhang et al. 2022).

The printed weights (0.001, 0.005, 10) fit no reading of the losses' reductions: the terms would
differ by orders of magnitude. Here each term's gradient is measured once and scaled to its share,
and the paper's numbers act relative to their printed values.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import tyro
from numpy.typing import NDArray

from .. import models
from ..capture import Capture
from ..device import computing_device
from ..errors import UserError
from ..example import Exemplar, SurfaceGuide, Transfer, TransferConfig
from ..field import VoxelField
from ..files import write_image
from ..progress import Progress
from .fit import ColorModel
from .kernels.linear import adam_step
from .losses import content_loss, laplacian_loss, nearest_neighbour_loss, stacked
from .networks import FeatureNetwork, load_network
from .views import StyleView, prepare_view, style_cameras

__all__ = ["StylizeConfig", "stylize", "stylize_with_figures"]

Network = Literal["auto", "vgg16", "resnet50", "vgg19-se", "embedded"]


@dataclass(frozen=True)
class StylizeConfig:
    """Parameters of the stylisation."""

    method: Literal["paper", "arf"] = "paper"
    """paper: example-based transfer, then the losses; arf: nearest-neighbour features alone."""
    guide: Literal["surface", "view"] = "surface"
    """surface: guides anchored to the head in 3D; view: from the landmarks in each view (paper)."""
    size: int = 576
    """Width and height of the stylised views in pixels."""
    arc: float = 75.0
    """Half angle of the arc of views in degrees."""
    views: int = 15
    """Views on each arc."""
    pitches: tuple[float, ...] = (-12.0, 8.0, 28.0)
    """Height of the arcs in degrees above the horizon."""
    fit_iterations: int = 12
    """Iterations of the least-squares fit to the example pictures."""
    steps: int = 90
    """Refinement steps, one view each; 0 leaves the fit."""
    learning_rate: float = 0.02
    """Adam's step in colour units at the start; it falls to a tenth."""
    content_network: Network = "auto"
    """Features of the content loss; auto: vgg16 if its weights are at hand, else embedded."""
    style_network: Network = "auto"
    """Features of the style loss; auto: resnet50 if its weights are at hand, else embedded."""
    alpha: float = 0.001
    """Weight of the content loss; at the paper's 0.001 its gradient is 0.1 of the fit's."""
    beta: float = 0.005
    """Weight of the style loss; at the paper's 0.005 its gradient is 0.5 of the fit's."""
    gamma: float = 10.0
    """Weight of the Laplacian loss; at the paper's 10 its gradient is 0.5 of the fit's."""
    lap_reference: Literal["example", "content"] = "example"
    """Contours kept: of the example (brush work) or of the photo (the paper's words)."""
    lap_pool: int = 1
    """Average pooling before the Laplacian, 1 to 16 pixels."""
    strength: float = 1.0
    """0 leaves the real colours, 1 gives the style."""
    background: float = 1.0
    """Grey level behind the head while stylising."""
    transfer: TransferConfig = field(default_factory=TransferConfig)
    """Example-based transfer."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the order of the views and of the chunks."""


def stylize(field: VoxelField, capture: Capture, exemplar: Exemplar,
            config: StylizeConfig | None = None, progress: Progress | None = None,
            device: str = "auto", dump: Path | None = None) -> VoxelField:
    """Give a field the manner of an exemplar: `stylize_with_figures`' field alone."""
    return stylize_with_figures(field, capture, exemplar, config, progress, device, dump)[0]


def stylize_with_figures(field: VoxelField, capture: Capture, exemplar: Exemplar,
                         config: StylizeConfig | None = None, progress: Progress | None = None,
                         device: str = "auto", dump: Path | None = None,
                         ) -> tuple[VoxelField, dict[str, Any]]:
    """Give a field the manner of an exemplar.

    Parameters
    ----------
    field
        The real radiance field.
    capture
        Its capture: the landmarks in space.
    exemplar
        The painting with its landmarks.
    config
        Parameters.
    progress
        Progress line.
    device
        Where to compute: ``"auto"`` or ``"cpu"`` (`lfportrait.device.computing_device`).
    dump
        Folder for pictures of every third view and its guides; None writes none.

    Returns
    -------
    styled, figures
        A field with the same density and direction-independent colours, and the figures for
        ``--json``: per-term losses and gradient norms, networks, ``seconds``.

    Raises
    ------
    UserError
        If the capture has no landmarks or the networks' weights are missing.
    """
    config = config or StylizeConfig()
    if capture.landmarks is None and config.method == "paper":
        raise UserError("the capture has no facial landmarks; run `lfportrait calibrate` on the "
                        "photos, or use --method arf")
    computes_on = computing_device(device)
    start = time.perf_counter()
    views, transfer_seconds = _prepare(field, capture, exemplar, config, progress, dump)
    prepared = time.perf_counter()
    model = ColorModel(field, config.background)
    errors = model.fit(views, config.fit_iterations, progress) if config.method == "paper" else []
    if config.method == "arf":
        _match_palette(model, views, exemplar)
    fitted = time.perf_counter()
    figures: dict[str, Any] = {
        "method": config.method, "views": len(views), "device": computes_on,
        "fit": {"rmse": [round(float(np.sqrt(e)), 5) for e in errors]},
        "transfer": transfer_seconds}
    if config.steps > 0:
        refinement = _Refinement(model, views, exemplar, config)
        figures["refinement"] = refinement.run(progress)
    refined = time.perf_counter()
    figures["unseen_share"] = round(model.fill_unseen(), 4)
    styled = field.with_sh(model.coefficients(field, config.strength))
    figures["seconds"] = {"views": round(prepared - start, 3), "fit": round(fitted - prepared, 3),
                          "refine": round(refined - fitted, 3),
                          "total": round(time.perf_counter() - start, 3)}
    if dump is not None:
        for index, view in enumerate(views[::3]):
            write_image(dump / f"view_{index:02d}.png", np.concatenate(
                [view.content, view.example, model.picture(view)], axis=1))
    return styled, figures


def _prepare(field: VoxelField, capture: Capture, exemplar: Exemplar, config: StylizeConfig,
             progress: Progress | None, dump: Path | None,
             ) -> tuple[list[StyleView], dict[str, float]]:
    """Render and transfer all views."""
    from dataclasses import replace

    cameras = style_cameras(field, config.size, config.arc, config.views, config.pitches)
    transfer, guide = None, None
    if config.method == "paper":
        transfer = Transfer(exemplar, replace(config.transfer, seed=config.seed))
        if config.guide == "surface":
            assert capture.landmarks is not None
            guide = SurfaceGuide(capture.landmarks, exemplar, transfer.regions)
    views: list[StyleView] = []
    seconds = {"table_seconds": 0.0, "guides_seconds": 0.0, "synthesis_seconds": 0.0}
    total = len(cameras) + config.steps
    for index in range(len(cameras)):
        view = prepare_view(field, cameras, index, transfer, guide, capture.landmarks,
                            config.background, keep=True)
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


def _match_palette(model: ColorModel, views: list[StyleView], exemplar: Exemplar) -> None:
    """Colours moved so that mean and covariance are the exemplar's (ARF's colour transfer)."""
    for view in views:
        model.pulled_back(view, np.repeat(view.alpha[..., None], 3, 2), seen := np.zeros(
            (3, len(model.colors)), np.float32))
        model.seen += seen[0]
    known = model.seen > 1e-2
    source = model.colors[known].astype(np.float64)
    target = exemplar.image.reshape(-1, 3).astype(np.float64) / 255.0

    def root(pixels: NDArray[np.float64], inverse: bool) -> NDArray[np.float64]:
        values, vectors = np.linalg.eigh(np.cov(pixels.T) + 1e-8 * np.eye(3))
        return (vectors * (values ** (-0.5 if inverse else 0.5))) @ vectors.T

    matrix = root(target, False) @ root(source, True)
    moved = (model.colors - source.mean(0)) @ matrix.T + target.mean(0)
    model.colors = np.clip(moved, 0.0, 1.0).astype(np.float32)


class _Refinement:
    """The losses' steps over the views."""

    def __init__(self, model: ColorModel, views: list[StyleView], exemplar: Exemplar,
                 config: StylizeConfig) -> None:
        self.model, self.views, self.config = model, views, config
        names = {"content": (config.content_network, "vgg16"),
                 "style": (config.style_network, "resnet50")}
        self.names = {term: ((paper if models.available(paper) else "embedded")
                             if chosen == "auto" else chosen)
                      for term, (chosen, paper) in names.items()}
        self.content: FeatureNetwork = load_network(self.names["content"])
        self.style: FeatureNetwork = load_network(self.names["style"])
        self.exemplar = self._exemplar_features(exemplar) if config.method == "arf" else None
        self.scale: dict[str, float] = {}

    def _exemplar_features(self, exemplar: Exemplar) -> torch.Tensor:
        """Features of the whole exemplar at the views' stroke size."""
        picture = torch.from_numpy(exemplar.image.astype(np.float32) / 255.0).permute(2, 0, 1)[None]
        factor = self.config.size / max(picture.shape[-2:])
        picture = torch.nn.functional.interpolate(picture, scale_factor=factor, mode="bilinear",
                                                  antialias=True)
        with torch.no_grad():
            features = stacked(self.style(picture))
        return features.flatten(1).T

    def _terms(self, view: StyleView, image: torch.Tensor) -> dict[str, torch.Tensor]:
        """The losses of one render [1, 3, h, w]."""
        def tensor(picture: NDArray[np.float32]) -> torch.Tensor:
            return torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1)))[None]

        wanted = tensor(view.example if self.exemplar is None else view.content)
        content = tensor(view.content)
        with torch.no_grad():
            content_features = stacked(self.content(content))
            style_features = None if self.exemplar is not None else stacked(self.style(wanted))
        features = stacked(self.style(image))
        inside = torch.nn.functional.interpolate(
            torch.from_numpy(view.alpha)[None, None], size=features.shape[-2:], mode="area"
        )[0, 0] > 0.3
        bank = self.exemplar if style_features is None else style_features[:, inside].T
        assert bank is not None
        found = stacked(self.content(image)) if self.content is not self.style else features
        inside_content = torch.nn.functional.interpolate(
            torch.from_numpy(view.alpha)[None, None], size=found.shape[-2:], mode="area"
        )[0, 0] > 0.3
        terms = {
            "style": nearest_neighbour_loss(features[:, inside].T, bank),
            "content": content_loss(found, content_features, inside_content),
            "laplacian": laplacian_loss(
                image[0], wanted[0] if self.config.lap_reference == "example" else content[0],
                pool=self.config.lap_pool)}
        if self.exemplar is None:
            terms["fit"] = (image - wanted).square().mean()
        return terms

    def _shares(self) -> dict[str, float]:
        """Wanted gradient norm of each term, relative to the anchor's."""
        config = self.config
        return {"fit": 1.0, "content": 0.1 * config.alpha / 0.001,
                "style": 0.5 * config.beta / 0.005, "laplacian": 0.5 * config.gamma / 10.0}

    def _gradients(self, view: StyleView) -> tuple[dict[str, float], dict[str, float],
                                                   dict[str, torch.Tensor]]:
        """Losses, gradient norms and image gradients of each term for the colours as they are."""
        image = torch.from_numpy(np.ascontiguousarray(
            self.model.picture(view).transpose(2, 0, 1)))[None].requires_grad_(True)
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
        """Take the steps; returns losses and gradient norms before and after."""
        config, model = self.config, self.model
        before = self._calibrate()
        mean, square = np.zeros_like(model.colors), np.zeros_like(model.colors)
        gradient = np.zeros((3, len(model.colors)), np.float32)
        generator = np.random.Generator(np.random.Philox(key=[config.seed, 1]))
        order: list[int] = []
        for step in range(config.steps):
            if not order:
                order = list(generator.permutation(len(self.views)))
            view = self.views[order.pop()]
            image = torch.from_numpy(np.ascontiguousarray(
                model.picture(view).transpose(2, 0, 1)))[None].requires_grad_(True)
            terms = self._terms(view, image)
            loss = torch.stack([self.scale[name] * value for name, value in terms.items()]).sum()
            slope, = torch.autograd.grad(loss, image)
            picture = slope[0].permute(1, 2, 0).numpy() * view.alpha[..., None]
            model.pulled_back(view, np.ascontiguousarray(picture), gradient)
            rate = config.learning_rate * 0.1 ** (step / max(1, config.steps))
            adam_step(model.colors, gradient, mean, square, np.float32(rate), step + 1)
            if progress is not None:
                progress.update(progress.done + 1, f"refine {step + 1} of {config.steps}: "
                                f"style {float(terms['style'].detach()):.4f}")
        after, norms, _ = self._gradients(self.views[len(self.views) // 2])
        return {"networks": self.names, "steps": config.steps, "before": before,
                "after": {"losses": after, "gradient_norms": norms}}
