"""A painting without what covers the forehead, and without spectacles.

The broad colors of bare skin go on over the hole; strokes come from the painter's own skin, as
patches that agree with each other and with what is around.
"""

from dataclasses import replace

import cv2
import numpy as np

from ...arrays import Array, Bool, Float32, Floats, UInt8, box_about
from ...cache import kept_arrays, key_of
from ...color import to_uint8
from ...face import drawn_spectacles, find_spectacles, spectacle_lenses
from ...labels import MATERIALS, PICTURE_LABELS
from ..exemplar import Exemplar
from ..guides.filters import blurred_within, dilated, grey, smaller
from ..guides.regions import FaceFrame, Regions, polygon
from ..kernels.patches import ACTIVE, FIXED, OUTSIDE
from ..painter.materials import ExemplarMaterials, main_material, nearest_of_material, pieces
from ..painter.patch_painter import GuideWeights, PatchPainter, PatchRequest, PhotoAtlas
from ..painter.picture_materials import FEATURES, SKIN
from ..patches import PatchSearch
from .hat import HIDES, covered_forehead, hat_beside_hair

MOST = 0.8
"""A forehead is bared if something else than hair hides it (`HIDES`), or if more than this share of
it is covered by anything."""
FRINGE = 0.45  # The same share for a sitter whose own forehead is bare.
NEARLY = 20.0  # Foreheads of faces turned by more degrees are not looked at.
GROWN, SOFT = 0.035, 0.012
"""The hole is larger than the cover by so much, and ends softly over so much, over the face's
height: paint at a cover's edge is of both."""
BROW, EDGE = 0.04, 0.02
"""Brows are darker than skin by this, and not so near to the cover, over the face's height."""
AROUND = 0.1  # So much around the hole the patches agree with, over the face's height.
CENTRAL = 0.6  # Skin counts by how near it is to the middle: sigma over half the face's width.
BROAD, REACHES = 0.07, (1.2, 0.6, 0.3, 0.15, 0.08)
"""Colors broader than the first number come from the skin around the hole, which is looked for as
far away as the others, from broad to narrow; over the face's height."""
BESIDE_RIMS, RIMS = 0.02, (0.2, 0.1, 0.05, 0.03)  # The same beside the rims of spectacles.
SMALL = 4  # Broad colors are computed every Nth pixel.
RIM, SHADE, THROUGH = 0.15, 0.02, np.float32(0.1)
"""What is so surely a rim is filled; rims have a shade and glints of this breadth, over the face's
height, which are filled beside the nose; and the weight of what is seen through a lens."""


def bared(exemplar: Exemplar, fringe: bool = False) -> Exemplar:
    """A painting, seen from the front or nearly so, whose forehead is bare: itself, if it is.

    ``fringe``: whether its hair is taken from the forehead, too.
    """
    if abs(exemplar.pose().yaw) > NEARLY:
        return exemplar

    regions = exemplar.regions()

    def find() -> dict[str, Array]:
        return _found(exemplar, regions, fringe) or {}

    key = key_of(__name__, exemplar.image, exemplar.landmarks, regions.person, regions.hair, fringe,
                 exemplar.mask, exemplar.by_hand)
    found = kept_arrays("bared", key, find, most=30)
    if not found:
        return exemplar
    person, hair, hole, hat = (found[name].astype(np.float32) / np.float32(255)
                               for name in ("person", "hair", "hole", "hat"))
    return replace(exemplar, image=found["image"], mask=person, hair=hair, covered=exemplar,
                   bared=hole, hat=hat if hat.any() else None, by_hand=None)


def without_spectacles(exemplar: Exemplar) -> Exemplar:
    """A painting without the spectacles that its sitter wears; itself, if there are none."""
    def find() -> dict[str, Array]:
        shape, points = exemplar.image.shape[:2], exemplar.landmarks
        worn = find_spectacles(exemplar.image, points)
        if worn is None:
            return {}
        height = FaceFrame.of(points).height
        # Strong rims shine and shade within themselves: a nose between them stays.
        lines = drawn_spectacles(worn, shape, min(worn.width, worn.unsure)) > RIM
        behind = spectacle_lenses(worn, shape, points) > 0
        nose = polygon(shape, np.concatenate([points[27:28], points[[31, 33, 35]]])) > 0
        # Beside an eye or a brow that the rims cross, its own paint is worth more.
        features = dilated(_drawn_features(points, shape), BROW * height)
        kept = nose | (features & ~behind)
        hole = lines | ((behind | dilated(lines, SHADE * height)) & ~kept)
        # Rims have a shade; and what is seen through a lens counts less than what lies around it.
        # An eye above them is no light of a cheek: it would be a dark smear.
        eyes = [polygon(shape, points[first:first + 6]) > 0 for first in (36, 42)]
        apart = dilated(lines, SHADE * height) | dilated(eyes[0] | eyes[1], BROW * height)
        beside = np.where(apart, np.float32(0), np.float32(1))
        broad = _spread(exemplar.image, beside * np.where(behind & ~nose, THROUGH, np.float32(1)),
                        height, RIMS)
        bare = dilated(hole, 2 * AROUND * height) & (beside > 0) & ~behind
        return {"image": _filled(exemplar, bare, hole, broad, height, BESIDE_RIMS)}

    key = key_of(__name__, "spectacles, shade, eyes", exemplar.image, exemplar.landmarks)
    found = kept_arrays("bared", key, find, most=30)
    return replace(exemplar, image=found["image"]) if found else exemplar


def _drawn_features(points: Floats, shape: tuple[int, ...]) -> Bool:
    """Eyes with their brows, from landmarks [68, 2]; bool [h, w]."""
    size = shape[0], shape[1]
    return np.logical_or.reduce([
        polygon(size, np.concatenate([points[brow], points[eye]])[order]) > 0
        for brow, eye, order in ((slice(17, 22), slice(36, 42), [0, 1, 2, 3, 4, 8, 9, 10, 5]),
                                 (slice(22, 27), slice(42, 48), [0, 1, 2, 3, 4, 8, 9, 10, 5]))])


def _found(exemplar: Exemplar, regions: Regions, fringe: bool) -> dict[str, Array] | None:
    """The picture and its mattes, uint8, or None where it is bare already."""
    labels = regions.labels()
    forehead = covered_forehead(exemplar, regions, labels)
    if forehead.other < HIDES and forehead.share < (FRINGE if fringe else MOST):
        return None
    height = regions.frame.height
    hole = dilated(forehead.covered > 0.5, GROWN * height)
    bare = forehead.bare * ~hole
    broad = _spread(exemplar.image, _central(forehead.lit * ~hole, regions), height)
    # Brows stay, as dark as they are; linen at their edge goes, with its shade.
    brows = labels[..., PICTURE_LABELS.index("brows")] > 100
    dark = grey(exemplar.image) < grey(broad) - BROW
    brows &= dilated(dark, 0.01 * height) & ~dilated(forehead.covered > 0.5, EDGE * height)
    hole &= ~brows
    image = _filled(exemplar, bare > 0.5, hole, broad, height)
    # What lies above is where hair is: a sitter's forehead ends there.
    soft = cv2.GaussianBlur(hole.astype(np.float32), (0, 0), max(0.5, SOFT * height))
    hair = np.zeros_like(soft) if regions.hair is None else regions.hair
    above = np.maximum(hair, regions.person * forehead.crown) * (1 - soft)
    person = np.maximum(regions.person, soft)
    hat = hat_beside_hair(exemplar, regions, forehead)
    return {"image": image, **{name: np.asarray(255 * matte + 0.5, np.uint8)
                               for name, matte in (("person", person), ("hair", above),
                                                ("hole", soft),
                                                ("hat", 0 * soft if hat is None else hat))}}


def _central(bare: Float32, regions: Regions) -> Float32:
    """Weights of bare skin [h, w] by how far it faces as a forehead does: nose and inner cheeks."""
    frame = regions.frame
    right, _ = frame.local(bare.shape)
    return np.asarray(bare * np.exp(-(right / (CENTRAL * 0.5 * frame.width / frame.height)) ** 2),
                      np.float32)


def _filled(exemplar: Exemplar, bare: Bool, hole: Bool, broad: Float32, height: float,
            beyond: float = BROAD) -> UInt8:
    """The picture with strokes of bare places in the hole, uint8 [h, w, 3].

    ``broad`` [h, w, 3] are the colors there, broader than ``beyond`` over the face's height.
    """
    part = box_about(hole | bare, round(AROUND * height) + 8)
    assert part is not None
    picture = exemplar.image[part].astype(np.float32) / np.float32(255)
    inside = hole[part]
    strokes = _strokes(replace(exemplar, image=exemplar.image[part], mask=None, by_hand=None),
                       inside, bare[part] & ~inside, grey(broad[part]), height)
    filled = strokes - blurred_within(strokes, inside, beyond * height) + broad[part]
    soft = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), max(0.5, SOFT * height))
    mixed = picture + np.maximum(2 * soft - 1, 0)[..., None] * (np.clip(filled, 0, 1) - picture)
    out = exemplar.image.copy()
    out[part] = to_uint8(mixed)
    return out


def _spread(image: UInt8, weight: Float32, height: float,
            reaches: tuple[float, ...] = REACHES) -> Float32:
    """Broad colors in [0, 1] of a picture [h, w, 3] known by weights [h, w], carried on."""
    picture = image.astype(np.float32) / np.float32(255)
    size = tuple(max(side // SMALL, 8) for side in picture.shape[1::-1])
    known, colors = smaller(weight, size), smaller(picture * weight[..., None], size)
    mean = colors.sum(axis=(0, 1)) / max(float(known.sum()), 1e-6)
    out = np.broadcast_to(mean, colors.shape).astype(np.float32)
    for reach in reaches:
        sigma = reach * height / SMALL
        total = cv2.GaussianBlur(known, (0, 0), sigma)[..., None]
        here = cv2.GaussianBlur(colors, (0, 0), sigma) / (total + 1e-4)
        sure = np.clip(total / 0.15, 0, 1)
        out = np.asarray(out + sure * (here - out), np.float32)
    return np.asarray(cv2.resize(out, picture.shape[1::-1], interpolation=cv2.INTER_CUBIC),
                      np.float32)


def _strokes(exemplar: Exemplar, inside: Bool, bare: Bool, tone: Float32, height: float,
             ) -> Float32:
    """A picture with the hole laid out with patches of its bare skin, float32 [h, w, 3]."""
    one = np.eye(len(MATERIALS), dtype=np.float32)
    painter = PatchPainter(exemplar, one[np.where(bare, SKIN, FEATURES)], PatchSearch(), 0,
                           sharp=False, weights=GuideWeights(hue=0.0))  # strokes alone are used
    _, theirs = painter.source(1.0)
    near = dilated(inside, AROUND * height)
    # Strokes agree with skin around the hole, not with hair and hats.
    state = np.where(inside, ACTIVE, np.where(near & bare, FIXED, OUTSIDE)).astype(np.uint8)
    picture = exemplar.image.astype(np.float32) / np.float32(255)
    request = _request(theirs, inside, tone, picture, state, exemplar.size)
    painted = painter.paint(PhotoAtlas((inside.shape[0], inside.shape[1])), 1.0, request)
    return np.where(inside[..., None], painted, picture)


def _request(theirs: ExemplarMaterials, inside: Bool, tone: Float32, picture: Float32,
             state: UInt8, size: float) -> PatchRequest:
    """Skin of the tones asked for, from anywhere."""
    count = inside.size
    y, x = np.mgrid[:inside.shape[0], :inside.shape[1]]
    plane = np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float32) + np.float32(0.5)
    shares = np.broadcast_to(np.eye(len(MATERIALS), dtype=np.float32)[SKIN],
                             (count, len(MATERIALS)))
    material = main_material(shares)
    wanted = nearest_of_material(material, theirs, plane)
    asked = np.ascontiguousarray(tone.reshape(-1))
    begin = np.where(inside.reshape(-1)[:, None],
                     pieces(material, theirs, wanted, plane, asked, size), plane)
    none = np.zeros(count, np.float32)
    sure = np.tile(np.array([0, 1], np.float32), (count, 1))
    return PatchRequest(np.ascontiguousarray(shares), asked, none, wanted, begin, none, sure, state,
                        picture, 4.0)
