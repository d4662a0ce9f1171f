"""A skin painted by example, once for all views (after Shen et al. 2023, 2.2 and Eq. 6).

The face is painted as on a photo: guides, look-up table, StyleBlit. Everything else starts from
there and becomes patches of the exemplar that agree with each other (`patches`), guided by what the
sitter is made of (skin, hair, clothes), by the photo's tones and by its detail. So what the
exemplar does not show - the back of a head, a neck, a chest - goes on from what it does show, from
like material, and edges and patterns of the photo stay.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import distance_transform_edt

from ..exemplar import Exemplar
from ..guides.appearance import Distribution, grey, match_histogram
from ..guides.blurs import gaussian_blur
from ..guides.labels import LABELS
from ..guides.maps import Guides, anchor_scale, relative_stretch, sample_labels
from ..kernels.atlas import exchange, look_up_colors
from ..kernels.patches import ACTIVE, FIXED, FOREIGN, OUTSIDE
from ..patches import SCALE, PatchConfig, PatchSource, PatchTarget, synthesise_patches
from ..styleblit import finest_level, synthesise
from ..surface_guide import SurfaceGuide
from ..transfers import CALM, Transfer, TransferConfig
from .sitter import Skin, skin_distance

__all__ = ["Painting", "SkinConfig", "SkinPainter"]

Float32 = NDArray[np.float32]

MATERIALS = ("skin", "hair", "neck", "clothes", "background")
CONTOUR = 0.016
"""Detail of this strength (root mean square of luma) counts half."""
CODES = np.array([[150, 150], [255, 0], [150, 120], [0, 60], [0, 255]], np.float32)
"""A place in a plane for each material, far apart where they must not mix."""


@dataclass(frozen=True)
class SkinConfig:
    """Painting on the skin."""

    tone_weight: float = 0.3
    """Weight of the photo's light and shade where patches are laid, 0 to 2."""
    detail_weight: float = 1.0
    """Weight of the photo's edges and patterns there, 0 to 4."""
    material_weight: float = 1.5
    """Weight of keeping hair, skin and clothes apart, 0 to 4."""
    place_weight: float = 4.0
    """Weight of staying near the place that the guide names, around the face, 0 to 20."""
    far_place_weight: float = 0.15
    """The same in hair, on neck and clothes."""
    patches: PatchConfig = field(default_factory=lambda: PatchConfig(
        style_weight=1.0, uniformity=2000.0, votes=4, passes=2, levels=5))
    """Synthesis of patches."""


@dataclass
class Painting:
    """A painted skin.

    Attributes
    ----------
    skin
        What was painted on.
    color
        float32 [H, W, 3] in [0, 1], sRGB, of the atlas; copies and fringes filled.
    labels
        uint8 [H, W, K], soft regions of the atlas, see `LABELS`.
    seconds
        By step.
    steps
        Intermediates by name, for pictures.
    """

    skin: Skin
    color: Float32
    labels: NDArray[np.uint8]
    seconds: dict[str, float]
    steps: dict[str, Float32] = field(default_factory=dict)

    def at(self, places: Float32) -> Float32:
        """Colours at places [N, 2] of the atlas, float32 [N, 3]; NaN where those are."""
        out = np.full((len(places), 3), np.nan, np.float32)
        look_up_colors(self.color, places, out)
        return out


@dataclass
class _Materials:
    """What the pixels of a picture are, and their tones and detail.

    ``shares`` float32 [h, w, 5] by `MATERIALS`; ``tone`` and ``detail`` float32 [h, w].
    """

    shares: Float32
    tone: Float32
    detail: Float32


class SkinPainter:
    """One exemplar prepared for painting skins.

    Parameters
    ----------
    exemplar
        The painting.
    config, transfer
        Parameters; ``transfer`` those of the face.
    seed
        Of chunks and search.
    """

    def __init__(self, exemplar: Exemplar, config: SkinConfig | None = None,
                 transfer: TransferConfig | None = None, seed: int = 0) -> None:
        self.exemplar, self.seed = exemplar, seed
        self.config = config or SkinConfig()
        self.transfer = Transfer(exemplar, replace(transfer or TransferConfig(), seed=seed))
        self._sources: dict[float, tuple[PatchSource, _Materials]] = {}

    def paint(self, skin: Skin, progress: Any = None) -> Painting:
        """Paint a skin."""
        seconds: dict[str, float] = {}
        clock = time.perf_counter()

        def lap(name: str) -> None:
            nonlocal clock
            now = time.perf_counter()
            seconds[name] = round(now - clock, 4)
            clock = now

        atlas = skin.atlas
        own = atlas.own
        guide = SurfaceGuide(skin.landmarks, self.exemplar, self.transfer.regions)
        points = np.where(own[..., None], atlas.points, np.nan)
        position, anchor = guide(points)
        lap("guides")
        image, shift = self._blit(skin, guide, position, anchor)
        lap("blit")
        labels = sample_labels(self.transfer.labels, position)
        color = self._lay_patches(skin, guide, position, anchor, anchor + shift, image, labels,
                                  lap)
        exchange(atlas.owner, color)
        exchange(atlas.owner, self.crisp)
        steps = {"crisp": self.crisp, "blit": image, "position": position}
        return Painting(skin, color, labels, seconds, steps)

    def _blit(self, skin: Skin, guide: SurfaceGuide, position: Float32,
              anchor: Float32) -> tuple[Float32, Float32]:
        """StyleBlit over the whole skin: colours, and the chunks' shifts."""
        transfer, config = self.transfer, self.transfer.config
        own = skin.atlas.own
        scale = guide.scale / skin.pixels
        sigma = config.blur * self.exemplar.size / scale
        appearance = _detail(skin, sigma, 0.2 * sigma)
        appearance = match_histogram(appearance, transfer._distribution, own)
        person = np.ones(own.shape, np.float32)
        labels = sample_labels(transfer.labels, position)
        weights = transfer._weights(person, labels, position, scale)
        guides = Guides(position, appearance, labels, anchor)
        weights[..., 0] *= relative_stretch(position, anchor)
        weights[..., 1] *= skin.seen
        result = synthesise(
            guides, weights, config.label_weight, transfer.appearance, transfer.labels,
            transfer.table, transfer.colours(scale), config.blit, seed=self.seed, scale=None,
            finest=finest_level(anchor_scale(anchor)),
            calm=CALM * 255 * config.table.appearance_weight)
        return result.image, result.shift

    def _lay_patches(self, skin: Skin, guide: SurfaceGuide, position: Float32, anchor: Float32,
                     places: Float32, image: Float32, labels: NDArray[np.uint8], lap: Any) -> Float32:
        """Patches that agree, over all that is not the face."""
        config, atlas = self.config, skin.atlas
        ratio = round(skin.pixels / guide.scale, 3)
        source, own_materials = self._source(ratio)
        lap("source")
        unit = self.exemplar.size * ratio / 50
        face = sample_labels(self.transfer._face[..., None], position)[..., 0] / np.float32(255)
        own = atlas.own
        materials = self._sitter(skin, labels, own_materials, unit)
        state = np.full(own.shape, OUTSIDE, np.uint8)
        state[np.isfinite(atlas.depth)] = FOREIGN
        state[own] = ACTIVE
        # A surface seen from within, where no photo looked, is no face.
        outwards = atlas.shape.at(atlas.points)[..., 2] > -0.2
        state[own & (face > 0.5) & outwards] = FIXED
        wanted = _into(materials, own_materials, position * np.float32(ratio))
        start = np.where(np.isfinite(places), places * np.float32(ratio), wanted)
        near = gaussian_blur(np.asarray(face, np.float32), 6 * unit)
        skinlike = materials.shares[..., 0] * relative_stretch(position, anchor) ** 2
        weight = (config.far_place_weight + (config.place_weight - config.far_place_weight)
                  * np.clip(2 * near, 0, 1) * skinlike) / np.float32(unit ** 2) * 100
        guides = self._guides(materials)
        # An ear is told by its own light and shade.
        trust = _contours(skin, unit) * (1 + 3 * skin.ears)
        values = np.concatenate([guides, start, wanted, wanted, weight[..., None],
                                 trust[..., None], image], axis=-1).astype(np.float32)
        exchange(atlas.owner, values)
        count = guides.shape[2]
        target = PatchTarget(
            np.ascontiguousarray(values[..., :count]), values[..., count:count + 2],
            values[..., count + 2:count + 4], values[..., count + 4:count + 6],
            values[..., count + 6], float((25 * unit) ** 2),
            _even(materials, own_materials, state == ACTIVE), values[..., count + 7], state,
            atlas.owner,
            np.ascontiguousarray(values[..., -3:]))
        lap("targets")
        color, places = synthesise_patches(target, source, config.patches, self.seed)
        self.crisp = np.where((state == ACTIVE)[..., None], source.pictures[0].reshape(-1, 3)[places], color)
        lap("patches")
        return color

    def _roots(self) -> Float32:
        """Roots of the guides' weights, times `SCALE`: tone, detail, materials (2)."""
        config = self.config
        return np.asarray(SCALE * np.sqrt([config.tone_weight, config.detail_weight,
                                           *[config.material_weight / 2] * 2]), np.float32)

    def _guides(self, materials: _Materials) -> Float32:
        """Guides of the patches, float32 [h, w, 4]."""
        planes = np.stack([255 * materials.tone, 255 * materials.detail], axis=-1)
        codes = materials.shares @ CODES
        return np.asarray(np.concatenate([planes, codes], -1) * self._roots(), np.float32)

    def _source(self, ratio: float) -> tuple[PatchSource, _Materials]:
        """The exemplar at the charts' scale: its pyramid and materials; kept."""
        if ratio in self._sources:
            return self._sources[ratio]
        regions, labels = self.transfer.regions, self.transfer.labels
        height, width = self.exemplar.image.shape[:2]
        size = max(round(width * ratio), 16), max(round(height * ratio), 16)
        picture = np.asarray(Image.fromarray(self.exemplar.image).resize(
            size, Image.Resampling.LANCZOS), np.float32) / np.float32(255)
        shares = _shares(labels)
        features = labels[..., [LABELS.index(n) for n in ("brows", "eyes", "nose", "lips")]]
        plain = (labels[..., LABELS.index("skin")] > 200) & (features.sum(-1) < 30)
        image = self.exemplar.image.astype(np.float32) / np.float32(255)
        away = skin_distance(gaussian_blur3(image, 0.02 * self.exemplar.size), plain)
        bare = 1 / (1 + np.exp(np.clip((away - 2.5) / 0.4, -30, 30)))
        shares[..., 3] = shares[..., 2] * (1 - bare)
        shares[..., 2] *= bare
        shares = np.stack([np.asarray(Image.fromarray(shares[..., n]).resize(
            size, Image.Resampling.BILINEAR)) for n in range(len(MATERIALS))], axis=-1)
        luma = grey(picture)
        sigma = self.transfer.config.blur * self.exemplar.size * ratio
        materials = _Materials(shares, luma, luma - gaussian_blur(luma, sigma))
        pyramid = PatchSource.of(picture, self._guides(materials))
        self._sources = {ratio: (pyramid, materials)}
        return self._sources[ratio]

    def _sitter(self, skin: Skin, labels: NDArray[np.uint8], theirs: _Materials,
                unit: float) -> _Materials:
        """The sitter's materials; tones and detail distributed as the exemplar's, by material."""
        shares = _shares(labels)
        if skin.hair is not None:
            hair = skin.hair
            rest = np.maximum(1 - shares[..., 1], 1e-3)
            shares[..., [0, 2]] *= ((1 - hair) / rest)[..., None]
            # What the exemplar has as hair and the sitter does not is skin.
            shares[..., 0] += np.maximum(1 - hair - shares[..., [0, 2]].sum(-1), 0)
            shares[..., 1] = hair
        ears = skin.ears * (1 - skin.hair if skin.hair is not None else np.float32(1))
        shares *= (1 - ears)[..., None]
        shares[..., 0] += ears
        clothes = skin.clothes
        shares *= (1 - clothes)[..., None]
        shares[..., 3] = clothes
        shares[..., 2] += shares[..., 4]
        shares[..., 4] = 0
        shares /= np.maximum(shares.sum(-1, keepdims=True), 1e-3)
        present = theirs.shares.reshape(-1, len(MATERIALS)).mean(0) > 0.004
        for material, stand_in in ((3, 2), (2, 0), (1, 0)):
            if not present[material]:
                shares[..., stand_in] += shares[..., material]
                shares[..., material] = 0
        sigma = self.transfer.config.blur * self.exemplar.size * unit * 50 / self.exemplar.size
        luma = grey(skin.atlas.color)
        detail = _detail(skin, sigma, 0.7)
        tone = luma.copy()
        own = skin.atlas.own
        for values, reference in ((tone, theirs.tone), (detail, theirs.detail)):
            matched = np.zeros_like(values)
            for material in range(4):
                share = shares[..., material]
                inside = own & (share > 0.5)
                there = theirs.shares[..., material] > 0.5
                if inside.sum() < 100 or there.sum() < 100:
                    matched += share * values
                    continue
                if values is detail:
                    # Noise of a plain place is not made as strong as strokes.
                    gain = reference[there].std() / max(float(values[inside].std()), 1e-4)
                    matched += share * values * np.float32(np.clip(gain, 0.5, 2.5))
                    continue
                wanted = Distribution.of(reference, there.astype(np.float32))
                matched += share * match_histogram(values, wanted, inside)
            values[:] = matched
        # What no photo saw has no detail, and the material's middle tone.
        detail *= skin.seen
        return _Materials(shares, tone, detail)


def _even(materials: _Materials, theirs: _Materials, active: NDArray[np.bool_]) -> Float32:
    """How often each exemplar pixel is used if those of its material are used alike, [h, w]."""
    wanted = materials.shares[active].sum(0)
    there = theirs.shares.reshape(-1, len(MATERIALS)).sum(0)
    return np.asarray(theirs.shares @ (wanted / np.maximum(there, 1.0)).astype(np.float32),
                      np.float32)


def _contours(skin: Skin, unit: float) -> Float32:
    """How much the photo has to say at a place: strong where it shows edges or a pattern.

    float32 [H, W] in [0, 1]: the energy of its detail against that of what is hardly seen.
    """
    detail = _detail(skin, 2.0 * unit, 0.3 * unit)
    energy = gaussian_blur(detail * detail, 1.5 * unit)
    return np.asarray(skin.seen * energy / (energy + CONTOUR ** 2), np.float32)


def gaussian_blur3(image: Float32, sigma: float) -> Float32:
    """A picture [H, W, 3] blurred."""
    return np.stack([gaussian_blur(np.ascontiguousarray(image[..., c]), sigma)
                     for c in range(3)], axis=-1)


def _shares(labels: NDArray[np.uint8]) -> Float32:
    """Shares of `MATERIALS` by soft labels: features are skin, a body is neck."""
    share = labels.astype(np.float32) / np.float32(255)
    named = {name: share[..., n] for n, name in enumerate(LABELS)}
    skin = named["skin"] + named["brows"] + named["eyes"] + named["nose"] + named["lips"]
    out = np.stack([skin, named["hair"], named["body"], np.zeros_like(skin),
                    named["background"]], axis=-1)
    return np.asarray(out / np.maximum(out.sum(-1, keepdims=True), 1e-3), np.float32)


def _into(materials: _Materials, theirs: _Materials, position: Float32) -> Float32:
    """Positions [H, W, 2], moved to the exemplar's nearest place of the like material."""
    best = materials.shares.argmax(-1)
    height, width = theirs.tone.shape
    x = np.clip(np.nan_to_num(position[..., 0]), 0, width - 1).astype(np.int64)
    y = np.clip(np.nan_to_num(position[..., 1]), 0, height - 1).astype(np.int64)
    out = np.nan_to_num(position).copy()
    for material in range(len(MATERIALS)):
        there = theirs.shares[..., material] > 0.6
        here = best == material
        if there.sum() < 50 or not here.any():
            continue
        _, index = distance_transform_edt(~there, return_indices=True)
        wrong = here & ~there[y, x]
        out[wrong] = np.stack([index[1][y[wrong], x[wrong]], index[0][y[wrong], x[wrong]]],
                              -1) + 0.5
    return np.asarray(out, np.float32)


def _detail(skin: Skin, sigma: float, grain: float) -> Float32:
    """Luma minus its blur over the surface alone, float32 [H, W]."""
    luma = grey(skin.atlas.color)[..., None].copy()
    exchange(skin.atlas.owner, luma)
    inside = (skin.atlas.owner >= 0).astype(np.float32)
    values = luma[..., 0] * inside
    weight = np.maximum(gaussian_blur(inside, sigma), 1e-3)
    broad = gaussian_blur(values, sigma) / weight
    fine = values
    if grain > 0.3:
        fine = gaussian_blur(values, grain) / np.maximum(gaussian_blur(inside, grain), 1e-3)
    return np.asarray((fine - broad) * inside, np.float32)
