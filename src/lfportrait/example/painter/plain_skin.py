"""What of an exemplar's skin is not plain: strands of hair, the outline, what frames features.

A lock over a cheek, a curl, a single stroke: copied onto every sitter it would be a scratch. It is
a thin dark line of the hair's colors that comes from the hair. Wrinkles do not come from there, and
where a face is drawn in lines altogether, lines are its skin.

Labels end where a feature ends; what frames it (the folds of lids, the shade under a lip) would
still be read as lids and lips on a chest. So features reach further, where skin is taken from for
other places than the face. Below the jaw and at the sides of the face, what is more like hair,
clothes and background than like forehead and cheeks is no paint for skin; a beard stays where the
face is copied.
"""

import cv2
import numpy as np
from PIL import Image, ImageDraw

from ...arrays import Bool, Float32, Float64, Floats, UInt8
from ...labels import FEATURES as FACE_FEATURES
from ...labels import PICTURE_LABELS
from ..exemplar import Exemplar, face_size
from ..guides.filters import broad_blur, disk, gaussian_blur, grey, skin_distance, smaller
from ..guides.regions import FaceFrame, Regions, soft_face
from .picture_materials import CLOTHES, EARS, FEATURES, GROUND, HAIR, NECK, SKIN, give

LINES_FACE = 110.0  # Size of the face in the picture that is looked at.
THIN = 0.03  # Strands are no broader than twice this, over the face's size.
DARKER = 0.08  # So much darker than what is beside it is a line.
LONG = 0.12  # Shorter lines, over the face's size, are none.
UNLIKE = 2.0  # A strand is so far from the cheek's colors, in standard deviations.
NEAR = 0.2  # It comes from hair that is no further away than this, over the face's size.
INSIDE, FOREHEAD = 0.95, 0.4
"""An outline lies where less than this is face (a soft mask); a forehead, so high over the face's
height, has none."""
BESIDE = 0.08  # Blur that carries the colors of the face to its outline, over the face's size.
OFF = 0.1  # Paint that is so far from them, root mean square of its colors, is outline.
MOST_LINES = 0.06  # More of a face than this in such lines is a drawing's manner.


def strands(exemplar: Exemplar, hair: Float32, labels: UInt8) -> Float32:
    """Where strands of ``hair`` [h, w] hang over an exemplar's face, float32 [h, w] in [0, 1]."""
    shape = exemplar.image.shape[:2]
    ratio = min(1.0, LINES_FACE / exemplar.size)
    size = max(round(shape[1] * ratio), 16), max(round(shape[0] * ratio), 16)
    face_size = exemplar.size * ratio
    points = exemplar.landmarks * ratio
    image, *parts_of_face = (
        np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.uint8)
        for plane in (exemplar.image, *(labels[..., PICTURE_LABELS.index(name)]
                                        for name in FACE_FEATURES)))
    features = np.maximum.reduce(parts_of_face)
    known = np.asarray(cv2.resize(np.asarray(hair, np.float32), size), np.float32)
    inside = (soft_face(size[::-1], points, 0.3) > 200) & (features < 20)
    skin = inside & (known < 0.3)
    lines = _long(_lines(image, face_size) & inside, LONG * face_size)
    if skin.sum() < 50 or lines.sum() > MOST_LINES * skin.sum():
        return np.zeros(shape, np.float32)
    plain = skin & ~lines
    away = np.zeros(size[::-1], np.float32)
    away[inside] = skin_distance(image[inside] / np.float32(255), plain[inside])
    lines = _long(lines & (away > UNLIKE), LONG * face_size)
    bare = np.asarray(known < 0.5, np.uint8)
    from_hair = cv2.distanceTransform(bare, cv2.DIST_L2, 3) < NEAR * face_size
    _, parts = cv2.connectedComponents(lines.astype(np.uint8))
    out = np.isin(parts, np.setdiff1d(parts[from_hair], 0)).astype(np.float32)
    # With its soft edge, and where it ends in a point.
    kernel = disk(1.5 * THIN * face_size)
    return np.asarray(cv2.resize(cv2.dilate(out, kernel), shape[::-1],
                                 interpolation=cv2.INTER_LINEAR), np.float32)


def outline(exemplar: Exemplar) -> Bool:
    """The rim of an exemplar's face where that is no paint of a face, bool [h, w].

    A dark stroke along the jaw, a collar, what lies behind: on a sitter's cheek they are crumbs.
    """
    soft = soft_face(exemplar.image.shape, exemplar.landmarks, FOREHEAD)
    inside = np.asarray(soft > 255 * INSIDE, np.float32)
    weight = broad_blur(inside, BESIDE * exemplar.size)
    away = np.zeros(soft.shape, np.float32)
    for channel in range(3):
        paint = np.asarray(exemplar.image[..., channel], np.float32) / np.float32(255)
        beside = broad_blur(np.asarray(paint * inside, np.float32), BESIDE * exemplar.size)
        away += (paint - beside / np.maximum(weight, np.float32(1e-3))) ** 2
    return np.asarray((inside == 0) & (away > 3 * OFF ** 2))


def take_out_strands(shares: Float32, exemplar: Exemplar, regions: Regions, labels: UInt8,
                     ) -> tuple[Float32, Float32]:
    """Let skin under loose strands be painted nowhere, in place in shares [h, w, 7].

    Returns, float32 [h, w] in [0, 1], its hair with a cap's ribbon, which is hair in its place but
    no paint for it, and where strands hang over the face.
    """
    hair = shares[..., HAIR]
    if regions.hair is not None:
        hair = np.maximum(hair, regions.hair)
    hair = np.ascontiguousarray(hair)
    strand = strands(exemplar, hair, labels)
    mask_strands(shares, strand)
    return hair, strand


def mask_strands(shares: Float32, strand: Float32) -> None:
    """Let skin under strands [h, w] be painted nowhere: in place, in shares [h, w, 7]."""
    shares[..., FEATURES] += shares[..., SKIN] * strand
    shares[..., SKIN] *= 1 - strand


def _long(lines: Bool, length: float) -> Bool:
    """Those of some lines, bool [h, w], that are at least so long."""
    _, parts, boxes, _ = cv2.connectedComponentsWithStats(lines.astype(np.uint8))
    kept = np.hypot(boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT]) > length
    return np.asarray(lines & kept[parts])


def _lines(image: UInt8, size: float) -> Bool:
    """Thin dark lines of a picture [h, w, 3] whose face is of a ``size``, bool [h, w]."""
    kernel = disk(THIN * size)
    return np.asarray(cv2.morphologyEx(grey(image), cv2.MORPH_BLACKHAT, kernel) > DARKER)


Points = Floats

AROUND = 0.09
"""How far around a feature skin is not plain, over the face's size: about a patch's reach."""
BAG = 0.45  # So far below an eye its bags reach, over its width.
SOFT = 0.03  # Blur of the edge, over the face's size.
LEFT = 0.35, 0.5
"""If less of the skin than this would be left all stays; from the second on all of it is spared:
a little skin, used again and again, is worse."""
EVERY = 2  # Drawn at every Nth pixel.
FACE = 110.0  # Size of the face in the picture in which folds are looked for.
FINE, FOLD = 0.025, 0.12
"""Finer strokes, over the face's size, are the painter's hand; a fold is no broader than twice the
second."""
DARK = 0.1, 0.2  # What is so much darker than the skin beside it begins to be a fold, and is one.
LINES = 0.12  # More of the skin than this in such strokes is a drawing's manner.
SMALL, STROKE = 60.0, 0.03
"""Size of the face in the picture in which colors are compared; blur that leaves out strokes, over
the face's size."""
UPPER = 0.6  # The painter's bare skin is that of his face down to here (brows 0, chin 1).
SKIN_LIKE, OTHER, SURE = 8.0, 20.0, 4.0
"""Paint (Lab) no further than this from that skin is skin, and paint further than the second is
none; between them other materials are to be nearer; and the width of the change."""
COMMON, SAMPLES, FEW = 0.05, 800, 100
"""A color is a material's if this share of it is nearer; so many of each are compared, and fewer
say nothing."""
COVERED = 0.6  # If more of a neck than this is none, none of it is used: the rest is its seams.
SHOULDERS = 0.8, 0.8
"""A neck is this broad, over the face's height, to each side, and begins so far below the brows."""
WHOLE, MOSTLY = 0.05, (0.4, 0.6)
"""Blur of what of a face is strange, over its size; so much of what is around begins to be enough,
and is."""
BEARDED = 0.35  # If so much of the lower face is strange it is a beard, else it is shade.
STRANGE = 0.5  # If more of a skin than this is strange it is his manner, and all of it is used.


def plain_skin(shares: Float32, landmarks: Points, image: UInt8) -> tuple[Float32, Float32]:
    """Shares with features that reach as far as they are seen, and without dark folds.

    Another array [h, w, 7], and what of the lower face is none of it, but a beard, float32 [h, w]
    in [0, 1]. ``landmarks`` and ``image`` are the exemplar's.
    """
    points = np.asarray(landmarks, np.float64)
    size = face_size(points)
    height, width = shares.shape[:2]
    picture = Image.new("L", (-(-width // EVERY), -(-height // EVERY)))
    draw = ImageDraw.Draw(picture)
    for outline in _features(points):
        _fill(draw, outline / EVERY, AROUND * size / EVERY)
    near = gaussian_blur(np.asarray(picture, np.float32) / np.float32(255),
                         max(SOFT * size / EVERY, 0.5))
    near = near.repeat(EVERY, 0).repeat(EVERY, 1)[:height, :width]
    folds = dark_folds(image, shares, size)
    out = shares.copy()
    for material, spared in ((SKIN, np.maximum(near, folds)), (NECK, folds)):
        share = shares[..., material]
        left = 1 - float((share * spared).sum()) / max(float(share.sum()), 1.0)
        taken = share * spared * np.float32(np.clip((left - LEFT[0]) / (LEFT[1] - LEFT[0]), 0, 1))
        give(out, taken, material, FEATURES)
    neck = out[..., NECK]
    low = np.asarray(soft_face(image.shape[:2], points) * np.float32(1 / 255), np.float32)
    below = np.asarray(FaceFrame.of(points).local(image.shape)[1] > UPPER, np.float32)
    low *= below
    beard = shares[..., FEATURES] * (1 - near) * low
    other, strange = unlike_face(image, out, points, beard)
    covered = float((neck * other).sum()) > COVERED * float(neck.sum())
    if covered:
        _dress(out, other, points)
    _nowhere(out, NECK, np.ones_like(other) if covered else other)
    skin = out[..., SKIN].copy()
    lower = skin * low + beard
    beard += skin * strange * low
    # Locks beside a face are taken for its ears.
    _nowhere(out, EARS, strange)
    unlike = float((skin * strange).sum())
    if float(beard.sum()) < BEARDED * float(lower.sum()) or unlike > STRANGE * float(skin.sum()):
        # A little of the jaw is in shade; or all is the painter's manner.
        return out, np.zeros_like(beard)
    _nowhere(out, SKIN, strange)
    return out, beard


def _dress(shares: Float32, other: Float32, points: Points) -> None:
    """Let what was taken for a neck, and is a coat, be clothes: in place in shares [h, w, 7].

    A coat in strokes of all colors has those of cheeks in such strokes. It is one, rather than a
    scarf or a beard, if there is more of it beyond a neck's place than of all other clothes.
    """
    right, down = FaceFrame.of(points).local(shares.shape)
    away = np.hypot(right / SHOULDERS[0], np.maximum(down - SHOULDERS[1], 0))
    coat = shares[..., NECK] * other * np.clip(2 * away - 1, 0, 1)
    if float(coat.sum()) > float(shares[..., CLOTHES].sum()):
        give(shares, coat, NECK, CLOTHES)


def _nowhere(shares: Float32, material: int, part: Float32) -> None:
    """Take a part [h, w] of a material out of use, in place in shares [h, w, 7]."""
    give(shares, shares[..., material] * part, material, FEATURES)


def unlike_face(image: UInt8, shares: Float32, landmarks: Points, beard: Float32,
                ) -> tuple[Float32, Float32]:
    """Where flesh is more like other materials than like the upper face, [h, w] in [0, 1] each.

    Of a neck, place by place; what is far from all is none. And of all flesh, what mostly is in its
    surroundings, too: locks over a cheek, a beard's edge; shade, however deep, that is like nothing
    else is flesh. Both 0 where too little is known. ``beard`` is what of the lower face is known to
    be one.
    """
    points = np.asarray(landmarks, np.float64)
    size = face_size(points)
    ratio = min(1.0, SMALL / size)
    shape = max(round(image.shape[1] * ratio), 16), max(round(image.shape[0] * ratio), 16)
    down = smaller(FaceFrame.of(points).local(image.shape)[1], shape)
    planes = {material: shares[..., material] for material in (
        SKIN, EARS, NECK, HAIR, CLOTHES, GROUND)}
    planes[FEATURES] = beard
    small = {material: smaller(plane, shape) for material, plane in planes.items()}
    colors = np.asarray(cv2.resize(image, shape, interpolation=cv2.INTER_AREA), np.float32)
    lab = np.asarray(cv2.cvtColor(colors / np.float32(255), cv2.COLOR_RGB2LAB), np.float32)
    sigma = max(STROKE * size * ratio, 0.5)
    upper = _samples(lab, small[SKIN] * (down < UPPER), sigma)
    others = {material: found for material in (HAIR, CLOTHES, GROUND, FEATURES)
              if (found := _samples(lab, small[material], sigma)) is not None}
    bare, flesh = small[NECK], small[SKIN] + small[EARS]
    neck, strange = np.zeros_like(bare), np.zeros_like(bare)
    worn = [one for material, one in others.items() if material != FEATURES]
    if upper is not None and worn:
        neck = _unlike(lab, bare, sigma, upper, worn, OTHER)
    if upper is not None and others:
        strange = _unlike(lab, flesh, sigma, upper, list(others.values()), np.inf)
        reach = max(WHOLE * size * ratio, 0.5)
        around = gaussian_blur(strange * flesh, reach) / np.maximum(
            gaussian_blur(flesh, reach), np.float32(1e-3))
        strange = np.clip((around - MOSTLY[0]) / (MOSTLY[1] - MOSTLY[0]), 0, 1)
    whole = [np.asarray(cv2.resize(np.asarray(plane, np.float32), image.shape[1::-1],
                                   interpolation=cv2.INTER_LINEAR), np.float32)
             for plane in (neck, strange)]
    return whole[0], whole[1]


def _unlike(lab: Float32, share: Float32, sigma: float, upper: Float32, others: list[Float32],
            furthest: float) -> Float32:
    """How far colors [h, w, 3] of a material are others' rather than the upper face's, [h, w].

    ``share`` [h, w] is that of the material, and 0 where nothing is asked; ``upper`` and others
    [N, 3] are samples; what is ``furthest`` from the face is another's in any case.
    """
    out, asked = np.zeros(share.shape, np.float32), share > 0.05
    if not asked.any():
        return out
    # Few colors are distinguished: in steps of 1 they are many fewer than places.
    rounded: Float32 = np.rint(_blurred(lab, share, sigma)[asked])
    # As one number each they are sorted eight times as fast as in threes.
    _, first, same = np.unique(rounded.astype(np.int64) @ np.array([1 << 20, 1 << 10, 1]),
                               return_index=True, return_inverse=True)
    steps = rounded[first]
    away, *near = (_distance(steps, material)[same] for material in (upper, *others))
    nearest = np.clip(np.min(near, axis=0), SKIN_LIKE, furthest)
    out[asked] = np.clip((away - nearest) / SURE + 0.5, 0, 1)
    return out


def _blurred(lab: Float32, share: Float32, sigma: float) -> Float32:
    """Colors [h, w, 3] blurred within a material, whose share [h, w] of each place is given."""
    total = np.maximum(cv2.GaussianBlur(share, (0, 0), sigma), np.float32(1e-3))
    return np.asarray(cv2.GaussianBlur(lab * share[..., None], (0, 0), sigma) / total[..., None],
                      np.float32)


def _samples(lab: Float32, share: Float32, sigma: float) -> Float32 | None:
    """Colors [N, 3] of a material; None if there are few."""
    found = _blurred(lab, np.ascontiguousarray(share, np.float32), sigma)[share > 0.6]
    return found[::-(-len(found) // SAMPLES)] if len(found) >= FEW else None


def _distance(colors: Float32, material: Float32) -> Float32:
    """Distance of colors [N, 3] to the nearest ones [M, 3] of a material, but for a few, [N]."""
    squares = ((colors ** 2).sum(axis=1)[:, None] + (material ** 2).sum(axis=1)
               - 2 * colors @ material.T)
    few = int(COMMON * len(material))
    return np.sqrt(np.maximum(np.partition(squares, few, axis=1)[:, few], 0))


def dark_folds(image: UInt8, shares: Float32, size: float) -> Float32:
    """Dark strokes between lighter skin: folds, the edge of a jaw; float32 [h, w] in [0, 1].

    Where a face is drawn in lines altogether they are its skin: none. ``size`` is the face's.
    """
    ratio = min(1.0, FACE / size)
    shape = max(round(image.shape[1] * ratio), 16), max(round(image.shape[0] * ratio), 16)
    light = grey(np.asarray(cv2.resize(image, shape, interpolation=cv2.INTER_AREA), np.uint8))
    bare = smaller(shares[..., SKIN] + shares[..., NECK], shape)
    light = gaussian_blur(light, max(FINE * size * ratio, 0.5))
    dark = cv2.morphologyEx(light, cv2.MORPH_BLACKHAT, disk(FOLD * size * ratio))
    folds = np.clip((dark - DARK[0]) / (DARK[1] - DARK[0]), 0, 1)
    if (folds * bare).sum() > LINES * bare.sum():
        return np.zeros(image.shape[:2], np.float32)
    soft = cv2.dilate(np.asarray(folds, np.float32), disk(FINE * size * ratio))
    return np.asarray(cv2.resize(soft, image.shape[1::-1], interpolation=cv2.INTER_LINEAR),
                      np.float32)


def _features(points: Float64) -> list[Float64]:
    """Outlines [N, 2] of what is seen of eyes with their brows, nostrils and mouth."""
    out = []
    for brow, eye in ((points[17:22], points[36:42]), (points[22:27], points[42:48])):
        across = eye[3] - eye[0]
        down = BAG * np.array([-across[1], across[0]])
        low = [eye[n] + down * part for n, part in ((0, 0.4), (5, 1.0), (4, 1.0), (3, 0.4))]
        out.append(np.concatenate([brow, np.array(low)[::-1]]))
    out += [points[31:36], points[48:60]]
    return out


def _fill(draw: ImageDraw.ImageDraw, outline: Float64, radius: float) -> None:
    """Fill an outline [N, 2] and what is within a radius of it."""
    corners = [(float(x), float(y)) for x, y in outline - 0.5]
    if not np.isfinite(outline).all():
        return
    draw.polygon(corners, fill=255)
    draw.line([*corners, corners[0]], fill=255, width=max(1, round(2 * radius)), joint="curve")
    for x, y in corners:
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=255)
