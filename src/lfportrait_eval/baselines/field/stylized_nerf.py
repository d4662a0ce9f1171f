"""StylizedNeRF (Huang et al. 2022): a network that paints views, and a field, teach each other.

The network (AdaIN) paints every view in the painting's manner. First its decoder is tuned until
neighbouring views agree where the field's depth says that they show the same place. Then, round by
round, the field's colors are fitted to the painted views, and the decoder is tuned towards what
the field shows. What views can't agree on goes into a latent code of each view; at the end the mean
code is shown.

What differs from the original:

- The field is a voxel field with frozen density; a row's color is linear in the code
  (`LatentColors`) instead of a network of place and code. It is fitted to whole views by
  simultaneous iterations.
- The decoder is taught by the field as the paper says; the published program has that half switched
  off.
- Encoder and decoder are 16 times smaller (`AdainNetwork`), and features in the losses are scaled
  to the published encoder's mean activation of 1. The codes have a few numbers, set by least
  squares and normalised, instead of 32 from an autoencoder over many styles.
- Statistics of features are those of the person alone, in photos and painting.
- Whole small views instead of patches of 512 pixels, and fewer steps.

AdaIN is style transfer in the plane by adaptive instance normalisation (Huang and Belongie 2017).
The features of a picture get mean and spread of the painting's, channel by channel, and a decoder
makes a picture of them. Encoder and decoder are the 16 times smaller VGG-19 to relu4_1 of
Collaborative-Distillation (Wang et al. 2020), written out here; weights are named as there.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import torch
from safetensors.torch import load
from torch.nn import functional

from lfportrait import models
from lfportrait.arrays import Float32
from lfportrait.device import device_name, torch_device
from lfportrait.stylize import FieldTask
from lfportrait.stylize.fit import ColorModel

from ..adam import Adam
from ..config import StylizedNerfConfig
from .photo_views import Correspondence, PhotoView, dump_views, photo_views, seen_from, tensor

Weights = dict[str, torch.Tensor]
Statistics = tuple[torch.Tensor, torch.Tensor]
"""Mean and spread of each channel, [C] each."""

ENCODER = ("11", "12", "21", "22", "31", "32", "33", "34", "41")
DECODER = tuple(reversed(ENCODER))

LEARNING_RATE = 2e-5
"""Adam's step for the decoder; at the published 0.0001 the small decoder draws stripes."""
CONTENT, STYLE = 1.0, 1.0
"""Weights of the decoder's content loss and of its style loss."""
AGREEMENT, SHOWN = 50.0, 50.0
"""Weights of the agreement of neighbouring views, warped by the field's depth, and of that with
what the field shows."""
CODE = 0.0001
"""Weight of a latent code's squared length beside the mean squared error of its view."""


class AdainNetwork:
    """Encoder and decoder; the decoder can be taught.

    ``weights`` are ``encoder4.conv0`` ... ``encoder4.conv41`` and ``decoder4.conv41`` ...
    ``decoder4.conv11``, ``.weight`` and ``.bias`` each, and are copied to ``place``, torch's name
    of the device that computes, and that pictures must lie on.
    """

    def __init__(self, weights: Weights, place: str = "cpu") -> None:
        self.place = place
        placed = {name: value.float().to(place) for name, value in weights.items()}
        self.encoder = {name.removeprefix("encoder4."): value
                        for name, value in placed.items() if name.startswith("encoder4.")}
        self.decoder = {name.removeprefix("decoder4."): value.clone().requires_grad_(True)
                        for name, value in placed.items() if name.startswith("decoder4.")}

    def encode(self, image: torch.Tensor) -> list[torch.Tensor]:
        """Features relu1_1, relu2_1, relu3_1 and relu4_1 of RGB in [0, 1], [1, 3, h, w].

        Strides 1, 2, 4 and 8; h and w are multiples of 8.
        """
        x = functional.conv2d(image, self.encoder["conv0.weight"], self.encoder["conv0.bias"])
        maps = []
        for name in ENCODER:
            if name in ("21", "31", "41"):
                x = functional.max_pool2d(x, 2)
            x = torch.relu(_padded(x, self.encoder, name))
            if name.endswith("1"):
                maps.append(x)
        return maps

    def decode(self, features: torch.Tensor) -> torch.Tensor:
        """A picture [1, 3, h, w] of features relu4_1; not confined to [0, 1]."""
        x = features
        for name in DECODER:
            x = _padded(x, self.decoder, name)
            if name != "11":
                x = torch.relu(x)
            if name in ("41", "31", "21"):
                x = functional.interpolate(x, scale_factor=2, mode="nearest")
        return x


def _padded(x: torch.Tensor, weights: Weights, name: str) -> torch.Tensor:
    """A 3x3 convolution of a picture continued by its mirror image."""
    return functional.conv2d(functional.pad(x, (1, 1, 1, 1), mode="reflect"),
                             weights[f"conv{name}.weight"], weights[f"conv{name}.bias"])


def load_adain(place: str = "cpu") -> AdainNetwork:
    """The network with its published weights, through the registry."""
    return AdainNetwork(load(models.fetch("adain").read_bytes()), place)


def statistics_of(features: torch.Tensor, inside: torch.Tensor) -> Statistics:
    """Mean and spread of features [1, C, h, w] where ``inside``, float [h, w], counts."""
    weight = inside / inside.sum().clamp_min(1e-6)
    mean = (features[0] * weight).sum((1, 2))
    variance = ((features[0] - mean[:, None, None]).square() * weight).sum((1, 2))
    return mean, (variance + 1e-5).sqrt()


def normalised_to(features: torch.Tensor, inside: torch.Tensor, wanted: Statistics,
                  ) -> torch.Tensor:
    """Features [1, C, h, w] moved so that their statistics inside are the wanted ones."""
    mean, spread = (value[:, None, None] for value in statistics_of(features, inside))
    target_mean, target_spread = (value[:, None, None] for value in wanted)
    return (features - mean) / spread * target_spread + target_mean



NEIGHBOURS = 3
"""A view is compared with views up to this many places away in their order around the head."""


def paint_by_mutual_teaching(task: FieldTask, config: StylizedNerfConfig,
                             network: AdainNetwork | None = None,
                             ) -> tuple[Float32, dict[str, Any]]:
    """Colors of a field's rows for a painting, float32 [N, 3], after StylizedNeRF, and figures.

    These are error of the fit after each round, disagreement of neighbours before and after,
    seconds. Without a ``network`` the published weights are loaded.
    """
    config.check()
    start = time.perf_counter()
    device = torch_device(task.device)
    network = network or load_adain(device.place)
    if task.progress is not None:
        task.progress.total = (min(config.views, len(task.capture.training())) + config.length
                               + (config.rounds - 1) * (config.length // 2))
    views = photo_views(task, config.pixels, config.views)
    prepared = time.perf_counter()
    teacher = PaintingTeacher(network, views, task, config)
    untaught = teacher.disagreement()
    teacher.tune(config.length, None)
    model = ColorModel(task.field, task.background)
    latent = LatentColors(model, views, config.latent, CODE, task.random(5))
    errors = []
    for turn in range(config.rounds):
        if turn:
            teacher.tune(config.length // 2, [latent.picture(k) for k in range(len(views))])
        for index, view in enumerate(views):
            view.example = teacher.picture(index)
        task.tell(f"round {turn + 1} of {config.rounds}: fit")
        errors.append(latent.fit(config.iterations))
    unseen = model.fill_unseen()
    dump_views(task, model, views)
    return model.colors, {
        "device": device_name(device), "views": len(views), "networks": {"painting": "adain"},
        "fit": {"rmse": [[round(value, 5) for value in row] for row in errors]},
        "disagreement": {"before": round(untaught, 5), "after": round(teacher.disagreement(), 5)},
        "unseen_share": round(unseen, 4),
        "seconds": {"views": round(prepared - start, 3),
                    "teaching": round(time.perf_counter() - prepared, 3)}}


class PaintingTeacher:
    """The network that paints views, and how it is tuned."""

    def __init__(self, network: AdainNetwork, views: list[PhotoView], task: FieldTask,
                 config: StylizedNerfConfig) -> None:
        self.network, self.views, self.task, self.config = network, views, task, config
        self.random = task.random(4)
        self._links: dict[tuple[int, int], Correspondence] = {}
        self._inside = [[_reduced(view.alpha, 2 ** level).to(network.place) for level in range(4)]
                        for view in views]
        with torch.no_grad():
            self.style = self._style_statistics()
            # As published the encoder's mean activation is 1 in each layer; that of the small one
            # is 3 to 10, and losses would not have the weights they are said to have.
            self._scale = [float(mean.mean().clamp_min(1e-3)) ** -2 for mean, _ in self.style]
            self.wanted = [normalised_to(network.encode(self._tensor(view.content))[-1], inside[-1],
                                         self.style[-1])
                           for view, inside in zip(views, self._inside)]
        self._adam = Adam(network.decoder.values(), LEARNING_RATE)
        self._taken = 0

    def _tensor(self, picture: Float32) -> torch.Tensor:
        return tensor(picture, self.network.place)

    def _style_statistics(self) -> list[Statistics]:
        """Statistics of the painted person's features, at the views' size."""
        exemplar = self.task.exemplar
        person = exemplar.regions().person
        size = _multiples(self.config.pixels, exemplar.image.shape)
        picture, mask = (functional.interpolate(value, size=size, mode="bilinear", antialias=True)
                         for value in (tensor(exemplar.image.astype(np.float32) / np.float32(255)),
                                       torch.from_numpy(person.astype(np.float32))[None, None]))
        inside = mask[0, 0].numpy()
        place = self.network.place
        return [statistics_of(features, _reduced(inside, 2 ** level).to(place))
                for level, features in enumerate(self.network.encode(picture.to(place)))]

    def picture(self, index: int) -> Float32:
        """A view painted, float32 [h, w, 3], on the background."""
        view = self.views[index]
        with torch.no_grad():
            painted = self.network.decode(self.wanted[index])[0].permute(1, 2, 0).cpu().numpy()
        alpha = view.alpha[..., None]
        return (np.clip(painted, 0, 1) * alpha
                + np.float32(self.task.background) * (1 - alpha)).astype(np.float32)

    def disagreement(self) -> float:
        """RMS difference of every view to the next one where both show the same place."""
        pictures = [self._tensor(self.picture(index)) for index in range(len(self.views))]
        total, count = 0.0, 0
        for index in range(len(self.views) - 1):
            link = self._link(index, index + 1)
            difference = (pictures[index] - link.warped(pictures[index + 1]))[0, :, link.visible]
            total += float(difference.square().sum())
            count += difference.numel()
        return float(np.sqrt(total / max(count, 1)))

    def _link(self, index: int, other: int) -> Correspondence:
        if (index, other) not in self._links:
            self._links[index, other] = seen_from(self.views[index], self.views[other],
                                                   place=self.network.place)
        return self._links[index, other]

    def tune(self, steps: int, shown: list[Float32] | None) -> None:
        """Steps of the decoder; ``shown`` is what the field shows in each view, None at first."""
        for step in range(steps):
            index = int(self.random.integers(len(self.views)))
            loss = self._loss(index, None if shown is None else shown[index])
            self._adam.clear()
            loss.backward()  # type: ignore[no-untyped-call]
            self._taken += 1
            self._adam.rate = LEARNING_RATE / (1 + 5e-5 * self._taken)
            self._adam.step()
            self.task.tell(f"decoder {step + 1} of {steps}: loss {float(loss.detach()):.3f}", 1)

    def _loss(self, index: int, shown: Float32 | None) -> torch.Tensor:
        """Content, style, agreement with a neighbour and, later, with the field."""
        inside = self._inside[index]
        painted = self.network.decode(self.wanted[index])
        features = self.network.encode(painted)
        loss = CONTENT * self._scale[-1] * _mean_inside(
            features[-1] - self.wanted[index], inside[-1])
        for found, mask, (mean, spread), scale in zip(features, inside, self.style, self._scale):
            own_mean, own_spread = statistics_of(found, mask)
            loss = loss + STYLE * scale * ((own_mean - mean).square().mean()
                                         + (own_spread - spread).square().mean())
        near = [other for other in range(index - NEIGHBOURS, index + NEIGHBOURS + 1)
                if other != index and 0 <= other < len(self.views)]
        if near:
            other = near[int(self.random.integers(len(near)))]
            link = self._link(index, other)
            if link.visible.any():
                warped = link.warped(self.network.decode(self.wanted[other]))
                loss = loss + AGREEMENT * (painted - warped)[0, :, link.visible].square().mean()
        if shown is not None:
            loss = loss + SHOWN * _mean_inside(painted - self._tensor(shown), inside[0])
        return loss


def _mean_inside(difference: torch.Tensor, inside: torch.Tensor) -> torch.Tensor:
    """Mean square of [1, C, h, w], weighted by [h, w]."""
    return (difference[0].square().mean(0) * inside).sum() / inside.sum().clamp_min(1e-6)


def _reduced(alpha: Float32, factor: int) -> torch.Tensor:
    """A mask [h, w] at a lower resolution: 1 where all is inside, else 0."""
    share = functional.avg_pool2d(torch.from_numpy(alpha)[None, None], factor)[0, 0]
    return (share > 0.9).float()


def _multiples(size: int, shape: tuple[int, ...]) -> tuple[int, int]:
    """Height and width of a picture whose longer side is ``size``, as multiples of 8."""
    factor = size / max(shape[:2])
    return max(16, int(shape[0] * factor) // 8 * 8), max(16, int(shape[1] * factor) // 8 * 8)


class LatentColors:
    """A model's colors, and how they may differ from view to view by a latent code of each view.

    The teacher paints every view on its own, so views contradict each other. There the color is a
    network of the place and of a latent code that belongs to the view; what views can't agree on
    goes into the codes, and the mean code shows what they have in common. Here the color of a row
    is linear in the code: its own color plus a change for each of the code's numbers. Codes have
    mean 0 and spread 1, so that the mean code shows the rows' own colors.

    Parameters
    ----------
    model : The colors of the mean code; changed in place.
    numbers : Length of a code; 0 is the model alone.
    ridge : Weight of a code's squared length beside the mean squared error of its view.
    """

    def __init__(self, model: ColorModel, views: list[PhotoView], numbers: int, ridge: float,
                 random: np.random.Generator) -> None:
        self.model, self.views, self.ridge = model, views, ridge
        self.codes = random.standard_normal((len(views), numbers)).astype(np.float32)
        self.changes = np.zeros((numbers, *model.colors.shape), np.float32)
        self._normalise()

    def picture(self, index: int) -> Float32:
        """What a view shows with its own code, float32 [h, w, 3]."""
        code = self.codes[index]
        colors = self.model.colors + np.tensordot(code, self.changes, 1)
        return self.model.picture(self.views[index], np.ascontiguousarray(colors, np.float32))

    def fit(self, iterations: int) -> list[float]:
        """Fit colors, changes and codes to the views' examples; error of each iteration (RMS)."""
        errors = []
        weight = self._column_sums()
        for _ in range(iterations):
            errors.append(self._iterate(weight))
            self._fit_codes()
            weight = self._column_sums()
        return errors

    def _column_sums(self) -> Float32:
        """How much each row counts in color and changes, float32 [1 + D, N]."""
        sums = np.zeros((1 + len(self.changes), len(self.model.colors)), np.float32)
        for view, code in zip(self.views, self.codes):
            seen = np.zeros((3, sums.shape[1]), np.float32)
            self.model.pulled_back(view, np.repeat(view.trusted[..., None], 3, 2), seen)
            sums[0] += seen[0]
            sums[1:] += np.abs(code)[:, None] * seen[0]
        self.model.seen = sums[0].copy()
        return sums

    def _iterate(self, sums: Float32) -> float:
        """One simultaneous iteration (SIRT) of colors and changes; returns the error before."""
        updates = np.zeros((len(sums), 3, sums.shape[1]), np.float32)
        total = mass = 0.0
        for index, (view, code) in enumerate(zip(self.views, self.codes)):
            residual = view.example - self.picture(index)
            total += float((residual ** 2 * view.trusted[..., None]).sum())
            mass += 3.0 * float(view.trusted.sum())
            rows = np.maximum(view.alpha, 0.05) * (1 + np.abs(code).sum())
            back = np.zeros_like(updates[0])
            self.model.pulled_back(view, view.trusted[..., None] * residual / rows[..., None], back)
            updates[0] += back
            updates[1:] += code[:, None, None] * back
        updates /= np.maximum(sums, 1e-4)[:, None]
        known = sums[0] > 1e-4
        self.model.colors[known] += updates[0].T[known]
        np.clip(self.model.colors, 0.0, 1.0, out=self.model.colors)
        self.changes[:, known] += updates[1:].transpose(0, 2, 1)[:, known]
        return float(np.sqrt(total / max(mass, 1e-9)))

    def _fit_codes(self) -> None:
        """The code of each view by least squares, colors and changes held."""
        if not len(self.changes):
            return
        for index, view in enumerate(self.views):
            trust = np.sqrt(view.trusted)[..., None]
            behind = self.model.picture(view, np.zeros_like(self.model.colors))
            shown = [(trust * (self.model.picture(view, change) - behind)).ravel()
                     for change in self.changes]
            wanted = (trust * (view.example - self.model.picture(view))).ravel()
            matrix = np.stack(shown, 1).astype(np.float64)
            ridge = self.ridge * max(float(view.trusted.sum()) * 3, 1.0)
            normal = matrix.T @ matrix + ridge * np.eye(matrix.shape[1])
            self.codes[index] = np.linalg.solve(normal, matrix.T @ wanted)
        self._normalise()

    def _normalise(self) -> None:
        """Codes of mean 0 and spread 1; colors and changes follow, so that nothing else moves."""
        if len(self.codes) < 2 or not len(self.changes):
            return
        mean, spread = self.codes.mean(0), np.maximum(self.codes.std(0), 1e-6)
        self.model.colors += np.tensordot(mean, self.changes, 1)
        np.clip(self.model.colors, 0.0, 1.0, out=self.model.colors)
        self.codes = (self.codes - mean) / spread
        self.changes *= spread[:, None, None]
