"""Coding a panel again and again on a device, for a light field that moves; without any window.

A picture takes as long as the device needs for it, in bands of one dispatch each, so that a slow
one stays responsive. Where a picture would take more than a tenth of a second, what moves is coded
in every n-th row only; once it stands still, the rows between follow, a few bands at a time.

The ground behind the head is made on the CPU. It follows what moves in a thread of its own: a
picture shows the latest one there is, and the last picture the one that belongs to it.

A picture is drawn onto a window's or a texture's pixels unscaled, and mirrored if need be.
The picture stays on the device: nothing of it goes through the computer's memory.
"""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arrays import Float64, UInt8
from ...errors import UserError
from ...field import VoxelField
from ...field.gpu import Atlas, field_parts, keep_texture, picture_texture, shader, texture_parts
from ...gpu import BINDING, LIMITS, Device
from ..coding import _footprint, panel_job
from ..display import Display
from ..ground import Ground, backdrop_of, ground_of
from ..placement import EncodeConfig, Placement
from .panel import PanelJob


@dataclass(frozen=True)
class LivePicture:
    """A coded picture on a device."""

    buffer: Any  # Its bytes: red, green, blue, pixel after pixel.
    words: int  # Words of 4 bytes from one row to the next.
    rows: int  # How many rows there are.
    apart: int  # How many rows of the panel each of them stands for.

    def read(self, device: Device, display: Display) -> UInt8:
        """The panel's pixels as seen, uint8 [H, W, 3]; coarse rows are repeated."""
        raw = device.read(self.buffer, np.uint8, (self.rows, 4 * self.words))
        rows = raw[:, :3 * display.width].reshape(self.rows, display.width, 3)
        return np.ascontiguousarray(np.repeat(rows, self.apart, axis=0)[:display.height])


class Blit:
    """Draws pictures for one display onto targets of one format.

    That is one of WebGPU's with 8 bits a color and without a conversion (``-srgb``).
    """

    def __init__(self, device: Device, display: Display, format: str) -> None:
        self._device, self._display = device, display
        raw = device.raw
        module = raw.create_shader_module(code=shader("lightfield/gpu/blit.wgsl"))
        self._pipeline = raw.create_render_pipeline(
            layout="auto", vertex={"module": module, "entry_point": "corner"},
            primitive={"topology": "triangle-list"},
            fragment={"module": module, "entry_point": "pixel", "targets": [{"format": format}]})
        self._uniform = device.buffer(np.zeros(8, np.uint32), uniform=True)
        self._groups: dict[int, tuple[Any, Any]] = {}

    def draw(self, picture: LivePicture, view: Any) -> None:
        """Draw a picture onto all of a target, given as a texture's view of the panel's size."""
        display, raw = self._display, self._device.raw
        self._device.write(self._uniform, np.array(
            [display.width, display.height, picture.words, picture.rows, display.flip_x,
             display.flip_y, picture.apart, 0], np.uint32))
        encoder = raw.create_command_encoder()
        work = encoder.begin_render_pass(color_attachments=[{
            "view": view, "resolve_target": None, "clear_value": (0, 0, 0, 1),
            "load_op": "clear", "store_op": "store"}])
        work.set_pipeline(self._pipeline)
        work.set_bind_group(0, self._group(picture.buffer))
        work.draw(3)
        work.end()
        raw.queue.submit([encoder.finish()])

    def _group(self, buffer: Any) -> Any:
        """The bound picture; the few buffers that pictures alternate between are kept bound."""
        kept = self._groups.get(id(buffer))
        if kept is None or kept[0] is not buffer:
            if len(self._groups) > 4:
                self._groups.clear()
            group = self._device.raw.create_bind_group(
                layout=self._pipeline.get_bind_group_layout(0), entries=[
                    {"binding": 0, "resource": {"buffer": self._uniform, "offset": 0,
                                                "size": self._uniform.size}},
                    {"binding": 1, "resource": {"buffer": buffer, "offset": 0,
                                                "size": buffer.size}}])
            kept = self._groups[id(buffer)] = (buffer, group)
        return kept[1]


def pixels_of(device: Device, texture: Any) -> UInt8:
    """What a texture of 8 bits a color holds, uint8 [H, W, 3]: red, green, blue."""
    width, height, _ = texture.size
    raw = device.raw.queue.read_texture({"texture": texture}, {
        "bytes_per_row": 4 * width, "rows_per_image": height}, (width, height, 1))
    found = np.frombuffer(raw, np.uint8).reshape(height, width, 4)[..., :3]
    return np.ascontiguousarray(found[..., ::-1] if texture.format.startswith("bgra") else found)


class LiveGround:
    """The ground behind a head that moves, and its texture on the device.

    ``made_for`` is the configuration that the latest one belongs to; ``field`` throws its shadow.
    """

    def __init__(self, device: Device, field: VoxelField, display: Display) -> None:
        self._device, self._field, self._display = device, field, display
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="ground")
        self._making: tuple[EncodeConfig, Future[Ground | None]] | None = None
        self._ground: Ground | None = None
        self.made_for: EncodeConfig | None = None
        self.texture = picture_texture(device, None)

    def follow(self, config: EncodeConfig) -> None:
        """Take up the ground that was made meanwhile, and have this configuration's made."""
        if self._making is not None and self._making[1].done():
            self._take_up()
        if self._making is None and config != self.made_for:
            if backdrop_of(self._field, config) is None:
                self._ground, self.made_for = None, config
            else:
                self._making = config, self._pool.submit(ground_of, self._field, self._display,
                                                         config)
                if self.made_for is None:
                    self._take_up()  # none is no ground for the first picture

    def wait(self, config: EncodeConfig) -> None:
        """Wait for this configuration's ground."""
        self.follow(config)
        while self.made_for != config:
            if self._making is not None:
                self._take_up()
            self.follow(config)

    def of_job(self) -> dict[str, Any]:
        """What a `PanelJob` has of it."""
        ground = self._ground
        if ground is None:
            return {"ground": None}
        return {"ground": ground.planes, "ground_place": (
            ground.depth / self._display.distance, ground.left, ground.top, *ground.texel,
            self._display.eye_height)}

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _take_up(self) -> None:
        assert self._making is not None
        self.made_for, future = self._making
        self._making = None
        self._ground = future.result()
        self.texture = picture_texture(self._device,
                                       None if self._ground is None else self._ground.planes)

_TILE = 16  # Pixels along a side of a workgroup's tile.
_DISPATCH = 0.05  # Seconds that one dispatch should take.
_PICTURE = 0.1
"""Seconds that a picture of something that moves may take, and a stretch of one that stands."""
_COARSE = 1, 3, 5, 9, 17
"""Rows that one stands for. The middle one of an odd number is the nearest to all of them: lenses
are slanted, and the views of a row are not quite its neighbour's."""
_SHADING = 0.01
"""Seconds from which on colors are not evaluated for every eye that something moving comes to."""
_KEPT = "live"  # The name of the field's texture on the device.
_NEAR = 0.04
"""How far an eye may then be from the one that colors were evaluated for, over its distance."""


def same_points(field: VoxelField, photo: VoxelField) -> bool:
    """Whether two fields are the same but for their colors, so that these can be mixed."""
    return (np.array_equal(field.links, photo.links)
            and np.array_equal(field.density, photo.density)
            and np.allclose(field.bounds, photo.bounds))


class LiveCoder:
    """Codes a field for a display, picture after picture.

    Parameters
    ----------
    field : The (stylised) field.
    display : The panel: at most 8192 pixels a side, and a picture that a shader sees at once.
    photo : A field of the same points with other colors, to mix in; or None.
    page : Bytes of the field's arrays that a shader sees at once.

    Attributes
    ----------
    picture : The picture that was coded last.
    exact : Whether it is what `lfportrait.lightfield.encode` gives for what was asked for last.
    shown : The configuration and share that it was coded for.
    seconds : What the last picture took.
    """

    def __init__(self, device: Device, field: VoxelField, display: Display,
                 photo: VoxelField | None = None, page: int = BINDING) -> None:
        _check_size(display)
        if photo is not None and not same_points(field, photo):
            raise UserError("the photo's field has other points than the painted one: give the "
                            "field that was stylised")
        self._device, self.display, self._field = device, display, field
        bricks, lattice = field.bricks, field.lattice
        parts = field_parts(bricks, lattice)
        # Eyes and methods are chosen for the field whose colors depend more on the eye.
        self._rich = field
        if photo is not None:
            mixed = field.with_sh(photo.sh)
            parts = replace(parts, others=mixed.bricks.rows, other_basis=mixed.basis)
            self._rich = mixed if mixed.basis > field.basis else field
        layers = len(panel_job(self._rich, display, EncodeConfig(ground="black")).viewpoints)
        self._atlas = Atlas(device, parts, layers, page)
        self._painted_basis, self._photo_basis = field.basis, parts.other_basis
        self._kernel = device.kernel(
            shader("field/gpu/march.wgsl", "lightfield/gpu/panel.wgsl",
                   "lightfield/gpu/direct.wgsl"), "main", {"sorted": display.views > 1})
        self._marching = device.buffer(np.zeros(64, np.uint8), uniform=True)
        self._panel = device.buffer(np.zeros(384, np.uint8), uniform=True)
        self._tiles = -(-display.width // _TILE), -(-display.height // _TILE)
        size = 48 * self._tiles[0] * display.height
        self._buffers = [device.buffer(size), device.buffer(size)]
        self._behind = LiveGround(device, field, display)
        self._level = -2
        self._shaded: tuple[float, Float64 | None] = (-1.0, None)
        self._shading, self._pace, self._worst, self._band = 0.0, 0.0, 0.0, 1
        self._work: _Work | None = None
        self._wanted: tuple[EncodeConfig, float] | None = None
        self.picture = LivePicture(self._buffers[0], 12 * self._tiles[0], 1, display.height)
        self.shown: tuple[EncodeConfig, float] | None = None
        self.exact, self._lacks_detail, self.seconds = False, True, 0.0

    def step(self, config: EncodeConfig, share: float = 0.0) -> bool:
        """Code what is asked for, or go on with it; whether there is another picture than before.

        ``config`` is without ``compose``; ``share`` of the photo's colors, 0 to 1.
        """
        if config.method == "slices":
            config = replace(config, method="auto")  # a head that is turned far has none
        wanted = config, float(share) if self._photo_basis else 0.0
        self._behind.follow(config)
        if wanted != self._wanted:
            self._wanted, self.exact = wanted, False
            self._start(self._affordable(), moving=True)
        elif self._work is None:
            if self.exact or not self._better():
                return False
            self._start(1, moving=False)
        return self._go_on()

    def settle(self, config: EncodeConfig, share: float = 0.0) -> None:
        """Go on until the picture is exact."""
        self._behind.wait(config)
        self.step(config, share)
        while not self.exact:
            self.step(config, share)

    def read(self) -> UInt8:
        """The last picture as seen, uint8 [H, W, 3]."""
        return self.picture.read(self._device, self.display)

    def close(self) -> None:
        """End the thread that the ground is made in."""
        self._behind.close()

    # -- a picture --------------------------------------------------------------------------------

    def _affordable(self) -> int:
        """How many rows one must stand for, so that a picture takes a tenth of a second at most."""
        whole = self._pace * self._tiles[1]
        if self._pace == 0:
            return _COARSE[-1]
        return next((apart for apart in _COARSE if whole <= _PICTURE * apart), _COARSE[-1])

    def _better(self) -> bool:
        """Whether another picture of the same would differ from the last one."""
        assert self._wanted is not None
        return self._lacks_detail or self._behind.made_for == self._wanted[0]

    def _start(self, apart: int, moving: bool) -> None:
        """Begin a picture of every n-th row."""
        assert self._wanted is not None
        config, share = self._wanted
        rows = -(-self.display.height // apart)
        job = panel_job(self._rich, self.display, replace(config, ground="black"), rows,
                        first=apart // 2, apart=apart)
        # Colors that are the same from everywhere are evaluated for one eye.
        layers = self._atlas.layers if self._from_eye(share) else 1
        eyes = spread_viewpoints(job.viewpoints, layers)
        whole = self._shade(eyes, share, moving) & self._detail(config, moving) & (apart == 1)
        texture = self._device.kept["textures"][_KEPT]
        self._device.write(self._marching, self._atlas.march_uniform(
            job.threshold, job.stop, job.whole, (1.0 - share) * texture.there))
        self._work = _Work(
            replace(job, viewpoints=eyes, **self._behind.of_job()), apart, rows, self._wanted,
            lacks_detail=not whole, lacks_ground=self._behind.made_for != config, moving=moving)

    def _go_on(self) -> bool:
        """Code bands of the picture that is under way; whether it is done."""
        work, device = self._work, self._device
        assert work is not None
        begun = time.perf_counter()
        target = self._buffers[1]
        tall = -(-work.rows // _TILE)
        texture = device.kept["textures"][_KEPT]
        while work.at < tall:
            many = min(self._band, tall - work.at)
            start = time.perf_counter()
            first = work.at * _TILE
            height = min(work.rows, first + many * _TILE) - first
            device.write(self._panel, work.job.uniform(first, height))
            group = device.bind(self._kernel, {
                0: self._marching, 1: self._atlas.table, 2: self._atlas.masks,
                3: self._atlas.texture, 4: device.sampler(), 5: texture.cells, 6: texture.charts,
                7: texture.texels, 8: self._panel, 9: self._behind.texture,
                10: (target, 4 * self.picture.words * first, 4 * self.picture.words * height)})
            device.run((self._kernel, group, (self._tiles[0], many, 1)))
            device.wait()
            work.at += many
            self._measured(work, many, max(time.perf_counter() - start, 1e-6))
            if work.at < tall and not work.moving and (
                    time.perf_counter() - begun > _PICTURE - _DISPATCH):
                return False
        self._pace, self._worst = work.spent / tall, work.worst
        self._buffers.reverse()
        self.picture = replace(self.picture, buffer=target, rows=work.rows, apart=work.apart)
        self.shown, self.seconds, self._lacks_detail = work.wanted, work.spent, work.lacks_detail
        self.exact = not (work.lacks_detail or work.lacks_ground)
        self._work = None
        return True

    def _measured(self, work: _Work, many: int, spent: float) -> None:
        """Size the next band by what this one took, and by the dearest of the last picture."""
        work.spent += spent
        work.worst = max(work.worst, spent / many)
        slowest = max(spent / many, self._worst)
        self._band = max(1, min(int(_DISPATCH / slowest), 4 * many))

    # -- colors -----------------------------------------------------------------------------------

    def _from_eye(self, share: float) -> bool:
        """Whether colors depend on the eye."""
        return (self._painted_basis > 1 and share < 1) or (self._photo_basis > 1 and share > 0)

    def _shade(self, eyes: Float64, share: float, moving: bool) -> bool:
        """Evaluate colors where they are others by now; whether they are those of these eyes."""
        known, places = self._shaded
        if known == share and places is not None and (
                not self._from_eye(share) or np.array_equal(eyes, places)):
            return True
        if known == share and moving and self._shading > _SHADING and places is not None:
            away = np.linalg.norm(eyes - places, axis=1) / np.linalg.norm(eyes, axis=1)
            if away.max() < _NEAR:
                return False
        start = time.perf_counter()
        self._atlas.share = share
        self._atlas.shade(eyes)
        self._device.wait()
        self._shading = time.perf_counter() - start
        self._shaded = share, eyes.copy()
        return True

    def _detail(self, config: EncodeConfig, moving: bool) -> bool:
        """Have the texture's detail for the head's size; not while something moves."""
        texture = self._field.texture
        footprint = _footprint(self.display, Placement.of(self.display, config))
        level = -1 if texture is None else texture.level(footprint, whole=True)
        if level == self._level:
            return True
        if moving and self._level != -2:
            return False
        parts = None
        if texture is not None:
            parts = texture_parts(self._field.texture_rows(footprint, whole=True))
        keep_texture(self._device, _KEPT, parts)
        self._level = level
        return True


@dataclass
class _Work:
    """A picture that is under way."""

    # job, apart, rows, wanted: What is coded, every how-many-th row, how many rows, and what was
    # asked for.
    job: PanelJob
    apart: int
    rows: int
    wanted: tuple[EncodeConfig, float]
    # lacks_detail, lacks_ground: Whether another picture of the same will be better, and whether it
    # will once its ground is there.
    lacks_detail: bool
    lacks_ground: bool
    moving: bool  # Coded in one go, because something moves.
    # at, spent, worst: The next row of tiles, seconds so far, and most seconds of a row of tiles.
    at: int = 0
    spent: float = 0.0
    worst: float = 0.0


def spread_viewpoints(viewpoints: Float64, layers: int) -> Float64:
    """So many eyes, float64 [layers, 3], over the line that evenly spread ones [L, 3] stand for."""
    many = len(viewpoints)
    if many == layers:
        return viewpoints
    apart = (viewpoints[-1] - viewpoints[0]) / max(many - 1, 1)
    share = (np.arange(layers)[:, None] + 0.5) / layers
    return np.asarray(viewpoints[0] + apart * (many * share - 0.5), np.float64)


def _check_size(display: Display) -> None:
    """Raise `UserError` where a panel's picture is too large for a device's default limits."""
    most = LIMITS["max-texture-dimension-2d"]
    bytes_ = 48 * -(-display.width // _TILE) * display.height
    if max(display.width, display.height) > most or bytes_ > BINDING:
        raise UserError(f"a light field can be live on panels of up to {most} pixels a side and "
                        f"{BINDING // 3 // 1_000_000} million pixels, not {display.width} x "
                        f"{display.height}: code a picture with `lfportrait encode`")
