"""Speed of the coding on a GPU, where the device's own time is apart from that of reading back."""

from __future__ import annotations

from typing import Any

from lfportrait.field import VoxelField
from lfportrait.gpu import Adapter, gpu_process
from lfportrait.lightfield import Display, EncodeConfig, code_on_device, composed

__all__ = ["device_figures"]

_REPEATS = 20


def device_figures(field: VoxelField, display: Display, config: EncodeConfig,
                   adapter: Adapter) -> dict[str, Any]:
    """Times on the device, with nothing read back.

    Returns
    -------
    figures
        ``device_seconds`` of coding, the field being there; ``shade_seconds`` of evaluating its
        colors for the views; ``copy_seconds``: the floor, a copy of as many bytes as the field and
        the picture have, within the device's memory.
    """
    process = gpu_process(adapter)
    config = composed(field, display, config)
    run = code_on_device(process, field, display, config, repeats=1 if not adapter.real
                         else _REPEATS)
    size = run["field_bytes"] + 3 * display.width * display.height
    return {"device_seconds": run["repeated"], "shade_seconds": run["shade"],
            "copy_seconds": process.call("lfportrait.gpu.measuring:copy_seconds", size),
            "copy_bytes": size}
