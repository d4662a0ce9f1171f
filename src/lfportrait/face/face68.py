"""face-api's networks: a tiny face detector and 68 landmarks; better on paintings than MediaPipe.

Both were published for face-api.js (MIT): the detector is a separable tiny YOLOv2 on a 416x416
picture, the landmark network four dense blocks on a 112x112 crop. They are small enough to be
computed with NumPy in hundredths of a second; importing torch for them took a second. Layers are
float32 [H, W, C].
"""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np
from PIL import Image
from safetensors.numpy import load_file

from .. import models
from ..arrays import Float32, Float64, UInt8

__all__ = ["detect_face", "detect_landmarks68", "landmarks_in_box"]


_ANCHORS = ((1.603231, 2.094468), (6.041143, 7.080126), (2.882459, 3.518061),
            (4.266906, 5.178857), (9.041765, 10.66308))


@functools.lru_cache(maxsize=4)
def _weights(name: str) -> dict[str, Float32]:
    return {key: np.asarray(value, np.float32)
            for key, value in load_file(str(models.fetch(name))).items()}


def _resized(image: UInt8, width: int, height: int) -> Float32:
    picture = Image.fromarray(image).resize((width, height), Image.Resampling.BILINEAR)
    return np.asarray(picture, np.float32)


def _convolve(x: Float32, weights: dict[str, Float32], name: str, stride: int = 1,
              padding: str = "same") -> Float32:
    """A convolution by HWIO filters, or a separable one by depthwise and pointwise filters."""
    bias = weights[f"{name}.bias"]
    filters = weights.get(f"{name}.filters")
    if filters is not None:
        x = _same(x, len(filters), stride) if padding == "same" else x
        # One product for each of the filter's places.
        return np.asarray(sum(part @ filters[row, column] for row, column, part in
                              _parts(x, len(filters), stride)) + bias, np.float32)
    depthwise = weights[f"{name}.depthwise_filter"][..., 0]
    x = _same(x, len(depthwise), stride) if padding == "same" else x
    mixed = sum(part * depthwise[row, column] for row, column, part in
                _parts(x, len(depthwise), stride))
    return np.asarray(mixed @ weights[f"{name}.pointwise_filter"][0, 0] + bias, np.float32)


def _same(x: Float32, kernel: int, stride: int) -> Float32:
    """Padded with zeros as TensorFlow does: more at the end where the padding is odd."""
    total = max((-(-len(x) // stride) - 1) * stride + kernel - len(x), 0)
    return np.pad(x, ((total // 2, total - total // 2),) * 2 + ((0, 0),))


def _parts(x: Float32, kernel: int, stride: int) -> Iterator[tuple[int, int, Float32]]:
    """What each place of a filter sees: its row and column, and every so many pixels from there."""
    last = len(x) - kernel + 1
    for row in range(kernel):
        for column in range(kernel):
            yield row, column, x[row:row + last:stride, column:column + last:stride]


def _pooled(x: Float32, stride: int) -> Float32:
    """The largest of each 2x2 pixels; what lies beyond the edge counts for nothing."""
    more = x.shape[0] % 2 if stride == 2 else 1
    x = np.pad(x, ((0, more), (0, more), (0, 0)), constant_values=-np.inf)
    return np.maximum.reduce([part for _, _, part in _parts(x, 2, stride)])


def _leaky(x: Float32) -> Float32:
    return np.maximum(x, np.float32(0.1) * x)


def detect_face(image: UInt8, least: float = 0.4,
                ) -> tuple[Float64, float] | None:
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
    frame = np.zeros((416, 416, 3), np.float32)
    frame[:high, :wide] = _resized(image, wide, high)
    x = (frame - np.array([117.001, 114.697, 97.404], np.float32)) / np.float32(255.0)
    for layer in range(6):
        x = _leaky(_convolve(x, weights, f"conv{layer}",
                             padding="valid" if layer == 0 else "same"))
        x = _pooled(x, 2 if layer < 5 else 1)
    for name in ("conv6", "conv7", "conv8"):
        if any(key.startswith(f"{name}.") for key in weights):
            x = _convolve(x, weights, name)
            if name != "conv8":
                x = _leaky(x)
    cells = len(x)
    x = x.reshape(cells, cells, 5, -1)
    score = 1 / (1 + np.exp(-x[..., 4]))
    best = int(score.argmax())
    row, column, anchor = np.unravel_index(best, score.shape)
    if score.reshape(-1)[best] < least:
        return None
    tx, ty, tw, th = (float(v) for v in x[row, column, anchor, :4])
    size = 416.0 / cells
    center = (column + 1 / (1 + np.exp(-tx))) * size, (row + 1 / (1 + np.exp(-ty))) * size
    box = np.exp(tw) * _ANCHORS[anchor][0] * size, np.exp(th) * _ANCHORS[anchor][1] * size
    corner = center[0] - box[0] / 2, center[1] - box[1] / 2
    return np.array([*corner, *box]) / scale, float(score.reshape(-1)[best])


def landmarks_in_box(image: UInt8, box: Float64) -> Float64:
    """The 68 landmarks [68, 2] of the face in a box (x, y, width, height)."""
    weights = _weights("face-landmarks-68")
    height, width = image.shape[:2]
    x0, y0 = int(max(box[0], 0)), int(max(box[1], 0))
    x1, y1 = int(min(box[0] + box[2], width)), int(min(box[1] + box[3], height))
    crop = np.ascontiguousarray(image[y0:y1, x0:x1])
    scale = 112.0 / max(crop.shape[:2])
    wide, high = round(crop.shape[1] * scale), round(crop.shape[0] * scale)
    left, top = (112 - wide) // 2, (112 - high) // 2
    frame = np.zeros((112, 112, 3), np.float32)
    frame[top:top + high, left:left + wide] = _resized(crop, wide, high)
    x = (frame - np.array([122.782, 117.001, 104.298], np.float32)) / np.float32(255.0)
    for block in range(4):
        x = np.maximum(_convolve(x, weights, f"dense{block}.conv0", 2), 0)
        total = x
        for layer in (1, 2, 3):
            total = total + _convolve(np.maximum(total, 0) if layer > 1 else x, weights,
                                      f"dense{block}.conv{layer}")
        x = np.maximum(total, 0)
    flat = x.mean(axis=(0, 1))
    points = (flat @ weights["fc.weights"] + weights["fc.bias"]).reshape(68, 2)
    return (points * 112.0 - (left, top)) / scale + (x0, y0)


def detect_landmarks68(image: UInt8) -> Float64 | None:
    """The 68 landmarks [68, 2] of the most certain face, or None."""
    found = detect_face(image)
    return None if found is None else landmarks_in_box(image, found[0])
