"""A field laid out on a device: bricks, their masks, the atlas, its painted texture; views of it.

`march.wgsl` casts through it. On the CPU a sample gathers eight densities and eight color rows;
here both are one look-up of a texture of half floats, which the GPU interpolates itself. What is
uploaded is what `Bricks` holds; colors are evaluated on the device for an eye (`Atlas.shade`), so
that a mixture or another eye uploads nothing but coefficients. `view.wgsl` renders pinhole views.

Buffers larger than a shader may see at once are uploaded in pages: of bricks for links and
densities, of rows for coefficients. The texture itself has no such bound.
"""

import functools
import math
from dataclasses import dataclass
from importlib import resources
from typing import Any, Protocol

import numpy as np

from ...arrays import Float32, Float64, Int8, Int32, UInt8, UInt16, UInt32
from ...gpu import BINDING, Device, GpuProcess, bands
from ..kernels.bricks import SLOTS, Bricks, row_width
from ..texture import SurfaceTexture, TextureRows


@functools.cache
def shader(*files: str) -> str:
    """Sources ``"package/file.wgsl"`` one after the other: WGSL has no include."""
    texts = []
    for file in files:
        package, _, name = file.rpartition("/")
        folder = resources.files("lfportrait." + package.replace("/", "."))
        texts.append((folder / name).read_text(encoding="utf-8"))
    return "\n".join(texts)


_KEPT = 3  # Fields that stay on a device, and so many textures.


def _room(device: Device, kind: str, key: str) -> dict[str, Any]:
    """What is kept of a kind on a device, with room for this key: the oldest of many goes."""
    kept: dict[str, Any] = device.kept.setdefault(kind, {})
    kept.pop(key, None)
    while len(kept) >= _KEPT:
        kept.pop(next(iter(kept)))
    return kept


@dataclass(frozen=True)
class TextureParts:
    """A field's painted texture, as it is sent."""

    cells: UInt8  # uint8 [bricks * 128], the chart of each cell; 255: none.
    charts: Float32  # float32 [C, 12], from the lattice to texels.
    texels: Int8  # int8 [H, W, 4].


@dataclass(frozen=True)
class DeviceTexture:
    """The same on a device: buffers and a texture; ``there``: the field has one at all."""

    cells: Any
    charts: Any
    texels: Any
    there: bool


def texture_parts(rows: TextureRows) -> TextureParts:
    """What `VoxelField.texture_rows` gives, as it is sent."""
    cells, charts, texels = rows
    words = np.ascontiguousarray(texels)
    return TextureParts(cells.astype(np.uint8), charts,
                        words.view(np.int8).reshape(*words.shape, 4))


def keep_texture(device: Device, key: str, parts: TextureParts | None) -> list[str]:
    """Keep a texture, or that there is none, on a device; returns the names of all kept."""
    kept = _room(device, "textures", key)
    if parts is None:
        kept[key] = DeviceTexture(device.buffer(16), device.buffer(48),
                                  device.texture((1, 1), "rgba8snorm"), False)
    else:
        texels = device.texture(parts.texels.shape[1::-1], "rgba8snorm")
        device.fill_texture(texels, parts.texels)
        kept[key] = DeviceTexture(device.buffer(parts.cells), device.buffer(parts.charts), texels,
                                  True)
    return list(kept)


def picture_texture(device: Device, planes: Float32 | None) -> Any:
    """A texture of half floats of a picture float32 [3, H, W], 0 to 255; None: a black texel."""
    if planes is None:
        return device.texture((1, 1), "rgba16float")
    _, height, width = planes.shape
    texels = np.zeros((height, width, 4), np.float16)
    texels[..., :3] = np.moveaxis(planes, 0, -1) * np.float32(1 / 255)
    texture = device.texture((width, height), "rgba16float")
    device.fill_texture(texture, texels)
    return texture


_LEAST = 1e-2  # Density from which a cell is looked at: the least threshold that casting uses.
_SIDE = 409  # Most bricks along a side of the atlas: 5 x 409 texels, under the limit of 2048.
_ACROSS = 32768  # Workgroups along x of a dispatch.


@dataclass(frozen=True)
class FieldParts:
    """What a field sends to a device: of `Bricks` what is not said here."""

    table: Int32
    links: Int32
    density: UInt16
    rows: UInt16
    basis: int
    width: int
    lattice: Float64  # float64 [9], `VoxelField.lattice`.
    # others, other_basis: Other colors of the same points, as ``rows`` and ``basis``.
    others: UInt16 | None = None
    other_basis: int = 0

    @property
    def bricks(self) -> int:
        """Number of bricks, at least one."""
        return len(self.links) // SLOTS

    @property
    def empty(self) -> int:
        """The row that stands for empty points."""
        return (len(self.rows) - 32) // self.width - 1


def field_parts(bricks: Bricks, lattice: Float64) -> FieldParts:
    """What a field of this layout sends to a device."""
    return FieldParts(bricks.table, bricks.links, bricks.density, bricks.rows, bricks.basis,
                      bricks.width, lattice)


class Atlas:
    """A field on a device.

    Parameters
    ----------
    layers : How many eyes colors are kept for; fields of one coefficient need one.

    Attributes
    ----------
    table, masks, texture : For `march.wgsl`: buffers and the texture.
    side, down, deep : Bricks of the atlas along x, y and, of one layer, z.
    layers : As above.
    share : Share of the other colors that `shade` mixes in, 0 to 1.
    """

    def __init__(self, device: Device, parts: FieldParts, layers: int = 1,
                 page: int = BINDING) -> None:
        if max(parts.table.shape) > 1024:
            raise MemoryError("lattices of more than 4096 points a side")
        self.layers = 1 if max(parts.basis, parts.other_basis) == 1 else layers
        self.share = 0.0
        count = parts.bricks
        self.side = self.down = min(_SIDE, max(8, math.ceil((count * self.layers) ** (1 / 3))))
        self.deep = -(-count // (self.side * self.down))
        if self.deep * self.layers > _SIDE:
            self.side = self.down = _SIDE
            self.deep = -(-count // (_SIDE * _SIDE))
        if self.deep * self.layers > _SIDE:
            raise MemoryError("its bricks do not fit a texture")
        self._device, self.lattice, self.basis = device, parts.lattice, parts.basis
        self.tables, self.count, self.empty = parts.table.shape, count, parts.empty
        self.table = device.buffer(parts.table)
        self.masks = device.buffer(8 * count)
        self.texture = device.texture(
            (5 * self.side, 5 * self.down, 5 * self.deep * self.layers), "rgba16float",
            written=True)
        self._kernel = device.kernel(shader("field/gpu/atlas.wgsl"), "main",
                                     {"basis": parts.basis, "width": parts.width,
                                      "other_basis": parts.other_basis,
                                      "other_width": row_width(max(parts.other_basis, 1))})
        self._places = device.buffer(_places(parts.table, count))
        self._width, self._page = parts.width, page
        self._other_width = row_width(max(parts.other_basis, 1))
        together = page // (4 * SLOTS)
        self._links = [(start, *(device.buffer(part[start * SLOTS:min(start + together, count)
                                                    * SLOTS])
                                 for part in (parts.links, parts.density)))
                       for start in range(0, count, together)]
        self._rows: list[tuple[int, int, Any]] = []
        self._others: list[Any] = []
        self.set_rows(parts.rows, parts.others)

    def set_rows(self, rows: UInt16, others: UInt16 | None = None) -> None:
        """New coefficients of the same points (`Bricks.rows`), and of their other colors."""
        together = self._page // (2 * max(self._width, self._other_width)) // 128 * 128
        for number, start in enumerate(range(0, self.empty + 1, together)):
            end = min(start + together, self.empty + 1)
            part = rows[start * self._width:end * self._width]
            if number < len(self._rows):
                self._device.write(self._rows[number][2], part)
            else:
                self._rows.append((start, end, self._device.buffer(part)))
            if others is None:
                continue
            part = others[start * self._other_width:end * self._other_width]
            if number < len(self._others):
                self._device.write(self._others[number], part)
            else:
                self._others.append(self._device.buffer(part))

    def shade(self, eyes: Float64) -> None:
        """Evaluate the colors of all points for eyes, float64 [layers, 3] in the field's world."""
        device = self._device
        steps = []
        for layer, eye in enumerate(eyes[:self.layers]):
            for first, links, density in self._links:
                many = min(links.size // 4 // SLOTS, self.count - first)
                columns = min(many, _ACROSS)
                for number, (start, end, rows) in enumerate(self._rows):
                    uniform = np.zeros(96, np.uint8)
                    floats, words = uniform.view(np.float32), uniform.view(np.uint32)
                    floats[0:3], floats[4:7] = self.lattice[3:6], self.lattice[6:9]
                    floats[8:11] = eye
                    words[12:16] = first, many, self.side, self.down
                    words[16:20] = start, end, self.empty, 5 * self.deep * layer
                    floats[20], words[21], floats[22] = _LEAST, columns, self.share
                    group = device.bind(self._kernel, {
                        0: device.buffer(uniform, uniform=True), 1: links, 2: density, 3: rows,
                        4: self._places, 5: self.masks, 6: self.texture,
                        7: self._others[number] if self._others else rows})
                    steps.append((self._kernel, group, (columns, -(-many // columns), 1)))
        device.run(*steps)

    def march_uniform(self, threshold: float, stop: float, whole: bool, textured: float) -> UInt8:
        """The uniform ``field`` of `march.wgsl`, uint8 [64]; the texture's strength is 0 to 1."""
        uniform = np.zeros(64, np.uint8)
        floats, words = uniform.view(np.float32), uniform.view(np.uint32)
        floats[0:3], floats[3] = self.lattice[0:3], threshold
        words[4:8] = *self.tables[::-1], self.side
        floats[8:11] = 1.0 / np.array(self.texture.size)
        floats[11] = self.down
        floats[12:15] = stop, whole, textured
        return uniform

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        texels = int(np.prod(self.texture.size))
        pages = sum(links.size + density.size for _, links, density in self._links)
        return int(8 * texels + self.table.size + self.masks.size + pages
                   + sum(rows.size for _, _, rows in self._rows)
                   + sum(rows.size for rows in self._others))


def _places(table: Int32, count: int) -> UInt32:
    """Where each brick lies in the table: x, y and z, ten bits each."""
    z, y, x = np.nonzero(table >= 0)
    out = np.zeros(count, np.uint32)
    out[table[z, y, x]] = x | y << 10 | z << 20
    return out


def upload(device: Device, key: str, parts: FieldParts, layers: int,
           page: int = BINDING) -> list[str]:
    """Keep a field on a device under a name; returns the names of all that it keeps."""
    kept = _room(device, "fields", key)
    kept[key] = Atlas(device, parts, layers, page)
    return list(kept)


_GROUP = 8  # Pixels along a side of a workgroup.


@dataclass(frozen=True)
class ViewJob:
    """Views to be rendered, of one size."""

    cameras: Float64  # float64 [V, 16] (`Camera.row`).
    size: tuple[int, int]  # Width and height in pixels.
    lattice: Float64  # float64 [9], `VoxelField.lattice`.
    # axis, step: 1, 2 or 3: samples lie where rays cross lattice planes of x, y or z, ``step``
    # planes apart; 0: they lie ``step`` lattice units apart.
    axis: int
    step: float
    # threshold, stop, whole: Density that counts; transmittance at which rays end; whether the rest
    # has their color.
    threshold: float
    stop: float
    whole: bool
    # covered, probes, reach: How long a piece of surface may be, in world units, for one look-up of
    # the texture; most look-ups; width of detail along a piece over its length.
    covered: float
    probes: int
    reach: float
    eight_bit: bool = False  # Pictures of bytes are wanted, not colors, opacities and depths.
    # Red, green and blue behind the field, in [0, 1], for pictures of bytes.
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # float32 [3, R, C], 0 to 255: what is behind it instead; or None.
    ground: Float32 | None = None
    # float64 [V, 4, 3], in the ground's texels: each camera's place, its ray's growth for a pixel
    # to the right and below, and the first pixel's.
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
    """Render views, one after the other, of a field and its texture of these names on the device.

    uint8 [V, H, W, 3] if ``job.eight_bit``; else colors float32 [V, H, W, 3], opacities and depths
    [V, H, W], without a background.
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
    """Have a field and its texture on the device's process; their names there.

    ``layers`` eyes are kept colors for; ``footprint`` and ``whole`` say which width of the
    texture's detail is wanted (`VoxelField.texture_rows`).
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
    return process.call(f"{_STAGE}.atlas:render_views", keys, job)
