"""What the methods share: their training views, features of them, and the descent of colors.

The paper's method and the skin look at renders on arcs; the methods here were published with the
photos that a field was trained on. A photo is laid on the background by the field's own opacity:
what the field cannot show (a wall, a chair) would only disturb the losses.

Places of one view are found in another by the field's depth (`seen_from`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from PIL import Image
from scipy.ndimage import maximum_filter, minimum_filter
from torch.nn import functional

from lfportrait import models
from lfportrait.arrays import Bool, Float32, Float64, Int32, Int64
from lfportrait.capture import Camera
from lfportrait.errors import UserError
from lfportrait.field import C0, VoxelField
from lfportrait.files import write_image
from lfportrait.stylize import FieldTask
from lfportrait.stylize.fit import ColorModel, StyleView, facing
from lfportrait.stylize.losses import FeatureNetwork, load_network, stacked

from ..kernels import rmsprop_step


@dataclass
class PhotoView(StyleView):
    """A view whose content is a photo, with the surface that it shows."""

    camera: Any = None  # Its camera, a batch of one.
    points: Any = None  # float64 [h, w, 3], world point under each pixel, NaN without one.
    # float32 [h, w], distance along the optical axis; infinite without a surface.
    depth: Any = None

    @property
    def inside(self) -> Bool:
        """Pixels that show nothing but the head, bool [h, w]."""
        return self.alpha > 0.9


def tensor(picture: Float32, place: str = "cpu") -> torch.Tensor:
    """A picture [h, w, 3] as the networks take it, [1, 3, h, w], on torch's device of that name."""
    return torch.from_numpy(
        np.ascontiguousarray(picture.transpose(2, 0, 1), np.float32))[None].to(place)


def photo_views(task: FieldTask, size: int, count: int) -> list[PhotoView]:
    """Up to ``count`` training photos, evenly spread by their direction, ``size`` pixels long."""
    cameras = task.capture.cameras
    training = task.capture.training()
    position = cameras.position[training]
    order = training[np.argsort(np.arctan2(position[:, 0], position[:, 2]), kind="stable")]
    chosen = order[np.unique(np.linspace(0, len(order) - 1, min(count, len(order))).astype(int))]
    views = []
    for index in chosen:
        view = view_of(task, cameras[int(index)], size, int(index))
        if view is not None:
            views.append(view)
        task.tell(f"views: {len(views)} of {len(chosen)}", 1)
    if not views:
        raise UserError("no photo of the capture shows anything of the field: it was "
                        "reconstructed from another capture")
    return views


def view_of(task: FieldTask, camera: Camera, size: int, photo: int | None) -> PhotoView | None:
    """One view, cropped to the head; None where its camera sees nothing of the field.

    The camera is a batch of one; the view's longer side is ``size`` pixels. ``photo``: which one it
    took; None: the field's render is the content.
    """
    box = _head_box(task.field, camera)
    if box is None:
        return None
    cropped, window = _cropped(camera, box, size)
    rendering = task.field.render(cropped, 0, background=task.background)
    points = rendering.points(cropped, 0)
    alpha = rendering.alpha
    content = np.clip(rendering.color, 0.0, 1.0)
    if photo is not None:
        picture = np.rint(255 * task.capture.image_float(photo, task.background))
        resized = Image.fromarray(picture.astype(np.uint8)).resize(
            (int(cropped.width[0]), int(cropped.height[0])), Image.Resampling.BICUBIC, box=window)
        content = (np.asarray(resized, np.float32) / 255 * alpha[..., None]
                   + np.float32(task.background) * (1 - alpha[..., None]))
    return PhotoView(content, content, alpha, facing(points, cropped.position[0]),
                     task.field.sample_weights(cropped, 0),
                     trust=np.where(alpha > 0.05, alpha, 0).astype(np.float32),
                     camera=cropped, points=points, depth=rendering.depth)


def _head_box(field: VoxelField, camera: Camera) -> tuple[float, float, float, float] | None:
    """Left, top, right and bottom of what a camera sees of the field, in its pixels."""
    width, height = int(camera.width[0]), int(camera.height[0])
    coarse = camera.scaled(min(1.0, 160 / max(width, height)))
    rows, columns = np.nonzero(field.render(coarse, 0).alpha > 0.02)
    if not len(rows):
        return None
    across, down = width / coarse.width[0], height / coarse.height[0]
    margin = 4
    return (max((columns.min() - margin) * across, 0.0), max((rows.min() - margin) * down, 0.0),
            min((columns.max() + 1 + margin) * across, float(width)),
            min((rows.max() + 1 + margin) * down, float(height)))


def _cropped(camera: Camera, box: tuple[float, float, float, float], size: int,
             ) -> tuple[Camera, tuple[float, float, float, float]]:
    """The camera restricted to a box, sides multiples of 16; and that box as it became."""
    left, top, right, bottom = box
    factor = size / max(right - left, bottom - top)
    width, height = (max(16, int((end - start) * factor + 1e-6) // 16 * 16)
                     for start, end in ((left, right), (top, bottom)))
    right, bottom = left + width / factor, top + height / factor
    window = (left, top, min(right, float(camera.width[0])), min(bottom, float(camera.height[0])))
    cropped = Camera(camera.pose, camera.focal * factor,
                     (camera.center - np.array([left, top])) * factor, np.array([width]),
                     np.array([height]))
    return cropped, window


def dump_views(task: FieldTask, model: ColorModel, views: list[PhotoView]) -> None:
    """Write every third view: what it was to keep, what it was fitted to, what it shows."""
    if task.dump is None:
        return
    for index, view in enumerate(views[::3]):
        write_image(task.dump / f"view_{index:02d}.png", np.concatenate(
            [view.content, view.example, model.picture(view)], axis=1))


IMAGE_SMOOTHNESS, COLOR_SMOOTHNESS, SMOOTHED_SHARE = 1.0, 0.005, 0.01
"""Weights of the total variation of a rendered view and of the voxels' colors, and the share of the
voxels that a step smooths, as in ARF's own code."""
TOLERANCE = 0.02
"""A place is the same where both views' depths agree within this, in world units: a head is about
one and a half high, a nose 0.15 deep, and a voxel less than 0.01."""


@dataclass(frozen=True)
class Correspondence:
    """Where each pixel of one view lies in another."""

    # float32 [1, h, w, 2], place (x, y) in the other view, -1 to 1 from border to border.
    grid: torch.Tensor
    visible: torch.Tensor  # bool [h, w], whether the other view sees the same place of the surface.
    cosine: Float32  # float32 [h, w], between the directions from which both see it.

    def warped(self, picture: torch.Tensor) -> torch.Tensor:
        """A picture of the other view [1, C, H, W] as this view would show it, [1, C, h, w]."""
        return functional.grid_sample(picture, self.grid, mode="bilinear", padding_mode="border",
                                      align_corners=False)


def seen_from(view: PhotoView, other: PhotoView, tolerance: float = TOLERANCE,
              place: str = "cpu") -> Correspondence:
    """Where ``other`` sees what ``view`` shows, for pictures on torch's device ``place``.

    Visibility is tested by depth: the surface's point, projected into the other view, must lie as
    far away as what that view shows there, at that pixel or between it and the next ones.
    """
    height, width = view.shape
    points = np.nan_to_num(view.points.reshape(-1, 3))
    known = np.isfinite(view.points).all(-1) & view.inside
    pixels, away = other.camera.project(points)
    x, y = pixels[0].T
    rows = np.clip(np.floor(y), 0, other.shape[0] - 1).astype(int)
    columns = np.clip(np.floor(x), 0, other.shape[1] - 1).astype(int)
    within = (x > 0) & (y > 0) & (x < other.shape[1]) & (y < other.shape[0])
    nearest, farthest = _depths_around(other)
    same = ((away[0] > nearest[rows, columns] - tolerance)
            & (away[0] < farthest[rows, columns] + tolerance))
    visible = known & (within & same & other.inside[rows, columns]).reshape(height, width)
    grid = np.stack([2 * x / other.shape[1] - 1, 2 * y / other.shape[0] - 1], -1)
    grid = np.clip(grid, -2, 2).reshape(1, height, width, 2).astype(np.float32)
    return Correspondence(torch.from_numpy(grid).to(place), torch.from_numpy(visible).to(place),
                          _cosine(points, view, other).reshape(height, width))


def _depths_around(view: PhotoView) -> tuple[Float32, Float32]:
    """Least and largest depth of a pixel and its eight neighbours, places without one left out."""
    known = np.isfinite(view.depth)
    return (minimum_filter(np.where(known, view.depth, np.inf), 3),
            maximum_filter(np.where(known, view.depth, -np.inf), 3))


def _cosine(points: Float64, view: PhotoView, other: PhotoView,
            ) -> Float32:
    """Cosine of the angle at points [N, 3] between the directions to two cameras."""
    first, second = (one.camera.position[0] - points for one in (view, other))
    length = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    return ((first * second).sum(1) / np.maximum(length, 1e-12)).astype(np.float32)


def best_network(name: str, place: str = "cpu") -> tuple[str, FeatureNetwork]:
    """A feature network on torch's device ``place``, and its name.

    ``"auto"`` is VGG-16, or the embedded one without it.
    """
    if name == "auto":
        name = "vgg16" if models.available("vgg16") else "embedded"
    return name, load_network(name, place=place)


def half_sized(image: torch.Tensor) -> torch.Tensor:
    """A picture [1, 3, h, w] at half its size, bilinear: the mean of two by two pixels."""
    return functional.avg_pool2d(image, 2)


def style_features(network: FeatureNetwork, task: FieldTask, side: int, place: str = "cpu",
                   ) -> torch.Tensor:
    """Features of the painting, its longer side of ``side`` pixels, [M, C].

    ``place`` is torch's name of the network's device.
    """
    picture = tensor(task.exemplar.image.astype(np.float32) / np.float32(255))
    small = functional.interpolate(picture, scale_factor=side / max(picture.shape[-2:]),
                                   mode="bilinear", antialias=True)
    with torch.no_grad():
        return stacked(network(small.to(place))).flatten(1).T


def head_places(view: PhotoView, features: torch.Tensor) -> torch.Tensor:
    """Places of a feature map [C, h, w] that show the head, bool [h, w]."""
    share = functional.interpolate(torch.from_numpy(view.alpha)[None, None],
                                   size=features.shape[-2:], mode="area")
    return (share[0, 0] > 0.3).to(features.device)


def nearest_places(features: torch.Tensor, bank: torch.Tensor, *, chunk: int = 2048,
                   ) -> tuple[torch.Tensor, torch.Tensor]:
    """The nearest of a bank's features [M, C] by cosine, for each feature [N, C].

    int64 [N], row of the bank; float [N], 1 - cosine. ``chunk`` rows of ``features`` are compared
    at once.
    """
    unit = functional.normalize(features, dim=1, eps=1e-6)
    bank_unit = functional.normalize(bank, dim=1, eps=1e-6)
    found = [(part @ bank_unit.T).max(dim=1) for part in unit.split(chunk)]
    return (torch.cat([part.indices for part in found]),
            1.0 - torch.cat([part.values for part in found]))


class ColorDescent:
    """Steps of a field's colors, changed in place, down the slopes of pictures.

    Parameters
    ----------
    rate : Step of RMSProp in units of the coefficients of degree 0.
    smoothness, share : Weight of the total variation of the colors; share of the rows that a step
        smooths.
    """

    def __init__(self, model: ColorModel, field: VoxelField, rate: float, smoothness: float,
                 share: float, random: np.random.Generator) -> None:
        self.model, self.rate = model, np.float32(rate * C0)
        self.smoothness, self.share, self.random = smoothness, share, random
        self._following = following_rows(field.links, len(field.density))
        self._scale = np.array(field.links.shape[::-1]) / 256.0
        self._gradient = np.zeros((3, len(model.colors)), np.float32)
        self._square = np.zeros_like(model.colors)

    def step(self, slopes: list[tuple[StyleView, Float32]]) -> None:
        """One step down the slopes [h, w, 3] of the losses of some views' pictures."""
        for view, slope in slopes:
            self.model.pulled_back(view, np.ascontiguousarray(slope), self._gradient)
        if self.smoothness > 0:
            rows = np.unique(self.random.integers(
                0, len(self.model.colors), max(1, int(self.share * len(self.model.colors)))))
            total_variation_slope(self.model.colors, self._following, self._scale, rows,
                                  self.smoothness, self._gradient)
        rmsprop_step(self.model.colors, self._gradient, self._square, self.rate)


def following_rows(links: Int32, count: int) -> Int32:
    """Row of the next lattice point along x, y and z, int32 [N, 3]; a row itself where none is."""
    following = np.repeat(np.arange(count, dtype=np.int32)[:, None], 3, axis=1)
    for axis in range(3):
        here = np.take(links, range(links.shape[axis] - 1), axis=axis)
        there = np.take(links, range(1, links.shape[axis]), axis=axis)
        both = (here >= 0) & (there >= 0)
        following[here[both], 2 - axis] = there[both]
    return following


def total_variation_slope(colors: Float32, following: Int32,
                          scale: Float64, rows: Int64, weight: float,
                          gradient: Float32) -> None:
    """Add the slope of the total variation of some rows to a gradient, as svox2 does.

    The value is the mean over the rows of sqrt(dx^2 + dy^2 + dz^2) of each channel, in
    coefficients; its slope counts lattice points as 256 along an axis.

    Parameters
    ----------
    colors : float32 [N, 3].
    following : int32 [N, 3] (`following_rows`).
    scale : Lattice points along x, y and z over 256.
    rows : Rows to smooth.
    weight : Weight of the value.
    gradient : float32 [3, N]; added to.
    """
    ahead = following[rows]
    change = (colors[ahead] - colors[rows][:, None]) / C0  # [M, axis, channel]
    norm = np.sqrt(1e-9 + (change ** 2).sum(1, keepdims=True))
    slope = (weight / len(rows) / C0) * change * scale[None, :, None] / norm
    for channel in range(3):
        for axis in range(3):
            np.add.at(gradient[channel], ahead[:, axis], slope[:, axis, channel])
        np.add.at(gradient[channel], rows, -slope[:, :, channel].sum(1))
