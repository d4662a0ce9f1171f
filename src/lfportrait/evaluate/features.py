"""Distances in the feature spaces of pretrained networks, each named for what it is.

* ``FID of 64, 192 and 768 dimensions``: the Frechet distance on the pooled features of the FID
  network (Inception-v3 of 2015-12-05) after its first and second max-pooling and after Mixed_6e, as
  pytorch-fid computes with ``--dims``. These are not the usual 2048-dimensional FID, and numbers of
  different dimensions don't compare.
* ``KID-768``: the kernel distance (cubic polynomial kernel, unbiased) on the same 768 features;
  unlike FID it is meaningful for few pictures.
* ``LPIPS``: v0.1 with VGG-16, where its two official files are at hand.
* ``feature distance``: mean squared distance of unit-length features of VGG-16 (or of the embedded
  network). It is built like LPIPS but has none of its learnt weights, so it is not called LPIPS.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import models

__all__ = ["LPIPS_NETWORKS", "feature_distance", "frechet_distance", "inception_features",
           "kernel_distance", "lpips", "style_distance"]

LPIPS_NETWORKS = ("lpips", "vgg16-torchvision")
"""What `lpips` needs, names of the registry."""

Features = dict[str, NDArray[np.float64]]


def _read(path: Path) -> dict[str, Any]:
    """Weights by name, float32."""
    import torch
    from safetensors.torch import load_file

    weights = (load_file(str(path)) if path.suffix == ".safetensors"
               else torch.load(path, map_location="cpu", weights_only=True))
    return {name: value.float() for name, value in weights.items()}


def _folded(weights: dict[str, Any], epsilon: float = 1e-3) -> dict[str, Any]:
    """Convolutions with the batch norm behind each folded into weight and bias.

    pytorch-fid's ``NAME.conv.weight`` and ``NAME.bn.{weight,bias,running_mean,running_var}`` become
    ``NAME.weight`` and ``NAME.bias``; other weights stay as they are.
    """
    folded = dict(weights)
    for key in [key for key in weights if key.endswith(".conv.weight")]:
        name = key.removesuffix(".conv.weight")
        scale, shift, mean, variance = (
            folded.pop(f"{name}.bn.{part}")
            for part in ("weight", "bias", "running_mean", "running_var"))
        scale = scale / (variance + epsilon).sqrt()
        folded[f"{name}.weight"] = folded.pop(key) * scale[:, None, None, None]
        folded[f"{name}.bias"] = shift - mean * scale
    return folded


@functools.lru_cache(maxsize=1)
def _inception_weights(path: Path) -> dict[str, Any]:
    return _folded(_read(path))


class _Inception:
    """Inception-v3 of the TensorFlow graph of 2015, batch norm folded, to Mixed_6e."""

    def __init__(self, weights: dict[str, Any]) -> None:
        self.weights = weights

    def convolve(self, x: Any, name: str, stride: int = 1, padding: Any = 0) -> Any:
        """A convolution and its ReLU."""
        import torch

        return torch.relu(torch.nn.functional.conv2d(
            x, self.weights[f"{name}.weight"], self.weights[f"{name}.bias"], stride, padding))

    def chain(self, x: Any, name: str, count: int) -> Any:
        """Convolutions NAME_1 ... NAME_count that keep the size."""
        for index in range(1, count + 1):
            kernel = self.weights[f"{name}_{index}.weight"].shape[2:]
            x = self.convolve(x, f"{name}_{index}", 1, (kernel[0] // 2, kernel[1] // 2))
        return x

    def block(self, x: Any, name: str, chains: dict[str, int]) -> Any:
        """Parallel branches: 1x1, chains of convolutions, and an average pooling."""
        import torch

        # The TensorFlow graph's average counts no padding.
        pooled = torch.nn.functional.avg_pool2d(x, 3, 1, 1, count_include_pad=False)
        branches = [self.convolve(x, f"{name}.branch1x1")]
        branches += [self.chain(x, f"{name}.{branch}", count) for branch, count in chains.items()]
        branches.append(self.convolve(pooled, f"{name}.branch_pool"))
        return torch.cat(branches, 1)

    def __call__(self, x: Any) -> dict[str, Any]:
        """Pooled features by dimension of pictures [N, 3, 299, 299] in [-1, 1]."""
        import torch
        from torch.nn.functional import max_pool2d

        x = self.convolve(x, "Conv2d_1a_3x3", 2)
        x = self.convolve(x, "Conv2d_2a_3x3")
        first = max_pool2d(self.convolve(x, "Conv2d_2b_3x3", 1, 1), 3, 2)
        x = self.convolve(first, "Conv2d_3b_1x1")
        second = max_pool2d(self.convolve(x, "Conv2d_4a_3x3"), 3, 2)
        x = second
        for name in ("Mixed_5b", "Mixed_5c", "Mixed_5d"):
            x = self.block(x, name, {"branch5x5": 2, "branch3x3dbl": 3})
        double = self.chain(x, "Mixed_6a.branch3x3dbl", 2)
        x = torch.cat([self.convolve(x, "Mixed_6a.branch3x3", 2),
                       self.convolve(double, "Mixed_6a.branch3x3dbl_3", 2),
                       max_pool2d(x, 3, 2)], 1)
        for name in ("Mixed_6b", "Mixed_6c", "Mixed_6d", "Mixed_6e"):
            x = self.block(x, name, {"branch7x7": 3, "branch7x7dbl": 5})
        return {"64": first.mean((2, 3)), "192": second.mean((2, 3)), "768": x.mean((2, 3))}


def inception_features(pictures: Iterable[NDArray[np.uint8]], batch: int = 8) -> Features:
    """Pooled features of the FID network.

    Parameters
    ----------
    pictures
        uint8 [H, W, 3] each; resized to 299 x 299 (bilinear).
    batch
        Pictures at once.

    Returns
    -------
    features
        ``"64"``, ``"192"``, ``"768"``: float64 [N, 64], [N, 192], [N, 768].

    Raises
    ------
    UserError
        If the weights (``inception``) are missing.
    """
    import torch

    network = _Inception(_inception_weights(models.fetch("inception")))
    found: dict[str, list[NDArray[np.float64]]] = {"64": [], "192": [], "768": []}
    waiting: list[Any] = []

    def flush() -> None:
        with torch.no_grad():
            for name, values in network(torch.cat(waiting)).items():
                found[name].append(values.double().numpy())
        waiting.clear()

    for picture in pictures:
        image = torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1)))[None].float()
        if image.shape[2:] != (299, 299):
            image = torch.nn.functional.interpolate(image, size=(299, 299), mode="bilinear",
                                                    align_corners=False)
        waiting.append((image - 128.0) / 128.0)
        if len(waiting) == batch:
            flush()
    if waiting:
        flush()
    return {name: np.concatenate(values) for name, values in found.items()}


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
                   ) -> dict[str, Any]:
    """FID of 64, 192 and 768 dimensions and KID-768 between two sets of pictures (or crops).

    Returns
    -------
    figures
        ``fid_64``, ``fid_192``, ``fid_768``, ``kid_768`` and the numbers of pictures; see the
        module for what these are, and are not.
    """
    ours, theirs = inception_features(pictures), inception_features(exemplar)
    figures: dict[str, Any] = {f"fid_{name}": frechet_distance(ours[name], theirs[name])
                               for name in ours}
    figures["kid_768"] = kernel_distance(ours["768"], theirs["768"])
    return {**figures, "pictures": len(ours["64"]), "exemplar_pictures": len(theirs["64"])}


def feature_distance(a: NDArray[Any], b: NDArray[Any], mask: NDArray[np.bool_] | None = None,
                     network: str = "auto") -> float:
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

    Returns
    -------
    distance
        0 (equal) to 4, mean over the layers.
    """
    import torch

    from ..stylize import load_network

    if network == "auto":
        network = "vgg16" if models.available("vgg16") else "embedded"
    run = load_network(network)

    def maps(image: NDArray[Any]) -> list[Any]:
        values = np.ascontiguousarray(np.asarray(image, np.float32).transpose(2, 0, 1))
        with torch.no_grad():
            return [m / m.norm(dim=1, keepdim=True).clamp_min(1e-8)
                    for m in run(torch.from_numpy(values)[None])]

    distances = []
    for first, second in zip(maps(a), maps(b), strict=True):
        squared = (first - second).square().sum(dim=1)[0]
        if mask is not None:
            cover = torch.nn.functional.interpolate(
                torch.from_numpy(np.asarray(mask, np.float32))[None, None],
                size=squared.shape, mode="area")[0, 0]
            distances.append(float((squared * cover).sum() / cover.sum().clamp_min(1e-8)))
        else:
            distances.append(float(squared.mean()))
    return float(np.mean(distances))


# The convolutions of VGG-16 (torchvision's ``features.N``) up to each of LPIPS' five maps.
_VGG_BLOCKS = ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28))
_LPIPS_SHIFT = (-0.030, -0.088, -0.188)
_LPIPS_SCALE = (0.458, 0.448, 0.450)


@functools.lru_cache(maxsize=1)
def _lpips_weights(linear: Path, backbone: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    convolutions = {name: value for name, value in _read(backbone).items()
                    if name.startswith("features.")}  # nine tenths of the file classify
    return _read(linear), convolutions


def lpips(a: NDArray[Any], b: NDArray[Any]) -> float:
    """LPIPS v0.1 with VGG-16 of two pictures (Zhang et al. 2018).

    Unit-length features of five layers, their squared differences weighted by the learnt linear
    layers, averaged over each map and summed over the layers.

    Parameters
    ----------
    a, b
        float [H, W, 3] in [0, 1], at least 16 pixels wide and high.

    Returns
    -------
    distance
        0 for equal pictures, about 0.7 for unlike ones.

    Raises
    ------
    UserError
        If its networks (`LPIPS_NETWORKS`) are missing; nothing is downloaded.
    """
    import torch

    models.require(LPIPS_NETWORKS, download=False, purpose="LPIPS")
    linear, convolutions = _lpips_weights(*(models.fetch(name) for name in LPIPS_NETWORKS))
    with torch.no_grad():
        first, second = (_lpips_maps(convolutions, image) for image in (a, b))
        return float(sum(
            ((x - y).square() * linear[f"lin{layer}.model.1.weight"]).sum(dim=1).mean()
            for layer, (x, y) in enumerate(zip(first, second, strict=True))))


def _lpips_maps(weights: dict[str, Any], image: NDArray[Any]) -> list[Any]:
    """Unit-length features of a picture [H, W, 3] after each block of VGG-16."""
    import torch
    from torch.nn import functional

    shift, scale = (torch.tensor(values)[:, None, None] for values in (_LPIPS_SHIFT, _LPIPS_SCALE))
    values = np.ascontiguousarray(np.asarray(image, np.float32).transpose(2, 0, 1))
    x = ((2.0 * torch.from_numpy(values) - 1.0 - shift) / scale)[None]
    maps = []
    for block, numbers in enumerate(_VGG_BLOCKS):
        if block:
            x = functional.max_pool2d(x, 2)
        for number in numbers:
            x = torch.relu(functional.conv2d(x, weights[f"features.{number}.weight"],
                                             weights[f"features.{number}.bias"], padding=1))
        maps.append(x / (x.norm(dim=1, keepdim=True) + 1e-10))
    return maps
