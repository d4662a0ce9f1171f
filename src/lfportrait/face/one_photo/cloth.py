"""Where a photo shows clothes, and where bare skin below the face.

The face says what skin looks like: its hue at each lightness, which goes on into the shade below a
chin. What is unlike that is clothes, and what lies far from the neck is so rather than what lies
near it. Of places that neither says much of those around decide that no edge parts from them, by a
random walk with priors (Grady 2005): the shade of a chin ends softly, a collar does not. Then the
colors of both, as found, say it once more, so that a chest need not have the color of the face, nor
a brown cloth another one than skin.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ... import models
from ...arrays import Bool, Float32, Float64
from ...capture import Camera
from ...color import LUMINANCE
from ...field import SurfaceGraph
from ..segmentation import parts as parts_of_network
from .parts import opened
from .samples import MeshSamples
from .skin import CHIN, features_of, nearest_samples

CELL = 0.0088  # Width of a cell at the head, portrait units: a face is 90 wide.
ASIDE, LOWER = 1.8, 1.8
"""How far beside the neck and below the chin clothes are looked for, portrait units: a bust ends
before."""
RAISED, SHOULDER, HIGHEST = 0.22, 0.42, 0.6
"""How far above the chin a collar may stand; how far beside the neck, and at most how high, raised
shoulders are; portrait units."""
DARK = 0.008  # Added to light before its logarithm.
SHARES = (0.02, 0.15, 0.3, 0.5, 0.7, 0.85, 0.98)
"""Quantiles of a face's lightness between which its hue is known."""
HUE = 0.12  # Least deviation of a hue, octaves.
BRIGHTER, DARKER, SHADE = 0.35, 0.8, 1.0
"""Deviations of lightness beyond that of the face, octaves; and how much darker skin may be."""
REDDER, DEEP = 0.5, 2.0  # How much less a redder hue counts in shade so deep, octaves.
UNLIKE, STEEP = 3.0, 1.4
"""Deviation from skin at which a color says nothing, and what one more says (in logits)."""
SAYS = -4.0, 6.0  # Least and most that colors say.
COLORFUL = 0.4  # Octaves from grey at which the hue of skin says so much.
AT_NECK, DOWN, OUT = -0.84, (1.4, 0.79), (1.05, 0.32, 0.4)
"""What the place below a chin says; how much more one so far (portrait units) below does; and one
beside that, from the second on, over the third."""
OF_NECK = -0.35  # What a place on the fitted neck says at most.
TRUST = 0.03, 0.1
"""Weight of what places say, and of the face that they touch, over that of their neighbours."""
ACCURACY = 3e-3  # Relative, of what is found.
LIGHTNESS = 0.6  # Weight of lightness in an edge.
FAINTEST, PASSES = 4.0, 1e-3
"""Square of a difference in CIELAB that is no edge, and what is left where there is one."""
CLOSE = 0.28, 0.36  # Down and beside so far from a chin skin is a neck's, portrait units.
SURE, FEW = 4.5, 0.3
"""Deviation from skin of what is clothes for sure; and how much of the clothes that must be to
stand for them."""
MODES, OF_FACE = 5, 0.35  # Colors of a part, and the weight of lightness among them.
SPREAD = np.array([0.15, 0.1, 0.1])  # Their least deviations.
LEAST = 50  # Cells of a part whose colors are known.
ALONE, PLACE = 0.4, 0.6
"""What colors and places say still counts so much when those of both parts are known."""
THIN, SMALL = 0.02, 0.02
"""What is less than twice so wide, or has less than such an area, is part of what is around it,
portrait units: necklaces, buttons."""


def clothes_of(image: NDArray[np.uint8], colors: Float32, matte: NDArray[np.floating],
               hair: NDArray[np.floating] | None, beard: NDArray[np.floating] | None,
               landmarks: Float64, camera: Camera, samples: MeshSamples) -> Float32:
    """How much a photo shows clothes below a face, float32 [H, W]; none on face and head.

    Where hair or a beard hides what is there it goes on as beside that.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    colors : float32 [H, W, 3] in [0, 1], the person's alone (`clean_colors`).
    matte, hair, beard : [H, W] in [0, 1], or None where there is none.
    landmarks : float64 [68, 2] in pixels.
    camera : The photo's.
    samples : Of the head, in the camera's world.
    """
    scene = _Scene.of(colors, matte, hair, beard, landmarks, camera, samples)
    whole = np.zeros(matte.shape, np.float32)
    if not scene.asked.any():
        return whole
    if models.available("multiclass-segmentation"):
        worn = _by_network(image, scene)
    else:
        worn = _by_colors(scene)
    worn = _without_crumbs(worn, scene)
    if not worn.any():
        return whole
    # Below hair and beard, and beyond the outline, as in the nearest place that is seen.
    nearest = ndimage.distance_transform_edt(~scene.asked, return_distances=False,
                                             return_indices=True)
    shares = worn[tuple(nearest)].astype(np.float32)
    shares[scene.head | ~scene.deep] = 0
    soft = cv2.GaussianBlur(shares, (0, 0), 0.7)
    small = np.zeros(scene.size[::-1], np.float32)
    small[scene.part] = soft
    return np.asarray(np.clip(cv2.resize(small, matte.shape[::-1]), 0, 1), np.float32)


class _Scene(NamedTuple):
    """A person's bust in a picture of cells [h, w]."""

    size: tuple[int, int]  # Of the whole picture, (width, height).
    part: tuple[slice, slice]  # Where the bust is in it.
    cell: float  # Portrait units.
    image: Float32  # [h, w, 3].
    person: Float32
    hidden: Float32  # How much is hair or beard.
    head: Bool  # The face and the fitted head, ears and all.
    neck: Bool  # The fitted neck.
    bare: Bool  # Skin of the face, for sure.
    deep: Bool  # Where a body is,
    asked: Bool  # and what of it is seen.
    down: Float64  # How far below the chin, [h, 1], and how far beside the neck, [1, w]:
    beside: Float64  # portrait units.

    @staticmethod
    def of(colors: Float32, matte: NDArray[np.floating], hair: NDArray[np.floating] | None,
           beard: NDArray[np.floating] | None, landmarks: Float64, camera: Camera,
           samples: MeshSamples) -> _Scene:
        """The bust; parameters as of `clothes_of`."""
        unit = float(camera.focal[0, 0]) / float(np.linalg.norm(camera.position[0]))
        small = camera.scaled(min(1.0, 1.0 / (CELL * unit)))
        size = int(small.width[0]), int(small.height[0])
        cell = float(np.linalg.norm(small.position[0]) / small.focal[0, 0])
        scale = np.array(size) / np.array(matte.shape[::-1])
        rest, cosine = nearest_samples(small, samples)
        places = landmarks * scale
        head = np.isfinite(cosine) & (rest[..., 1] > CHIN)
        neck = np.isfinite(cosine) & ~head
        middle = float(np.median(np.nonzero(neck)[1])) if neck.any() else float(places[8, 0])
        first = np.array([middle - ASIDE / cell, places[:, 1].min()])
        last = np.array([middle + ASIDE / cell, places[8, 1] + LOWER / cell])
        low, high = (np.clip(end, 0, size).astype(int) for end in (first, last))
        part = slice(low[1], high[1]), slice(low[0], high[0])

        def reduced(plane: NDArray[np.floating] | None) -> Float32:
            if plane is None:
                return np.zeros((high - low)[::-1], np.float32)
            found = cv2.resize(np.asarray(plane, np.float32), size, interpolation=cv2.INTER_AREA)
            return np.ascontiguousarray(found[part])

        shape = head[part].shape
        head = head[part] | _filled(shape, places[:17] - low, places[26:16:-1] - low)
        person, hidden = reduced(matte), np.maximum(reduced(hair), reduced(beard))
        down = (np.arange(low[1], high[1])[:, None] - places[8, 1]) * cell
        beside = np.abs(np.arange(low[0], high[0])[None] - middle) * cell
        bare = _filled(shape, places[[17, 19, 24, 26, 14, 12, 4, 2]] - low)
        bare &= ~features_of(places - low, shape) & (hidden < 0.2) & (person > 0.9)
        deep = down > -RAISED - np.clip(2 * (beside - SHOULDER), 0, HIGHEST - RAISED)
        asked = (person > 0.5) & (hidden < 0.5) & ~head & deep
        return _Scene(size, part, cell, reduced(colors), person, hidden, head, neck[part] & ~head,
                      bare, deep, asked, down, beside)


def _filled(shape: tuple[int, ...], *outline: Float64) -> Bool:
    """The inside of an outline (x, y) in a picture [h, w]."""
    out = np.zeros(shape, np.uint8)
    cv2.fillPoly(out, [np.rint(np.vstack(outline)).astype(np.int32)], 1)
    return out > 0


def _by_network(image: NDArray[np.uint8], scene: _Scene) -> Bool:
    """Clothes [h, w] as the network of six parts sees them; what else is worn is as around it."""
    def small(one: Float32) -> Float32:
        found = cv2.resize(one, scene.size, interpolation=cv2.INTER_AREA)
        return np.asarray(found[scene.part], np.float32) + np.float32(0.01)

    shares = parts_of_network(image)
    worn, bare = small(shares["clothes"]), small(shares["body-skin"] + shares["face-skin"])
    return _Walk(scene, bare > worn).settled(np.log(worn / bare)) > 0.5


def _by_colors(scene: _Scene) -> Bool:
    """Clothes [h, w] by colors, places and edges."""
    if scene.bare.sum() < LEAST:
        return np.zeros(scene.asked.shape, bool)
    values = _values(scene.image)
    away = _unlike_skin(values, scene.bare)
    hue = float(np.linalg.norm(np.median(values[scene.bare], axis=0)[1:]))
    colorful = min(hue / COLORFUL, 1.0)  # in a picture without colors all may be like skin
    says = np.clip(STEEP * (away - UNLIKE), SAYS[0] * colorful, SAYS[1])
    place = _place(scene) * (2 - colorful)
    walk = _Walk(scene, says < 0)
    worn = walk.settled(says + place)
    clean = scene.asked & (scene.hidden < 0.2) & (scene.person > 0.95)
    known = clean & (scene.down < CLOSE[0]) & (scene.beside < CLOSE[1])
    values = values * np.array([OF_FACE, 1, 1], np.float32)
    for step in range(2 if colorful > 0.5 else 0):
        skin, cloth = known & (worn < 0.25), clean & (worn > 0.75)
        sure = cloth & (away > SURE)
        if step == 0 and sure.sum() > max(2 * LEAST, FEW * cloth.sum()):
            cloth = sure
        if cloth.sum() <= LEAST:
            break
        odds = np.zeros(worn.shape, np.float32)
        asked = values[scene.asked]
        odds[scene.asked] = (_likelihood(asked, _modes(values[cloth]))
                             - _likelihood(asked, _modes(values[scene.bare | skin])))
        worn = walk.settled(np.clip(odds, -4, 4) + ALONE * says + PLACE * place)
        known = clean  # a chest is as good as a neck, once it is found
    return worn > 0.5


def _values(image: Float32) -> Float32:
    """Lightness, redness and blueness of a picture's places in octaves, [h, w, 3]."""
    linear = np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)
    linear = cv2.GaussianBlur(np.asarray(linear, np.float32), (0, 0), 0.6) + np.float32(DARK)
    red, green, blue = np.moveaxis(linear, 2, 0)
    return np.asarray(np.dstack([np.log2(linear @ LUMINANCE.astype(np.float32)),
                                 np.log2(red / green), np.log2(blue / green)]), np.float32)


def _unlike_skin(values: Float32, bare: Bool) -> Float32:
    """How far places [h, w] are from the hue that skin has at their lightness, in deviations.

    Highlights are paler than what is around them, shade is redder; ``values`` are `_values`.
    """
    sample = values[bare]
    steps = np.quantile(sample[:, 0], SHARES)
    middles, spreads = [], []
    for low, high in itertools.pairwise(steps):
        some = sample[(sample[:, 0] >= low) & (sample[:, 0] <= high)]
        middles.append(np.median(some, axis=0))
        spreads.append(1.48 * np.median(np.abs(some - middles[-1]), axis=0))
    middle, spread = np.array(middles), np.hypot(np.array(spreads), HUE)
    light = values[..., 0]
    shade = 1 - REDDER * np.clip((middle[0, 0] - light) / DEEP, 0, 1)
    total = np.zeros(light.shape)
    for k, redder in ((1, 1), (2, -1)):
        off = values[..., k] - np.interp(light, middle[:, 0], middle[:, k])
        off = np.where(redder * off > 0, off * shade, off)
        total += (off / np.interp(light, middle[:, 0], spread[:, k])) ** 2
    total += np.maximum((light - steps[-1]) / BRIGHTER, 0) ** 2
    total += np.maximum((steps[0] - SHADE - light) / DARKER, 0) ** 2
    return np.asarray(np.sqrt(total), np.float32)


def _place(scene: _Scene) -> Float64:
    """What places [h, w] say of clothes, in logits."""
    out = (AT_NECK + DOWN[0] * np.clip(scene.down / DOWN[1], 0, 1)
           + OUT[0] * np.clip((scene.beside - OUT[1]) / OUT[2], 0, 1))
    return np.where(scene.neck, np.minimum(out, OF_NECK), out)


class _Walk:
    """A random walk over places that may be clothes, which edges hinder (`SurfaceGraph`).

    Parameters
    ----------
    scene : Whose skin it meets where they touch the face.
    bare : bool [h, w], what of both may be skin.
    """

    def __init__(self, scene: _Scene, bare: Bool) -> None:
        self.asked = scene.asked
        count = int(self.asked.sum())
        index = np.full(self.asked.shape, -1)
        index[self.asked] = np.arange(count)
        lab = np.asarray(cv2.cvtColor(scene.image, cv2.COLOR_RGB2LAB), np.float32)
        ends, steps = [], []
        for one, two in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
            both = (index[one] >= 0) & (index[two] >= 0)
            ends.append(np.stack([index[one][both], index[two][both]], axis=1))
            steps.append(((lab[one] - lab[two])[both] ** 2 * np.array([LIGHTNESS, 1, 1])).sum(1))
        step = np.concatenate(steps)
        usual = 2 * float(step.mean() if len(step) else 0.0) + FAINTEST
        self.graph = SurfaceGraph(np.arange(count), np.ones(count), np.concatenate(ends),
                                  np.exp(-step / usual) + PASSES)
        face = scene.head & (scene.hidden < 0.3) & (scene.person > 0.5)
        self.held = TRUST[1] * (ndimage.binary_dilation(face & bare) & bare)[self.asked]

    def settled(self, odds: NDArray[np.floating]) -> Float32:
        """How much places [h, w] are clothes, if these are the logits of what each says."""
        share = 1 / (1 + np.exp(-odds[self.asked].astype(np.float64)))
        trust = TRUST[0] * (2 * share - 1) ** 2 + 1e-4
        out = np.zeros(self.asked.shape, np.float32)
        out[self.asked] = self.graph.decided(trust * share / (trust + self.held),
                                             trust + self.held, ACCURACY)
        return out


Mode = tuple[float, Float64, Float64]
"""Logarithm of the share of a color less that of its spread; its mean [3]; what whitens it [3, 3].
"""


def _modes(sample: Float32) -> list[Mode]:
    """The colors of a part by k-means, of a sample [N, 3] with at least one value."""
    some = np.ascontiguousarray(sample[::max(1, len(sample) // 4000)])
    kinds = min(MODES, max(1, len(some) // 30))
    cv2.setRNGSeed(0)
    labels = np.zeros((len(some), 1), np.int32)
    cv2.kmeans(some, kinds, labels, (3, 20, 0.01), 1, cv2.KMEANS_PP_CENTERS)
    out: list[Mode] = []
    for kind in range(kinds):
        own = some[labels[:, 0] == kind]
        if len(own) < 10 and kinds > 1:
            continue
        spread = np.diag(SPREAD ** 2) + (np.cov(own.T) if len(own) > 3 else 0)
        root = np.linalg.cholesky(np.linalg.inv(spread))
        out.append((float(np.log(len(own) / len(some)) + np.log(np.diag(root)).sum()),
                    own.mean(axis=0), root))
    return out


def _likelihood(values: Float32, modes: list[Mode]) -> Float64:
    """Logarithms of how likely colors [N, 3] are one of the modes, [N]."""
    # Without the library that starts threads for a matrix.
    each = [level - 0.5 * np.minimum(
        (np.einsum("ni,ij->nj", values - middle, root) ** 2).sum(axis=1), 60.0)
        for level, middle, root in modes]
    return np.asarray(np.logaddexp.reduce(each, axis=0), np.float64)


def _without_crumbs(worn: Bool, scene: _Scene) -> Bool:
    """Clothes [h, w] without necklaces, buttons and what hangs at no bust."""
    reach, least = THIN / scene.cell, SMALL / scene.cell ** 2
    out = opened((worn & scene.asked) | (scene.person <= 0.5), reach) & scene.asked
    others = ~out & (scene.person > 0.5)
    out |= scene.asked & ~opened(others | (scene.person <= 0.5), reach)
    labels, count = ndimage.label(out)
    lowest = ndimage.maximum(np.broadcast_to(scene.down, out.shape), labels, np.arange(count + 1))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    out &= ((sizes >= least) & (np.asarray(lowest) > 0))[labels]
    # Skin hangs together with the face, be it behind hair, or is a hand.
    labels, count = ndimage.label((scene.asked & ~out) | scene.head | (scene.hidden >= 0.5))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    gaps = (sizes < least) & (np.arange(count + 1) > 0)
    return np.asarray(out | (scene.asked & gaps[labels]))
