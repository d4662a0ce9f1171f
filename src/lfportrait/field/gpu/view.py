"""Rendering pinhole views on a device: what `view.wgsl` needs, and what is sent there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ...arrays import Float32, Float64, UInt8
from ...gpu import GpuProcess
from ...gpu.device import BINDING, Device, bands
from ..kernels.bricks import Bricks
from ..texture import SurfaceTexture, TextureRows
from .atlas import Atlas, DeviceTexture, field_parts, picture_texture, shader, texture_parts

_GROUP = 8
"""Pixels along a side of a workgroup."""


@dataclass(frozen=True)
class ViewJob:
    """Views to be rendered, of one size.

    Attributes
    ----------
    cameras
        float64 [V, 16] (`Camera.row`).
    size
        Width and height in pixels.
    lattice
        float64 [9], `VoxelField.lattice`.
    axis, step
        1, 2 or 3: samples lie where rays cross lattice planes of x, y or z, ``step`` planes apart;
        0: they lie ``step`` lattice units apart.
    threshold, stop, whole
        Density that counts; transmittance at which rays end; whether the rest has their color.
    covered, probes, reach
        How long a piece of surface may be, in world units, for one look-up of the texture; most
        look-ups; width of detail along a piece over its length.
    eight_bit
        Pictures of bytes are wanted, not colors, opacities and depths.
    background
        Red, green and blue behind the field, in [0, 1], for pictures of bytes.
    ground
        float32 [3, R, C], 0 to 255: what is behind it instead; or None.
    ground_rays
        float64 [V, 4, 3], in the ground's texels: each camera's place, its ray's growth for a pixel
        to the right and below, and the first pixel's.
    """

    cameras: Float64
    size: tuple[int, int]
    lattice: Float64
    axis: int
    step: float
    threshold: float
    stop: float
    whole: bool
    covered: float
    probes: int
    reach: float
    eight_bit: bool = False
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ground: Float32 | None = None
    ground_rays: Float64 | None = None

    def uniform(self, view: int, first: int, rows: int) -> UInt8:
        """The uniform ``view`` of `view.wgsl` for a band of rows, uint8 [208]."""
        out = np.zeros(208, np.uint8)
        floats, words = out.view(np.float32), out.view(np.uint32)
        floats[0:16] = self.cameras[view]
        floats[16:19], floats[19] = self.lattice[3:6], self.axis
        floats[20:23], floats[23] = self.lattice[6:9], self.step
        words[24:28] = *self.size, first, rows
        floats[28:31] = min(self.covered, 1e30), self.probes, self.reach
        floats[32:35], floats[35] = self.background, self.ground is not None
        if self.ground_rays is not None:
            floats[36:52].reshape(4, 4)[:, :3] = self.ground_rays[view]
        return out


def render_views(device: Device, keys: tuple[str, str], job: ViewJob) -> Any:
    """Render views, one after the other.

    Parameters
    ----------
    device, keys
        The device, and the names of the field and its texture there.
    job
        The views.

    Returns
    -------
    pictures
        uint8 [V, H, W, 3] if ``job.eight_bit``; else colors float32 [V, H, W, 3], opacities and
        depths [V, H, W], without a background.
    """
    atlas: Atlas = device.kept["fields"][keys[0]]
    viewer = _Viewer(device, atlas, device.kept["textures"][keys[1]], job)
    width, height = job.size
    # Pictures lie side by side in a buffer, each at a place that can be bound.
    size = -(-4 * width * height // 256) * 256
    together = max(1, min(len(job.cameras), BINDING // size))
    picture = device.buffer(size * together if job.eight_bit else 16)
    out: list[Any] = []
    for view in range(len(job.cameras)):
        if view == 0 or atlas.basis > 1:
            atlas.shade(job.cameras[view][None, [3, 7, 11]])
        viewer.look(view)
        if not job.eight_bit:
            out.append(viewer.read())
            continue
        viewer.pack(view, (picture, size * (view % together), size))
        if view % together == together - 1 or view == len(job.cameras) - 1:
            many = view % together + 1
            raw = device.read(picture, np.uint8, (many, size))[:, :4 * width * height]
            out.extend(raw.reshape(many, height, width, 4)[..., :3])
    if job.eight_bit:
        return np.stack(out)
    return tuple(np.stack(part) for part in zip(*out, strict=True))


class _Viewer:
    """Shaders and buffers for views of one size."""

    def __init__(self, device: Device, atlas: Atlas, texture: DeviceTexture, job: ViewJob) -> None:
        self.device, self.job, self.texture = device, job, texture
        width, height = job.size
        source = shader("field/gpu/march.wgsl", "field/gpu/view.wgsl")
        self.kernels = {name: device.kernel(source, name) for name in ("look", "paint", "bytes")}
        self.shots = device.buffer(16 * width * height)
        self.depths = device.buffer(4 * width * height)
        self.ground = picture_texture(device, job.ground)
        self.groups = -(-width // _GROUP), -(-height // _GROUP), 1
        self.bound = {
            0: device.buffer(atlas.march_uniform(job.threshold, job.stop, job.whole,
                                                 texture.there), uniform=True),
            1: atlas.table, 2: atlas.masks, 3: atlas.texture, 4: device.sampler(),
            5: texture.cells, 6: texture.charts, 7: texture.texels, 9: self.shots,
            10: self.depths, 11: self.ground}

    def _group(self, name: str, numbers: tuple[int, ...], **more: Any) -> Any:
        """What a kernel is bound to: the resources of these numbers, uniform and picture."""
        resources = {number: self.bound[number] for number in numbers}
        return self.device.bind(self.kernels[name], {
            **resources, **{int(number[1:]): value for number, value in more.items()}})

    def look(self, view: int) -> None:
        """Cast a view's rays, and add the texture."""
        device, height = self.device, self.job.size[1]

        def run(since: int, until: int) -> None:
            """Cast rows of groups."""
            rows = min(until * _GROUP, height) - since * _GROUP
            uniform = device.buffer(self.job.uniform(view, since * _GROUP, rows), uniform=True)
            group = self._group("look", (0, 1, 2, 3, 4, 9, 10), _8=uniform)
            device.run((self.kernels["look"], group, (self.groups[0], until - since, 1)))

        paces: dict[Any, int] = device.kept.setdefault("view paces", {})
        kind = self.job.size[0], self.job.axis
        if kind in paces:
            for since in range(0, self.groups[1], paces[kind]):
                run(since, min(since + paces[kind], self.groups[1]))
        else:
            paces[kind] = bands(self.groups[1], 8, run, device.wait)
        self.uniform = device.buffer(self.job.uniform(view, 0, height), uniform=True)
        if self.texture.there:
            device.run((self.kernels["paint"], self._group(
                "paint", (0, 1, 4, 5, 6, 7, 9, 10), _8=self.uniform), self.groups))

    def pack(self, view: int, picture: Any) -> None:
        """Write the view that was looked at as bytes."""
        group = self._group("bytes", (4, 9, 11), _8=self.uniform, _12=picture)
        self.device.run((self.kernels["bytes"], group, self.groups))

    def read(self) -> tuple[Float32, ...]:
        """Color, opacity and depth of the view that was looked at."""
        width, height = self.job.size
        shot = self.device.read(self.shots, np.float32, (height, width, 4))
        depth = self.device.read(self.depths, np.float32, (height, width))
        depth[depth > 1e30] = np.inf
        return shot[..., :3], shot[..., 3], depth


_STAGE = "lfportrait.field.gpu"


class Castable(Protocol):
    """What is sent of a field (`lfportrait.field.VoxelField`, whose module loads this one)."""

    texture: SurfaceTexture | None

    @property
    def bricks(self) -> Bricks:
        """The layout for casting."""

    @property
    def lattice(self) -> Float64:
        """Points along x, y, z; scale and offset."""

    def texture_rows(self, footprint: float, whole: bool = False) -> TextureRows:
        """Charts of cells, projections, texels."""


def keep_field(process: GpuProcess, field: Castable, layers: int, footprint: float,
               whole: bool = True) -> tuple[str, str]:
    """Have a field and its texture on the device; returns their names there.

    Parameters
    ----------
    process, field
        The device's process, and the field.
    layers
        Eyes that its colors are kept for.
    footprint, whole
        Width of the texture's detail that is wanted (`VoxelField.texture_rows`).
    """
    bricks = field.bricks
    key = f"{bricks.token} {layers}"
    if not process.holds("fields", key):
        process.note("fields", process.call(f"{_STAGE}.atlas:upload", key,
                                            field_parts(bricks, field.lattice), layers))
    texture = field.texture
    name = "none" if texture is None else f"{bricks.token} {texture.level(footprint, whole)}"
    if not process.holds("textures", name):
        parts = None if texture is None else texture_parts(field.texture_rows(footprint, whole))
        process.note("textures", process.call(f"{_STAGE}.atlas:keep_texture", name, parts))
    return key, name


def views_on_gpu(process: GpuProcess, field: Castable, job: ViewJob, footprint: float) -> Any:
    """Render views on the device (`render_views`), where the field is sent first if it must be."""
    keys = keep_field(process, field, 1, footprint, whole=False)
    return process.call(f"{_STAGE}.view:render_views", keys, job)
