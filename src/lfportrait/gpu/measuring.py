"""What a device can do at best: the floor that figures are held against."""

from __future__ import annotations

import time

from .device import BINDING, Device

__all__ = ["copy_seconds"]


def copy_seconds(device: Device, size: int, repeats: int = 20) -> float:
    """Seconds that a device needs to copy so many bytes within its own memory.

    Parameters
    ----------
    device
        The device.
    size
        Bytes; what is more than a binding holds is copied in parts.
    repeats
        Copies whose mean is taken.
    """
    part = min(max(size // 4 * 4, 4), BINDING)
    source, target = device.buffer(part), device.buffer(part)

    def copy() -> None:
        encoder = device.raw.create_command_encoder()
        for _ in range(repeats):
            left = size
            while left > 0:
                some = max(min(left, part) // 4 * 4, 4)
                encoder.copy_buffer_to_buffer(source, 0, target, 0, some)
                left -= part
        device.raw.queue.submit([encoder.finish()])
        device.wait()

    copy()
    start = time.perf_counter()
    copy()
    return (time.perf_counter() - start) / repeats
