"""The colors that a page can show: one set, or several that share their densities."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...field import C0, VoxelField
from ...stylize import StyledField

__all__ = ["ColorSet", "color_sets"]



@dataclass(frozen=True)
class ColorSet:
    """Colors of a field's rows.

    Attributes
    ----------
    name
        For people.
    kind
        ``"photo"``, ``"style"``, ``"mix"`` (of photo and styles) or ``"field"`` (of a field that
        has no other).
    sh
        float32 [N, 3, B], coefficients as a `VoxelField` has them.
    texels
        int8 [H, W, 3], texture of the surface that belongs to them, or None.
    """

    name: str
    kind: str
    sh: NDArray[np.float32] = field(repr=False)
    texels: NDArray[np.int8] | None = field(default=None, repr=False)


def _plain(colors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Colors [N, 3] as coefficients of degree 0, float32 [N, 3, 1]."""
    return ((colors - np.float32(0.5)) * np.float32(1 / C0))[:, :, None]


def color_sets(voxels: VoxelField, degree: int = 0) -> list[ColorSet]:
    """The colors of a field: photo, then what it shows, then its other styles.

    Parameters
    ----------
    voxels
        A `StyledField` has several sets, every other field one.
    degree
        Degree of the spherical harmonics that are kept, 0 to 2.

    Raises
    ------
    UserError
        If the field does not have that degree.
    """
    if not 0 <= degree <= 2:
        raise UserError(f"--sh takes the degree 0, 1 or 2, not {degree}")
    if (degree + 1) ** 2 > voxels.basis:
        raise UserError(f"the field's colors have degree {round(voxels.basis ** 0.5) - 1}, not "
                        f"{degree}: leave out --sh, or export the photographed field")
    own = None if voxels.texture is None else voxels.texture.texels
    if not isinstance(voxels, StyledField):
        return [ColorSet("", "field", voxels.sh[:, :, :(degree + 1) ** 2], own)]
    shown: dict[str, Any] = voxels.mixture
    first = shown.get("style", voxels.styles[0])
    order = [first, *(name for name in voxels.styles if name != first)]
    texels = dict(zip(voxels.styles, voxels.painted_texels, strict=True)
                  ) if voxels.painted_texels is not None else {}
    styles = [ColorSet(name, "style", _plain(voxels.painted[voxels.styles.index(name)]),
                       texels.get(name)) for name in order]
    photo = ColorSet("photo", "photo", _plain(voxels.photo))
    pure = (shown.get("strength", 1.0) == 1.0 and not shown.get("identity")
            and not shown.get("regions") and not shown.get("keep_colors")
            and not shown.get("keep"))
    return [photo, *([] if pure else [ColorSet("mixed", "mix", voxels.sh, own)]), *styles]
