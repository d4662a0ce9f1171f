"""Render pictures and captures of a modelled head.

Kernels release the interpreter lock and write disjoint parts of their output, so the work is
shared among threads by fixed bands: the bytes do not depend on timing.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lfportrait.capture import Camera, Capture
from lfportrait.measure import usable_cores

from .head_model import HeadModel
from .kernels.head_render import bake, render
from .people import SITTER, landmarks

__all__ = ["Picture", "photograph", "studio_cameras", "studio_capture"]

_BAND = 16
_GRID = 257
EXTENT = 1.06
"""Half the side of the cube that the baked distances span."""


@dataclass
class Picture:
    """A photograph of a modelled head and what is known about its pixels.

    Attributes
    ----------
    image : uint8 [H, W, 4], sRGB with straight alpha.
    normal : float32 [H, W, 3], world, zero where nothing is hit.
    surface : int8 [H, W]: 0 skin, 1 hair (and beard), 2 cloth, 3 eye, 4 worn (spectacles), -1
        nothing.
    depth : float32 [H, W], distance along the ray; 0 where nothing is hit.
    """

    image: NDArray[np.uint8]
    normal: NDArray[np.float32]
    surface: NDArray[np.int8]
    depth: NDArray[np.float32]


def _share(work: Callable[[int], None], count: int) -> None:
    """Call ``work`` with 0..count-1 from as many threads as there are processors."""
    with ThreadPoolExecutor(usable_cores()) as pool:
        for _ in pool.map(work, range(count)):
            pass


@lru_cache(maxsize=2)
def distances(model: HeadModel) -> NDArray[np.float32]:
    """The baked distances of a head to its surface, kept for the next picture.

    float32 [257, 257, 257] (z, y, x) over the cube of half side `EXTENT`; away from the surface
    only bounds of it.
    """
    grid = np.zeros((_GRID, _GRID, _GRID), np.float32)
    _share(lambda layer: bake(model, grid, layer, layer + 1), (_GRID - 1) // 4)
    return grid


def photograph(model: HeadModel, cameras: Camera, view: int = 0) -> Picture:
    """Photograph a modelled head.

    Parameters
    ----------
    model : The head.
    cameras, view : A batch of cameras and the index of the one to use.

    Returns
    -------
    picture : Four rays a pixel; the same bytes for the same arguments.
    """
    height, width = int(cameras.height[view]), int(cameras.width[view])
    image = np.zeros((height, width, 4), np.uint8)
    aux = np.zeros((height, width, 5), np.float32)
    aux[..., 3] = -1.0
    grid = distances(model)
    # Copies: for what can't be written to, as a camera's numbers may be, kernels would be compiled
    # once more.
    pose, focal, center = (np.array(part[view]) for part in (cameras.pose, cameras.focal,
                                                             cameras.center))

    def band(index: int) -> None:
        first = index * _BAND
        render(model, grid, pose, focal, center, image, aux, first, min(first + _BAND, height))

    _share(band, -(-height // _BAND))
    return Picture(image, aux[..., :3], aux[..., 3].astype(np.int8), aux[..., 4])


def studio_cameras(size: int, views: int) -> Camera:
    """Cameras of the demo's photos: four arcs about the head, from below to far above.

    Parameters
    ----------
    size : Width and height of the pictures in pixels.
    views : Number of cameras, at least 4.

    Returns
    -------
    cameras : Arc after arc, each from yaw -100 to 100 degrees (the arc at eye level: 105).
    """
    arcs = ((1.0, 105.0, 0.42), (18.0, 100.0, 0.25), (-15.0, 95.0, 0.20), (40.0, 90.0, 0.13))
    counts = [max(1, round(views * share)) for _, _, share in arcs]
    counts[0] += views - sum(counts)
    focal = 0.5 * size / np.tan(np.radians(14.3))
    batches = []
    for (pitch, reach, _), count in zip(arcs, counts, strict=True):
        yaw = np.linspace(-reach, reach, count) if count > 1 else np.zeros(1)
        batches.append(Camera.arc(yaw, distance=4.4, width=size, height=size, focal=float(focal),
                                  target=(0.0, -0.05, 0.0), pitch=pitch))
    return Camera.concatenate(batches)


def studio_capture(size: int = 384, views: int = 60, model: HeadModel = SITTER) -> Capture:
    """A modelled head photographed from known cameras in soft light.

    Parameters
    ----------
    size : Width and height of the pictures in pixels.
    views : Number of cameras; every 8th is held out.
    model : Who is photographed.

    Returns
    -------
    capture : With straight alpha and the 68 landmarks; its frame is the portrait frame
        (identity).
    """
    cameras = studio_cameras(size, views)
    images, alphas = [], []
    for view in range(views):
        picture = photograph(model, cameras, view)
        images.append(np.ascontiguousarray(picture.image[..., :3]))
        alphas.append(np.ascontiguousarray(picture.image[..., 3]))
    held_out = np.arange(views) % 8 == 4
    names = [f"view_{view:03d}" for view in range(views)]
    return Capture(cameras, images, alphas, names, held_out, np.eye(4), landmarks(model))
