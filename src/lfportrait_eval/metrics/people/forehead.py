"""Whether a painted forehead is of the painter's skin, or of what covers his sitter's.

A bonnet's linen, a hat or a fringe that lies on the painter's sitter must not be copied onto a bare
forehead. The colors of the exemplar's cheeks and nose are its skin's; those of its hair, clothes
and background are its other materials'; what it shows above the brows is skin, unless it is much
nearer to the latter. A pixel of the sitter's forehead that is nearer to other material is stained,
if by a margin and unlike the skin: cloth in the color of skin can't be told from skin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage
from scipy.cluster.vq import kmeans2
from skimage.color import rgb2lab
from skimage.draw import polygon2mask

from lfportrait.example import Exemplar, FaceFrame, Regions, painted_shares
from lfportrait.face import face_mask
from lfportrait.labels import MATERIALS

__all__ = ["Tones", "forehead_found", "forehead_region", "tones_of"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

FACE = 150.0
"""Colors are compared in pictures whose faces are so high at most, from brows to chin."""
BLUR = 0.02
"""Sigma of their blur over the face's height: strokes count by their mean."""
LIGHT = 0.5
"""So much light and shade count against hue and chroma: a forehead may be in other light."""
COLORS = 6
"""Colors that stand for a material."""
UNLIKE = 9.0
"""A color is unlike the skin that is so far (delta E) from all of its colors."""
MARGIN = 1.3
"""A pixel is stained whose distance to the skin is so many times that to other material."""
COVER = 2.5
"""The same of what the exemplar shows above the brows: in most it is skin in other light."""
TOP, BARE_TOP = -0.62, -0.36
"""A forehead ends here at most (brows 0, chin 1); the latter where no hairline is known."""
ABOVE_BROWS = 0.09
"""It begins so far above the brows' line: brows and their shade are none of it."""
WIDE = 0.9, 0.75
"""Its width over that of the brows; the latter where no hairline is known."""
FROM_HAIR = 0.05
"""It keeps so far from the hair: a painted hairline is soft."""
FEW = 40
"""Fewer pixels than this have no colors."""


@dataclass(frozen=True)
class Tones:
    """Colors of an exemplar's materials.

    Attributes
    ----------
    skin
        float32 [K, 3], Lab with light weighed by `LIGHT`: cheeks and nose.
    other
        float32 [M, 3], the same of all that is no skin, without what has the skin's colors.
    """

    skin: Float32
    other: Float32

    def stained(self, colors: Float32) -> Mask:
        """Which colors [N, 3] are another material's, bool [N]."""
        if not len(self.other) or not len(self.skin):
            return np.zeros(len(colors), bool)
        skin, other = _nearest(colors, self.skin), _nearest(colors, self.other)
        return np.asarray((skin > UNLIKE) & (skin > MARGIN * other))


def _nearest(colors: Float32, tones: Float32) -> Float32:
    """Distance of colors [N, 3] to the nearest of some tones [K, 3]; float32 [N]."""
    return np.asarray(np.linalg.norm(colors[:, None] - tones[None], axis=-1).min(axis=1),
                      np.float32)


def _small(picture: NDArray[np.uint8], points: NDArray[np.floating],
           ) -> tuple[NDArray[np.uint8], NDArray[np.float64], float]:
    """A picture whose face is no higher than `FACE`, its landmarks, and how much smaller it is."""
    factor = min(FACE / max(FaceFrame.of(points).height, 1.0), 1.0)
    height, width = picture.shape[:2]
    size = max(round(factor * width), 1), max(round(factor * height), 1)
    small = np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.BOX))
    return small, np.asarray(points * np.divide(size, (width, height)), np.float64), factor


def _colors(picture: NDArray[np.uint8], frame: FaceFrame) -> Float32:
    """Blurred colors of a picture, float32 [H, W, 3], as `Tones` compares them."""
    sigma = BLUR * frame.height
    blurred = ndimage.gaussian_filter(picture / np.float32(255), (sigma, sigma, 0))
    return np.asarray(rgb2lab(blurred) * np.array([LIGHT, 1, 1]), np.float32)


def _means(colors: Float32, seed: int = 0) -> Float32:
    """Colors that stand for many, [at most COLORS, 3]; those of a few pixels are left out."""
    if len(colors) < FEW:
        return np.empty((0, 3), np.float32)
    rng = np.random.default_rng(seed)
    sample = colors[rng.permutation(len(colors))[:20000]].astype(np.float64)
    means, of = kmeans2(sample, COLORS, minit="++", seed=rng)
    share = np.bincount(of, minlength=COLORS) / len(sample)
    return np.asarray(means[share > 0.02], np.float32)


def tones_of(exemplar: Exemplar) -> Tones:
    """Colors of an exemplar's skin, and of all else.

    Parameters
    ----------
    exemplar
        The painting, as the painter left it.
    """
    small, points, _ = _small(exemplar.image, exemplar.landmarks)
    shape = small.shape[1], small.shape[0]
    mask = None if exemplar.mask is None else np.asarray(
        Image.fromarray(exemplar.mask).resize(shape, Image.Resampling.BOX))
    picture = Exemplar(small, points, exemplar.name, mask)
    regions = picture.regions()
    shares = painted_shares(picture, regions, regions.labels())
    frame = regions.frame
    colors = _colors(small, frame)
    _, down = frame.local(small.shape[:2])
    face = polygon2mask(small.shape[:2], points[[0, 2, 4, 6, 10, 12, 14, 16]][:, ::-1])
    bare = face & (shares[..., MATERIALS.index("skin")] > 0.8) & (down > 0.1) & (down < 0.6)
    skin = _means(colors[bare])
    other = np.concatenate([_means(colors[shares[..., MATERIALS.index(name)] > 0.8])
                            for name in ("hair", "clothes", "background")])
    if not len(skin) or not len(other):
        return Tones(skin, other)
    other = other[_nearest(other, skin) > UNLIKE]
    if not len(other):
        return Tones(skin, other)
    above = _means(colors[forehead_region(points, small.shape[:2], top=TOP)])
    covers = _nearest(above, skin) > COVER * _nearest(above, other)
    return Tones(np.concatenate([skin, above[~covers]]), np.concatenate([other, above[covers]]))


def forehead_region(landmarks: NDArray[np.floating], shape: tuple[int, ...],
                    real: NDArray[np.uint8] | None = None, regions: Regions | None = None,
                    top: float | None = None) -> Mask:
    """The bare part of a forehead, between brows and hairline; bool [H, W].

    Parameters
    ----------
    landmarks
        [68, 2] pixels.
    shape
        Height and width of the picture.
    real, regions
        The sitter's own picture, uint8 [H, W, 3], and its regions, for the hairline; without hair
        the forehead ends below where most hairlines are.
    top
        Where it ends at most (brows 0, chin 1).
    """
    frame = FaceFrame.of(landmarks)
    hair = None if regions is None else regions.hair
    if top is None:
        top = BARE_TOP if hair is None else TOP
    right, down = frame.local(shape)
    brows = np.stack([(landmarks[17:27] - frame.origin) @ axis for axis in
                      (frame.right, frame.down)], axis=1) / frame.height
    brows = brows[np.argsort(brows[:, 0])]
    line = np.interp(right, brows[:, 0], brows[:, 1])
    # The temples, where hair begins and the face turns away, are left out.
    half = WIDE[real is not None and hair is None] * 0.5 * float(np.ptp(brows[:, 0]))
    middle = float(brows[:, 0].mean())
    round_top = top * np.sqrt(np.clip(1 - ((right - middle) / (1.25 * half)) ** 2, 0, 1))
    mask = (np.abs(right - middle) < half) & (down < line - ABOVE_BROWS) & (down > round_top)
    if real is not None:
        # The network overlooks hair: what continues the face in its color is skin.
        bare = face_mask(real, np.asarray(landmarks, np.float64)) > 0.5
        bare &= True if hair is None else hair < 0.5
        mask &= ndimage.distance_transform_edt(bare) > FROM_HAIR * frame.height
        # Gaps between locks are none of it.
        mask = ndimage.binary_opening(mask, iterations=max(1, round(FROM_HAIR * frame.height)))
    return np.asarray(mask, bool)


def forehead_found(painted: NDArray[np.uint8], real: NDArray[np.uint8],
                   landmarks: NDArray[np.floating], tones: Tones,
                   regions: Regions | None = None) -> dict[str, float]:
    """What a painted forehead is made of, and its steps of light.

    Parameters
    ----------
    painted, real
        uint8 [H, W, 3], the same view.
    landmarks
        [68, 2] pixels of the real view.
    tones
        Of the exemplar.
    regions
        Of the real view.

    Returns
    -------
    figures
        ``forehead``: share of its pixels that are another material's, NaN where hair or a hat
        leaves no forehead; ``brow_step``, ``side_step``: luma above the brows against below, and
        of its right half against the left one, so much more (absolute) than in the real view.
    """
    mask = forehead_region(landmarks, real.shape[:2], real, regions)
    frame = FaceFrame.of(landmarks)
    if mask.sum() < FEW:
        return dict.fromkeys(("forehead", "brow_step", "side_step"), float("nan"))
    stained = tones.stained(_colors(painted, frame)[mask])
    right, down = frame.local(real.shape[:2])
    across = np.abs(right) < 0.45 * np.ptp(landmarks[17:27] @ frame.right) / frame.height
    below = polygon2mask(real.shape[:2], landmarks[[1, 41, 46, 15, 13, 35, 31, 3]][:, ::-1])
    low = mask & (down > np.quantile(down[mask], 0.6))
    steps = []
    for image in (painted, real):
        luma = image @ np.array([0.299, 0.587, 0.114]) / 255
        brow = float(np.median(luma[low]) - np.median(luma[below & across]))
        halves = [np.median(luma[mask & side]) if (mask & side).any() else np.nan
                  for side in (right > 0.02, right < -0.02)]
        steps.append((brow, float(halves[0] - halves[1])))
    (brow, side), (own_brow, own_side) = steps
    return {"forehead": float(stained.mean()), "brow_step": abs(brow - own_brow),
            "side_step": abs(side - own_side)}
