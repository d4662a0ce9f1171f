"""The views that a field is stylised in: rendered, transferred by example, and linearised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture import Camera
from ..example import SurfaceGuide, Transfer
from ..field import SampleWeights, VoxelField

__all__ = ["StyleView", "facing", "prepare_view", "style_cameras"]

Float32 = NDArray[np.float32]


@dataclass
class StyleView:
    """One view, cropped to what it shows of the head.

    Attributes
    ----------
    content
        float32 [h, w, 3]: I_c, the real field's render on the background.
    example
        float32 [h, w, 3]: I_e, its example-based transfer on the background.
    alpha
        float32 [h, w].
    confidence
        float32 [h, w]: how frontally the surface is seen, 0 to 1.
    weights
        The crop's pixels as a linear map of the lattice's colors.
    trust
        float32 [h, w], weight of each pixel in the fit; None: opaque, and frontal rather than
        grazing.
    result
        What the transfer did, for ``--dump``; None unless asked for.
    """

    content: Float32
    example: Float32
    alpha: Float32
    confidence: Float32
    weights: SampleWeights
    trust: Float32 | None = None
    result: Any = None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the crop."""
        return self.alpha.shape[0], self.alpha.shape[1]

    @property
    def trusted(self) -> Float32:
        """Weight of each pixel's gradient, float32 [h, w]."""
        return self.alpha if self.trust is None else self.trust


def style_cameras(field: VoxelField, size: int, arc: float, count: int,
                  pitches: tuple[float, ...]) -> Camera:
    """Cameras on arcs in front of the head, from -arc to +arc degrees at each pitch.

    Parameters
    ----------
    field
        Its box, as far as it reaches beyond the head, is kept in the picture.
    size
        Width and height of the pictures in pixels.
    arc
        Half angle in degrees.
    count
        Cameras a pitch.
    pitches
        Degrees above the horizon.
    """
    low, high = field.bounds
    reach = float(np.clip(np.abs(np.stack([low, high]))[:, :2].max(), 1.0, 1.5))
    distance = 4.0
    focal = 0.5 * size * distance / (1.03 * reach)
    return Camera.concatenate([
        Camera.arc(np.linspace(-arc, arc, count), distance=distance, width=size, height=size,
                   focal=focal, pitch=pitch) for pitch in pitches])


def _cropped(camera: Camera, alpha: Float32, margin: int = 12) -> Camera | None:
    """The camera restricted to the rectangle that shows the field, sides a multiple of 8."""
    rows, columns = np.nonzero(alpha > 0.02)
    if not len(rows):
        return None
    height, width = alpha.shape
    y0, x0 = max(rows.min() - margin, 0), max(columns.min() - margin, 0)
    h = min(-(-(rows.max() + margin + 1 - y0) // 8) * 8, height - y0)
    w = min(-(-(columns.max() + margin + 1 - x0) // 8) * 8, width - x0)
    return Camera(camera.pose, camera.focal, camera.center - np.array([x0, y0]),
                  np.array([w]), np.array([h]))


def facing(points: NDArray[np.float64], position: NDArray[np.float64]) -> Float32:
    """Cosine between the surface's normal and the direction to the camera, [h, w]; 0 if unknown."""
    across = np.gradient(points, axis=1)
    down = np.gradient(points, axis=0)
    normal = np.cross(down, across)
    towards = position - points
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.abs((normal * towards).sum(-1)) / (
            np.linalg.norm(normal, axis=-1) * np.linalg.norm(towards, axis=-1))
    return np.nan_to_num(np.clip(cosine, 0, 1)).astype(np.float32)


def prepare_view(field: VoxelField, cameras: Camera, view: int, transfer: Transfer | None,
                 guide: SurfaceGuide | None, landmarks: NDArray[np.float64] | None,
                 background: float, keep: bool = False) -> StyleView | None:
    """Render, transfer and linearise one view; None where it shows nothing.

    Parameters
    ----------
    field
        The real field.
    cameras, view
        Which view.
    transfer
        Example-based transfer; None leaves the content as the example.
    guide
        Guide anchored to the surface; None = from the landmarks' projections in each view.
    landmarks
        float64 [68, 3] in the world.
    background
        Grey level behind the field.
    keep
        Keep the transfer's intermediates.
    """
    first = field.render(cameras, view, background=background)
    camera = _cropped(cameras[view], first.alpha)
    if camera is None:
        return None
    rendering = field.render(camera, 0, background=background)
    points = rendering.points(camera, 0)
    content = np.clip(rendering.color, 0.0, 1.0)
    example, result = content, None
    if transfer is not None:
        assert landmarks is not None
        pixels, _ = camera.project(landmarks)
        if guide is not None:
            position, anchor = guide(points)
            result = transfer.apply(content, pixels[0], position=position, seeds_anchor=anchor,
                                    mask=rendering.alpha)
        else:
            result = transfer.apply(content, pixels[0], mask=rendering.alpha)
        alpha = rendering.alpha[..., None]
        example = np.where(np.isfinite(points[..., :1]), result.image, content)
        example = (example * alpha + background * (1.0 - alpha)).astype(np.float32)
    return StyleView(content, example, rendering.alpha, facing(points, camera.position[0]),
                     field.sample_weights(camera, 0),
                     result=result if keep else None)
