"""Closed eyes: where a sitter's are shut, the painter's are shut, too.

Open eyes that are laid onto closed lids are pressed into a slit, hollow and dark. So the painter's
own upper lid is drawn down over his eye to the lower one, with the dark line of its lashes, and
the painting with closed eyes is what is painted from. Each eye is decided by itself: a wink is one.
"""

from dataclasses import replace

import cv2
import numpy as np

from ..arrays import Array, Bool, Float32, Float64, Floats, UInt8
from .exemplar import Exemplar
from .guides.filters import grey
from .guides.regions import polygon

Points = Floats
Lids = tuple[bool, bool]
"""Whether the eye on the picture's left and the one on its right are shut."""

EYES = (36, 42)
"""First landmark of each eye: corner, two of the upper lid, corner, two of the lower lid."""
SHUT, DOUBTFUL, OPEN = 0.17, 0.27, 0.23
"""Height over width of eyes that are shut (closed lids keep a little of it, as landmarks of the
upper lid stay above its edge); of those that only the picture tells from narrow ones; and of open
eyes."""
SHUT_IN_SPACE = 0.12  # The same of shut eyes of a head: landmarks from many views keep less of it.
IRIS = 0.25
"""An eye whose middle differs from the skin above it in a channel by this share of the skin's
light shows its iris."""
LEFT = 0.08
"""Height over width that landmarks of a closed eye are given: its label keeps the lashes."""
LASHES, EDGE = 0.05, 0.06
"""Thickness of the upper lid's dark edge, which moves with it, and of the lower lid's wet one,
which it covers; over the eye's width."""
LINE, LINE_SHARE, DARKEST = 0.05, 0.6, 0.15
"""Width of the line of closed lashes, over the eye's; how much of it shows over the paint that was
drawn down; and the share of an open eye, its darkest, whose color the line has."""
SOUGHT = -0.02, 0.12
"""Where the upper lid's edge is sought above its landmarks, over the eye's width."""
NEAR = 0.25  # The same as a share of the way to the brow, at most.
BROAD, NEARBY, LIKE, FEW = 0.08, 0.2, 4.0, 8
"""Sigma of the blur for a lid's broad colors, and for those of the skin around that go on over it,
over the eye's width; how far apart both may be, of 255; and pixels that say enough."""
BESIDE, RIM = 0.35, 0.04
"""Skin beside an eye counts so far from its corners, and blur of the edge of what is changed, over
its width."""
UNDER, DARKER = 0.8, 0.2
"""Skin below a lid reaches so far down, over its width; a closed lid is no darker than it by more
than this share: it bulges into the light that falls there, whatever the shade of its socket is."""
SLACK = 0.5
"""How much less the upper lid is stretched at the brow than it is on average, and how much more at
its edge: its crease stays in its upper half."""
BROW = 0.65  # Share of the way from the upper lid to the brow that is drawn down.
BELOW = 0.25  # So far below the lower lid, over the eye's width, nothing moves.


def eye_openings(points: Points) -> tuple[float, float]:
    """Height of each eye over its width, from landmarks [68, 2 or 3]; NaN where unknown."""
    out = []
    for first in EYES:
        eye = np.asarray(points[first:first + 6], np.float64)
        height = 0.5 * sum(float(np.linalg.norm(eye[a] - eye[b])) for a, b in ((1, 5), (2, 4)))
        out.append(height / max(float(np.linalg.norm(eye[0] - eye[3])), 1e-9))
    return out[0], out[1]


def shut_eyes(points: Points, photo: Array | None = None) -> Lids:
    """Which eyes are shut, by landmarks [68, 2 or 3]; [68, 2] in pixels where there is a photo.

    The photo, uint8 or float in [0, 1], [H, W, 3], decides on narrow eyes.
    """
    shut = []
    least = SHUT if np.shape(points)[1] == 2 else SHUT_IN_SPACE
    for first, opening in zip(EYES, eye_openings(points)):
        eye = np.asarray(points[first:first + 6], np.float64)
        narrow = photo is not None and SHUT <= opening < DOUBTFUL
        shut.append(opening < least or (narrow and not _shows_iris(np.asarray(photo), eye)))
    return shut[0], shut[1]


def _shows_iris(photo: Array, eye: Float64) -> bool:
    """Whether the middle of a narrow eye [6, 2] has another color than the skin above it."""
    upper, lower = (eye[[a, b]].mean(axis=0) for a, b in ((1, 2), (4, 5)))
    way = lower - upper
    # Closed lids have their lashes where landmarks end: only what lies well above that counts.
    inside = [upper + share * way + along * (eye[3] - eye[0])
              for share in (0.2, 0.35, 0.5) for along in (-0.12, -0.06, 0.0, 0.06, 0.12)]
    above = [upper - share * way + along * (eye[3] - eye[0])
             for share in (0.6, 0.9) for along in (-0.12, 0.0, 0.12)]
    shown, skin = (np.median(_colors_at(photo, np.array(places)), axis=0)
                   for places in (inside, above))
    return bool(np.abs(shown - skin).max() > IRIS * max(float(skin.mean()), 1e-6))


def _colors_at(photo: Array, places: Float64) -> Float64:
    """Colors at places [N, 2] of a photo, float64 [N, 3]."""
    columns, rows = (np.clip(places[:, axis].astype(int), 0, photo.shape[1 - axis] - 1)
                     for axis in (0, 1))
    return np.asarray(photo[rows, columns][:, :3], np.float64)


def asked_lids(exemplar: Exemplar, points: Points, photo: Array | None = None) -> Lids:
    """Which open eyes of an exemplar have to be shut for a sitter; as `shut_eyes`."""
    shut, theirs = shut_eyes(points, photo), eye_openings(exemplar.landmarks)
    return shut[0] and theirs[0] > OPEN, shut[1] and theirs[1] > OPEN


def closed_words(lids: Lids) -> str:
    """The subject of a note on closed eyes, with its verb."""
    return "the sitter's eyes are" if all(lids) else "one of the sitter's eyes is"


def lids_together(points: Points, lids: Lids) -> Float64:
    """Landmarks [68, 2] of a photo with the upper lids of shut eyes near their lashes.

    Detectors see an eye in each face: of a closed one they have the lashes right, as its lower
    lid, and the upper lid in the middle of what covers it.
    """
    out = np.array(points, np.float64)
    for first, shut in zip(EYES, lids):
        if shut:
            across = out[first + 3] - out[first]
            up = LEFT * np.array([across[1], -across[0]])
            out[[first + 1, first + 2]] = out[[first + 5, first + 4]] + up
    return out


def closed(exemplar: Exemplar, lids: Lids) -> Exemplar:
    """The exemplar with eyes shut: itself where there are none to be shut.

    What is known of its person and hair stays (`Exemplar.regions`).
    """
    if not any(lids):
        return exemplar
    image, points = exemplar.image, exemplar.landmarks
    for first, shut in zip(EYES, lids):
        if shut:
            image = _drawn_down(image, points, first)
    return replace(exemplar, image=image, landmarks=lids_together(points, lids), lids=lids,
                   opened=exemplar)


def _drawn_down(image: UInt8, points: Float64, first: int) -> UInt8:
    """A picture whose upper lid of one eye covers it down to the lower one, uint8 [H, W, 3]."""
    eye = points[first:first + 6]
    brow = points[17:22] if first == EYES[0] else points[22:27]
    across = eye[3] - eye[0]
    width = float(np.linalg.norm(across))
    axes = np.array([across, [across[1], -across[0]]]) / width ** 2
    low = np.floor(np.minimum(eye.min(axis=0), brow.min(axis=0)) - width).astype(int)
    high = np.ceil(eye.max(axis=0) + width).astype(int)
    low, high = np.maximum(low, 0), np.minimum(high, image.shape[1::-1])
    rows, columns = np.mgrid[low[1]:high[1], low[0]:high[0]]
    along, up = np.moveaxis((np.stack([columns, rows], axis=-1) + 0.5 - eye[0]) @ axes.T, -1, 0)
    flat, back = (eye - eye[0]) @ axes.T, np.asarray(np.linalg.inv(axes).T, np.float64)
    upper, lower = (curve_through(flat[[0, *middle, 3]], along) for middle in ((1, 2), (5, 4)))
    over = (brow - eye[0]) @ axes.T
    # Not in the brow: no more than a part of the way there.
    room = NEAR * float(over[:, 1].mean() - flat[1:3, 1].mean())
    upper += _edge(image, flat, eye[0], back, room)
    source = up + _moved(along, up, upper, lower, over)
    places = (np.stack([along, source], axis=-1) @ back + eye[0] - 0.5).astype(np.float32)
    out = image.copy()
    moved = cv2.remap(image, places[..., 0], places[..., 1], cv2.INTER_CUBIC,
                      borderMode=cv2.BORDER_REPLICATE)
    # Where nothing moves nothing is resampled.
    part = out[low[1]:high[1], low[0]:high[0]]
    part[source != up] = moved[source != up]
    lid = (up > lower) & (up < upper) & (along > 0) & (along < 1)
    skin = (up > upper + 2 * LASHES) & (
        up < upper + BROW * np.maximum(over[:, 1].mean() - upper, 0.15))
    skin &= (along > 0) & (along < 1)
    # Both corners' sides, as high as the eye is: in the painter's light there.
    skin |= (np.abs(along - 0.5) > 0.5 + LASHES) & (np.abs(along - 0.5) < 0.5 + BESIDE) & (
        up > flat[4:, 1].mean() - LASHES) & (up < flat[1:3, 1].mean() + 2 * LASHES)
    shown = image[low[1]:high[1], low[0]:high[0]]
    _as_around(part, lid, shown, skin, width)
    bag = (up < lower - LASHES) & (up > lower - UNDER) & (along > 0) & (along < 1)
    _lifted(part, lid, shown, bag, width)
    line = LINE_SHARE * _line(along, up - lower)[..., None]
    part[:] = np.clip((1 - line) * part + line * np.minimum(_dark(image, eye), part) + 0.5, 0, 255)
    return out


def _as_around(part: UInt8, lid: Bool, shown: UInt8, around: Bool, width: float) -> None:
    """Keep the broad colors of a lid [h, w] like those that go on from around it; in place.

    A thin edge of another color, drawn down over a whole eye, would be a stain, and so would the
    light of a brow or the dark of a socket. ``shown`` is the picture before, ``width`` the eye's.
    """
    if min(lid.sum(), around.sum()) < FEW:
        return
    broad = _blurred(part, lid, BROAD * width)
    apart = _blurred(shown, around, NEARBY * width) - broad
    change = apart - np.clip(apart, -LIKE, LIKE)
    soft = cv2.GaussianBlur(lid.astype(np.float32), (0, 0), max(RIM * width, 0.3))
    part[:] = np.asarray(np.clip(part + soft[..., None] * change + 0.5, 0, 255), np.uint8)


def _lifted(part: UInt8, lid: Bool, shown: UInt8, below: Bool, width: float) -> None:
    """Let a lid's broad colors be no much darker than those below; in place; see `_as_around`."""
    if min(lid.sum(), below.sum()) < FEW:
        return
    broad = _blurred(part, lid, BROAD * width)
    under = _blurred(shown, below, 2 * NEARBY * width)
    light, most = (grey(colors / np.float32(255)) for colors in (broad, under))
    way = (1 - DARKER) * most - light
    share = np.clip(way / np.maximum(most - light, np.float32(1e-3)), 0, 1)[..., None]
    soft = cv2.GaussianBlur(lid.astype(np.float32), (0, 0), max(RIM * width, 0.3))
    part[:] = np.asarray(np.clip(part + soft[..., None] * share * (under - broad) + 0.5, 0, 255),
                         np.uint8)


def _blurred(picture: UInt8, inside: Bool, sigma: float) -> Float32:
    """Colors [h, w, 3] of what lies inside, blurred and carried on."""
    # From broad to narrow: what is near counts alone, where there is any.
    mean = picture[inside].astype(np.float32).mean(axis=0)
    out = np.broadcast_to(mean, picture.shape).astype(np.float32)
    weighted = np.dstack([np.where(inside[..., None], picture, 0), inside]).astype(np.float32)
    for reach in (4 * sigma, 2 * sigma, sigma):
        # What is broad shows on fewer pixels.
        factor = max(1.0, 0.25 * reach)
        few = cv2.resize(weighted, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
        few = cv2.GaussianBlur(few, (0, 0), reach / factor)
        here, total = np.split(cv2.resize(few, inside.shape[::-1]), [3], axis=-1)
        sure = np.clip(total / np.float32(0.1), 0, 1)
        out += sure * (here / np.maximum(total, np.float32(1e-4)) - out)
    return np.asarray(out, np.float32)


def _line(along: Float64, above: Float64) -> Float64:
    """Where the lashes of closed lids lie, in [0, 1], ``above`` the lower lid; thin at corners."""
    ends = np.sqrt(np.clip(4 * along * (1 - along), 0, 1))
    return np.asarray(ends * np.exp(-0.5 * ((above - LINE / 2) / (LINE / 2)) ** 2))


def _dark(image: UInt8, eye: Float64) -> Float64:
    """Mean color of the darkest part of an open eye [6, 2], float64 [3]."""
    places = np.argwhere(polygon(image.shape[:2], eye) > 0)
    if not len(places):
        places = np.floor(eye.mean(axis=0))[None, ::-1].astype(int)
    colors = image[places[:, 0], places[:, 1]]
    light = grey(colors[None])[0]
    return np.asarray(colors[light <= np.quantile(light, DARKEST)].mean(axis=0), np.float64)


def _edge(image: UInt8, eye: Float64, corner: Float64, back: Float64, room: float) -> float:
    """How far above its landmarks the upper lid's edge is, over the eye's width.

    That is where skin turns into the dark of lashes most sharply, along the whole lid, ``room``
    above the landmarks at most. ``eye`` [6, 2] is along and above the line of its corners, which
    ``back`` turns into pixels.
    """
    along = np.linspace(0.2, 0.8, 25)
    lid = curve_through(eye[[0, 1, 2, 3]], along)
    step = 0.01
    most = min(SOUGHT[1], room)
    heights = np.arange(SOUGHT[0] - LASHES, most + LASHES + step / 2, step)
    places = np.stack(np.broadcast_arrays(along, lid + heights[:, None]), axis=-1) @ back + corner
    colors = _colors_at(image, places.reshape(-1, 2)).reshape(len(heights), -1, 3)
    light = colors.mean(axis=(1, 2))
    reach = round(LASHES / step)
    sums = np.concatenate([[0.0], np.cumsum(light)])
    means = (sums[reach:] - sums[:-reach]) / reach
    rise = means[reach:] - means[:-reach]
    return float(heights[reach + int(np.argmax(rise))])


def _moved(along: Float64, up: Float64, upper: Float64, lower: Float64, brow: Float64) -> Float64:
    """How far above each place its paint comes from, in units of the eye's width.

    Parameters
    ----------
    along, up : Of each place, from the first corner (0) to the other (1), and above the line of
        both.
    upper, lower : Height of the lids' edges there.
    brow : Landmarks, [5, 2], as ``along`` and ``up``.
    """
    # The lids of a narrow strip beyond the corners move less and less.
    inside = np.clip(np.minimum(along + 0.1, 1.1 - along) / 0.2, 0, 1)
    inside = inside * inside * (3 - 2 * inside)
    order = np.argsort(brow[:, 0])
    top = upper + BROW * np.maximum(np.interp(along, brow[order, 0], brow[order, 1]) - upper, 0.15)
    height = np.clip((up - lower - LASHES) / np.maximum(top - lower - LASHES, 1e-6), 0, 1)
    height *= 1 - SLACK + SLACK * height
    skin = upper + height * (top - upper) - up
    lid = np.where(up < lower + LASHES, upper - LASHES - lower, np.where(up < top, skin, 0))
    below = np.clip((up - lower + BELOW) / BELOW, 0, 1)
    return np.asarray(inside * np.where(up >= lower, lid, -below * EDGE))


def curve_through(points: Float64, along: Float64) -> Float64:
    """Height of a lid's or lip's edge through points [K, 2] (Fritsch & Carlson 1980)."""
    from scipy.interpolate import PchipInterpolator

    order = np.argsort(points[:, 0])
    x = points[order, 0] + 1e-6 * np.arange(len(points))
    return np.asarray(PchipInterpolator(x, points[order, 1])(np.clip(along, x[0], x[-1])))
