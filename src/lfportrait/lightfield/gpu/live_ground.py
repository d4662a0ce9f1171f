"""The ground behind a head that moves, made in a thread: its shadow takes the CPU a while.

Pictures show the latest one there is.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from ...field import VoxelField
from ...field.gpu import picture_texture
from ...gpu.device import Device
from ..display import Display
from ..ground import Ground, backdrop_of, ground_of
from ..placement import EncodeConfig

__all__ = ["LiveGround"]


class LiveGround:
    """The ground behind a head that moves.

    Parameters
    ----------
    device, field, display
        Where it is shown, what throws its shadow, and the panel.

    Attributes
    ----------
    made_for
        The configuration that the latest one belongs to.
    texture
        Its texture on the device.
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
