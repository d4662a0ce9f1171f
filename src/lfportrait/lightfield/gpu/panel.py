"""Coding a panel on a device: what `panel.wgsl` needs, and its bands.

`code_panel` runs beside the device; `PanelJob` is made by the caller, of numbers and small arrays
alone, so that it can be sent there.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...field.gpu import Atlas, DeviceTexture, picture_texture, shader
from ...gpu.device import BINDING, Device, bands

__all__ = ["PanelJob", "code_panel"]

_TILE = 16
"""Pixels along a side of a workgroup's tile."""


@dataclass(frozen=True)
class PanelJob:
    """A panel, or some of its rows, to be coded.

    Attributes
    ----------
    width, height
        Pixels of the picture.
    matrix
        float64 [3, 4], from the deep display frame to the lattice.
    panel
        float64 [61], the panel's numbers as `encode_kernel` takes them.
    eyes
        float64 [V], x of the views' eyes.
    fixed
        One view for all sub-pixels, or -1.
    rays, spread, gamma
        Rays a sub-pixel; how far their outermost eyes would lie apart; gamma of the panel.
    axis, step
        1, 2 or 3: samples lie where rays cross lattice planes of x, y or z, ``step`` planes apart;
        0: they lie ``step`` lattice units apart.
    threshold, stop, whole
        Density that counts; transmittance at which rays end; whether the rest has their color.
    background
        Grey level behind the field.
    viewpoints
        float64 [L, 3], eyes in the field's world that colors are evaluated for.
    ground
        float32 [3, R, C], 0 to 255, or None.
    ground_place
        Its depth over the eyes' distance, left, top, width and height of a texel, eyes' height.
    """

    width: int
    height: int
    matrix: NDArray[np.float64]
    panel: NDArray[np.float64]
    eyes: NDArray[np.float64]
    fixed: int
    rays: int
    spread: float
    gamma: float
    axis: int
    step: float
    threshold: float
    stop: float
    whole: bool
    background: float
    viewpoints: NDArray[np.float64]
    ground: NDArray[np.float32] | None = None
    ground_place: tuple[float, ...] = (0.0,) * 6
    ordered: bool = True

    def uniform(self, first: int, rows: int) -> NDArray[np.uint8]:
        """The uniform ``panel`` of `panel.wgsl` for a band of rows, uint8 [384]."""
        out = np.zeros(384, np.uint8)
        floats, words = out.view(np.float32), out.view(np.uint32)
        numbers = self.panel
        floats[0:12] = self.matrix.ravel()
        floats[12:16] = numbers[0:4]
        floats[16:20] = 3 * self.width, numbers[5], numbers[4], numbers[7]
        floats[20:24] = self.eyes[0], self.eyes[-1], len(self.eyes), numbers[6]
        floats[24:28] = self.rays, self.spread, self.gamma, self.fixed
        floats[28:32] = self.axis, self.step, self.background, len(self.viewpoints)
        place = self.ground_place
        floats[32:36] = *place[:3], self.ground is not None
        floats[36:40] = *place[3:6], numbers[8]
        pitch = numbers[9]
        words[40:44] = (_wrapped(3.0 / pitch), _wrapped(numbers[10] / pitch),
                        _wrapped(numbers[11] / pitch), numbers[12] > 0.5)
        words[44:48] = self.width, first, rows, self.words
        words[48:72] = [_wrapped(step / pitch) for step in numbers[13:37]]
        floats[72:96] = numbers[37:61]
        return out

    @property
    def words(self) -> int:
        """Words of a row of the picture on the device: whole tiles."""
        return -(-self.width // _TILE) * 12


def _wrapped(turns: float) -> int:
    """A fraction of a turn in 32 bits."""
    return round((turns % 1.0) * 2 ** 32) % 2 ** 32


def code_panel(device: Device, keys: tuple[str, str], job: PanelJob, read: bool = True,
               repeats: int = 0) -> tuple[NDArray[np.uint8], dict[str, float]]:
    """Code a panel.

    Parameters
    ----------
    device, keys
        The device, and the names of the field and its texture there (`upload`, `keep_texture`).
    job
        The panel.
    read
        Whether the picture is wanted; else it stays on the device.
    repeats
        How often to code it once more, to measure.

    Returns
    -------
    picture, figures
        uint8 [H, W, 3]; seconds of shading, of coding (all bands), of reading back; and, with
        ``repeats``, the least of a repetition.
    """
    atlas: Atlas = device.kept["fields"][keys[0]]
    texture: DeviceTexture = device.kept["textures"][keys[1]]
    job = replace(job, viewpoints=job.viewpoints[:atlas.layers])
    start = time.perf_counter()
    atlas.shade(job.viewpoints)
    device.wait()
    shaded = time.perf_counter()
    kernel = device.kernel(shader("field/gpu/march.wgsl", "lightfield/gpu/panel.wgsl"), "main",
                           {"sorted": job.ordered})
    marching = device.buffer(
        atlas.march_uniform(job.threshold, job.stop, job.whole, texture.there), uniform=True)
    ground = picture_texture(device, job.ground)
    tiles = -(-job.width // _TILE)
    most = max(_TILE, min(job.height, BINDING // (4 * job.words) // _TILE * _TILE))
    device.wait()
    ready = time.perf_counter()
    parts, best, reading = [], float("inf"), 0.0
    for first in range(0, job.height, most):
        rows = min(most, job.height - first)
        picture = device.buffer(4 * job.words * rows)
        sizes: list[tuple[int, int]] = []

        def run(since: int, until: int, first: int = first, rows: int = rows,
                picture: Any = picture) -> None:
            """Code tile rows of this part."""
            begin = since * _TILE
            many = min(until * _TILE, rows) - begin
            panel = device.buffer(job.uniform(first + begin, many), uniform=True)
            part = (picture, 4 * job.words * begin, 4 * job.words * many)
            group = device.bind(kernel, {
                0: marching, 1: atlas.table, 2: atlas.masks, 3: atlas.texture,
                4: device.sampler(), 5: texture.cells, 6: texture.charts, 7: texture.texels,
                8: panel, 9: ground, 10: part})
            device.run((kernel, group, (tiles, until - since, 1)))

        sizes = bands(-(-rows // _TILE), 4, run, device.wait)
        device.wait()
        for _ in range(repeats):
            begin = time.perf_counter()
            for since, until in _joined(sizes):
                run(since, until)
            device.wait()
            best = min(best, time.perf_counter() - begin)
        if read:
            begin = time.perf_counter()
            raw = device.read(picture, np.uint8, (rows, job.words * 4))
            parts.append(raw[:, :3 * job.width].reshape(rows, job.width, 3))
            reading += time.perf_counter() - begin
    done = time.perf_counter()
    whole = (np.concatenate(parts) if len(parts) > 1 else np.ascontiguousarray(parts[0])
             ) if read else np.zeros((0, 0, 3), np.uint8)
    figures = {"shade": shaded - start, "cast": done - ready - reading, "read": reading,
               "field_bytes": atlas.nbytes}
    if repeats:
        figures["repeated"] = best
    return whole, figures


def _joined(sizes: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Bands as they are once their size is known: the calibration's joined to the next one."""
    largest = max(until - since for since, until in sizes)
    total = sizes[-1][1]
    return [(since, min(since + largest, total)) for since in range(0, total, largest)]
