"""FaceStyle (Fiser et al. 2017), for comparison: guided patch synthesis on a pyramid of pictures.

The target is built of overlapping patches of the exemplar (`lfportrait.example.patches`) that agree
in color with each other and in three guides with the photo: appearance (grey of head and hair,
matched to the exemplar's), segmentation (soft region labels as colors) and position. The search is
seeded by the position guide, so that few levels and steps do.

Patch synthesis of this kind touches patents; see docs/methods.md before you use it in a product.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lfportrait.arrays import Float32, UInt8
from lfportrait.example.exemplar import Exemplar, face_size
from lfportrait.example.guides.filters import Distribution, grey, match_histogram
from lfportrait.example.guides.position import folded_position_guide, pixel_centres
from lfportrait.example.guides.regions import Regions, find_regions, missing_labels
from lfportrait.example.patches import (
    CELL,
    SCALE,
    PatchSearch,
    PatchSource,
    PatchTarget,
    occupancy,
    synthesise_patches,
)
from lfportrait.example.photo_guide import match_regions
from lfportrait.labels import PICTURE_LABELS

from ..config import FaceStyleConfig, Painted

APPEARANCE, SEGMENT, POSITION = 0.3, 1.5, 12.0
"""Weights of the guides: more appearance keeps the sitter's features, above 1 the photo shows
through; more position keeps features in place. Chosen by eye, as the paper gives none."""
UNIFORMITY = 3500.0
"""Penalty on exemplar pixels used more often than the average."""
COARSEST = 32
"""The pyramid ends where the shorter side would fall below this."""
STEP = np.log(1.1)
"""The exemplar is resized to sizes that are this far apart (logarithm), so that few are made."""
CODES = np.array([[200, 60], [255, 150], [150, 215], [255, 255], [150, 150], [255, 0], [0, 200],
                  [0, 0]], np.float32)
"""Segmentation guide: a place in the plane for each of `PICTURE_LABELS`, far apart where they must
not mix."""


@dataclass
class _Source:
    """An exemplar at one scale: its regions and the pyramid of colors and guides."""

    exemplar: Exemplar
    regions: Regions
    distribution: Distribution
    like: frozenset[str]
    box: tuple[float, float, float, float]
    pyramid: PatchSource


class FaceStyle:
    """One exemplar prepared for guided patch synthesis."""

    def __init__(self, exemplar: Exemplar, config: FaceStyleConfig | None = None) -> None:
        self.exemplar = exemplar
        self.config = config or FaceStyleConfig()
        start = time.perf_counter()
        self._sources: dict[float, _Source] = {}
        self._source(1.0)
        self.seconds = time.perf_counter() - start

    def apply(self, image: UInt8, landmarks: NDArray[np.floating]) -> Painted:
        """Stylise one photo uint8 [H, W, 3] with landmarks [68, 2] in pixels."""
        start = time.perf_counter()
        photo = np.ascontiguousarray(image[..., :3])
        points = np.asarray(landmarks, np.float64)
        ratio = self.exemplar.size / face_size(points)
        source = self._source(1.0 if 0.75 < ratio < 4 / 3 else 1.1 ** -round(np.log(ratio) / STEP))
        regions = find_regions(photo, points)
        position = folded_position_guide(
            np.ones(photo.shape[:2], np.float32),
            match_regions(points, regions, source.exemplar.landmarks, source.regions),
            source.exemplar.image.shape, source.box)
        guides = self._guides(photo, regions, position, source.exemplar.image.shape, source)
        guided = time.perf_counter()
        image_out, used = self._synthesise(guides, position, source)
        end = time.perf_counter()
        return Painted(np.clip(image_out, 0, 1).astype(np.float32),
                       {"precalculation_seconds": self.seconds, "guides_seconds": guided - start,
                        "synthesis_seconds": end - guided},
                       {"appearance": guides[..., 0] / (255 * self._roots()[0]),
                        "segmentation": _picture(guides[..., 3:5] / (255 * self._roots()[3])),
                        "position": _picture(guides[..., 1:3] / (255 * self._roots()[1])),
                        "occupancy": used / 4})

    def _roots(self) -> Float32:
        """Roots of the weights of the guides' channels, times `SCALE`: [5]."""
        weights = [APPEARANCE, *[POSITION / 2] * 2, *[SEGMENT / 2] * 2]
        return np.asarray(SCALE * np.sqrt(weights) + 1e-6, np.float32)

    def _source(self, scale: float) -> _Source:
        """The exemplar, resized by ``scale``, with its pyramid; kept."""
        if scale in self._sources:
            return self._sources[scale]
        exemplar = self.exemplar if scale == 1.0 else _resized(self.exemplar, scale)
        regions = exemplar.regions()
        head = _head(regions.labels())
        guides = self._guides(exemplar.image, regions, pixel_centres(exemplar.image.shape),
                              exemplar.image.shape, None)
        picture = exemplar.image.astype(np.float32) / np.float32(255)
        source = _Source(exemplar, regions, Distribution.of(grey(exemplar.image), head),
                         missing_labels(regions.labels()), regions.box(),
                         PatchSource.of(picture, guides))
        self._sources[scale] = source
        return source

    def _guides(self, image: UInt8, regions: Regions, position: Float32,
                shape: tuple[int, ...], source: _Source | None) -> Float32:
        """Guides of a picture, float32 [H, W, 5]: appearance, position (2), segmentation (2)."""
        labels = regions.labels(source.like if source is not None else frozenset())
        head = _head(labels)
        light = grey(image)
        if source is not None:
            light = match_histogram(light, source.distribution, head)
        share = labels.astype(np.float32)
        share /= np.maximum(share.sum(axis=-1, keepdims=True), 1)
        scale = np.float32(255 / max(shape[:2]))
        planes = np.concatenate([(255 * light * head)[..., None], position * scale, share @ CODES],
                                axis=-1)
        return np.asarray(planes * self._roots(), np.float32)

    def _synthesise(self, guides: Float32, position: Float32, source: _Source,
                    ) -> tuple[Float32, Float32]:
        """The picture and the exemplar's occupancy, coarse to fine."""
        config = self.config
        levels, side = 1, min(guides.shape[:2])
        while side >= 2 * COARSEST:
            levels, side = levels + 1, -(-side // 2)
        image, places = synthesise_patches(
            PatchTarget(guides, position, position), source.pyramid,
            PatchSearch(uniformity=UNIFORMITY, levels=levels, votes=config.length, last_votes=0,
                        passes=config.passes),
            config.seed)
        size = source.exemplar.image.shape[0], source.exemplar.image.shape[1]
        even = places.size / (size[0] * size[1]) * CELL ** 2
        return image, occupancy(places, size) / np.float32(even)


def _head(labels: UInt8) -> Float32:
    """Head and hair against body and background, float32 [H, W] in [0, 1]."""
    other = labels[..., PICTURE_LABELS.index("body")].astype(np.float32)
    other += labels[..., PICTURE_LABELS.index("background")]
    return np.clip(1 - other / 255, 0, 1).astype(np.float32)


def _picture(planes: Float32) -> Float32:
    """Two channels as red and green."""
    return np.concatenate([planes, np.zeros_like(planes[..., :1])], axis=-1)


def _resized(exemplar: Exemplar, scale: float) -> Exemplar:
    """The exemplar, its landmarks and mask at another size."""
    height, width = exemplar.image.shape[:2]
    size = max(round(width * scale), 16), max(round(height * scale), 16)

    def resize(array: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(Image.fromarray(array).resize(size, Image.Resampling.LANCZOS))

    mask = None if exemplar.mask is None else np.clip(resize(exemplar.mask), 0, 1)
    points = exemplar.landmarks * (np.array(size) / (width, height))
    return Exemplar(resize(exemplar.image), points, exemplar.name, mask)
