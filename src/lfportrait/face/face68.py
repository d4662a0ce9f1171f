"""face-api's networks in torch: a tiny face detector and 68 landmarks, kinder to paintings.

Both were published for face-api.js (MIT): the detector is a separable tiny YOLOv2 on a 416x416
picture, the landmark network four dense blocks on a 112x112 crop.
"""

from __future__ import annotations

import functools

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load_file
from torch.nn import functional

from .. import models

__all__ = ["detect_face", "detect_landmarks68", "landmarks_in_box"]

_ANCHORS = ((1.603231, 2.094468), (6.041143, 7.080126), (2.882459, 3.518061),
            (4.266906, 5.178857), (9.041765, 10.66308))


@functools.lru_cache(maxsize=4)
def _weights(name: str) -> dict[str, torch.Tensor]:
    return load_file(str(models.fetch(name)))


def _resized(image: NDArray[np.uint8], width: int, height: int) -> torch.Tensor:
    from PIL import Image

    picture = Image.fromarray(image).resize((width, height), Image.Resampling.BILINEAR)
    return torch.from_numpy(np.asarray(picture, np.float32).copy())


def _convolve(x: torch.Tensor, weights: dict[str, torch.Tensor], name: str, stride: int = 1,
              padding: str | int = "same") -> torch.Tensor:
    """A convolution from HWIO filters, or a separable one from depthwise + pointwise filters."""
    def same(value: torch.Tensor, kernel: int) -> torch.Tensor:
        # TensorFlow pads more at the end where the padding is odd.
        size = value.shape[-1]
        total = max((-(-size // stride) - 1) * stride + kernel - size, 0)
        return functional.pad(value, (total // 2, total - total // 2) * 2)

    if f"{name}.filters" in weights:
        kernel = weights[f"{name}.filters"].permute(3, 2, 0, 1)
        if padding == "same":
            x = same(x, kernel.shape[-1])
        return functional.conv2d(x, kernel, weights[f"{name}.bias"], stride=stride)
    depthwise = weights[f"{name}.depthwise_filter"].permute(2, 3, 0, 1)
    pointwise = weights[f"{name}.pointwise_filter"].permute(3, 2, 0, 1)
    if padding == "same":
        x = same(x, depthwise.shape[-1])
    x = functional.conv2d(x, depthwise, stride=stride, groups=x.shape[1])
    return functional.conv2d(x, pointwise, weights[f"{name}.bias"])


@torch.no_grad()
def detect_face(image: NDArray[np.uint8], least: float = 0.4,
                ) -> tuple[NDArray[np.float64], float] | None:
    """The box (x, y, width, height) of the most certain face, with its score, or None.

    Parameters
    ----------
    image
        uint8 [H, W, 3].
    least
        Score below which a box is no face.
    """
    weights = _weights("face-detector")
    height, width = image.shape[:2]
    scale = 416.0 / max(height, width)
    wide, high = round(width * scale), round(height * scale)
    frame = torch.zeros(416, 416, 3)
    frame[:high, :wide] = _resized(image, wide, high)
    x = (frame - torch.tensor([117.001, 114.697, 97.404])) / 255.0
    x = x.permute(2, 0, 1)[None]
    for layer in range(6):
        x = functional.leaky_relu(_convolve(x, weights, f"conv{layer}",
                                            padding="valid" if layer == 0 else "same"), 0.1)
        if layer < 5:
            x = functional.max_pool2d(functional.pad(x, (0, x.shape[-1] % 2) * 2,
                                                     value=float("-inf")), 2)
        else:
            x = functional.max_pool2d(functional.pad(x, (0, 1, 0, 1), value=float("-inf")), 2, 1)
    for name in ("conv6", "conv7", "conv8"):
        if any(key.startswith(f"{name}.") for key in weights):
            x = _convolve(x, weights, name)
            if name != "conv8":
                x = functional.leaky_relu(x, 0.1)
    cells = x.shape[-1]
    x = x[0].permute(1, 2, 0).reshape(cells, cells, 5, -1)
    score = torch.sigmoid(x[..., 4])
    best = int(score.argmax())
    row, column, anchor = np.unravel_index(best, score.shape)
    if score.flatten()[best] < least:
        return None
    tx, ty, tw, th = (float(v) for v in x[row, column, anchor, :4])
    size = 416.0 / cells
    center = (column + 1 / (1 + np.exp(-tx))) * size, (row + 1 / (1 + np.exp(-ty))) * size
    box = np.exp(tw) * _ANCHORS[anchor][0] * size, np.exp(th) * _ANCHORS[anchor][1] * size
    corner = center[0] - box[0] / 2, center[1] - box[1] / 2
    return np.array([*corner, *box]) / scale, float(score.flatten()[best])


@torch.no_grad()
def landmarks_in_box(image: NDArray[np.uint8], box: NDArray[np.float64]) -> NDArray[np.float64]:
    """The 68 landmarks [68, 2] of the face in a box (x, y, width, height)."""
    weights = _weights("face-landmarks-68")
    height, width = image.shape[:2]
    x0, y0 = int(max(box[0], 0)), int(max(box[1], 0))
    x1, y1 = int(min(box[0] + box[2], width)), int(min(box[1] + box[3], height))
    crop = np.ascontiguousarray(image[y0:y1, x0:x1])
    scale = 112.0 / max(crop.shape[:2])
    wide, high = round(crop.shape[1] * scale), round(crop.shape[0] * scale)
    left, top = (112 - wide) // 2, (112 - high) // 2
    frame = torch.zeros(112, 112, 3)
    frame[top:top + high, left:left + wide] = _resized(crop, wide, high)
    x = ((frame - torch.tensor([122.782, 117.001, 104.298])) / 255.0).permute(2, 0, 1)[None]
    for block in range(4):
        stride = 2
        x = functional.relu(_convolve(x, weights, f"dense{block}.conv0", stride))
        total = x
        for layer in (1, 2, 3):
            source = total if layer > 1 else x
            x_new = _convolve(functional.relu(source) if layer > 1 else x, weights,
                              f"dense{block}.conv{layer}")
            total = total + x_new
        x = functional.relu(total)
    x = functional.avg_pool2d(x, 7, 2)
    flat = x.permute(0, 2, 3, 1).reshape(1, -1)
    points = (flat @ weights["fc.weights"] + weights["fc.bias"]).reshape(68, 2).numpy()
    return (points * 112.0 - (left, top)) / scale + (x0, y0)


def detect_landmarks68(image: NDArray[np.uint8]) -> NDArray[np.float64] | None:
    """The 68 landmarks [68, 2] of the most certain face, or None."""
    found = detect_face(image)
    return None if found is None else landmarks_in_box(image, found[0])
