"""ARF (Zhang et al. 2022): artistic radiance fields by nearest-neighbour features.

Colors that do not depend on the direction are matched to the painting's, fitted to the photos
recolored in the same way, then changed by whole-view steps: every feature of the render goes to
the nearest of the painting (Eq. 4 and 5 of Shen et al. 2023 are these), a content loss keeps it
near the recolored photo, total variation keeps view and voxels smooth. At the end the colors are
matched again. The gradient of a picture is taken back through our renderer exactly, as the
original's deferred back-propagation does.

What differs from the original:

- Statistics of colors are those of the person alone, in photos and painting, and the map of the
  last match is that of colors. The original counts all pixels, and adds the map's offset to raw
  coefficients. A short fit to the recolored renders follows, as in ABC-GS.
- The losses on features count where the head is; the background has none. The nearest features are
  sought in the whole painting, as in the original.
- Features are those of Oxford's VGG-16 (or of the small network that ships with the package), each
  layer scaled to a mean square of 1; the original's are torchvision's, unscaled. Oxford's have one
  of about 140,000 on portraits, for pictures of 0 to 255; torchvision's see colors with a spread
  of 1 instead of about 58, which makes 40 if all else is alike. So the content weight of 0.001 is
  0.04 here: an estimate.
- The fit to the recolored photos is by whole views (SIRT) instead of by random rays; colors stay
  between 0 and 1; there are fewer, smaller photos.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from lfportrait.arrays import Float32, Float64
from lfportrait.device import device_name, torch_device
from lfportrait.example import Exemplar
from lfportrait.stylize import FieldTask
from lfportrait.stylize.fit import ColorModel
from lfportrait.stylize.losses import (
    FeatureNetwork,
    content_loss,
    nearest_neighbour_loss,
    stacked,
    total_variation,
)

from ..config import ArfConfig
from .photo_views import (
    COLOR_SMOOTHNESS,
    IMAGE_SMOOTHNESS,
    SMOOTHED_SHARE,
    ColorDescent,
    PhotoView,
    best_network,
    dump_views,
    half_sized,
    head_places,
    photo_views,
    style_features,
    tensor,
)

Terms = dict[str, torch.Tensor]

LEARNING_RATE = 0.1
"""Step of RMSProp in units of the field's coefficients (0.28 of a color's)."""
CONTENT = 0.04
"""Weight of the content loss, on features with a mean square of 1; the original's 0.001 is for
features that are about six times larger. The style loss has 1."""
REFITS = 3
"""Iterations of the fit to the recolored renders, after the steps; the original has none."""


def paint_by_features(task: FieldTask, config: ArfConfig) -> tuple[Float32, dict[str, Any]]:
    """Colors of a field's rows for a painting, float32 [N, 3], by ARF, and figures.

    These are errors of the fits, losses before and after, seconds.
    """
    config.check()
    start = time.perf_counter()
    device = torch_device(task.device)
    name, network = best_network(config.network, device.place)
    if task.progress is not None:
        task.progress.total = min(config.views, len(task.capture.training())) + config.length
    views = photo_views(task, config.pixels, config.views)
    prepared = time.perf_counter()
    model = ColorModel(task.field, task.background)
    fit = _recolored(model, task, views, config.iterations)
    fitted = time.perf_counter()
    losses = _Losses(network, task, config, device.place)
    descent = ColorDescent(model, task.field, LEARNING_RATE, COLOR_SMOOTHNESS,
                           SMOOTHED_SHARE, task.random(3))
    probe = views[len(views) // 2]
    before = losses.report(model, probe)
    random = task.random(2)
    for step in range(config.length):
        view = views[random.integers(len(views))]
        values, slope = losses.slope(model, view)
        descent.step([(view, slope)])
        task.tell(f"step {step + 1} of {config.length}: style {values['style']:.4f}", 1)
    after = losses.report(model, probe)
    stepped = time.perf_counter()
    refit = _matched_again(model, task, views, REFITS)
    unseen = model.fill_unseen()
    dump_views(task, model, views)
    return model.colors, {
        "device": device_name(device), "views": len(views), "fit": {"rmse": fit},
        "refit": {"rmse": refit},
        "refinement": {"networks": {"features": name}, "steps": config.length, "before": before,
                       "after": after},
        "unseen_share": round(unseen, 4),
        "seconds": {"views": round(prepared - start, 3), "fit": round(fitted - prepared, 3),
                    "refine": round(stepped - fitted, 3),
                    "refit": round(time.perf_counter() - stepped, 3)}}


def _recolored(model: ColorModel, task: FieldTask, views: list[PhotoView],
                iterations: int) -> list[float]:
    """Photos and colors matched to the painting's, and the colors fitted to the photos."""
    palette = painted_pixels(task.exemplar)
    change = ColorMap.between(person_pixels(views, [view.content for view in views]), palette)
    for view in views:
        view.content = view.example = change.picture(view.content, view.alpha, task.background)
    model.colors = change.colors(model.colors)
    return _rms(model.fit(list(views), iterations, task.progress))


def _matched_again(model: ColorModel, task: FieldTask, views: list[PhotoView],
                   iterations: int) -> list[float]:
    """Colors matched once more, and fitted to the renders that were matched."""
    pictures = [model.picture(view) for view in views]
    change = ColorMap.between(person_pixels(views, pictures), painted_pixels(task.exemplar))
    for view, picture in zip(views, pictures):
        view.example = change.picture(picture, view.alpha, task.background)
    model.colors = change.colors(model.colors)
    return _rms(model.fit(list(views), iterations, task.progress))


def _rms(errors: list[float]) -> list[float]:
    return [round(float(np.sqrt(error)), 5) for error in errors]


class _Losses:
    """ARF's losses of a rendered view at half its size."""

    def __init__(self, network: FeatureNetwork, task: FieldTask, config: ArfConfig,
                 place: str) -> None:
        self.network, self.place = network, place
        self.style = style_features(network, task, config.pixels // 2, place)
        self._content: dict[int, torch.Tensor] = {}

    def terms(self, view: PhotoView, image: torch.Tensor) -> Terms:
        """Each loss of a render [1, 3, h, w], weighted."""
        features = stacked(self.network(half_sized(image)))
        inside = head_places(view, features)
        return {
            "style": nearest_neighbour_loss(features[:, inside].T, self.style),
            "content": CONTENT * content_loss(
                features, self._content_of(view), inside),
            "smoothness": IMAGE_SMOOTHNESS * total_variation(image)}

    def _content_of(self, view: PhotoView) -> torch.Tensor:
        if id(view) not in self._content:
            with torch.no_grad():
                self._content[id(view)] = stacked(self.network(half_sized(
                    tensor(view.content, self.place))))
        return self._content[id(view)]

    def slope(self, model: ColorModel, view: PhotoView) -> tuple[dict[str, float], Float32]:
        """Values of the losses, and the slope of their sum at each pixel [h, w, 3]."""
        image = tensor(model.picture(view), self.place).requires_grad_(True)
        terms = self.terms(view, image)
        slope, = torch.autograd.grad(torch.stack(list(terms.values())).sum(), image)
        return ({name: float(value.detach()) for name, value in terms.items()},
                slope[0].permute(1, 2, 0).cpu().numpy())

    def report(self, model: ColorModel, view: PhotoView) -> dict[str, dict[str, float]]:
        """Losses and norms of their gradients on one view, for the figures."""
        image = tensor(model.picture(view), self.place).requires_grad_(True)
        terms = self.terms(view, image)
        return {"losses": {name: float(value.detach()) for name, value in terms.items()},
                "gradient_norms": {
                    name: float(torch.autograd.grad(value, image, retain_graph=True)[0].norm())
                    for name, value in terms.items()}}



LEAST = 1e-8
"""Eigenvalues of a covariance are not taken as smaller than this."""


@dataclass(frozen=True)
class ColorMap:
    """An affine map of colors."""

    matrix: Float64  # float64 [3, 3].
    offset: Float64  # float64 [3].

    @staticmethod
    def between(source: NDArray[np.floating], target: NDArray[np.floating]) -> ColorMap:
        """The map that gives ``source`` [N, 3] mean and covariance of ``target`` [M, 3].

        Matrix: C_t^1/2 C_s^-1/2, with symmetric roots.
        """
        matrix = _root(target, 0.5) @ _root(source, -0.5)
        return ColorMap(matrix, target.mean(0, dtype=np.float64)
                        - matrix @ source.mean(0, dtype=np.float64))

    def colors(self, colors: Float32) -> Float32:
        """Colors [N, 3] moved, in [0, 1]."""
        return np.clip(colors @ self.matrix.T + self.offset, 0.0, 1.0).astype(np.float32)

    def picture(self, picture: Float32, alpha: Float32, background: float) -> Float32:
        """A picture [h, w, 3] on a background moved, the background left as it is."""
        behind = (1 - alpha[..., None]) * background
        moved = (picture - behind) @ self.matrix.T + alpha[..., None] * self.offset + behind
        return np.clip(moved, 0.0, 1.0).astype(np.float32)


def _root(pixels: NDArray[np.floating], power: float) -> Float64:
    values, vectors = np.linalg.eigh(np.cov(pixels.T.astype(np.float64)))
    return (vectors * np.maximum(values, LEAST) ** power) @ vectors.T


def painted_pixels(exemplar: Exemplar) -> Float32:
    """Colors of the painted person, float32 [N, 3] in [0, 1]."""
    person = exemplar.regions().person > 0.5
    if person.sum() < 100:
        person = np.ones(exemplar.image.shape[:2], np.bool_)
    return exemplar.image[person].astype(np.float32) / np.float32(255)


def person_pixels(views: list[PhotoView], pictures: list[Float32]) -> Float32:
    """Colors of the person in pictures of the views, float32 [N, 3]."""
    return np.concatenate([picture[view.inside] for view, picture in zip(views, pictures)])
