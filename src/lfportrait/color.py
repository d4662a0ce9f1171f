"""Conversion between linear light, sRGB (IEC 61966-2-1) and other sets of primaries.

What the numbers of a picture mean is found out elsewhere (`media.colors`); here are the formulas.
Pictures of high dynamic range (ITU-R BT.2100: HLG, as phones film by default, and PQ) are
tone-mapped.
"""

from typing import Literal

import numpy as np

from .arrays import Array, Float64, Floats, UInt8, UInt16

SRGB = (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3127, 0.3290)
"""Chromaticities x, y of red, green, blue and white of sRGB and BT.709."""
BT2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
"""The same of BT.2020 and BT.2100."""
LUMA = np.array([0.299, 0.587, 0.114], np.float32)
"""Weights of red, green and blue in the luma of sRGB values (BT.601)."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Those in the luminance of linear light (BT.709)."""
_LUMA = np.array([0.2627, 0.6780, 0.0593], np.float32)
_WHITE_HLG, _WHITE_PQ = 0.2650, 203.0
"""Where a diffuse white lies (ITU-R BT.2408): scene light of HLG's 75 %, and candela per m2."""
_SYSTEM_GAMMA = 1.09
"""Of HLG on a display of 550 cd/m2 (ITU-R BT.2100: 1.2 + 0.42 log10(L / 1000)): between videos that
hold scene light (1.0) and those made for a display of 1000 cd/m2 (1.2)."""
_KNEE = 0.9  # Light above this part of white is compressed: highlights keep their shape.


def to_uint8(values: Array) -> UInt8:
    """Values in [0, 1] of any shape as uint8, rounded, beyond it cut off; uint8 as they are."""
    if values.dtype == np.uint8:
        return values
    return (np.clip(values, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def linear_light(values: Floats) -> Float64:
    """Light, in [0, 1], of sRGB values in [0, 1] of any shape, float64."""
    value = np.asarray(values, np.float64)
    return np.asarray(np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4),
                      np.float64)


def srgb_values(light: Floats) -> Float64:
    """SRGB values in [0, 1] of light in [0, 1] of any shape, float64; beyond it is cut off."""
    value = np.clip(np.asarray(light, np.float64), 0.0, 1.0)
    return np.asarray(np.where(value <= 0.0031308, 12.92 * value,
                               1.055 * np.maximum(value, 1e-8) ** (1 / 2.4) - 0.055), np.float64)


def to_lab(picture: Array) -> Floats:
    """CIE Lab of sRGB values [..., 3], bytes or floats, which are clipped to [0, 1]."""
    from skimage.color import rgb2lab  # takes a while to import

    return np.asarray(rgb2lab(picture if picture.dtype == np.uint8 else np.clip(picture, 0, 1)))


def _to_xyz(primaries: tuple[float, ...]) -> Float64:
    """The matrix [3, 3] from linear RGB with these primaries to XYZ (SMPTE RP 177)."""
    x, y = np.array(primaries[0::2]), np.array(primaries[1::2])
    xyz = np.stack([x / y, np.ones(4), (1 - x - y) / y])
    return np.asarray(xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3]))


_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367],
                      [0.0389, -0.0685, 1.0296]])


def primaries_to_srgb(primaries: tuple[float, ...]) -> Float64:
    """The matrix [3, 3] from linear RGB with other primaries (as `SRGB`) to sRGB's.

    Another white is adapted to sRGB's (Bradford).
    """
    def cone(values: tuple[float, ...]) -> Float64:
        x, y = values[6:8]
        return _BRADFORD @ np.array([x / y, 1.0, (1 - x - y) / y])

    adapted = np.linalg.solve(_BRADFORD, np.diag(cone(SRGB) / cone(primaries)) @ _BRADFORD)
    return np.asarray(np.linalg.solve(_to_xyz(SRGB), adapted @ _to_xyz(primaries)))


def tone_mapped(signal: UInt16, curve: Literal["hlg", "pq"],
                primaries: tuple[float, ...] = BT2020) -> UInt8:
    """A picture of high dynamic range as sRGB, uint8 [H, W, 3]; a diffuse white is nearly white.

    ``signal`` is uint16 [H, W, 3], full range, R'G'B', by the curve HLG (ARIB STD-B67) or PQ (SMPTE
    ST 2084), as in ITU-R BT.2100; ``primaries`` are chromaticities as in `SRGB`.
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
    light = np.maximum(light @ primaries_to_srgb(primaries).T.astype(np.float32), 0)
    over = np.maximum(light - _KNEE, 0)
    light = np.minimum(light, _KNEE) + (1 - _KNEE) * (1 - np.exp(-over / (1 - _KNEE)))
    return np.asarray(srgb_values(light) * 255 + 0.5, np.uint8)
