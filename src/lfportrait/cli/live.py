"""``show --live``: a field on a panel, or in an ordinary window, coded on the GPU as it moves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UserError
from ..lightfield import Display, EncodeConfig

if TYPE_CHECKING:
    from .common import Common

__all__ = ["run_live"]


def run_live(command: Common, fields: tuple[Path, ...], panel: Display, config: EncodeConfig,
             photo: Path | None, *, screen: int, simulate: bool, seconds: float,
             ) -> dict[str, Any]:
    """Show a field until the viewer closes the window, or the time is up.

    Parameters
    ----------
    command
        Its device and its progress line.
    fields
        The field's file, one.
    panel, config
        The display, and how the field is placed at first.
    photo
        The field to mix with; None: one of the same points beside it.
    screen
        Number of the panel's screen; -1 = the one that has its pixels.
    simulate
        An ordinary window instead of the panel.
    seconds
        How long; 0 = until the window is closed.

    Returns
    -------
    figures
        What ``--json`` writes.
    """
    from ..lightfield.screens import (
        LiveWindow,
        check_packages,
        fields_to_show,
        live_adapter,
        show_live,
    )

    if len(fields) != 1 or fields[0].suffix.lower() != ".npz":
        raise UserError("name one field to show live: lfportrait show styled.npz --live")
    if command.device != "cpu":
        check_packages()
    adapter = live_adapter(command.device)
    window = LiveWindow(panel, screen, simulate)
    with command.progress("live") as progress:
        progress.update(0, fields[0].name)
        field, real = fields_to_show(fields[0], photo)

        def say(line: str, stays: bool) -> None:
            if stays:
                progress.say(line)
            else:
                progress.update(0, line)

        return show_live(window, adapter, field, config, panel, real, seconds=seconds, say=say)
