"""A painted hat: found in the painting, and put on the sitter of a photo (docs/people.md).

The networks know no hats: to them one is hair, cloth or background. Where a forehead is covered
(its colors and its light are not those of cheeks and nose), and what covers it reaches far beyond a
head, is unlike the hair below it or has two hues, there is one. Its outline is a cut by colors
(GrabCut: Rother et al. 2004) that begins at the crown.

It lies over a photo as a thing with its own edge, warped by the two faces' frames: as wide as the
sitter's face is against the painter's, and high enough for the sitter's head. Hair that would stick
out above its edge is pressed down under it: there is background.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numba
import numpy as np
from scipy import ndimage

from ...arrays import Array, Bool, Float32, UInt8, box_about
from ...cache import kept_arrays, key_of
from ...color import to_lab
from ...labels import BY_HAND, PICTURE_LABELS
from ..exemplar import Exemplar
from ..guides.filters import disk, grey, skin_distance, smaller
from ..guides.regions import Regions, soft_face
from ..painter.picture_materials import SmallPicture, has_two_hues

HAIRLINE, TEMPLE, ROUND = 0.54, 0.86, 2.0
"""A forehead ends this far above the brows (chin -1), and this far from its middle over half the
face's width, in a superellipse of this power."""
HIGH = 0.64  # The same height of a forehead that is hidden.
HIDES = 0.3
"""A forehead is hidden if no less than this share of it is covered by something else than hair."""
HEAD = 1.15, 0.95, 0.0
"""A head ends this far from its middle over half the face's width, and this far above the brows;
hair that a hat covers begins above this."""
BROWS = 0.03  # It begins this far above the brows' middle: what lies lower is brows and lids.
LAB_BLUR = 0.02  # Colors are compared blurred by so much over the face's size.
LIGHT = 0.4  # How much light counts against hue and chroma.
FEW, MOST = 50, 1500  # A smaller sample of skin says nothing; of a larger one a part will do.
NEAR, USUAL = 0.02, 0.95
"""A color's distance is that to the nearest of the sample, this share of it left out; so far apart
are the sample's own, but for the rest."""
OTHER, LEAST_OTHER = 1.2, 0.5
"""What is further than this times that, and a little more in Lab, is no skin."""
THICK = 0.04  # What is narrower, over the face's height, is a wrinkle.
STRIP = 0.2
"""Skin below a hat, down to the brows, that is no higher than this over the face's height: the edge
of a shade runs through it."""


@dataclass(frozen=True)
class Forehead:
    """What is known of a painted forehead."""

    covered: Float32  # float32 [h, w] in [0, 1], where it is not bare.
    bare: Float32  # float32 [h, w] in [0, 1], skin of the face.
    lit: Float32  # The same with the nose: its light goes on there.
    crown: Float32  # float32 [h, w] in [0, 1], where the head is above the forehead and beside it.
    share: float  # Of the forehead that is covered, in [0, 1].
    # Of the forehead that is covered or shaded by something else than hair, in [0, 1].
    other: float


def covered_forehead(exemplar: Exemplar, regions: Regions, labels: UInt8) -> Forehead:
    """Where the forehead of a painting seen from the front, or nearly so, is covered or shaded."""
    small = SmallPicture(exemplar, regions, labels)
    right, down = small.part(small.right), small.part(small.down)
    half = 0.5 * regions.frame.width / regions.frame.height
    around, high = (((np.abs(right) / (TEMPLE * half)) ** ROUND
                     + (np.maximum(-down, 0) / top) ** ROUND) for top in (HAIRLINE, HIGH))
    features = _features(small, labels)
    oval = (around < 1) & (down < 0)
    flesh = (small.part(small.face) > 0.7) | oval
    sample = _sample(small, labels)
    unlike, light = _unlike(small, sample, flesh)
    # Linen on the brows themselves is lighter than skin.
    forehead = oval & (down < np.where(light, 0, -BROWS)) & (~features | light)
    hair = small.part(labels[..., PICTURE_LABELS.index("hair")]) > 100
    cover = forehead & unlike
    cover = _from_above(cover, forehead, max(1, round(THICK * regions.frame.height / small.factor)))
    whole = max(float(forehead.sum()), 1.0)
    share, other = float(cover.sum()) / whole, float((cover & ~hair).sum()) / whole
    bare = flesh & ~features & ~unlike & ~cover & ~hair
    if other >= HIDES:
        cover |= _strip(cover, oval & (down < 0) & ~features, round(
            STRIP * regions.frame.height / small.factor))
        bare &= ~cover
        # Where hair begins under a hat nobody knows: as high as on most heads.
        cover |= (high < 1) & (down < 0) & ~oval
    crown = np.hypot(right / (HEAD[0] * half), np.maximum(-down, 0) / HEAD[1]) < 1
    crown &= (down < HEAD[2]) & (around > 1) & ~cover
    covered, skin, lit, head = (small.whole(plane.astype(np.float32)) for plane in (
        cover, bare, bare | sample & flesh & ~unlike, crown))
    return Forehead(covered, skin, lit, head, share, other)


def _features(small: SmallPicture, labels: UInt8) -> Bool:
    """Brows and what else is no plain skin, of the small picture."""
    part = small.part(labels)
    numbers = [PICTURE_LABELS.index(name) for name in ("brows", "eyes", "nose", "lips")]
    return np.asarray(part[..., numbers].sum(axis=-1, dtype=np.int64) > 40)


def _sample(small: SmallPicture, labels: UInt8) -> Bool:
    """Cheeks and nose: a nose is lit as a forehead is."""
    nose = small.part(labels[..., PICTURE_LABELS.index("nose")]) > 200
    # Its ridge, without nostrils and their shade.
    nose &= small.part(small.down) < 0.45
    return small.cheeks | nose


def _unlike(small: SmallPicture, sample: Bool, where: Bool) -> tuple[Bool, Bool]:
    """What has other colors than a sample of skin, and what of this is lighter, bool [h, w].

    Skin has a painter's lights, shades and hues, so colors are compared with the nearest ones of
    the sample, and these with each other. Looked at is ``where``.
    """
    from scipy.spatial import cKDTree

    unlike = np.zeros(where.shape, bool)
    if sample.sum() < FEW:
        return unlike, unlike
    lab = to_lab(small.blurred(LAB_BLUR)) * [LIGHT, 1.0, 1.0]
    skin = lab[sample][::max(1, int(sample.sum()) // MOST)]
    tree, near = cKDTree(skin), [max(1, round(NEAR * len(skin)))]
    own = np.quantile(tree.query(skin, k=near)[0], USUAL)
    away = tree.query(lab[where], k=near, workers=numba.get_num_threads())[0][:, 0]
    unlike[where] = away > OTHER * own + LEAST_OTHER
    return unlike, unlike & (lab[..., 0] > np.quantile(skin[:, 0], USUAL))


def _strip(cover: Bool, forehead: Bool, most: int) -> Bool:
    """What of a forehead lies below a cover in columns where that is ``most`` rows at most."""
    below = forehead & ~cover & (np.maximum.accumulate(cover, axis=0))
    count = below.sum(axis=0)
    # Single columns are as their neighbours are.
    thin = cv2.morphologyEx((count <= most).astype(np.uint8)[None], cv2.MORPH_OPEN,
                            np.ones((1, max(1, most // 2)), np.uint8))[0] > 0
    return np.asarray(below & thin)


def _from_above(cover: Bool, forehead: Bool, radius: int) -> Bool:
    """The part of a cover that hangs down from the forehead's upper edge, without wrinkles."""
    kernel = disk(radius)
    # Beyond the forehead it may go on.
    beyond = cover | ~forehead
    opened = cv2.morphologyEx(beyond.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0
    closed = cv2.morphologyEx(opened.astype(np.uint8), cv2.MORPH_CLOSE, kernel) > 0
    pieces, _ = ndimage.label(closed & forehead)
    rows = np.arange(len(forehead))[:, None]
    top = forehead & (rows < np.where(forehead.any(axis=0), forehead.argmax(axis=0), 0)
                      + 2 * radius)
    kept = np.unique(pieces[top & (pieces > 0)])
    return np.asarray(np.isin(pieces, kept[kept > 0]))


Wear = Literal["hat", "spectacles"]
"""What a sitter may be given of what the painter's wears."""

COVERS, REACHES = 0.3, 2.0
"""A hat covers at least the first share of the forehead, by what is no hair to the network, and
reaches so far from the face's middle, over half its width, or is unlike the hair below it."""
FACE = 45.0  # Size of the face (`face_size`) in the picture that is cut.
ROOM = 2.4, 2.6, 2.3
"""It lies no further than this beside, above and below the brows' middle (chin 1)."""
BLUR = 0.02  # Colors are compared blurred by so much over the face's size.
LIKE = 2.5
"""What is no further from the crown's colors, in standard deviations, may be a veil's hanging
part, on shoulders, too."""
NECK = 1.05  # The body begins so far below the brows.
PERSON = 0.3  # The crown is where the network sees a person, if that is at least this share of it.
TURNS = 6  # Of the cut.
SAMPLE = 0.01  # Less of a color than this, over the face's squared height, says nothing.
HAIRY, GREY = 0.02, 8.0
"""What hangs beside a face below the brows is hair, not a veil, unless the crown is lighter than
the cheeks, or it is by the first (luma), or is of no hue that hair has: bluer than yellow by the
second (b of Lab)."""
BRIM = 1.8, 0.35
"""Nor so far from the face's middle, over half its width, down to here: that is a brim."""
BESIDE, SURELY = 1.3, 1.5
"""Within the first, over half the face's width, what is no further from the cheeks' colors than
the second, in standard deviations, is skin."""
UNLIKE = 2.6  # Skin is no further from the colors of the cheeks, in standard deviations.
UNLIKE_CROWN, BROW = 3.0, 0.6
"""What is further than the first from the crown's colors is none of it, up to so far above the
brows; higher up there may be a feather or a ribbon."""
CHIN = 0.9  # Nothing that is worn on a head lies below a face from here on.
ALL_AROUND = 0.5
"""What covers more than this of the picture's border above the brows was not separated from the
background."""
GAP, CRUMB = 0.05, 0.03
"""Gaps and crumbs up to this, over the face's height, are closed and left out."""
EDGE = 0.006  # Its edge is soft over so much of the face's height.
LEAST = 0.25  # A thing smaller than this, over the face's squared height, is none.


def headwear(exemplar: Exemplar, regions: Regions | None = None) -> Float32 | None:
    """What a painting's sitter wears on the head, float32 [h, w] in [0, 1]; None for nothing.

    One connected thing without its shade. The painting is seen from the front or turned, and not
    bared (`inpainting`).
    """
    def find() -> dict[str, Array]:
        found = _found(exemplar, regions or exemplar.regions())
        return {} if found is None else {"hat": np.asarray(255 * found + 0.5, np.uint8)}

    key = key_of(__name__, exemplar.image, exemplar.landmarks, exemplar.mask)
    kept = kept_arrays("hats", key, find, most=30)
    mask = kept["hat"].astype(np.float32) / np.float32(255) if kept else None
    if exemplar.by_hand is None:
        return mask
    hat = exemplar.by_hand == BY_HAND.index("hat")
    if mask is None:
        return hat.astype(np.float32) if hat.any() else None
    return np.where(exemplar.by_hand == 0, mask, hat.astype(np.float32))


def hat_beside_hair(exemplar: Exemplar, regions: Regions, found: Forehead) -> Float32 | None:
    """A painting's hat, float32 [h, w] in [0, 1], if hair of other colors shows beside it.

    It is wanted where hair is to be painted: a black hat is no example of fair hair. None if there
    is no hat, no hair beside it, or if that has the hat's colors, as under a bonnet.
    """
    mask = headwear(exemplar, regions)
    if mask is None:
        return None
    small = _Small.of(exemplar, regions, found)
    cut = smaller(mask, (small.right.shape[1], small.right.shape[0])) > 0.5
    return mask if _unlike_hair(small, cut) else None


def not_worn(exemplar: Exemplar, wear: Sequence[Wear]) -> list[str]:
    """Notes, a line each, on what is to be worn and is not there in a painting, as it came."""
    if "hat" in wear and headwear(exemplar.covered or exemplar) is None:
        return [f"{exemplar.name} wears no hat: --wear hat changes nothing"]
    return []


@dataclass
class _Small:
    """A painting at the size that it is cut at; planes [h, w]."""

    image: UInt8
    right: Float32
    down: Float32
    hair: Float32
    person: Float32
    face: Float32
    covered: Bool
    crown: Bool
    forehead: Bool
    half: float
    height: float

    @staticmethod
    def of(exemplar: Exemplar, regions: Regions, found: Forehead) -> _Small:
        frame, shape = regions.frame, exemplar.image.shape
        factor = min(1.0, FACE / exemplar.size)
        size = max(round(factor * shape[1]), 8), max(round(factor * shape[0]), 8)
        right, down = (smaller(plane, size) for plane in frame.local(shape))
        covered, crown, bare = (smaller(part, size) > 0.5
                                for part in (found.covered, found.crown, found.bare))
        half = 0.5 * frame.width / frame.height
        none = np.zeros(shape[:2], np.float32)
        image = cv2.resize(exemplar.image, size, interpolation=cv2.INTER_AREA)
        return _Small(np.asarray(image, np.uint8), right, down,
                      smaller(none if regions.hair is None else regions.hair, size),
                      smaller(regions.person, size),
                      smaller(soft_face(shape, exemplar.landmarks), size) / np.float32(255),
                      covered, crown, bare, half, frame.height * factor)

    def room(self) -> Bool:
        """Where a hat may be."""
        beside, above, below = ROOM
        return (np.abs(self.right) < beside) & (self.down > -above) & (self.down < below)

    def colors(self) -> Float32:
        """Colors in [0, 1] without strokes, float32 [h, w, 3]."""
        picture = self.image.astype(np.float32) / np.float32(255)
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), max(0.5, BLUR * FACE)), np.float32)

    def kernel(self, share: float) -> UInt8:
        """A disk of a radius over the face's height."""
        return disk(share * self.height)


def _found(exemplar: Exemplar, regions: Regions) -> Float32 | None:
    labels = regions.labels()
    forehead = covered_forehead(exemplar, regions, labels)
    picture = SmallPicture(exemplar, regions, labels)
    two_hues = has_two_hues(picture,
                            picture.part(labels[..., PICTURE_LABELS.index("hair")]) > 150)
    if not two_hues and forehead.other < COVERS:
        return None
    small = _Small.of(exemplar, regions, forehead)
    cut = _cut(small)
    if cut is None:
        return None
    above = cut & (small.down < 0)
    reaches = (np.abs(small.right[above]) > REACHES * small.half).any()
    if not (two_hues or reaches or _unlike_hair(small, cut)):
        return None
    if above.sum() < LEAST * small.height ** 2 or _all_around(cut, small.down < 0):
        return None
    soft = cv2.GaussianBlur(cut.astype(np.float32), (0, 0), 1.0)
    shape = exemplar.image.shape
    whole = cv2.resize(soft, shape[1::-1], interpolation=cv2.INTER_CUBIC)
    edge = max(1.0, EDGE * regions.frame.height)
    # As steep as a stroke's edge, whatever size it was cut at.
    steep = max(1.0, regions.frame.height / small.height * 2.5 / (2 * edge))
    return np.asarray(np.clip((whole - 0.5) * steep + 0.5, 0, 1), np.float32)


def _all_around(cut: Bool, above: Bool) -> bool:
    """Whether a cut [h, w] goes on at most of the picture's border ``above`` the brows."""
    border = np.ones(cut.shape, bool)
    border[1:, 1:-1] = False
    return bool((cut & border & above).sum() > ALL_AROUND * (border & above).sum())


def _cut(small: _Small) -> Bool | None:
    """The thing itself, bool [h, w] of the small picture."""
    colors = small.colors()
    cheeks = small.forehead & (small.down > 0.1)
    away = skin_distance(colors, cheeks)
    like_skin = away < UNLIKE
    core = cv2.erode((small.crown | small.covered).astype(np.uint8), small.kernel(0.03)) > 0
    core &= (small.down < -0.5) & ~like_skin & ~small.forehead
    person = core & (np.maximum(small.person, small.hair) > 0.5)
    if person.sum() > PERSON * core.sum():
        core = person
    if core.sum() < 0.01 * small.height ** 2:
        return None
    state = _seeds(small, colors, core, like_skin)
    part = box_about(small.room())
    assert part is not None
    within = np.ascontiguousarray(state[part])
    cv2.setRNGSeed(0)
    back, front = np.zeros((1, 65)), np.zeros((1, 65))
    # It asks for a rectangle, and does not look at it.
    cv2.grabCut(np.ascontiguousarray(small.image[part]), within, (0, 0, 1, 1), back, front, TURNS,
                cv2.GC_INIT_WITH_MASK)  # in place
    state[part] = within
    cut = (state == cv2.GC_FGD) | (state == cv2.GC_PR_FGD)
    beside = np.abs(small.right) / small.half
    cut &= (small.down < -0.02) | _veil(colors, cheeks, core) | (
        (beside > BRIM[0]) & (small.down < BRIM[1]))
    # Hair below its edge is of other colors than its crown.
    alike = skin_distance(colors, core) < UNLIKE_CROWN
    cut &= alike | (beside > BRIM[0]) | (small.down < -BROW)
    cut &= ~((away < SURELY) & (beside < BESIDE) & (small.down > -BROW))
    # A cloth around the neck is no part of what is worn on the head.
    cut &= (small.down < CHIN) | (beside > 1)
    return _one_thing(small, cut, alike, core)


def _seeds(small: _Small, colors: Float32, core: Bool, like_skin: Bool) -> UInt8:
    """Where the cut begins: sure and probable parts of it, by the numbers of `cv2.grabCut`."""
    down = small.down
    state = np.full(down.shape, cv2.GC_PR_BGD, np.uint8)
    away = skin_distance(colors, core)
    alike = (away < UNLIKE_CROWN) | (down < -BROW)
    maybe = (small.hair > 0.5) & (down < 0) | core | small.covered
    state[maybe & alike & ~like_skin] = cv2.GC_PR_FGD
    hanging = away < LIKE
    body = (small.person > 0.5) & (down > NECK) & ~hanging
    state[body | ~small.room()] = cv2.GC_BGD
    state[(small.face > 0.5) & (down > -0.03) | small.forehead] = cv2.GC_BGD
    state[core] = cv2.GC_FGD
    return state


def _unlike_hair(small: _Small, cut: Bool) -> bool:
    """Whether it is of other colors than the hair that shows under it, beside the face."""
    around = cv2.dilate(cut.astype(np.uint8), small.kernel(GAP)) > 0
    hair = (small.hair > 0.5) & ~around & (small.face < 0.1)
    above = cut & (small.down < 0)
    if min(hair.sum(), above.sum()) < SAMPLE * small.height ** 2:
        return False
    return float(np.median(skin_distance(small.colors(), above)[hair])) > UNLIKE_CROWN


def _veil(colors: Float32, cheeks: Bool, core: Bool) -> Bool:
    """What may hang beside a face and is no hair, by its colors: all of a light cloth."""
    light = grey(colors)
    most = np.median(light[cheeks]) if cheeks.any() else 1.0
    if np.median(light[core]) > most:
        return np.ones(core.shape, bool)
    lab = to_lab(colors)
    return np.asarray((light > most + HAIRY) | (lab[..., 2] < -GREY))


def _one_thing(small: _Small, cut: Bool, alike: Bool, core: Bool) -> Bool | None:
    """The piece that sits on the head, without crumbs and holes, closed where it is ``alike``."""
    whole = cv2.morphologyEx(cut.astype(np.uint8), cv2.MORPH_OPEN, small.kernel(CRUMB))
    closed = cv2.morphologyEx(whole, cv2.MORPH_CLOSE, small.kernel(GAP))
    # What shows between two folds is background.
    whole = np.where(alike, closed, whole)
    _, pieces = cv2.connectedComponents(whole)
    counts = np.bincount(pieces[core & (pieces > 0)], minlength=1)
    if not counts.any():
        return None
    one = (pieces == int(counts.argmax())).astype(np.uint8)
    face = (small.face > 0.5) & (small.down > 0) | small.forehead
    return _filled(one > 0, face) & ~face


def _filled(one: Bool, face: Bool) -> Bool:
    """A thing [h, w] without holes, but for those that the face looks out of."""
    _, rest = cv2.connectedComponents(np.pad(~one, 1, constant_values=True).astype(np.uint8),
                                      connectivity=4)
    rest = rest[1:-1, 1:-1]
    open_ones = np.union1d(np.unique(rest[face]), [rest[0, 0], rest[0, -1], rest[-1, 0],
                                                   rest[-1, -1]])
    return one | ~np.isin(rest, open_ones)


CROWN, ABOVE_HEAD = 0.85, 0.06
"""A head without its hair ends this far above the brows (chin -1) at most, a hat so far above."""
HIGHER = 1.5  # A hat is made higher by this factor at most.
JOINED = 0.3
"""The map below the brows goes over into the one above them within so much of the face's height."""
SHADE, DEEPEST = 0.12, 0.45
"""Its shade reaches so far below its edge, over the face's height, and takes at most this share of
the light."""
LIGHT_REACHES = 0.05, 0.15, 0.4, 1.2
"""Background is carried in under removed hair from as far as this, over the face's height."""
SOFT = 0.015  # Removed hair ends softly over so much of the face's height.
FINER = 1.2  # A hat with so many of its pixels per pixel of the photo is made smaller first.


@dataclass(frozen=True)
class Layer:
    """A hat as it lies over a photo."""

    color: Float32  # float32 [H, W, 3] in [0, 1], sRGB.
    cover: Float32  # float32 [H, W] in [0, 1], where it lies.
    light: Float32  # float32 [H, W] in [0, 1], what its shade leaves of the light below it.

    def over(self, image: Float32) -> Float32:
        """A picture [H, W, 3] with it."""
        shaded = image * self.light[..., None]
        return np.asarray(shaded + self.cover[..., None] * (self.color - shaded), np.float32)


class Hat:
    """The hat of a painting's sitter, as he wears it; ``mask`` is its `headwear`."""

    def __init__(self, exemplar: Exemplar, mask: Float32, regions: Regions) -> None:
        self.frame, self.mask = regions.frame, mask
        self.color = _carried_beyond(exemplar.image.astype(np.float32) / np.float32(255), mask,
                                     regions.frame.height)
        self.shade = _shade(exemplar, mask, regions)
        right, down = regions.frame.local(mask.shape)
        half = 0.5 * regions.frame.width / regions.frame.height
        middle = (mask > 0.5) & (np.abs(right) < 0.3 * half)
        self.top = float(-down[middle].min()) if middle.any() else CROWN

    @staticmethod
    def of(exemplar: Exemplar, regions: Regions) -> Hat | None:
        """The hat of a painting, bared or not, with its regions; None if there is none."""
        covered = exemplar.covered
        if covered is not None:
            exemplar, regions = covered, covered.regions()
        mask = headwear(exemplar, regions)
        return None if mask is None else Hat(exemplar, mask, regions)

    def put_on(self, photo: Array, regions: Regions) -> tuple[Array, Regions, Layer]:
        """The hat on the sitter of a photo, uint8 or float in [0, 1], [H, W, 3].

        Returns photo and regions without what sticks out above the hat, and the hat.
        """
        shape = photo.shape[0], photo.shape[1]
        right, down = regions.frame.local(shape)
        color, cover = self._warped(right, down, regions)
        gone = _sticking_out(cover, regions.person, down)
        soft = cv2.GaussianBlur(gone.astype(np.float32), (0, 0),
                                max(0.5, SOFT * regions.frame.height))
        gone_soft = np.maximum(gone, np.clip(2 * soft, 0, 1)).astype(np.float32)
        person = np.asarray(regions.person * (1 - gone_soft), np.float32)
        hair = None if regions.hair is None else np.asarray(regions.hair * (1 - gone_soft),
                                                            np.float32)
        before = np.asarray(photo, np.float32)
        behind = _carried_beyond(before, np.clip(1 - 2 * np.maximum(regions.person, cover), 0, 1),
                                 regions.frame.height)
        mixed = before + gone_soft[..., None] * (behind - before)
        if photo.dtype == np.uint8:
            mixed = np.clip(mixed + 0.5, 0, 255)
        layer = Layer(color, cover, self._light(cover, regions, right, down))
        return np.asarray(mixed, photo.dtype), Regions(regions.landmarks, person, hair), layer

    def _warped(self, right: Float32, down: Float32, regions: Regions) -> tuple[Float32, Float32]:
        """Colors [H, W, 3] and cover [H, W] of the hat at places in the photo's face frame."""
        ours, theirs = self.frame, regions.frame
        wide = (ours.width / ours.height) / (theirs.width / theirs.height)
        above = wide / self._higher(regions, wide)
        share = np.clip(-down / JOINED, 0, 1)
        share = share * share * (3 - 2 * share)
        places = (right * wide)[..., None] * ours.right + (
            down * (1 + share * (above - 1)))[..., None] * ours.down
        places = np.asarray(ours.origin + ours.height * places, np.float32)
        step = ours.height * wide / theirs.height
        planes = np.concatenate([self.color, self.mask[..., None]], axis=-1)
        if step > FINER:
            size = tuple(max(round(side / step), 8) for side in self.mask.shape[::-1])
            places *= np.divide(size, self.mask.shape[::-1], dtype=np.float32)
            planes = cv2.resize(planes, size, interpolation=cv2.INTER_AREA)
        x, y = (np.ascontiguousarray(places[..., axis]) - np.float32(0.5) for axis in range(2))
        # What the painting's border cuts off ends there.
        color = cv2.remap(np.ascontiguousarray(planes[..., :3]), x, y, cv2.INTER_CUBIC,
                          borderMode=cv2.BORDER_REPLICATE)
        cover = cv2.remap(np.ascontiguousarray(planes[..., 3]), x, y, cv2.INTER_LINEAR,
                          borderMode=cv2.BORDER_CONSTANT, borderValue=0.0)
        return (np.asarray(np.clip(color, 0, 1), np.float32),
                np.asarray(np.clip(cover, 0, 1), np.float32))

    def _higher(self, regions: Regions, wide: float) -> float:
        """How much higher it is to be, so that it covers a sitter's crown."""
        outline = regions.outline(np.zeros(1))[0] - regions.frame.origin
        head = float(-outline @ regions.frame.down) / regions.frame.height
        head = CROWN if not np.isfinite(head) else head
        # Hair is pressed down.
        head = head if regions.hair is None else min(head, CROWN)
        return float(np.clip((head + ABOVE_HEAD) * wide / max(self.top, 1e-3), 1.0, HIGHER))

    def _light(self, cover: Float32, regions: Regions, right: Float32, down: Float32) -> Float32:
        """What its shade leaves of the light on the forehead, [H, W]."""
        height = regions.frame.height
        sigma = max(0.5, 0.5 * SHADE * height)
        shift = np.float32(SHADE * height / 3) * regions.frame.down
        moved = cv2.warpAffine(cover, np.array([[1, 0, shift[0]], [0, 1, shift[1]]]),
                               cover.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
        near = cv2.GaussianBlur(moved, (0, 0), sigma)
        half = 0.5 * regions.frame.width / height
        # It falls on the person, below the hat alone.
        where = regions.person * np.clip((1.3 - np.abs(right) / half) / 0.3, 0, 1) * (
            np.clip((0.6 - down) / 0.6, 0, 1))
        return np.asarray(1 - self.shade * near * where, np.float32)


def _carried_beyond(image: Float32, known: Float32, height: float) -> Float32:
    """Colors [h, w, 3] where they are known [h, w], and from the nearest such places elsewhere."""
    step = max(1, int(height / 60))
    size = tuple(max(side // step, 4) for side in image.shape[1::-1])
    weight, colors = smaller(known, size), smaller(image * known[..., None], size)
    total = max(float(weight.sum()), 1e-6)
    out = np.broadcast_to(colors.sum(axis=(0, 1)) / total, colors.shape).astype(np.float32)
    for reach in reversed(LIGHT_REACHES):
        sigma = max(0.5, reach * height / step)
        found = cv2.GaussianBlur(weight, (0, 0), sigma)[..., None]
        here = cv2.GaussianBlur(colors, (0, 0), sigma) / (found + 1e-6)
        out += np.clip(found / 0.05, 0, 1) * (here - out)
    broad = cv2.resize(out, image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    sure = np.clip(2 * known - 1, 0, 1)[..., None]
    return np.asarray(broad + sure * (image - broad), np.float32)


def _shade(exemplar: Exemplar, mask: Float32, regions: Regions) -> float:
    """How much darker the face is painted right below its hat than the cheeks are, in [0, 1]."""
    height = regions.frame.height
    _, down = regions.frame.local(mask.shape)
    side = 2 * max(1, round(SHADE * height)) + 1
    near = cv2.dilate((mask > 0.5).astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    soft = soft_face(mask.shape, exemplar.landmarks, 0.4) > 200
    light = grey(exemplar.image)
    below, cheeks = (light[soft & part & (mask < 0.1)] for part in (
        near & (down < -0.1), (down > 0.15) & (down < 0.6)))
    if min(len(below), len(cheeks)) < 30:
        return 0.0
    share = float(np.median(below)) / max(float(np.median(cheeks)), 1e-3)
    return float(np.clip(1 - share, 0, DEEPEST))


def _sticking_out(cover: Float32, person: Float32, down: Float32) -> Bool:
    """The part of a person [H, W] above a hat's edge that the hat does not cover."""
    rows = np.arange(len(cover))[:, None]
    worn = (cover > 0.5) & (down < 0)
    if not worn.any():
        return np.zeros(cover.shape, bool)
    lowest = np.where(worn, rows, -1).max(axis=0)
    columns = np.flatnonzero(lowest >= 0)
    # Beyond its sides the level of its ends goes on.
    level = np.interp(np.arange(cover.shape[1]), columns, lowest[columns])
    return (rows < level) & (cover < 0.5) & (person > 0.02)
