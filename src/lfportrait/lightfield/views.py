"""Pictures of views: level cameras by row slices, quilts of a field, and what any renderer shows.

The views' eyes lie on one level line, and their pictures in one plane: rows of the same height are
seen through one slice of the field (`render_views`).

A `VoxelField` is coded directly, one ray for each sub-pixel (`coding.encode`). Of other scenes -
splats, a neural field, a mesh, an analytic surface - only pictures are known: each view of the
panel is rendered for its off-axis camera, and the views are interlaced.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

import numba
import numpy as np

from ..arrays import Float32, Float64, Floats, UInt8
from ..capture import Camera
from ..device import gpu_adapter
from ..errors import UserError
from ..field import Rendering, VoxelField
from ..gpu import attempted
from .coding import composed, pictures_on_gpu, view_camera
from .display import Display
from .ground import Ground, ground_of
from .interlacing import interlace
from .kernels.slices import view_kernel
from .placement import EncodeConfig, InterlaceConfig
from .quilts import QuiltLayout

_FAINTEST = 2e-4  # Slices leave out samples that hold back less light than this.
_STOP = 4e-3
"""Transmittance at which a ray ends; the rest, a level of 8 bits, is taken to have its color."""
_TOGETHER = 64 << 20  # Bytes of pictures that are rendered at once.
_STEEPEST = 50.0
"""Degrees between a ray and the normal of the planes, at most: there is one sample a plane."""
_LEVEL = 1e-9  # What a camera's axes may lie off the horizon, as a sine.


def eight_bit(color: Float32) -> UInt8:
    """Colors in [0, 1] as bytes; the colors are overwritten."""
    color *= np.float32(255.0)
    color += np.float32(0.5)
    return np.clip(color, 0.5, 255.5, out=color).astype(np.uint8)


def _rays(row: Float64, size: tuple[int, int], corners: Float64) -> tuple[float, float] | None:
    """Slopes x / z of the first and last ray that a camera sends at the lattice, in its own frame.

    None if the lattice reaches behind the camera, or up to it. ``row`` float64 [16] is the camera
    (`Camera.row`), ``size`` its picture's width and height, ``corners`` float64 [4, 2] x and z of
    the lattice's.
    """
    from_eye = corners - row[[3, 11]]
    ahead = from_eye @ row[[2, 10]]
    if ahead.min() <= 1e-3 * np.abs(corners).max():
        return None
    slopes = (from_eye @ row[[0, 8]]) / ahead
    edges = (np.array([0.5, size[0] - 0.5]) - row[14]) / row[12]
    low, high = max(slopes.min(), edges[0]), min(slopes.max(), edges[1])
    return (float(low), float(high)) if low <= high else (float(edges[0]), float(edges[0]))


def _fits(field: VoxelField, row: Float64, slopes: tuple[float, float] | None) -> bool:
    """Whether a camera's rays go through slices: it is level, and looks along the planes' normal.

    The kernel reads 63 columns at a time, of at most 1024, and a ray may not leave them within 16
    planes.
    """
    lattice, bounds = field.lattice, math.tan(math.radians(_STEEPEST))
    level = max(abs(row[4]), abs(row[6]), abs(row[1]), abs(row[9])) <= _LEVEL
    if slopes is None or not level or lattice[0] > 1024 or 16 * bounds * lattice[3] / lattice[5
                                                                                  ] >= 60:
        return False
    for slope in slopes:
        x, z = row[[0, 8]] * slope + row[[2, 10]]
        if z >= 0 or abs(x) > bounds * -z:
            return False
    return True


def _beside(row: Float64, other: Float64) -> bool:
    """Whether two level cameras' rows lie in the same planes."""
    same = [0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 13, 15]
    ahead = row[[2, 10]] @ (row[[3, 11]] - other[[3, 11]])
    return bool(np.abs(row[same] - other[same]).max() <= _LEVEL and abs(ahead) <= _LEVEL)


def render_views(field: VoxelField, cameras: Camera, views: Sequence[int] | None = None, *,
                 background: float | Floats = 1.0,
                 ground: Ground | None = None, device: str = "cpu") -> Iterator[Rendering]:
    """What `VoxelField.render` gives of several views, in their order, in less time.

    Level cameras that look at the lattice from its front are rendered by slices of the field, one
    for each row of those that stand side by side; all others one by one. What a rendering holds may
    be overwritten once the one after is asked for.

    Parameters
    ----------
    cameras, views : Batch of cameras, and which of them; all by default.
    background, ground : Grey level or RGB behind the field, or what is behind it instead.
    device : Where to compute (`lfportrait.device.gpu_adapter`).
    """
    wanted = list(range(len(cameras)) if views is None else views)
    x, z = field.bounds[:, 0], field.bounds[:, 2]
    corners = np.array([(i, k) for i in x for k in z])
    while wanted:
        first = wanted[0]
        size = int(cameras.width[first]), int(cameras.height[first])
        row = cameras.row(first)
        slopes = _rays(row, size, corners)
        if gpu_adapter(device) is not None or not _fits(field, row, slopes):
            behind = background if ground is None else ground.seen(cameras, first)
            yield field.render(cameras, first, background=behind, device=device)
            wanted.pop(0)
            continue
        rows, reach = [], 0.0
        most = max(1, _TOGETHER // (20 * size[0] * size[1]))
        for view in wanted[:most]:
            other = cameras.row(view)
            slopes = _rays(other, size, corners)
            if ((int(cameras.width[view]), int(cameras.height[view])) != size
                    or not _beside(row, other) or not _fits(field, other, slopes)):
                break
            assert slopes is not None
            rows.append(other)
            reach = max(reach, abs(slopes[0]), abs(slopes[1]))
        yield from _together(field, cameras, wanted[:len(rows)], np.array(rows), size, reach,
                             background, ground)
        del wanted[:len(rows)]


def _together(field: VoxelField, cameras: Camera, views: Sequence[int], rows: Float64,
              size: tuple[int, int], reach: float, background: float | Floats,
              ground: Ground | None) -> Iterator[Rendering]:
    """Views whose rows lie in the same planes; ``reach`` is the largest slope of their rays."""
    stretches, lattice = field.stretches, field.lattice
    shape = len(views), size[1], size[0]
    color = np.empty((*shape, 3), np.float32)
    alpha, depth = np.empty(shape, np.float32), np.empty(shape, np.float32)
    view_kernel(field.basis)(
        stretches.places, stretches.occupied, stretches.values, lattice, rows,
        np.float32(1.0 / math.hypot(1.0, reach)), 1, np.float32(_FAINTEST * lattice[5]),
        np.float32(_STOP), numba.get_num_threads(), color, alpha, depth)
    for place, view in enumerate(views):
        behind = background if ground is None else ground.seen(cameras, view)
        yield field.finished(cameras, view, Rendering(color[place], alpha[place], depth[place]),
                             background=behind)


def quilt_of(field: VoxelField, display: Display, config: EncodeConfig | None = None, *,
             name: str | None = None, device: str = "cpu") -> tuple[UInt8, str]:
    """A quilt of a field for a display, uint8 [H, W, 3], and a file name ``quilt_qsCxRaA.png``.

    ``name`` gives columns and rows, and may give the aspect; by default the layout is the display's
    customary one.
    """
    config = composed(field, display, config or EncodeConfig())
    ground = ground_of(field, display, config)
    layout = QuiltLayout.of_name(name, display) if name else None
    if layout is None:
        layout = QuiltLayout.of_display(display)
    full_width, full_height = display.quilt_size
    width, height = full_width // layout.columns, full_height // layout.rows
    quilt = np.zeros((full_height, full_width, 3), np.uint8)
    count = layout.columns * layout.rows
    eyes = display.eye_reach * (2.0 * (np.arange(count) + 0.5) / count - 1.0)
    cameras = Camera.concatenate([view_camera(display, config, float(eye), width=width,
                                              height=height) for eye in eyes])
    pictures: Iterable[UInt8] | None
    pictures = attempted(gpu_adapter(device), lambda process: pictures_on_gpu(
        process, field, cameras, background=max(config.background, 0.0), ground=ground))
    if pictures is None:
        pictures = (eight_bit(seen.color) for seen in render_views(
            field, cameras, background=config.background, ground=ground))
    for view, seen in enumerate(pictures):
        row, column = divmod(view, layout.columns)
        top = full_height - (row + 1) * height
        quilt[top:top + height, column * width:(column + 1) * width] = seen
    return quilt, f"quilt{layout.suffix()}.png"


class Renderer(Protocol):
    """What can picture a scene: a `VoxelField`, or any object with this one method."""

    def render(self, cameras: Camera, view: int = 0, *, background: float = 1.0) -> Rendering:
        """Picture the scene for one camera.

        Parameters
        ----------
        cameras, view : A batch of pinhole cameras and which of them: ``cameras.rays(view)`` are
            its rays. The world is the portrait frame: +y up, +z out of the face, the head
            within [-1, 1]^3.
        background : Grey level in [0, 1] behind the scene.

        Returns
        -------
        rendering : Of the camera's size. Coding uses its ``color`` alone.
        """


def encode_views(renderer: Renderer, display: Display, config: EncodeConfig | None = None, *,
                 sampling: InterlaceConfig | None = None, height: int = 0) -> UInt8:
    """Code what a renderer shows for a display: all its views are rendered and interlaced.

    Parameters
    ----------
    renderer : The scene.
    display : The panel.
    config : Placement of the scene in front of the panel (size, shifts, focus, turn, depth
        scale) and the grey level behind it.
    sampling : How views are interlaced.
    height : Rows of a view's picture. By default a view has as many pixels as an eye sees of the
        panel: one for each lens in each row, about as many across as down.

    Returns
    -------
    image : uint8 [H, W, 3]: show it on the panel pixel for pixel, unscaled.

    Raises
    ------
    UserError : If the configuration composes the picture, which needs a field, or a picture has
        another size than its camera.
    """
    config = config or EncodeConfig()
    if config.compose:
        raise UserError("a picture is composed about a field's head; place another scene by size, "
                        "shifts and focus")
    height = height or max(1, round(display.height / math.sqrt(max(display.pitch / 3.0, 1.0))))
    width = max(1, round(height * display.aspect))
    views = np.empty((display.views, height, width, 3), np.uint8)
    for view, eye in enumerate(display.eyes()):
        camera = view_camera(display, config, float(eye), width=width, height=height)
        color = renderer.render(camera, 0, background=max(config.background, 0.0)).color
        if color.shape != (height, width, 3):
            raise UserError(f"the renderer made a picture [{', '.join(map(str, color.shape))}] for "
                            f"a camera of {width} x {height} pixels")
        views[view] = eight_bit(np.array(color, np.float32))
    return interlace(views, display, sampling, aspect=display.aspect)
