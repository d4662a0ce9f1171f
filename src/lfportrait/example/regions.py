"""Soft regions of a portrait, and the control points that they add to the landmarks.

The 68 landmarks end at the brows: without more, moving least squares extrapolates hair, ears and
neck from the face, and the exemplar's hairline lands wherever it may. So the person and its hair
are segmented in both pictures, and rays from the middle of the face meet the hairline and the
outline of the head at points that correspond. The soft labels of all regions are compared during
the synthesis, so that skin is not painted with hair.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.ndimage import map_coordinates

from .guides import gaussian_blur, mls_similarity
from .segment import overlap, separate

__all__ = ["LABELS", "FaceFrame", "Regions", "find_regions", "match_regions",
           "substitute"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

LABELS = ("brows", "eyes", "nose", "lips", "skin", "hair", "body", "background")
"""Channels of the soft region labels; ears belong to the skin, neck and clothes to the body."""

RAYS = np.radians(np.arange(-75, 76, 15.0))
"""Directions of the rays to hairline and outline: from straight up, clockwise."""


@dataclass(frozen=True)
class FaceFrame:
    """The upright frame of a face: origin between the eyes' height and the brows, unit = chin.

    Attributes
    ----------
    origin
        [2], middle of the brows.
    right, down
        [2] each, the face's axes in the picture, orthonormal.
    height
        Distance from the brows to the chin in pixels.
    width
        Distance of the jaw's ends in pixels.
    """

    origin: Float64
    right: Float64
    down: Float64
    height: float
    width: float

    @staticmethod
    def of(landmarks: NDArray[np.floating]) -> FaceFrame:
        """Frame of 68 landmarks; roll is taken out by the line of eyes and chin."""
        points = np.asarray(landmarks, np.float64)
        brows = np.nanmean(points[17:27], axis=0)
        eyes = np.nanmean(points[42:48], axis=0) - np.nanmean(points[36:42], axis=0)
        chin = points[8] - brows
        # The chin alone would lean with the yaw, the eyes alone vanish in profile.
        down = chin / np.linalg.norm(chin) + np.array([-eyes[1], eyes[0]]) / max(
            float(np.linalg.norm(chin)), 1e-9)
        down /= np.linalg.norm(down)
        right = np.array([down[1], -down[0]])
        extent = points[[0, 16]] @ right
        return FaceFrame(brows, right, down, float(chin @ down), float(abs(extent[1] - extent[0])))

    def local(self, shape: tuple[int, ...]) -> tuple[Float32, Float32]:
        """Coordinates of all pixels of a picture in units of ``height``: (right, down)."""
        y, x = np.mgrid[:shape[0], :shape[1]].astype(np.float32)
        x, y = x + 0.5 - np.float32(self.origin[0]), y + 0.5 - np.float32(self.origin[1])
        unit = np.float32(1 / self.height)
        return ((x * np.float32(self.right[0]) + y * np.float32(self.right[1])) * unit,
                (x * np.float32(self.down[0]) + y * np.float32(self.down[1])) * unit)

    def point(self, right: NDArray[np.floating], down: NDArray[np.floating]) -> Float64:
        """Picture coordinates [N, 2] of local ones."""
        return np.asarray(self.origin + self.height * (
            np.multiply.outer(right, self.right) + np.multiply.outer(down, self.down)), np.float64)


@dataclass
class Regions:
    """Soft regions of one picture.

    Attributes
    ----------
    landmarks
        float64 [68, 2].
    person
        float32 [H, W], head, hair, neck and clothes against the background.
    hair
        float32 [H, W], or None where no hair could be told from skin.
    """

    landmarks: Float64
    person: Float32
    hair: Float32 | None
    frame: FaceFrame = field(init=False)

    def __post_init__(self) -> None:
        self.frame = FaceFrame.of(self.landmarks)

    def outline(self, rays: Float64 = RAYS) -> Float64:
        """Where ``rays`` leave the person, [R, 2] pixels; NaN where they leave the picture."""
        return self._rays(self.person, rays, last=True)

    def lowest(self) -> float:
        """Depth of the picture's lower border below the brows, at least 1.02 (1 is the chin)."""
        frame = self.frame
        return max(1.02, float((self.person.shape[0] - 3 - frame.origin[1]) / frame.height))

    def edges(self, depth: float) -> tuple[Float64, Float64]:
        """Left and right edge of neck or body, [2] pixels each, ``depth`` below the brows.

        Where the person's mask shows none they are two thirds as far apart as the ears.
        """
        frame = self.frame
        across = np.linspace(-2.0, 2.0, 321)
        points = frame.point(across, np.full(across.size, depth))
        line = map_coordinates(self.person, [points[:, 1] - 0.5, points[:, 0] - 0.5], order=1,
                               mode="constant", cval=0.0) > 0.5
        half = 0.33 * frame.width / frame.height
        distances = []
        for side in (-1, 1):
            outside = np.flatnonzero(~line & (across * side > 0))
            nearest = float(np.min(np.abs(across[outside])))
            distances.append(side * (nearest if nearest > 0.4 * half else half))
        ends = frame.point(np.array(distances), np.array([depth, depth]))
        return ends[0], ends[1]

    def hairline(self, rays: Float64 = RAYS) -> Float64:
        """Where ``rays`` enter the hair, [R, 2] pixels; NaN where there is none."""
        if self.hair is None:
            return np.full((len(rays), 2), np.nan)
        return self._rays(np.asarray(1 - self.hair, np.float32), rays, last=False)

    def _rays(self, mask: Float32, rays: Float64, last: bool) -> Float64:
        """First (or last) place on each ray where ``mask`` falls below one half."""
        frame = self.frame
        radius = np.linspace(0.15, 2.2, 165)
        right = np.sin(rays)[:, None] * radius
        down = -np.cos(rays)[:, None] * radius
        points = frame.point(right, down)
        values = map_coordinates(mask, [points[..., 1] - 0.5, points[..., 0] - 0.5], order=1,
                                 mode="constant", cval=-1.0)
        out = np.full((len(rays), 2), np.nan)
        for n, line in enumerate(values):
            seen = line >= 0
            end = len(line) if seen.all() else int(np.argmin(seen))
            inside = line[:end] > 0.5
            if last:
                k = int(np.flatnonzero(inside)[-1]) if inside.any() else -1
                # A person cut off by the picture's border has no outline there.
                if k < 0 or k >= end - 2:
                    continue
            else:
                falls = np.flatnonzero(~inside)
                if len(falls) == 0 or falls[0] == 0:
                    continue
                k = int(falls[0]) - 1
            if k + 1 < end:
                step = (line[k] - 0.5) / max(line[k] - line[k + 1], 1e-6)
                out[n] = points[n, k] + np.clip(step, 0, 1) * (points[n, k + 1] - points[n, k])
        return out

    def box(self) -> tuple[float, float, float, float]:
        """Box of the head (left, top, right, bottom) in pixels, from landmarks and person."""
        corners = self.frame.point(np.array([-0.75, 0.75, -0.75, 0.75]),
                                   np.array([-1.0, -1.0, 1.12, 1.12]))
        outline = self.outline()
        points = np.concatenate([corners, outline[np.isfinite(outline).all(axis=1)]])
        low, high = points.min(axis=0), points.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def labels(self) -> NDArray[np.uint8]:
        """Soft labels, uint8 [H, W, len(LABELS)], diffused between neighbouring regions."""
        shape = self.person.shape
        points, frame = self.landmarks, self.frame
        blur = 0.03 * frame.height
        features = [
            np.maximum(_polygon(shape, _thicken(points[17:22], frame)),
                       _polygon(shape, _thicken(points[22:27], frame))),
            np.maximum(_polygon(shape, points[36:42]), _polygon(shape, points[42:48])),
            _polygon(shape, np.concatenate([points[27:28], points[31:36]])),
            _polygon(shape, points[48:60])]
        rest = np.ones(shape, np.float32)
        planes = []
        for feature in features:
            soft = gaussian_blur(feature, blur)
            planes.append(soft * rest)
            rest = rest * (1 - soft)
        hair = self.hair if self.hair is not None else np.zeros(shape, np.float32)
        body = gaussian_blur(_below_jaw(shape, points, frame), 1.5 * blur)
        skin = self.person * (1 - hair)
        planes += [skin * (1 - body) * rest, self.person * hair * rest, skin * body * rest,
                   (1 - self.person) * rest]
        return np.stack([np.asarray(plane * 255 + 0.5, np.uint8) for plane in planes], axis=-1)


def _polygon(shape: tuple[int, ...], points: NDArray[np.floating]) -> Float32:
    """Filled polygon, float32 [H, W]."""
    picture = Image.new("L", (shape[1], shape[0]))
    if np.isfinite(points).all():
        ImageDraw.Draw(picture).polygon([(float(x), float(y)) for x, y in points - 0.5], fill=1)
    return np.asarray(picture, np.float32)


def _thicken(brow: Float64, frame: FaceFrame) -> Float64:
    """A brow's line of landmarks as a strip."""
    half = 0.035 * frame.height * frame.down
    return np.concatenate([brow - half, (brow + 1.6 * half)[::-1]])


def _below_jaw(shape: tuple[int, ...], points: Float64, frame: FaceFrame) -> Float32:
    """Everything below the jaw line: neck, shoulders and whatever is beside them."""
    jaw = points[3:14]
    far = 6.0 * max(shape)
    left, right = jaw[0], jaw[-1]
    border = [left - far * frame.right, left, *jaw[1:-1], right, right + far * frame.right,
              right + far * frame.right + far * frame.down,
              left - far * frame.right + far * frame.down]
    return _polygon(shape, np.array(border))


def _person_prior(frame: FaceFrame, shape: tuple[int, ...], points: Float64) -> Float32:
    """Probability of the person from the landmarks alone: a head on a neck on shoulders."""
    right, down = frame.local(shape)
    half = max(0.5 * frame.width / frame.height, 0.42)
    head = np.hypot(right / (half * 1.25), (down + 0.05) / np.where(down < -0.05, 0.88, 1.1))
    neck = np.abs(right) / (half * 0.85 + np.clip(down - 1.15, 0, None) * 2.2)
    away = np.where(down > 0.8, np.minimum(head, np.where(down > 1.0, neck, 2.0)), head)
    prior = 1 / (1 + np.exp((away - 1.0) / 0.12))
    prior = np.where(away > 1.5, 0.0, prior)
    face = np.maximum(_polygon(shape, points[:27][[*range(17), 26, 25, 24, 19, 18, 17]]),
                      (np.hypot(right / (half * 0.7), (down + 0.1) / 0.45) < 1))
    return np.asarray(np.where(face > 0, 1.0, prior), np.float32)


def _hair_prior(frame: FaceFrame, person: Float32, points: Float64) -> Float32:
    """Probability of hair: near the head's outline above the ears, not on the face."""
    shape = person.shape
    right, down = frame.local(shape)
    half = max(0.5 * frame.width / frame.height, 0.42)
    # How far out a pixel lies: 0 at the brows, 1 at the outline that the person's mask shows.
    inner = np.hypot(right / (half * 1.02), np.where(down < 0, down / 0.8, down / 1.5))
    prior = 1 / (1 + np.exp(-(inner - 0.9) / 0.10))
    prior = prior * np.clip((0.6 - down) / 0.4, 0.05, 1.0)
    face = _polygon(shape, points[[*range(17), 26, 25, 24, 19, 18, 17]])
    forehead = np.hypot(right / (half * 0.75), down / 0.38) < 1
    prior = np.where((face > 0) | forehead | (down > 1.0), 0.0, prior)
    return np.asarray(np.clip(prior, 0, 0.97) * person, np.float32)


def _networks(image: NDArray[np.uint8]) -> tuple[Float32 | None, Float32 | None]:
    """Person and hair from the segmentation networks, None where their weights are missing."""
    person = hair = None
    try:
        from .. import face, models

        if models.available("person-segmentation"):
            person = np.asarray(face.person_matte(image), np.float32)
        if models.available("hair-segmentation"):
            hair = np.asarray(face.hair_mask(image), np.float32)
    except (ImportError, AttributeError):
        return person, hair
    return person, hair


def find_regions(image: NDArray[np.generic], landmarks: NDArray[np.floating],
                 mask: Float32 | None = None, networks: bool = True) -> Regions:
    """Segment a portrait.

    Parameters
    ----------
    image
        uint8 or float in [0, 1], [H, W, 3].
    landmarks
        [68, 2].
    mask
        float32 [H, W], the person where it is known.
    networks
        Use the segmentation networks where their weights are at hand and the result is plausible.
    """
    points = np.asarray(landmarks, np.float64)
    frame = FaceFrame.of(points)
    colours = np.asarray(image[..., :3], np.float32) / np.float32(
        255 if image.dtype == np.uint8 else 1)
    person_net = hair_net = None
    if networks:
        picture = np.asarray(colours * 255 + 0.5, np.uint8)
        person_net, hair_net = _networks(picture)
    prior = _person_prior(frame, colours.shape, points)
    if mask is not None:
        person = np.asarray(mask, np.float32)
    elif person_net is not None and _plausible(person_net, prior, frame):
        person = person_net
    else:
        person = separate(colours, prior)
    hair_guess = _hair_prior(frame, person, points)
    if hair_net is not None and _plausible_hair(hair_net, person, frame):
        hair = np.minimum(hair_net, person)
        if hair_net[prior >= 1.0].mean() > 0.1:
            # In drawings the network takes hatching on the face for hair.
            hair = hair * np.clip(hair_guess * 10, 0, 1)
        return Regions(points, person, np.asarray(hair, np.float32))
    hair = separate(colours, hair_guess, smoothness=4.0, blur=1.2)
    crown = np.asarray(hair * person, np.float32)
    skin = np.asarray((prior >= 1.0) & (hair < 0.5), np.float32)
    if crown.sum() < 0.05 * frame.height ** 2 or overlap(colours, crown, skin) > 0.85:
        return Regions(points, person, None)
    return Regions(points, person, crown)


def substitute(labels: NDArray[np.uint8], style: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Give regions that the exemplar has not to those that stand in for them.

    Hair of an exemplar whose hair can't be told from its skin (a statue) is skin, a body that it
    does not show is background. Both arguments are uint8 [..., len(LABELS)].
    """
    out = labels.copy()
    for name, stand_in in (("hair", "skin"), ("body", "background")):
        missing, other = LABELS.index(name), LABELS.index(stand_in)
        if style[..., missing].mean() < 0.5:
            total = out[..., other].astype(np.int32) + out[..., missing]
            out[..., other] = np.minimum(total, 255).astype(np.uint8)
            out[..., missing] = 0
    return out


def _plausible(person: Float32, prior: Float32, frame: FaceFrame) -> bool:
    """Whether a network's person covers the face and leaves the background beside the head."""
    _, down = frame.local(person.shape)
    inside, outside = person[prior >= 1.0], person[(prior <= 0.0) & (down < 0.6)]
    return bool(inside.size == 0 or inside.mean() > 0.9) and bool(
        outside.size == 0 or outside.mean() < 0.4)


def _plausible_hair(hair: Float32, person: Float32, frame: FaceFrame) -> bool:
    """Whether a network's hair covers a good part of the head above the brows, and not the face."""
    right, down = frame.local(hair.shape)
    crown = (np.abs(right) < 0.5) & (down < -0.55) & (person > 0.5)
    face = (np.abs(right) < 0.3) & (down > 0.1) & (down < 0.8)
    return bool(crown.any() and hair[crown].mean() > 0.35 and hair[face].mean() < 0.4)


def match_regions(landmarks: Float64, regions: Regions, style_landmarks: Float64,
                  style_regions: Regions,
                  contours: bool = True) -> tuple[Float64, Float64, Float64, Float64]:
    """Control points of the position guide: landmarks, hairline and outline.

    Returns
    -------
    sources, targets
        [M, 2] in the target and in the exemplar; only points known on both sides count.
    weights, softness
        [M], see `guides.mls_similarity`.
    """
    sources, targets = [landmarks], [style_landmarks]
    weights = [np.ones(68)]
    if contours:
        for name, weight in (("outline", 2.0), ("hairline", 1.0)):
            sources.append(getattr(regions, name)())
            targets.append(getattr(style_regions, name)())
            weights.append(np.full(len(RAYS), weight))
        foot, style_foot = _foot(landmarks, regions, style_landmarks, style_regions)
        sources.append(foot)
        targets.append(style_foot)
        weights.append(np.full(len(foot), 2.0))
    source = np.concatenate(sources)
    softness = np.full(len(source), 0.05 * regions.frame.height)
    softness[:68] = 0.0
    return source, np.concatenate(targets), np.concatenate(weights), softness


def _foot(landmarks: Float64, regions: Regions, style_landmarks: Float64,
          style_regions: Regions) -> tuple[Float64, Float64]:
    """Points on the target's lower border, pinned to the exemplar's where it shows less body.

    Without them a photo that shows more of the chest than the exemplar does would run off its lower
    border. Where the exemplar shows enough there are none.
    """
    height, width = regions.person.shape
    style_height = style_regions.person.shape[0]
    foot = np.array([[0.0, height], [width / 2, height], [float(width), height]])
    style_foot = mls_similarity(foot, landmarks[:27], style_landmarks[:27])
    beyond = style_foot[:, 1] > style_height - 1
    style_foot[:, 1] = style_height - 1
    return foot[beyond], style_foot[beyond]
