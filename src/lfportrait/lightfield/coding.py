"""Coding a field for a display: one ray per sub-pixel, and no views (Shen et al. 2023, 2.3).

The field is placed in the display frame by a similarity: by default the middle of the head lies on
the panel's plane, and the head, two world units high, takes 80 % of the panel's height. A
sub-pixel's ray runs from the eye point of its view through the sub-pixel's own place on the panel:
off-axis, never toed in, so that there is no vertical disparity. The view of each sub-pixel is the
mask guide, which depends on the panel alone: it is kept on disk under the display's hash and mapped
into memory.

In a composed portrait the face, not the middle of the head, lies in the panel's plane, where it is
sharpest. The head is as large as its crown and the end of its bust allow: that ends below the
picture's lower edge, and the eyes stay in its middle third. If the panel can't show the head's
depth sharply, as far as it is seen from the front, the head is flattened.
"""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numba
import numpy as np

from ..arrays import Array, Float64, UInt8, Unsigned
from ..cache import key_of, user_cache
from ..capture import Camera
from ..device import device_name, gpu_adapter
from ..errors import UserError
from ..field import VoxelField, head_points
from ..field.gpu import ViewJob, keep_field, views_on_gpu
from ..field.marching import PROBES, REACH
from ..files import UNREADABLE_ARRAYS, atomic_write
from ..gpu import Adapter, GpuProcess, attempted
from .display import Display
from .gpu.panel import PanelJob
from .ground import Ground, ground_of
from .kernels.panel import encode_kernel, lens_of, mask_views, mix_light
from .kernels.slices import slice_kernel
from .placement import DepthReport, EncodeConfig, Placement


def row_views(display: Display, first: int, count: int, apart: int = 1) -> Unsigned:
    """The nearest view of ``count`` rows, ``apart`` apart, [count, W, 3]; see `ViewMask`."""
    kind = np.dtype(np.uint8 if display.views <= 256 else np.uint16)
    views = np.empty((count, display.width, 3), kind)
    mask_views(views, display.steps(), lens_of(display), first, apart)
    return views


@dataclass(frozen=True)
class ViewMask:
    """The nearest view of every sub-pixel of a panel.

    Attributes
    ----------
    views : uint8 (uint16 above 256 views) [H, W, 3], sub-pixels as `Display.phase` counts them.
    display : Hash of the display that it was computed for.
    seconds : Time that building or loading it took.
    loaded : Whether it came from the cache.
    """

    views: Unsigned
    display: str
    seconds: float
    loaded: bool

    @staticmethod
    def build(display: Display, cache: bool | Path = True) -> ViewMask:
        """The mask of a display, from the cache if it is there.

        Parameters
        ----------
        display : The panel.
        cache : True keeps masks in the user's cache folder, a path in that folder, False
            nowhere.
        """
        start = time.perf_counter()
        kind = np.dtype(np.uint8 if display.views <= 256 else np.uint16)
        shape = (display.height, display.width, 3)
        file = None
        if cache is not False:
            folder = user_cache("masks") if cache is True else Path(cache)
            file = folder / f"{key_of(__name__, display.hash())}.npy"
            try:
                stored = np.load(file, mmap_mode="r", allow_pickle=False)
                if stored.shape == shape and stored.dtype == kind:
                    return ViewMask(stored, display.hash(), time.perf_counter() - start, True)
            except UNREADABLE_ARRAYS:
                pass
        views = row_views(display, 0, display.height)
        if file is not None:
            try:
                with atomic_write(file) as stream:
                    np.save(stream, views, allow_pickle=False)
            except Exception:  # a cache that can't be written is no reason to stop
                pass
        return ViewMask(views, display.hash(), time.perf_counter() - start, False)

    @property
    def nbytes(self) -> int:
        """Memory taken, in bytes."""
        return int(self.views.nbytes)


# In the portrait frame the eyes lie at y = 0 and z = 0.4 (`lfportrait.capture.camera`), the tip of
# the nose at z = 0.6; from the front a head is seen back to its widest place, at z = 0.
_FACE, _NOSE, _OUTLINE = 0.4, 0.6, 0.0
_EYES = 0.2  # Half the distance of the eyes' outer corners, rounded up.
_TOP = 0.86  # Place of the crown in half panel heights, where all else allows it.
_LOW = -1.06  # The bust ends here or below, in half panel heights: just beneath the lower edge.
_HIGHEST = 0.24
"""Eyes are at most so high or low, in half panel heights: well within the middle third."""
_SIZES = 0.6, 1.2  # Half panel heights per world unit, at least and at most.
_WIDE = 0.86
"""Share of a panel's width that a head's own may take up: hair and outer views need the rest."""
_FLATTEST = 0.5  # Of its depth a head keeps so much at least: a flatter one looks like a relief.


def composed(field: VoxelField, display: Display, config: EncodeConfig) -> EncodeConfig:
    """The placement that a composition comes to, as a configuration without one.

    Size, shifts, focus and depth scale of the configuration change what is composed: a size of 0.8
    (the default) leaves it, one of 0.4 halves it, a focus of 0.1 moves it towards the viewer.

    A configuration without ``compose`` comes back as it is. A warning says where the panel can't
    keep the head sharp. ``field`` is in the portrait frame.
    """
    if not config.compose:
        return config
    points = head_points(field) if field.backdrop is None else field.backdrop.points
    low, high = (float(v) for v in np.quantile(points[:, 1], [0.002, 0.998]))
    upper = points[points[:, 1] > -_EYES]
    wide = float(np.quantile(np.abs(upper[:, 0]), 0.99)) if len(upper) else 0.5
    scale, up = _stand(display, low, high, wide)
    scale *= config.size / EncodeConfig.size
    depth = _kept_depth(display, scale)
    usual = EncodeConfig()
    # What `Placement.of` does to heads on narrow panels is taken into account already.
    size = scale / min(1.0, 1.15 * display.aspect)
    return replace(config, compose=False, size=size, shift_y=up + config.shift_y - usual.shift_y,
                   focus=config.focus - _FACE * scale * depth * config.depth_scale,
                   depth_scale=depth * config.depth_scale)


def _stand(display: Display, low: float, high: float, wide: float) -> tuple[float, float]:
    """Scale and shift upwards of a head from ``low`` to ``high`` and so wide to each side."""
    # The bust ends behind the panel's plane, where things are a little smaller.
    nearer = display.distance / (display.distance + 0.5)
    scale = (_TOP - _LOW) / max(high - nearer * low, 0.5)
    scale = float(np.clip(scale, *_SIZES))
    scale = min(scale, _WIDE * display.aspect / max(wide, 0.3), 0.3 * display.aspect / _EYES)
    # Above all the bust's end is hidden; then the crown has its distance from the upper edge.
    up = min(_TOP - scale * high, _LOW - nearer * scale * low)
    return scale, float(np.clip(up, -_HIGHEST, _HIGHEST))


def _kept_depth(display: Display, scale: float) -> float:
    """How much of its depth a head of a scale keeps so that it is sharp as far as it is seen."""
    plain = DepthReport.of(display)
    wanted = min(plain.front / ((_NOSE - _FACE) * scale),
                 -plain.back / ((_FACE - _OUTLINE) * scale), 1.0)
    if wanted < _FLATTEST:
        warnings.warn(
            f"{display.name} shows {plain.length(plain.back)} behind its plane sharply, the "
            f"composed head is {(_FACE - _OUTLINE) * scale * _FLATTEST / -plain.back:.1f} times as "
            "deep to its outline: ears and hair blur a little (a smaller --size helps)",
            stacklevel=4)
    return float(max(wanted, _FLATTEST))

_APART = math.radians(3.0)  # Angle between neighbouring eyes that colors are evaluated for.
_LAYERS = 16  # Most such eyes.
_STEEP = 0.77
"""Cosine between a camera's axis and the lattice's from which planes lie close enough."""
_MEMORY = 512 << 20  # Bytes that their colors may take.


def viewpoints(field: VoxelField, eyes: Float64, distance: float, height: float,
               to_world: Float64) -> Float64:
    """Eyes that colors are evaluated for, float64 [L, 3] in the field's world.

    Colors of one coefficient are the same for all eyes.

    Parameters
    ----------
    eyes : float64 [V], x of the views' eyes in the deep display frame, `distance` away and `height`
        up.
    to_world : float64 [3, 4], from that frame to the world.
    """
    first, last = float(eyes[0]), float(eyes[-1])
    layers = 1
    if field.basis > 1:
        cone = math.atan(abs(last) / distance) + math.atan(abs(first) / distance)
        room = _MEMORY // (8 * len(field.bricks.links))
        layers = max(1, min(math.ceil(cone / _APART), _LAYERS, room))
    share = (np.arange(layers) + 0.5) / layers
    places = np.stack([first + (last - first) * share, np.full(layers, height),
                       np.full(layers, distance), np.ones(layers)])
    return np.ascontiguousarray((to_world @ places).T)


def code_on_gpu(process: GpuProcess, field: VoxelField, job: PanelJob, footprint: float,
                read: bool = True, repeats: int = 0) -> tuple[UInt8, dict[str, Any]]:
    """Code a panel on the device (`code_panel`), where the field is sent first if it must be."""
    keys = keep_field(process, field, len(job.viewpoints), footprint)
    image, figures = process.call("lfportrait.lightfield.gpu.panel:code_panel", keys, job, read,
                                  repeats)
    return image, figures


def pictures_on_gpu(process: GpuProcess, field: VoxelField, cameras: Camera, *, background: float,
                    ground: Ground | None) -> UInt8:
    """Pictures of cameras of one size, uint8 [V, H, W, 3], with what is behind the field.

    Rays are sampled on the lattice's planes, as row slices are, and at half steps where they are
    oblique.
    """
    count = len(cameras)
    details = [field.detail_of(cameras, view) for view in range(count)]
    # Views of the same width of detail go together.
    levels = [0 if field.texture is None else field.texture.level(wide) for wide, _ in details]
    out = np.empty((count, int(cameras.height[0]), int(cameras.width[0]), 3), np.uint8)
    for level in sorted(set(levels)):
        some = [view for view in range(count) if levels[view] == level]
        job = _picture_job(field, cameras, some, details[some[0]][1], background, ground)
        out[some] = views_on_gpu(process, field, job, details[some[0]][0])
    return out


def _picture_job(field: VoxelField, cameras: Camera, views: list[int], covered: float,
                 background: float, ground: Ground | None) -> ViewJob:
    """Some views of one width of the texture's detail, as pictures of bytes."""
    ahead = np.abs(cameras.pose[views, 2, 2])
    axis, step = (3, 1.0) if ahead.min() > _STEEP else (0, 0.5)
    rays = None if ground is None else np.stack([ground.rays(cameras, view) for view in views])
    return ViewJob(np.stack([cameras.row(view) for view in views]),
                   (int(cameras.width[0]), int(cameras.height[0])), field.lattice, axis, step,
                   2e-4 * field.lattice[5] if axis else 1e-2, 4e-3 if axis else 1e-3, axis > 0,
                   covered, PROBES, REACH, True, (background,) * 3,
                   None if ground is None else ground.planes, rays)

_FAINTEST = 1e-3
"""Slices leave out samples that hold back less light than this: a quarter of an 8-bit level."""
_STOP = 1e-2
"""Transmittance at which a ray through slices ends; the rest is taken to have the same color."""
_RAYS = 3
"""Rays of a sub-pixel with ``blend="filtered"``; more of them change nothing that one sees."""


def depth_budget(display: Display, placement: Placement) -> dict[str, float]:
    """How much of the head's depth the panel can show sharply.

    Detail at distance z from the panel blurs where its disparity between neighbouring views
    exceeds one lens (Zwicker et al. 2006). Returns ``sharp_depth``: +- z in half panel heights;
    ``sharp_percent``: share of the head's depth of two world units that lies within; ``sharp_mm``
    where the panel's size is known.
    """
    baseline = 2 * display.distance * math.tan(math.radians(display.cone) / 2) / display.views
    lens = display.pitch / 3.0 * 2.0 / display.height
    # A point at z in front of the panel moves by baseline z / (distance - z) from view to view.
    depth = lens * display.distance / (baseline + lens)
    figures = {"sharp_depth": depth,
               "sharp_percent": 100.0 * min(1.0, depth / (placement.scale * placement.depth))}
    if display.panel_height > 0:
        figures["sharp_mm"] = depth * display.panel_height / 2 * 1000.0
    return figures


def _panel(display: Display, config: EncodeConfig, placement: Placement, first: int = 0,
           apart: int = 1) -> Float64:
    """The numbers of a panel as the kernels take them (see `encode_kernel`)."""
    # Cells move sub-pixels; their height within a row is left out, so that a row stays a plane.
    thirds = np.arange(3) + 0.5
    moved = 3.0 * display.places()[..., 0] - thirds if display.cells else np.zeros((4, 2, 3))
    return np.concatenate([
        [display.aspect, display.eye_height, placement.deep_distance(display), placement.scale,
         first, display.height, float(config.blend != "nearest"), apart,
        float(display.subpixels == "BGR"),
         display.pitch, display.shift, display.offset, float(display.inverted)],
        display.steps().ravel(), moved.ravel()])


def _footprint(display: Display, placement: Placement) -> float:
    """Distance in the world between the rays that a view has on the panel.

    They are a row apart downwards and a lens across. A slanted lens moves them from row to row, so
    that what counts is the area of one.
    """
    row = 2.0 / display.height
    return row * math.sqrt(max(display.pitch / 3.0, 1.0)) / placement.scale


def _method(field: VoxelField, display: Display, config: EncodeConfig) -> str:
    """``"slices"`` or ``"direct"``, as asked or as fits."""
    if config.method == "direct":
        return "direct"
    placement = Placement.of(display, config)
    # Slices follow the lattice's planes z = k. Rays must cross them, at 60 degrees at most, and
    # the whole field must lie behind the eyes. The kernel reads 63 columns at a time, of at most
    # 1024, and a ray may not leave them within 16 planes.
    distance, lattice = placement.deep_distance(display), field.lattice
    oblique = math.degrees(abs(placement.turn) + math.atan(display.eye_reach / distance))
    corners = np.abs(field.radius[[0, 2]] * placement.scale).sum() + abs(placement.deep_shift[2])
    fits = bool(oblique <= 60 and corners < 0.9 * distance and lattice[0] <= 1024
                and 16 * math.tan(math.radians(60)) * lattice[3] / lattice[5] < 60)
    if config.method == "slices" and not fits:
        raise UserError("slices need a head that faces the panel (turn and half the cone within 60 "
                        "degrees) and lies before the eyes; use --method direct or auto")
    return "slices" if fits else "direct"


def panel_job(field: VoxelField, display: Display, config: EncodeConfig, height: int = 0,
              first: int = 0, apart: int = 1) -> PanelJob:
    """A panel, or ``height`` of its rows from ``first`` on, ``apart`` apart, as a GPU takes it."""
    placement = Placement.of(display, config)
    distance = placement.deep_distance(display)
    panel = _panel(display, config, placement, first, apart)
    slices = _method(field, display, config) == "slices"
    stride = 2 if config.draft else 1
    step = max(config.step_size, 1.0) if config.draft else config.step_size
    ground = ground_of(field, display, config)
    to_world = np.column_stack([placement.to_world, -placement.to_world @ placement.deep_shift]
                               ) / placement.scale
    colors = viewpoints(field, display.eyes(), distance, display.eye_height, to_world)
    return PanelJob(
        display.width, height or display.height, placement.to_lattice(field.lattice), panel,
        display.eyes(), _RAYS if config.blend == "filtered" else 1,
        2.0 * display.eye_reach * display.breadth / display.pitch, display.gamma,
        3 if slices else 0, stride if slices else step,
        _FAINTEST * field.lattice[5] / stride if slices else 1e-2, _STOP if slices else 1e-3,
        slices, max(config.background, 0.0),
        colors, None if ground is None else ground.planes,
        (0.0,) * 6 if ground is None else (ground.depth / display.distance, ground.left, ground.top,
                                           *ground.texel, display.eye_height),
        # Casting along the lattice's planes is as exact, and faster on GPUs.
        sliced=config.method == "slices" and len(colors) == 1)


def _cast(field: VoxelField, display: Display, config: EncodeConfig, mask: Array, fixed: int,
          first: int = 0, apart: int = 1, ground: Ground | None = None) -> UInt8:
    """Code the rows of a mask [h, W, 3]: of the panel from ``first`` on, ``apart`` apart."""
    bricks = field.bricks
    placement = Placement.of(display, config)
    panel = _panel(display, config, placement, first, apart)
    rays = _RAYS if config.blend == "filtered" else 1
    # Under its lens a sub-pixel takes up one in L_n of the cone, or where a pixel's colors lie in
    # one place, three: its eyes spread over that.
    spread = (2.0 * display.eye_reach * display.breadth / display.pitch
              * ((np.arange(rays) + 0.5) / rays - 0.5))
    pictures = np.empty((rays, len(mask), display.width * 3), np.uint8)
    eyes = [display.eyes() + away for away in spread]
    matrix, axes = placement.to_lattice(field.lattice), placement.to_world[:, [0, 2]].T.copy()
    views = mask.reshape(len(mask), display.width * 3).view()
    # Masks from the cache can't be written to; for all others kernels would be compiled once more.
    views.flags.writeable = False
    texture = field.texture_rows(_footprint(display, placement), whole=True)
    background = np.float32(max(config.background, 0.0))  # where there is no ground
    ground = ground or ground_of(field, display, config)
    if ground is not None:
        # Below 0: the picture holds what is behind the field already.
        background = np.float32(-1.0)
        for own, out in zip(eyes, pictures, strict=True):
            ground.fill(display, panel, views, fixed, own, out)
    if _method(field, display, config) == "slices":
        stride, stretches = 2 if config.draft else 1, field.stretches
        for own, out in zip(eyes, pictures, strict=True):
            slice_kernel(field.basis)(
                stretches.places, stretches.occupied, stretches.values, bricks.table,
                *texture, field.lattice, matrix, axes, views, fixed, own, panel, stride,
                _FAINTEST * field.lattice[5] / stride, _STOP,
                background, numba.get_num_threads(), out)
    else:
        step = max(config.step_size, 1.0) if config.draft else config.step_size
        for own, out in zip(eyes, pictures, strict=True):
            encode_kernel(bricks.width, bricks.basis)(
                bricks.table, bricks.links, bricks.density, bricks.rows, *texture, field.lattice,
                matrix, axes, views, fixed, own, panel, step, 1e-2, 1e-3,
                background, out)
    if rays > 1:
        mix_light(pictures, ((np.arange(256) / 255.0) ** display.gamma), display.gamma)
    out = pictures[0] if rays == 1 else pictures[0].copy()
    image = out.reshape(len(mask), display.width, 3)
    return image[..., ::-1].copy() if display.subpixels == "BGR" else image


def encode_with_figures(field: VoxelField, display: Display, config: EncodeConfig | None = None, *,
                        mask: ViewMask | None = None, device: str = "auto",
                        ) -> tuple[UInt8, dict[str, Any]]:
    """`encode`, and the figures of the run for ``--json``."""
    config = composed(field, display, config or EncodeConfig())
    if mask is not None and mask.display != display.hash():
        raise ValueError("the mask was computed for another display")
    coded = _coded_on_gpu(field, display, config, gpu_adapter(device))
    if coded is not None:
        return coded
    start = time.perf_counter()
    if mask is None:
        mask = ViewMask.build(display)
    views = np.asarray(mask.views)
    field.bricks  # noqa: B018 - laid out before the clock of the casting starts
    laid_out = time.perf_counter()
    image = _cast(field, display, config, views, -1)
    end = time.perf_counter()
    figures = {
        "method": _method(field, display, config), "subpixels": 3 * display.width * display.height,
        "views": display.views, "display": display.name, "device": "cpu",
        "seconds": {"mask": round(mask.seconds, 4), "cast": round(end - laid_out, 4),
                    "total": round(end - start + mask.seconds, 4)},
        "mask": {"loaded": mask.loaded, "bytes": int(mask.views.nbytes)},
        "depth_budget": depth_budget(display, Placement.of(display, config))}
    return image, figures


def _coded_on_gpu(field: VoxelField, display: Display, config: EncodeConfig,
                  adapter: Adapter | None) -> tuple[UInt8, dict[str, Any]] | None:
    """What `encode_with_figures` gives, from a GPU; None where there is none, or it was lost."""
    if adapter is None:
        return None
    start = time.perf_counter()
    placement = Placement.of(display, config)
    job = panel_job(field, display, config)
    coded = attempted(adapter, lambda process: code_on_gpu(
        process, field, job, _footprint(display, placement)))
    if coded is None:
        return None
    image, seconds = coded
    seconds.pop("field_bytes")
    return image, {
        "method": "slices" if job.sliced else "planes" if job.axis else "direct",
        "subpixels": 3 * display.width * display.height,
        "views": display.views, "display": display.name, "device": device_name(adapter),
        "seconds": {"mask": 0.0, **{name: round(spent, 4) for name, spent in seconds.items()},
                    "total": round(time.perf_counter() - start, 4)},
        "mask": {"loaded": False, "bytes": 0}, "depth_budget": depth_budget(display, placement)}


def code_on_device(process: GpuProcess, field: VoxelField, display: Display, config: EncodeConfig,
                   repeats: int) -> dict[str, float]:
    """Figures of coding on a GPU with nothing read back (`lightfield.gpu.panel.code_panel`)."""
    job = panel_job(field, display, config)
    footprint = _footprint(display, Placement.of(display, config))
    return code_on_gpu(process, field, job, footprint, read=False, repeats=repeats)[1]


def encode(field: VoxelField, display: Display, config: EncodeConfig | None = None, *,
           mask: ViewMask | None = None, device: str = "auto") -> UInt8:
    """Code a field for a display.

    Parameters
    ----------
    field : The (stylised) radiance field.
    display : The panel.
    config : Placement and quality.
    mask : The display's mask guide; built or loaded from the cache if None.
    device : Where to compute (`lfportrait.device.gpu_adapter`); ``mask`` is not used on a GPU.

    Returns
    -------
    image : uint8 [H, W, 3]: show it on the panel pixel for pixel, unscaled.
    """
    return encode_with_figures(field, display, config, mask=mask, device=device)[0]


def encode_rows(field: VoxelField, display: Display, config: EncodeConfig | None, first: int,
                count: int, apart: int = 1, *, views: Unsigned | None = None,
                ground: Ground | None = None) -> UInt8:
    """Code some rows of a panel, uint8 [count, W, 3]: the same as these rows of `encode`.

    So a picture that is too large for the memory is coded from the top down, and a small copy of it
    from every n-th row.

    Parameters
    ----------
    first, count, apart : The first row, how many, and how far apart they are.
    views, ground : Their views (`row_views`), and what lies behind the head (`ground_of`), where
        the caller has them.
    """
    if first < 0 or count < 1 or apart < 1 or first + (count - 1) * apart >= display.height:
        raise ValueError("these rows are not the panel's")
    if views is None:
        views = row_views(display, first, count, apart)
    config = composed(field, display, config or EncodeConfig())
    return _cast(field, display, config, views, -1, first, apart, ground)


def render_view(field: VoxelField, display: Display, view: int,
                config: EncodeConfig | None = None) -> UInt8:
    """Every sub-pixel of the panel as one view sees it: what de-interlacing must give back.

    Parameters
    ----------
    field, display, config : As for `encode`.
    view : 0 (leftmost) to V_n - 1.

    Returns
    -------
    image : uint8 [H, W, 3].
    """
    if not 0 <= view < display.views:
        raise UserError(f"the display has views 0 to {display.views - 1}, not {view}")
    empty = np.zeros((display.height, display.width, 3), np.uint8)
    return _cast(field, display, composed(field, display, config or EncodeConfig()), empty, view)


def view_camera(display: Display, config: EncodeConfig | None, eye: float, *, width: int,
                height: int) -> Camera:
    """The off-axis pinhole, a batch of one, at an eye point whose picture is the panel's window.

    ``eye`` is its x in the display frame; the picture has ``width`` x ``height`` pixels.
    """
    placement = Placement.of(display, config or EncodeConfig())
    y = display.eye_height
    pixel = np.array([2.0 * display.aspect / width, 2.0 / height])
    pose = np.eye(4)
    pose[1, 1] = pose[2, 2] = -1.0
    pose[:3, :3] = placement.to_world @ pose[:3, :3]
    distance = placement.deep_distance(display)
    pose[:3, 3] = placement.to_world @ (
        np.array([eye, y, distance]) - placement.deep_shift) / placement.scale
    return Camera(pose[None], (distance / pixel)[None],
                  np.array([[(eye + display.aspect) / pixel[0], (1.0 - y) / pixel[1]]]),
                  np.array([width]), np.array([height]))
