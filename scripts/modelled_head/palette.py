"""Palettes of the painted exemplars: map the colors of a modelled head's photo."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .studio import Picture

__all__ = ["charcoal_tone", "fauve_colors", "impression_colors"]

Image = NDArray[np.float32]

_WARM = ((0.10, 0.05, 0.24), (0.42, 0.05, 0.27), (0.80, 0.16, 0.17), (0.96, 0.45, 0.15),
         (0.99, 0.74, 0.30), (1.00, 0.94, 0.66))
_COOL = ((0.05, 0.05, 0.22), (0.06, 0.16, 0.40), (0.03, 0.40, 0.47), (0.16, 0.62, 0.53),
         (0.62, 0.82, 0.50), (0.97, 0.96, 0.74))
_HAIR = ((0.04, 0.03, 0.16), (0.10, 0.10, 0.40), (0.14, 0.26, 0.66), (0.20, 0.50, 0.78),
         (0.50, 0.80, 0.84), (0.95, 0.95, 0.80))
_CLOTH = ((0.14, 0.02, 0.16), (0.42, 0.03, 0.24), (0.74, 0.07, 0.26), (0.93, 0.25, 0.30),
          (0.99, 0.55, 0.45), (1.00, 0.80, 0.65))


def _ramp(stops: tuple[tuple[float, float, float], ...], value: Image) -> Image:
    """Colors of a ramp at ``value`` in [0, 1]: [H, W] -> [H, W, 3]."""
    places = np.linspace(0.0, 1.0, len(stops))
    table = np.array(stops)
    return np.stack([np.interp(value, places, table[:, c]) for c in range(3)],
                    axis=-1).astype(np.float32)


def _stretched(light: Image, inside: NDArray[np.bool_], low: float, high: float) -> Image:
    """Luma rescaled so that these percentiles inside a region become 0.06 and 0.97."""
    if not inside.any():
        return light
    a, b = np.percentile(light[inside], [low, high])
    return np.asarray(np.clip(0.06 + 0.91 * (light - a) / max(b - a, 1e-3), 0.0, 1.0), np.float32)


def fauve_colors(picture: Picture, coverage: Image, light: Image,
                  rng: np.random.Generator) -> Image:
    """Wanted colors of the fauve painting, float32 [H, W, 3].

    Luma chooses the place on a ramp of the region; skin turned from the key light takes the cool
    ramp, skin turned to it the warm one. The background is cool behind the lit side of the head
    and warm behind the shaded one.
    """
    surface = picture.surface
    skin, hair, cloth, eye = (surface == k for k in range(4))
    tone = _stretched(light, skin, 1.0, 99.5) ** 1.12
    turn = ndimage.gaussian_filter(picture.normal[..., 0], 2.5)
    cool = np.clip((turn - 0.05) / 0.55, 0.0, 1.0)[..., None].astype(np.float32)
    face = _ramp(_WARM, tone) * (1.0 - cool) + _ramp(_COOL, tone) * cool
    photo = picture.image[..., :3].astype(np.float32) / 255.0
    # Redder than skin usually is: lips, cheeks, nose. They go to crimson.
    red = photo[..., 0] - photo[..., 1]
    usual = np.median(red[skin]) if skin.any() else 0.0
    crimson = np.clip((red - usual - 0.035) / 0.09, 0.0, 1.0)[..., None]
    lips = _ramp(((0.25, 0.0, 0.12), (0.72, 0.03, 0.20), (0.98, 0.32, 0.36)), light * 1.25)
    face = face * (1.0 - 0.8 * crimson) + 0.8 * crimson * lips
    wanted = face
    wanted = np.where(hair[..., None], _ramp(_HAIR, _stretched(light, hair, 2.0, 99.0)), wanted)
    shirt = _ramp(_CLOTH, 0.80 * _stretched(light, cloth, 2.0, 99.5))
    wanted = np.where(cloth[..., None], shirt, wanted)
    grey = light[..., None]
    vivid = np.clip(1.12 * grey + 3.2 * (photo - grey) + (-0.02, 0.04, 0.06), 0.0, 1.0)
    wanted = np.where(eye[..., None], vivid, wanted)
    wanted = np.where((surface == 4)[..., None], _ramp(_HAIR, 0.5 * light), wanted)
    behind = _background(light.shape, rng)
    cover = coverage[..., None]
    return np.asarray(wanted * cover + behind * (1.0 - cover), np.float32)


def _background(shape: tuple[int, ...], rng: np.random.Generator) -> Image:
    """Patches of teal and green on the left, orange and yellow on the right."""
    height, width = shape
    y, x = np.mgrid[:height, :width].astype(np.float32) / width
    clouds = []
    for reach in (0.10, 0.05):
        cloud = ndimage.gaussian_filter(rng.standard_normal(shape), reach * width, mode="wrap")
        clouds.append(cloud / cloud.std())
    side = np.clip(0.5 + 1.5 * (x - 0.5) + 0.10 * clouds[0], 0.0, 1.0)
    value = np.clip(0.52 + 0.16 * clouds[1] - 0.12 * (y - 0.6), 0.0, 1.0)
    left = _ramp(((0.02, 0.20, 0.34), (0.04, 0.47, 0.50), (0.42, 0.76, 0.55)), value)
    right = _ramp(((0.80, 0.24, 0.10), (0.96, 0.58, 0.14), (0.99, 0.84, 0.36)), value)
    weight = (side * side * (3.0 - 2.0 * side))[..., None]
    return np.asarray(left * (1.0 - weight) + right * weight, np.float32)


def impression_colors(picture: Picture, coverage: Image, light: Image,
                       rng: np.random.Generator) -> Image:
    """Wanted colors of the impressionist painting, float32 [H, W, 3].

    The photograph, livelier: light goes to rose and gold, shade to violet, its edge to green; the
    background is a garden out of focus.
    """
    photo = picture.image[..., :3].astype(np.float32) / 255.0
    surface = picture.surface
    grey = light[..., None]
    lively = grey + 1.35 * (photo - grey)
    tone = _stretched(light, surface == 0, 1.0, 99.0)[..., None]
    lively = lively * (0.80 + 0.50 * tone) + (0.035, 0.03, 0.05)
    shade = np.clip(1.0 - 1.7 * tone, 0.0, 1.0)
    edge = np.clip(1.0 - np.abs(tone - 0.52) / 0.18, 0.0, 1.0)
    glow = np.clip((tone - 0.70) / 0.30, 0.0, 1.0)
    skin = (surface == 0)[..., None]
    lively = np.where(skin, lively + shade * np.array([0.02, -0.01, 0.20])
                      + edge * np.array([-0.05, 0.05, 0.01]) + glow * np.array([0.10, 0.05, -0.02]),
                      lively)
    hair = _ramp(((0.10, 0.05, 0.16), (0.30, 0.14, 0.20), (0.52, 0.30, 0.20), (0.78, 0.58, 0.34),
                  (0.96, 0.88, 0.66)), 0.85 * _stretched(light, surface == 1, 2.0, 99.0))
    lively = np.where((surface == 1)[..., None], hair, lively)
    shirt = _ramp(((0.12, 0.14, 0.36), (0.24, 0.32, 0.62), (0.50, 0.62, 0.84), (0.86, 0.90, 0.95)),
                  _stretched(light, surface == 2, 2.0, 99.5))
    lively = np.where((surface == 2)[..., None], shirt, lively)
    height, width = light.shape
    clouds = [ndimage.gaussian_filter(rng.standard_normal(light.shape), reach * width, mode="wrap")
              for reach in (0.09, 0.035, 0.02)]
    a, b, c = (cloud / cloud.std() for cloud in clouds)
    rise = np.linspace(0.16, -0.16, height)[:, None]
    garden = _ramp(((0.16, 0.28, 0.30), (0.28, 0.46, 0.34), (0.52, 0.66, 0.42), (0.80, 0.82, 0.58),
                    (0.93, 0.90, 0.78)), np.clip(0.50 + rise + 0.15 * a + 0.08 * b, 0.0, 1.0))
    bloom = np.clip((c - 1.25) / 0.5, 0.0, 1.0)[..., None]
    garden = garden * (1.0 - bloom) + bloom * np.array([0.93, 0.62, 0.66])
    cover = coverage[..., None]
    return np.asarray(np.clip(lively, 0.0, 1.0) * cover + garden * (1.0 - cover), np.float32)


def charcoal_tone(picture: Picture, coverage: Image, light: Image, detail: Image,
                  scale: float) -> tuple[Image, Image, Image]:
    """What a charcoal drawing needs: darkness, contours and highlights, each [H, W] in [0, 1]."""
    surface = picture.surface
    skin, hair, cloth, eye = (surface == k for k in range(4))
    tone = np.where(hair, 0.85 * _stretched(light, hair, 1.0, 98.0),
                    np.where(cloth, 0.60 * _stretched(light, cloth, 1.0, 99.0),
                             _stretched(light, skin | eye | (surface == 4), 0.5, 97.0)))
    blurred = ndimage.gaussian_filter(tone, 22.0 * scale)
    tone = np.clip(tone + 0.5 * (tone - blurred), 0.0, 1.0)
    dark = np.clip(1.08 * (1.0 - tone), 0.0, 1.0) ** 1.25 * coverage
    # Edges of depth, of surface and of fine tone become contours.
    region = np.where(coverage > 0.5, surface, -1)
    region[region == 3] = 0
    border = np.zeros(light.shape, np.float32)
    border[:, 1:] += region[:, 1:] != region[:, :-1]
    border[1:] += region[1:] != region[:-1]
    border = ndimage.gaussian_filter(np.minimum(border, 1.0), 1.2 * scale) * 2.2
    fine = ndimage.gaussian_filter(light, 1.0 * scale) - ndimage.gaussian_filter(light, 4.0 * scale)
    lines = np.clip(-14.0 * fine - 0.25, 0.0, 1.0) * (0.35 + 0.65 * detail) * coverage
    contour = np.clip(0.75 * border * (coverage > 0.5) + lines, 0.0, 1.0)
    chalk = np.clip((tone - 0.90) / 0.10, 0.0, 1.0) * (skin | eye) * 0.6
    return (dark.astype(np.float32), contour.astype(np.float32), chalk.astype(np.float32))
