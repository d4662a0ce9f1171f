"""From a field to fitted splats."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...errors import UserError
from ...field import VoxelField
from ..config import SplatConfig
from ..paths import orbit_cameras
from .cloud import Splats, render_splats
from .fitting import fit_splats
from .placing import place_splats

__all__ = ["field_splats", "splat_psnr"]

CHECKED = 8
"""Views of a level orbit with which splats are compared to the field."""


def field_splats(field: VoxelField, config: SplatConfig | None = None,
                 tell: Callable[[float, str], None] = lambda share, text: None,
                 ) -> tuple[Splats, float]:
    """Gaussian splats that look like a field.

    Parameters
    ----------
    field
        The field.
    config
        Parameters.
    tell
        Told how much is done, 0 to 1, and what is being done.

    Returns
    -------
    splats
        In the field's world.
    psnr
        In dB, of pictures of the splats against the field's, see `splat_psnr`.

    Raises
    ------
    UserError
        If a parameter makes no sense or the field shows nothing.
    """
    config = config or SplatConfig()
    if config.count < 1 or config.steps < 0:
        raise UserError(f"--splats.count must be at least 1 and --splats.steps at least 0, not "
                        f"{config.count} and {config.steps}")
    tell(0.0, "surface points")
    splats = place_splats(field, config.count, config.degree)
    splats = fit_splats(field, splats, config.steps, config.seed,
                        lambda step: tell(0.2 + 0.7 * step / config.steps, "fit"))
    tell(0.9, "comparison")
    return splats, splat_psnr(field, splats)


def splat_psnr(field: VoxelField, splats: Splats, size: int = 512) -> float:
    """PSNR in dB of splats to a field: a level orbit on white, which no fit has seen.

    Parameters
    ----------
    field, splats
        What is compared.
    size
        Of the pictures in pixels.
    """
    cameras = orbit_cameras(CHECKED, size, field)
    errors = []
    for view in range(len(cameras)):
        expected = np.clip(field.render(cameras, view).color, 0, 1)
        shown = np.clip(render_splats(splats, cameras, view), 0, 1)
        errors.append(float(((shown - expected) ** 2).mean()))
    return round(-10 * math.log10(max(sum(errors) / CHECKED, 1e-10)), 2)
