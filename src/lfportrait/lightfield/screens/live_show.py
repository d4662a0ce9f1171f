"""A field shown live: its photo's field is found, the device started; what is lost is said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...device import device_name, gpu_adapter
from ...errors import UserError
from ...field import VoxelField
from ...gpu import Adapter
from ...gpu.device import Device
from ..display import Display
from ..gpu.live import same_points
from ..placement import EncodeConfig
from .live import Live, OffscreenWindow, one_eyed
from .live_window import LiveWindow, check_packages

__all__ = ["fields_to_show", "live_adapter", "show_field", "show_live"]


def live_adapter(choice: str) -> Adapter:
    """The GPU for a choice of ``--device``.

    Raises
    ------
    UserError
        If there is none: nothing else is fast enough.
    """
    adapter = gpu_adapter(choice)
    if adapter is None:
        raise UserError(f"a light field is shown live by a GPU, and --device {choice} has none "
                        "here: see `lfportrait devices`; --device gpu takes software, slowly, "
                        "where there is no other")
    return adapter


def show_field(field: VoxelField, display: Display, config: EncodeConfig | None = None, *,
               photo: VoxelField | None = None, screen: int = -1, simulate: bool = False,
               window: OffscreenWindow | None = None, seconds: float = 0.0, device: str = "gpu",
               ) -> dict[str, Any]:
    """Show a field live on an attached panel, as ``lfportrait show --live`` does.

    A graphics card codes each picture. The pointer turns the head, keys move, flatten and mix it;
    the key ``h`` prints which.

    Parameters
    ----------
    field
        What is shown.
    display
        The panel.
    config
        How the field is placed at first.
    photo
        A field of the same points whose colors the viewer can mix in.
    screen
        Number of the panel's screen; -1: the one that has its pixels.
    simulate
        An ordinary window instead, with what an eye in the middle sees.
    window
        Draw into this one in memory instead: for tests, and to keep the pictures.
    seconds
        How long; 0: until the window is closed.
    device
        Which graphics card: ``"gpu"``, ``"gpu:NAME"``, or ``"auto"`` (`lfportrait.device`).

    Returns
    -------
    figures
        Pictures a second and milliseconds for each.

    Raises
    ------
    UserError
        If a package, the graphics card or the panel's screen is missing.
    """
    if window is None:
        check_packages()
    adapter = live_adapter(device)
    shown: LiveWindow | OffscreenWindow = window or LiveWindow(display, screen, simulate)
    return show_live(shown, adapter, field, config or EncodeConfig(), display, photo,
                     seconds=seconds)


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


def show_live(window: LiveWindow | OffscreenWindow, adapter: Adapter, field: VoxelField,
              config: EncodeConfig, panel: Display, photo: VoxelField | None = None, *,
              seconds: float = 0.0,
              say: Callable[[str, bool], None] = lambda line, stays: None) -> dict[str, Any]:
    """Show a field until the viewer closes the window, or the time is up.

    The device lives in this process, where its window is.

    Parameters
    ----------
    window
        The panel's, an ordinary one, or one in memory.
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
