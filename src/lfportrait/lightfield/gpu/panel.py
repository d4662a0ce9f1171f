"""Coding a panel on a device: what `panel.wgsl` needs, and its bands.

`code_panel` runs beside the device; `PanelJob` is made by the caller, of numbers and small arrays
alone, so that it can be sent there.
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arrays import Float32, Float64, UInt8
from ...field.gpu import Atlas, DeviceTexture, picture_texture, shader
from ...gpu import BINDING, Device, bands

_TILE = 16  # Pixels along a side of a workgroup's tile.
_TILE_ROWS = 4  # Rows of tiles whose slices are kept at once.


@dataclass(frozen=True)
class PanelJob:
    """A panel, or some of its rows, to be coded."""

    # width, height: Pixels of the picture.
    width: int
    height: int
    matrix: Float64  # float64 [3, 4], from the deep display frame to the lattice.
    panel: Float64  # float64 [61], the panel's numbers as `encode_kernel` takes them.
    eyes: Float64  # float64 [V], x of the views' eyes.
    # rays, spread, gamma: Rays a sub-pixel; how far their outermost eyes would lie apart; gamma of
    # the panel.
    rays: int
    spread: float
    gamma: float
    # axis, step: 1, 2 or 3: samples lie where rays cross lattice planes of x, y or z, ``step``
    # planes apart; 0: they lie ``step`` lattice units apart.
    axis: int
    step: float
    # threshold, stop, whole: Density that counts; transmittance at which rays end; whether the rest
    # has their color.
    threshold: float
    stop: float
    whole: bool
    background: float  # Grey level behind the field.
    viewpoints: Float64  # float64 [L, 3], eyes in the field's world that colors are evaluated for.
    ground: Float32 | None = None  # float32 [3, R, C], 0 to 255, or None.
    # Its depth over the eyes' distance, left, top, width and height of a texel, eyes' height.
    ground_place: tuple[float, ...] = (0.0,) * 6
    ordered: bool = True  # Sort the sub-pixels of a tile by view.
    sliced: bool = False  # Cast through row slices: for ``axis`` 3 and colors of one viewpoint.

    def uniform(self, first: int, rows: int) -> UInt8:
        """The uniform ``panel`` of `panel.wgsl` for a band of rows, uint8 [384]."""
        out = np.zeros(384, np.uint8)
        floats, words = out.view(np.float32), out.view(np.uint32)
        numbers = self.panel
        floats[0:12] = self.matrix.ravel()
        floats[12:16] = numbers[0:4]
        floats[16:20] = 3 * self.width, numbers[5], numbers[4], numbers[7]
        floats[20:24] = self.eyes[0], self.eyes[-1], len(self.eyes), numbers[6]
        floats[24:27] = self.rays, self.spread, self.gamma
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


class _Coder:
    """A panel's shaders and what they are bound to."""

    def __init__(self, device: Device, keys: tuple[str, str], job: PanelJob) -> None:
        self.device, self.job = device, job
        self.atlas: Atlas = device.kept["fields"][keys[0]]
        self.texture: DeviceTexture = device.kept["textures"][keys[1]]
        files = ["field/gpu/march.wgsl", "lightfield/gpu/panel.wgsl",
                 f"lightfield/gpu/{'slices' if job.sliced else 'direct'}.wgsl"]
        self.source = shader(*files)
        self.main = device.kernel(self.source, "main", {"sorted": job.ordered})
        self.field = device.buffer(self.atlas.march_uniform(
            job.threshold, job.stop, job.whole, self.texture.there), uniform=True)
        self.ground = picture_texture(device, job.ground)
        self.slices = _Slices(self) if job.sliced else None

    def code(self, picture: Any, first: int, since: int, until: int, rows: int) -> None:
        """Code tile rows ``since`` to ``until`` of ``picture``, ``rows`` from row ``first`` on."""
        most = until - since if self.slices is None else _TILE_ROWS
        for tile in range(since, until, most):
            begin = tile * _TILE
            many = min(min(tile + most, until) * _TILE, rows) - begin
            panel = self.device.buffer(self.job.uniform(first + begin, many), uniform=True)
            words = 4 * self.job.words
            bound = {0: self.field, 1: self.atlas.table, 4: self.device.sampler(),
                     5: self.texture.cells, 6: self.texture.charts, 7: self.texture.texels,
                     8: panel, 9: self.ground, 10: (picture, words * begin, words * many)}
            if self.slices is None:
                bound |= {2: self.atlas.masks, 3: self.atlas.texture}
                before: list[Any] = []
            else:
                bound |= {14: self.slices.slabs, 15: self.slices.spans}
                before = self.slices.steps(panel, many)
            self.device.run(*before, (self.main, self.device.bind(self.main, bound),
                                      (-(-self.job.width // _TILE), -(-many // _TILE), 1)))


class _Slices:
    """The slices of some rows of a panel (`slices.wgsl`)."""

    def __init__(self, coder: _Coder) -> None:
        device, job, self.coder = coder.device, coder.job, coder
        self.size = [int(number) for number in coder.atlas.lattice[:3]]
        self.empty, self.build = (device.kernel(coder.source, name) for name in ("empty", "build"))
        self.slabs = device.texture((self.size[0], self.size[2]), "rgba16float", written=True,
                                    layers=_TILE * _TILE_ROWS)
        self.planes = self.size[2] + -(-self.size[2] // 16)
        self.spans = device.buffer(8 * self.planes * _TILE * _TILE_ROWS)
        self.uniform = device.buffer(_slice_uniform(job), uniform=True)

    def steps(self, panel: Any, rows: int) -> list[Any]:
        """What fills the slices of a band of rows."""
        coder, device = self.coder, self.coder.device
        build = device.bind(self.build, {
            0: coder.field, 1: coder.atlas.table, 3: coder.atlas.texture, 4: device.sampler(),
            8: panel, 11: self.uniform, 12: self.slabs, 13: self.spans})
        return [(self.empty, device.bind(self.empty, {13: self.spans}),
                 (-(-2 * self.planes * rows // 64), 1, 1)),
                (self.build, build, (-(-self.size[0] // 64), self.size[2], rows))]


def _slice_uniform(job: PanelJob) -> UInt8:
    """The uniform ``slice`` of `slices.wgsl`, uint8 [32]: lattice rows of a panel row's plane."""
    matrix, eye_y, distance = job.matrix, job.panel[1], job.panel[2]
    det = matrix[0, 0] * matrix[2, 2] - matrix[0, 2] * matrix[2, 0]
    depth_i, depth_k = -matrix[2, 0] / det, matrix[0, 0] / det
    depth = np.array([-depth_i * matrix[0, 3] - depth_k * matrix[2, 3], depth_i, depth_k])
    lift = matrix[1, 1] / distance * depth
    out = np.zeros(8, np.float32)
    out[0:3] = eye_y * lift + [matrix[1, 3], 0, 0]
    out[4:7] = [matrix[1, 1], 0, 0] - lift
    return out.view(np.uint8)


def code_panel(device: Device, keys: tuple[str, str], job: PanelJob, read: bool = True,
               repeats: int = 0) -> tuple[UInt8, dict[str, float]]:
    """Code a panel: uint8 [H, W, 3], and figures.

    The figures are seconds of shading, of coding (all bands), of reading back; with ``repeats``,
    those of one of them, sent off one after the other; bytes of the field.

    Parameters
    ----------
    keys : Names of the field and its texture on the device (`upload`, `keep_texture`).
    read : Whether the picture is wanted; else it stays on the device.
    """
    atlas: Atlas = device.kept["fields"][keys[0]]
    job = replace(job, viewpoints=job.viewpoints[:atlas.layers])
    start = time.perf_counter()
    atlas.shade(job.viewpoints)
    device.wait()
    shaded = time.perf_counter()
    coder = _Coder(device, keys, job)
    most = max(_TILE, min(job.height, BINDING // (4 * job.words) // _TILE * _TILE))
    device.wait()
    parts, coding, repeated, reading = [], 0.0, 0.0, 0.0
    # Bands of what was coded before need no calibration.
    paces: dict[Any, int] = device.kept.setdefault("paces", {})
    kind = keys, job.width, job.sliced, job.axis, job.rays
    for first in range(0, job.height, most):
        rows = min(most, job.height - first)
        picture = device.buffer(4 * job.words * rows)

        def run(since: int, until: int, first: int = first, rows: int = rows,
                picture: Any = picture) -> None:
            """Code tile rows of this part."""
            coder.code(picture, first, since, until, rows)

        begin = time.perf_counter()
        pace = bands(-(-rows // _TILE), paces.get(kind, 4), run, device.wait)
        paces[kind] = pace
        device.wait()
        coding += time.perf_counter() - begin
        begin = time.perf_counter()
        for _ in range(repeats):
            for since in range(0, -(-rows // _TILE), pace):
                run(since, min(since + pace, -(-rows // _TILE)))
        device.wait()
        repeated += (time.perf_counter() - begin) / max(repeats, 1)
        if read:
            begin = time.perf_counter()
            raw = device.read(picture, np.uint8, (rows, job.words * 4))
            parts.append(raw[:, :3 * job.width].reshape(rows, job.width, 3))
            reading += time.perf_counter() - begin
    whole = (np.concatenate(parts) if len(parts) > 1 else np.ascontiguousarray(parts[0])
             ) if read else np.zeros((0, 0, 3), np.uint8)
    figures = {"shade": shaded - start, "cast": coding, "read": reading,
               "field_bytes": atlas.nbytes}
    if repeats:
        figures["repeated"] = repeated
    return whole, figures
