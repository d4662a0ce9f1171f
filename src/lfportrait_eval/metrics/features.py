"""Distances in the feature spaces of pretrained networks, each named for what it is; LPIPS.

* ``FID of 64, 192 and 768 dimensions``: the Frechet distance on the pooled features of the FID
  network (Inception-v3 of 2015-12-05) after its first and second max-pooling and after Mixed_6e, as
  pytorch-fid computes with ``--dims``. These are not the usual 2048-dimensional FID, and numbers of
  different dimensions don't compare. FID of 2048 dimensions, after the last block, takes the
  official file (`inception_features`).
* ``KID-768``: the kernel distance (cubic polynomial kernel, unbiased) on the same 768 features;
  unlike FID it is meaningful for few pictures.
* ``LPIPS``: v0.1 with VGG-16 or AlexNet, where its official files are at hand (`lpips`).
* ``feature distance``: mean squared distance of unit-length features of VGG-16 (or of the embedded
  network). It is built like LPIPS but has none of its learnt weights, so it is not called LPIPS.

LPIPS v0.1 (Zhang et al. 2018) is computed as its authors' program does it. Unit-length features of
five layers, their squared differences weighted by the learnt linear layers, averaged over each map
and summed over the layers. Over a mask, each layer's map is first enlarged to the picture's size,
as with ``spatial=True``, both pictures are black outside the mask, and the mean is taken inside it.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lfportrait import models
from lfportrait.arrays import Bool, Float64, UInt8
from lfportrait.device import torch_device
from lfportrait.example import Exemplar


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


def style_distance(pictures: Sequence[UInt8], exemplar: Sequence[UInt8],
                   device: str = "auto") -> dict[str, Any]:
    """FID of 64, 192 and 768 dimensions and KID-768 between two sets of pictures (or crops).

    ``fid_64``, ``fid_192``, ``fid_768``, ``kid_768`` and the numbers of pictures; see the module
    for what these are, and are not.
    """
    ours, theirs = (inception_features(those, device=device) for those in (pictures, exemplar))
    figures: dict[str, Any] = {f"fid_{name}": frechet_distance(ours[name], theirs[name])
                               for name in ours}
    figures["kid_768"] = kernel_distance(ours["768"], theirs["768"])
    return {**figures, "pictures": len(ours["64"]), "exemplar_pictures": len(theirs["64"])}


def feature_distance(a: NDArray[Any], b: NDArray[Any], mask: Bool | None = None,
                     network: str = "auto", device: str = "auto") -> float:
    """Mean squared distance of unit-length features of two pictures, float [H, W, 3] in [0, 1].

    0 (equal) to 4, mean over the layers. Pixels of ``mask`` bool [H, W] count. ``network`` is a
    name for `lfportrait.stylize.load_network`; ``"auto"``: vgg16 if it is at hand, else the
    embedded one.
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


@contextmanager
def exact(place: str) -> Iterator[None]:
    """Without gradients, and without the shorter numbers that NVIDIA's cards convolve with.

    What is measured should not depend on who measures. ``place`` is torch's name of the device.
    """
    import torch

    with torch.no_grad():
        if not place.startswith("cuda"):
            yield
            return
        with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
            yield


def read_weights(path: Path, place: str = "cpu") -> dict[str, Any]:
    """Weights by name, float32, on torch's device of that name."""
    import torch
    from safetensors.torch import load_file

    weights = (load_file(str(path)) if path.suffix == ".safetensors"
               else torch.load(path, map_location="cpu", weights_only=True))
    return {name: value.float().to(place) for name, value in weights.items()}


Features = dict[str, Float64]

CROP = 0.6
"""Side of a crop over the width of the face."""


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
    """Inception-v3 of TensorFlow's graph of 2015-12-05 as in pytorch-fid, batch norm folded."""

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


def inception_features(pictures: Iterable[UInt8], batch: int = 8, *,
                       full: bool = False, device: str = "auto") -> Features:
    """Pooled features of the FID network: ``"64"``, ``"192"``, ``"768"``; float64 [N, 64] etc.

    Pictures uint8 [H, W, 3] are resized to 299 x 299 (bilinear). ``full``: also those of 2048
    dimensions, after the last block (the usual FID).
    """
    import torch

    place = torch_device(device).place
    network = _Inception(_inception_weights(
        models.fetch("inception-2048" if full else "inception"), place))
    found: dict[str, list[Float64]] = {}
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


def spread_crops(pictures: list[UInt8], masks: list[Bool], size: int,
                 count: int, seed: int) -> list[UInt8]:
    """Square crops whose middles lie where the masks are set, spread evenly over the pictures.

    Pictures are uint8 [H, W, 3], masks bool [H, W] each; ``size`` is a side in pixels: a smaller
    picture gives smaller crops. There are ``count``; fewer where a mask is empty.
    """
    generator = np.random.default_rng(seed)
    crops = []
    for index in range(count):
        picture, mask = pictures[index % len(pictures)], masks[index % len(pictures)]
        height, width = picture.shape[:2]
        side = min(size, height, width)
        rows, columns = np.nonzero(mask)
        if not len(rows):
            continue
        pick = generator.integers(len(rows))
        y = int(np.clip(rows[pick] - side // 2, 0, height - side))
        x = int(np.clip(columns[pick] - side // 2, 0, width - side))
        crops.append(picture[y:y + side, x:x + side])
    return crops


def exemplar_crops(exemplar: Exemplar, count: int, seed: int) -> list[UInt8]:
    """Crops of a painting's person, or of its face where no mask is known.

    They are 0.6 of the face's width a side.
    """
    if exemplar.mask is None:
        mask = np.zeros(exemplar.image.shape[:2], bool)
        low, high = exemplar.landmarks.min(axis=0), exemplar.landmarks.max(axis=0)
        mask[max(int(low[1]), 0):int(high[1]) + 1, max(int(low[0]), 0):int(high[0]) + 1] = True
    else:
        mask = exemplar.mask > 0.5
    size = max(int(CROP * float(np.ptp(exemplar.landmarks[:, 0]))), 16)
    return spread_crops([exemplar.image], [mask], size, count, seed)


Backbone = Literal["vgg", "alex"]

LPIPS_NETWORKS: dict[Backbone, tuple[str, ...]] = {
    "vgg": ("lpips", "vgg16-torchvision"), "alex": ("lpips-alex", "alexnet")}
"""What `lpips` needs by backbone, names of the registry."""

Weights = dict[str, Any]

# Of torchvision's ``features.N``: number, stride, padding, side of a maximum of stride 2 that comes
# before it (0: none), and whether it is one of LPIPS' five maps.
_LAYERS: dict[Backbone, tuple[tuple[int, int, int, int, bool], ...]] = {
    "vgg": tuple((number, 1, 1, 2 if block and not at else 0, at == len(numbers) - 1)
                 for block, numbers in enumerate(((0, 2), (5, 7), (10, 12, 14), (17, 19, 21),
                                                  (24, 26, 28)))
                 for at, number in enumerate(numbers)),
    "alex": ((0, 4, 2, 0, True), (3, 1, 2, 3, True), (6, 1, 1, 3, True), (8, 1, 1, 0, True),
             (10, 1, 1, 0, True))}
_SHIFT = (-0.030, -0.088, -0.188)
_SCALE = (0.458, 0.448, 0.450)


@functools.lru_cache(maxsize=2)
def _weights(linear: Path, backbone: Path, place: str) -> tuple[Weights, Weights]:
    convolutions = {name: value for name, value in read_weights(backbone, place).items()
                    if name.startswith("features.")}  # nine tenths of the file classify
    return read_weights(linear, place), convolutions


def _maps(network: Backbone, weights: Weights, x: Any) -> list[Any]:
    """LPIPS' five maps of a picture [1, 3, H, W]."""
    import torch
    from torch.nn import functional

    maps = []
    for number, stride, padding, pooled, kept in _LAYERS[network]:
        if pooled:
            x = functional.max_pool2d(x, pooled, 2)
        x = torch.relu(functional.conv2d(x, weights[f"features.{number}.weight"],
                                         weights[f"features.{number}.bias"], stride, padding))
        if kept:
            maps.append(x)
    return maps


def lpips(a: NDArray[Any], b: NDArray[Any], mask: Bool | None = None, *,
          network: Backbone = "vgg", device: str = "auto") -> float:
    """LPIPS v0.1 of two pictures, float [H, W, 3] in [0, 1], at least 32 pixels wide and high.

    0 for equal pictures, about 0.7 for unlike ones. NaN where the mask, bool [H, W], is empty.
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
        first, second = (_unit_maps(network, convolutions, image, mask, place)
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


def _unit_maps(network: Backbone, weights: Weights, image: NDArray[Any], mask: Bool | None,
               place: str) -> list[Any]:
    """Unit-length features of a picture [H, W, 3], black outside the mask."""
    import torch

    values = np.asarray(image, np.float32)
    if mask is not None:
        values = values * np.asarray(mask, np.float32)[..., None]
    shift, scale = (torch.tensor(three)[:, None, None] for three in (_SHIFT, _SCALE))
    picture = torch.from_numpy(np.ascontiguousarray(values.transpose(2, 0, 1)))
    x = ((2.0 * picture - 1.0 - shift) / scale)[None].to(place)
    return [found / (found.norm(dim=1, keepdim=True) + 1e-10)
            for found in _maps(network, weights, x)]
