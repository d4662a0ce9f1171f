"""Style transfer in the plane by adaptive instance normalisation (Huang and Belongie 2017).

The features of a picture get mean and spread of the painting's, channel by channel, and a decoder
makes a picture of them. Encoder and decoder are the 16 times smaller VGG-19 to relu4_1 of
Collaborative-Distillation (Wang et al. 2020), written out here; weights are named as there.
"""

from __future__ import annotations

import torch
from safetensors.torch import load
from torch.nn import functional

from lfportrait import models

__all__ = ["AdainNetwork", "Statistics", "load_adain", "normalised_to", "statistics_of"]

Weights = dict[str, torch.Tensor]
Statistics = tuple[torch.Tensor, torch.Tensor]
"""Mean and spread of each channel, [C] each."""

ENCODER = ("11", "12", "21", "22", "31", "32", "33", "34", "41")
DECODER = tuple(reversed(ENCODER))


class AdainNetwork:
    """Encoder and decoder; the decoder can be taught.

    Parameters
    ----------
    weights
        ``encoder4.conv0`` ... ``encoder4.conv41`` and ``decoder4.conv41`` ... ``decoder4.conv11``,
        ``.weight`` and ``.bias`` each. They are copied.
    place
        Torch's name of the device that computes, and that pictures must lie on.
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
    """The network with its published weights, through the registry.

    Parameters
    ----------
    place
        Torch's name of the device that computes.

    Raises
    ------
    UserError
        If the weights are missing.
    """
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
