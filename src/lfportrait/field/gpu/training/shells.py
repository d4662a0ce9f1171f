"""Spheres behind the lattice on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ....arrays import Float32, Int32
from ....gpu import GpuLostError
from ....gpu.device import BINDING, Device

__all__ = ["Shells"]


@dataclass(frozen=True)
class Shells:
    """Buffers of a background (`lfportrait.field.background.Background`) that is trained.

    Attributes
    ----------
    count
        Values of four numbers: places on the map times layers.
    buffers
        By the names of the shaders' bindings: the map, its values, their mean squared slopes, and
        sums of slopes as integers, zero between steps.
    """

    count: int
    buffers: dict[str, Any]

    @staticmethod
    def of(device: Device, links: Int32, data: Float32,
           mean_square: Float32) -> Shells:
        """Copy a background to the device.

        Parameters
        ----------
        device
            Where to.
        links
            int32 [2 R, R].
        data, mean_square
            float32 [N, layers, 4] and [N * layers, 4].

        Raises
        ------
        GpuLostError
            If it is larger than what a shader can see.
        """
        if max(links.nbytes, data.nbytes) > BINDING:
            raise GpuLostError(f"the background is too large for {device.adapter.title}")
        return Shells(data.size // 4, {
            "map": device.buffer(links), "spheres": device.buffer(data),
            "shell_squares": device.buffer(mean_square), "shell_sums": device.buffer(data.nbytes)})

    def read(self, device: Device) -> tuple[Float32, Float32]:
        """Values and mean squared slopes, float32 [N * layers, 4] each."""
        data, square = (device.read(self.buffers[name], np.float32, (self.count, 4)).copy()
                        for name in ("spheres", "shell_squares"))
        return data, square
