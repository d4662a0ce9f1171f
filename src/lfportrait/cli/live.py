"""``show --live``: a field on a panel, or in an ordinary window, coded on the GPU as it moves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..device import device_name, gpu_adapter
from ..errors import UserError
from ..lightfield import Display

if TYPE_CHECKING:
    from ..field import VoxelField
    from ..gpu import Adapter
    from ..lightfield.screens.live import Live
    from ..lightfield.screens.live_window import LiveWindow
    from .devices import Show

__all__ = ["show_live"]


def show_live(command: Show) -> dict[str, Any]:
    """Show a field until the viewer closes the window, or the time is up.

    Returns
    -------
    figures
        What ``--json`` writes.
    """
    from ..field import VoxelField
    from ..lightfield.screens.live_window import LiveWindow, check_packages
    from .devices import warn_uncalibrated

    if len(command.lightfields) != 1 or command.lightfields[0].suffix.lower() != ".npz":
        raise UserError("name one field to show live: lfportrait show styled.npz --live")
    command.check_seconds()
    check_packages()
    adapter = _adapter(command.device)
    panel = Display.resolve(command.display)
    window = LiveWindow(panel, command.screen, command.simulate)
    if not command.simulate:
        warn_uncalibrated(panel)
    source = command.lightfields[0]
    with command.progress("live") as progress:
        progress.update(0, source.name)
        field = VoxelField.load(source)
        photo = _photo(field, source, command.photo)

        def say(line: str, stays: bool) -> None:
            if stays:
                progress.say(line)
            else:
                progress.update(0, line)

        live = _run(window, adapter, field, photo, panel, command, say)
    return {"display": panel.name, "screen": window.screen, "simulated": command.simulate,
            "size": list(window.size), "photo": photo is not None,
            "device": device_name(adapter), **live.figures()}


def _run(window: LiveWindow, adapter: Adapter, field: VoxelField, photo: VoxelField | None,
         panel: Display, command: Show, say: Any) -> Live:
    """Open the window and show; the device lives in this process, where its window is."""
    from ..gpu.device import Device
    from ..lightfield.screens.live import Live, one_eyed

    display = panel
    try:
        size = window.open()
        if command.simulate:
            display = one_eyed(panel, *size)
        device = Device(adapter)
        live = Live(device, field, command.config, panel, display, photo,
                    seconds=command.seconds, say=say)
        try:
            window.run(device, display, live)
        finally:
            live.close()
    except UserError:
        raise
    except Exception as error:
        if not (isinstance(error, MemoryError) or type(error).__module__.startswith("wgpu")):
            raise
        raise UserError(f"{adapter.title} was lost, or its memory is too small for this field: "
                        f"{str(error).strip().splitlines()[0]}") from error
    return live


def _adapter(choice: str) -> Adapter:
    """The GPU for a choice of ``--device``: there is no other way."""
    adapter = gpu_adapter(choice)
    if adapter is None:
        raise UserError("a light field is shown live by a GPU, and --device "
                        f"{choice} has none here: see `lfportrait devices`; --device gpu takes "
                        "software, slowly, where there is no other")
    return adapter


def _photo(field: VoxelField, source: Path, photo: Path | None) -> VoxelField | None:
    """The field to mix with: the one that was named, or one of the same points beside the source.

    Raises
    ------
    UserError
        If the named one has other points.
    """
    from ..field import VoxelField
    from ..lightfield.gpu.live import same_points

    beside = source.with_name("field.npz")
    if photo is None and (not beside.is_file() or beside.resolve() == source.resolve()):
        return None
    found = VoxelField.load(photo or beside)
    if same_points(field, found):
        return found
    if photo is not None:
        raise UserError(f"{photo} has other points than {source}: give the field that it was "
                        "stylised from")
    return None
