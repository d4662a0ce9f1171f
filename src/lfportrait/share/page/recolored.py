"""Other colors for a page that is open: a further color set of the same head, as the page holds it.

A page keeps the rows of the lattice, and the texels of the surface, that its own colors need. What
is painted of the same field, in another mix, has a color at each of them. So only colors are sent:
no mask, no densities, no charts.
"""

from __future__ import annotations

import base64
import json
import re
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UserError
from ...field import C0, VoxelField
from .colors import ColorSet
from .packing import code_values
from .texels import PageTexture

__all__ = ["OpenPage", "recolored"]

_HEADER = re.compile(rb'<script type="application/json" id="portrait">(.*?)</script>', re.DOTALL)
_STREAM = re.compile(rb'<script type="application/octet-stream" data-stream="(mask|texels)">'
                     rb"([A-Za-z0-9+/=]*)</script>")


@dataclass(frozen=True)
class OpenPage:
    """What of a page other colors must fit to.

    Attributes
    ----------
    filled
        bool [Z, Y, X], the lattice points that it keeps.
    kept
        bool [H, W], the texels that it keeps, or None where it has no texture.
    pixels
        Texels per world unit; 0 without a texture.
    """

    filled: NDArray[np.bool_]
    kept: NDArray[np.bool_] | None = field(default=None, repr=False)
    pixels: float = 0.0

    @staticmethod
    def of(page: bytes) -> OpenPage:
        """Read a page that `write_page` wrote."""
        found = _HEADER.search(page)
        streams = dict(_STREAM.findall(page))
        if found is None or b"mask" not in streams:
            raise UserError("this file is no page of a portrait; write it again")
        header = json.loads(found[1])
        texture = header.get("texture")
        if not texture:
            return OpenPage(_bits(streams[b"mask"], header["shape"]))
        height, _, width = texture["shape"]
        return OpenPage(_bits(streams[b"mask"], header["shape"]),
                        _bits(streams[b"texels"], (height, width)), float(texture["pixels"]))


def _bits(text: bytes, shape: Any) -> NDArray[np.bool_]:
    bits = np.unpackbits(np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8))
    return bits[:int(np.prod(shape))].astype(np.bool_).reshape(shape)


def recolored(page: OpenPage, voxels: VoxelField) -> dict[str, Any] | None:
    """A field's colors as a further color set of a page.

    Parameters
    ----------
    page
        Of the same field, in whatever colors.
    voxels
        The field in the colors that are wanted; those seen from the front, of degree 0.

    Returns
    -------
    set
        ``bands`` as in the page's header; ``streams``: the band's residuals by its number;
        ``texels``: those of the texture, or None. Streams are deflated, in base64. None where the
        page does not hold the field row by row, as its size did not allow it.
    """
    if page.filled.shape != voxels.links.shape:
        return None
    rows = voxels.links[page.filled]
    if (rows < 0).any():
        return None
    shown = np.clip(voxels.sh[rows][:, (1, 0, 2), 0] * np.float32(C0) + np.float32(0.5), 0.0, 1.0)
    levels = (shown * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)
    stream, _ = code_values(page.filled, levels, np.zeros(len(levels), np.uint8))
    return {"bands": [{"low": 0.0, "high": 1.0}], "streams": {"0": _text(stream)},
            "texels": _texels(page, voxels)}


def _texels(page: OpenPage, voxels: VoxelField) -> str | None:
    """The texture's stream, in the page's atlas and at its resolution."""
    if page.kept is None or voxels.texture is None:
        return None
    voxel = float((2.0 * voxels.radius / voxels.links.shape[::-1]).mean())
    colors = ColorSet("", "mix", voxels.sh, voxels.texture.texels)
    texture = PageTexture.of(voxels.texture, [colors], voxels.lattice_points(), 1.8 * voxel)
    for _ in range(round(np.log2(texture.pixels / page.pixels))):
        texture = texture.halved()
    [texels] = texture.texels
    if texels is None or texels.shape[:2] != page.kept.shape:
        return None
    values = (texels[page.kept][:, (1, 0, 2)].astype(np.int16) + 128).astype(np.uint8)
    stream, _ = code_values(page.kept[:, None], values, np.zeros(len(values), np.uint8))
    return _text(stream)


def _text(stream: bytes) -> str:
    return base64.b64encode(stream).decode()
