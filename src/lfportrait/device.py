"""The option ``--device``: allowed values, and the device that is used."""

from __future__ import annotations

from .errors import UserError

__all__ = ["computing_device"]


def computing_device(choice: str = "auto") -> str:
    """The device for the user's choice of ``--device``.

    Parameters
    ----------
    choice
        ``"auto"``, ``"cpu"``, ``"gpu"`` (any) or ``"gpu:NAME"`` (the one of that name).

    Returns
    -------
    device
        ``"cpu"``, as in the figures: this version uses no GPU.

    Raises
    ------
    UserError
        If the choice is none of these, or a GPU.
    """
    if choice in ("auto", "cpu"):
        return "cpu"
    if choice == "gpu" or (choice.startswith("gpu:") and choice != "gpu:"):
        raise UserError("this version computes on the CPU; leave --device at auto or cpu")
    raise UserError(f"--device takes auto, cpu, gpu or gpu:NAME, not {choice!r}")
