"""Ref-NPR (Zhang et al. 2023): one painted view, registered to the field.

The frontal view is painted by example. Its colors are carried along the field's surface to every
place that other views see, too, and the field is fitted to them. Everything else follows by
likeness in the photos: each feature of a photo is matched with the nearest of the frontal render,
and the field's view shall have the painted feature of that place; coarse patches take the painted
color in the same way. In the last quarter the painted view is replaced by what the field shows of
it.

What differs from the original:

- Registration tests visibility by depth, as ReGS does, instead of by equal cells of 512^3. As
  there, outlines are dropped, and places that the painted view sees at more than 72.5 degrees from
  the other one.
- The painted view is a render of the field from the front; the others are photos of the capture.
- The first fit is to whole views (SIRT). A step takes the whole painted view and one other, instead
  of 50,000 rays of each kind.
- Features match in the third block of VGG-16 alone, without the fourth; colors match in conv5_1 of
  a 16 times smaller VGG-19, or in the third block, pooled, where its weights are missing. Features
  are scaled to a mean square of 1 (`arf`).
- The error to the painting weighs 30 times as much: at the published weight the matched features
  pull the painted view away from its painting. Coarse colors weigh 15 as in ReGS instead of 5, and
  steps are smaller: at the published 0.1 views of this size get colored speckles.
- Losses on features count where the head is.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from scipy.ndimage import binary_erosion, maximum_filter, minimum_filter
from torch.nn import functional

from lfportrait import models
from lfportrait.arrays import Bool, Float32
from lfportrait.capture import Camera
from lfportrait.device import device_name, torch_device
from lfportrait.errors import UserError
from lfportrait.example import Transfer
from lfportrait.stylize import FieldTask
from lfportrait.stylize.fit import ColorModel
from lfportrait.stylize.losses import (
    FeatureNetwork,
    content_loss,
    load_network,
    stacked,
    total_variation,
)

from ..config import RefNprConfig
from .photo_views import (
    COLOR_SMOOTHNESS,
    IMAGE_SMOOTHNESS,
    SMOOTHED_SHARE,
    TOLERANCE,
    ColorDescent,
    PhotoView,
    best_network,
    dump_views,
    head_places,
    nearest_places,
    photo_views,
    seen_from,
    tensor,
    view_of,
)

Terms = dict[str, torch.Tensor]

STEEPEST = 0.3
"""Least cosine between the directions from which the painted and another view see a place."""
OUTLINE = 7 / 800
"""Width of the outline that is dropped, over the longer side of the view: 7 of 800 pixels."""
ALIKE = 0.6
"""Largest cosine distance of coarse patches that take each other's color."""
PATCH = 16
"""Side of a coarse patch in pixels."""
LEARNING_RATE = 0.03
"""Step of RMSProp in units of the field's coefficients (0.28 of a color's); the original's 0.1
leaves colored speckles where views are small."""
PAINTED = 30.0
"""Weight of the squared error to the painted view, and of that to what others see of it; at the
published 1 the steps leave the painting."""
MATCH = 1.0
"""Weight of the painted features at the places whose photographed features match best."""
COLOR = 15.0
"""Weight of the painted colors of coarse patches that match in the same way; the original has 5,
ReGS 15."""
CONTENT = 0.2
"""Weight of the content loss, on features with a mean square of 1; the original's 0.005 is for
features that are about six times larger."""
LAST = 0.25
"""Share of the steps at the end that use what the field shows instead of the painting."""
LAST_WEIGHT = 0.2
"""Weight of the matched features in those."""


def paint_by_reference(task: FieldTask, config: RefNprConfig) -> tuple[Float32, dict[str, Any]]:
    """Colors of a field's rows for a painting, float32 [N, 3], after Ref-NPR, and figures.

    These are error of the fit, losses before and after, share of the other views that is
    registered, seconds. The capture has landmarks.
    """
    config.check()
    start = time.perf_counter()
    device = torch_device(task.device)
    name, network = best_network(config.network, device.place)
    deep_name, deep = _deep_network(name, network, device.place)
    if task.progress is not None:
        task.progress.total = min(config.views, len(task.capture.training())) + config.length
    reference = painted_view(task, config.pixels)
    views = photo_views(task, config.pixels, config.views)
    shares = [registered(view, reference) for view in views]
    prepared = time.perf_counter()
    model = ColorModel(task.field, task.background)
    errors = model.fit([reference, *views], config.iterations, task.progress)
    fitted = time.perf_counter()
    losses = _Losses(network, deep, model, reference, config, device.place)
    descent = ColorDescent(model, task.field, LEARNING_RATE, COLOR_SMOOTHNESS,
                           SMOOTHED_SHARE, task.random(6))
    probe = views[len(views) // 2]
    before = losses.report(probe)
    random = task.random(7)
    for step in range(config.length):
        view = views[random.integers(len(views))]
        last = step >= (1 - LAST) * config.length
        values, slopes = losses.slopes(view, last)
        descent.step([(view, slopes[0]), (reference, slopes[1])])
        task.tell(f"step {step + 1} of {config.length}: match {values['match']:.4f}", 1)
    after = losses.report(probe)
    stepped = time.perf_counter()
    # No iteration: only which rows the views see counts here.
    model.fit([replace(view, trust=view.alpha) for view in (reference, *views)], 0)
    unseen = model.fill_unseen()
    dump_views(task, model, [reference, *views])
    return model.colors, {
        "device": device_name(device), "views": len(views),
        "registered_share": round(float(np.mean(shares)), 4),
        "fit": {"rmse": [round(float(np.sqrt(error)), 5) for error in errors]},
        "refinement": {"networks": {"features": name, "coarse colors": deep_name},
                       "steps": config.length,
                       "before": before, "after": after},
        "unseen_share": round(unseen, 4),
        "seconds": {"views": round(prepared - start, 3), "fit": round(fitted - prepared, 3),
                    "refine": round(stepped - fitted, 3)}}


def painted_view(task: FieldTask, size: int) -> PhotoView:
    """The field from the front, painted by example: the reference."""
    landmarks = task.capture.landmarks
    if landmarks is None:
        raise UserError("the capture has no facial landmarks; run `lfportrait calibrate` on the "
                        "photos, or use --method arf")
    camera = Camera.arc(np.zeros(1), distance=4.0, width=512, height=512, focal=640.0)
    view = view_of(task, camera, size, None)
    if view is None:
        raise UserError("the field shows nothing from the front")
    pixels, _ = view.camera.project(landmarks)
    transfer = Transfer(task.exemplar, replace(task.transfer, seed=task.seed))
    painted = transfer.apply(view.content, pixels[0], mask=view.alpha).image
    alpha = view.alpha[..., None]
    view.example = (np.where(np.isfinite(view.points[..., :1]), painted, view.content) * alpha
                    + task.background * (1 - alpha)).astype(np.float32)
    return view


def steady_places(view: PhotoView) -> Bool:
    """Pixels of a view away from its outlines, bool [h, w].

    An outline is where the head ends, or where the depth jumps from a pixel to the next ones: by
    more than on a surface that is seen at 72 degrees.
    """
    width = max(1, round(OUTLINE * max(view.shape)))
    depth = np.where(np.isfinite(view.depth), view.depth, 1e3)
    jump = maximum_filter(depth, 3) - minimum_filter(depth, 3)
    steepest = np.maximum(3 * TOLERANCE, 6 * depth / view.camera.focal[0, 0])
    return binary_erosion(view.inside & (jump < steepest), iterations=width)


def registered(view: PhotoView, reference: PhotoView) -> float:
    """Lay the painted view on another one, as its example; returns the share that it covers.

    Only what both see counts in the fit: the view's trust is 0 elsewhere.
    """
    link = seen_from(view, reference)
    steady = torch.from_numpy(steady_places(reference).astype(np.float32))[None, None]
    whole = link.warped(steady)[0, 0].numpy() > 0.99
    known = link.visible.numpy() & whole & (link.cosine >= STEEPEST) & steady_places(view)
    warped = link.warped(tensor(reference.example))[0].permute(1, 2, 0).numpy()
    view.example = np.where(known[..., None], warped, view.content).astype(np.float32)
    view.trust = known.astype(np.float32)
    return float(known.sum() / max(int(view.inside.sum()), 1))


def _deep_network(name: str, network: FeatureNetwork, place: str) -> tuple[str, FeatureNetwork]:
    """Features of coarse patches, stride 16, and their name."""
    if models.available("vgg19-se") and name != "embedded":
        return "vgg19-se", load_network("vgg19-se-deep", place=place)
    return f"{name}, pooled", lambda image: [functional.avg_pool2d(stacked(network(image))[None],
                                                                   PATCH // 4)]


class _Losses:
    """Ref-NPR's losses of a view and of the reference."""

    def __init__(self, network: FeatureNetwork, deep: FeatureNetwork, model: ColorModel,
                 reference: PhotoView, config: RefNprConfig, place: str) -> None:
        self.network, self.deep, self.model = network, deep, model
        self.reference, self.config, self.place = reference, config, place
        known, painted = tensor(reference.content, place), tensor(reference.example, place)
        with torch.no_grad():
            content = stacked(network(known))
            self._inside = head_places(reference, content)
            self._bank = content[:, self._inside].T
            self._painted = stacked(network(painted))[:, self._inside].T
            coarse = deep(known)[0][0]
            self._coarse_inside = head_places(reference, coarse)
            self._coarse_bank = coarse[:, self._coarse_inside].T
            self._painted_colors = functional.avg_pool2d(
                painted, PATCH)[0][:, self._coarse_inside].T
        self._wanted = torch.from_numpy(reference.example).to(place)
        self._known: dict[int, tuple[torch.Tensor, ...]] = {}

    def _matches(self, view: PhotoView) -> tuple[torch.Tensor, ...]:
        """Features of a view's photo, its places' matches in the reference, fine and coarse."""
        if id(view) not in self._known:
            photo = tensor(view.content, self.place)
            with torch.no_grad():
                content = stacked(self.network(photo))
                inside = head_places(view, content)
                nearest, _ = nearest_places(content[:, inside].T, self._bank)
                coarse = self.deep(photo)[0][0]
                places = head_places(view, coarse)
                patch, distance = nearest_places(coarse[:, places].T, self._coarse_bank)
                alike = distance <= ALIKE
                places[places.clone()] = alike
            self._known[id(view)] = content, inside, nearest, places, patch[alike]
        return self._known[id(view)]

    def terms(self, view: PhotoView, image: torch.Tensor, shown: torch.Tensor,
              last: bool = False) -> Terms:
        """Each loss of a view's render and of the reference's [1, 3, h, w], weighted."""
        content, inside, nearest, places, patch = self._matches(view)
        features = stacked(self.network(image))
        painted = self._painted
        if last:
            with torch.no_grad():
                painted = stacked(self.network(shown))[:, self._inside].T
        match = 1 - functional.cosine_similarity(features[:, inside].T, painted[nearest]).mean()
        terms = {"painted": PAINTED * _error(shown, self._wanted,
                                                           self.reference.trusted),
                 "registered": PAINTED * _error(
                     image, torch.from_numpy(view.example).to(self.place), view.trusted),
                 "match": (LAST_WEIGHT if last else MATCH) * match,
                 "smoothness": IMAGE_SMOOTHNESS * total_variation(image)}
        if not last:
            terms["content"] = CONTENT * content_loss(features, content, inside)
            if places.any():
                colors = functional.avg_pool2d(image, PATCH)[0][:, places].T
                terms["color"] = COLOR * (colors - self._painted_colors[patch]).square().mean()
        return terms

    def slopes(self, view: PhotoView, last: bool) -> tuple[dict[str, float], list[Float32]]:
        """Values of the losses, and slopes of their sum at each pixel of view and reference."""
        image, shown = (tensor(self.model.picture(one), self.place).requires_grad_(True)
                        for one in (view, self.reference))
        terms = self.terms(view, image, shown, last)
        slopes = torch.autograd.grad(torch.stack(list(terms.values())).sum(), (image, shown))
        return ({name: float(value.detach()) for name, value in terms.items()},
                [slope[0].permute(1, 2, 0).cpu().numpy() for slope in slopes])

    def report(self, view: PhotoView) -> dict[str, dict[str, float]]:
        """Losses and norms of their gradients, for the figures."""
        image, shown = pictures = [tensor(self.model.picture(one), self.place).requires_grad_(True)
                                   for one in (view, self.reference)]
        terms = self.terms(view, image, shown)
        norms = {}
        for name, value in terms.items():
            found = torch.autograd.grad(value, pictures, retain_graph=True, allow_unused=True)
            norms[name] = float(sum(slope.square().sum() for slope in found
                                    if slope is not None) ** 0.5)
        return {"losses": {name: float(value.detach()) for name, value in terms.items()},
                "gradient_norms": norms}


def _error(image: torch.Tensor, wanted: torch.Tensor, trust: Float32) -> torch.Tensor:
    """Mean squared difference of [1, 3, h, w] and [h, w, 3] where it is trusted; 0 if nowhere."""
    weight = torch.from_numpy(trust).to(image.device)
    squared = (image[0].permute(1, 2, 0) - wanted).square().mean(-1)
    return (squared * weight).sum() / weight.sum().clamp_min(1.0)
