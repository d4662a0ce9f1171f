"""Example-based transfer of one exemplar to any number of pictures (Paper 2.2, Eq. 6).

What is painted from is the version of a painting that fits a sitter: spectacles are taken off, a
turned face is seen from the front where that is nearer to the sitter, the forehead is bared, an eye
that cannot be made out is painted as the other one is, eyes that look apart look the same way, and
are shut where the sitter's are. Regions of a photo may come from different paintings
(`mix_regions`). Other packages bring methods of their own, by name (`PhotoMethod`).
"""

from __future__ import annotations

import copy
import functools
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro

from ..arrays import Array, Float32, Float64, Floats, Int32, UInt8
from ..color import to_uint8
from ..errors import UserError
from ..face import FacePose
from ..labels import GROUPS, LABELS, PICTURE_LABELS, RegionStyle, members
from ..plugins import Choice, Sitting, chosen, offered
from . import styleblit
from .exemplar import Exemplar, face_size
from .frontal import FaceAside, face_aside, frontalised, suited
from .gaze import with_even_eyes, with_parallel_eyes
from .guides import filters
from .guides.position import Guides, anchor_scale, pixel_centres, relative_stretch, sample_labels
from .guides.regions import (
    Regions,
    find_regions,
    missing_labels,
    photo_regions,
    soft_face,
    without_hair,
)
from .kernels.labels import pixel_weights
from .kernels.vote import blend
from .lids import Lids, asked_lids, closed, lids_together
from .mouth import Palette, part_lips, parts_lips
from .painter.picture_materials import CLOTHES, EARS, NECK, SKIN, picture_shares
from .photo_guide import GRID, FlatGuide
from .worn.hat import Hat, Layer, Wear
from .worn.inpainting import bared, without_spectacles

if TYPE_CHECKING:
    from .painter.photo import PhotoPatches


@dataclass(frozen=True)
class TransferConfig:
    """Parameters of the example-based transfer; lengths are relative to the face."""

    quality: Literal["fast", "best"] = "fast"
    """fast: StyleBlit alone, a tenth of a second. best: patch synthesis outside the face, without
    repeated rows and stripes, in seconds; only for photos in `lfportrait transfer`. It uses patch
    search: see the note on patents in docs/methods.md."""
    extent: Literal["picture", "head", "face"] = "picture"
    """Painted area: the whole picture, the head (person), or the face alone (as in the paper)."""
    strength: float = 1.0
    """0 leaves the photo, 1 gives the painting."""
    eyes: Literal["auto", "painted"] = "auto"
    """auto: eyes that are closed in a photo are painted closed; painted: open, as in the painting.
    For photos only; a frame of a video that blinks is painted open."""
    wear: tuple[Wear, ...] = ()
    """Put on the sitter of a photo what the painting's wears: hat, spectacles."""
    aside: float = 20.0
    """For faces turned by more than this angle, guide by the visible part of a generic head instead
    of hidden landmarks; in degrees, 90 = never."""
    table: styleblit.TableConfig = field(default_factory=styleblit.TableConfig)
    """Look-up table."""
    blit: styleblit.BlitConfig = field(default_factory=styleblit.BlitConfig)
    """Synthesis."""
    seed: tyro.conf.Suppress[int] = 0
    """Seed of the chunks' jitter."""


Points = Floats


def as_painted(exemplar: Exemplar, wear: Sequence[str] = ()) -> Exemplar:
    """The exemplar for photos whose face is turned as its own and has open eyes."""
    return bared(_plain(exemplar, wear), fringe=True)


def fitting(exemplar: Exemplar, points: Points, photo: Array, eyes: str = "auto",
            wear: Sequence[str] = ()) -> Exemplar:
    """The exemplar's version that fits a photo with landmarks ``points`` [68, 2].

    ``eyes="painted"`` leaves the painting's eyes open; of what is worn, ``"spectacles"`` are left
    on.
    """
    chosen = _with_both_eyes(bared(suited(_plain(exemplar, wear), points), fringe=True))
    return closed(chosen, asked_lids(chosen, points, photo)) if eyes == "auto" else chosen


def from_the_front(exemplar: Exemplar, pose: FacePose, fringe: bool, lids: Lids,
                   wear: Sequence[str] = ()) -> Exemplar:
    """The exemplar's version for a head.

    ``pose`` is how its face is turned, ``fringe`` whether a painted fringe is taken off (`bared`),
    ``lids`` which eyes are shut; of what is worn, ``"spectacles"`` are left on.
    """
    front = bared(frontalised(_plain(exemplar, wear), pose), fringe)
    return closed(_with_both_eyes(front), lids)


def _with_both_eyes(exemplar: Exemplar) -> Exemplar:
    return with_parallel_eyes(with_even_eyes(exemplar))


def _plain(exemplar: Exemplar, wear: Sequence[str]) -> Exemplar:
    if "spectacles" in wear:
        return exemplar
    with ThreadPoolExecutor(1, "regions") as aside:
        # Of who wears no spectacles the regions are asked for next: they are kept.
        aside.submit(exemplar.regions)
        return without_spectacles(exemplar)


def mix_regions(photo: UInt8, landmarks: Floats, painted: Float32,
                choices: Sequence[RegionStyle], others: dict[str, Float32]) -> Float32:
    """Blend paintings of one photo by its soft regions, float32 [H, W, 3] in [0, 1].

    Parameters
    ----------
    photo, landmarks : uint8 [H, W, 3] and [68, 2].
    painted : float32 [H, W, 3] in [0, 1], the painting of all other regions.
    choices : What regions get; later ones win.
    others : The photo painted by the other exemplars, by `RegionStyle.style`.
    """
    shares = _region_shares(photo, landmarks, [choice.region for choice in choices])
    plain = photo[..., :3].astype(np.float32) / np.float32(255)
    out = np.array(painted, np.float32)
    for choice in choices:
        share = shares[choice.region][..., None]
        wanted = others[choice.style] if choice.style else painted
        out += share * (plain + np.float32(choice.strength) * (wanted - plain) - out)
    return np.clip(out, 0, 1)


def _region_shares(photo: UInt8, landmarks: Floats, names: Sequence[str]) -> dict[str, Float32]:
    """How far each pixel lies in each region, float32 [H, W] by its name.

    The labels of pictures (`PICTURE_LABELS`) do not separate ears from skin, nor neck from clothes:
    where one of those is asked for, they are parted as a painter parts them.
    """
    regions = find_regions(photo, landmarks)
    labels = regions.labels()
    found = {name: labels[..., n] / np.float32(255) for n, name in enumerate(PICTURE_LABELS)}
    if any(name in ("ears", "skin", "neck", "clothes") for name in names):
        picture = Exemplar(np.ascontiguousarray(photo[..., :3]),
                           np.asarray(landmarks, np.float64), "")
        parts = picture_shares(picture, regions, labels)
        for whole, (one, two), columns in (("skin", ("skin", "ears"), (SKIN, EARS)),
                                           ("body", GROUPS["body"], (NECK, CLOTHES))):
            first, second = (parts[..., column] for column in columns)
            share = first / np.maximum(first + second, np.float32(1e-3))
            known = found[whole]
            found[one], found[two] = known * share, known * (1 - share)
    return {name: np.asarray(sum(found[part] for part in (
        (name,) if name in found else members(name, LABELS))), np.float32) for name in names}


FIRM = 2.0  # Factor of the labels' weight in a video, where a stretched position asks for less.
BLUR = 0.06  # Sigma of the appearance guide's Gaussian blur over the face's size (`face_size`).
LABEL_WEIGHT = 40.0  # Error of copying from a wrong region (hair for skin, lips for skin, ...).
VIEW_GAIN = 10.0
"""Factor of `BlitConfig.min_improvement` where the target is no photo but a place on a surface:
strokes must not jump between views."""
OUTLINE = 4.0
"""Added weight of the position along the outline of the person: a chunk that is off shows there."""
BACKGROUND = np.array([0.4, 0.05], np.float32)
"""Weights of position and appearance outside the person, against 1 on the face. Found by eye, as
those below."""
HAIR, BODY = np.array([1.0, 0.1], np.float32), np.array([0.5, 0.1], np.float32)
"""The same in the hair, and on neck and clothes."""
SKIN_LOOK = np.float32(0.1)  # Weight of the appearance on forehead and ears.
HOLD = np.float32(10)
"""Added to the weight of the position, times as much, at a painting's lines: where the guide turns
or bends, a chunk's edge would cut them and set their ends off."""
CALM = 0.25  # Share of the face's weight of the appearance below which it hardly counts.


class Transfer:
    """One exemplar prepared once and applied to many pictures.

    Parameters
    ----------
    regions : Of the painting, where they are known.
    exact : Whether every target pixel is one of the exemplar's, whatever the sizes of the faces.
    """

    def __init__(self, exemplar: Exemplar, config: TransferConfig | None = None,
                 regions: Regions | None = None, exact: bool = False) -> None:
        self.exemplar, self._exact = exemplar, exact
        self.config = config or TransferConfig()
        start = time.perf_counter()
        self.unit = exemplar.size / 50.0
        self.regions: Regions = regions or exemplar.regions()
        self.labels = self.regions.labels()
        self.appearance = filters.appearance_guide(exemplar.image, BLUR * exemplar.size)
        self.prepare_seconds = time.perf_counter() - start
        start = time.perf_counter()
        self.table = styleblit.build_table(self.appearance, self.config.table, self.unit)
        self.table_seconds = time.perf_counter() - start
        self.distribution = filters.Distribution.of(self.appearance, self.regions.person)
        self._find_face()
        self._plan: tuple[Any, Float32, styleblit.Seeds] | None = None
        self._picture = exemplar.image.astype(np.float32) / np.float32(255)
        self._filtered = {1.0: styleblit.pack_colors(self._picture)}
        self._patches: PhotoPatches | None = None
        self._hat = Hat.of(exemplar, self.regions) if "hat" in self.config.wear else None
        if self.config.quality == "best":
            self._painter()

    def moved(self, landmarks: Floats) -> Transfer:
        """The same exemplar with landmarks [68, 2] a little beside, in the same regions."""
        other = copy.copy(self)
        for name in ("_like", "_bald", "_flat", "palette"):
            other.__dict__.pop(name, None)
        other.exemplar = replace(self.exemplar, landmarks=np.asarray(landmarks, np.float64))
        regions = self.regions
        # What is nearest so far from the outline is the same.
        other.regions = Regions(other.exemplar.landmarks, regions.person, regions.hair,
                                regions.nearest)
        other.labels = other.regions.labels()
        other._find_face()
        other._plan = other._patches = None
        return other

    def _find_face(self) -> None:
        """Find the exemplar's soft face and the lines that it is drawn in, uint8 [h, w] each."""
        exemplar = self.exemplar
        self.face = soft_face(exemplar.image.shape, exemplar.landmarks)
        lines = filters.drawn_lines(exemplar.image, self.face, exemplar.size)
        self._face_and_lines = np.stack([self.face, lines], axis=-1)

    @functools.cached_property
    def _steady(self) -> Float32:
        """The appearance for captures: which pixel of a hatching a view hits must not matter."""
        return filters.gaussian_blur(self.appearance, 0.2 * BLUR * self.exemplar.size)

    @functools.cached_property
    def _like(self) -> frozenset[str]:
        """Labels that the exemplar does not show."""
        return missing_labels(self.labels)

    @functools.cached_property
    def _bald(self) -> UInt8:
        """The labels for photos without hair."""
        return without_hair(self.labels)

    @functools.cached_property
    def _flat(self) -> FlatGuide:
        """The position guide of photos."""
        return FlatGuide(self.exemplar, self.regions, self.labels)

    def apply(self, image: Array, landmarks: Floats, *,
              position: Float32 | None = None, seeds_anchor: Float32 | None = None,
              mask: Float32 | None = None, regions: Regions | None = None,
              ) -> styleblit.TransferResult:
        """Stylise one picture; where ``position`` is NaN the image is the given one.

        Parameters
        ----------
        image : uint8 or float in [0, 1], [H, W, 3].
        landmarks : [68, 2] in pixels of ``image``; rows with NaN are unknown.
        position : float32 [H, W, 2], exemplar coordinates instead of those from the landmarks
            (`SurfaceGuide`); NaN = not to be painted.
        seeds_anchor : float32 [H, W, 2], place of each pixel in the plane of the seeds, in exemplar
            pixels.
        mask : float32 [H, W], the person against the background (a capture's alpha); None = found.
        regions : Of the picture where they are known (`find_regions`): the networks are not asked.
        """
        config = self.config
        points = lids_together(landmarks, self.exemplar.lids)
        photo = np.asarray(image[..., :3])
        start = time.perf_counter()
        flat = position is None
        aside = face_aside(points, config.aside) if flat else None
        if config.quality == "best" and flat and seeds_anchor is None:
            self._painter().begin(photo.shape, self.scale(
                points if aside is None else aside.landmarks))
        if position is None and regions is None:
            regions = photo_regions(photo, points, mask)
        if aside is not None and regions is not None:
            points = aside.landmarks
            regions = Regions(points, regions.person, regions.hair)
        worn: Layer | None = None
        if self._hat is not None and regions is not None and seeds_anchor is None:
            photo, regions, worn = self._hat.put_on(photo, regions)
        guided = time.perf_counter()
        if position is None:
            assert regions is not None
            position, labels, person, cover = self._by_landmarks(
                photo, points, regions, aside, seeds_anchor is not None)
        else:
            position, labels, person, cover = self._by_surface(photo, points, position, mask)
        if seeds_anchor is None:
            scale = self.scale(points)
            anchor, seeds = self._photo_anchor(photo.shape, scale)
        else:
            anchor, seeds = np.ascontiguousarray(seeds_anchor, np.float32), None
            scale = anchor_scale(anchor)
        appearance = self._appearance(photo, scale, person)
        guides = Guides(position, appearance, labels, anchor)
        weights = self.weights(person, labels, position, scale)
        blit, label_weight = config.blit, LABEL_WEIGHT
        if seeds is None:
            blit = replace(blit, min_improvement=VIEW_GAIN * blit.min_improvement)
            # On a photo the position is as smooth as the grid that it was computed on.
            weights[..., 0] *= relative_stretch(guides.position, guides.anchor,
                                                cell=GRID if flat else 1)
            label_weight *= FIRM if flat else 1
        synthesising = time.perf_counter()
        style = styleblit.Style(
            self.appearance if seeds is not None else self._steady,
            self._bald if flat and regions is not None and regions.hair is None else self.labels,
            self.table, self.colors(scale))
        synthesis = styleblit.synthesise(
            guides, weights, label_weight, style, blit,
            self.seeds(anchor, None, scale) if seeds is None else seeds,
            scale=None if seeds is None else scale,
            calm=CALM * 255 * config.table.appearance_weight)
        seconds = {"table_seconds": self.table_seconds, "regions_seconds": guided - start,
                   "guides_seconds": synthesising - guided,
                   "synthesis_seconds": time.perf_counter() - synthesising}
        made = styleblit.TransferResult(synthesis.image, guides, cover, synthesis, seconds,
                                        self.exemplar.image.shape[:2], self.appearance)
        if config.quality == "best" and flat and seeds is not None:
            assert regions is not None
            start = time.perf_counter()
            made.image = self._painter().refine(photo, points, regions, made, self.scale(points),
                                                aside is not None)
            made.seconds["patches_seconds"] = time.perf_counter() - start
        if flat:
            self.part_lips(made.image, photo, landmarks)
        if worn is not None:
            made.image = worn.over(made.image)
            made.mask = np.maximum(made.mask, worn.cover * np.float32(config.strength))
        if not (flat and self.covers_all):
            painted, made.image = made.image, np.empty(photo.shape, np.float32)
            blend(photo, np.float32(1 / 255 if photo.dtype == np.uint8 else 1), painted, made.mask,
                  made.image)
        return made

    def _by_landmarks(self, photo: Array, points: Float64, regions: Regions,
                      aside: FaceAside | None, hold: bool,
                      ) -> tuple[Float32, UInt8, Float32, Float32]:
        """Position, labels, person and cover of a photo; ``hold`` in videos (`FlatGuide`)."""
        person = regions.person
        cover = self.cover(photo, points, person)
        labels = regions.labels(self._like)
        hold = hold or self._flat.turned(points, regions)
        position = self._flat(cover, points, regions, labels, hold, aside)
        if self.config.extent == "picture" and not hold:
            person = self._flat.own_shoulders(position, points, labels, person)
        return position, labels, person, cover

    def _by_surface(self, photo: Array, points: Float64, position: Float32, mask: Float32 | None,
                    ) -> tuple[Float32, UInt8, Float32, Float32]:
        """The same of a view of a surface, whose place in the exemplar says what a point is."""
        position = np.ascontiguousarray(position, np.float32)
        shown = np.isfinite(position[..., 0])
        person = shown.astype(np.float32)
        if mask is not None:
            person = person * mask
        cover = np.where(shown, self.cover(photo, points, person), np.float32(0))
        return position, sample_labels(self.labels, position), person, cover

    def part_lips(self, paint: Float32, photo: Array, landmarks: Floats) -> None:
        """Paint what a photo shows between open lips where the exemplar has them closed, in place.

        ``paint`` is float32 [H, W, 3], the rest as for `apply`.
        """
        if parts_lips(self.exemplar, landmarks) and self.palette is not None:
            part_lips(paint, photo, landmarks, self.palette)

    @functools.cached_property
    def palette(self) -> Palette | None:
        """What open mouths are painted with; None where the painted face is too small."""
        return Palette.of(self.exemplar)

    def _painter(self) -> PhotoPatches:
        """What paints around the face, made when it is first wanted."""
        from .painter.photo import PhotoPatches

        if self._patches is None:
            self._patches = PhotoPatches(self.exemplar, self.regions, self.labels,
                                         seed=self.config.seed)
        return self._patches

    def _photo_anchor(self, shape: tuple[int, ...], scale: float,
                      ) -> tuple[Float32, styleblit.Seeds]:
        """Anchor plane and seeds of a photo: the same for all of one size."""
        key = shape[:2], round(scale, 6)
        if self._plan is None or self._plan[0] != key:
            anchor = np.float32(scale) * pixel_centres(shape)
            self._plan = key, anchor, self.seeds(anchor, scale, scale)
        return self._plan[1:]

    def seeds(self, anchor: Float32, regular: float | None, scale: float) -> styleblit.Seeds:
        """Seeds of an anchor plane, ``regular`` as `plant`'s scale, no finer than ``scale`` asks.

        ``scale`` is exemplar pixels per target pixel.
        """
        blit = self.config.blit
        return styleblit.plant(anchor, blit.top, self.config.seed, regular,
                               min(styleblit.finest_level(scale), blit.levels))

    def scale(self, landmarks: Float64) -> float:
        """Exemplar pixels per target pixel; 1 (exact copies) where the faces are alike in size."""
        if self._exact:
            return 1.0
        scale = self.exemplar.size / face_size(landmarks)
        return 1.0 if 0.75 < scale < 4 / 3 else scale

    def colors(self, scale: float) -> Int32:
        """The exemplar's colors, low-passed where a target pixel covers several of its pixels.

        Packed (`styleblit.pack_colors`), int32 [h, w].
        """
        key = round(scale, 1) if scale > 4 / 3 else 1.0
        if key not in self._filtered:
            sigma = 0.5 * np.sqrt(key ** 2 - 1)
            self._filtered[key] = styleblit.pack_colors(np.stack(
                [filters.gaussian_blur(np.ascontiguousarray(self._picture[..., c]), sigma)
                 for c in range(3)], axis=-1))
        return self._filtered[key]

    def _appearance(self, photo: Array, scale: float, person: Float32) -> Float32:
        """Appearance guide of the target, matched to the exemplar's inside the person."""
        sigma = BLUR * self.exemplar.size / scale
        # Grain of the photo has no counterpart in paint: smooth what is finer than a stroke.
        appearance = filters.appearance_guide(photo, max(sigma, 0.7), 0.2 * sigma)
        return filters.match_histogram(appearance, self.distribution, person)

    def weights(self, person: Float32, labels: UInt8, position: Float32, scale: float) -> Float32:
        """Weights of a pixel of displacement and of an appearance of 1, float32 [H, W, 2]."""
        config = self.config
        # Along the outline a chunk that is off shows as a step.
        sigma = 2.5 * self.unit / scale
        factor = max(2, int(sigma / 2)) if sigma >= 2 else 1
        soft = filters.gaussian_blur(filters.shrunk(person, factor), sigma / factor)
        place = np.float32(config.table.position_weight / self.unit)
        look = np.float32(config.table.appearance_weight * 255)
        out = np.empty((*person.shape, 2), np.float32)
        face, lines = self._face_of(position, factor)
        pixel_weights(np.ascontiguousarray(person, np.float32), styleblit.label_words(labels), soft,
                      face, lines, factor,
                      place * np.array([BACKGROUND[0], 1], np.float32),
                      place * np.float32(OUTLINE),
                      look * np.array([BACKGROUND[1], 1], np.float32), HAIR, BODY, SKIN_LOOK, HOLD,
                      out)
        return out

    def _face_of(self, position: Float32, factor: int) -> tuple[Float32, Float32]:
        """The exemplar's soft face, and its lines, where a position leads.

        In [0, 1], at the middles of blocks of ``factor`` pixels.
        """
        middles = position[factor // 2::factor, factor // 2::factor]
        rows, columns = (-(-n // factor) for n in position.shape[:2])
        middles = np.pad(middles, ((0, rows - middles.shape[0]), (0, columns - middles.shape[1]),
                                   (0, 0)), mode="edge")
        found = sample_labels(self._face_and_lines, middles).astype(np.float32)
        found *= np.float32(1 / 255)
        return np.ascontiguousarray(found[..., 0]), np.ascontiguousarray(found[..., 1])

    @property
    def covers_all(self) -> bool:
        """Whether nothing of a photo is left."""
        return self.config.extent == "picture" and self.config.strength == 1

    def cover(self, photo: Array, landmarks: Float64, person: Float32) -> Float32:
        """Weight of the synthesis against the photo, float32 [H, W] in [0, 1]."""
        config = self.config
        if config.extent == "face":
            from ..face import face_mask

            mask = face_mask(to_uint8(np.ascontiguousarray(photo)), landmarks)
            cover = filters.broad_blur(np.asarray(mask, np.float32), 0.06 * face_size(landmarks))
        elif config.extent == "head":
            cover = person
        else:
            cover = np.ones(photo.shape[:2], np.float32)
        # Fainter than a grey level is not worth painting.
        cover = np.where(cover > np.float32(0.002), cover, np.float32(0))
        return np.asarray(cover * np.float32(config.strength), np.float32)


def transfer(image: Array, exemplar: Exemplar, config: TransferConfig | None = None,
             landmarks: Floats | None = None, **options: Any) -> styleblit.TransferResult:
    """Stylise one photo by example.

    Parameters
    ----------
    image : uint8 [H, W, 3].
    exemplar : The painting.
    config : Parameters.
    landmarks : [68, 2] in pixels; detected if None.
    options : Passed on to `Transfer.apply`.

    Raises
    ------
    UserError : If no face is found.
    """
    points = face_landmarks(image) if landmarks is None else landmarks
    config = config or TransferConfig()
    return Transfer(fitting(exemplar, points, image, config.eyes, config.wear), config).apply(
        image, points, **options)


def face_landmarks(image: Array) -> Float64:
    """Landmarks [68, 2] of the face in a photo, uint8 [H, W, 3]."""
    from ..face import detect_landmarks

    landmarks = detect_landmarks(np.asarray(image, np.uint8))
    if landmarks is None:
        raise UserError("no face found in the photo; give a picture in which one face is seen "
                        "with both eyes or nearly so (turned by 70 degrees at most), larger than "
                        "about 60 pixels")
    return landmarks


GROUP = "lfportrait.transfer_methods"
"""Entry points of the methods of other packages; the fields of their parameters are options of the
command line: ``--NAME.FIELD``."""
OWN = "styleblit"  # The method of this stage.

Method = Annotated[str, Choice(GROUP, OWN)]

MethodConfig = Any
"""Parameters of a method: a `TransferConfig`, or those of another package's method."""


@dataclass(frozen=True)
class PhotoMethod:
    """A method of another package."""

    # Class of its parameters, a frozen data class whose fields have defaults.
    parameters: type[Any]
    # Prepares an exemplar by its parameters, as `prepare` does; the last argument are photos with
    # landmarks that a network also trains on, or None.
    prepare: Callable[[Exemplar, Any, list[Sitting] | None], Any]


def photo_method(name: str) -> PhotoMethod:
    """A method of another package."""
    found: PhotoMethod = chosen(GROUP, name, (OWN,))
    return found


def prepare(exemplar: Exemplar, config: MethodConfig, own: list[Sitting] | None = None) -> Any:
    """An exemplar prepared for the method of a configuration, to be applied to many photos.

    ``apply(image, landmarks)`` gives a picture with ``image``, ``seconds`` and ``dump``. ``own``
    are photos with landmarks that a network also trains on.
    """
    if isinstance(config, TransferConfig):
        return Transfer(exemplar, config)
    for method in offered(GROUP).values():
        if isinstance(config, method.parameters):
            return method.prepare(exemplar, config, own)
    raise TypeError(f"no installed method of transfer has parameters like {config!r}")
