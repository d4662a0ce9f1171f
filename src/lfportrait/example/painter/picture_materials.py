"""What a picture is made of: shares of `MATERIALS` in each pixel, of a photo or a painting.

Most of it follows from the picture's regions. What lies below the jaw is classified by its color
and place, in a picture made small (`SmallPicture`), and so is a beard; ears by their place alone.

A sitter without a hat has hair and a background there. They must not be painted with a ribbon, or
with a brim that hovers behind the head. What is found in a painting is kept (`known_shares`).
"""

import functools

import cv2
import numpy as np
from scipy.spatial import cKDTree

from ...arrays import Array, Bool, Float32, Floats, Int32, UInt8
from ...cache import kept_arrays, key_of
from ...color import to_lab
from ...labels import BY_HAND, MATERIALS, PICTURE_LABELS
from ...labels import FEATURES as FACE_FEATURES
from ..exemplar import Exemplar
from ..guides.filters import broad_blur, enlarged, gaussian_blur, grey, shrunk, skin_distance
from ..guides.regions import Regions, soft_face

SKIN, HAIR, NECK, CLOTHES, GROUND, FEATURES, EARS = range(7)
PLAIN = 0.08
"""A background whose colors deviate by no more than this (standard deviation) is plain."""
CHEEKS = 0.15, 0.6  # The skin that a neck is compared with lies between these (brows 0, chin 1).
LIKE_PLAIN = ((0.025, 1.5),)  # The same for a plain background.
PURER, LEAST_CHROMA = 1.1, 10.0
"""So many times the chroma of the face's purest tenth, or of greys, is a collar's, no neck's."""
LOOKED_AT = 30.0
"""Colors are compared in a picture whose face is at least of this size: all of it is blurred."""
LIKE_SKIN = (0.05, 3.0), (0.015, 3.5)
"""Blurs, over the face's size, and how far from the skin's colors a neck may be then."""


class SmallPicture:
    """A picture as small as its colors may be compared in, which are blurred anyway.

    Parameters
    ----------
    picture : Painting or photo.
    regions, labels : What is known of it.

    Attributes
    ----------
    image : float32 [h / factor, w / factor, 3] in [0, 1].
    factor : How much smaller it is.
    shape : Height and width of the picture.
    size : Of its face, in the small picture's pixels.
    right, down : float32 [h, w], the picture's pixels in the face's frame.
    """

    def __init__(self, picture: Exemplar, regions: Regions, labels: UInt8) -> None:
        self.factor = int(np.clip(picture.size / LOOKED_AT, 1, 3))
        self.image: Float32 = np.stack(
            [shrunk(plane / np.float32(255), self.factor)
             for plane in np.moveaxis(picture.image.astype(np.float32), -1, 0)], axis=-1)
        self.shape = picture.image.shape[0], picture.image.shape[1]
        self.size = picture.size / self.factor
        self.points, self.labels = picture.landmarks, labels
        self.right, self.down = regions.frame.local(self.shape)
        self._blurred: dict[float, Float32] = {}

    @functools.cached_property
    def face(self) -> Float32:
        """The face without its forehead, soft; float32 [h, w] of the picture in [0, 1]."""
        return soft_face(self.shape, self.points).astype(np.float32) / np.float32(255)

    @functools.cached_property
    def cheeks(self) -> Bool:
        """The part of the face that is bare, of the small picture.

        A forehead may lie under a fringe, or a mask's hair that is none to the network, and a chin
        under a beard. What lies beside the face and is skin to the labels may be locks or a hat.
        """
        down = self.part(self.down)
        return np.asarray(self.plain_skin() & (down > CHEEKS[0]) & (down < CHEEKS[1])
                          & (self.part(self.face) > np.float32(230 / 255)))

    def plain_skin(self) -> Bool:
        """Skin without features, of the small picture."""
        labels = self.part(self.labels)
        features = labels[..., [PICTURE_LABELS.index(name) for name in FACE_FEATURES]]
        skin = labels[..., PICTURE_LABELS.index("skin")]
        return np.asarray((skin > 200) & (features.sum(-1) < 30))

    def part(self, plane: Array) -> Array:
        """Every Nth pixel of a plane of the picture, [h, w]."""
        return plane[::self.factor, ::self.factor]

    def whole(self, plane: Float32) -> Float32:
        """A small plane as large as the picture."""
        return enlarged(plane, self.factor, self.shape)

    def blurred(self, sigma: float) -> Float32:
        """The small picture blurred; ``sigma`` over the face's size."""
        if sigma not in self._blurred:
            self._blurred[sigma] = np.stack(
                [broad_blur(np.ascontiguousarray(self.image[..., c]), sigma * self.size)
                 for c in range(3)], axis=-1)
        return self._blurred[sigma]

    def alike(self, sample: Bool, places: Bool,
              tests: tuple[tuple[float, float], ...], allowed: Float32 | None = None) -> Float32:
        """How much places are of a sample's colors; 0 elsewhere, 1 if the sample is small.

        Several blurs and limits: strokes by their mean, the edge of a collar by itself;
        ``allowed`` scales the limits. All planes are small, [h, w].
        """
        chosen = places | sample
        scale = 1.0 if allowed is None else allowed[chosen]
        out = np.zeros(places.shape, np.float32)
        out[chosen] = np.min([near_to(skin_distance(self.blurred(blur)[chosen], sample[chosen]),
                                    limit * scale) for blur, limit in tests], axis=0)
        return out

    def like_plain_ground(self, body: Bool) -> Float32:
        """How much the body looks like the background; 0 where that is not plain."""
        behind = self.part(self.labels[..., PICTURE_LABELS.index("background")]) > 250
        if not behind.any() or self.image[behind].std(axis=0).max() >= PLAIN:
            return np.zeros(behind.shape, np.float32)
        return self.alike(behind, self.part(body), LIKE_PLAIN)

    def darker(self, plain: Bool, share: float) -> Float32:
        """Where it is darker than all but a share of the plain skin."""
        light = grey(self.blurred(LIKE_SKIN[-1][0]))
        if not plain.any():
            return np.ones_like(light)
        least = np.quantile(light[plain], share)
        return np.asarray(np.clip((least - light) / 0.05, 0, 1), np.float32)

    def pure(self, plain: Bool) -> Float32:
        """Where colors are purer than the plain skin's: shade makes none purer."""
        if not plain.any():
            return np.zeros(plain.shape, np.float32)
        colors = to_lab(self.blurred(LIKE_SKIN[-1][0]))
        chroma = np.hypot(colors[..., 1], colors[..., 2])
        most = PURER * max(float(np.quantile(chroma[plain], 0.9)), LEAST_CHROMA)
        return np.asarray(np.clip((chroma - most) / (0.1 * most) + 0.5, 0, 1), np.float32)


def give(shares: Float32, amount: Float32, source: int, target: int) -> None:
    """Let an amount [...] of one material in shares [..., 7] be another, in place."""
    shares[..., target] += amount
    shares[..., source] -= amount


def near_to(distance: Float32, limit: Floats | float) -> Float32:
    """1 for small distances, 0 for large ones, one half at the limit."""
    return np.asarray(1 / (1 + np.exp(np.clip((distance - limit) / 0.4, -30, 30))), np.float32)


FEW_WORN = 60  # Fewer pixels than this have no color.
BLUR = 0.03  # Colors are compared blurred by so much over the face's size.
TWO_HUES = 26.0
"""Hair whose two most frequent colors are further apart than this in a and b is a cap."""
BESIDE, LITTLE = 0.2, 0.2
"""The cap's color is what lies so near to the face, over its size; the other has so little there,
over what that has."""
EDGED = 1.3  # A cap's paint is no further from its color than this times what is usual.
COLORS, APART = (2, 3), 15.0
"""A background is divided into so many colors; a hat before it differs by this from the others."""
MEETING = 0.08  # Head and background meet within this of each other, over the face's size.
TOUCHING, BORDER, RARE = 0.25, 0.06, 0.01
"""A hat covers so much of the line where head and background meet, above the chin. Of the picture's
border, which is so broad over its size, it covers little: over that share, no more than this times
the difference of the colors."""


def has_two_hues(small: SmallPicture, hair: Bool) -> bool:
    """Whether what is taken for hair, bool [h, w] of a small picture, is a cap with a ribbon.

    Hair has lights and shades, but one hue.
    """
    return _second_hue(small, hair) is not None


def _second_hue(small: SmallPicture, hair: Bool) -> Bool | None:
    """Where a cap has the hue that is not next to the face, bool [h, w]; None if it is hair."""
    if hair.sum() < FEW_WORN:
        return None
    colors = _colors(small, hair)
    found, middles = _clusters(colors, 2)
    if np.linalg.norm(np.diff(middles, axis=0)[0, 1:]) < TWO_HUES:
        return None
    beside = np.bincount(found[_grown(small.part(small.face) > 0.02, BESIDE * small.size)[hair]],
                         minlength=2)
    if beside.min() > LITTLE * beside.max():
        return None
    own = int(beside.argmax())
    # Nor is its edge, where skin and shade are mixed with it.
    away = np.linalg.norm(colors - middles[own], axis=1)
    other = np.zeros(hair.shape, bool)
    other[hair] = (found != own) | (away > EDGED * np.sqrt(np.mean(away[found == own] ** 2)))
    return other


def _part_cap(small: SmallPicture, shares: Float32) -> None:
    """A cap with a ribbon would become stripes of hair; the color next to the face stays."""
    other = _second_hue(small, small.part(shares[..., HAIR]) > 0.6)
    if other is not None:
        _nowhere(small, shares, HAIR, other)


def _part_hat(small: SmallPicture, shares: Float32) -> None:
    """What is taken for background, but lies around the head alone and is of its own color."""
    ground = small.part(shares[..., GROUND]) > 0.6
    if ground.sum() < FEW_WORN:
        return
    above = small.part(small.down) < 1
    meeting = ground & above & _grown(~ground & above, MEETING * small.size)
    width = max(2, round(BORDER * max(ground.shape)))
    border = np.ones(ground.shape, bool)
    border[width:, width:-width] = False
    border &= ground & above
    if min(meeting.sum(), border.sum()) < FEW_WORN:
        return
    colors = _colors(small, ground)
    for count in COLORS:
        found, middles = _clusters(colors, count)
        number = np.full(ground.shape, -1)
        number[ground] = found
        for one in range(count):
            touches, ends = (float((number[part] == one).mean()) for part in (meeting, border))
            away = np.linalg.norm(np.delete(middles, one, axis=0) - middles[one], axis=1).min()
            if touches > TOUCHING and away > APART and ends < RARE * away * touches:
                _nowhere(small, shares, GROUND, _hanging(number == one, meeting))
                return


def _hanging(part: Bool, meeting: Bool) -> Bool:
    """The pieces of a part [h, w] that meet the head."""
    _, pieces = cv2.connectedComponents(part.astype(np.uint8))
    known = np.unique(pieces[meeting & part])
    return np.isin(pieces, known[known > 0])


def _colors(small: SmallPicture, where: Bool) -> Float32:
    """Blurred colors of some pixels, Lab with half the lightness, float32 [N, 3]."""
    colors = to_lab(small.blurred(BLUR)[where]) * [0.5, 1.0, 1.0]
    return np.asarray(colors, np.float32)


def _clusters(colors: Float32, count: int) -> tuple[Int32, Float32]:
    """Which of the most frequent colors each has, int32 [N], and these, float32 [count, 3]."""
    stop = cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.1
    cv2.setRNGSeed(0)
    _, found, middles = cv2.kmeans(colors, count, np.empty(0, np.int32), stop, 3,
                                   cv2.KMEANS_PP_CENTERS)
    return np.asarray(found[:, 0], np.int32), np.asarray(middles, np.float32)


def _grown(part: Bool, radius: float) -> Bool:
    """A part [h, w] with the square of half a side ``radius`` around each pixel."""
    side = 2 * round(radius) + 1
    return np.asarray(cv2.dilate(part.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)


def _nowhere(small: SmallPicture, shares: Float32, material: int, part: Bool) -> None:
    """Take a part of a material out of use, in place."""
    soft = np.clip(2 * small.whole(gaussian_blur(part.astype(np.float32), 1.0)), 0, 1)
    give(shares, shares[..., material] * soft, material, FEATURES)


BARE = 1.12  # Down to here (brows 0, chin 1) it may be neck in the chin's shadow.
LIKE_HAIR = ((0.015, 2.5),)  # The same for hair.
FAR = 0.3  # Far from the jaw it must be nearer by this share.
BEARD = 0.7, 1.0
"""Chin and lip so far from the cheeks' hue, over its spread, begin to be bearded, and are."""
MOUSTACHE = 0.4, 0.7
"""The same of the lip's way to the chin, over the way to the cheeks: it is, and it is not."""
EAR, EAR_BEGINS = (-0.15, 0.75), 0.9
"""Ears lie between these (brows 0, chin 1), and this far from the middle, over half the width."""
FEW = 30  # Fewer pixels than this have no color.
CLOTH, LEAST_CLOTH = (1.5, 4.0), 0.5
"""Most clothes lie so near to their middle color; what is so far from most is none of them, if no
more than the other part is."""
SAME, COMPARED = 6.0, 2000
"""Colors (Lab) that are so near are the same; and how many of each material are compared."""
BARED, OTHER_HUE = (0.05, 0.7), 12.0
"""So much of the clothes is bare skin, if that is so far from the rest in hue and chroma (Lab)."""
STROKES = 0.06  # Clothes and ground are compared blurred by so much: a stroke over the face's size.
BROAD, HUES_APART = 0.1, 12.0
"""Parts of hair and clothes are compared blurred by so much over the face's size; hues so far apart
(a and b of Lab) are two. Of 25 exemplars the halves of the clothes are no further apart than 11.7,
or 15 and more (5); hair beside a face and on the crown no further than 9.3, but for 11.9 (a
stylised portrait), 12.7 (van Gogh's, green on one side), and what is in the dark."""
MIDDLE, LESS = 0.35, 1 / 3
"""The middle of clothes is so broad to each side, over half the face's width. The lit side stays,
but not if it is less than this of the other one."""
CROWN = 0.35
"""The crown lies so far above the brows, over the face's height; beside the face hair hangs lower.
"""
NO_HUE = 15.0
"""Locks darker than this (lightness of Lab) are in the dark rather than of another hue: Mona Lisa's
are of 10, van Gogh's green ones of 27."""
LIKE_GROUND = 1.2
"""Clothes of an exemplar less far from its background's colors than this are taken for it."""


def material_shares(labels: UInt8) -> Float32:
    """Shares of `MATERIALS`, float32 [..., 7], by soft labels, uint8 [..., K]: a body is neck."""
    share = labels.astype(np.float32) / np.float32(255)
    named = {name: share[..., n] for n, name in enumerate(PICTURE_LABELS)}
    out = np.zeros((*labels.shape[:-1], len(MATERIALS)), np.float32)
    for name in FACE_FEATURES:
        out[..., FEATURES] += named[name]
    out[..., SKIN], out[..., HAIR], out[..., NECK] = named["skin"], named["hair"], named["body"]
    out[..., GROUND] = named["background"]
    # Added plane by plane: numpy is slow in adding up a handful of neighbours.
    total = out[..., SKIN] + out[..., HAIR] + out[..., NECK] + out[..., GROUND] + out[..., FEATURES]
    out /= np.maximum(total, np.float32(1e-3))[..., None]
    return out


def picture_shares(picture: Exemplar, regions: Regions, labels: UInt8,
                   strict: bool = True) -> Float32:
    """Shares of `MATERIALS` of a picture with its soft labels, float32 [h, w, 7].

    Below the jaw, what is of the face's color, or right below it, is neck, the rest clothes; and
    where the background is plain, what looks like it there is background.

    ``strict`` is for heads, whose necks are seen from all sides: a neck must be alike the cheeks,
    the more so the further away, or lie in the chin's shadow; what hangs there may be hair; and
    paper in the color of skin is skin. Else all right below the jaw is neck: for photos, whose
    bodies are painted of it.
    """
    return _shares(SmallPicture(picture, regions, labels), regions, strict)


def _shares(small: SmallPicture, regions: Regions, strict: bool) -> Float32:
    """`picture_shares` of a picture that has been made small."""
    shares = material_shares(small.labels)
    # Labels fall off gently beyond the outline: what lies there is background all the same.
    shares[regions.person < 0.5] = np.eye(len(MATERIALS), dtype=np.float32)[GROUND]
    body = shares[..., NECK] > 0.02
    if not body.any():
        return shares
    right, down = small.right, small.down
    if strict:
        plain = small.cheeks
        # Shoulders and chest may be bare, but coats are larger.
        far = np.clip((np.hypot(right / 0.8, np.maximum(down - 0.8, 0)) - 0.5) / 0.5, 0, 1)
        alike = small.alike(plain, small.part(body), LIKE_SKIN,
                            np.asarray(1 - FAR * small.part(far), np.float32))
        pure = small.whole(small.pure(plain))
        alike = small.whole(alike) * (1 - pure)
    else:
        plain = small.plain_skin()
        alike = small.whole(small.alike(plain, small.part(body), LIKE_SKIN[:1]))
    bare, other = shares[..., NECK] * alike, shares[..., NECK] * (1 - alike)
    ground = small.whole(small.like_plain_ground(body))
    shares[..., GROUND] += ground * (other if strict else other + bare)
    other *= 1 - ground
    shadow = np.asarray(np.clip((BARE - down) / 0.15, 0, 1), np.float32)
    # Not beside the chin: there a collar's edge is as dark.
    half = 0.5 * regions.frame.width / regions.frame.height
    shadow *= np.clip(((0.85 if strict else 1.05) * half - np.abs(right)) / 0.1, 0, 1)
    if strict:
        if regions.hair is not None:
            shares[..., HAIR] += other * regions.hair
            other *= 1 - regions.hair
        shadow *= small.whole(small.darker(plain, 0.25))
        shadow *= 1 - pure
    else:
        bare *= 1 - ground
    shares[..., NECK] = bare + shadow * other
    shares[..., CLOTHES] = (1 - shadow) * other
    return shares


def _overlooked(small: SmallPicture, skin: Float32) -> Float32:
    """Shares of ``skin`` [h, w] that are hair, by their colors: hair's, not the cheeks'."""
    face = np.where(small.part(small.down) < 0, np.float32(0), small.part(small.face))
    plain = small.cheeks
    known = small.part(small.labels[..., PICTURE_LABELS.index("hair")]) > 200
    looked_at = small.part(skin) > 0.02
    hair = 1 - small.alike(plain, looked_at, LIKE_SKIN)
    hair *= small.alike(known, looked_at, LIKE_HAIR)
    hair *= small.darker(plain, 0.75)
    hair *= 1 - gaussian_blur(np.ascontiguousarray(face), LIKE_SKIN[-1][0] * small.size)
    return skin * small.whole(hair)


def _beard(small: SmallPicture, skin: Float32) -> Float32:
    """Shares of ``skin`` [h, w] that are a beard.

    Chin and upper lip under a beard are alike, and both are of another hue than the cheeks; shade
    is not, and paint that differs from chin to lip is none. What is more like that chin than like
    the cheeks is beard.
    """
    points, plain = small.points, small.cheeks
    chin = _between(small, points[57], points[8], (0.25, 0.9), 0.6)
    lip = _between(small, points[33], points[51], (0.2, 0.85), 1.2)
    low = (small.part(small.down) > CHEEKS[1] - 0.05) & (small.part(skin) > 0.02)
    if min(part.sum() for part in (plain, chin, lip)) < FEW:
        return np.zeros_like(skin)
    chosen = low | plain | chin | lip
    colors = small.blurred(LIKE_SKIN[0][0] / 2)[chosen]
    sure = _bearded(*(colors[part[chosen]] for part in (plain, chin, lip)))
    if sure == 0:
        return np.zeros_like(skin)
    beard = np.zeros(low.shape, np.float32)
    to_plain, to_chin = (skin_distance(colors, part[chosen]) for part in (plain, chin))
    beard[chosen] = sure * np.clip(0.5 + (to_plain - to_chin) / 0.4, 0, 1)
    return skin * small.whole(beard * low)


def _bearded(plain: Float32, chin: Float32, lip: Float32) -> float:
    """How surely chin and lip are bearded, by chroma over lightness, which shade keeps."""
    looks = [lab[..., 1:] / (lab[..., :1] + 10) for lab in map(to_lab, (plain, chin, lip))]
    skin, below, above = (np.median(part, axis=0) for part in looks)
    apart = min(float(np.linalg.norm(part - skin)) for part in (below, above))
    spread = np.linalg.norm(looks[0].std(axis=0)) + 0.02
    unlike = np.linalg.norm(above - below) / max(apart, 1e-3)
    (least, most), (alike, other) = BEARD, MOUSTACHE
    return float(np.clip((apart / spread - least) / (most - least), 0, 1)
                 * np.clip((other - unlike) / (other - alike), 0, 1))


def _beside(small: SmallPicture, regions: Regions) -> Float32:
    """Where ears are, if they show: beside the face, from the brows to the mouth; [h, w]."""
    upright = np.clip(np.minimum(small.down - EAR[0], EAR[1] - small.down) / 0.05 + 0.5, 0, 1)
    half = 0.5 * regions.frame.width / regions.frame.height
    aside = np.clip((np.abs(small.right) / half - EAR_BEGINS) / 0.05 + 0.5, 0, 1)
    return np.asarray(upright * aside * np.clip(2 * (0.75 - small.face), 0, 1), np.float32)


def _between(small: SmallPicture, top: Floats, bottom: Floats,
             along: tuple[float, float], across: float) -> Bool:
    """A part of the way from one landmark to another, so wide to both sides; of a small picture."""
    way = (bottom - top) / max(float((bottom - top) @ (bottom - top)), 1e-6)
    rows, columns = small.factor * np.indices(small.image.shape[:2])
    x, y = columns - top[0], rows - top[1]
    down, right = x * way[0] + y * way[1], x * way[1] - y * way[0]
    return np.asarray((down > along[0]) & (down < along[1]) & (np.abs(right) < across))


def painted_shares(exemplar: Exemplar, regions: Regions, labels: UInt8,
                   strict: bool = True) -> Float32:
    """Shares of `MATERIALS` of a painting, float32 [h, w, 7]: `picture_shares`, and a little more.

    What is dark and unlike the cheeks around the face is hair: a fringe, a hat, locks at the
    temples that the networks overlook. Clothes of the colors of the background are background
    beside the neck, and clothes are of one cloth. For heads (``strict``), a beard is a feature of
    the face, and ears are no skin. For photos neck and clothes are as for heads; the rest is none.
    """
    small = SmallPicture(exemplar, regions, labels)
    shares = _shares(small, regions, strict)
    if not strict:
        known = _shares(small, regions, True)
        collar = np.maximum(shares[..., NECK] - known[..., NECK], 0)
        # A brown coat has a shaded cheek's colors, but is worn all the same.
        coat = np.minimum(collar, np.maximum(known[..., CLOTHES] - shares[..., CLOTHES], 0))
        shares[..., NECK] -= collar
        shares[..., CLOTHES] += coat
        shares[..., FEATURES] += collar - coat
    give(shares, _overlooked(small, shares[..., SKIN]), SKIN, HAIR)
    if strict:
        give(shares, _beard(small, shares[..., SKIN]), SKIN, FEATURES)
        shares[..., EARS] = shares[..., SKIN] * _beside(small, regions)
        shares[..., SKIN] -= shares[..., EARS]
    # A cap's second color is no hair, and a hat beyond the head no background: painted nowhere.
    _part_cap(small, shares)
    _part_hat(small, shares)
    hide_ground(small, shares)
    _bare_shoulders(small, shares)
    _part_clothes(small, shares)
    return shares


def hide_ground(small: SmallPicture, shares: Float32) -> None:
    """Let clothes of the colors of the background be background, in place."""
    behind, worn = shares[..., GROUND] > 0.98, shares[..., CLOTHES] > 0.02
    if not worn.any() or behind.sum() < 50:
        return
    there = small.part(behind)
    chosen = there | small.part(worn)
    alike = np.zeros(there.shape, np.float32)
    # By the mean of their strokes: single ones of a coat may have the colors of some of the ground.
    colors = small.blurred(STROKES)[chosen]
    alike[chosen] = skin_distance(colors, there[chosen]) < LIKE_GROUND
    alike = small.whole(gaussian_blur(alike, 0.008 * max(there.shape)))
    ground = shares[..., CLOTHES] * np.clip(2 * alike - np.float32(0.5), 0, 1)
    give(shares, ground, CLOTHES, GROUND)


def _bare_shoulders(small: SmallPicture, shares: Float32) -> None:
    """Let lit skin that was taken for clothes be painted nowhere, in place.

    A lit shoulder is paler than the cheeks that a neck is compared with, but has the colors of a
    forehead or a nose. Only where its hue is not the clothes', and it is lit: a coat may be as
    brown as shaded skin, and linen as white as a highlight.
    """
    worn = small.part(shares[..., CLOTHES]) > 0.5
    skin = small.part(shares[..., [SKIN, NECK, EARS]].sum(axis=-1)) > 0.8
    if min(worn.sum(), skin.sum()) < FEW:
        return
    image = small.blurred(LIKE_HAIR[0][0] * 2)
    ours, theirs = (to_lab(image[part][::max(1, int(part.sum()) // COMPARED)])
                    for part in (worn, skin))
    away = cKDTree(theirs).query(ours, k=min(3, len(theirs)))[0][:, -1]
    bare = (away < SAME) & (ours[:, 0] > np.median(theirs[:, 0]))
    if not BARED[0] < bare.mean() < BARED[1]:
        return
    middles = [np.median(ours[part], axis=0) for part in (bare, ~bare)]
    if np.linalg.norm((middles[0] - middles[1])[1:]) < OTHER_HUE:
        return
    like = np.zeros(worn.shape, np.float32)
    to_bare, to_cloth = (np.linalg.norm(to_lab(image[worn]) - middle, axis=1)
                         for middle in middles)
    like[worn] = to_bare < to_cloth
    give(shares, shares[..., CLOTHES] * small.whole(like), CLOTHES, FEATURES)


def _part_clothes(small: SmallPicture, shares: Float32) -> None:
    """Let what is far from most of the clothes' colors be none, in place.

    Hands, a bare chest, the shade beside a neck, a collar: on a sitter's shoulder they would be
    stains. They are painted nowhere.
    """
    worn = small.part(shares[..., CLOTHES]) > 0.5
    if worn.sum() < FEW:
        return
    colors = small.blurred(LIKE_HAIR[0][0] * 2)[worn]
    most = skin_distance(colors, np.ones(len(colors), bool)) < CLOTH[0]
    like = np.ones(worn.shape, np.float32)
    like[worn] = near_to(skin_distance(colors, most), CLOTH[1])
    if most.sum() < FEW or like[worn].mean() < LEAST_CLOTH:
        return
    give(shares, shares[..., CLOTHES] * (1 - small.whole(like)), CLOTHES, FEATURES)


def one_hue(exemplar: Exemplar, regions: Regions, labels: UInt8, shares: Float32) -> None:
    """Let clothes and hair be of one hue, in place: what has another one is painted nowhere.

    A coat is green in the light and brown in the shade, hair is fair on the crown and green behind
    a temple. That is the painter's light: a sitter with both has two coats, or stains in his hair.
    Stripes, dots and strokes of several hues stay, as what is compared is broader. Not before a
    neck has been compared with all that is worn (`plain_skin`). What was painted over by hand as
    hair stays.
    """
    small = SmallPicture(exemplar, regions, labels)
    by_hand = _is_by_hand(exemplar if exemplar.covered is None else exemplar.covered, "hair")
    given = shares[by_hand]
    half = 0.5 * regions.frame.width / regions.frame.height
    right, down = small.part(small.right), small.part(small.down)
    worn = small.part(shares[..., CLOTHES]) > 0.5
    sides = [worn & (way * right > MIDDLE * half) for way in (-1, 1)]
    if min(side.sum() for side in sides) > FEW_WORN:
        colors = _broad_colors(small, shares[..., CLOTHES])
        light = [float(np.median(colors[side][:, 0])) for side in sides]
        lit = int(light[1] > light[0])
        if sides[lit].sum() < LESS * sides[1 - lit].sum():
            lit = 1 - lit
        _like_part(small, shares, CLOTHES, colors, (sides[lit], sides[1 - lit]))
    hair = small.part(shares[..., HAIR]) > 0.6
    crown = hair & (down < -CROWN) & (np.abs(right) < half)
    beside = hair & (down > -CROWN) & (down < 1) & (np.abs(right) > half)
    if min(crown.sum(), beside.sum()) > FEW_WORN:
        colors = _broad_colors(small, shares[..., HAIR])
        if 2 * np.median(colors[beside][:, 0]) > NO_HUE:
            _like_part(small, shares, HAIR, colors, (crown, beside))
    shares[by_hand] = given


def _broad_colors(small: SmallPicture, share: Float32) -> Float32:
    """Lab with half the lightness, blurred within a material by its share [H, W]: [h, w, 3].

    Within it: a narrow rim of dark hair is no lighter for the forehead below it.
    """
    share = np.ascontiguousarray(small.part(share))
    total = np.maximum(broad_blur(share, BROAD * small.size), np.float32(1e-3))
    image = np.stack([broad_blur(small.image[..., c] * share, BROAD * small.size) / total
                      for c in range(3)], axis=-1)
    return np.asarray(to_lab(image) * [0.5, 1.0, 1.0], np.float32)


def _like_part(small: SmallPicture, shares: Float32, material: int, colors: Float32,
               parts: tuple[Bool, Bool]) -> None:
    """Let a material be what is like the first of two parts, if the second has another hue.

    In place; ``colors`` [h, w, 3] are those of `_broad_colors`.
    """
    own, other = (np.median(colors[part], axis=0) for part in parts)
    if np.linalg.norm((own - other)[1:]) < HUES_APART:
        return
    to_own, to_other = (np.linalg.norm(colors - middle, axis=-1) for middle in (own, other))
    _nowhere(small, shares, material, to_other < to_own)


MOST_KEPT = 30  # Paintings that are kept: six megabytes for one of 768 x 1024.
HAT_EDGE, OWN_HAIR = 0.05, 0.25
"""Hair beside a hat lies so far from its outline, over the face's size, where they are not mixed;
and less of it than this, over that squared, is no example of hair."""
FEW_ALIKE, CLOTH_APART = 500, 10.0
"""Two parts of the hair, of more pixels than this, differ if their colors do by this in Lab."""
STEPS = np.float32(255)
"""Shares are kept in so many steps: the labels that they come from have no more."""


def known_shares(exemplar: Exemplar, regions: Regions, labels: UInt8,
                 strict: bool = True) -> Float32:
    """`painted_shares`, from the user's cache where they have been found before.

    In steps of 1/255; ``labels`` are the regions' own.
    """
    if exemplar.covered is not None and exemplar.bared is not None:
        return _bared_shares(exemplar, regions, exemplar.covered, exemplar.bared, strict)

    def find() -> dict[str, Array]:
        shares = painted_shares(exemplar, regions, labels, strict)
        return {"shares": np.asarray(shares * STEPS + np.float32(0.5), np.uint8)}

    key = key_of(__name__, exemplar.image, exemplar.landmarks, regions.person, regions.hair, strict)
    # A file keeps rounded numbers: the first run continues with the numbers that the next one
    # reads.
    kept = kept_arrays("materials", key, find, most=MOST_KEPT)["shares"]
    shares = kept.astype(np.float32) / STEPS
    if exemplar.by_hand is not None:
        _paint_over(shares, exemplar.by_hand, labels)
    return shares


def _paint_over(shares: Float32, by_hand: UInt8, labels: UInt8) -> None:
    """Let regions that were painted over by hand be what was painted, in place.

    What is skin by hand leaves the face its brows, eyes, nose and lips, and its ears; a hat is
    painted nowhere.
    """
    for name, material in (("hair", HAIR), ("hat", FEATURES), ("neck", NECK), ("skin", SKIN),
                           ("background", GROUND)):
        here = by_hand == BY_HAND.index(name)
        if name == "skin":
            own, ears = np.zeros_like(shares[here]), shares[here][:, EARS]
            face = labels[here][:, [PICTURE_LABELS.index(one) for one in FACE_FEATURES]].sum(
                axis=1, dtype=np.float32)
            own[:, FEATURES] = np.minimum(face / STEPS, 1 - ears)
            own[:, EARS] = ears
            own[:, SKIN] = 1 - own[:, FEATURES] - ears
            shares[here] = own
        else:
            shares[here] = np.eye(len(MATERIALS), dtype=np.float32)[material]


def _is_by_hand(exemplar: Exemplar, name: str) -> Bool:
    """Where a region was painted by hand, bool [H, W]."""
    if exemplar.by_hand is None:
        return np.zeros(exemplar.image.shape[:2], bool)
    return np.asarray(exemplar.by_hand == BY_HAND.index(name))


def _one_cloth(image: UInt8, shares: Float32, own: Bool, above: Bool) -> None:
    """Let the smaller of two parts of the hair be painted nowhere if their colors differ; in place.

    ``own`` [h, w] was taken for hair, ``above`` is the hat or linen over the forehead: hair of both
    would have patches.
    """
    if min(own.sum(), above.sum()) < FEW_ALIKE:
        return
    middles = [np.median(to_lab(image[part][::max(1, int(part.sum()) // FEW_ALIKE)]), axis=0)
               for part in (own, above)]
    if np.linalg.norm(middles[0] - middles[1]) > CLOTH_APART:
        less = own if own.sum() < above.sum() else above
        shares[..., FEATURES] += shares[..., HAIR] * less
        shares[..., HAIR] *= ~less


def _hat_or_hair(small: SmallPicture, regions: Regions, hat: Float32) -> Float32 | None:
    """Where a hat is, rather than the hair that shows beside it, float32 [h, w] in [0, 1].

    By their colors: a hat's outline runs through the hair below its brim. None if there is too
    little hair.
    """
    worn = small.part(hat) > 0.5
    hair = np.zeros(worn.shape, bool) if regions.hair is None else small.part(regions.hair) > 0.5
    hair &= ~_grown(worn, HAT_EDGE * small.size) & (small.part(small.face) < 0.1)
    if hair.sum() < OWN_HAIR * small.size ** 2 or worn.sum() < FEW_WORN:
        return None
    colors = small.blurred(BLUR)
    # Twice: of what was taken for hair some belongs to the hat.
    for _ in range(2):
        to_hair, to_hat = (skin_distance(colors, part) for part in (hair, worn))
        hair &= to_hair < to_hat
        if hair.sum() < FEW_WORN:
            return None
    return np.maximum(small.whole(gaussian_blur((to_hair > to_hat).astype(np.float32), 1.0)), hat)


def _bared_shares(exemplar: Exemplar, regions: Regions, covered: Exemplar,
                  bared: Float32, strict: bool) -> Float32:
    """Shares of a painting whose forehead was bared: skin there, hair above, else as before.

    They are not found in the bared picture: its forehead is no sample of the painter's skin.
    """
    before = covered.regions()
    labels = before.labels()
    shares = known_shares(covered, before, labels, strict)
    worn = None if exemplar.hat is None else _hat_or_hair(
        SmallPicture(covered, before, labels), before, exemplar.hat)
    if worn is not None:
        worn[_is_by_hand(covered, "hair")] = 0
        give(shares, shares[..., HAIR] * worn, HAIR, FEATURES)
    if regions.hair is not None:
        own = shares[..., HAIR].copy()
        hair = regions.hair if worn is None else regions.hair * (1 - worn)
        more = np.clip(hair - own, 0, 1)[..., None]
        shares += more * (np.eye(len(MATERIALS), dtype=np.float32)[HAIR] - shares)
        _one_cloth(exemplar.image, shares, own > 0.5, more[..., 0] > 0.5)
    shares += bared[..., None] * (np.eye(len(MATERIALS), dtype=np.float32)[SKIN] - shares)
    return shares
