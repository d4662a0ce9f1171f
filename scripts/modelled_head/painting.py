"""Make painted exemplars: render a modelled head, change its palette, and paint it.

The painter knows more than the pixels: which are skin, hair, cloth or background, and how the
surface is turned. Strokes wrap around the form of the face, run along the locks of the hair and
wander over the background; brushes go from broad to fine, as in Hertzmann 1998, and the finest
touch only eyes, nose and mouth. The 68 landmarks come from the model and are exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.errors import UserError
from lfportrait.example import Exemplar

from .head_model import HeadModel
from .kernels.brush import lay, plan, trace
from .palette import charcoal_tone, fauve_colors, impression_colors
from .people import PAINTED, landmarks
from .studio import Picture, photograph

__all__ = ["STYLES", "exemplar_camera", "painted_exemplar"]

Image = NDArray[np.float32]


@dataclass
class _Sitting:
    """What the painter has before him.

    Attributes
    ----------
    picture : The photograph and its normals and surfaces.
    coverage : float32 [H, W], share of the pixel that the person covers.
    light : float32 [H, W], luma of the photograph in [0, 1].
    field : float32 [H, W, 2], unit directions of strokes.
    label : int8 [H, W], regions: -1 background, else the surface.
    detail : float32 [H, W] in [0, 1]: 1 around eyes, nose and mouth.
    points : float64 [68, 2], landmarks in pixels.
    scale : Pixels of the picture over those of a picture 768 wide.
    """

    picture: Picture
    coverage: Image
    light: Image
    field: Image
    label: NDArray[np.int8]
    detail: Image
    points: NDArray[np.float64]
    scale: float


def exemplar_camera(width: int, height: int, turn: float = 0.0) -> Camera:
    """The camera in front of which the exemplars sit; pictures ``width`` x ``height``.

    It sees faces turned by ``turn`` degrees to the picture's right.
    """
    focal = 4.4 * max(width * 4.0 / 3.0, height) / 2.02
    away = np.radians(-turn)
    eye = np.array([[4.4 * np.sin(away), 0.06, 4.4 * np.cos(away)]])
    return Camera.look_at(eye, np.array([0.0, 0.06, 0.0]), width=width, height=height, focal=focal)


def painted_exemplar(name: str = "", width: int = 768, height: int = 1024, seed: int = 5,
                  turn: float = 0.0) -> Exemplar:
    """A painted portrait with its 68 landmarks.

    Parameters
    ----------
    name : One of `STYLES`; empty = the first.
    width, height : Size of the picture in pixels.
    seed : Seed of the painter's hand; the same seed gives the same bytes.
    turn : Degrees that the face is turned to the picture's right.

    Returns
    -------
    exemplar : Picture, landmarks (exact: projected from the model) and the mask of the person.

    Raises
    ------
    UserError : If there is no such style.
    """
    names = list(_STYLES)
    name = name or names[0]
    if name not in names:
        raise UserError(f"no built-in style {name!r}; there are: {', '.join(names)}")
    sitting = _sitting(PAINTED, width, height, turn)
    painted = _STYLES[name](sitting, np.random.default_rng(seed))
    image = (np.clip(painted, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    return Exemplar(image, sitting.points.copy(), name, sitting.coverage.copy())


@lru_cache(maxsize=1)
def _sitting(model: HeadModel, width: int, height: int, turn: float) -> _Sitting:
    """What all styles paint, kept for the next one: half of a painting's time. To be read only."""
    camera = exemplar_camera(width, height, turn)
    return _sit(photograph(model, camera), camera.project(landmarks(model))[0][0])


def _sit(picture: Picture, points: NDArray[np.float64]) -> _Sitting:
    """Look at the sitter: regions, directions, where detail matters."""
    color = picture.image[..., :3].astype(np.float32) / 255.0
    coverage = picture.image[..., 3].astype(np.float32) / 255.0
    light = np.asarray(color @ np.array([0.2126, 0.7152, 0.0722], np.float32), np.float32)
    label = np.where(coverage > 0.5, picture.surface, -1).astype(np.int8)
    # Eyes are part of the face to the brush: lids and eyeballs share their strokes.
    label[label == 3] = 0
    height, width = light.shape
    y, x = np.mgrid[:height, :width].astype(np.float32) + 0.5
    eyes = float(np.linalg.norm(points[36:42].mean(axis=0) - points[42:48].mean(axis=0)))
    detail = np.zeros_like(light)
    for first, last, reach in ((36, 42, 0.30), (42, 48, 0.30), (17, 22, 0.26), (22, 27, 0.26),
                               (30, 36, 0.28), (48, 68, 0.36)):
        cx, cy = points[first:last].mean(axis=0)
        detail = np.maximum(detail, np.exp(-(((x - cx) ** 2 + 2.0 * (y - cy) ** 2)
                                             / (reach * eyes) ** 2)))
    field = _directions(picture, light, label, eyes)
    return _Sitting(picture, coverage, light, field, label, detail.astype(np.float32), points,
                    width / 768.0)


def _directions(picture: Picture, light: Image, label: NDArray[np.int8], eyes: float) -> Image:
    """Directions of strokes, smoothed as angles modulo half a turn."""
    height, width = light.shape
    smooth = ndimage.gaussian_filter(light, 0.012 * eyes + 0.6)
    gy, gx = np.gradient(smooth)
    edge = np.hypot(gx, gy)
    # Double angles: (cos 2a, sin 2a) of the direction across the gradient, weighted by it.
    along = np.stack([gy * gy - gx * gx, -2.0 * gx * gy], axis=-1) / (edge[..., None] + 1e-4)
    nx, ny = picture.normal[..., 0], -picture.normal[..., 1]
    form = np.stack([ny * ny - nx * nx, -2.0 * nx * ny], axis=-1)
    skin, hair = (label == 0)[..., None], (label == 1)[..., None]
    double = np.where(skin, 0.10 * form + 1.3 * along, np.where(hair, along, 0.3 * form + along))
    y, x = np.mgrid[:height, :width] / float(width)
    angle = 0.9 + 1.3 * np.sin(3.1 * x + 1.7 * np.sin(2.3 * y)) + 0.8 * np.cos(4.1 * y - 1.2 * x)
    wander = 0.02 * np.stack([np.cos(2.0 * angle), np.sin(2.0 * angle)], axis=-1)
    double = np.where((label < 0)[..., None], wander, double)
    sums = []
    for region in (label == 0, label == 1, label == 2, label == 4, label < 0):
        if not region.any():
            continue
        weight = region.astype(np.float64)
        reach = 0.045 * eyes
        mass = ndimage.gaussian_filter(weight, reach) + 1e-6
        blurred = np.stack([ndimage.gaussian_filter(double[..., c] * weight, reach) / mass
                            for c in (0, 1)], axis=-1)
        sums.append(blurred * weight[..., None])
    double = np.sum(sums, axis=0)
    half = 0.5 * np.arctan2(double[..., 1], double[..., 0])
    return np.stack([np.cos(half), np.sin(half)], axis=-1).astype(np.float32)


def _grain(shape: tuple[int, int], rng: np.random.Generator, scale: float) -> Image:
    """Grain of paper or canvas in [0, 1]."""
    fine = ndimage.gaussian_filter(rng.standard_normal(shape), 0.7 * scale)
    coarse = ndimage.gaussian_filter(rng.standard_normal(shape), 1.8 * scale)
    mixed = fine / fine.std() + 0.6 * coarse / coarse.std()
    return np.asarray(np.clip(0.5 + 0.22 * mixed, 0.0, 1.0), np.float32)


def _rake(canvas: Image, relief: Image, strength: float) -> Image:
    """Let light from the upper left rake over the thickness of the paint."""
    gy, gx = np.gradient(ndimage.gaussian_filter(relief, 0.6))
    slope = np.clip(strength * (gx + gy), -0.35, 0.35)[..., None]
    return np.asarray(np.where(slope > 0, canvas + slope * (1.0 - canvas) * 0.55,
                               canvas * (1.0 + slope)), np.float32)


def _paint_fauve(sitting: _Sitting, rng: np.random.Generator) -> Image:
    """Thick oil in complementary colors: orange light, teal and violet shade."""
    wanted = fauve_colors(sitting.picture, sitting.coverage, sitting.light, rng)
    layers = ((30.0, 0.00, 3, 9, 0.070, 0.060, 0.0), (14.0, 0.075, 3, 9, 0.055, 0.050, 0.0),
              (7.0, 0.085, 3, 9, 0.045, 0.040, 0.0), (3.8, 0.085, 3, 9, 0.035, 0.025, 0.06),
              (2.1, 0.060, 2, 8, 0.020, 0.010, 0.32))
    return _oil(sitting, wanted, (0.36, 0.13, 0.16), layers, 0.50, rng)


def _paint_impression(sitting: _Sitting, rng: np.random.Generator) -> Image:
    """Short broken strokes of pure color: pink and gold light, violet and green shade."""
    wanted = impression_colors(sitting.picture, sitting.coverage, sitting.light, rng)
    layers = ((17.0, 0.00, 2, 4, 0.050, 0.060, 0.0), (8.0, 0.050, 2, 3, 0.050, 0.070, 0.0),
              (4.6, 0.075, 2, 3, 0.045, 0.060, 0.0), (2.8, 0.075, 2, 4, 0.030, 0.030, 0.08),
              (1.8, 0.055, 2, 5, 0.015, 0.012, 0.30))
    return _oil(sitting, wanted, (0.80, 0.70, 0.56), layers, 0.42, rng)


def _oil(sitting: _Sitting, wanted: Image, ground: tuple[float, float, float],
         layers: tuple[tuple[float, float, int, int, float, float, float], ...], impasto: float,
         rng: np.random.Generator) -> Image:
    """Paint the wanted colors in layers from broad to fine brushes.

    Each layer: radius (pixels of a picture 768 wide), color distance that calls for a stroke,
    steps of a stroke (shortest, longest), jitter of its value and of its hue, and the detail below
    which the brush is not used.
    """
    shape = sitting.light.shape
    tooth = _grain(shape, rng, sitting.scale)
    canvas = np.broadcast_to(np.array(ground, np.float32), (*shape, 3)).copy()
    relief = np.zeros(shape, np.float32)
    for radius, threshold, shortest, longest, value, hue, least in layers:
        radius = max(radius * sitting.scale, 1.2)
        reference = np.stack([ndimage.gaussian_filter(wanted[..., c], 0.45 * radius)
                              for c in range(3)], axis=-1)
        goal = reference.copy()
        if least > 0.0:
            # Fine brushes see no error where no detail is wanted.
            keep = (sitting.detail < least) & ((sitting.label != 1) | (radius < 3.0))
            goal[keep] = canvas[keep]
        paths, counts = plan(goal, canvas, sitting.field, sitting.label, radius, threshold,
                             shortest, longest, 0.8)
        order = rng.permutation(len(paths))
        paths, counts = paths[order], counts[order]
        start = paths[:, 0].astype(np.int64)
        colors = reference[start[:, 1], start[:, 0]]
        colors = colors * (1.0 + value * rng.standard_normal((len(paths), 1))) + (
            hue * rng.standard_normal((len(paths), 3)))
        lay(canvas, relief, tooth, paths, counts, np.clip(colors, 0.0, 1.0).astype(np.float32),
            radius, 0.96, 0.35, 1.0)
    return _rake(canvas, relief, impasto)


def _paint_charcoal(sitting: _Sitting, rng: np.random.Generator) -> Image:
    """Charcoal on toned paper: smudged tone, hatching along the form, dark contours, chalk."""
    dark, contour, chalk = charcoal_tone(sitting.picture, sitting.coverage, sitting.light,
                                         sitting.detail, sitting.scale)
    shape = sitting.light.shape
    tooth = _grain(shape, rng, sitting.scale)
    paper = np.array([0.87, 0.80, 0.69], np.float32)
    smudge = ndimage.gaussian_filter(dark, 5.0 * sitting.scale)[..., None]
    canvas = paper * (1.0 + 0.05 * (tooth[..., None] - 0.5)) * (1.0 - 0.34 * smudge)
    canvas = np.ascontiguousarray(canvas, np.float32)
    relief = np.zeros(shape, np.float32)
    slanted = np.broadcast_to(np.array([0.64, -0.77], np.float32), (*shape, 2))
    crossed = np.broadcast_to(np.array([0.90, 0.44], np.float32), (*shape, 2))
    ink, white = (0.085, 0.075, 0.075), (0.98, 0.96, 0.92)
    # Hatching may leave the head by a little, as a quick hand does.
    near = (ndimage.gaussian_filter(sitting.coverage, 4.0 * sitting.scale) > 0.10).astype(np.int8)
    form = (sitting.field, sitting.label)
    # Directions, where, how dense, radius, opacity, steps, color, pitch of the starting points.
    passes = ((*form, dark, 1.35, 0.55, 18, ink, 6.6),
              (slanted, near, np.clip(1.25 * dark - 0.25, 0, 1), 1.25, 0.50, 15, ink, 6.8),
              (crossed, near, np.clip(1.6 * dark - 0.80, 0, 1), 1.25, 0.50, 12, ink, 6.8),
              (*form, np.clip(2.6 * dark - 1.55, 0, 1), 1.9, 0.80, 12, ink, 5.6),
              (*form, contour, 1.15, 0.85, 6, ink, 2.4), (*form, chalk, 1.8, 0.50, 9, white, 6.4))
    for field, label, density, radius, opacity, longest, color, pitch in passes:
        pitch, radius = pitch * sitting.scale, max(radius * sitting.scale, 0.9)
        starts = _scatter(density, pitch, rng)
        paths, counts = trace(starts, np.ascontiguousarray(field), label, 1.9 * radius, longest,
                              0.35)
        colors = np.broadcast_to(np.array(color, np.float32), (len(starts), 3)).copy()
        lay(canvas, relief, tooth, paths, counts, colors, radius, opacity, 0.85, 0.7)
    return canvas


def _scatter(density: Image, pitch: float, rng: np.random.Generator) -> Image:
    """Jittered points (x, y), float32 [S, 2], one in a cell of ``pitch`` times the density."""
    height, width = density.shape
    rows, columns = int(height / pitch), int(width / pitch)
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    points = (grid + rng.random(grid.shape)) * pitch
    points = np.minimum(points, [width - 1.0, height - 1.0])
    wanted = density[points[:, 1].astype(int), points[:, 0].astype(int)]
    points = points[rng.random(len(points)) < 0.55 * wanted]
    return np.asarray(rng.permutation(points), np.float32)


_STYLES: dict[str, Callable[[_Sitting, np.random.Generator], Image]] = {
    "fauve": _paint_fauve, "charcoal": _paint_charcoal, "impression": _paint_impression}
STYLES = tuple(_STYLES)
"""Names of the styles, the first is the default."""
