"""The full-frame image-to-image network of `network`, and its training, in torch.

A U-Net after the full-frame configuration that the same laboratory published for video (Texler et
al. 2020), made small: residual blocks at an eighth of the size, skips, and a last
convolution that sees the photo. A small discriminator of patches keeps the strokes sharp.
"""

from __future__ import annotations

import time
from itertools import pairwise
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from lfportrait.arrays import Float32, UInt8

from ..adam import Adam

STRIDE = 8
"""Sides of a picture are padded to multiples of this."""
BLOCKS = 4


def _convolution(inputs: int, outputs: int, side: int = 3, stride: int = 1) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, side, stride, side // 2, padding_mode="reflect")


class _Residual(nn.Module):
    """Two convolutions beside the identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first, self.second = _convolution(channels, channels), _convolution(channels, channels)
        self.norm = nn.InstanceNorm2d(channels, affine=True)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Same size."""
        y = functional.leaky_relu(self.norm(self.first(x)), 0.2)
        return x + self.second(y)


class Painter(nn.Module):
    """Photo [1, 3, H, W] in [0, 1], sides multiples of `STRIDE`, to a painting of that size.

    Blocks of 2 x 2 pixels come in and go out as channels: the costly layers at full size are saved.
    The first layer has ``width`` channels; the deepest has four times as many.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        sizes = [width, 2 * width, 4 * width]
        self.enter = _convolution(12, width, 5)
        self.down = nn.ModuleList(_convolution(a, b, 3, 2) for a, b in pairwise(sizes))
        self.blocks = nn.ModuleList(_Residual(sizes[-1]) for _ in range(BLOCKS))
        self.up = nn.ModuleList(_convolution(b + a, a) for a, b in pairwise(sizes))
        self.smooth = _convolution(width + 12, width)
        self.leave = _convolution(width, 12)

    def forward(self, photo: torch.Tensor) -> torch.Tensor:
        """Painting in [0, 1]."""
        blocks = functional.pixel_unshuffle(2 * photo - 1, 2)
        x = functional.leaky_relu(self.enter(blocks), 0.2)
        skips = []
        for layer in self.down:
            skips.append(x)
            x = functional.leaky_relu(layer(x), 0.2)
        for block in self.blocks:
            x = block(x)
        for layer, skip in zip(reversed(list(self.up)), reversed(skips)):
            x = functional.interpolate(x, scale_factor=2.0, mode="nearest")
            x = functional.leaky_relu(layer(torch.cat([x, skip], 1)), 0.2)
        x = functional.leaky_relu(self.smooth(torch.cat([x, blocks], 1)), 0.2)
        return 0.5 + 0.5 * torch.tanh(functional.pixel_shuffle(self.leave(x), 2))


def _discriminator() -> nn.Module:
    """Judges patches of photo and painting side by side."""
    return nn.Sequential(
        nn.Conv2d(6, 12, 4, 2, 1), nn.LeakyReLU(0.2),
        nn.Conv2d(12, 24, 4, 2, 1), nn.InstanceNorm2d(24), nn.LeakyReLU(0.2),
        nn.Conv2d(24, 1, 4, 1, 1))


def _tensor(image: NDArray[np.generic], place: str = "cpu") -> torch.Tensor:
    """[H, W, 3], uint8 or float in [0, 1], as float [1, 3, H', W'], sides padded."""
    values = np.asarray(image, np.float32) / (255 if image.dtype == np.uint8 else 1)
    tensor = torch.from_numpy(np.ascontiguousarray(values.transpose(2, 0, 1)))[None]
    height, width = tensor.shape[2:]
    tensor = functional.pad(tensor, (0, -width % STRIDE, 0, -height % STRIDE), mode="replicate")
    return tensor.contiguous(memory_format=torch.channels_last).to(place)


def _edges(image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    return image[..., 1:] - image[..., :-1], image[..., 1:, :] - image[..., :-1, :]


def train(pairs: list[tuple[UInt8, Float32]], width: int, *,
          steps: int, seconds: float, rate: float, adversarial: float, seed: int,
          place: str = "cpu") -> tuple[Painter, int, float]:
    """Train a painter on photos uint8 [H, W, 3] and their paintings float32 [H, W, 3] in [0, 1].

    Returns the network (on its device), the steps taken, and the mean absolute difference over the
    last steps.

    Parameters
    ----------
    steps, seconds : The training ends after so many steps (0: no limit) or, without that limit,
        seconds.
    rate : Of Adam; it falls to a tenth towards the end.
    adversarial : Weight of the discriminator against 4 for the mean absolute difference.
    seed : Of the weights and of the order; with ``steps`` the same seed gives the same network.
    place : Torch's name of the device that trains; the weights begin the same on all.
    """
    shown = [(_tensor(photo, place), _tensor(painting, place)) for photo, painting in pairs]
    order = np.random.default_rng(seed)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        painter, judge = Painter(width), _discriminator()
    for network in (painter, judge):
        cast(Any, network).to(place, memory_format=torch.channels_last)
    optimisers = [Adam(network.parameters(), rate, (0.5, 0.99)) for network in (painter, judge)]
    start, step, losses = time.perf_counter(), 0, [1.0]
    while True:
        done = step / steps if steps else (time.perf_counter() - start) / max(seconds, 1e-3)
        if done >= 1:
            break
        for optimiser in optimisers:
            optimiser.rate = rate * min(1.0, max(0.1, 2.0 - 1.9 * done))
        photo, wanted = shown[int(order.integers(len(shown)))]
        # Exposure and color of the light vary; the painting stays.
        light = torch.from_numpy(order.uniform(0.85, 1.15, (1, 3, 1, 1)).astype(np.float32))
        light = light.to(place)
        photo = (photo * light).clamp(0, 1)
        made = painter(photo)
        loss = (made - wanted).abs().mean()
        losses.append(float(loss.detach()))
        total = 4 * loss + sum(2 * (a - b).abs().mean()
                               for a, b in zip(_edges(made), _edges(wanted)))
        if adversarial > 0:
            total = total + adversarial * (judge(torch.cat([photo, made], 1)) - 1).square().mean()
        optimisers[0].clear()
        total.backward()
        optimisers[0].step()
        if adversarial > 0:
            real = judge(torch.cat([photo, wanted], 1))
            fake = judge(torch.cat([photo, made.detach()], 1))
            optimisers[1].clear()
            ((real - 1).square().mean() + fake.square().mean()).backward()
            optimisers[1].step()
        step += 1
    return painter.eval(), step, float(np.mean(losses[-20:]))


@torch.no_grad()
def run(painter: Painter, photo: UInt8) -> Float32:
    """Painting float32 [H, W, 3] in [0, 1] of a photo uint8 [H, W, 3]."""
    height, width = photo.shape[:2]
    place = next(painter.parameters()).device
    made = painter(_tensor(photo, str(place)))[0, :, :height, :width].permute(1, 2, 0)
    return np.ascontiguousarray(made.clamp(0, 1).cpu().numpy(), np.float32)
