"""The hat of a painting's sitter: cap, bonnet or veil, as a thing with its own edge.

The networks know no hats: to them one is hair, cloth or background. Where a forehead is covered and
what covers it reaches far beyond a head or is unlike the hair below it, or where what is taken for
hair has two hues, there is one. Its outline is a cut by colors (GrabCut: Rother et al. 2004) that
begins at the crown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ...cache import kept_arrays, key_of
from ...labels import BY_HAND, PICTURE_LABELS
from ..exemplar import Exemplar
from ..guides.filters import disk, grey, skin_distance
from ..guides.regions import Regions, soft_face
from ..painter.picture_materials import SmallPicture, has_two_hues
from .forehead import Forehead, covered_forehead

__all__ = ["Wear", "headwear", "not_worn"]

Float32 = NDArray[np.float32]
Bools = NDArray[np.bool_]

Wear = Literal["hat", "spectacles"]
"""What a sitter may be given of what the painter's wears."""

COVERS, REACHES = 0.3, 2.0
"""A hat covers at least the first share of the forehead, by what is no hair to the network, and
reaches so far from the face's middle, over half its width, or is unlike the hair below it."""
FACE = 45.0
"""Size of the face (`face_size`) in the picture that is cut."""
ROOM = 2.4, 2.6, 2.3
"""It lies no further than this beside, above and below the brows' middle (chin 1)."""
BLUR = 0.02
"""Colors are compared blurred by so much over the face's size."""
LIKE = 2.5
"""What is no further from the crown's colors, in standard deviations, may be a veil's hanging
part, on shoulders, too."""
NECK = 1.05
"""The body begins so far below the brows."""
PERSON = 0.3
"""The crown is where the network sees a person, if that is at least this share of it."""
TURNS = 6
"""Of the cut."""
SAMPLE = 0.01
"""Less of a color than this, over the face's squared height, says nothing."""
HAIRY, GREY = 0.02, 8.0
"""What hangs beside a face below the brows is hair, not a veil, unless the crown is lighter than
the cheeks, or it is by the first (luma), or is of no hue that hair has: bluer than yellow by the
second (b of Lab)."""
BRIM = 1.8, 0.35
"""Nor so far from the face's middle, over half its width, down to here: that is a brim."""
BESIDE, SURELY = 1.3, 1.5
"""Within the first, over half the face's width, what is no further from the cheeks' colors than
the second, in standard deviations, is skin."""
UNLIKE = 2.6
"""Skin is no further from the colors of the cheeks, in standard deviations."""
UNLIKE_CROWN, BROW = 3.0, 0.6
"""What is further than the first from the crown's colors is none of it, up to so far above the
brows; higher up there may be a feather or a ribbon."""
CHIN = 0.9
"""Nothing that is worn on a head lies below a face from here on."""
ALL_AROUND = 0.5
"""What covers more than this of the picture's border above the brows was not told apart from the
background."""
GAP, CRUMB = 0.05, 0.03
"""Gaps and crumbs up to this, over the face's height, are closed and left out."""
EDGE = 0.006
"""Its edge is soft over so much of the face's height."""
LEAST = 0.25
"""A thing smaller than this, over the face's squared height, is none."""


def headwear(exemplar: Exemplar, regions: Regions | None = None) -> Float32 | None:
    """What a painting's sitter wears on the head.

    Parameters
    ----------
    exemplar
        The painting, from the front or turned; not bared (`filled`).
    regions
        Its own, where they are known.

    Returns
    -------
    mask
        float32 [h, w] in [0, 1], one connected thing without its shade; None where there is none.
    """
    def find() -> dict[str, NDArray[Any]]:
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


def not_worn(exemplar: Exemplar, wear: Sequence[Wear]) -> list[str]:
    """Notes, a line each, on what is to be worn and is not there in a painting, as it came."""
    if "hat" in wear and headwear(exemplar.covered or exemplar) is None:
        return [f"{exemplar.name} wears no hat: --wear hat changes nothing"]
    return []


@dataclass
class _Small:
    """A painting at the size that it is cut at; planes [h, w]."""

    image: NDArray[np.uint8]
    right: Float32
    down: Float32
    hair: Float32
    person: Float32
    face: Float32
    covered: Bools
    crown: Bools
    forehead: Bools
    half: float
    height: float

    @staticmethod
    def of(exemplar: Exemplar, regions: Regions, found: Forehead) -> _Small:
        frame, shape = regions.frame, exemplar.image.shape
        factor = min(1.0, FACE / exemplar.size)
        size = max(round(factor * shape[1]), 8), max(round(factor * shape[0]), 8)

        def small(plane: NDArray[Any]) -> Float32:
            return np.asarray(cv2.resize(np.asarray(plane, np.float32), size,
                                         interpolation=cv2.INTER_AREA), np.float32)

        right, down = (small(plane) for plane in frame.local(shape))
        half = 0.5 * frame.width / frame.height
        none = np.zeros(shape[:2], np.float32)
        image = cv2.resize(exemplar.image, size, interpolation=cv2.INTER_AREA)
        return _Small(np.asarray(image, np.uint8), right, down,
                      small(none if regions.hair is None else regions.hair), small(regions.person),
                      small(soft_face(shape, exemplar.landmarks)) / np.float32(255),
                      small(found.covered) > 0.5, small(found.crown) > 0.5,
                      small(found.bare) > 0.5, half, frame.height * factor)

    def room(self) -> Bools:
        """Where a hat may be."""
        beside, above, below = ROOM
        return (np.abs(self.right) < beside) & (self.down > -above) & (self.down < below)

    def colors(self) -> Float32:
        """Colors in [0, 1] without strokes, float32 [h, w, 3]."""
        picture = self.image.astype(np.float32) / np.float32(255)
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), max(0.5, BLUR * FACE)), np.float32)

    def kernel(self, share: float) -> NDArray[np.uint8]:
        """A disk of a radius over the face's height."""
        return disk(share * self.height)


def _found(exemplar: Exemplar, regions: Regions) -> Float32 | None:
    labels = regions.labels()
    forehead = covered_forehead(exemplar, regions, labels)
    two_hues = _two_hues(exemplar, regions, labels)
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


def _all_around(cut: Bools, above: Bools) -> bool:
    """Whether a cut [h, w] goes on at most of the picture's border ``above`` the brows."""
    border = np.ones(cut.shape, bool)
    border[1:, 1:-1] = False
    return bool((cut & border & above).sum() > ALL_AROUND * (border & above).sum())


def _two_hues(exemplar: Exemplar, regions: Regions, labels: NDArray[np.uint8]) -> bool:
    """Whether what is taken for hair is a cap of two colors."""
    small = SmallPicture(exemplar, regions, labels)
    hair = small.part(labels[..., PICTURE_LABELS.index("hair")]) > 150
    return has_two_hues(small, hair)


def _cut(small: _Small) -> Bools | None:
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
    rows, columns = (np.flatnonzero(small.room().any(axis=axis)) for axis in (1, 0))
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
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


def _seeds(small: _Small, colors: Float32, core: Bools, like_skin: Bools) -> NDArray[np.uint8]:
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


def _unlike_hair(small: _Small, cut: Bools) -> bool:
    """Whether it is of other colors than the hair that shows under it, beside the face."""
    around = cv2.dilate(cut.astype(np.uint8), small.kernel(GAP)) > 0
    hair = (small.hair > 0.5) & ~around & (small.face < 0.1)
    above = cut & (small.down < 0)
    if min(hair.sum(), above.sum()) < SAMPLE * small.height ** 2:
        return False
    return float(np.median(skin_distance(small.colors(), above)[hair])) > UNLIKE_CROWN


def _veil(colors: Float32, cheeks: Bools, core: Bools) -> Bools:
    """What may hang beside a face and is no hair, by its colors: all of a light cloth."""
    from skimage.color import rgb2lab

    light = grey(colors)
    most = np.median(light[cheeks]) if cheeks.any() else 1.0
    if np.median(light[core]) > most:
        return np.ones(core.shape, bool)
    lab = rgb2lab(np.clip(colors, 0, 1))
    return np.asarray((light > most + HAIRY) | (lab[..., 2] < -GREY))


def _one_thing(small: _Small, cut: Bools, alike: Bools, core: Bools) -> Bools | None:
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


def _filled(one: Bools, face: Bools) -> Bools:
    """A thing [h, w] without holes, but for those that the face looks out of."""
    _, rest = cv2.connectedComponents(np.pad(~one, 1, constant_values=True).astype(np.uint8),
                                      connectivity=4)
    rest = rest[1:-1, 1:-1]
    open_ones = np.union1d(np.unique(rest[face]), [rest[0, 0], rest[0, -1], rest[-1, 0],
                                                   rest[-1, -1]])
    return one | ~np.isin(rest, open_ones)
