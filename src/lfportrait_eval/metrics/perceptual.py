"""LPIPS v0.1 (Zhang et al. 2018), with VGG-16 or AlexNet, as its authors' program computes it.

Unit-length features of five layers, their squared differences weighted by the learnt linear layers,
averaged over each map and summed over the layers. Over a mask, each layer's map is first enlarged
to the picture's size, as with ``spatial=True``, both pictures are black outside the mask, and the
mean is taken inside it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lfportrait import models
from lfportrait.device import torch_device

from .features import exact, read_weights

__all__ = ["LPIPS_NETWORKS", "lpips"]

Backbone = Literal["vgg", "alex"]

LPIPS_NETWORKS: dict[Backbone, tuple[str, ...]] = {
    "vgg": ("lpips", "vgg16-torchvision"), "alex": ("lpips-alex", "alexnet")}
"""What `lpips` needs by backbone, names of the registry."""

Weights = dict[str, Any]

# The convolutions (torchvision's ``features.N``) up to each of LPIPS' five maps.
_VGG_BLOCKS = ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28))
# Of AlexNet: number, stride, padding, and whether a 3 x 3 maximum of stride 2 comes before it.
_ALEX_LAYERS = ((0, 4, 2, False), (3, 1, 2, True), (6, 1, 1, True), (8, 1, 1, False),
                (10, 1, 1, False))
_SHIFT = (-0.030, -0.088, -0.188)
_SCALE = (0.458, 0.448, 0.450)


@functools.lru_cache(maxsize=2)
def _weights(linear: Path, backbone: Path, place: str) -> tuple[Weights, Weights]:
    convolutions = {name: value for name, value in read_weights(backbone, place).items()
                    if name.startswith("features.")}  # nine tenths of the file classify
    return read_weights(linear, place), convolutions


def _vgg_maps(weights: Weights, x: Any) -> list[Any]:
    """The output of each block of VGG-16 of a picture [1, 3, H, W]."""
    import torch
    from torch.nn import functional

    maps = []
    for block, numbers in enumerate(_VGG_BLOCKS):
        if block:
            x = functional.max_pool2d(x, 2)
        for number in numbers:
            x = torch.relu(functional.conv2d(x, weights[f"features.{number}.weight"],
                                             weights[f"features.{number}.bias"], padding=1))
        maps.append(x)
    return maps


def _alex_maps(weights: Weights, x: Any) -> list[Any]:
    """The output of each convolution of AlexNet of a picture [1, 3, H, W]."""
    import torch
    from torch.nn import functional

    maps = []
    for number, stride, padding, pooled in _ALEX_LAYERS:
        if pooled:
            x = functional.max_pool2d(x, 3, 2)
        x = torch.relu(functional.conv2d(x, weights[f"features.{number}.weight"],
                                         weights[f"features.{number}.bias"], stride, padding))
        maps.append(x)
    return maps


_BACKBONES: dict[Backbone, Callable[[Weights, Any], list[Any]]] = {
    "vgg": _vgg_maps, "alex": _alex_maps}


def lpips(a: NDArray[Any], b: NDArray[Any], mask: NDArray[np.bool_] | None = None, *,
          network: Backbone = "vgg", device: str = "auto") -> float:
    """LPIPS v0.1 of two pictures.

    Parameters
    ----------
    a, b
        float [H, W, 3] in [0, 1], at least 32 pixels wide and high.
    mask
        bool [H, W], the pixels that count; all by default.
    network
        Whose features.
    device
        Where the network computes, a choice of ``--device``.

    Returns
    -------
    distance
        0 for equal pictures, about 0.7 for unlike ones. NaN where the mask is empty.

    Raises
    ------
    UserError
        If its networks (`LPIPS_NETWORKS`) are missing; nothing is downloaded.
    """
    import torch

    names = LPIPS_NETWORKS[network]
    models.require(names, download=False, purpose="LPIPS")
    if mask is not None and not mask.any():
        return float("nan")
    place = torch_device(device).place
    first_file, second_file = (models.fetch(name) for name in names)
    linear, convolutions = _weights(first_file, second_file, place)
    with exact(place):
        first, second = (_unit_maps(_BACKBONES[network], convolutions, image, mask, place)
                         for image in (a, b))
        layers = [((x - y).square() * linear[f"lin{layer}.model.1.weight"]).sum(
            dim=1, keepdim=True) for layer, (x, y) in enumerate(zip(first, second, strict=True))]
        if mask is None:
            return float(sum(layer.mean() for layer in layers))
        inside = torch.from_numpy(np.asarray(mask, bool)).to(place)
        whole = torch.stack([torch.nn.functional.interpolate(
            layer, size=inside.shape, mode="bilinear", align_corners=False)
            for layer in layers]).sum(0)
        return float(whole[0, 0][inside].mean())


def _unit_maps(maps: Callable[[Weights, Any], list[Any]], weights: Weights, image: NDArray[Any],
               mask: NDArray[np.bool_] | None, place: str) -> list[Any]:
    """Unit-length features of a picture [H, W, 3], black outside the mask."""
    import torch

    values = np.asarray(image, np.float32)
    if mask is not None:
        values = values * np.asarray(mask, np.float32)[..., None]
    shift, scale = (torch.tensor(three)[:, None, None] for three in (_SHIFT, _SCALE))
    picture = torch.from_numpy(np.ascontiguousarray(values.transpose(2, 0, 1)))
    x = ((2.0 * picture - 1.0 - shift) / scale)[None].to(place)
    return [found / (found.norm(dim=1, keepdim=True) + 1e-10) for found in maps(weights, x)]
