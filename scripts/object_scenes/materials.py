"""What solids are made of: a row of numbers, and the patterns that are painted on them.

Patterns are procedures of where a point lies on its solid: of two coordinates along the surface
(`chart`), in the solid's own axes. Randomness is a hash of cells and of the solid's number, so that
it is the same in every picture.
"""

from __future__ import annotations

from math import atan2, floor, pi, sin

import numpy as np
from numba import njit

from lfportrait.simd.decorators import part

from .solids import BLADE, BOX, CASE, CLOTH, CYLINDER, LEAF

__all__ = ["BANDS", "BOARDS", "BRICKS", "CHECKS", "CLEAR", "CLOUDS", "FREQUENCY", "GLOSS", "GLOW",
           "METAL", "PAPER", "POSTER", "PRINT", "ROUGH", "SHARPNESS", "SPECKLES", "SPINE",
           "STRIPES", "THIN", "VEINS", "WEAVE", "material", "noise", "paint", "part"]

STRIPES, BANDS, CHECKS, BRICKS, BOARDS, CLOUDS, WEAVE, PAPER, POSTER, VEINS, SPINE, SPECKLES, \
    PRINT = range(13)
COLOR, SECOND, FREQUENCY, GLOSS, SHARPNESS, PATTERN, METAL, ROUGH, CLEAR, VARY, THIN, GLOW = (
    0, 3, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)


def material(color, gloss: float = 0.1, sharpness: float = 20, second=None, pattern: int = STRIPES,
             frequency: float = 0.0, metal: float = 0.0, rough: float = 0.0, clear: float = 0.0,
             vary: float = 0.0, thin: float = 0.0, glow: float = 0.0) -> np.ndarray:
    """A row of numbers.

    Parameters
    ----------
    color, second : sRGB in [0, 1]; the second one is the pattern's.
    gloss, sharpness : How bright a highlight is, and how narrow.
    pattern, frequency : What is painted, how many times a unit length.
    metal : 1: a mirror tinted by the color; less: a lacquer that mirrors at flat angles.
    rough : How much what it mirrors is blurred, in radians.
    clear : Glass: how many times a unit length dims what is seen through it to 1/e.
    vary : How much the brightness of solids of this material differs.
    thin : How much light passes from behind.
    glow : Brightness of its own.
    """
    row = np.zeros(16)
    row[COLOR:COLOR + 3], row[SECOND:SECOND + 3] = color, color if second is None else second
    row[FREQUENCY:] = (frequency, gloss, sharpness, pattern, metal, rough, clear, vary, thin, glow)
    return row


_of_three = njit("float64(float64, float64, float64)", cache=True, error_model="numpy", nogil=True,
                 no_cfunc_wrapper=True, no_cpython_wrapper=True)


@_of_three
def hashed(a, b, c):
    """A number in [0, 1) that looks random, from three whole ones."""
    low = np.uint64(0xFFFFFFFF)
    mixed = (np.uint64(int(a) & 0xFFFF) * np.uint64(0x9E3779B1)
             ^ np.uint64(int(b) & 0xFFFF) * np.uint64(0x85EBCA77)
             ^ np.uint64(int(c) & 0xFFFF) * np.uint64(0xC2B2AE3D)) & low
    for _ in range(2):
        mixed = ((mixed ^ (mixed >> np.uint64(15))) * np.uint64(0x2C1B3C6D)) & low
    mixed ^= mixed >> np.uint64(13)
    return float(mixed & np.uint64(0xFFFFFF)) / 16777216.0


@_of_three
def noise(x, y, z):
    """Two octaves of smooth noise in [0, 1]."""
    total, weight = 0.0, 0.67
    for _ in range(2):
        i, j, k = floor(x), floor(y), floor(z)
        u, v, w = x - i, y - j, z - k
        u, v, w = u * u * (3 - 2 * u), v * v * (3 - 2 * v), w * w * (3 - 2 * w)
        for corner in range(8):
            a, b, c = corner >> 2, (corner >> 1) & 1, corner & 1
            total += (weight * (u if a else 1 - u) * (v if b else 1 - v) * (w if c else 1 - w)
                      * hashed(i + a, j + b, k + c))
        x, y, z, weight = 2.03 * x + 17.0, 2.03 * y + 5.0, 2.03 * z, 0.33
    return total


@part
def chart(solid, place, normal):
    """Two coordinates along the surface; the second one is the height where there is one."""
    kind = int(solid[0])
    if kind in (BOX, CASE):
        across = np.empty(3)
        for axis in range(3):
            across[axis] = abs((solid[4 + 3 * axis:7 + 3 * axis] * normal).sum())
        if across[2] >= max(across[0], across[1]):
            return place[0], place[1]
        return (place[1], place[2]) if across[0] > across[1] else (place[0], place[2])
    if kind in (LEAF, BLADE, CLOTH):
        return place[0], place[1]
    if kind == CYLINDER and place[2] > solid[15] - 0.003:
        return place[0], place[1]
    return atan2(place[1], place[0]) * solid[13], place[2]


@_of_three
def step(low, high, value):
    t = min(max((value - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@part
def blend_of(pattern, often, solid, number, place, p, q):
    """(share of the second color, brightness) of a pattern at a point."""
    if pattern == STRIPES:
        return (1.0 if sin(pi * often * (place[0] + place[1] + place[2])) > 0 else 0.0), 1.0
    if pattern == BANDS:  # painted by hand on what turns: lines of several widths, a few rows
        height = place[2] / solid[15]
        wobble = 0.02 * (noise(5.0 * p, 0.0, number) - 0.5)
        band = 0.5 + 0.5 * sin(often * pi * (height + wobble)) + 0.3 * sin(2.7 * often * height)
        return step(0.75, 0.95, band) * step(0.85, 0.7, abs(height)), 1.0
    if pattern == CHECKS:
        i, j = floor(p * often), floor(q * often)
        joint = min(min(p * often - i, i + 1 - p * often), min(q * often - j, j + 1 - q * often))
        tone = 0.82 + 0.3 * hashed(i, j, number) + 0.12 * (noise(9 * p, 9 * q, number) - 0.5)
        return float((int(i) + int(j)) & 1), tone * (0.45 + 0.55 * step(0.01, 0.035, joint))
    if pattern == BRICKS:
        row = floor(q * often * 2.0)
        i = floor(p * often + 0.5 * (int(row) & 1))
        along, up = p * often + 0.5 * (int(row) & 1) - i, q * often * 2.0 - row
        joint = step(0.03, 0.07, min(min(along, 1 - along), 0.5 * min(up, 1 - up)))
        tone = 0.65 + 0.5 * hashed(i, row, number) + 0.5 * (noise(30 * p, 30 * q, 1.0) - 0.5)
        return 1.0 - joint, tone
    if pattern == BOARDS:
        j = floor(q * often)
        i = floor(0.9 * p + 3.0 * hashed(j, 3, number))
        joint = min(q * often - j, j + 1 - q * often)
        grain = noise(2.5 * p + 20 * hashed(i, j, 1), 26 * q, number + j)
        ring = 0.5 + 0.5 * sin(22.0 * grain)
        tone = (0.75 + 0.45 * hashed(i, j, number)) * (0.35 + 0.65 * step(0.0, 0.04, joint))
        return 0.75 * ring * grain + 0.25 * grain, tone
    if pattern == CLOUDS:
        cloud = noise(often * place[0], often * place[1], often * place[2] + 7.0 * number)
        return step(0.3, 0.7, cloud), 0.9 + 0.2 * cloud
    if pattern == WEAVE:
        thread = sin(pi * often * p) * sin(pi * often * q)
        stripe = step(0.75, 0.85, sin(0.09 * often * p)) + step(0.75, 0.85, sin(0.09 * often * q))
        return min(0.5 * stripe, 1.0), 0.94 + 0.1 * thread + 0.1 * (noise(9 * p, 9 * q, 0) - 0.5)
    if pattern == PAPER:  # flowers at the corners of a lattice between stripes
        j = floor(q * often)
        x, y = p * often + 0.5 * (int(j) & 1), q * often - j - 0.5
        x -= floor(x) + 0.5
        turn, away = atan2(y, x), (x * x + y * y)**0.5
        petal = step(0.03, -0.03, away - 0.24 - 0.11 * sin(5.0 * turn + 1.0))
        heart = step(0.02, -0.02, away - 0.09)
        line = step(0.46, 0.48, abs(x))
        return max(petal - heart, 0.7 * line), 0.93 + 0.14 * noise(14 * p, 14 * q, 2.0)
    if pattern == VEINS:
        u, v = p / solid[13], abs(q) / solid[14]
        rib = step(0.10, 0.03, v) + 0.7 * step(0.25, 0.12, abs(sin(8.0 * (u - 0.35 * v))))
        return min(rib, 1.0), 0.88 + 0.24 * noise(35 * p, 35 * q, number)
    if pattern == SPINE:
        height = q / solid[15]
        band = step(0.03, 0.01, abs(abs(height) - 0.72)) + step(0.02, 0.0, abs(abs(height) - 0.62))
        letter = hashed(floor(q * 90.0), number, 5)
        title = (abs(height) < 0.4) and letter > 0.45 and abs(p) < 0.6 * min(solid[13], solid[14])
        return min(band + (0.9 if title else 0.0), 1.0), 0.9 + 0.2 * noise(40 * p, 40 * q, number)
    if pattern == SPECKLES:
        spot = noise(often * place[0], often * place[1], often * place[2])
        slow = noise(2.5 * place[0], 2.5 * place[1], 2.5 * place[2] + number)
        return 0.75 * step(0.66, 0.74, spot), 0.85 + 0.3 * slow
    line = floor(q * often)  # PRINT: columns of words, some grey pictures
    word = floor(p * often * 0.6 + 3.3 * hashed(line, 0, number))
    inked = (q * often - line < 0.55) and hashed(line, word, number) > 0.18
    letter = hashed(floor(p * often * 4.0), line, 9) > 0.35
    picture = hashed(floor(p * often * 0.08), floor(q * often * 0.08), number) > 0.7
    if picture:
        return noise(often * p, often * q, 4.0), 1.0
    return (0.85 if inked and letter else 0.0), 1.0


@part
def paint(row, solid, number, place, normal, color):
    """The color, before light, at ``place`` (in the solid's axes) of solid ``number``."""
    pattern, often = int(row[PATTERN]), row[FREQUENCY]
    share, tone = 0.0, 1.0
    if often > 0.0:
        p, q = chart(solid, place, normal)
        if pattern == POSTER:
            poster(often, solid, number, p, q, color)
            return
        share, tone = blend_of(pattern, often, solid, number, place, p, q)
    if row[VARY] > 0.0:
        tone *= 1.0 + row[VARY] * (2.0 * hashed(number, 77, 1) - 1.0)
    for channel in range(3):
        color[channel] = tone * (row[channel] * (1.0 - share) + row[SECOND + channel] * share)


@part
def poster(often, solid, number, p, q, color):
    """A framed picture: sky, hills and discs in colors of its own, like a modern print."""
    border = min(solid[13] - abs(p), solid[14] - abs(q))
    kind = hashed(number, 1, 2)
    if kind < 0.5:  # a landscape of layers
        layer, height = 0, q / solid[14]
        for hill in range(5):
            top = 0.55 - 0.32 * hill + 0.35 * (noise(often * p, 3.1 * hill, number) - 0.5)
            if height < top:
                layer = hill + 1
    else:  # patches about scattered points
        layer, least = 0, 1e9
        i, j = floor(p * often), floor(q * often)
        for a in range(-1, 2):
            for b in range(-1, 2):
                x = i + a + hashed(i + a, j + b, number)
                y = j + b + hashed(i + a, j + b, number + 1)
                away = (x - p * often)**2 + (y - q * often)**2
                if away < least:
                    least, layer = away, int(8.0 * hashed(i + a, j + b, number + 2))
        if least < 0.04:
            layer = 9
    shade = 0.85 + 0.3 * noise(12 * often * p, 12 * often * q, number)
    for channel in range(3):
        value = 0.12 + 0.8 * hashed(layer, channel, number + 3)
        color[channel] = min(value * shade, 1.0) if border > 0.03 else 0.9
    if border < 0.012:
        for channel in range(3):
            color[channel] = 0.12
