"""Conversion between linear light and sRGB (IEC 61966-2-1).

Decoded pictures become eight-bit sRGB, whatever a file holds them as. Phones photograph in Display
P3, cameras in Adobe RGB, printers' files are CMYK or LAB: the profile in the file says what the
numbers mean (relative colorimetric, by LittleCMS). Sixteen bits a channel and floating-point
numbers become eight bits, not black or white. Videos of high dynamic range (ITU-R BT.2100: HLG, as
phones film by default, and PQ) are tone-mapped.
"""

from __future__ import annotations

import io
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

__all__ = ["linear_light", "srgb", "tone_mapped"]

_PROFILED = ("L", "RGB", "CMYK", "LAB")
"""Pillow's modes that LittleCMS converts."""


_TO_709 = np.array([[1.660491, -0.587641, -0.072850], [-0.124550, 1.132900, -0.008349],
                    [-0.018151, -0.100579, 1.118730]], np.float32)
"""Linear BT.2020 to BT.709, sRGB's primaries (ITU-R BT.2087)."""
_LUMA = np.array([0.2627, 0.6780, 0.0593], np.float32)
_WHITE_HLG, _WHITE_PQ = 0.2650, 203.0
"""Where a diffuse white lies (ITU-R BT.2408): scene light of HLG's 75 %, and candela per m2."""
_SYSTEM_GAMMA = 1.09
"""Of HLG on a display of 550 cd/m2 (ITU-R BT.2100: 1.2 + 0.42 log10(L / 1000)): between videos that
hold scene light (1.0) and those made for a display of 1000 cd/m2 (1.2)."""
_KNEE = 0.9
"""Light above this part of white is compressed: highlights keep their shape."""


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

    if picture.mode not in _PROFILED:  # a palette's colors have the file's profile, too
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


def tone_mapped(signal: NDArray[np.uint16], curve: Literal["hlg", "pq"]) -> NDArray[np.uint8]:
    """A picture of high dynamic range as sRGB.

    Parameters
    ----------
    signal
        uint16 [H, W, 3], full range, R'G'B' with the primaries of BT.2020.
    curve
        HLG (ARIB STD-B67) or PQ (SMPTE ST 2084), as in ITU-R BT.2100.

    Returns
    -------
    picture
        uint8 [H, W, 3]; a diffuse white is nearly white.
    """
    value = np.arange(65536) / 65535.0
    if curve == "hlg":
        a, b, c = 0.17883277, 0.28466892, 0.55991073
        scene = np.where(value <= 0.5, value ** 2 / 3, (np.exp((value - c) / a) + b) / 12)
        light = (scene / _WHITE_HLG).astype(np.float32)[signal]
        light *= np.maximum(light @ _LUMA, 1e-6)[..., None] ** np.float32(_SYSTEM_GAMMA - 1)
    else:
        m1, m2, c1, c2, c3 = 0.1593017578125, 78.84375, 0.8359375, 18.8515625, 18.6875
        root = value ** (1 / m2)
        nits = 10_000 * (np.maximum(root - c1, 0) / (c2 - c3 * root)) ** (1 / m1)
        light = (nits / _WHITE_PQ).astype(np.float32)[signal]
    light = np.maximum(light @ _TO_709.T, 0)
    over = np.maximum(light - _KNEE, 0)
    light = np.minimum(light, _KNEE) + (1 - _KNEE) * (1 - np.exp(-over / (1 - _KNEE)))
    shown = np.where(light <= 0.0031308, 12.92 * light,
                     1.055 * np.maximum(light, 1e-8) ** (1 / 2.4) - 0.055)
    return np.asarray(shown * 255 + 0.5, np.uint8)
