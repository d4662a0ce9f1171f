"""Picture files for meshes."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

__all__ = ["jpeg", "png"]


def png(picture: NDArray[np.uint8]) -> bytes:
    """A PNG file of a picture [H, W, 3]."""
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "PNG", compress_level=6)
    return stream.getvalue()


def jpeg(picture: NDArray[np.uint8]) -> bytes:
    """A JPEG file of a picture [H, W, 3], at full resolution in color as well."""
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "JPEG", quality=94, subsampling=0)
    return stream.getvalue()
