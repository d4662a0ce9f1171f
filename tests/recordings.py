"""Pictures and forms of modelled heads, kept as files: what only looks at them compiles no kernel.

`scripts/modelled_head` made what lies in ``tests/recorded``. With ``LFPORTRAIT_RECORD=1`` a test
makes its own again; that all are what the model gives is a slow test of their own
(``tests/project/test_modelled_head.py``).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lfportrait.capture import Camera
from lfportrait.example import Exemplar
from lfportrait.field import VoxelField

FOLDER = Path(__file__).parent / "recorded"


class Picture(NamedTuple):
    """A photograph, and what else was asked for, as `modelled_head.Picture` has it."""

    image: Any  # uint8 [H, W, 4]
    more: Any


def _camera_arrays(cameras: Camera) -> dict[str, Any]:
    return {"pose": np.asarray(cameras.pose), "focal": np.asarray(cameras.focal),
            "center": np.asarray(cameras.center), "width": np.asarray(cameras.width),
            "height": np.asarray(cameras.height)}


def _kept(name: str, made: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    path = FOLDER / f"{name}.npz"
    if os.environ.get("LFPORTRAIT_RECORD") == "1":
        FOLDER.mkdir(exist_ok=True)
        np.savez_compressed(path, **made())
    assert path.exists(), f"LFPORTRAIT_RECORD=1 makes {path}"
    with np.load(path) as data:
        return {key: data[key] for key in data.files}


def make_photographs(cameras: Camera, more: str = "") -> dict[str, Any]:
    """The demo's head from all cameras, and the cameras."""
    from modelled_head import SITTER, photograph

    shots = [photograph(SITTER, cameras, view) for view in range(len(cameras))]
    return {name: np.stack([getattr(shot, name) for shot in shots])
            for name in ("image", more) if name} | _camera_arrays(cameras)


def make_painting(style: str, width: int, height: int, turn: float) -> dict[str, Any]:
    """A painting, its landmarks and mask."""
    from modelled_head import painted_exemplar

    made = painted_exemplar(style, width, height, turn=turn)
    return {"image": made.image, "landmarks": made.landmarks,
            "mask": np.uint8(np.round(made.mask * 255)), "style": style, "turn": turn}


def make_form(person: str) -> dict[str, Any]:
    """The form of one of `modelled_head.PEOPLE` on 65 points each way."""
    from modelled_head import PEOPLE, head_field, studio_cameras

    made = head_field(PEOPLE[person], 4, studio_cameras(16, 4))
    return {"filled": np.packbits(made.links >= 0), "density": np.uint8(np.round(made.density)),
            "shape": made.links.shape, "radius": made.radius, "person": person}


def photographs(name: str, cameras: Camera, more: str = "") -> list[Picture]:
    """The demo's head from all cameras, by the name of their file.

    ``more`` is ``"surface"``, int8 [H, W], or ``"depth"``, float32 [H, W].
    """
    data = _kept(name, lambda: make_photographs(cameras, more))
    for key, values in _camera_arrays(cameras).items():
        np.testing.assert_allclose(data[key], values, atol=1e-9,
                                   err_msg="other cameras: LFPORTRAIT_RECORD=1 records again")
    return [Picture(image, data[more][view] if more else None)
            for view, image in enumerate(data["image"])]


def painting(style: str, width: int, height: int, turn: float = 0.0) -> Exemplar:
    """A painting in one of the demo's styles of a face that is turned to the picture's right."""
    data = _kept(f"{style}_{width}x{height}_{turn:.0f}",
                 lambda: make_painting(style, width, height, turn))
    return Exemplar(data["image"], data["landmarks"], style, data["mask"] / np.float32(255))


def form(person: str) -> VoxelField:
    """The form of a person, of no color."""
    data = _kept(person, lambda: make_form(person))
    shape = tuple(data["shape"])
    filled = np.unpackbits(data["filled"], count=int(np.prod(shape))).reshape(shape) > 0
    links = np.full(shape, -1, np.int32)
    links[filled] = np.arange(int(filled.sum()), dtype=np.int32)
    density = data["density"].astype(np.float32)
    return VoxelField(links, density, np.zeros((len(density), 3, 1), np.float32), np.zeros(3),
                      data["radius"])
