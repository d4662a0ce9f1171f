"""Relight the mirrored side of a face.

A strip of the far cheek that a painter showed from the side is too narrow for strokes, but it shows
the light there: shade, its hue, a reflection. So mirrored strokes take the broad colors of his own
paint wherever he showed any, and what lies behind goes on from there.

What goes on is brightness. Hue follows from it: deep shade is grey or green where half-tones are
warm, and its hue on a half-tone would be a stain. So a painter's curve from brightness to hue is
read from his own paint; only what differs from the curve (a reflection) is carried on as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..arrays import Float32
from .guides.filters import smaller

DARK = 24.0  # Added to values before their logarithm: the darkest paint is no blacker than that.
UNLIKE = 0.6  # Difference of logarithms, mean of the channels, that is hardly one of light alone.
SMALL = 8  # Light changes slowly: it is looked at in pictures of this fraction of the size.
BROAD, ALONG = 0.04, 0.06
"""Blurs, in units of the head, in which light is looked at, and how wide a seam is."""
FURTHEST = 0.4
REACHES = FURTHEST, 0.2, 0.1, 0.05  # Units of the head over which light is carried on.
ENOUGH, FAR = 0.2, 0.08
"""So much of all that could be known within a reach is enough for it; and within the furthest."""
UTMOST = 0.05
"""No light makes paint brighter or darker than this share of what the painter saw of the face."""
DIM, FAINT = 0.5, 0.05
"""Paint darker than bare skin by this, in logarithms, is no skin; weight of light read from it."""
KEPT = 0.25
"""Light that differs so much, in logarithms, leaves 1 / e of what a place's hue has of its own."""
OWN = 0.15, 0.35
"""A hue that is so far off the painter's curve, in logarithms, begins to be carried on as far as
brightness, and wholly is."""
KNOTS, ALIKE, STEPS = 33, 0.08, 1000
"""Knots of the curve from brightness to hue; it is smoothed by this width, in logarithms; and steps
in which it is looked up for each pixel."""
THIRDS = np.full((1, 3), 1 / 3, np.float32)  # The mean of the channels.
FEW = 0.02
"""A brightness that is so much rarer than the commonest takes its hue from its neighbours."""


@dataclass(frozen=True)
class Sides:
    """A frontal picture, a painter's own paint on one side, its mirror image on the other."""

    # ours, theirs: float32 [h, w, 3], sRGB in [0, 255]: his own paint, and the mirror image's.
    ours: Float32
    theirs: Float32
    share: Float32  # float32 [h, w] in [0, 1], of his own.
    both: Float32  # float32 [h, w], where either is on the face and was seen at all.
    face: Float32  # float32 [h, w], the face; light changes nothing of hair and hats around it.
    head: Float32  # float32 [h, w], the head: bare skin in it is lit, too.
    # float32 [h, w], what of his own paint is hair; None where that is not known.
    hair: Float32 | None
    # float32 [h, w] in [0, 1], from the brows to the mouth: there darkness is shade, no hat.
    features: Float32
    scale: float  # Pixels per unit of the head.


def relit(sides: Sides) -> Float32:
    """The relit mirror image, float32 [h, w, 3].

    What differs broadly between own and mirrored paint, where both are skin, is the light. From
    there it goes on: a lit cheek does not end at a line of shadow, nor shade at a line of light.
    """
    scale, broad = sides.scale, BROAD * sides.scale
    bare = sides.both
    if sides.hair is not None:
        bare = bare * np.clip(1 - 2 * np.maximum(sides.hair, sides.hair[:, ::-1]), 0, 1)
    known = np.maximum(blurred(bare, broad), np.float32(1e-3))
    # Light multiplies: a brighter cheek makes no grey of a black hat beside it.
    brightness = [np.log(np.maximum(one, 0) + DARK) for one in (sides.ours, sides.theirs)]
    differing = blurred(bare[..., None] * (brightness[0] - brightness[1]), broad)
    differing = np.asarray(differing / known[..., None], np.float32)
    asked = _asked(sides, bare)
    if not asked.any():
        return sides.theirs
    # What is much darker or brighter may be hair or a hat over skin, and gets little weight.
    unlike = (differing.mean(axis=-1) / UNLIKE) ** 2
    known_light = asked * np.exp(-unlike * (1 - sides.features))
    # Two dark brows, or sockets, are alike in any light.
    lighter = np.maximum(*(blurred(one.mean(axis=-1), broad) for one in brightness))
    known_light = known_light * _lit(lighter, bare)
    weight, most, light, clear, own, mirrored = (_small(plane) for plane in (
        known_light, asked, differing, np.maximum(sides.face * (sides.share > 0.9), known_light),
        *(blurred(one, broad) for one in brightness)))
    hue = _Hue.of(own, clear)
    change = _change(hue, light, weight, most, clear, own, mirrored, scale / SMALL)
    laid = _laid(sides)[..., None] * cv2.resize(change, sides.ours.shape[1::-1],
                                                interpolation=cv2.INTER_CUBIC)
    # Stroke by stroke: a pale highlight beside them is none any more in shade.
    before, lighter = (np.asarray(cv2.transform(one, THIRDS), np.float32)
                       for one in (brightness[1], laid))
    laid += hue.table(before + lighter) - hue.table(before)
    return np.asarray(np.exp(brightness[1] + laid) - DARK, np.float32)


def _lit(bright: Float32, bare: Float32) -> Float32:
    """How far a place is as bright as bare skin mostly is, in [`FAINT`, 1], float32 [h, w]."""
    skin = bright[bare > 0.5]
    most = np.quantile(skin, 0.6) if len(skin) else np.float32(0)
    return np.asarray(np.clip(1 - (most - bright) / DIM, FAINT, 1), np.float32)


def _laid(sides: Sides) -> Float32:
    """Where light is laid, float32 [h, w]: on the face, and on bare skin around it."""
    if sides.hair is None:
        return sides.face
    bare = np.clip(1 - 2 * sides.hair[:, ::-1], 0, 1)
    return np.maximum(sides.face, sides.head * bare)


def _change(hue: _Hue, light: Float32, weight: Float32, most: Float32, clear: Float32,
            own: Float32, mirrored: Float32, unit: float) -> Float32:
    """What is added to the mirror image's logarithms, without what ``hue`` says, float32 [h, w, 3].

    ``light`` [h, w, 3] is known by ``weight`` [h, w] (see `_spread`); ``own`` and ``mirrored``
    [h, w, 3] are broad logarithms, his own where he saw the face clearly by ``clear`` [h, w].
    """
    dark = mirrored.mean(axis=-1)
    # What the curve says of the light is left out, and said again for the brightness that comes.
    known = light.mean(axis=-1)
    rest = light - known[..., None] - (hue(dark + known) - hue(dark))
    bright = dark + _spread(known[..., None], weight, most, unit)[..., 0]
    near, far = (_spread(rest, weight, most, unit, reaches) for reaches in (REACHES[2:], REACHES))
    # Shade that is green where the light is red has a hue of its own, which goes as far.
    strong = np.clip((np.abs(far).max(axis=-1) - OWN[0]) / (OWN[1] - OWN[0]), 0, 1)
    rest = near + strong[..., None] * (far - near)
    seen = clear > 0.5
    if seen.any():
        low, high = np.quantile(own.mean(axis=-1)[seen], (UTMOST, 1 - UTMOST))
        bright = np.clip(bright, np.minimum(low, dark), np.maximum(high, dark))
    # A cold highlight on warm skin is none in shade.
    lost = 1 - np.exp(-np.abs(bright - dark) / KEPT)[..., None]
    theirs = mirrored - dark[..., None]
    return np.asarray((bright - dark)[..., None] + rest - lost * (theirs - hue(dark)), np.float32)


@dataclass(frozen=True)
class _Hue:
    """A painter's hues by brightness."""

    knots: Float32  # float32 [K], brightness: the mean of the channels' logarithms.
    hues: Float32  # float32 [K, 3], logarithms less their mean.

    @staticmethod
    def of(paint: Float32, weight: Float32) -> _Hue:
        """From broad logarithms [h, w, 3] and weights [h, w]."""
        bright = paint.mean(axis=-1)
        counted = weight > 0.05 * max(float(weight.max()), 1e-6)
        low, high = np.quantile(bright[counted], (0.01, 0.99))
        knots = np.linspace(low, max(high, low + ALIKE), KNOTS)
        near = np.exp(-0.5 * ((bright[counted][:, None] - knots) / ALIKE) ** 2)
        near *= weight[counted][:, None]
        hue = (paint - bright[..., None])[counted]
        total = near.sum(axis=0)
        mean = (near.T @ hue) / np.maximum(total, 1e-6)[:, None]
        # A brightness that is hardly painted has no hue of its own.
        sure = total > FEW * total.max()
        each = [np.interp(knots, knots[sure], mean[sure, channel]) for channel in range(3)]
        return _Hue(np.asarray(knots, np.float32), np.asarray(np.stack(each, axis=-1), np.float32))

    def table(self, bright: Float32) -> Float32:
        """Hues [H, W, 3] of a picture's brightness [H, W], in a thousand steps of the curve."""
        low, high = self.knots[0], self.knots[-1]
        steps = self(np.linspace(low, high, STEPS + 1, dtype=np.float32))
        number = (bright - low) * np.float32(STEPS / (high - low)) + np.float32(0.5)
        return np.take(steps, np.clip(number, 0, STEPS).astype(np.int32), axis=0)

    def __call__(self, bright: Float32) -> Float32:
        """Hues [..., 3] of brightness [...]."""
        return np.stack([np.interp(bright, self.knots, self.hues[:, channel])
                         for channel in range(3)], axis=-1).astype(np.float32)


def _asked(sides: Sides, bare: Float32) -> Float32:
    """Where light is looked for, float32 [h, w]: at the seam, and beyond it wherever ``bare``."""
    seam = blurred(4 * sides.share * (1 - sides.share), ALONG * sides.scale)
    seam = seam / max(float(seam.max()), 1e-3)
    return np.asarray(bare * np.maximum(seam, 1 - sides.share), np.float32)


def _spread(light: Float32, weight: Float32, most: Float32, unit: float,
            reaches: tuple[float, ...] = REACHES) -> Float32:
    """Light [h, w, C] known by weights [h, w], carried on to where it is not; ``unit`` in pixels.

    From broad to narrow ``reaches``: near what is known that counts, further away a mean of more.
    ``most`` [h, w] are the weights if all of it were known. What is furthest takes the broadest
    mean whole; without `FURTHEST` it keeps 0.
    """
    mean: Float32 = np.zeros_like(light)
    for reach in reaches:
        total = blurred(weight, reach * unit)[..., None]
        # A picture of one channel loses its last axis.
        sums = blurred(light * weight[..., None], reach * unit).reshape(light.shape)
        here = sums / (total + np.float32(1e-5))
        enough = FAR if reach == FURTHEST else ENOUGH
        enough *= float(blurred(most, reach * unit).max())
        sure = np.clip(total / (enough + 1e-6), 0, 1)
        mean = np.asarray(mean + sure * (here - mean), np.float32)
    return mean


def _small(plane: Float32) -> Float32:
    """A plane made small."""
    return smaller(plane, (max(plane.shape[1] // SMALL, 8), max(plane.shape[0] // SMALL, 8)))


def blurred(picture: Float32, sigma: float) -> Float32:
    """A picture blurred by a Gaussian of ``sigma`` pixels."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.float32)
