"""Mattes of the person and of the hair by MediaPipe's segmentation networks, run in torch.

The networks are stored as their tensors and a list of operations (``NAME.graph.json`` beside the
weights); `_run` plays that list. Both were trained on pictures that the person fills, upright, so
the picture is turned upright first, and the result turned back.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from safetensors.torch import load_file
from torch.nn import functional

from .. import models
from ..errors import UserError
from ..files import read_json

__all__ = ["hair_mask", "mattes", "person_matte"]


@functools.lru_cache(maxsize=2)
def _network(name: str) -> tuple[dict[str, Any], dict[str, torch.Tensor]]:
    path = models.fetch(name)
    graph = path.with_name(path.stem + ".graph.json")
    if not graph.is_file():
        raise UserError(f"{path.name} needs its list of operations, {graph.name}, beside it")
    steps = read_json(graph)
    weights = {key: value.float() for key, value in load_file(str(path)).items()}
    # Convolutions want [out, in, height, width]; once, not at every picture.
    order = {"CONV_2D": (0, 3, 1, 2), "DEPTHWISE_CONV_2D": (3, 0, 1, 2),
             "Convolution2DTransposeBias": (3, 0, 1, 2)}
    for step in steps["ops"]:
        if step["op"] in order:
            key = f"t{step['in'][1]}"
            weights[key] = weights[key].permute(order[step["op"]]).contiguous()
    return steps, weights


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let torch compute on the calling thread alone.

    The networks are hundreds of tiny steps: handing each out to several threads takes longer than
    doing it, twice as long on two idle cores and many times on busy ones.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _padded(x: torch.Tensor, kernel: tuple[int, int], stride: int) -> torch.Tensor:
    """TensorFlow's SAME padding: the odd pixel goes to the end."""
    pads = []
    for size, k in zip(reversed(x.shape[-2:]), reversed(kernel)):
        total = max((-(-size // stride) - 1) * stride + k - size, 0)
        pads += [total // 2, total - total // 2]
    return functional.pad(x, pads)


def _activated(x: torch.Tensor, kind: int) -> torch.Tensor:
    return {0: lambda v: v, 1: torch.relu, 3: functional.relu6}[kind](x)


def _convolution(step: dict[str, Any], x: torch.Tensor, weight: torch.Tensor,
                 bias: torch.Tensor | None) -> torch.Tensor:
    depthwise = step["op"] == "DEPTHWISE_CONV_2D"
    dilation = int(step.get("dilation", 1))
    reach = tuple((k - 1) * dilation + 1 for k in weight.shape[-2:])
    if step["padding"] == "SAME":
        x = _padded(x, (reach[0], reach[1]), step["stride"])
    x = functional.conv2d(x, weight, bias, stride=step["stride"], dilation=dilation,
                          groups=x.shape[1] if depthwise else 1)
    return _activated(x, step.get("act", 0))


def _transposed(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    full = functional.conv_transpose2d(x, weight, stride=2)
    return full[..., :2 * x.shape[-2], :2 * x.shape[-1]] + bias[None, :, None, None]


@torch.no_grad()
def _run(name: str, frame: torch.Tensor) -> torch.Tensor:
    """Play a network's list of operations on one picture [1, C, H, W]."""
    graph, weights = _network(name)
    values: dict[int, torch.Tensor] = {graph["input"]["tensor"]: frame}

    def tensor(number: int) -> torch.Tensor:
        return values[number] if number in values else weights[f"t{number}"]

    for step in graph["ops"]:
        kind, inputs, outputs = step["op"], step["in"], step["out"]
        if kind == "RESIZE_BILINEAR":
            values[outputs[0]] = functional.interpolate(
                tensor(inputs[0]), size=step["size"], mode="bilinear",
                align_corners=bool(step["align"]))
            continue
        got = [tensor(number) for number in inputs]
        x = got[0]
        if kind in ("CONV_2D", "DEPTHWISE_CONV_2D"):
            result = _convolution(step, x, got[1], got[2] if len(got) > 2 else None)
        elif kind == "Convolution2DTransposeBias":
            result = _transposed(x, got[1], got[2])
        elif kind == "AVERAGE_POOL_2D":
            result = functional.avg_pool2d(x, tuple(step["k"]), step["stride"])
        elif kind == "MaxPoolingWithArgmax2D":
            result, values[outputs[1]] = functional.max_pool2d(x, 2, 2, return_indices=True)
        elif kind == "MaxUnpooling2D":
            result = functional.max_unpool2d(x, got[1], [2, 2], [2, 2])
        elif kind == "CONCATENATION":
            result = torch.cat(got, dim=1)
        elif kind == "ADD":
            result = _activated(x + got[1], step.get("act", 0))
        elif kind == "MUL":
            result = _activated(x * got[1], step.get("act", 0))
        elif kind == "PRELU":
            result = functional.prelu(x, got[1].reshape(-1))
        elif kind == "RELU":
            result = torch.relu(x)
        elif kind == "HARD_SWISH":
            result = functional.hardswish(x)
        elif kind == "LOGISTIC":
            result = torch.sigmoid(x)
        else:
            raise UserError(f"the network {name} uses the operation {kind}, which is not known")
        values[outputs[0]] = result
    return values[graph["output"]["tensor"]]


def _quarter_turns(up: NDArray[Any] | None) -> int:
    """Quarter turns (counter-clockwise) that put the direction ``up`` (x right, y down) on top."""
    if up is None:
        return 0
    x, y = float(up[0]), float(up[1])
    if abs(x) > abs(y):
        return 1 if x > 0 else 3
    return 0 if y <= 0 else 2


def _resized(image: NDArray[np.uint8], size: int) -> torch.Tensor:
    # Whole blocks of pixels first, where there are some: as good, and several times faster.
    picture = Image.fromarray(image).resize((size, size), Image.Resampling.BILINEAR,
                                            reducing_gap=1.0)
    return torch.from_numpy(np.asarray(picture, np.float32) / 255.0).permute(2, 0, 1)[None]


def _full_size(mask: torch.Tensor, shape: tuple[int, ...], turns: int) -> NDArray[np.float32]:
    back = functional.interpolate(mask, size=shape, mode="bilinear", align_corners=False)
    return np.ascontiguousarray(np.rot90(back[0, 0].clamp(0, 1).numpy(), -turns))


def person_matte(image: NDArray[np.uint8], up: NDArray[Any] | None = None) -> NDArray[np.float32]:
    """How much of each pixel is the person.

    Parameters
    ----------
    image
        uint8 [H, W, 3], sRGB.
    up
        Direction [2] in the picture that is up in the world (x right, y down); the picture is
        turned to the nearest quarter before the network sees it.

    Returns
    -------
    matte
        float32 [H, W] in [0, 1], of the network's 256x256 resolution.

    Raises
    ------
    UserError
        If the network's weights are missing.
    """
    with _one_thread():
        return _person(image, _quarter_turns(up))


def hair_mask(image: NDArray[np.uint8], up: NDArray[Any] | None = None, size: int = 512,
              ) -> NDArray[np.float32]:
    """How much of each pixel is hair: float32 [H, W] in [0, 1]; arguments as `person_matte`.

    ``size`` is the side of the picture that the network sees, a multiple of 32. It was trained on
    512; on photos 384 takes half of the time and differs in less than one pixel of 200, 256 a third
    and in less than one of 100; paintings want 512.
    """
    with _one_thread():
        return _hair(image, _quarter_turns(up), size)


def mattes(image: NDArray[np.uint8], up: NDArray[Any] | None = None, size: int = 512,
           ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """`person_matte` and `hair_mask` at the same time, on two threads."""
    turns = _quarter_turns(up)
    with _one_thread(), ThreadPoolExecutor(1) as other:
        person = other.submit(_person, image, turns)
        hair = _hair(image, turns, size)
        return person.result(), hair


def _person(image: NDArray[np.uint8], turns: int) -> NDArray[np.float32]:
    upright = np.ascontiguousarray(np.rot90(image, turns))
    mask = _run("person-segmentation", _resized(upright, 256))
    return _full_size(mask, upright.shape[:2], turns)


def _hair(image: NDArray[np.uint8], turns: int, size: int) -> NDArray[np.float32]:
    upright = np.ascontiguousarray(np.rot90(image, turns))
    frame = torch.cat([_resized(upright, size), torch.zeros(1, 1, size, size)], dim=1)
    mask = torch.softmax(_run("hair-segmentation", frame), dim=1)[:, 1:]
    return _full_size(mask, upright.shape[:2], turns)
