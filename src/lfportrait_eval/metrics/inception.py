"""The FID network: Inception-v3 of the TensorFlow graph of 2015-12-05, as pytorch-fid runs it."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait import models
from lfportrait.device import torch_device

from .weights import exact, read_weights

__all__ = ["inception_features"]

Features = dict[str, NDArray[np.float64]]


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
def _inception_weights(path: Path, place: str) -> dict[str, Any]:
    return {name: value.to(place) for name, value in _folded(read_weights(path)).items()}


class _Inception:
    """Inception-v3 of the TensorFlow graph of 2015, batch norm folded."""

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

    def reduced(self, x: Any, name: str) -> Any:
        """Mixed_7a: halves the size."""
        import torch

        three = self.convolve(self.convolve(x, f"{name}.branch3x3_1"), f"{name}.branch3x3_2", 2)
        seven = self.convolve(self.chain(x, f"{name}.branch7x7x3", 3), f"{name}.branch7x7x3_4", 2)
        return torch.cat([three, seven, torch.nn.functional.max_pool2d(x, 3, 2)], 1)

    def forked(self, x: Any, name: str, pooled: Any) -> Any:
        """Mixed_7b and 7c: branches that end in a row and a column beside each other."""
        import torch

        def fork(values: Any, branch: str) -> list[Any]:
            return [self.convolve(values, f"{name}.{branch}a", 1, (0, 1)),
                    self.convolve(values, f"{name}.{branch}b", 1, (1, 0))]

        return torch.cat([
            self.convolve(x, f"{name}.branch1x1"),
            *fork(self.convolve(x, f"{name}.branch3x3_1"), "branch3x3_2"),
            *fork(self.chain(x, f"{name}.branch3x3dbl", 2), "branch3x3dbl_3"),
            self.convolve(pooled, f"{name}.branch_pool")], 1)

    def last(self, x: Any) -> Any:
        """The blocks after Mixed_6e."""
        from torch.nn.functional import avg_pool2d, max_pool2d

        x = self.reduced(x, "Mixed_7a")
        x = self.forked(x, "Mixed_7b", avg_pool2d(x, 3, 1, 1, count_include_pad=False))
        # The TensorFlow graph takes the maximum in the last block.
        return self.forked(x, "Mixed_7c", max_pool2d(x, 3, 1, 1))

    def __call__(self, x: Any, full: bool = False) -> dict[str, Any]:
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
        found = {"64": first.mean((2, 3)), "192": second.mean((2, 3)), "768": x.mean((2, 3))}
        return {**found, **({"2048": self.last(x).mean((2, 3))} if full else {})}


def inception_features(pictures: Iterable[NDArray[np.uint8]], batch: int = 8, *,
                       full: bool = False, device: str = "auto") -> Features:
    """Pooled features of the FID network.

    Parameters
    ----------
    pictures
        uint8 [H, W, 3] each; resized to 299 x 299 (bilinear).
    batch
        Pictures at once.
    full
        Also the features of 2048 dimensions, after the last block (the usual FID).
    device
        Where the network computes, a choice of ``--device``.

    Returns
    -------
    features
        ``"64"``, ``"192"``, ``"768"``, and ``"2048"``: float64 [N, 64] and so on.

    Raises
    ------
    UserError
        If the weights (``inception``; ``inception-2048`` for the last) are missing.
    """
    import torch

    place = torch_device(device).place
    network = _Inception(_inception_weights(
        models.fetch("inception-2048" if full else "inception"), place))
    found: dict[str, list[NDArray[np.float64]]] = {}
    waiting: list[Any] = []

    def flush() -> None:
        with exact(place):
            for name, values in network(torch.cat(waiting).to(place), full).items():
                found.setdefault(name, []).append(values.cpu().double().numpy())
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
