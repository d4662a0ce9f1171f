"""Drawing a coded picture onto a window's or a texture's pixels, unscaled, mirrored if need be.

The picture stays on the device: nothing of it goes through the computer's memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...field.gpu import shader
from ...gpu.device import Device
from ..display import Display

__all__ = ["Blit", "LivePicture", "pixels_of"]


@dataclass(frozen=True)
class LivePicture:
    """A coded picture on a device.

    Attributes
    ----------
    buffer
        Its bytes: red, green, blue, pixel after pixel.
    words
        Words of 4 bytes from one row to the next.
    rows
        How many rows there are.
    apart
        How many rows of the panel each of them stands for.
    """

    buffer: Any
    words: int
    rows: int
    apart: int

    def read(self, device: Device, display: Display) -> NDArray[np.uint8]:
        """The panel's pixels as seen, uint8 [H, W, 3]; coarse rows are repeated."""
        raw = device.read(self.buffer, np.uint8, (self.rows, 4 * self.words))
        rows = raw[:, :3 * display.width].reshape(self.rows, display.width, 3)
        return np.ascontiguousarray(np.repeat(rows, self.apart, axis=0)[:display.height])


class Blit:
    """Draws pictures for one display onto targets of one format.

    Parameters
    ----------
    device, display
        Where the pictures are, and the panel that they are for.
    format
        Of the targets, one of WebGPU's with 8 bits a color and without a conversion (``-srgb``).
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


def pixels_of(device: Device, texture: Any) -> NDArray[np.uint8]:
    """What a texture of 8 bits a color holds, uint8 [H, W, 3]: red, green, blue."""
    width, height, _ = texture.size
    raw = device.raw.queue.read_texture({"texture": texture}, {
        "bytes_per_row": 4 * width, "rows_per_image": height}, (width, height, 1))
    found = np.frombuffer(raw, np.uint8).reshape(height, width, 4)[..., :3]
    return np.ascontiguousarray(found[..., ::-1] if texture.format.startswith("bgra") else found)
