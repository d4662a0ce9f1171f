"""Light and what files hold of it (IEC 61966-2-1: sRGB).

Decoded pictures become eight-bit sRGB, whatever a file holds them as. Phones photograph in Display
P3, cameras in Adobe RGB, printers' files are CMYK or LAB: the profile in the file says what the
numbers mean (relative colorimetric, by LittleCMS). Sixteen bits a channel and floating-point
numbers become eight bits, not black or white.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

__all__ = ["linear_light", "srgb"]

_PROFILED = ("L", "RGB", "CMYK", "LAB")
"""Pillow's modes that LittleCMS converts."""


def linear_light(values: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Light, in [0, 1], of sRGB values in [0, 1] of any shape, float64."""
    value = np.asarray(values, np.float64)
    return np.asarray(np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4),
                      np.float64)


def srgb(picture: Image.Image) -> Image.Image:
    """A picture upright by its EXIF orientation, in sRGB.

    Parameters
    ----------
    picture
        As Pillow opens it, of any mode.

    Returns
    -------
    picture
        ``RGB``, or ``RGBA`` (straight alpha) where there is transparency; eight bits a channel.

    Raises
    ------
    OSError, ValueError, SyntaxError
        If its data are damaged.
    """
    profile = picture.info.get("icc_profile")
    upright: Image.Image = _in_eight_bits(ImageOps.exif_transpose(picture))
    # LAB's second channel is called A as well.
    alpha = upright.mode != "LAB" and ("A" in upright.getbands() or "a" in upright.getbands()
                                       or "transparency" in upright.info)
    if not alpha:
        return _by_profile(upright, profile)
    whole = upright.convert("LA" if upright.mode == "LA" else "RGBA")
    colors = _by_profile(whole.convert("L" if whole.mode == "LA" else "RGB"), profile)
    colors.putalpha(whole.getchannel("A"))
    return colors


def _in_eight_bits(picture: Image.Image) -> Image.Image:
    """The same with eight bits a channel; Pillow's own conversion cuts off what is above."""
    if not picture.mode.startswith(("I", "F")):
        return picture
    values = np.asarray(picture, np.float64)
    values = np.where(np.isfinite(values), values, 0.0)
    # Sixteen bits, or thirty-two of which sixteen are used; floating point from 0 to 1.
    most = 65535.0 if picture.mode.startswith("I") else 1.0
    if values.max(initial=0.0) > most:
        most = float(values.max())
    return Image.fromarray(np.uint8(np.clip(values / most, 0.0, 1.0) * 255.0 + 0.5))


def _by_profile(picture: Image.Image, profile: bytes | None) -> Image.Image:
    """The picture as RGB, by the profile if it has one that fits."""
    if picture.mode == "RGB" and not profile:
        return picture
    from PIL import ImageCms

    if picture.mode not in _PROFILED:  # a palette's colours have the file's profile, too
        picture = picture.convert("RGB")
    if profile:
        try:
            source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
            if "srgb" not in ImageCms.getProfileDescription(source).lower():
                changed = ImageCms.profileToProfile(
                    picture, source, ImageCms.createProfile("sRGB"), outputMode="RGB",
                    renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC)
                if changed is not None:
                    return changed
        except (ImageCms.PyCMSError, OSError, ValueError, TypeError):
            pass  # a damaged profile, or one of another kind of picture
    if picture.mode == "LAB":
        lab = ImageCms.createProfile("LAB")
        found = ImageCms.profileToProfile(picture, lab, ImageCms.createProfile("sRGB"),
                                          outputMode="RGB")
        return found if found is not None else picture.convert("L").convert("RGB")
    return picture.convert("RGB")
