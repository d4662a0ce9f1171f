"""Rendering pinhole views on a device: what `view.wgsl` needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...gpu.device import Device, bands
from .atlas import Atlas
from .shaders import shader
from .textures import DeviceTexture, picture_texture

__all__ = ["ViewJob", "render_views"]

_GROUP = 8
"""Pixels along a side of a workgroup."""


@dataclass(frozen=True)
class ViewJob:
    """Views to be rendered, of one size.

    Attributes
    ----------
    cameras
        float64 [V, 16] (`camera_row`).
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

    cameras: NDArray[np.float64]
    size: tuple[int, int]
    lattice: NDArray[np.float64]
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
    ground: NDArray[np.float32] | None = None
    ground_rays: NDArray[np.float64] | None = None

    def uniform(self, view: int, first: int, rows: int) -> NDArray[np.uint8]:
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
    texture: DeviceTexture = device.kept["textures"][keys[1]]
    width, height = job.size
    source = shader("field/gpu/march.wgsl", "field/gpu/view.wgsl")
    look, paint, pack = (device.kernel(source, name) for name in ("look", "paint", "bytes"))
    marching = device.buffer(
        atlas.march_uniform(job.threshold, job.stop, job.whole, texture.there), uniform=True)
    shots, depths = device.buffer(16 * width * height), device.buffer(4 * width * height)
    picture = device.buffer(4 * width * height if job.eight_bit else 16)
    ground = picture_texture(device, job.ground)
    out: list[tuple[NDArray[Any], ...]] = []
    for view, camera in enumerate(job.cameras):
        atlas.shade(camera[None, [3, 7, 11]])

        def run(since: int, until: int, view: int = view) -> None:
            """Render rows of groups."""
            rows = min(until * _GROUP, height) - since * _GROUP
            uniform = device.buffer(job.uniform(view, since * _GROUP, rows), uniform=True)
            marched = {0: marching, 1: atlas.table, 2: atlas.masks, 3: atlas.texture,
                       4: device.sampler()}
            device.run((look, device.bind(look, {**marched, 8: uniform, 9: shots, 10: depths}),
                        (-(-width // _GROUP), until - since, 1)))

        bands(-(-height // _GROUP), 8, run, device.wait)
        uniform = device.buffer(job.uniform(view, 0, height), uniform=True)
        groups = (-(-width // _GROUP), -(-height // _GROUP), 1)
        if texture.there:
            device.run((paint, device.bind(paint, {
                0: marching, 1: atlas.table, 4: device.sampler(), 5: texture.cells,
                6: texture.charts, 7: texture.texels, 8: uniform, 9: shots, 10: depths}), groups))
        if job.eight_bit:
            device.run((pack, device.bind(pack, {
                4: device.sampler(), 8: uniform, 9: shots, 11: ground, 12: picture}), groups))
            out.append((device.read(picture, np.uint8, (height, width, 4))[..., :3],))
        else:
            shot = device.read(shots, np.float32, (height, width, 4))
            depth = device.read(depths, np.float32, (height, width))
            depth[depth > 1e30] = np.inf
            out.append((shot[..., :3], shot[..., 3], depth))
    parts = tuple(np.stack(part) for part in zip(*out, strict=True))
    return parts[0] if job.eight_bit else parts
