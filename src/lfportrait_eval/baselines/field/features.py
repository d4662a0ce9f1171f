"""Feature networks as the methods use them."""

from __future__ import annotations

import numpy as np
import torch
from torch.nn import functional

from lfportrait import models
from lfportrait.stylize import FieldTask
from lfportrait.stylize.losses import FeatureNetwork, load_network, stacked

from .photo_views import PhotoView, tensor

__all__ = ["best_network", "half_sized", "head_places", "nearest_places", "style_features"]


def best_network(name: str, place: str = "cpu") -> tuple[str, FeatureNetwork]:
    """A feature network on torch's device ``place``, and its name.

    ``"auto"`` is VGG-16, or the embedded one without it.
    """
    if name == "auto":
        name = "vgg16" if models.available("vgg16") else "embedded"
    return name, load_network(name, place=place)


def half_sized(image: torch.Tensor) -> torch.Tensor:
    """A picture [1, 3, h, w] at half its size, bilinear: the mean of two by two pixels."""
    return functional.avg_pool2d(image, 2)


def style_features(network: FeatureNetwork, task: FieldTask, side: int, place: str = "cpu",
                   ) -> torch.Tensor:
    """Features of the painting, its longer side of ``side`` pixels, [M, C].

    ``place`` is torch's name of the network's device.
    """
    picture = tensor(task.exemplar.image.astype(np.float32) / np.float32(255))
    small = functional.interpolate(picture, scale_factor=side / max(picture.shape[-2:]),
                                   mode="bilinear", antialias=True)
    with torch.no_grad():
        return stacked(network(small.to(place))).flatten(1).T


def head_places(view: PhotoView, features: torch.Tensor) -> torch.Tensor:
    """Places of a feature map [C, h, w] that show the head, bool [h, w]."""
    share = functional.interpolate(torch.from_numpy(view.alpha)[None, None],
                                   size=features.shape[-2:], mode="area")
    return (share[0, 0] > 0.3).to(features.device)


def nearest_places(features: torch.Tensor, bank: torch.Tensor, *, chunk: int = 2048,
                   ) -> tuple[torch.Tensor, torch.Tensor]:
    """The nearest of a bank's features by cosine, for each feature.

    Parameters
    ----------
    features
        [N, C].
    bank
        [M, C].
    chunk
        Rows of ``features`` compared at once.

    Returns
    -------
    nearest, distance
        int64 [N], row of the bank; float [N], 1 - cosine.
    """
    unit = functional.normalize(features, dim=1, eps=1e-6)
    bank_unit = functional.normalize(bank, dim=1, eps=1e-6)
    found = [(part @ bank_unit.T).max(dim=1) for part in unit.split(chunk)]
    return (torch.cat([part.indices for part in found]),
            1.0 - torch.cat([part.values for part in found]))
