"""Feature networks in plain torch, and the losses between pictures (Shen et al. 2023, Eq. 4, 5, 7).

The losses compare features, and contours. Of the networks the architectures are written out and the
state dicts' names kept.

=============  ============================================  ======================  =============
name           network                                       maps                    strides
=============  ============================================  ======================  =============
``vgg16``      VGG-16, ReLU outputs of the third block       conv3_1, 3_2, 3_3       4, 4, 4
``resnet50``   ResNet-50, outputs of the first two stages    layer1, layer2          4, 8
``vgg19-se``   16x smaller distilled VGG-19, third block     conv3_1 ... conv3_4     4, 4, 4, 4
``…-deep``     the same, to the fifth block                  conv5_1                 16
``embedded``   our own small network, trained to reproduce   conv3_1, conv3_4        4, 4
               ``vgg19-se`` (scripts/train_embedded_features.py); ships with the package
=============  ============================================  ======================  =============

Every network takes RGB in [0, 1], [1, 3, H, W], and does its own normalisation. Features are scaled
to a mean square of about 1, so that a loss weight means the same with any of them. A network
computes where it was loaded to, the CPU or a GPU; its pictures must lie there, too.
"""

import functools
import os
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import numba
import torch
from safetensors.torch import load
from torch.nn import functional

from .. import models
from ..errors import UserError
from ..measure import usable_cores

FeatureNetwork = Callable[[torch.Tensor], list[torch.Tensor]]
"""RGB in [0, 1], [1, 3, H, W] -> feature maps [1, C, h, w]."""

Weights = dict[str, torch.Tensor]


# As many threads as OpenMP was given, and no more than usable cores: torch does not know how little
# time a container gets. Numba shares torch's OpenMP, and sets the number to its own when it loads
# its threads. Sums depend on the number in their last digits, and must not on which of the two is
# loaded first.
numba.get_num_threads()  # loads them
_ASKED = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
torch.set_num_threads(min(max(1, int(_ASKED)) if _ASKED.isdigit() else usable_cores(),
                          usable_cores()))

_MEAN = torch.tensor([0.485, 0.456, 0.406])[None, :, None, None]
_STD = torch.tensor([0.229, 0.224, 0.225])[None, :, None, None]


def _read(path: Path) -> Weights:
    if path.suffix == ".safetensors":
        return {name: value.float() for name, value in load(path.read_bytes()).items()}
    return torch.load(path, map_location="cpu", weights_only=True)


def _entering(image: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """A picture as the first convolution takes it: of its mean and spread, in its numbers."""
    return ((image - _MEAN.to(image.device)) / _STD.to(image.device)).to(weight.dtype)


def _vgg16(weights: Weights) -> FeatureNetwork:
    """VGG-16 to conv3_3 (torchvision's ``features.N``)."""
    def run(image: torch.Tensor) -> list[torch.Tensor]:
        x = _entering(image, weights["features.0.weight"])
        maps = []
        for number in (0, 2, 5, 7, 10, 12, 14):
            if number in (5, 10):
                x = functional.max_pool2d(x, 2)
            x = torch.relu(functional.conv2d(x, weights[f"features.{number}.weight"],
                                             weights[f"features.{number}.bias"], padding=1))
            if number >= 10:
                maps.append(x)
        return maps
    return run


def _bottleneck(x: torch.Tensor, weights: Weights, name: str, stride: int, folded: bool,
                ) -> torch.Tensor:
    """One residual unit; v1 strides in its first convolution, v1.5 (torchvision) in its second."""
    def convolve(value: torch.Tensor, part: str, norm: str, step: int, padding: int,
                 ) -> torch.Tensor:
        bias = weights.get(f"{name}.{part}.bias")
        value = functional.conv2d(value, weights[f"{name}.{part}.weight"], bias, step, padding)
        if folded:
            return value
        mean, variance, scale, shift = (
            weights[f"{name}.{norm}.{key}"]
            for key in ("running_mean", "running_var", "weight", "bias"))
        return functional.batch_norm(value, mean, variance, scale, shift)

    first, second = (stride, 1) if folded else (1, stride)
    y = torch.relu(convolve(x, "conv1", "bn1", first, 0))
    y = torch.relu(convolve(y, "conv2", "bn2", second, 1))
    y = convolve(y, "conv3", "bn3", 1, 0)
    if f"{name}.downsample.0.weight" in weights:
        x = convolve(x, "downsample.0", "downsample.1", stride, 0)
    return torch.relu(x + y)


def _resnet50(weights: Weights) -> FeatureNetwork:
    """ResNet-50 to layer2: folded v1 weights, or torchvision's v1.5 with batch norm."""
    folded = "bn1.weight" not in weights

    def run(image: torch.Tensor) -> list[torch.Tensor]:
        first = weights["conv1.weight"]
        x = functional.conv2d(_entering(image, first), first, weights.get("conv1.bias"), 2, 3)
        if not folded:
            x = functional.batch_norm(x, weights["bn1.running_mean"], weights["bn1.running_var"],
                                      weights["bn1.weight"], weights["bn1.bias"])
        x = functional.max_pool2d(torch.relu(x), 3, 2, 1)
        maps = []
        for stage, units in ((1, 3), (2, 4)):
            for unit in range(units):
                x = _bottleneck(x, weights, f"layer{stage}.{unit}",
                                2 if stage > 1 and unit == 0 else 1, folded)
            maps.append(x)
        return maps
    return run


def _vgg19_se(weights: Weights, layers: str = "11 12 21 22 31 32 33 34",
              wanted: str = "3") -> FeatureNetwork:
    """The distilled VGG-19 to conv3_4; reflection padding, its color transform is conv0."""
    def run(image: torch.Tensor) -> list[torch.Tensor]:
        x = functional.conv2d(image, weights["conv0.weight"], weights["conv0.bias"])
        maps = []
        for name in layers.split():
            block, number = name[0], name[1]
            if block != "1" and number == "1":
                x = functional.max_pool2d(x, 2)
            x = functional.pad(x, (1, 1, 1, 1), mode="reflect")
            x = torch.relu(functional.conv2d(x, weights[f"conv{block}_{number}.weight"],
                                             weights[f"conv{block}_{number}.bias"]))
            if block == wanted:
                maps.append(x)
        return maps
    return run


def _vgg19_se_deep(weights: Weights) -> FeatureNetwork:
    """The distilled VGG-19 to conv5_1; pictures of at least 32 pixels."""
    return _vgg19_se(weights, "11 12 21 22 31 32 33 34 41 42 43 44 51", "5")


def embedded_features(weights: Weights) -> FeatureNetwork:
    """Our own network: seven convolutions, strides 1, 2, 1, 2, 1, 1, 1, and a linear read-out.

    It reproduces conv3_1 and conv3_4 of ``vgg19-se`` (64 channels each).
    """
    def run(image: torch.Tensor) -> list[torch.Tensor]:
        x = 2.0 * image - 1.0
        for layer, stride in enumerate((1, 2, 1, 2, 1, 1, 1)):
            x = functional.pad(x, (1, 1, 1, 1), mode="reflect")
            x = torch.relu(functional.conv2d(x, weights[f"conv{layer}.weight"],
                                             weights[f"conv{layer}.bias"], stride))
        x = torch.relu(functional.conv2d(x, weights["read.weight"], weights["read.bias"]))
        return [x[:, :64], x[:, 64:]]
    return run


_BUILDERS: dict[str, Callable[[Weights], FeatureNetwork]] = {
    "vgg16": _vgg16, "resnet50": _resnet50, "vgg19-se": _vgg19_se,
    "vgg19-se-deep": _vgg19_se_deep}
_HALVED = "vgg16", "resnet50"  # Networks that are large enough for it to matter.
_SHARED = {"vgg19-se-deep": "vgg19-se"}  # Networks whose weights are those of another.


def _normalised(network: FeatureNetwork, place: str = "cpu") -> FeatureNetwork:
    """The network with each map scaled to a mean square of 1 on a fixed smooth noise picture.

    The same architecture comes with weights of very different scale (Caffe's, torchvision's);
    after this a loss does not depend on which file was found.
    """
    generator = torch.Generator().manual_seed(0)
    noise = torch.rand(1, 3, 24, 24, generator=generator)
    picture = functional.interpolate(noise, size=(192, 192), mode="bicubic").clamp(0, 1)
    picture = picture.to(place)
    with torch.no_grad():
        scales = [1.0 / float(values.square().mean().sqrt().clamp_min(1e-8))
                  for values in network(picture)]
    return lambda image: [scale * values.float() for scale, values in zip(scales, network(image))]


def has_half_numbers() -> bool:
    """Whether this processor multiplies bfloat16 (AVX-512 BF16, AMX), two numbers for one."""
    if not torch.backends.cpu.get_cpu_capability().startswith("AVX512"):
        return False  # torch was limited to less, where bfloat16 takes ten times as long
    # torch reports this under its own names; a version without them counts as a processor without.
    return any(getattr(torch.cpu, name, bool)()
               for name in ("_is_avx512_bf16_supported", "_is_amx_tile_supported"))


def _halved(weights: Weights) -> Weights:
    """Weights as bfloat16, channels last."""
    return {name: value.to(torch.bfloat16, memory_format=torch.channels_last)
            if value.dim() == 4 else value.to(torch.bfloat16) for name, value in weights.items()}


@functools.lru_cache(maxsize=8)
def load_network(name: str, half: bool = False, place: str = "cpu") -> FeatureNetwork:
    """A feature network by its name, weights through the registry.

    Parameters
    ----------
    name : ``"vgg16"``, ``"resnet50"``, ``"vgg19-se"``, ``"vgg19-se-deep"`` or ``"embedded"``.
    half : Let a large network compute in bfloat16 where the processor does (`has_half_numbers`):
        half the time, three digits. For descents; what is measured should not depend on the
        processor. GPUs are fast enough without.
    place : Torch's name of where it computes, and where its pictures must lie
        (`lfportrait.device.torch_device`).

    Raises
    ------
    UserError : If the name is unknown or the weights are missing.
    """
    if name == "embedded":
        file = resources.files("lfportrait.stylize") / "embedded.safetensors"
        weights = {key: value.float().to(place) for key, value in load(file.read_bytes()).items()}
        return _normalised(embedded_features(weights), place)
    if name not in _BUILDERS:
        raise UserError(f"there is no feature network {name!r}; choose vgg16, resnet50, vgg19-se "
                        "or embedded")
    weights = _read(models.fetch(_SHARED.get(name, name)))
    if half and place == "cpu" and name in _HALVED and has_half_numbers():
        weights = _halved(weights)
    weights = {key: value.to(place) for key, value in weights.items()}
    return _normalised(_BUILDERS[name](weights), place)


def stacked(maps: list[torch.Tensor]) -> torch.Tensor:
    """Feature maps of several strides as one [C, h, w] at the finest of them."""
    size = maps[0].shape[-2:]
    return torch.cat([values if values.shape[-2:] == size else functional.interpolate(
        values, size=size, mode="bilinear", align_corners=False) for values in maps], dim=1)[0]


def content_loss(features: torch.Tensor, wanted: torch.Tensor,
                 inside: torch.Tensor | None = None) -> torch.Tensor:
    """Mean squared difference of two feature maps.

    Parameters
    ----------
    features, wanted : [C, h, w], of the render and of the content picture.
    inside : bool [h, w], the places that count; by default all.
    """
    squared = (features - wanted).square().mean(dim=0)
    return squared.mean() if inside is None else squared[inside].mean()


def nearest_neighbour_loss(features: torch.Tensor, style: torch.Tensor, *,
                           chunk: int = 512, half: bool = False) -> torch.Tensor:
    """Mean cosine distance of each feature to its nearest neighbour in the style (Eq. 4, 5).

    The distance is 1 - v1.v2 / (|v1| |v2|); Eq. 5 prints the 1 inside the numerator. The search
    itself has no gradient.

    Parameters
    ----------
    features : [N, C], features of the render.
    style : [M, C], features of the style.
    chunk : Rows of ``features`` compared at once.
    half : Search in bfloat16: of two neighbours that are equally near to three digits, either.

    Returns
    -------
    loss : Scalar in [0, 2]; 0 for a picture compared with itself.
    """
    unit = functional.normalize(features, dim=1, eps=1e-6)
    style_unit = functional.normalize(style, dim=1, eps=1e-6)
    with torch.no_grad():
        numbers = torch.bfloat16 if half else unit.dtype
        asked, known = unit.to(numbers), style_unit.to(numbers).T
        nearest = torch.cat([(part @ known).argmax(dim=1) for part in asked.split(chunk)])
    return (1.0 - (unit * style_unit[nearest]).sum(dim=1)).mean()


def laplacian(image: torch.Tensor, pool: int = 1) -> torch.Tensor:
    """The picture [3, H, W] convolved with the 3x3 Laplacian, after average pooling by ``pool``."""
    x = image[:, None]
    if pool > 1:
        x = functional.avg_pool2d(x, pool)
    kernel = torch.tensor([[0.0, 1.0, 0.0], [1.0, -4.0, 1.0], [0.0, 1.0, 0.0]])[None, None]
    return functional.conv2d(functional.pad(x, (1, 1, 1, 1), mode="replicate"),
                             kernel.to(image))[:, 0]


def laplacian_loss(image: torch.Tensor, wanted: torch.Tensor, *, pool: int = 1,
                   reduction: str = "mean") -> torch.Tensor:
    """Squared difference of two pictures' Laplacians (Eq. 7 of 2.2; a sum in the paper).

    Parameters
    ----------
    image, wanted : [3, H, W] in [0, 1].
    pool : Average pooling before the Laplacian: 1 sees single strokes, 4 to 16 the contours.
    reduction : ``"mean"`` or ``"sum"``.
    """
    squared = (laplacian(image, pool) - laplacian(wanted, pool)).square()
    return squared.sum() if reduction == "sum" else squared.mean()


def total_variation(image: torch.Tensor) -> torch.Tensor:
    """Half the mean squared difference of neighbours across plus that down, [1, 3, H, W] (ARF)."""
    across, down = image.diff(dim=-1), image.diff(dim=-2)
    return 0.5 * (across.square().mean() + down.square().mean())
