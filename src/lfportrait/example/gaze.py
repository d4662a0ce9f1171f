"""Painted eyes that look the same way, and of which both can be made out (docs/people.md).

Both irises are moved within their lids, each by half of it, until they are as parallel as those of
people are. Where they look is found twice: by MediaPipe's landmarker, which reports a part of an
iris's move only and is misled by paint, and by the dark discs between the lids, which are misled by
glints and shade. Eyes are moved to the side by as much as both agree on. A disc is looked for whose
paint is darkest against what lies to its left and right between the lids; both eyes have discs of
one size.

An eye in the shade, or behind the rim of spectacles, would be a smear on another person's face. So
an eye with much less contrast between white and iris than the other is painted as the other one is,
in the light and the color of its own surroundings; iris and white are shifted, not mirrored.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from .. import face, models
from ..arrays import Array, Float32, Float64, Floats, UInt8
from ..cache import kept_arrays, key_of
from ..color import LUMA
from .exemplar import Exemplar
from .frontal import FRONTAL
from .guides.regions import polygon

WIDTH = 64  # Pixels between the corners of an eye in the picture of it that is looked at.
HALF = 56, 36  # Half the width and height of that picture.
RADII = (0.16, 0.18, 0.2, 0.22, 0.24, 0.26)
"""Of an iris, over the width of its eye: people have 0.19 to 0.2."""
PLACES = 0.3, 0.04
"""How far from the middle of an eye's opening an iris may lie, to the side and up or down, over its
width."""
BESIDE = 1.1, 1.6  # What lies beside a disc, in its radii; above and below are lids and lashes.
BLUR = 0.03  # Sigma, over the width of an eye: single strokes and glints are no irises.
OPEN = 1.15
"""The outline of landmarks lies on the lids' edges or within: it is taken this much larger."""
SHOWN = 0.45  # Share of an iris that shows between the lids, at least.
LEAST = 0.9
"""Contrast of a disc and what is beside it, over the spread of an eye's tones and times the share
of the disc that shows, from which on discs are irises: mean of both eyes, half of it in each."""


@dataclass(frozen=True)
class _Eye:
    """A picture of an eye, its corners level."""

    luma: Float32  # float32 [2 * HALF[1] + 1, 2 * HALF[0] + 1], blurred.
    opening: Float32  # float32 of that shape, 1 between the lids.
    outline: Float64  # float64 [6, 2], pixels of the portrait.


def irises_found(image: UInt8, landmarks: Float64) -> Float64 | None:
    """Middles of both irises, float64 [2, 2] pixels, of the picture's left eye first.

    None where an eye shows no disc. The face is seen from the front in ``image`` uint8 [H, W, 3],
    sRGB.
    """
    seen = (_seen(image, np.asarray(landmarks[part], np.float64))
            for part in (slice(36, 42), slice(42, 48)))
    eyes = [eye for eye in seen if eye is not None]
    if len(eyes) < 2:
        return None
    best: tuple[float, list[Float64]] = (2 * LEAST, [])
    for radius in RADII:
        found = [_disc(eye, radius * WIDTH) for eye in eyes]
        total = sum(score for score, _ in found)
        if min(score for score, _ in found) > 0.5 * LEAST and total > best[0]:
            best = total, [place for _, place in found]
    if not best[1]:
        return None
    return np.stack([_in_portrait(eye, place) for eye, place in zip(eyes, best[1])])


def _frame(outline: Float64) -> tuple[Float64, Float64]:
    """Middle of an eye's corners, and what a pixel of its picture is in the portrait, [2, 2]."""
    along = (outline[3] - outline[0]) / WIDTH
    return 0.5 * (outline[0] + outline[3]), np.array([along, [-along[1], along[0]]])


def _in_portrait(eye: _Eye, place: Float64) -> Float64:
    """A place (x, y) from the middle of an eye's picture, in the portrait."""
    middle, axes = _frame(eye.outline)
    return np.asarray(middle + place @ axes, np.float64)


def _seen(image: UInt8, outline: Float64) -> _Eye | None:
    """The picture of an eye [6, 2]; None if it is too small or closed."""
    middle, axes = _frame(outline)
    if np.linalg.norm(axes[0]) * WIDTH < 8:
        return None
    to = np.linalg.inv(axes)
    inside = OPEN * ((outline - middle) @ to) + np.array(HALF)
    size = 2 * HALF[0] + 1, 2 * HALF[1] + 1
    way = np.concatenate([axes.T, (middle - np.array(HALF) @ axes - 0.5)[:, None]], axis=1)
    # Paint finer than the picture's pixels is mixed first.
    fine = max(float(np.linalg.norm(axes[0])), 1e-6)
    low = np.maximum(np.floor(middle - 1.2 * WIDTH * fine), 0).astype(int)
    high = np.minimum(np.ceil(middle + 1.2 * WIDTH * fine), image.shape[1::-1]).astype(int)
    if (high - low < 4).any():
        return None
    part = image[low[1]:high[1], low[0]:high[0]] @ LUMA
    blurred = cv2.GaussianBlur(part, (0, 0), BLUR * WIDTH * fine)
    way[:, 2] -= low
    luma = cv2.warpAffine(blurred, way, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                          borderMode=cv2.BORDER_REPLICATE)
    opening = np.zeros(size[::-1], np.float32)
    cv2.fillPoly(opening, [np.round(inside * 16).astype(np.int32)], 1.0, shift=4)
    if opening.sum() < 0.08 * WIDTH ** 2:
        return None
    return _Eye(np.asarray(luma, np.float32), opening, outline)


def _disc(eye: _Eye, radius: float) -> tuple[float, Float64]:
    """Contrast of the best disc of a radius in an eye, and its place (x, y) from the middle."""
    reach = int(np.ceil(BESIDE[1] * radius))
    y, x = np.mgrid[-reach:reach + 1, -reach:reach + 1]
    away = np.hypot(x, y) / radius
    disc = (away < 1).astype(np.float32)
    beside = ((away > BESIDE[0]) & (away < BESIDE[1]) & (np.abs(y) < 0.7 * radius)
              ).astype(np.float32)
    inner, outer = (_mean(eye, kernel) for kernel in (disc, beside))
    spread = float(eye.luma[eye.opening > 0].std()) + 1.0
    # The more of a disc the lids leave open, the surer it is; one behind them is none.
    open_share = inner[1] / disc.sum()
    score = open_share * (outer[0] - inner[0]) / spread
    rows, columns = np.mgrid[-HALF[1]:HALF[1] + 1, -HALF[0]:HALF[0] + 1]
    rows = rows - np.average(rows, weights=eye.opening)
    score[(open_share < SHOWN) | (outer[1] < 0.5 * SHOWN * beside.sum())
          | (np.abs(columns) > PLACES[0] * WIDTH) | (np.abs(rows) > PLACES[1] * WIDTH)] = -np.inf
    row, column = np.unravel_index(int(score.argmax()), score.shape)
    place = np.array([column - HALF[0], row - HALF[1]], np.float64)
    return float(score[row, column]), place + _between(score, int(row), int(column))


def _mean(eye: _Eye, kernel: Float32) -> tuple[Float32, Float32]:
    """Mean tone of what a kernel covers of an eye's opening around each pixel, and how much."""
    total, covered = (cv2.filter2D(plane, -1, kernel, borderType=cv2.BORDER_CONSTANT)
                      for plane in (eye.luma * eye.opening, eye.opening))
    return np.asarray(total / np.maximum(covered, 1e-3), np.float32), np.asarray(covered)


def _between(score: Floats, row: int, column: int) -> Float64:
    """Where a parabola has its top around the best pixel, (x, y) in [-0.5, 0.5]."""
    out = np.zeros(2)
    for axis, (dy, dx) in enumerate(((0, 1), (1, 0))):
        one, two = score[row - dy, column - dx], score[row + dy, column + dx]
        bend = one + two - 2 * score[row, column]
        if np.isfinite(bend) and bend < 0:
            out[axis] = np.clip(0.5 * (one - two) / bend, -0.5, 0.5)
    return out


FULL = 45.0
"""Degrees by which an eye is turned whose iris lies at a corner, about."""
USUAL = 9.0, 0.0
"""Degrees (right, down) that irises of parallel eyes seem apart, as the inner corners of eyes reach
further from them: the median of photos of nine people, between 7 and 10."""
DISCS_USUAL = 10.0
"""The same to the right for dark discs between the landmarker's corners: the median of photos of
nine people was 10.2, between 5.6 and 13.9, of thirteen paintings 9.0."""
FOLLOWED = 0.5
"""Share of an iris's move that the landmarker reports, in photos and in paintings: 0.1 to 0.7. Of
the discs it is 0.4 to 0.9."""
LITTLE, MOST = 2.0, 10.0
"""Eyes less apart than this stay, as people's own seem to be; more apart than that, an iris was not
seen right."""
CLOSED = 0.12  # An eye less open than this, height over width, shows too little of its iris.
REACH = 0.33, 0.25
"""The iris and what is moved with it: half its width and height, over the width of the eye."""
SIDE, ROOM = 768, 1.56
"""Side of the picture of a face that is looked at, and its width over that of the landmarks."""
MESH_EYES = ((33, 133, 468, 159, 145), (362, 263, 473, 386, 374))
"""Left and right corner, middle of the iris, upper and lower lid in MediaPipe's mesh; the picture's
left eye first."""


def with_parallel_eyes(exemplar: Exemplar) -> Exemplar:
    """The exemplar with eyes that look the same way; itself where they do, or nothing is known.

    Faces that are turned stay as they are: there, parallel eyes seem apart. So do all where
    MediaPipe's landmarker is not at hand.
    """
    if abs(exemplar.pose().yaw) >= FRONTAL or not models.available("face-landmarker"):
        return exemplar

    def find() -> dict[str, Array]:
        mesh = _mesh(exemplar.image, exemplar.landmarks)
        discs = irises_found(exemplar.image, exemplar.landmarks)
        return {"eyes": np.empty((0, 5, 2)) if mesh is None else mesh[np.array(MESH_EYES)],
                "discs": np.empty((0, 2)) if discs is None else discs}

    key = key_of(__name__, face.detectors_key(), exemplar.image, exemplar.landmarks)
    found = kept_arrays("gazes", key, find)
    eyes, discs = found["eyes"], found["discs"]
    if not len(eyes) or not len(discs) or _opening(eyes) < CLOSED:
        return exemplar
    away = agreed(eyes, discs)
    if abs(away) < LITTLE:
        return exemplar
    image = exemplar.image
    for eye, disc, share in zip(eyes, discs, (0.5, -0.5)):
        image = _moved(image, eye, disc, share * away)
    return replace(exemplar, image=image, opened=exemplar)


def agreed(eyes: Float64, discs: Float64) -> float:
    """Degrees by which the picture's right eye surely looks further right than the left one.

    The lesser of what both kinds of irises show, those of ``eyes`` (`looking_apart`) and the discs,
    float64 [2, 2] pixels (`irises_found`); 0 where one shows the contrary, or eyes more than `MOST`
    degrees apart.
    """
    turned = [_turned(disc, eye[0], eye[1])[0] for eye, disc in zip(eyes, discs)]
    by_discs = float(turned[1] - turned[0]) - DISCS_USUAL
    by_mesh = float(looking_apart(eyes)[0])
    if by_discs * by_mesh <= 0 or max(abs(by_discs), abs(by_mesh)) > MOST:
        return 0.0
    return float(np.sign(by_discs)) * min(abs(by_discs), abs(by_mesh) / FOLLOWED)


def looking_apart(eyes: Float64) -> Float64:
    """Degrees [2], right and down, that the picture's right eye looks away from the left one.

    ``eyes`` float64 [2, 5, 2] pixels: left and right corner, iris, upper and lower lid of each.
    """
    gaze = [_turned(iris, left, right) for left, right, iris, *_ in eyes]
    return np.asarray(gaze[1] - gaze[0] - USUAL, np.float64)


def _turned(iris: Float64, left: Float64, right: Float64) -> Float64:
    """Degrees [2], to the right and downwards, of an iris between an eye's corners, [2] each."""
    along = 0.5 * (right - left)
    away = iris - 0.5 * (left + right)
    across = np.array([-along[1], along[0]])
    return FULL * np.array([away @ along, away @ across]) / max(float(along @ along), 1e-9)


def _opening(eyes: Float64) -> float:
    """Height over width of the eye [2, 5, 2] that is less open."""
    return min(float(np.linalg.norm(upper - lower)) / max(float(np.linalg.norm(right - left)), 1e-9)
               for left, right, _, upper, lower in eyes)


def _mesh(image: UInt8, landmarks: Float64) -> Float64 | None:
    """MediaPipe's mesh [478, 2] of the face with these landmarks [68, 2], pixels of the picture."""
    low, high = landmarks.min(axis=0), landmarks.max(axis=0)
    half = 0.5 * ROOM * float((high - low).max())
    first = 0.5 * (low + high) - [0.0, 0.1 * (high[1] - low[1])] - half
    step = 2 * half / SIDE
    # From the middle of the close picture's first pixel, in pixels of the picture.
    way = np.array([[step, 0, first[0] + 0.5 * step - 0.5], [0, step, first[1] + 0.5 * step - 0.5]])
    close = cv2.warpAffine(image, way, (SIDE, SIDE), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
                           borderMode=cv2.BORDER_REPLICATE)
    mesh = face.face_mesh(np.asarray(close, np.uint8))
    return None if mesh is None else np.asarray(first + step * mesh, np.float64)


def _moved(image: UInt8, eye: Float64, iris: Float64, degrees: float,
           ) -> UInt8:
    """A picture [H, W, 3] whose ``iris`` [2] is turned to the right; corners and lids stay."""
    along = 0.5 * (eye[1] - eye[0])
    across = np.array([-along[1], along[0]])
    width = 2 * float(np.linalg.norm(along))
    shift = degrees * along / FULL
    low = np.maximum(np.floor(iris - width), 0).astype(int)
    high = np.minimum(np.ceil(iris + width), image.shape[1::-1]).astype(int)
    if (high <= low).any():
        return image
    rows, columns = np.mgrid[low[1]:high[1], low[0]:high[0]]
    places = np.stack([columns, rows], axis=-1) + 0.5
    away = (places - iris - shift) @ np.stack([along, across], axis=1) / (0.5 * width ** 2)
    weight = np.exp(-np.hypot(away[..., 0] / REACH[0], away[..., 1] / REACH[1]) ** 4)
    weight[weight < 1e-3] = 0
    source = (places - weight[..., None] * shift - 0.5).astype(np.float32)
    moved = cv2.remap(image, source[..., 0], source[..., 1], cv2.INTER_CUBIC,
                      borderMode=cv2.BORDER_REPLICATE)
    out = image.copy()
    part = out[low[1]:high[1], low[0]:high[0]]
    # Where nothing moves nothing is resampled.
    part[weight > 0] = moved[weight > 0]
    return out


EYE_LANDMARKS = slice(36, 42), slice(42, 48)  # Landmarks of the eyes, the picture's left one first.
TWIN = np.array([3, 2, 1, 0, 5, 4])  # The landmarks of an eye's mirror image.
EVEN = 0.57
"""An eye with less of the other's contrast than this is not made out. On eight old masters those
had 0.33 to 0.55 that one sees as smears, all others 0.74 or more; of fourteen frontal exemplars the
least has 0.58."""
SEEN = 0.12  # An eye with less contrast than this is no better.
LIGHT, DARK = 0.85, 0.12  # Quantiles of the tones between the lids that stand for white and iris.
WITHIN = 0.92  # What is looked at is this much smaller than the lids' outline: not the lashes.
LEAST_OPENING = 0.06
"""Lids that leave less open than this, over the square of an eye's width, are closed."""
FINE = 0.03  # Blur of what is looked at, over an eye's width: finer strokes are the painter's hand.
REPLACED = 0.72, 0.40, 0.46
"""Half width of what is painted, and its heights above and below an eye's middle, over the eye's
width: lids and bags, but no brow."""
SOFT, RING = 0.12, 1.3
"""Blur of its edge, over the eye's width; and how far around it light and color are read, over its
size."""
LIFTED = 0.3  # Share of the light around that reaches an eye's middle.


def with_even_eyes(exemplar: Exemplar) -> Exemplar:
    """The exemplar with both eyes as clear as the better one; itself where they nearly are.

    Faces that are turned stay as they are: their far eye is narrow. So does an eye that is closed.
    """
    if abs(exemplar.pose().yaw) >= FRONTAL:
        return exemplar
    outlines = [np.asarray(exemplar.landmarks[eye], np.float64) for eye in EYE_LANDMARKS]
    clear = [eye_contrast(exemplar.image, outline) for outline in outlines]
    weak = int(np.argmin(clear))
    if min(clear) == 0 or clear[1 - weak] < SEEN or clear[weak] > EVEN * clear[1 - weak]:
        return exemplar
    image = _as_the_other(exemplar.image, outlines[weak], outlines[1 - weak])
    return replace(exemplar, image=image, opened=exemplar)


def eye_contrast(image: Array, outline: Float64) -> float:
    """Contrast of white and iris between the lids, in [0, 1]; 0 of an eye that is hardly open.

    ``outline`` [6, 2] are the eye's landmarks in an sRGB picture [H, W, 3], uint8 or float in [0,
    1].
    """
    middle = outline.mean(axis=0)
    size = float(np.linalg.norm(outline[3] - outline[0]))
    low = np.maximum(np.floor(middle - size).astype(int), 0)
    high = np.minimum(np.ceil(middle + size).astype(int), image.shape[1::-1])
    if (high - low < 4).any():
        return 0.0
    part = np.asarray(image[low[1]:high[1], low[0]:high[0]], np.float32)
    luma = part @ LUMA
    if image.dtype == np.uint8:
        luma /= np.float32(255)
    luma = np.asarray(cv2.GaussianBlur(luma, (0, 0), max(FINE * size, 0.3)), np.float32)
    opening = polygon(part.shape, middle - low + WITHIN * (outline - middle)) > 0.5
    if opening.sum() < max(LEAST_OPENING * size ** 2, 12):
        return 0.0
    dark, light = np.quantile(luma[opening], (DARK, LIGHT))
    return float(light - dark)


def _as_the_other(image: UInt8, weak: Float64, clear: Float64) -> UInt8:
    """The picture with the eye ``weak`` [6, 2] painted as the eye ``clear`` [6, 2] is."""
    size = float(np.linalg.norm(weak[3] - weak[0]))
    middle = weak.mean(axis=0)
    low = np.maximum(np.floor(middle - 1.5 * size).astype(int), 0)
    high = np.minimum(np.ceil(middle + 1.5 * size).astype(int), image.shape[1::-1])
    shape = high[1] - low[1], high[0] - low[0]
    rows, columns = np.mgrid[low[1]:high[1], low[0]:high[0]]
    places = np.stack([columns, rows], axis=-1) + 0.5
    # Lids and what is around them as in a mirror; white and iris as they look.
    mirrored, shifted = (_sampled(image, places @ way[:2] + way[2])
                         for way in (_affine(weak, clear[TWIN]), _affine(weak, clear)))
    opening = cv2.GaussianBlur(polygon(shape, weak - low), (0, 0), max(0.04 * size, 0.3))
    theirs = mirrored + opening[..., None] * (shifted - mirrored)
    ours = image[low[1]:high[1], low[0]:high[0]].astype(np.float32)
    away = _away(places, weak, size)
    # In the light around: what differs there goes on over the eye, but deep shade would hide it.
    ring = np.asarray((away > 1) & (away < RING), np.float32)
    reach = 0.5 * REPLACED[0] * size
    total = cv2.GaussianBlur(ring, (0, 0), reach)[..., None]
    light = cv2.GaussianBlur((ours - theirs) * ring[..., None], (0, 0), reach) / (total + 1e-4)
    light *= np.clip(LIFTED + (1 - LIFTED) * away, 0, 1)[..., None]
    share = cv2.GaussianBlur(np.asarray(away < 1, np.float32), (0, 0), max(SOFT * size, 0.3))
    out = image.copy()
    out[low[1]:high[1], low[0]:high[0]] = np.asarray(np.clip(
        ours + share[..., None] * (theirs + light - ours), 0, 255) + 0.5, np.uint8)
    return out


def _away(places: Float64, outline: Float64, size: float) -> Float64:
    """How far places [h, w, 2] are from an eye's middle: 1 at the edge of what is painted."""
    along = (outline[3] - outline[0]) / size
    beside = (places - outline.mean(axis=0)) @ np.stack([along, [-along[1], along[0]]], axis=1)
    wide, above, below = (part * size for part in REPLACED)
    high = np.where(beside[..., 1] < 0, above, below)
    return np.hypot(beside[..., 0] / wide, beside[..., 1] / high)


def _affine(places: Float64, others: Float64) -> Float64:
    """The affine map [3, 2] that leads from places [N, 2] to others [N, 2] by least squares."""
    known = np.concatenate([places, np.ones((len(places), 1))], axis=1)
    return np.asarray(np.linalg.lstsq(known, others, rcond=None)[0], np.float64)


def _sampled(image: UInt8, places: Float64) -> Float32:
    """A picture [H, W, 3] at places [h, w, 2] (x, y), float32 in [0, 255]."""
    x, y = np.moveaxis(np.asarray(places - 0.5, np.float32), -1, 0)
    return np.asarray(cv2.remap(image, np.ascontiguousarray(x), np.ascontiguousarray(y),
                                cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.float32)
