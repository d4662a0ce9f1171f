"""Regions of a portrait: the person, its hair, and soft labels of all parts.

The 68 landmarks end at the brows. So the person and its hair are segmented in both pictures, and
rays from the middle of the face meet the hairline and the outline of the head at points that
correspond (`photo_guide`). The soft labels of all regions are compared during the synthesis, so
that skin is not painted with hair.

Photos need more care (`photo_regions`): the network of the hair takes the shaded half of a shaven
head for hair, that of the person takes things in the room for a part of the person. Where no hair
is found, colors decide: hair is rougher than skin, or of another color; a scalp is neither.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import cv2
import numpy as np
from PIL import Image, ImageDraw
from scipy.ndimage import distance_transform_edt, map_coordinates

from ...arrays import Array, Float32, Float64, Floats, UInt8
from ...color import to_uint8
from ...labels import PICTURE_LABELS
from ..kernels.labels import soft_labels
from .color_segmentation import overlap, separate
from .filters import broad_blur, disk, gaussian_blur, grey, shrunk, smaller


@dataclass(frozen=True)
class FaceFrame:
    """The upright frame of a face: origin between the eyes' height and the brows, unit = chin."""

    origin: Float64  # [2], middle of the brows.
    # right, down: [2] each, the face's axes in the picture, orthonormal.
    right: Float64
    down: Float64
    height: float  # Distance from the brows to the chin in pixels.
    width: float  # Distance of the jaw's ends in pixels.

    @staticmethod
    def of(landmarks: Floats) -> FaceFrame:
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
        """Coordinates (right, down) of a picture's pixels in units of ``height``, [H, W] each."""
        y, x = (np.arange(n, dtype=np.float32) + np.float32(0.5) - np.float32(at)
                for n, at in zip(shape[:2], self.origin[::-1]))
        # Row and column by themselves: no products of whole pictures.
        along, below = (np.asarray(way / self.height, np.float32)
                        for way in (self.right, self.down))
        return x * along[0] + (y * along[1])[:, None], x * below[0] + (y * below[1])[:, None]

    def point(self, right: Floats, down: Floats) -> Float64:
        """Picture coordinates [N, 2] of local ones."""
        return np.asarray(self.origin + self.height * (
            np.multiply.outer(right, self.right) + np.multiply.outer(down, self.down)), np.float64)

    def turn(self, landmarks: Floats) -> float:
        """How far the nose lies to the right of the middle of the jaw's ends, over half the width.

        0 seen from the front, about 1.25 for a head turned by 50 degrees.
        """
        across = np.asarray(landmarks, np.float64) @ self.right
        return float((across[30] - 0.5 * (across[0] + across[16])) / max(0.5 * self.width, 1e-9))


OUTLINE_BLUR = 0.02
"""Sigma of the blur of the person's outline, over the distance of brows and chin."""


def region_labels(person: Float32, hair: Float32 | None, landmarks: Float64, frame: FaceFrame,
                  like: frozenset[str] = frozenset()) -> UInt8:
    """Soft labels, uint8 [H, W, len(PICTURE_LABELS)], 255 = wholly inside; about 255 in sum.

    ``person`` and ``hair`` are float32 [H, W]. ``like`` are labels (``hair``, ``body``) to give to
    those that stand in for them, where the exemplar has none (`missing_labels`): hair to the skin,
    the body to the background.
    """
    blur = 0.03 * frame.height
    factor = 2 * min(4, max(1, int(blur / 4))) if blur >= 2 else 1
    planes = _feature_planes(person.shape, landmarks, factor, blur / factor)
    if hair is None:
        hair = np.zeros(person.shape, np.float32)
    out = np.empty((*person.shape, 2), np.int32)
    # Paint of the outline lies outside the mask too: labels that fall off gently hold it there.
    soft = broad_blur(np.ascontiguousarray(person, np.float32), OUTLINE_BLUR * frame.height)
    # A mask that Pillow resized is read-only: the kernel would be compiled once more for it.
    soft_labels(soft, np.require(hair, np.float32, ("C", "W")), planes, factor, "hair" in like,
                "body" in like, out)
    return out.view(np.uint8)


def soft_face(shape: tuple[int, ...], landmarks: Float64, above: float = 0.1) -> UInt8:
    """The face between jaw and brows with soft edges, uint8 [H, W].

    It ends ``above`` of its height above the brows.
    """
    frame = FaceFrame.of(landmarks)
    brows = landmarks[17:27][::-1] - above * frame.height * frame.down
    drawn = polygon(shape, np.concatenate([landmarks[:17], brows]))
    return np.asarray(broad_blur(drawn, 0.05 * frame.height) * 255 + np.float32(0.5), np.uint8)


def missing_labels(style: UInt8) -> frozenset[str]:
    """Labels among hair and body that an exemplar [h, w, len(PICTURE_LABELS)] does not show.

    Hair of an exemplar whose hair can't be separated from its skin (a statue) is skin, a body that
    it does not show is background.
    """
    return frozenset(name for name in ("hair", "body")
                     if style[..., PICTURE_LABELS.index(name)].mean() < 0.5)


def without_hair(labels: UInt8) -> UInt8:
    """Labels [h, w, len(PICTURE_LABELS)] whose hair is skin, for a target that shows no hair."""
    out = labels.copy()
    hair, skin = PICTURE_LABELS.index("hair"), PICTURE_LABELS.index("skin")
    out[..., skin] = np.minimum(out[..., skin].astype(np.int64) + out[..., hair], 255)
    out[..., hair] = 0
    return out


def _feature_planes(shape: tuple[int, ...], landmarks: Float64, factor: int,
                    blur: float) -> Float32:
    """Brows, eyes, nose, lips, and what is below the jaw, blurred block means [5, h, w]."""
    # Drawn at twice the resolution of the blocks: their edges are a quarter grey at the least.
    fine = max(1, factor // 2)
    ratio = factor // fine
    rows, columns = -(-shape[0] // factor) * ratio, -(-shape[1] // factor) * ratio
    points = landmarks / fine
    frame = FaceFrame.of(points)
    size = (rows, columns)
    drawn = [
        np.maximum(polygon(size, _thicken(points[17:22], frame)),
                   polygon(size, _thicken(points[22:27], frame))),
        np.maximum(polygon(size, points[36:42]), polygon(size, points[42:48])),
        polygon(size, np.concatenate([points[27:28], points[31:36]])),
        polygon(size, points[48:60]),
        _below_jaw(size, points, frame)]
    return np.stack([gaussian_blur(shrunk(plane, ratio), blur * (1.5 if n == 4 else 1.0))
                     for n, plane in enumerate(drawn)])


def polygon(shape: tuple[int, ...], points: Floats) -> Float32:
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
    return polygon(shape, np.array(border))


RAYS = np.radians(np.arange(-75, 76, 15.0))
"""Directions of the rays to hairline and outline: from straight up, clockwise."""

BACK = 0.8, 1.4
"""Turns of a head (`FaceFrame.turn`) between which more and more of its back is seen."""
EAR = 0.9, 0.3, 0.3, 0.4
"""The ear of a head in profile, which hair may cover: how far behind and below the middle of the
brows, and half the width and height of its surroundings, in units of the frame's height."""
DEPTH = 0.8
"""How much further a turned head reaches behind its face, in units of the frame's height."""


@dataclass
class Regions:
    """Soft regions of one picture.

    Attributes
    ----------
    landmarks : float64 [68, 2].
    person : float32 [H, W], head, hair, neck and clothes against the background.
    hair : float32 [H, W], or None where hair and skin could not be separated.
    known_nearest : `nearest`, where it is known already.
    """

    landmarks: Float64
    person: Float32
    hair: Float32 | None
    known_nearest: Float32 | None = None
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
        """Left and right edge of neck or body, [2] pixels each, ``depth`` below the brows."""
        left, right = self.frame.point(self.spans(np.array([depth]))[0], np.full(2, depth))
        return left, right

    def spans(self, depths: Float64) -> Float64:
        """Left and right edge of neck or body at ``depths`` [D] below the brows, float64 [D, 2].

        They count from the brows' middle to the right, in units of the frame's height. It is the
        longest piece of the line across: the neck of a turned head lies beside the face. Where the
        person's mask shows none they are two thirds as far apart as the ears.
        """
        frame = self.frame
        across = np.linspace(-2.0, 2.0, 321)
        points = frame.point(*np.broadcast_arrays(across, depths[:, None]))
        lines = map_coordinates(self.person, [points[..., 1] - 0.5, points[..., 0] - 0.5], order=1,
                                mode="constant", cval=0.0)
        half = 0.33 * frame.width / frame.height
        out = np.tile([-half, half], (len(depths), 1))
        for span, line in zip(out, lines):
            # Samples after which the line enters and leaves the person, in turn.
            ends = np.flatnonzero(np.diff(line > 0.5, prepend=False, append=False)) - 1
            if len(ends) == 0:
                continue
            before, after = line[np.maximum(ends, 0)], line[np.minimum(ends + 1, line.size - 1)]
            share = np.where(before == after, 0.5, (0.5 - before) / np.where(
                before == after, 1.0, after - before))
            places = np.clip(across[0] + (ends + share) * (across[1] - across[0]), -2.0, 2.0)
            starts, stops = places[::2], places[1::2]
            longest = int(np.argmax(stops - starts))
            if stops[longest] - starts[longest] > 0.8 * half:
                span[:] = starts[longest], stops[longest]
        return out

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

    @functools.cached_property
    def nearest(self) -> Float32:
        """For every pixel the nearest one well inside the person, [H, W, 2] (x, y).

        Below the chin of a picture that shows no body, a pixel stays where it is.
        """
        if self.known_nearest is not None:
            return self.known_nearest
        frame, person = self.frame, self.person
        margin = 0.03 * frame.height
        depth_inside = distance_transform_edt(np.pad(person > 0.5, 1, mode="edge"))[1:-1, 1:-1]
        inside = depth_inside > margin
        own = np.moveaxis(np.indices(person.shape), 0, -1)
        nearest = own.copy()
        if inside.any():
            _, index = distance_transform_edt(~inside, return_indices=True)
            nearest = np.moveaxis(index, 0, -1)
        _, down = frame.local(person.shape)
        last_row = down > self.lowest() - 0.1
        if not (inside & last_row).any():
            nearest = np.where((down > 1.0)[..., None], own, nearest)
        return np.asarray(nearest[..., ::-1] + 0.5, np.float32)

    def labels(self, like: frozenset[str] = frozenset()) -> UInt8:
        """Soft labels, uint8 [H, W, len(PICTURE_LABELS)]; see `region_labels`."""
        return region_labels(self.person, self.hair, self.landmarks, self.frame, like)


def _person_prior(frame: FaceFrame, shape: tuple[int, ...], points: Float64) -> Float32:
    """Probability of the person from the landmarks alone: a head on a neck on shoulders."""
    right, down = frame.local(shape)
    half = max(0.5 * frame.width / frame.height, 0.42)
    turn = frame.turn(points)
    across = right
    right = _without_back(right, turn, half)
    head = np.hypot(right / (half * 1.25), (down + 0.05) / np.where(down < -0.05, 0.88, 1.1))
    neck = np.abs(right) / (half * 0.85 + np.clip(down - 1.15, 0, None) * 2.2)
    away = np.where(down > 0.8, np.minimum(head, np.where(down > 1.0, neck, 2.0)), head)
    prior = 1 / (1 + np.exp((away - 1.0) / 0.12))
    prior = np.where(away > 1.5, 0.0, prior)
    forehead = np.hypot(across / (half * 0.7), (down + 0.1) / 0.45) < 1
    if abs(turn) > BACK[1]:
        # Before the brows of a profile there is nothing any more.
        forehead &= np.sign(turn) * across < 0
    face = np.maximum(polygon(shape, points[:27][[*range(17), 26, 25, 24, 19, 18, 17]]), forehead)
    return np.asarray(np.where(face > 0, 1.0, prior), np.float32)


def _without_back(right: Float32, turn: float, half: float) -> Float32:
    """Places across a head [H, W] without what is seen of its back where it is turned.

    As far behind the face as a turned head's ear they count as its middle; ``half`` is half the
    face's width.
    """
    first, last = BACK
    back = np.float32(DEPTH * np.clip((abs(turn) - first) / (last - first), 0, 1))
    behind = -np.sign(turn) * right
    return np.asarray(np.where(behind > 0, -np.sign(turn) * np.maximum(
        behind - back, np.minimum(behind, 0.5 * half)), right), np.float32)


def _hair_prior(frame: FaceFrame, person: Float32, points: Float64) -> Float32:
    """Probability of hair: near the head's outline above the ears, not on the face."""
    shape = person.shape
    right, down = frame.local(shape)
    half = max(0.5 * frame.width / frame.height, 0.42)
    # How far out a pixel lies: 0 at the brows, 1 at the outline that the person's mask shows.
    inner = np.hypot(right / (half * 1.02), np.where(down < 0, down / 0.8, down / 1.5))
    prior = 1 / (1 + np.exp(-(inner - 0.9) / 0.10))
    prior = prior * np.clip((0.6 - down) / 0.4, 0.05, 1.0)
    face = polygon(shape, points[[*range(17), 26, 25, 24, 19, 18, 17]])
    forehead = np.hypot(right / (half * 0.75), down / 0.38) < 1
    prior = np.where((face > 0) | forehead | (down > 1.0), 0.0, prior)
    turn = frame.turn(points)
    if abs(turn) > BACK[0]:
        behind, below, width, height = EAR
        ear = np.hypot((-np.sign(turn) * right - behind) / width, (down - below) / height) < 1
        prior = np.where(ear, np.minimum(prior, 0.5), prior)
    return np.asarray(np.clip(prior, 0, 0.97) * person, np.float32)


def _networks(image: UInt8, size: int) -> tuple[Float32 | None, Float32 | None]:
    """Person and hair from the segmentation networks, None where their weights are missing."""
    from ... import face, models

    known = [not models.missing([f"{part}-segmentation"]) for part in ("person", "hair")]
    try:
        if all(known):
            return face.mattes(image, size=size)
        return (face.person_matte(image) if known[0] else None,
                face.hair_mask(image, size=size) if known[1] else None)
    except ImportError:  # mediapipe needs system libraries that some machines lack
        return None, None


def find_regions(image: Array, landmarks: Floats,
                 mask: Float32 | None = None, networks: bool = True,
                 size: int = 512, by_color: bool = True, denied: float = 0.0) -> Regions:
    """Segment a portrait, uint8 or float in [0, 1], [H, W, 3], with landmarks [68, 2].

    Parameters
    ----------
    mask : float32 [H, W], the person where it is known.
    networks : Use the segmentation networks where their weights are at hand and the result is
        plausible.
    size : Side of the picture that the network of the hair sees, a multiple of 32: paintings want
        512, for photos 384 is as good (in one pixel of 250 hair becomes skin or skin hair) and
        takes two thirds of the time, in videos 256 will do.
    by_color : Segment hair by color where the network's result is not plausible; slow.
    denied : What only colors take for hair is none if the network finds less than this there: the
        shaded half of a shaven head. 0 for paintings, of which the network knows little.
    """
    points = np.asarray(landmarks, np.float64)
    frame = FaceFrame.of(points)
    picture = np.asarray(image[..., :3])
    person_net = hair_net = None
    if networks:
        person_net, hair_net = _networks(to_uint8(picture), size)
    check = _Plausibility(points, picture.shape)
    if mask is not None:
        person = np.asarray(mask, np.float32)
    elif person_net is not None and check.person(person_net):
        person = person_net
    else:
        person = separate(_unit_colors(picture), _person_prior(frame, picture.shape, points))
    if hair_net is not None and check.hair(hair_net, person):
        hair = np.minimum(hair_net, person)
        # A photo has no hatching, but locks beside the face.
        if check.drawn(hair_net, inner=denied > 0):
            # In drawings the network takes hatching on the face for hair.
            hair = hair * np.clip(_hair_prior(frame, person, points) * 10, 0, 1)
        return Regions(points, person, np.asarray(hair, np.float32))
    if hair_net is not None and not by_color:
        return Regions(points, person, None)
    by_colors = _hair_by_color(picture, person, frame, points)
    if by_colors is not None and hair_net is not None and (
            (by_colors * hair_net).sum() < denied * by_colors.sum()):
        by_colors = None
    return Regions(points, person, by_colors)


def _unit_colors(image: Array) -> Float32:
    """Colors in [0, 1]."""
    return np.asarray(image, np.float32) / np.float32(255 if image.dtype == np.uint8 else 1)


def _hair_by_color(image: Array, person: Float32, frame: FaceFrame,
                    points: Float64) -> Float32 | None:
    """Hair by prior and colors, or None where it has the colors of the skin (a statue)."""
    colors = _unit_colors(image)
    hair = separate(colors, _hair_prior(frame, person, points), smoothness=4.0, blur=1.2)
    crown = np.asarray(hair * person, np.float32)
    face = _person_prior(frame, person.shape, points) >= 1.0
    skin = np.asarray(face & (hair < 0.5), np.float32)
    if crown.sum() < 0.05 * frame.height ** 2 or overlap(colors, crown, skin) > 0.85:
        return None
    return crown


class _Plausibility:
    """Tests whether networks' masks suit the landmarks, on every n-th pixel."""

    def __init__(self, points: Float64, shape: tuple[int, ...]) -> None:
        step = max(1, int(FaceFrame.of(points).height / 50))
        self.every = slice(step // 2, None, step), slice(step // 2, None, step)
        rows, columns = (len(range(step // 2, n, step)) for n in shape[:2])
        small = (points - step // 2) / step
        frame = FaceFrame.of(small)
        self.prior = _person_prior(frame, (rows, columns), small)
        self.right, self.down = frame.local((rows, columns))

    def person(self, person: Float32) -> bool:
        """Whether the person covers the face and leaves the background beside the head."""
        mask = person[self.every]
        inside, outside = mask[self.prior >= 1.0], mask[(self.prior <= 0.0) & (self.down < 0.6)]
        return bool(inside.size == 0 or inside.mean() > 0.9) and bool(
            outside.size == 0 or outside.mean() < 0.4)

    def hair(self, hair: Float32, person: Float32) -> bool:
        """Whether hair covers a good part of the head above the brows, and not the face."""
        mask = hair[self.every]
        crown = (np.abs(self.right) < 0.5) & (self.down < -0.55) & (person[self.every] > 0.5)
        face = (np.abs(self.right) < 0.3) & (self.down > 0.1) & (self.down < 0.8)
        return bool(crown.any() and mask[crown].mean() > 0.35 and mask[face].mean() < 0.4)

    def drawn(self, hair: Float32, inner: bool) -> bool:
        """Whether there is hair on the face, or in its middle alone."""
        face = self.prior >= 1.0
        if inner:
            face &= (np.abs(self.right) < 0.3) & (self.down > -0.1)
        return bool(face.any() and hair[self.every][face].mean() > 0.1)


SIZE, LARGE = 384, 512
"""Side of the picture that the network of the hair sees, and where the face is small in it."""
SMALL = 80.0
"""Pixels from the brows to the chin, in the picture that the network sees, of a small face."""
DENIED = 0.1  # Where the network finds less hair than this, there is none, whatever colors say.
NARROW = 0.11
"""What hangs on the person by no more than twice this, over that height, is no part of it."""
FACE = 100.0  # Pixels from the brows to the chin in the picture that is looked at.
FINE = 0.02  # What is finer than this over that height is texture.
SMOOTH = 1.0  # Hair of skin's colors is rougher than this times skin.
LIKE = 0.6  # Overlap of its colors with the skin's: smooth hair shares less.
SURE = 0.2  # Share of what may be hair that is hair rather than not; a head of hair has more of it.
SHADE = 0.5  # A scalp in the shade is not darker than this over the face's skin.
LEAST = 30  # Pixels that suffice for a decision.


def photo_regions(photo: Array, landmarks: Floats, mask: Float32 | None = None) -> Regions:
    """Segment a photo: `find_regions`, without hair where that is a bare scalp.

    What the person's network finds beside the person is left out, too.
    """
    height = FaceFrame.of(np.asarray(landmarks, np.float64)).height
    size = SIZE if height * SIZE >= SMALL * max(photo.shape[:2]) else LARGE
    found = find_regions(photo, landmarks, mask, size=size, denied=DENIED)
    hair = found.hair
    if hair is not None and is_scalp(photo, found):
        hair = None
    if mask is not None:
        return Regions(found.landmarks, found.person, hair)
    person = _one_person(found)
    return Regions(found.landmarks, person, None if hair is None else np.minimum(hair, person))


def _one_person(regions: Regions) -> Float32:
    """The person [H, W] without what is apart from it, or hangs on it by a narrow bridge."""
    person = regions.person
    step = max(1, int(NARROW * regions.frame.height / 4))
    there = np.asarray(person[::step, ::step] > 0.5, np.uint8)
    kernel = disk(NARROW * regions.frame.height / step)
    count, parts = cv2.connectedComponents(cv2.erode(there, kernel))
    if count <= 2:
        return person
    inside = [parts[y, x] for x, y in (regions.landmarks[27:36] / step).astype(int)
              if 0 <= y < parts.shape[0] and 0 <= x < parts.shape[1]]
    own = np.bincount([part for part in inside if part], minlength=count)
    if not own.any():
        return person
    # Of what is narrow itself, a strand or a finger, the wide part next to it decides.
    ours, others = (distance_transform_edt(~part) for part in (
        parts == own.argmax(), (parts > 0) & (parts != own.argmax())))
    kept = np.asarray(ours <= others, np.float32)
    if kept[there > 0].all():
        return person
    return person * cv2.resize(kept, person.shape[::-1], interpolation=cv2.INTER_LINEAR)


def is_scalp(photo: Array, regions: Regions) -> bool:
    """Whether what is taken for hair in a photo, [H, W, 3], has the looks of skin."""
    assert regions.hair is not None
    ratio = min(1.0, FACE / max(regions.frame.height, 1.0))
    size = tuple(max(round(n * ratio), 1) for n in photo.shape[1::-1])
    colors, person, hair = (smaller(plane, size)
                            for plane in (photo, regions.person, regions.hair))
    colors *= np.float32(1 / 255 if photo.dtype == np.uint8 else 1)
    hair *= person
    sure = (hair > 0.7).sum() > SURE * (hair > 0.2).sum()
    small = Regions(regions.landmarks * ratio, person, hair)
    skin = small.labels()[..., PICTURE_LABELS.index("skin")] > 230
    # Edges of either are rough, whatever lies between them.
    kernel = np.ones((5, 5), np.uint8)
    scalp, skin = (cv2.erode(np.asarray(one, np.uint8), kernel) > 0
                   for one in (hair > 0.7, skin & (hair < 0.05)))
    if min(scalp.sum() if sure else hair.sum(), skin.sum()) < LEAST:
        return False
    shared = overlap(colors, np.asarray(scalp, np.float32) if sure else hair,
                     np.asarray(skin, np.float32))
    if not sure:
        return shared > LIKE
    luma = grey(colors)
    rough = np.abs(luma - broad_blur(luma, FINE * FACE))
    return bool(shared > LIKE and np.median(luma[scalp]) > SHADE * np.median(luma[skin])
                and rough[scalp].mean() < SMOOTH * rough[skin].mean())
