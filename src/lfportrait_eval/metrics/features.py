"""Distances in the feature spaces of pretrained networks, each named for what it is.

* ``FID of 64, 192 and 768 dimensions``: the Frechet distance on the pooled features of the FID
  network (Inception-v3 of 2015-12-05) after its first and second max-pooling and after Mixed_6e, as
  pytorch-fid computes with ``--dims``. These are not the usual 2048-dimensional FID, and numbers of
  different dimensions don't compare. FID of 2048 dimensions, after the last block, takes the
  official file (`inception.inception_features`).
* ``KID-768``: the kernel distance (cubic polynomial kernel, unbiased) on the same 768 features;
  unlike FID it is meaningful for few pictures.
* ``LPIPS``: v0.1 with VGG-16 or AlexNet, where its official files are at hand (`perceptual`).
* ``feature distance``: mean squared distance of unit-length features of VGG-16 (or of the embedded
  network). It is built like LPIPS but has none of its learnt weights, so it is not called LPIPS.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait import models
from lfportrait.device import torch_device

from .inception import inception_features
from .weights import exact

__all__ = ["feature_distance", "frechet_distance", "kernel_distance", "style_distance"]



def frechet_distance(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Frechet distance of two sets of features [N, D] and [M, D] taken as normal distributions.

    ``|m_a - m_b|^2 + tr(C_a + C_b - 2 (C_a C_b)^(1/2))`` (Heusel et al. 2017).
    """
    difference = a.mean(axis=0) - b.mean(axis=0)
    first, second = np.atleast_2d(np.cov(a.T)), np.atleast_2d(np.cov(b.T))
    values, vectors = np.linalg.eigh(first)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    # The trace of the root of C_a C_b is that of the symmetric root C_a^1/2 C_b C_a^1/2.
    cross = np.sqrt(np.maximum(np.linalg.eigvalsh(root @ second @ root), 0.0)).sum()
    return float(difference @ difference + np.trace(first) + np.trace(second) - 2.0 * cross)


def kernel_distance(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Unbiased squared maximum mean discrepancy with the kernel (x.y / D + 1)^3 (KID)."""
    def kernel(x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.floating]:
        return (x @ y.T / x.shape[1] + 1.0) ** 3

    within = 0.0
    for features in (a, b):
        values = kernel(features, features)
        count = len(features)
        within += float(values.sum() - np.trace(values)) / (count * (count - 1))
    return within - 2.0 * float(kernel(a, b).mean())


def style_distance(pictures: Sequence[NDArray[np.uint8]], exemplar: Sequence[NDArray[np.uint8]],
                   device: str = "auto") -> dict[str, Any]:
    """FID of 64, 192 and 768 dimensions and KID-768 between two sets of pictures (or crops).

    Returns
    -------
    figures
        ``fid_64``, ``fid_192``, ``fid_768``, ``kid_768`` and the numbers of pictures; see the
        module for what these are, and are not.
    """
    ours, theirs = (inception_features(those, device=device) for those in (pictures, exemplar))
    figures: dict[str, Any] = {f"fid_{name}": frechet_distance(ours[name], theirs[name])
                               for name in ours}
    figures["kid_768"] = kernel_distance(ours["768"], theirs["768"])
    return {**figures, "pictures": len(ours["64"]), "exemplar_pictures": len(theirs["64"])}


def feature_distance(a: NDArray[Any], b: NDArray[Any], mask: NDArray[np.bool_] | None = None,
                     network: str = "auto", device: str = "auto") -> float:
    """Mean squared distance of unit-length features of two pictures.

    Parameters
    ----------
    a, b
        float [H, W, 3] in [0, 1].
    mask
        bool [H, W], the pixels that count.
    network
        Name for `lfportrait.stylize.load_network`; ``"auto"``: vgg16 if it is at hand, else the
        embedded network.
    device
        Where the network computes, a choice of ``--device``.

    Returns
    -------
    distance
        0 (equal) to 4, mean over the layers.
    """
    import torch

    from lfportrait.stylize import load_network

    if network == "auto":
        network = "vgg16" if models.available("vgg16") else "embedded"
    place = torch_device(device).place
    run = load_network(network, place=place)

    def maps(image: NDArray[Any]) -> list[Any]:
        values = np.ascontiguousarray(np.asarray(image, np.float32).transpose(2, 0, 1))
        with exact(place):
            return [m / m.norm(dim=1, keepdim=True).clamp_min(1e-8)
                    for m in run(torch.from_numpy(values)[None].to(place))]

    distances = []
    for first, second in zip(maps(a), maps(b), strict=True):
        squared = (first - second).square().sum(dim=1)[0]
        if mask is not None:
            cover = torch.nn.functional.interpolate(
                torch.from_numpy(np.asarray(mask, np.float32))[None, None],
                size=squared.shape, mode="area")[0, 0].to(place)
            distances.append(float((squared * cover).sum() / cover.sum().clamp_min(1e-8)))
        else:
            distances.append(float(squared.mean()))
    return float(np.mean(distances))
