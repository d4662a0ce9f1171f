"""Plays the operations of a TensorFlow Lite network in torch.

Tensors keep TensorFlow's order [N, H, W, C]. Torch's convolutions want [N, C, H, W]: they get a
view with the axes swapped, which is torch's own "channels last" memory format: nothing is copied.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import torch
from torch.nn import functional

from ..errors import UserError
from .tflite import SAME, Graph, Operation

__all__ = ["Player"]

Tensor = torch.Tensor
Inputs = list[Any]
"""The inputs of a step: tensors, None for one that is left out."""


class Player:
    """A network that can be called.

    Parameters
    ----------
    graph
        What `lfportrait.face.tflite.read_tflite` read.

    Raises
    ------
    UserError
        If the network uses an operation that is not known here.

    Notes
    -----
    All real numbers are float32. Pictures of another size than the network was made for are
    possible where no step of it names a size.
    """

    def __init__(self, graph: Graph) -> None:
        strange = sorted({step.name for step in graph.operations} - set(_STEPS))
        if strange:
            raise UserError(f"the network uses operations that are not known: {', '.join(strange)}")
        self.graph = graph
        self.constants = {number: torch.tensor(values)
                          for number, values in graph.constants.items()}

    @torch.no_grad()
    def __call__(self, *frames: Tensor) -> list[Tensor]:
        """Play it.

        Parameters
        ----------
        frames
            The inputs, float32, pictures [1, H, W, C].

        Returns
        -------
        outputs
            Its outputs in the file's order, pictures [1, h, w, c].
        """
        values: dict[int, Any] = {-1: None, **self.constants}
        values.update(zip(self.graph.inputs, frames, strict=True))
        for step in self.graph.operations:
            result = _STEPS[step.name](step, [values[number] for number in step.inputs])
            results = result if isinstance(result, (list, tuple)) else (result,)
            values.update(zip(step.outputs, results))
        return [values[number] for number in self.graph.outputs]


def _activated(step: Operation, x: Tensor) -> Tensor:
    kind = step.options.get("activation", 0)
    if kind == 0:
        return x
    return {1: torch.relu, 2: functional.hardtanh, 3: functional.relu6, 4: torch.tanh}[kind](x)


def _pair(step: Operation, name: str) -> tuple[int, int]:
    """An option that has a value for rows and one for columns."""
    return int(step.options[f"{name}_y"]), int(step.options[f"{name}_x"])


def _first(x: Tensor) -> Tensor:
    """Channels first, [N, C, H, W]."""
    return x.permute(0, 3, 1, 2)


def _last(x: Tensor) -> Tensor:
    """Channels last, [N, H, W, C]."""
    return x.permute(0, 2, 3, 1)


def _same(sizes: tuple[int, int], kernel: tuple[int, int], stride: tuple[int, int]) -> list[int]:
    """TensorFlow's SAME padding [left, right, top, bottom]: the odd pixel goes to the end."""
    pads = []
    for size, reach, step in reversed(list(zip(sizes, kernel, stride))):
        total = max((-(-size // step) - 1) * step + reach - size, 0)
        pads += [total // 2, total - total // 2]
    return pads


def _padded(step: Operation, x: Tensor, kernel: tuple[int, int], value: float = 0.0) -> Tensor:
    """A picture [N, C, H, W] with the step's padding around it."""
    if step.options["padding"] != SAME:
        return x
    pads = _same((x.shape[2], x.shape[3]), kernel, _pair(step, "stride"))
    return functional.pad(x, pads, value=value) if any(pads) else x


def _convolution(step: Operation, got: Inputs) -> Tensor:
    x, filters, bias = _first(got[0]), got[1], got[2] if len(got) > 2 else None
    groups = 1
    if step.name == "DEPTHWISE_CONV_2D":  # filters [1, h, w, out], else [out, h, w, in]
        groups, filters = x.shape[1], filters.permute(3, 1, 2, 0)
    rows, columns = _pair(step, "dilation")
    reach = (filters.shape[1] - 1) * rows + 1, (filters.shape[2] - 1) * columns + 1
    result = functional.conv2d(_padded(step, x, reach), _first(filters), bias,
                               _pair(step, "stride"), dilation=(rows, columns), groups=groups)
    return _activated(step, _last(result))


def _transposed(step: Operation, x: Tensor, filters: Tensor, bias: Tensor | None,
                size: tuple[int, int] | None) -> Tensor:
    """A transposed convolution, filters [out, h, w, in]; the output's size may follow from it."""
    stride = _pair(step, "stride")
    full = functional.conv_transpose2d(_first(x), filters.permute(3, 0, 1, 2), None, stride)
    same = step.options["padding"] == SAME
    if size is None:
        size = (x.shape[1] * stride[0], x.shape[2] * stride[1]) if same else (
            full.shape[2], full.shape[3])
    kernel = (filters.shape[1], filters.shape[2])
    left, _, top, _ = _same(size, kernel, stride) if same else (0, 0, 0, 0)
    bottom, right = top + size[0], left + size[1]
    short = max(bottom - full.shape[2], 0), max(right - full.shape[3], 0)
    if any(short):  # nothing reaches there
        full = functional.pad(full, (0, short[1], 0, short[0]))
    result = _last(full[:, :, top:bottom, left:right])
    return _activated(step, result if bias is None else result + bias)


def _transpose_conv(step: Operation, got: Inputs) -> Tensor:
    size = got[0].tolist()
    return _transposed(step, got[2], got[1], got[3] if len(got) > 3 else None, (size[1], size[2]))


def _dense(step: Operation, got: Inputs) -> Tensor:
    x = got[0] if step.options["keep"] else got[0].reshape(-1, got[1].shape[1])
    return _activated(step, functional.linear(x, got[1], got[2] if len(got) > 2 else None))


def _average_pool(step: Operation, got: Inputs) -> Tensor:
    x, kernel, stride = _first(got[0]), _pair(step, "kernel"), _pair(step, "stride")
    pooled = functional.avg_pool2d(_padded(step, x, kernel), kernel, stride)
    if step.options["padding"] == SAME:  # padding does not count
        inside = _padded(step, torch.ones(1, 1, *x.shape[2:]), kernel)
        pooled = pooled / functional.avg_pool2d(inside, kernel, stride)
    return _activated(step, _last(pooled))


def _max_pool(step: Operation, got: Inputs) -> Tensor:
    kernel = _pair(step, "kernel")
    x = _padded(step, _first(got[0]), kernel, -math.inf)
    return _activated(step, _last(functional.max_pool2d(x, kernel, _pair(step, "stride"))))


def _max_pool_places(step: Operation, got: Inputs) -> list[Tensor]:
    found = functional.max_pool2d(_first(got[0]), _pair(step, "kernel"), _pair(step, "stride"),
                                  return_indices=True)
    return [_last(part) for part in found]


def _max_unpool(step: Operation, got: Inputs) -> Tensor:
    # By hand: torch's own asks sympy for its shapes, which takes a second to import.
    x, places = _first(got[0]), _first(got[1])
    size = [have * stride for have, stride in zip(x.shape[2:], _pair(step, "stride"))]
    spread = torch.zeros((*x.shape[:2], size[0] * size[1]), dtype=x.dtype)
    return _last(spread.scatter_(2, places.flatten(2), x.flatten(2)).unflatten(2, size))


def _resize(step: Operation, got: Inputs) -> Tensor:
    x, size = got[0], [int(value) for value in got[1]]
    align, half = step.options["align_corners"], step.options["half_pixel_centers"]
    if step.name == "RESIZE_BILINEAR" and (align or half):
        return _last(functional.interpolate(_first(x), size=size, mode="bilinear",
                                            align_corners=align))
    for axis, count in zip((1, 2), size):
        have = x.shape[axis]
        steps = torch.arange(count, dtype=torch.float32)
        if align and count > 1:
            place = steps * ((have - 1) / (count - 1))
        else:
            place = (steps + (0.5 if half else 0.0)) * (have / count)
        if step.name == "RESIZE_NEAREST_NEIGHBOR":
            nearest = torch.floor(place + 0.5) if align else torch.floor(place)
            x = x.index_select(axis, nearest.long().clamp(0, have - 1))
            continue
        low = place.long()
        weight = (place - low).reshape([-1 if index == axis else 1 for index in range(4)])
        x = torch.lerp(x.index_select(axis, low),
                       x.index_select(axis, (low + 1).clamp(max=have - 1)), weight)
    return x


def _prelu(_: Operation, got: Inputs) -> Tensor:
    x, slope = got
    if slope.numel() == slope.shape[-1]:  # one for each channel
        return _last(functional.prelu(_first(x), slope.reshape(-1)))
    return torch.where(x >= 0, x, x * slope)


def _pad(step: Operation, got: Inputs) -> Tensor:
    if step.name == "MIRROR_PAD":
        x = got[0]
        for axis, (before, after) in enumerate(got[1].tolist()):
            x = x.index_select(axis, _mirrored(x.shape[axis], before, after,
                                               int(step.options["mode"] == 0)))
        return x
    pads = [int(value) for value in got[1].flip(0).reshape(-1)]
    return functional.pad(got[0], pads, value=float(got[2]) if len(got) > 2 else 0.0)


def _mirrored(count: int, before: int, after: int, skip: int) -> Tensor:
    """Indices of an axis that is mirrored at its ends; ``skip`` 1 leaves out the last pixel."""
    if count == 1:
        return torch.zeros(before + 1 + after, dtype=torch.long)
    period = 2 * (count - skip)
    place = torch.arange(-before, count + after) % period
    return torch.where(place < count, place, period - 1 + skip - place)


def _shaped(step: Operation, got: Inputs) -> Tensor:
    shape = got[1].tolist() if len(got) > 1 else list(step.options["shape"])
    return got[0].reshape(shape)


def _squeezed(step: Operation, got: Inputs) -> Tensor:
    axes = step.options["axes"]
    return got[0].squeeze(tuple(axes)) if axes else got[0].squeeze()


def _split(step: Operation, got: Inputs) -> list[Tensor]:
    return list(got[1].chunk(step.options["count"], dim=int(got[0])))


def _space_to_depth(step: Operation, got: Inputs) -> Tensor:
    block = step.options["block"]
    count, height, width, channels = got[0].shape
    parts = got[0].reshape(count, height // block, block, width // block, block, channels)
    return parts.permute(0, 1, 3, 2, 4, 5).reshape(count, height // block, width // block, -1)


def _depth_to_space(step: Operation, got: Inputs) -> Tensor:
    block = step.options["block"]
    count, height, width, channels = got[0].shape
    parts = got[0].reshape(count, height, width, block, block, channels // block ** 2)
    return parts.permute(0, 1, 3, 2, 4, 5).reshape(count, height * block, width * block, -1)


def _reduced(reduce: Callable[..., Tensor]) -> Callable[[Operation, Inputs], Tensor]:
    """A reduction over the axes that the second input names."""
    def run(step: Operation, got: Inputs) -> Tensor:
        axes = [int(axis) for axis in got[1].reshape(-1)]
        return reduce(got[0], dim=axes, keepdim=bool(step.options["keep"]))
    return run


def _of_two(function: Callable[[Tensor, Tensor], Tensor]) -> Callable[[Operation, Inputs], Tensor]:
    return lambda step, got: _activated(step, function(got[0], got[1]))


def _of_one(function: Callable[[Tensor], Tensor]) -> Callable[[Operation, Inputs], Tensor]:
    return lambda _, got: function(got[0])


_STEPS: dict[str, Callable[[Operation, Inputs], Tensor | list[Tensor]]] = {
    "CONV_2D": _convolution, "DEPTHWISE_CONV_2D": _convolution,
    "TRANSPOSE_CONV": _transpose_conv, "FULLY_CONNECTED": _dense,
    "Convolution2DTransposeBias": lambda step, got: _transposed(step, got[0], got[1], got[2], None),
    "AVERAGE_POOL_2D": _average_pool, "MAX_POOL_2D": _max_pool,
    "MaxPoolingWithArgmax2D": _max_pool_places, "MaxUnpooling2D": _max_unpool,
    "RESIZE_BILINEAR": _resize, "RESIZE_NEAREST_NEIGHBOR": _resize,
    "PAD": _pad, "PADV2": _pad, "MIRROR_PAD": _pad,
    "RESHAPE": _shaped, "SQUEEZE": _squeezed, "SPLIT": _split,
    "EXPAND_DIMS": lambda _, got: got[0].unsqueeze(int(got[1])),
    "TRANSPOSE": lambda _, got: got[0].permute(got[1].tolist()),
    "SPACE_TO_DEPTH": _space_to_depth, "DEPTH_TO_SPACE": _depth_to_space,
    "CONCATENATION": lambda step, got: _activated(step, torch.cat(got, step.options["axis"])),
    "MEAN": _reduced(torch.mean), "SUM": _reduced(torch.sum), "REDUCE_MAX": _reduced(torch.amax),
    "ADD": _of_two(torch.add), "SUB": _of_two(torch.sub), "MUL": _of_two(torch.mul),
    "DIV": _of_two(torch.div), "MAXIMUM": _of_two(torch.maximum),
    "MINIMUM": _of_two(torch.minimum),
    "SQUARED_DIFFERENCE": _of_two(lambda x, y: (x - y).square()),
    "SOFTMAX": lambda step, got: torch.softmax(step.options["beta"] * got[0], -1),
    "PRELU": _prelu,
    "LEAKY_RELU": lambda step, got: functional.leaky_relu(got[0], step.options["alpha"]),
    "GELU": lambda step, got: functional.gelu(
        got[0], approximate="tanh" if step.options["approximate"] else "none"),
    "RELU": _of_one(torch.relu), "RELU6": _of_one(functional.relu6),
    "RELU_N1_TO_1": _of_one(functional.hardtanh), "ELU": _of_one(functional.elu),
    "HARD_SWISH": _of_one(functional.hardswish), "LOGISTIC": _of_one(torch.sigmoid),
    "TANH": _of_one(torch.tanh), "EXP": _of_one(torch.exp), "SQRT": _of_one(torch.sqrt),
    "RSQRT": _of_one(torch.rsqrt), "SQUARE": _of_one(torch.square), "ABS": _of_one(torch.abs),
    "NEG": _of_one(torch.neg),
    # Constants come out of the file as float32 already.
    "DEQUANTIZE": _of_one(lambda x: x),
}
