"""Example-based transfer of one exemplar to any number of pictures (Paper 2.2, Eq. 6)."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from ..errors import UserError
from .exemplar import Exemplar, face_size
from .guides import (
    Guides,
    anchor_scale,
    appearance_guide,
    fold_inside,
    gaussian_blur,
    match_histogram,
    pixel_centres,
    position_guide,
    relative_stretch,
    sample_labels,
)
from .regions import LABELS, Regions, find_regions, match_regions, substitute
from .styleblit import BlitConfig, Synthesis, synthesise
from .table import TableConfig, cached_table

__all__ = ["Transfer", "TransferConfig", "TransferResult", "transfer"]

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class TransferConfig:
    """Parameters of the example-based transfer; lengths are relative to the face."""

    region: Literal["picture", "head", "face"] = "picture"
    """What is painted: the whole picture, the person, or the face alone (the paper)."""
    strength: float = 1.0
    """0 leaves the photo, 1 gives the painting."""
    blur: float = 0.03
    """Sigma of the appearance guide's Gaussian blur over the face's size (`face_size`)."""
    grid: int = 4
    """The position guide is evaluated every so many pixels, bilinear between; 1 = everywhere."""
    stroke_scale: float = 0.0
    """Exemplar pixels per target pixel; 0 = from the sizes of the faces, 1 if nearly alike."""
    background_appearance: float = 0.15
    """Weight of the appearance guide outside the person, against 1 on the face."""
    hair_appearance: float = 0.6
    """Weight of the appearance guide in the hair."""
    body_appearance: float = 0.3
    """Weight of the appearance guide on neck and clothes."""
    background_position: float = 0.4
    """Weight of the position guide outside the person, against 1 on the face."""
    outline: float = 3.0
    """Added weight of the position guide along the outline of the person, 0 to 10."""
    label_weight: float = 60.0
    """Error of copying from a wrong region (hair for skin, lips for skin, ...), 0 to 200."""
    contours: bool = True
    """Let hairline and outline of the head join the landmarks in the position guide."""
    table: TableConfig = field(default_factory=TableConfig)
    """Look-up table."""
    blit: BlitConfig = field(default_factory=BlitConfig)
    """Synthesis."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the chunks' jitter."""


@dataclass
class TransferResult:
    """A stylised picture with everything that led to it.

    Attributes
    ----------
    image
        float32 [H, W, 3] in [0, 1].
    guides
        Position, appearance, labels and anchor of the target.
    mask
        float32 [H, W], where the synthesis covers the photo.
    synthesis
        Chunk shifts, levels and table error.
    seconds
        ``table_seconds``, ``guides_seconds``, ``synthesis_seconds``.
    """

    image: Float32
    guides: Guides
    mask: Float32
    synthesis: Synthesis
    seconds: dict[str, float]
    exemplar_shape: tuple[int, int] = (0, 0)
    style_appearance: Float32 | None = field(default=None, repr=False)

    def dump(self, folder: str | Path) -> None:
        """Write every intermediate as a picture into ``folder``."""
        from .dump import dump_transfer

        dump_transfer(self, Path(folder))


class Transfer:
    """One exemplar prepared once and applied to many pictures.

    Parameters
    ----------
    exemplar
        The painting.
    config
        Parameters.
    cache
        Folder for look-up tables, by content hash; None keeps none.
    """

    def __init__(self, exemplar: Exemplar, config: TransferConfig | None = None,
                 cache: str | Path | None = None) -> None:
        self.exemplar = exemplar
        self.config = config or TransferConfig()
        start = time.perf_counter()
        self.unit = exemplar.size / 50.0
        self.regions: Regions = find_regions(exemplar.image, exemplar.landmarks, exemplar.mask)
        self.labels = self.regions.labels()
        self.appearance = appearance_guide(exemplar.image, self.config.blur * exemplar.size)
        self.prepare_seconds = time.perf_counter() - start
        start = time.perf_counter()
        self.table = cached_table(self.appearance, self.config.table, self.unit,
                                  Path(cache) if cache is not None else None)
        self.table_seconds = time.perf_counter() - start
        self._picture = exemplar.image.astype(np.float32) / np.float32(255)
        self._filtered: dict[float, Float32] = {1.0: self._picture}

    def apply(self, image: NDArray[np.generic], landmarks: NDArray[np.floating], *,
              position: Float32 | None = None, seeds_anchor: Float32 | None = None,
              mask: Float32 | None = None) -> TransferResult:
        """Stylise one picture.

        Parameters
        ----------
        image
            uint8 or float in [0, 1], [H, W, 3].
        landmarks
            [68, 2] in pixels of ``image``; rows with NaN are unknown.
        position
            float32 [H, W, 2], exemplar coordinates instead of those from the landmarks
            (`surface_position_guide`); NaN = not to be painted.
        seeds_anchor
            float32 [H, W, 2], place of each pixel in the plane of the seeds, in exemplar pixels.
        mask
            float32 [H, W], the person against the background (a capture's alpha); None = found.

        Returns
        -------
        TransferResult; where ``position`` is NaN the image is the given one.
        """
        start = time.perf_counter()
        config = self.config
        points = np.asarray(landmarks, np.float64)
        photo = np.asarray(image[..., :3])
        if position is None:
            regions = find_regions(photo, points, mask)
            position = self._flat_guide(photo, points, regions)
            labels = substitute(regions.labels(), self.labels)
            person = regions.person
        else:
            # The place in the exemplar says what a surface point is, alike in every view.
            labels = sample_labels(self.labels, position)
            person = np.isfinite(position[..., 0]).astype(np.float32)
            if mask is not None:
                person = person * mask
        scale = self._scale(points) if seeds_anchor is None else anchor_scale(seeds_anchor)
        regular = seeds_anchor is None
        if seeds_anchor is None:
            seeds_anchor = np.float32(scale) * pixel_centres(photo.shape)
        appearance = self._appearance(photo, scale, person, position)
        guides = Guides(np.ascontiguousarray(position, np.float32), appearance, labels,
                        np.ascontiguousarray(seeds_anchor, np.float32))
        weights = self._weights(person, labels, scale)
        if not regular:
            weights[..., 0] *= relative_stretch(guides.position, guides.anchor)
        guides_seconds = time.perf_counter() - start
        start = time.perf_counter()
        synthesis = synthesise(
            guides, weights, config.label_weight, self.appearance, self.labels, self.table,
            self._colours(scale), config.blit, seed=config.seed,
            scale=scale if regular else None)
        cover = self._cover(photo, points, person, guides)
        base = photo.astype(np.float32) / np.float32(255) if photo.dtype == np.uint8 else photo
        result = base + (synthesis.image - base) * cover[..., None]
        seconds = {"table_seconds": self.table_seconds, "guides_seconds": guides_seconds,
                   "synthesis_seconds": time.perf_counter() - start}
        return TransferResult(np.asarray(result, np.float32), guides, cover, synthesis, seconds,
                              self.exemplar.image.shape[:2], self.appearance)

    def _scale(self, landmarks: NDArray[np.float64]) -> float:
        """Exemplar pixels per target pixel; 1 (exact copies) where the faces are alike in size."""
        if self.config.stroke_scale > 0:
            return self.config.stroke_scale
        scale = self.exemplar.size / face_size(landmarks)
        return 1.0 if 0.75 < scale < 4 / 3 else scale

    def _colours(self, scale: float) -> Float32:
        """The exemplar's colours, low-passed where a target pixel covers several of its pixels."""
        key = round(scale, 1) if scale > 4 / 3 else 1.0
        if key not in self._filtered:
            sigma = 0.5 * np.sqrt(key ** 2 - 1)
            self._filtered[key] = np.stack(
                [gaussian_blur(np.ascontiguousarray(self._picture[..., c]), sigma)
                 for c in range(3)], axis=-1)
        return self._filtered[key]

    def _flat_guide(self, photo: NDArray[np.generic], landmarks: NDArray[np.float64],
                    regions: Regions) -> Float32:
        """Position guide of a photo from its landmarks and contours."""
        sources, targets, weights, softness = match_regions(
            landmarks, regions, self.exemplar.landmarks, self.regions, self.config.contours)
        position = position_guide(photo.shape, sources, targets, weights=weights,
                                  softness=softness, grid=self.config.grid)
        return fold_inside(position, self.exemplar.image.shape, self.regions.box())

    def _appearance(self, photo: NDArray[np.generic], scale: float, person: Float32,
                    position: Float32) -> Float32:
        """Appearance guide of the target, matched to the exemplar's inside the person."""
        sigma = self.config.blur * self.exemplar.size / scale
        # Grain of the photo has no counterpart in paint: smooth what is finer than a stroke.
        appearance = appearance_guide(photo, max(sigma, 0.7), 0.2 * sigma)
        return match_histogram(appearance, self.appearance[self.regions.person > 0.5],
                               (person > 0.5) & np.isfinite(position[..., 0]))

    def _weights(self, person: Float32, labels: NDArray[np.uint8], scale: float) -> Float32:
        """Weights of a pixel of displacement and of an appearance of 1, per target pixel."""
        config = self.config
        place = config.background_position + (1 - config.background_position) * person
        # Along the outline a chunk that is off shows as a step.
        soft = gaussian_blur(person, 2.5 * self.unit / scale)
        place = place + np.float32(4 * config.outline) * soft * (1 - soft)
        hair, body = (labels[..., LABELS.index(name)].astype(np.float32) / 255
                      for name in ("hair", "body"))
        look = config.background_appearance + (1 - config.background_appearance) * person
        look = look * (1 - np.float32(1 - config.hair_appearance) * hair
                       - np.float32(1 - config.body_appearance) * body)
        return np.stack([place * np.float32(config.table.position_weight / self.unit),
                         look * np.float32(config.table.appearance_weight * 255)], axis=-1)

    def _cover(self, photo: NDArray[np.generic], landmarks: NDArray[np.float64], person: Float32,
               guides: Guides) -> Float32:
        """Weight of the synthesis against the photo."""
        config = self.config
        if config.region == "face":
            from ..face import face_mask

            colours = np.asarray(photo, np.float32) * (1 if photo.dtype == np.uint8 else 255)
            picture = (np.clip(colours, 0, 255) + 0.5).astype(np.uint8)
            mask = face_mask(picture, landmarks)
            cover = gaussian_blur(np.asarray(mask, np.float32), 0.06 * face_size(landmarks))
        elif config.region == "head":
            cover = person
        else:
            cover = np.ones(photo.shape[:2], np.float32)
        cover = cover * np.float32(config.strength)
        return np.where(np.isfinite(guides.position[..., 0]), cover, np.float32(0))


def transfer(image: NDArray[np.generic], exemplar: Exemplar, config: TransferConfig | None = None,
             landmarks: NDArray[np.floating] | None = None, **options: Any) -> TransferResult:
    """Stylise one photo by example.

    Parameters
    ----------
    image
        uint8 [H, W, 3].
    exemplar
        The painting.
    config
        Parameters.
    landmarks
        [68, 2] in pixels; detected if None.
    options
        Passed on to `Transfer.apply`.

    Raises
    ------
    UserError
        If no face is found.
    """
    if landmarks is None:
        from ..face import detect_landmarks

        landmarks = detect_landmarks(np.asarray(image, np.uint8))
        if landmarks is None:
            raise UserError("no face found in the photo; give a picture in which one face is seen "
                            "from the front, larger than about 60 pixels")
    return Transfer(exemplar, config).apply(image, landmarks, **options)
