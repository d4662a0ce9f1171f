"""What of an exemplar is laid where, by material and tone, and where the patch search begins.

The exemplar's materials are read from its picture (`picture_materials`). Who has a photo or a head
to be painted says what each of its places is made of (`photo`, `skin.painting`); tones
and detail of each material become those of the exemplar's.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter1d

from ...arrays import Bool, Float32, Floats, Int32, Int64
from ...color import to_lab
from ...labels import MATERIALS
from ..exemplar import Exemplar
from ..guides import filters
from ..kernels.labels import largest_share, move_to_material
from ..kernels.seeds import nearest_sites
from ..patches import SCALE
from ..surface_guide import Sites
from .picture_materials import CLOTHES, EARS, HAIR, NECK, SKIN

BLUR = 0.06
"""Sigma of the blur that separates detail from light, over the face's size (`face_size`)."""
CONTOUR = 0.016  # Detail of this strength (root mean square of luma) counts half.


def contours(values: Float32, inside: Float32, size: float) -> tuple[Float32, Float32]:
    """Luma without grain, and edge strength (edges and patterns), float32 [H, W] each.

    ``values`` are luma times the weight of a pixel, ``inside`` that weight; ``size`` is the face's
    in pixels.
    """
    sigma = BLUR * size
    soft = filters.gaussian_blur(values, 0.2 * sigma)
    soft /= np.maximum(filters.gaussian_blur(inside, 0.2 * sigma), np.float32(1e-3))
    near = filters.broad_blur(values, 0.6 * sigma)
    near /= np.maximum(filters.broad_blur(inside, 0.6 * sigma), np.float32(1e-3))
    fine = (soft - near) * inside
    energy = filters.broad_blur(fine * fine, 0.5 * sigma)
    return soft, np.asarray(energy / (energy + np.float32(CONTOUR ** 2)), np.float32)


CODES = np.array([[150, 150], [255, 0], [150, 138], [0, 60], [0, 255], [255, 255],
                  [174, 150]], np.float32)
"""A place in a plane for each of `MATERIALS`, far apart where they must not mix."""
ROAM = 25.0
"""Further than this from the guided place, in units of a 50th of the face, nothing gets dearer."""
DEPTH = 0.2
"""Well inside is this far from the edge, over the face's size, or most of the way there is."""
LEAST = 0.004  # A material that covers less of the exemplar than this is not there.
LEAST_HAIR = 0.25  # But so much hair, over the face's squared size, is there.
LEAST_CLOTHES = 0.012  # Clothes that cover less than this are too little to dress a body.
FEW = 100  # Fewer places than this say nothing of how tones are distributed.
SPREAD = 2.0
"""Tones of neck and clothes are drawn apart by no more: a plain shirt gets no stripes from an
exemplar's white collar on a dark coat."""
TONES, RARE, FINE = 24, 4.0, 1023
"""Tones that uses of the exemplar are evened out in; none is used so many times more than another;
and steps that are distinguished between them."""
HUES, MOST_OTHER = 8, 0.3
"""Tones between which the usual hue of flesh is interpolated; and no hue is further off."""
MANY_HUES = 0.08, 0.12
"""Where a quarter of the flesh is further off than the first, its hues begin not to count, further
than the second they do not (oils and prints 0.02 to 0.07, an expressionist's 0.13)."""
USUAL = 0.08
"""Flesh whose hue is so far from the usual one is to be used 1 / e times as often as other; the
search counts nothing as rarer than about a third."""
AGREES = 0.5, 3.0
"""Places that are moved so little to their material, in 50ths of the face, are where they belong;
those that are moved so far are not."""
LIT = 0.06, 0.12
"""A neck whose tone is so much off begins to be painted, and is wholly painted, as skin."""
NEARLY = (0.05, 0.25), (0.5, 0.7)
"""So little of a neck begins to be painted as skin at all, and so much of it lets all of it be."""
STAND_INS = ((CLOTHES, NECK), (NECK, SKIN), (HAIR, SKIN), (EARS, SKIN))
"""What stands in for a material that the exemplar does not show, in this order."""


@dataclass
class ExemplarMaterials:
    """Materials and looks of an exemplar at one scale."""

    shares: Float32  # float32 [h, w, 7] by `MATERIALS`.
    # tone, detail: float32 [h, w], luma blurred, and what that leaves out.
    tone: Float32
    detail: Float32
    nearest: Int32  # int32 [7, h, w], flat index of the nearest pixel of each material.
    deep: Int32  # The same, of the nearest pixel well inside each material.
    present: Bool  # bool [7], materials that it shows.
    # float32 [h, w], how far the broad color of flesh is from what flesh of its tone mostly has
    # (a and b of Lab, over 100); 0 where there is none.
    hue: Float32

    @property
    def luma(self) -> Float32:
        """Tone and detail together, float32 [h, w]."""
        return self.tone + self.detail

    @staticmethod
    def of(picture: Float32, shares: Float32, size: float, *, hues: bool = True,
           ) -> ExemplarMaterials:
        """From its picture [h, w, 3] and shares; ``size`` of the face in pixels.

        Without ``hues`` all of its flesh counts as of one.
        """
        luma = filters.grey(picture)
        present = shares.reshape(-1, len(MATERIALS)).mean(axis=0) > LEAST
        # Of a face that is small in its picture a lock or two are as large.
        present[HAIR] |= bool(shares[..., HAIR].sum() > LEAST_HAIR * size ** 2)
        present[CLOTHES] &= bool(shares[..., CLOTHES].mean() > LEAST_CLOTHES)
        nearest, deep = (np.empty((len(MATERIALS), *luma.shape), np.int32) for _ in range(2))
        for material in range(len(MATERIALS)):
            inside = shares[::2, ::2, material] > 0.6
            if material == EARS:
                inside |= shares[::2, ::2, [SKIN, EARS]].sum(axis=-1) > 0.6
            nearest[material] = _nearest(inside, luma.shape)
            depth = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2,
                                          cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
            limit = min(DEPTH * size / 2, 0.6 * float(depth.max(initial=0.0)))
            deep[material] = _nearest(inside & (depth >= limit), luma.shape)
        tone = filters.broad_blur(luma, BLUR * size)
        hue = (_other_hues(picture, shares, tone, size) if hues
               else np.zeros(luma.shape, np.float32))
        return ExemplarMaterials(shares, tone, luma - tone, nearest, deep, present, hue)


def _other_hues(picture: Float32, shares: Float32, tone: Float32, size: float) -> Float32:
    """How far flesh of a picture [h, w, 3] is of another hue than most flesh of its tone, [h, w].

    As for `ExemplarMaterials`; skin and neck by themselves.
    """
    out = np.zeros(tone.shape, np.float32)
    for alike in ([SKIN, EARS], [NECK]):
        share = shares[..., alike].sum(axis=-1)
        inside = share > 0.5
        if inside.sum() < FEW:
            continue
        broad = filters.blurred_within(picture, share, BLUR * size)
        hues, tones = to_lab(broad[inside])[:, 1:], tone[inside]
        edges = np.unique(np.quantile(tones, np.linspace(0, 1, HUES + 1)))
        which = np.clip(np.searchsorted(edges, tones) - 1, 0, max(len(edges) - 2, 0))
        middles = [(np.median(tones[which == n]), *np.median(hues[which == n], axis=0))
                   for n in np.unique(which)]
        at, *usual = np.array(middles).T
        off = [hues[:, n] - np.interp(tones, at, usual[n]) for n in range(2)]
        away = np.minimum(np.hypot(*off) / 100, MOST_OTHER)
        # Flesh that is orange here and blue there has no usual hue.
        few, many = MANY_HUES
        out[inside] = away * np.clip((many - np.quantile(away, 0.75)) / (many - few), 0, 1)
    return out


def _nearest(there: Bool, shape: tuple[int, ...]) -> Int32:
    """Flat index of the nearest pixel of a mask of every second pixel, int32 [h, w]."""
    rows, columns = np.arange(shape[0])[:, None], np.arange(shape[1])[None]
    if not there.any():
        return np.asarray(rows * shape[1] + columns, np.int32)
    # Each pixel of the mask has a number of its own, which is the nearest one's elsewhere.
    _, number = cv2.distanceTransformWithLabels(
        (~there).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    y, x = np.nonzero(there)
    place = np.zeros(int(number.max()) + 1, np.int32)
    place[number[y, x]] = np.minimum(2 * y, shape[0] - 1) * shape[1] + np.minimum(
        2 * x, shape[1] - 1)
    out = np.repeat(np.repeat(place[number], 2, 0), 2, 1)[:shape[0], :shape[1]]
    # On the mask a pixel is its own nearest one.
    own = np.repeat(np.repeat(there, 2, 0), 2, 1)[:shape[0], :shape[1]]
    return np.where(own, (rows * shape[1] + columns).astype(np.int32), out)


def stand_in(shares: Float32, present: Bool) -> None:
    """Let others stand in for materials that an exemplar does not show; in place.

    ``shares`` float32 [..., 7] by `MATERIALS`, ``present`` bool [7].
    """
    for material, other in STAND_INS:
        if not present[material]:
            shares[..., other] += shares[..., material]
            shares[..., material] = 0


def light_neck(shares: Float32, tone: Float32, theirs: ExemplarMaterials,
               shown: Bool | None = None) -> None:
    """Let skin stand in for a neck that the exemplar shows in another light, in place.

    The sitter's face says how light his neck would be in the exemplar's paint. Where the exemplar's
    own neck is not, as it lies in the chin's shadow or is drawn in a few dark strokes, the paint of
    its face is nearer: in ``shares`` float32 [N, 7] skin grows at the neck's cost. ``tone`` float32
    [N] in [0, 1] is the sitter's; ``shown`` bool [N] are places that photos show (None: all),
    others don't show how light a neck is.
    """
    neck, face = (mostly(shares[:, part].sum(axis=1), shown) for part in ([NECK], [SKIN, EARS]))
    their_neck, their_face = (theirs.shares[..., part].sum(axis=-1) > 0.5
                              for part in ([NECK], [SKIN, EARS]))
    if min(part.sum() for part in (neck, face, their_neck, their_face)) < FEW:
        return
    by_face, by_neck = (_like(tone, ours, theirs.tone, those)
                        for ours, those in ((face, their_face), (neck, their_neck)))
    other = np.clip((np.abs(by_face - by_neck) - LIT[0]) / (LIT[1] - LIT[0]), 0, 1)
    other *= shares[:, NECK]
    # Mostly one of them is all of it: a neck of two paints has a seam that the sitter's has not.
    part = float(other.sum()) / float(shares[:, NECK].sum())
    (least, some), (most, every) = NEARLY
    other *= np.clip((part - least) / (some - least), 0, 1)
    other += (shares[:, NECK] - other) * np.clip((part - most) / (every - most), 0, 1)
    shares[:, SKIN] += other
    shares[:, NECK] -= other


def mostly(share: Float32, shown: Bool | None) -> Bool:
    """Places [N] that are mostly of a material: those that are shown, where they are enough."""
    inside = share > 0.5
    seen = inside if shown is None else inside & shown
    return seen if seen.sum() >= FEW else inside


def _like(tone: Float32, ours: Bool, reference: Float32, theirs: Bool) -> Float32:
    """Tones [N], changed so that ``ours`` are distributed as ``theirs`` of the reference are."""
    wanted = filters.Distribution.of(reference, theirs.astype(np.float32))
    return filters.match_histogram(np.ascontiguousarray(tone[None]), wanted,
                                   ours[None].astype(np.float32))[0]


def matched_looks(tone: Float32, detail: Float32, shares: Float32, theirs: ExemplarMaterials,
                  reference: Float32 | None = None, shown: Bool | None = None,
                  darkest: float = 0.0) -> tuple[Float32, Float32]:
    """Tones and detail [N] of places as the exemplar would have them, float32 [N] each.

    Tones are distributed as the exemplar's of the same material (`SPREAD`). Detail is made as
    strong as its strokes, within bounds: noise of a plain place does not become strokes. Nothing is
    said about the background: both are 0 there. ``reference`` [h, w] are the exemplar's tones, by
    default ``theirs.tone``; of the places only those ``shown``, bool [N], define the distribution
    of ours.
    """
    reference = theirs.tone if reference is None else reference
    out, strong = (np.zeros(len(shares), np.float32) for _ in range(2))
    for material in (SKIN, HAIR, NECK, CLOTHES):
        alike = [SKIN, EARS] if material == SKIN else [material]
        share = shares[:, alike].sum(axis=1)
        inside = mostly(share, shown)
        there = theirs.shares[..., alike].sum(axis=-1) > 0.5
        if not (share > 0).any():
            continue
        if inside.sum() < FEW or there.sum() < FEW:
            out += share * tone
            strong += share * detail
            continue
        matched = _like(tone, inside, reference, there)
        if material in (NECK, CLOTHES):
            middle = np.median(matched[inside])
            most = SPREAD * tone[inside].std() / max(float(reference[there].std()), 1e-4)
            matched = middle + (matched - middle) * np.float32(min(1.0, most))
        if material in (SKIN, NECK) and darkest > 0:
            matched = np.maximum(matched, np.quantile(reference[there], darkest))
        out += share * matched
        gain = theirs.detail[there].std() / max(float(detail[inside].std()), 1e-4)
        strong += share * detail * np.float32(np.clip(gain, 0.5, 2.5))
    return out, strong


def material_guides(shares: Float32, tone: Float32, detail: Float32, hue: Float32,
                    weights: tuple[float, float, float, float]) -> Float32:
    """Guides of patches, float32 [..., 5]: detail, tone, materials (2), hue.

    ``shares`` are float32 [..., 7]. The weights are those of tone, detail, materials and hue.
    """
    roots = SCALE * np.sqrt([weights[1], weights[0], *[weights[2] / 2] * 2, weights[3]])
    planes = np.concatenate([255 * detail[..., None], 255 * tone[..., None], shares @ CODES,
                             255 * hue[..., None]], axis=-1)
    return np.asarray(planes * roots.astype(np.float32), np.float32)


def even_uses(shares: Float32, tone: Float32, theirs: ExemplarMaterials,
              factor: float | Float32, reference: Float32 | None = None) -> Float32:
    """How often each pixel of an exemplar would be used if those alike were used alike, [h, w].

    Alike are pixels of a material and of a tone: were all skin to be used alike, the shade under a
    painter's cheekbone would have to lie somewhere, and be a stain on a back.

    Parameters
    ----------
    shares, tone : float32 [N, 7] and [N], the places to be painted.
    factor : Pixels to be painted for each place, times how much more often than evenly the
        exemplar's may be used; one number, or one for each material.
    reference : float32 [h, w], the exemplar's tones, by default ``theirs.tone``.
    """
    reference = theirs.tone if reference is None else reference
    factors = np.broadcast_to(np.asarray(factor, np.float32), (len(MATERIALS),))
    steps = np.linspace(0, 1, TONES)
    fine = np.clip(np.rint(reference * FINE), 0, FINE).astype(np.int32)
    out, usual = np.zeros(theirs.tone.shape, np.float32), np.exp(-(theirs.hue / USUAL) ** 2)
    ours, these = (np.clip(np.rint(tones.reshape(-1) * (TONES - 1)), 0, TONES - 1).astype(int)
                       for tones in (tone, reference))
    for material in range(len(MATERIALS)):
        share = theirs.shares[..., material] * usual
        asked, there = (gaussian_filter1d(np.bincount(bins, weights, TONES), 1.0, mode="nearest")
                        for bins, weights in ((ours, shares[:, material]),
                                              (these, share.reshape(-1))))
        if asked.sum() == 0 or there.sum() == 0:
            continue
        alike = asked.sum() / max(there.sum(), 1.0)
        uses = np.clip(asked / np.maximum(there, 1e-3 * there.sum()), alike / RARE, alike * RARE)
        table = np.interp(np.linspace(0, 1, FINE + 1), steps, factors[material] * uses)
        out += share * np.take(table.astype(np.float32), fine)
    return out


def resized_materials(exemplar: Exemplar, shares: Float32, size: float, *, hues: bool = True,
                      ) -> tuple[Float32, ExemplarMaterials]:
    """An exemplar's picture, float32 [h, w, 3], and its materials at ``size`` times its own.

    Without ``hues`` all of its flesh counts as of one.
    """
    height, width = exemplar.image.shape[:2]
    shape = max(round(width * size), 16), max(round(height * size), 16)
    picture = np.asarray(Image.fromarray(exemplar.image).resize(
        shape, Image.Resampling.LANCZOS), np.float32) / np.float32(255)
    small = np.stack([np.asarray(Image.fromarray(shares[..., n]).resize(
        shape, Image.Resampling.BILINEAR)) for n in range(len(MATERIALS))], axis=-1)
    return picture, ExemplarMaterials.of(picture, small, exemplar.size * size, hues=hues)


def main_material(shares: Float32) -> Int64:
    """The material that each place is mostly, int64 [N], of shares float32 [N, 7]."""
    out = np.empty(len(shares), np.int64)
    largest_share(np.ascontiguousarray(shares, np.float32), out)
    return out


def nearest_of_material(material: Int64, theirs: ExemplarMaterials, position: Float32) -> Float32:
    """Positions [N, 2], moved to the exemplar's nearest place of a material, int64 [N]."""
    out = np.empty(position.shape, np.float32)
    move_to_material(np.ascontiguousarray(position, np.float32), material, theirs.nearest, out)
    return out


def guide_agreement(guided: Float32, wanted: Float32, unit: float) -> Float32:
    """How far the exemplar has the material where the guide leads, [N] in [0, 1].

    A place under a hat that is to be a forehead has been moved to the rim of the hat's shade: that
    is not where a forehead should come from. The guide's places and those of like material next to
    them (`nearest_of_material`) are float32 [N, 2]; ``unit`` is a 50th of the face.
    """
    away = np.linalg.norm(wanted - guided, axis=1) / np.float32(unit)
    near, far = AGREES
    return np.asarray(np.clip((far - away) / (far - near), 0, 1), np.float32)


@dataclass(frozen=True)
class Placement:
    """Where an exemplar has what N places are made of."""

    material: Int64  # int64 [N], what each place is mostly (`main_material`).
    # float32 [N, 2], where the guide leads, moved into like material; pixels of the exemplar.
    wanted: Float32
    agreement: Float32  # float32 [N] in [0, 1], how far the exemplar has it where the guide leads.

    @staticmethod
    def of(shares: Float32, theirs: ExemplarMaterials, guided: Float32, unit: float) -> Placement:
        """Of shares [N, 7] and guided places [N, 2]; ``unit`` as for `guide_agreement`."""
        material = main_material(shares)
        wanted = nearest_of_material(material, theirs, guided)
        return Placement(material, wanted, guide_agreement(guided, wanted, unit))


PIECE = 0.3  # Side of the pieces that the search begins with, over the exemplar's face size.
PLACES, R2 = 16, (0.7548776662, 0.5698402910)
"""So many places are tried for a piece, one after the other of this sequence."""
FAR, AWAY = 2.0, 0.05
"""Breadth of where these lie, over the face's size, and the tone that so far away costs."""


def pieces(material: Int64, theirs: ExemplarMaterials, wanted: Float32, plane: Float32,
           tone: Float32, size: float) -> Float32:
    """Rigid pieces of like material for the search to begin with, places float32 [N, 2].

    Pieces lie around jittered sites of the plane [N, 2] and come from well inside the same
    material, near the guided place or some way off: alike, but not the same next to each other. Of
    a few such places that is taken whose tone is the nearest to the one asked for, so that a dark
    piece does not lie beside a light one where the sitter is all alike.

    Parameters
    ----------
    material : int64 [N], what the sitter's places are mostly (`main_material`).
    wanted, plane : float32 [N, 2], the guided places in the exemplar and those in the plane;
        pixels.
    tone : float32 [N], asked for.
    size : Of the exemplar's face in these pixels.
    """
    side = PIECE * size
    sites = Sites.around(plane, side)
    number = np.empty(len(plane), np.int32)
    nearest_sites(plane, np.float32(side), sites.first, sites.points, number)
    middles = sites.points.reshape(-1, 2)
    count = np.maximum(np.bincount(number, minlength=len(middles)), 1)
    guided = np.stack([np.bincount(number, wanted[:, axis], len(middles)) / count
                       for axis in range(2)], axis=-1)
    asked = np.bincount(number, tone, len(middles)) / count
    votes = np.bincount(number * len(MATERIALS) + material, minlength=len(middles) * len(MATERIALS))
    kinds = votes.reshape(len(middles), -1).argmax(axis=1)
    best, chosen = np.full(len(middles), np.inf), np.zeros((len(middles), 2))
    for turn in range(PLACES):
        # The R2 sequence: places that lie evenly, in another order for each site.
        chance = (sites.chances.reshape(-1, 2) + turn * np.array(R2)) % 1
        place = guided + FAR * size * (chance - 0.5)
        there = theirs.deep[kinds, *exemplar_pixels(place, theirs)]
        off = np.abs(theirs.tone.reshape(-1)[there] - asked)
        off += theirs.hue.reshape(-1)[there]
        off += AWAY / size * np.linalg.norm(place - guided, axis=1)
        better = off < best - 1e-6
        best[better], chosen[better] = off[better], place[better]
    y, x = exemplar_pixels(chosen, theirs)
    found, width = theirs.deep[material, y[number], x[number]], theirs.tone.shape[1]
    piece = np.stack([found % width, found // width], axis=1) + np.float32(0.5)
    piece += plane - middles[number]
    return nearest_of_material(material, theirs, np.asarray(piece, np.float32))


def exemplar_pixels(places: Floats, theirs: ExemplarMaterials) -> tuple[Int64, Int64]:
    """Rows and columns of the exemplar's pixels at places [N, 2] (x, y), or next to them."""
    height, width = theirs.tone.shape
    return (np.clip(places[:, 1], 0, height - 1).astype(np.int64),
            np.clip(places[:, 0], 0, width - 1).astype(np.int64))
