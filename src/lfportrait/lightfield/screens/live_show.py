"""A field shown live: its photo's field is found, the device started; what is lost is said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...device import device_name
from ...errors import UserError
from ...field import VoxelField
from ...gpu import Adapter
from ...gpu.device import Device
from ..display import Display
from ..gpu.live import same_points
from ..placement import EncodeConfig
from .live import Live, one_eyed
from .live_window import LiveWindow

__all__ = ["fields_to_show", "show_live"]


def fields_to_show(source: Path, photo: Path | None) -> tuple[VoxelField, VoxelField | None]:
    """A field's file, and the field whose colors can be mixed in.

    Parameters
    ----------
    source
        The (stylised) field's file.
    photo
        The field's that it was stylised from; by default ``field.npz`` beside it, where that has
        the same points.

    Raises
    ------
    UserError
        If the named one has other points.
    """
    field = VoxelField.load(source)
    beside = source.with_name("field.npz")
    if photo is None and (not beside.is_file() or beside.resolve() == source.resolve()):
        return field, None
    found = VoxelField.load(photo or beside)
    if same_points(field, found):
        return field, found
    if photo is not None:
        raise UserError(f"{photo} has other points than {source}: give the field that it was "
                        "stylised from")
    return field, None


def show_live(window: LiveWindow, adapter: Adapter, field: VoxelField, config: EncodeConfig,
              panel: Display, photo: VoxelField | None = None, *, seconds: float = 0.0,
              say: Callable[[str, bool], None] = lambda line, stays: None) -> dict[str, Any]:
    """Show a field until the viewer closes the window, or the time is up.

    The device lives in this process, where its window is.

    Parameters
    ----------
    window
        The panel's, or an ordinary one.
    adapter
        The GPU.
    field, config, panel, photo, seconds, say
        As for `Live`.

    Returns
    -------
    figures
        For ``--json``.

    Raises
    ------
    UserError
        If the window is not as the panel needs it, or the GPU was lost or is too small.
    """
    try:
        size = window.open()
        display = panel if window.screen >= 0 else one_eyed(panel, *size)
        device = Device(adapter)
        live = Live(device, field, config, panel, display, photo, seconds=seconds, say=say)
        try:
            window.run(device, display, live)
        finally:
            live.close()
    except UserError:
        raise
    except Exception as error:
        if not _of_device(error):
            raise
        raise UserError(f"{adapter.title} was lost, or its memory is too small for this field: "
                        f"{(str(error).strip().splitlines() or ['out of memory'])[0]}") from error
    finally:
        window.close()
    return {"display": panel.name, "screen": window.screen, "simulated": window.screen < 0,
            "size": list(size), "photo": photo is not None, "device": device_name(adapter),
            **live.figures()}


def _of_device(error: Exception) -> bool:
    """Whether an error is the device's: lost, or out of memory."""
    text = str(error).lower()
    return (isinstance(error, MemoryError) or type(error).__module__.startswith("wgpu")
            or "lost" in text or "memory" in text)
