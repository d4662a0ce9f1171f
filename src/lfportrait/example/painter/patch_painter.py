"""The patch painter for photos and heads: exemplar patches of the same material over an atlas.

An atlas is a picture whose pixels are places of what is painted: the charts of a head's surface
(`skin.sitter.Canvas`), or a photo, which is an atlas with one chart (`PhotoAtlas`). Who paints says
of each place what it is made of, how light it is to be and where in the exemplar the guide leads
(`PatchRequest`); the painter lays patches that agree with each other and with what is painted
already.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ...arrays import Float32, Int32, UInt8
from ..exemplar import Exemplar
from ..kernels.patches import ACTIVE
from ..patches import (
    GuideLevels,
    PatchSearch,
    PatchSource,
    PatchTarget,
    start_levels,
    synthesise_patches,
)
from .materials import ROAM, ExemplarMaterials, even_uses, material_guides, resized_materials
from .picture_materials import EARS, NECK, SKIN

PLACE, FAR_PLACE = 4.0, 0.15
"""Weight of the position guide around the face; and in hair, neck, clothes and background, where it
is not rigid. Chosen by eye on the demo's heads and paintings."""


class GuideWeights(NamedTuple):
    """Weights of the guides of a patch search, by default those of heads.

    They were chosen by eye on the demo's heads and paintings.
    """

    tone: float = 0.5
    """Of the photo's light and shade."""
    detail: float = 2.0
    """Of the photo's edges and patterns."""
    material: float = 3.0
    """Of keeping hair, skin and clothes separate."""
    hue: float = 1.0
    """Of keeping flesh of one hue: what is green on a painter's temple makes stains on a scalp."""


class Atlas(Protocol):
    """Where N places lie in a picture [H, W].

    Attributes
    ----------
    slots : int32 [H, W], the number of each pixel's place; -1 where there is none.
    owner : int32 [H, W], the flat index of the pixel that owns what a pixel shows (copies at the
        charts' edges), or None where each owns its own.
    """

    @property
    def slots(self) -> Int32:
        """See above."""

    @property
    def owner(self) -> Int32 | None:
        """See above."""

    def spread(self, values: Float32) -> Float32:
        """Values [N, C] of the places as a picture [H, W, C]."""


@dataclass(frozen=True)
class PhotoAtlas:
    """A photo [H, W]: an atlas with one chart, whose places are its pixels."""

    shape: tuple[int, int]

    @property
    def slots(self) -> Int32:
        """The pixels' numbers."""
        return np.arange(self.shape[0] * self.shape[1], dtype=np.int32).reshape(self.shape)

    @property
    def owner(self) -> None:
        """Each pixel owns what it shows."""
        return None

    def spread(self, values: Float32) -> Float32:
        """Values [N, C] as a picture [H, W, C]."""
        return np.asarray(values, np.float32).reshape(*self.shape, -1)


@dataclass
class PatchRequest:
    """What is to be painted at N places, and what is painted already."""

    shares: Float32  # float32 [N, 7] by `MATERIALS`.
    # tone, detail: float32 [N], luma and its fine part as the exemplar would have them.
    tone: Float32
    detail: Float32
    # wanted, begin: float32 [N, 2], places in the exemplar (in pixels of the painting's size):
    # where the guide leads, moved into like material, and where the search begins.
    wanted: Float32
    begin: Float32
    weight: Float32  # float32 [N], of staying near ``wanted``, in units of a squared pixel.
    sure: Float32  # float32 [N, 2], how far detail and tone are to be trusted.
    # uint8 [H, W]: `ACTIVE` is to be painted, `FIXED` is, `FOREIGN` is another's copy, `OUTSIDE` is
    # nothing.
    state: UInt8
    color: Float32  # float32 [H, W, 3] in [0, 1], what is painted.
    # How often the exemplar's pixels may be used, against evenly: a number, or one a material.
    often: float | Float32 = 1.0
    own: bool = False  # Whether ``color`` may be painted over.
    # float32 [N], how far flesh is to be of another hue than most (`ExemplarMaterials`); None: 0.
    hue: Float32 | None = None


class PatchPainter:
    """One exemplar prepared for painting with patches.

    ``shares`` float32 [h, w, 7] is what it is made of (`known_shares`); ``sharp``: whether tones
    are compared with their detail, as on photos, or blurred, as on heads.
    """

    def __init__(self, exemplar: Exemplar, shares: Float32, search: PatchSearch, seed: int,
                 sharp: bool, weights: GuideWeights | None = None) -> None:
        self.exemplar, self.shares, self.search, self.seed = exemplar, shares, search, seed
        self._sharp, self._weights = sharp, weights or GuideWeights()
        self._sources: dict[float, tuple[PatchSource, ExemplarMaterials]] = {}

    def unit(self, size: float) -> float:
        """A 50th of the exemplar's face in pixels of a painting of ``size``."""
        return self.exemplar.size * size / 50

    def tones(self, theirs: ExemplarMaterials) -> Float32:
        """The exemplar's tones that ours are compared with, float32 [h, w]."""
        return theirs.luma if self._sharp else theirs.tone

    def source(self, size: float) -> tuple[PatchSource, ExemplarMaterials]:
        """The exemplar at ``size`` times its own, its pyramid and materials; the last is kept.

        Three decimals of the size count: its pictures serve all that are nearly as large.
        """
        size = round(size, 3)
        if size not in self._sources:
            picture, theirs = resized_materials(self.exemplar, self.shares, size,
                                                hues=self._weights.hue > 0)
            self._sources = {size: (PatchSource.of(picture, self._guides(
                theirs.shares, self.tones(theirs), theirs.detail, theirs.hue)), theirs)}
        return self._sources[size]

    def _target(self, atlas: Atlas, size: float, request: PatchRequest) -> PatchTarget:
        """What the patches are to do."""
        source, theirs = self.source(size)
        painted = request.state == ACTIVE
        active = np.zeros(len(request.shares), bool)
        active[atlas.slots[painted]] = True
        even = even_uses(request.shares[active], request.tone[active], theirs, request.often,
                         self.tones(theirs))
        # First, as the planes that these are made of are the largest of all.
        hue = np.zeros_like(request.tone) if request.hue is None else request.hue
        guides = GuideLevels.of(atlas.spread(self._guides(
            request.shares, request.tone, request.detail, hue)), source, self.search)
        start = start_levels(atlas.spread(request.begin), source, self.search)
        asked, weight, sure = (atlas.spread(values) for values in (
            request.wanted, request.weight[:, None], request.sure))
        return PatchTarget(guides, start, start, asked,
                           np.ascontiguousarray(weight[..., 0]),
                           float((ROAM * self.unit(size)) ** 2), even, sure, request.state,
                           atlas.owner, request.color, request.own)

    def paint(self, atlas: Atlas, size: float, request: PatchRequest) -> Float32:
        """The painting at ``size`` times the exemplar's own, float32 [H, W, 3] in [0, 1]."""
        target = [self._target(atlas, size, request)]
        del request  # a hundred MB, which nobody needs during the search
        return synthesise_patches(target.pop(), self.source(size)[0], self.search, self.seed)[0]

    def _guides(self, shares: Float32, tone: Float32, detail: Float32, hue: Float32) -> Float32:
        return material_guides(shares, tone, detail, hue, self._weights)


def flesh(shares: Float32) -> Float32:
    """How far places are skin, neck or ears, float32 [...]."""
    return np.asarray(shares[..., [SKIN, NECK, EARS]].sum(axis=-1), np.float32)
