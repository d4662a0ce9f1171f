"""Open mouths: teeth and the dark between the lips, where the painter's sitter has them closed.

The guide finds nothing in a closed mouth for what an open one shows, and draws the line between the
painter's lips out over it. So what lies between a sitter's lips is painted by itself: as much of
the painter's white and of the painter's dark as the photo has of its own there. The white is that
of the painted eyes, in the light of the face; the dark is the darkest between the painted lips.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import Array, Bool, Float32, Float64, Floats, UInt8
from ..face import mouth_opening
from .exemplar import Exemplar
from .guides.filters import grey
from .guides.regions import polygon
from .lids import EYES, curve_through

Points = Floats

OPEN, WIDER, SHOWN = 0.07, 0.05, 0.12
"""Height of the gap over the mouth's width from which on a sitter's is painted so, if the painted
one is so much less; and from which on a painted one shows what is in it, and is copied."""
UPPER, LOWER = (60, 61, 62, 63, 64), (60, 67, 66, 65, 64)
TOP, BOTTOM = (48, 49, 50, 51, 52, 53, 54), (48, 59, 58, 57, 56, 55, 54)
"""Landmarks of the lips' inner and outer edges from corner to corner."""
LINE = 0.4  # Share of a painted lip next to the other that is the line between them.
STEPS = 200  # Places that a curve is sampled at.
EDGE, GROWN = 0.02, 0.012
"""Half of the width in which lips go over into what is between them, and how far it is moved into
the lips, where the painter's line between them would be left; over the mouth's width."""
CHEEKS = (0.1, 0.5), (-0.9, -0.2)
"""Cheeks lie so far aside of the corners, and so far below the mouth; over its width."""
WHITE, BLACK = 0.9, 0.05  # Quantiles of light between the lips: teeth, and the dark behind them.
DULL, DEEP = 0.85, 0.35
"""The gap's white is no less bright than so much of the cheeks, as it may show no teeth, and its
dark no lighter than that."""
LIGHT, DARK = 0.75, 0.1
"""Quantiles of light in the painted eyes and between the painted lips: the white and the dark."""
BRIGHTER = 1.3
"""White is that much brighter than the painted cheeks, at most; or as bright as the eyes."""
FLESH = 0.7  # What is as red as the lips stays as it is painted by so much: gums, a tongue.
SOON = 0.03
"""So much further open, over the mouth's width, it is painted in full: in a film nothing jumps."""
FEW = 12  # Fewer pixels say nothing.


def parts_lips(exemplar: Exemplar, points: Points) -> bool:
    """Whether a sitter's mouth is open, by landmarks [68, 2 or 3], and the painted one is not."""
    theirs = mouth_opening(exemplar.landmarks)
    return theirs < SHOWN and mouth_opening(points) > _least(theirs)


def _least(painted: float) -> float:
    """The opening from which on a mouth is painted after a photo, by that of the painted one."""
    return max(OPEN, painted + WIDER)


def lips_apart(points: Float64) -> Float64:
    """Landmarks [68, 2] of a painted mouth without the dark line between its lips.

    It would be drawn out over the lips of an open mouth; between these it is painted over.
    """
    out = points.copy()
    for inner, outer in (((61, 62, 63), (50, 51, 52)), ((67, 66, 65), (58, 57, 56))):
        out[list(inner)] += LINE * (points[list(outer)] - points[list(inner)])
    return out


def with_open_mouth(paint: Float32, photo: Float32, places: Float32, landmarks: Points,
                    painter: Palette) -> Float32:
    """Paint with what a photo shows between a sitter's lips.

    Parameters
    ----------
    paint, photo : float32 [N, 3], sRGB in [0, 1].
    places : float32 [N, 2], where they are; y points down.
    landmarks : [68, 2], as ``places``.
    painter : Of the painting that the paint is of.

    Returns
    -------
    paint : float32 [N, 3]; the same array where the mouth can't be made out.
    """
    mouth = _Mouth.of(landmarks)
    if mouth is None:
        return paint
    x, y = mouth.plane(places)
    near = np.flatnonzero(mouth.around(x, y))
    cheeks = _on_cheeks(x, y)
    gap, lips = mouth.parts(x[near], y[near])
    inside = gap > 0.5
    if min(inside.sum(), cheeks.sum()) < FEW:
        return paint
    shown = photo[near]
    skin, light = float(np.median(grey(photo[cheeks][None]))), grey(shown[None])[0]
    white = max(float(np.quantile(light[inside], WHITE)), DULL * skin)
    black = min(float(np.quantile(light[inside], BLACK)), DEEP * skin)
    share = np.clip((light - black) / max(white - black, 1e-3), 0, 1)[:, None]
    mixed = painter.dark + share * (painter.white_in(white / max(skin, 1e-3)) - painter.dark)
    flesh = FLESH * _flesh(shown, light, inside & (light > 0.8 * white), lips)
    out = paint.copy()
    opened = np.clip((mouth_opening(landmarks) - _least(painter.opening)) / SOON, 0, 1)
    out[near] += (opened * (1 - flesh) * gap)[:, None] * (mixed - paint[near])
    return np.asarray(out, np.float32)


def part_lips(paint: Float32, photo: Array, landmarks: Points, painter: Palette) -> None:
    """Paint what a photo shows between the lips, in place, as `with_open_mouth`.

    ``paint`` is float32 [H, W, 3] in [0, 1], the photo uint8 or float in [0, 1], [H, W, 3], and
    ``landmarks`` [68, 2] in its pixels.
    """
    points = np.asarray(landmarks, np.float64)
    middle, reach = points[48:68].mean(axis=0), 1.5 * np.ptp(points[48:68], axis=0).max()
    if not np.isfinite(reach):
        return
    low = np.maximum(np.floor(middle - reach).astype(int), 0)
    high = np.minimum(np.ceil(middle + reach).astype(int), paint.shape[1::-1])
    if (high <= low).any():
        return
    part = slice(low[1], high[1]), slice(low[0], high[0])
    rows, columns = np.mgrid[part]
    places = np.stack([columns, rows], axis=-1).reshape(-1, 2) + np.float32(0.5)
    colors = np.asarray(photo[part][..., :3].reshape(-1, 3), np.float32)
    if photo.dtype == np.uint8:
        colors /= np.float32(255)
    paint[part] = with_open_mouth(
        np.ascontiguousarray(paint[part].reshape(-1, 3)), colors,
        places.astype(np.float32), points, painter).reshape(paint[part].shape)


def _flesh(colors: Float32, light: Float32, teeth: Bool, lips: Bool) -> Float32:
    """How far colors [n, 3] are as red as the lips rather than as teeth, [n] in [0, 1]."""
    if min(teeth.sum(), lips.sum()) < FEW:
        return np.zeros(len(colors), np.float32)
    red = (colors[:, 0] - 0.5 * (colors[:, 1] + colors[:, 2])) / np.maximum(light, 0.05)
    low, high = float(np.median(red[teeth])), float(np.median(red[lips]))
    # The dark has no color of its own.
    lit = np.clip(light / max(float(np.median(light[lips])), 1e-3), 0, 1)
    return np.asarray(lit * np.clip((red - low) / max(high - low, 0.1), 0, 1), np.float32)


class _Mouth(NamedTuple):
    """The edges of lips in a plane of their own: x from one corner (0) to the other (1), y down."""

    corner: Float64  # [2]
    axes: Float64  # [2, 2], from the plane to these.
    points: Float64  # [68, 2], landmarks.

    @staticmethod
    def of(landmarks: Points) -> _Mouth | None:
        """By landmarks [68, 2]; None where those of the mouth are unknown."""
        points = np.asarray(landmarks, np.float64)
        across = points[64] - points[60]
        width = float(across @ across)
        if not (np.isfinite(points[48:68]).all() and width > 0):
            return None
        axes = np.array([across, [-across[1], across[0]]]).T / width
        return _Mouth(points[60], axes, (points - points[60]) @ axes)

    def plane(self, places: Floats) -> tuple[Float64, Float64]:
        """Coordinates of places [N, 2], [N] each."""
        x, y = np.asarray(places, np.float64).T - self.corner[:, None]
        (a, b), (c, d) = self.axes
        return a * x + c * y, b * x + d * y

    def around(self, x: Float64, y: Float64) -> Bool:
        """The lips and what lies between them, roughly; bool [N]."""
        low, high = self.points[48:68].min(axis=0), self.points[48:68].max(axis=0)
        return np.asarray((x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1]))

    def parts(self, x: Float64, y: Float64) -> tuple[Float32, Bool]:
        """How far places lie between the lips, float32 [N] in [0, 1], and what lies on them."""
        upper, lower = self._edge(UPPER, x), self._edge(LOWER, x)
        within = 0.5 + (GROWN + np.minimum(y - upper, lower - y)) / (2 * EDGE)
        # Towards the corners the gap is thinner than its edges.
        thick = np.clip((lower - upper) / (2 * EDGE), 0, 1) * ((x > 0) & (x < 1))
        gap = np.asarray(np.clip(within, 0, 1) * thick, np.float32)
        lips = (y > self._edge(TOP, x) + EDGE) & (y < self._edge(BOTTOM, x) - EDGE)
        return gap, np.asarray(lips & (x > 0.1) & (x < 0.9) & (gap == 0))

    def _edge(self, marks: tuple[int, ...], x: Float64) -> Float64:
        """How low a curve through landmarks lies, [N]."""
        along = np.linspace(0, 1, STEPS)
        return np.interp(x, along, curve_through(self.points[list(marks)], along))


def _on_cheeks(x: Float64, y: Float64) -> Bool:
    """Places on the cheeks by coordinates of `_Mouth`, bool [N]."""
    (least, most), (high, low) = CHEEKS
    aside = np.abs(x - 0.5) - 0.5
    return np.asarray((aside > least) & (aside < most) & (y > high) & (y < low))


class Palette(NamedTuple):
    """What a painter draws an open mouth and spectacles with: sRGB in [0, 1]."""

    white: Float64  # [3]
    dark: Float64  # [3], between the lips.
    black: Float64  # [3], in the eyes.
    cheeks: Float64  # [3]
    skin: float  # Light of the cheeks.
    brightest: float  # Light of the painting around its face.
    opening: float  # Of the painted mouth (`mouth_opening`).

    @staticmethod
    def of(exemplar: Exemplar) -> Palette | None:
        """Of a painting, its eyes open; None where its face is too small."""
        shown = exemplar.opened or exemplar
        points = shown.landmarks
        if not np.isfinite(points).all():
            return None
        low, high = points.min(axis=0), points.max(axis=0)
        part = tuple(slice(max(int(low[axis] - 0.3 * shown.size), 0),
                           max(int(high[axis] + 0.3 * shown.size), 0)) for axis in (1, 0))
        image = shown.image[part]
        points = points - [part[1].start, part[0].start]
        mouth = _Mouth.of(points)
        eyes = np.logical_or(*(polygon(image.shape[:2], points[first:first + 6]) > 0
                               for first in EYES))
        lips = polygon(image.shape[:2], points[48:60]) > 0
        if mouth is None or min(eyes.sum(), lips.sum()) < FEW:
            return None
        rows, columns = np.mgrid[:image.shape[0], :image.shape[1]]
        places = np.stack([columns, rows], axis=-1).reshape(-1, 2) + 0.5
        cheeks = _on_cheeks(*mouth.plane(places)).reshape(image.shape[:2])
        light = grey(image)
        if cheeks.sum() < FEW:
            return None
        return Palette(_mean(image, light, eyes, LIGHT, True),
                       _mean(image, light, lips, DARK, False),
                       _mean(image, light, eyes, DARK, False),
                       np.median(image[cheeks], axis=0) / 255,
                       float(np.median(light[cheeks])), float(np.quantile(light, 0.999)),
                       mouth_opening(points))

    def white_in(self, ratio: float) -> Float64:
        """White paint that is ``ratio`` times as bright as the cheeks, [3]."""
        light = float(grey(self.white[None, None].astype(np.float32))[0, 0])
        most = min(max(BRIGHTER * self.skin, light), self.brightest)
        wanted = np.clip(ratio * self.skin, min(light, most), most)
        return np.asarray(np.clip(self.white * wanted / max(light, 1e-3), 0, 1))


def _mean(image: UInt8, light: Float32, inside: Bool, quantile: float, lighter: bool) -> Float64:
    """Mean color of what is lighter, or darker, than a quantile of what lies inside, [3]."""
    limit = np.quantile(light[inside], quantile)
    chosen = inside & ((light >= limit) if lighter else (light <= limit))
    return np.asarray(image[chosen].mean(axis=0) / 255, np.float64)
