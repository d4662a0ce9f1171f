"""The views that a field is stylised in, and the fit of its colors to them.

Views are rendered, transferred by example, and linearised: with fixed density, a view is linear in
the lattice's colors.

The weighted least-squares problem over all views, sum over pixels of w (A x + (1 - alpha) b - I)^2,
is solved by simultaneous iterations (SIRT, Gilbert 1972): each adds the back-projected residual,
normalised by the rows' and the columns' sums, which needs no step size and spreads nothing into
places that no view sees.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Float32, Float64
from ..capture import Camera
from ..example import SurfaceGuide, Transfer
from ..field import C0, SampleWeights, VoxelField
from ..progress import Progress, note
from .kernels import gather_colors, scatter_colors


@dataclass
class StyleView:
    """One view, cropped to what it shows of the head."""

    content: Float32  # float32 [h, w, 3]: I_c, the real field's render on the background.
    example: Float32  # float32 [h, w, 3]: I_e, its example-based transfer on the background.
    alpha: Float32  # float32 [h, w].
    confidence: Float32  # float32 [h, w]: how frontally the surface is seen, 0 to 1.
    weights: SampleWeights  # The crop's pixels as a linear map of the lattice's colors.
    # float32 [h, w], weight of each pixel in the fit; None: opaque, and frontal rather than
    # grazing.
    trust: Float32 | None = None
    result: Any = None  # What the transfer did, for ``--dump``; None unless asked for.

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
    """Cameras on arcs in front of the head, ``count`` from -arc to +arc degrees at each pitch.

    The field's box, as far as it reaches beyond the head, is kept in the square pictures.
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


def facing(points: Float64, position: Float64) -> Float32:
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
                 guide: SurfaceGuide | None, landmarks: Float64 | None,
                 background: float) -> StyleView | None:
    """Render, transfer and linearise one view; None where it shows nothing.

    Without ``transfer`` the content stays as the example. ``guide`` is anchored to the surface;
    None: from the projections of ``landmarks``, float64 [68, 3] in the world, in each view.
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
                     field.sample_weights(camera, 0), result=result)

_TOGETHER = 8192  # Rows whose moments are added up together: they fit into the cache.


class ColorModel:
    """One color, the same in all directions, for every lattice row.

    At first it is the field's mean; ``background`` is the grey level behind the field.
    """

    def __init__(self, field: VoxelField, background: float) -> None:
        self.background = background
        self.original = np.clip(C0 * field.sh[:, :, 0] + 0.5, 0.0, 1.0).astype(np.float32)
        self.colors = self.original.copy()
        self.seen = np.zeros(len(self.colors), np.float32)

    def picture(self, view: StyleView, colors: Float32 | None = None) -> Float32:
        """A view of the colors, float32 [h, w, 3]."""
        out = np.empty((view.alpha.size, 3), np.float32)
        weights = view.weights
        gather_colors(weights.indptr, weights.rows, weights.weights,
                      self.colors if colors is None else colors, out)
        out += (1.0 - view.alpha.reshape(-1, 1)) * np.float32(self.background)
        return out.reshape(*view.shape, 3)

    def pulled_back(self, view: StyleView, image: Float32, out: Float32) -> None:
        """Add the transpose of a view's map, applied to a picture [h, w, 3], to out [3, N]."""
        planes = np.ascontiguousarray(image.reshape(-1, 3).T, np.float32)
        weights = view.weights
        scatter_colors(weights.indptr, weights.rows, weights.weights, planes, out)

    def fit(self, views: list[StyleView], iterations: int, progress: Progress | None = None,
            relaxation: float = 1.0) -> list[float]:
        """Fit the colors to the views' example pictures; returns the error of each iteration.

        ``relaxation`` is the share of each update that is taken.
        """
        columns = np.zeros((1, len(self.colors)), np.float32)
        trust = [_trust(view) for view in views]
        for view, weight in zip(views, trust):
            scatter_colors(view.weights.indptr, view.weights.rows, view.weights.weights,
                           weight.reshape(1, -1), columns)
        self.seen = columns[0]
        errors = []
        for iteration in range(iterations):
            update = np.zeros((3, len(self.colors)), np.float32)
            total, mass = 0.0, 0.0
            for view, weight in zip(views, trust):
                # A pixel's weights add up to its opacity: that is the row sum to divide by.
                residual = view.example - self.picture(view)
                total += float((residual ** 2 * weight[..., None]).sum())
                mass += 3.0 * float(weight.sum())
                scaled = weight[..., None] * residual / np.maximum(view.alpha, 0.05)[..., None]
                self.pulled_back(view, scaled.astype(np.float32), update)
            known = self.seen > 1e-4
            self.colors[known] += np.float32(relaxation) * (update[:, known] / self.seen[known]).T
            np.clip(self.colors, 0.0, 1.0, out=self.colors)
            errors.append(total / max(mass, 1e-9))
            note(progress, f"fit {iteration + 1} of {iterations}: "
                           f"error {np.sqrt(errors[-1]):.4f}")
        return errors

    def shown(self, field: VoxelField) -> VoxelField:
        """A field of the same rows in these colors, without a texture."""
        colors = np.clip(self.colors, 0.0, 1.0)
        return field.with_sh((colors[:, :, None] - np.float32(0.5)) * np.float32(1 / C0))

    def fill_unseen(self) -> float:
        """Color rows that no view sees by the affine map of the seen ones; the share of them."""
        seen = self.seen > 1e-2
        if seen.sum() > 100:
            matrix, offset = affine_color_map(self.original[seen], self.colors[seen],
                                              self.seen[seen])
            # Between the two the trust grows with what the views see of a row.
            part = np.clip(self.seen / 0.05, 0.0, 1.0)
            less = np.flatnonzero(part < 1.0)
            guess = np.clip(self.original[less] @ matrix.T + offset, 0.0, 1.0).astype(np.float32)
            part = part[less, None]
            self.colors[less] = part * self.colors[less] + (1.0 - part) * guess
        return float(1.0 - seen.mean())


def _trust(view: StyleView) -> Float32:
    """Weight of each pixel in the fit: opaque, and seen frontally, so that strokes stay sharp."""
    if view.trust is not None:
        return view.trust
    weight = view.alpha * (0.02 + view.confidence ** 3)
    return np.ascontiguousarray(np.where(view.alpha > 0.05, weight, 0.0), np.float32)


def affine_color_map(source: Float32, target: Float32, weight: Float32) -> tuple[Float64, Float64]:
    """The affine map of colors, target ~ matrix source + offset, by weighted least squares.

    Of colors float32 [N, 3] each, and weights [N].
    """
    moments, wanted = np.zeros((4, 4)), np.zeros((4, 3))
    for since in range(0, len(source), _TOGETHER):
        part = slice(since, since + _TOGETHER)
        known = np.ones((len(source[part]), 4))
        known[:, :3] = source[part]
        weighted = known.T * weight[part]
        moments += weighted @ known
        wanted += weighted @ target[part]
    normal = moments + 1e-3 * weight.sum() * np.diag([1.0, 1.0, 1.0, 0.0])
    wanted += 1e-3 * weight.sum() * np.eye(4, 3) * target.mean()
    solution = np.linalg.solve(normal, wanted)
    return solution[:3].T, solution[3]
