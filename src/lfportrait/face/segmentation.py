"""Mattes of the person and of the hair by MediaPipe's segmentation networks, run in torch.

The official TensorFlow Lite files are read as they are (`tflite`) and played (`player`). Two small
networks give person and hair; where the file of a third one, which tells six parts of a person
apart, is at hand, both come from that. All were trained on pictures that the person fills, upright,
so the picture is turned upright first, and the result turned back.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch.nn import functional

from .. import models
from ..errors import UserError
from ..labels import SEGMENTS
from .player import Player
from .tflite import read_tflite

__all__ = ["SEGMENTS", "hair_mask", "mattes", "parts", "person_matte"]


_MULTICLASS = "multiclass-segmentation"


@functools.lru_cache(maxsize=3)
def _network(path: Path) -> Player:
    return Player(read_tflite(path))


def _run(name: str, frame: torch.Tensor) -> torch.Tensor:
    """The first output [1, h, w, c] of a network for one picture [1, H, W, C]."""
    return _network(models.fetch(name))(frame)[0]


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


def _quarter_turns(up: NDArray[Any] | None) -> int:
    """Quarter turns (counter-clockwise) that put the direction ``up`` (x right, y down) on top."""
    if up is None:
        return 0
    x, y = float(up[0]), float(up[1])
    if abs(x) > abs(y):
        return 1 if x > 0 else 3
    return 0 if y <= 0 else 2


def _resized(image: NDArray[np.uint8], size: int) -> torch.Tensor:
    """The picture as the networks want it: [1, size, size, 3] in [0, 1]."""
    # Whole blocks of pixels first, where there are some: as good, and several times faster.
    picture = Image.fromarray(image).resize((size, size), Image.Resampling.BILINEAR,
                                            reducing_gap=1.0)
    return torch.from_numpy(np.asarray(picture, np.float32) / 255.0)[None]


def _full_size(mask: torch.Tensor, shape: tuple[int, ...], turns: int) -> NDArray[np.float32]:
    """One map [h, w] of a network as a matte of the picture before it was turned."""
    back = functional.interpolate(mask[None, None], size=shape, mode="bilinear",
                                  align_corners=False)
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
    and in less than one of 100; paintings want 512. The network of six parts always sees 256.
    """
    with _one_thread():
        return _hair(image, _quarter_turns(up), size)


def mattes(image: NDArray[np.uint8], up: NDArray[Any] | None = None, size: int = 512,
           ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """`person_matte` and `hair_mask` at the same time, on two threads."""
    turns = _quarter_turns(up)
    if models.available(_MULTICLASS):
        with _one_thread():
            shares, shape = _shares(image, turns)
        return _full_size(1 - shares[..., 0], shape, turns), _full_size(shares[..., 1], shape,
                                                                        turns)
    with _one_thread(), ThreadPoolExecutor(1) as other:
        person = other.submit(_person, image, turns)
        hair = _hair(image, turns, size)
        return person.result(), hair


def parts(image: NDArray[np.uint8], up: NDArray[Any] | None = None,
          ) -> dict[str, NDArray[np.float32]]:
    """How much of each pixel is each part of a person, by the network of six parts.

    This is written against the network's documented input and outputs, and tested with a stand-in
    of the same shapes: its file was not at hand.

    Parameters
    ----------
    image, up
        As for `person_matte`.

    Returns
    -------
    maps
        float32 [H, W] in [0, 1] for each name of `SEGMENTS`; they sum to 1.

    Raises
    ------
    UserError
        If the network (``multiclass-segmentation``) is missing, or its file has other outputs.
    """
    turns = _quarter_turns(up)
    with _one_thread():
        shares, shape = _shares(image, turns)
    return {name: _full_size(shares[..., index], shape, turns)
            for index, name in enumerate(SEGMENTS)}


def _upright(image: NDArray[np.uint8], turns: int) -> NDArray[np.uint8]:
    return np.ascontiguousarray(np.rot90(image, turns))


def _shares(image: NDArray[np.uint8], turns: int) -> tuple[torch.Tensor, tuple[int, ...]]:
    """Confidences [256, 256, 6] of the classes, and height and width of the upright picture."""
    upright = _upright(image, turns)
    result = _run(_MULTICLASS, _resized(upright, 256))[0]
    if result.shape[-1] != len(SEGMENTS):
        raise UserError(f"the network {_MULTICLASS} has {result.shape[-1]} classes instead of "
                        f"{len(SEGMENTS)}; get its file again: lfportrait models fetch "
                        f"{_MULTICLASS}")
    # The documents call its output logits in one place, confidences in another.
    ready = bool((result >= 0).all()) and bool(((result.sum(-1) - 1).abs() < 1e-3).all())
    return (result if ready else torch.softmax(result, -1)), upright.shape[:2]


def _person(image: NDArray[np.uint8], turns: int) -> NDArray[np.float32]:
    if models.available(_MULTICLASS):
        shares, shape = _shares(image, turns)
        return _full_size(1 - shares[..., 0], shape, turns)
    upright = _upright(image, turns)
    matte = _run("person-segmentation", _resized(upright, 256))
    return _full_size(matte[0, ..., 0], upright.shape[:2], turns)


def _hair(image: NDArray[np.uint8], turns: int, size: int) -> NDArray[np.float32]:
    if models.available(_MULTICLASS):
        shares, shape = _shares(image, turns)
        return _full_size(shares[..., 1], shape, turns)
    upright = _upright(image, turns)
    # The fourth channel is the hair of the frame before, of which nothing is known.
    frame = torch.cat([_resized(upright, size), torch.zeros(1, size, size, 1)], dim=-1)
    shares = torch.softmax(_run("hair-segmentation", frame), dim=-1)
    return _full_size(shares[0, ..., 1], upright.shape[:2], turns)
