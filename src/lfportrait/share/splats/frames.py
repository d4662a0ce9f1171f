"""The frame in which a file holds splats: which way is up, and how long a unit is.

Programs that show PLY and SOG files take them for what Kerbl et al. 2023 write, whose captures have
+y down, and turn them upright. SuperSplat turns by 180 degrees about z and looks from +z. Turned
the same way beforehand, a head stands upright there and faces the camera. glTF says +y up and
metres, SPZ's description +y up.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import UserError
from ..config import Up
from ..units import METRES
from .cloud import Splats

__all__ = ["framed", "half_turned", "is_down"]

DOWN = {".ply", ".sog"}
"""Endings of files that programs take to have +y down."""
_ACROSS = np.array([-1, -1, 1], np.float32)
_HARMONICS = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1], np.float32)
"""Signs of the harmonics that half a turn about z changes: those odd in x and y together."""


def framed(splats: Splats, suffix: str, up: Up = "auto") -> Splats:
    """Splats as a file is to hold them.

    Parameters
    ----------
    splats
        In the portrait frame (+y up, +z out of the face).
    suffix
        Of the file's name, such as ``.ply``.
    up
        ``"y-up"``; ``"y-down"``: half a turn about z; ``"auto"``: what is usual for such files.

    Raises
    ------
    UserError
        If a glTF is to have y down.
    """
    if is_down(suffix, up):
        return half_turned(splats)
    if suffix != ".glb":
        return splats
    return replace(splats, positions=splats.positions * np.float32(METRES),
                   scales=splats.scales * np.float32(METRES))


def is_down(suffix: str, up: Up = "auto") -> bool:
    """Whether such a file is to have +y down.

    Raises
    ------
    UserError
        If a glTF is to have it.
    """
    if suffix == ".glb" and up == "y-down":
        raise UserError("a .glb file has y up by its specification; leave --splats.up at auto")
    return suffix in DOWN if up == "auto" else up == "y-down"


def half_turned(splats: Splats) -> Splats:
    """Splats after half a turn about z, which turns itself back: nothing but signs change."""
    w, x, y, z = splats.turns.T
    return replace(splats, positions=splats.positions * _ACROSS,
                   turns=np.stack([-z, -y, x, w], axis=1),
                   sh=splats.sh * _HARMONICS[:splats.sh.shape[2]])
