"""The sitter alone, where a photo shows other people beside.

A network's matte is of all people. Where somebody else is, says the sitter's face: no sitter
reaches that far beside the head, and a second look of the network from near sees what belongs
together. What is apart from the sitter is somebody else's, too. A hand that is held up reaches as
far: what does counts only where it is blurred, or has a face or hair of its own.

A random walker (Grady 2005, "Multilabel Random Walker Image Segmentation Using Prior Models") then
parts the matte between the two, along the edges in the photo. Where nobody is found, nothing
changes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage, sparse
from scipy.sparse import linalg
from skimage.segmentation import felzenszwalb

from ...arrays import Bool, Float32, Float64, UInt8
from ..detect import detect_faces
from ..head_fit import ear_to_ear
from ..segmentation import person_matte

FINE = 90.0  # Pixels of a face's width where a matte is parted.
MOST = 4e5  # Pixels of that picture, at most: of a large photo with a small face it is coarser.
REACH = np.array([(-1.4, 0.0, 0.4), (-1.2, 0.0, 0.5), (-0.6, 0.45, 0.8), (0.0, 0.62, 1.0),
                  (0.6, 0.6, 1.05), (0.8, 0.75, 1.7), (1.2, 1.2, 2.2), (2.2, 1.5, 2.4)])
"""By how far below the eyes, how far to either side many sitters reach, and few do; in widths of a
face, of 49 photos of one person each."""
SHOULDERS = 0.9  # From so far below the eyes on people differ, widths of a face.
LOOKS, ABOVE = (4.0, 2.6), 1.3
"""Widths of what a second look shows, and how much of it lies above the eyes, in widths of a face.
"""
UNSEEN, OTHERS = 0.15, 0.03
"""Squares of a face's width that belong to somebody else at least: of what a second look does not
show, and of what is apart or lies where no sitter reaches."""
BLURRED = 0.3  # How sharp out of focus is, at most, beside the sitter's face.
EDGES, LEAK = 0.1, 1e-4
"""How much a squared difference in CIELAB stops the walker, and what passes in any case."""
DRIFT, SOFT, SURE = 0.004, 0.015, 0.3
"""How much it counts where people usually are, that an edge is blurred, and what probably is
somebody else's, beside what a pixel's neighbors are."""
WEAK, STEEP = 0.25, 0.35
"""An edge counts that is so strong beside those of the sitter's face; blurred is what is seen of
it in fine by less than this part of what is seen in rough."""
PATCH = 0.3  # Of a patch without edges that much at least is somebody else's, or nothing.
SEED = 1e3  # The same for what is known.
NOBODY = 0.3  # A face of which a matte of people shows less is none.
UNSURE, HAIR = (0.05, 0.95), 0.3
"""Between which a network does not know who is there; hair of more than this is known by another.
"""
LOOSE = 0.1
"""What is farther from the sitter is none of a bust, widths of a face: ground, or a waving hand."""


@dataclass(frozen=True)
class _Place:
    """Where the pixels of a picture [h, w] lie beside a face."""

    face: Float64  # Landmarks [68, 2] in pixels.
    width: float  # Of the face, in pixels.
    # Widths of the face that a pixel is beside the eyes and below them, float64 [h, w].
    beside: Float64
    below: Float64

    @classmethod
    def of(cls, face: Float64, shape: tuple[int, ...]) -> _Place:
        """The places of a picture's pixels."""
        width = ear_to_ear(face)
        eyes = 0.5 * (face[36:42].mean(axis=0) + face[42:48].mean(axis=0))
        down = (face[8] - face[27]) / max(float(np.linalg.norm(face[8] - face[27])), 1e-9)
        row, column = np.mgrid[:shape[0], :shape[1]] + 0.5
        x, y = (column - eyes[0]) / width, (row - eyes[1]) / width
        return cls(face, width, np.abs(x * down[1] - y * down[0]), x * down[0] + y * down[1])

    def usual(self) -> Float64:
        """How usual it is that a person reaches to a pixel, float64 [h, w] in [0, 1]."""
        many, few = (np.interp(self.below, REACH[:, 0], REACH[:, k]) for k in (1, 2))
        out = 1 - np.clip((self.beside - many) / np.maximum(few - many, 0.05), 0, 1)
        return np.asarray(out)

    def hull(self) -> Bool:
        """The face from the brows down."""
        out = np.zeros(self.beside.shape, np.uint8)
        cv2.fillConvexPoly(out, cv2.convexHull(np.rint(self.face).astype(np.int32)), 1)
        return np.asarray(out > 0)

    def core(self) -> Bool:
        """What is surely the person's: the face, and what is straight below it."""
        return self.hull() | ((self.beside < 0.3) & (self.below > 0) & (self.below < 1.6))


@dataclass(frozen=True)
class _Scene:
    """A photo, made small: the sitter's face is 90 pixels wide, or fewer."""

    image: UInt8  # [h, w, 3]
    person: Bool  # [h, w], all people.
    # float32 [h, w]: hair of anybody, and what a second look takes for people.
    hair: Float32
    look: Float32
    # float32 [h, w], how strong edges are, in fine and in rough.
    sharp: Float32
    rough: Float32
    sitter: _Place
    others: list[_Place]  # Of other faces.

    def area(self, part: Bool) -> float:
        """Of a part, in squares of a face's width."""
        return float(part.sum()) / self.sitter.width ** 2

    def disc(self, radius: float) -> UInt8:
        """A structuring element, ``radius`` in widths of a face."""
        side = 2 * max(1, round(radius * self.sitter.width)) + 1
        return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def faces_of_people(faces: list[Float64], matte: Float32) -> list[Float64]:
    """The faces, [68, 2] each, where a matte of people [H, W] shows somebody.

    Detectors see faces in leaves and folds, too. All of them where it shows nobody at any: a matte
    may be wrong.
    """
    shown = []
    for face in faces:
        hull = np.asarray(cv2.convexHull(face.astype(np.int32)))
        place = cv2.fillConvexPoly(np.zeros(matte.shape, np.uint8), hull, 1.0) > 0
        if place.any() and float((matte[place] > 0.5).mean()) > NOBODY:
            shown.append(face)
    return shown or faces


def sitter_alone(image: UInt8, soft: Float32, hair: Float32, landmarks: list[Float64],
                 ) -> Float32 | None:
    """A matte without people beside the sitter, or None where there are none.

    Parameters
    ----------
    image : uint8 [H, W, 3], sRGB.
    soft : float32 [H, W] in [0, 1], of `person_matte`.
    hair : float32 [H, W] in [0, 1], of `hair_mask`.
    landmarks : [68, 2] of all faces in pixels, the sitter's first.
    """
    scene = _scene(image, soft, hair, landmarks)
    sitter = scene.sitter.core() & scene.person
    if not sitter.any():
        return None
    apart = _apart(scene, sitter)
    others, faces, blurred = _others(scene, sitter, apart, image)
    if not (others | apart).any():
        return None
    share = np.where(apart, 0.0, 1.0)
    if others.any():
        share = _walked(scene, sitter, apart, others, faces, blurred)
    gone = cv2.morphologyEx((scene.person & (share < 0.5)).astype(np.uint8), cv2.MORPH_OPEN,
                            scene.disc(0.015)) > 0
    for piece in _pieces(gone):
        if not (piece & (others | apart)).any() and scene.look[piece].mean() > 0.8:
            gone &= ~piece
    for piece in _pieces(scene.person & ~gone):
        if not (piece & sitter).any():
            gone |= piece
    if scene.area(gone) < OTHERS:
        return None
    # Elsewhere the outline stays as it is, with its single hairs.
    close = cv2.dilate(gone.astype(np.uint8), scene.disc(0.02)) > 0
    share = np.where(gone, np.minimum(share, 0.5), np.where(close, np.maximum(share, 0.5), 1))
    nearest = ndimage.distance_transform_edt(~(scene.person | close), return_distances=False,
                                             return_indices=True)
    share = share[tuple(nearest)].astype(np.float32)
    large = cv2.resize(share, soft.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(soft * np.clip(3 * large - 1, 0, 1), np.float32)


def seen_from_near(image: UInt8, soft: Float32, hair: Float32, face: Float64) -> Float32:
    """A matte of `person_matte` [H, W] without unsure ground that it does not take from near.

    Parameters
    ----------
    image : uint8 [H, W, 3], sRGB.
    soft, hair : float32 [H, W] in [0, 1], of `person_matte` and `hair_mask`.
    face : [68, 2] in pixels.
    """
    asked = (soft > UNSURE[0]) & (soft < UNSURE[1]) & (hair < HAIR)
    near = _second_look(image, face)
    return np.where(asked, np.minimum(soft, 0.5 * (soft + near)), soft)


def in_one_piece(matte: Float32, face: Float64) -> Float32:
    """A matte [H, W] without what lies apart from the person whose face [68, 2] is given."""
    labels = cv2.connectedComponents((matte > 0.5).astype(np.uint8), connectivity=4)[1]
    at = np.clip(np.rint(face), 0, np.array(matte.shape[::-1]) - 1).astype(int)
    shown = labels[at[:, 1], at[:, 0]]
    if not shown.any() or labels.max() < 2:
        return matte
    sitter = labels == np.bincount(shown[shown > 0]).argmax()
    close = np.unique(labels[_away(sitter) < LOOSE * ear_to_ear(face)])
    kept = np.isin(labels, close) & (labels > 0)
    if (kept == (labels > 0)).all():
        return matte
    return np.where(_away(kept) <= _away((labels > 0) & ~kept), matte, np.float32(0))


def _away(part: Bool) -> Float32:
    """How far pixels [H, W] are from a part."""
    return np.asarray(cv2.distanceTransform((~part).astype(np.uint8), cv2.DIST_L2, 5), np.float32)


def _scene(image: UInt8, soft: Float32, hair: Float32, faces: list[Float64]) -> _Scene:
    """A photo in small, with a second look at its sitter."""
    factor = min(1.0, FINE / ear_to_ear(faces[0]), (MOST / soft.size) ** 0.5)
    size = max(2, round(factor * soft.shape[1])), max(2, round(factor * soft.shape[0]))
    person, curls, look, sharp, rough = (
        np.asarray(cv2.resize(one, size, interpolation=cv2.INTER_AREA), np.float32)
        for one in (soft, hair, _second_look(image, faces[0]), *_edges(image, faces[0])))
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    sitter, *others = (_Place.of(face * factor, person.shape) for face in faces)
    return _Scene(small, person > 0.5, curls, look, sharp, rough, sitter, others)


def _second_look(image: UInt8, face: Float64) -> Float32:
    """What a network takes for people where it sees little but the sitter, float32 [H, W]."""
    eyes, width = 0.5 * (face[36:42].mean(axis=0) + face[42:48].mean(axis=0)), ear_to_ear(face)
    out = np.ones(image.shape[:2], np.float32)
    for wide in LOOKS:
        low, high = (np.clip(eyes + width * np.array(end), 0, image.shape[1::-1]).astype(int)
                     for end in ((-0.5 * wide, -ABOVE), (0.5 * wide, wide - ABOVE)))
        part = np.s_[low[1]:high[1], low[0]:high[0]]
        if out[part].size:
            out[part] = np.minimum(out[part], person_matte(np.ascontiguousarray(image[part])))
    return out


def _edges(image: UInt8, face: Float64) -> list[Float32]:
    """How strong edges are, in fine and in rough, float32 [h, w] each.

    In the grid a face is 150 pixels wide, or fewer. Both are alike along a sharp edge.
    """
    factor = min(1.0, 150 / ear_to_ear(face))
    grey = cv2.cvtColor(cv2.resize(image, None, fx=factor, fy=factor,
                                   interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    return [np.asarray(sigma ** 2 * np.abs(cv2.Laplacian(cv2.GaussianBlur(
        grey.astype(np.float32), (0, 0), sigma), cv2.CV_32F)), np.float32)
        for sigma in (1.0, 3.0)]


def _pieces(mask: Bool) -> Iterator[Bool]:
    """The connected pieces of a mask."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    return (labels == one for one in range(1, count))


def _apart(scene: _Scene, sitter: Bool) -> Bool:
    """What does not hang together with the sitter, bool [h, w], but for specks."""
    out = np.zeros(sitter.shape, bool)
    for piece in _pieces(scene.person):
        if not (piece & sitter).any() and scene.area(piece) > OTHERS:
            out |= piece
    return out


def _faces(scene: _Scene, far: list[Bool], image: UInt8) -> list[_Place]:
    """The other faces, and those that are found where it is looked for one that was overlooked."""
    out, factor = list(scene.others), len(scene.person) / len(image)
    for piece in far:
        if not any((piece & one.core()).any() for one in out):
            row, column = np.argwhere(piece).mean(axis=0) / factor
            out += [_Place.of(face * factor, piece.shape)
                    for face in detect_faces(image, (float(column), float(row)))]
    return out


def _others(scene: _Scene, sitter: Bool, apart: Bool, image: UInt8,
            ) -> tuple[Bool, list[_Place], bool]:
    """What else is somebody else's, bool [h, w], other people's faces, and if one is blurred."""
    person, place = scene.person, scene.sitter
    far = [piece for piece in _pieces(person & ~apart & (place.usual() == 0))
           if scene.area(piece) > OTHERS]
    own = _own_hair(scene)
    # One before the chest is printed on what the sitter wears, one in the sitter's hair is curls.
    faces = [one for one in _faces(scene, far, image) if (hull := one.hull()).any()
             and place.usual()[hull].mean() < 0.5 and own[hull].mean() < 0.5]
    known = np.zeros(person.shape, bool)
    for face in faces:
        known |= person & (face.hull() | (face.core() & (place.usual() == 0)))
    for piece in _pieces(person & (scene.hair > 0.5) & ~own):
        if any(scene.area(piece & one) > OTHERS for one in far):
            known |= piece
    out, blurred = known.copy(), False
    limit = BLURRED * float(np.percentile(scene.sharp[sitter], 95))
    inner = cv2.erode(person.astype(np.uint8), scene.disc(0.02)) > 0
    for piece in far:
        seen = scene.sharp[piece & inner]
        soft = len(seen) > 0 and float(np.percentile(seen, 95)) < limit
        blurred |= soft
        if soft or (piece & known).any():
            out |= piece
    unseen = cv2.morphologyEx((person & ~apart & (scene.look < 0.3)).astype(np.uint8),
                              cv2.MORPH_OPEN, scene.disc(0.04)) > 0
    if scene.area(unseen) > UNSEEN:
        out |= unseen
    return _grown(scene, out & ~sitter, sitter), faces, blurred


def _own_hair(scene: _Scene) -> Bool:
    """Hair that hangs together with what is on the sitter's head, bool [h, w]."""
    out = np.zeros(scene.person.shape, bool)
    for piece in _pieces(scene.person & (scene.hair > 0.5)):
        if (piece & (scene.sitter.beside < 0.8) & (scene.sitter.below < 0.5)).any():
            out |= piece
    return out


def _grown(scene: _Scene, others: Bool, sitter: Bool) -> Bool:
    """What is somebody else's, bool [h, w], with all of each plain patch that it has a part of."""
    patches = felzenszwalb(scene.image, scale=100, sigma=0.8, min_size=20)
    patches[~scene.person] = 0
    size, theirs, mine = (np.bincount(patches[part], minlength=patches.max() + 1)
                          for part in (scene.person, others, sitter))
    whole = (theirs > PATCH * size) & (mine == 0)
    return np.asarray(others | (whole[patches] & scene.person))


def _blurred(scene: _Scene, sitter: Bool) -> Bool:
    """Where an edge is out of focus, beside where the sitter surely is, bool [h, w]."""
    fine, rough = (cv2.dilate(one, scene.disc(0.04)) for one in (scene.sharp, scene.rough))
    strong = rough > WEAK * float(np.percentile(rough[sitter], 95))
    # The sitter's own outline may be out of focus, too.
    within = cv2.erode(scene.person.astype(np.uint8), scene.disc(0.1)) > 0
    return np.asarray(strong & (fine < STEEP * rough) & within & (scene.sitter.usual() < 1))


def _walked(scene: _Scene, sitter: Bool, apart: Bool, others: Bool, faces: list[_Place],
            blurred: bool) -> Float64:
    """How much of each pixel is the sitter, float64 [h, w]."""
    usual = scene.sitter.usual()
    # Shoulders differ more than heads, and hair says whose it is.
    usual = np.where(scene.sitter.below > SHOULDERS, np.maximum(usual, 0.5), usual)
    hair = _own_hair(scene)
    usual = np.where(hair & (usual > 0), 1.0, usual) * scene.look ** 2
    for other in faces:
        usual = usual * (1 - 0.5 * other.usual() * (scene.sitter.usual() < 1))
    mine, theirs = DRIFT * usual, DRIFT * (1 - usual)
    theirs[others] += SURE
    if blurred:
        theirs[_blurred(scene, sitter) & ~hair] += SOFT
    theirs[apart] = SEED
    mine[sitter], theirs[sitter] = SEED, 0.0
    lab = cv2.cvtColor(scene.image.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    return walker(np.asarray(lab, np.float32), scene.person, mine, theirs)


def walker(colors: Float32, domain: Bool, mine: Float64, theirs: Float64) -> Float64:
    """How probably a random walk ends at what is mine before it ends at what is theirs.

    Parameters
    ----------
    colors : float32 [h, w, 3]: the more they differ, the less often it goes that way.
    domain : bool [h, w], where it walks.
    mine, theirs : float64 [h, w], how likely it ends at a place, beside its going on.

    Returns
    -------
    share : float64 [h, w] in [0, 1], 0 outside of the domain.
    """
    number = np.full(domain.shape, -1)
    count = int(domain.sum())
    number[domain] = np.arange(count)
    rows, columns, weights = [], [], []
    for one, two in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        both = domain[one] & domain[two]
        apart = ((colors[one] - colors[two])[both].astype(np.float64) ** 2).sum(axis=-1)
        rows.append(number[one][both])
        columns.append(number[two][both])
        weights.append(np.exp(-EDGES * apart) + LEAK)
    half = sparse.coo_array((np.concatenate(weights),
                             (np.concatenate(rows), np.concatenate(columns))),
                            shape=(count, count))
    links = (half + half.T).tocsc()
    ends = mine[domain] + theirs[domain]
    matrix = sparse.diags_array(links.sum(axis=1) + ends + 1e-9) - links
    out = np.zeros(domain.shape)
    out[domain] = linalg.splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A",
                              options={"SymmetricMode": True}).solve(mine[domain])
    return out
