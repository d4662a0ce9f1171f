"""``--quality best`` on a photo: patch synthesis for everything but the face.

The face stays as StyleBlit paints it (`transfers`). Beyond it a photo asks for what the exemplar
does not show: shoulders, loose hair, a hat, a wide background; chunks that are laid by place then
stand in rows. Here the photo itself says what is hair, skin, neck, clothes and background, and each
is filled with patches of like material that agree with each other and with the face, follow the
photo's edges and patterns, and use the exemplar evenly (`patches`). What the position guide maps
nearly rigidly begins with StyleBlit's own chunks, all else with rigid pieces from well inside the
material.

Patch synthesis of this kind touches patents; see docs/methods.md before you use it in a product.

A painter's white shirt or black coat has no paint for the folds, patches and zips of what a sitter
wears: patches of it alone are a flat shape. Where the paint does not have the photo's light and
shade, it becomes lighter or darker as paint does: no further than to white and black, its hue kept.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...arrays import Bool, Float32, Float64, UInt8
from ...color import LUMA, to_uint8
from ...labels import MATERIALS
from ..exemplar import Exemplar, face_size
from ..guides.filters import broad_blur, disk, enlarged, gaussian_blur, grey
from ..guides.position import pixel_centres, relative_stretch
from ..guides.regions import Regions, soft_face
from ..kernels.patches import ACTIVE, FIXED, OUTSIDE
from ..patches import PatchSearch, PatchSource
from .light import light_beside
from .materials import (
    ExemplarMaterials,
    Placement,
    guide_agreement,
    light_neck,
    nearest_of_material,
    pieces,
)
from .patch_painter import (
    FAR_PLACE,
    PLACE,
    GuideWeights,
    PatchPainter,
    PatchRequest,
    PhotoAtlas,
    flesh,
)
from .photo_materials import has_plain_ground, photo_looks, photo_shares
from .picture_materials import CLOTHES, FEATURES, GROUND, HAIR, SKIN, known_shares
from .plain_skin import outline, take_out_strands

if TYPE_CHECKING:
    from ..styleblit import TransferResult

CONTRAST = 0.45
"""Contrast of the photo (of log odds of luma) that painted clothes have at the least."""
FINE, BROAD = 0.012, 0.03
"""Blurs of the photo and of its paint before they are compared, over the face's size."""
UTMOST_ODDS = 1.6  # Nothing becomes lighter or darker by more than this, in log odds.
LEAST = 0.03  # Black and white are this far from 0 and 1.
FEW = 100  # Fewer pixels are no clothes.


def with_folds(color: Float32, luma: Float32, worn: Float32, size: float) -> Float32:
    """A painted picture whose clothes have at least the photo's light and shade, [H, W, 3].

    The same array where nothing is worn. ``luma`` is the photo's, ``worn`` how far it shows
    clothes, float32 [H, W] in [0, 1]; ``size`` is the face's in pixels.
    """
    rows, columns = (np.flatnonzero((worn > 0.02).any(axis=axis)) for axis in (1, 0))
    if (worn > 0.5).sum() < FEW:
        return color
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    worn = np.ascontiguousarray(worn[box])
    paint = color[box]
    inside = worn > 0.5
    asked = _odds(gaussian_blur(np.ascontiguousarray(luma[box]), max(0.5, FINE * size)))
    there = paint @ LUMA
    there = _odds(broad_blur(there * worn, BROAD * size)
                  / np.maximum(broad_blur(worn, BROAD * size), np.float32(1e-3)))
    asked = np.float32(CONTRAST) * (asked - np.median(asked[inside]))
    lacking = asked - (there - np.median(there[inside]))
    # Not more than asked for, and nothing against it: the rest are the painter's own strokes.
    lacking = np.clip(lacking, np.minimum(asked, 0), np.maximum(asked, 0))
    lacking = np.clip(lacking, -UTMOST_ODDS, UTMOST_ODDS) * worn
    out = color.copy()
    chosen = worn > 0.02
    colors = _odds(paint[chosen]) + lacking[chosen][:, None]
    # Exact where nothing is lacking, black and white included.
    out[box][chosen] += 1 / (1 + np.exp(-colors)) - np.clip(paint[chosen], LEAST, 1 - LEAST)
    return np.clip(out, 0, 1, out=out)


def _odds(values: NDArray[np.floating]) -> Float32:
    """Log odds of values in [0, 1]."""
    values = np.clip(values, np.float32(LEAST), np.float32(1 - LEAST))
    return np.asarray(np.log(values / (1 - values)), np.float32)


LARGEST = 1.7e6
"""Photos of more pixels than this are refined at a smaller size and enlarged, but for the face."""
ENLARGED = 1.2
"""So are those in which the exemplar would be enlarged by more than this: it gets no finer."""
CELL = 8  # The guide's rigidity is measured every Nth pixel.
BENT = 0.3
"""A guide whose derivative is further from a multiple of the identity than this is not rigid."""
EVEN = np.array([1, 1, 1, 2, 2, 1, 1], np.float32)
"""How much more often than evenly a pixel of each of `MATERIALS` may be used."""
DRAWN_OUT, CALM = 0.45, 0.02
"""The side of a turned face is patches where the guide changes more slowly than this, blurred by so
much over the face's size."""
COVERED, SHADED = (0.15, 0.03), (0.05, 0.05)
"""Share of hair in the exemplar's face, blurred by so much over the face's size, from which on it
is not copied onto a bare one; and from which on it shades a forehead."""
UNDER = 0.02  # Trust in the photo's tones and detail under a strand that is left out.
EDGE = 0.03  # Blur that finds the edge of what is painted so, over the face's size.
UTMOST = 0.2  # Tones are carried by no more than this: beyond it is a cast shadow, not light.
PLAIN_EVEN = 8.0
"""The same of a plain background: paper may well repeat, but vignettes must not lie in patches."""
WEIGHTS = GuideWeights(tone=0.3, detail=1.0, material=1.5, hue=0.0)
"""Half of a head's: a photo's guides are sharp, and its face is painted already."""
CHUNK = 1.0  # Weight of staying with StyleBlit's chunks where those are of like material.


class PhotoPatches:
    """One exemplar with its regions and labels, prepared for refining photos."""

    def __init__(self, exemplar: Exemplar, regions: Regions, labels: UInt8, seed: int = 0) -> None:
        self.exemplar = exemplar
        shares = known_shares(exemplar, regions, labels, strict=False)
        self._coming: tuple[float, Future[tuple[PatchSource, ExemplarMaterials]]] | None = None
        self._hair, self._strand = take_out_strands(shares, exemplar, regions, labels)
        self._painter = PatchPainter(exemplar, shares, PatchSearch(last_votes=1), seed,
                                     sharp=True, weights=WEIGHTS)
        # [2, h, w]: 1 where there is too much of it, on a face and above its brows.
        self._covered = np.stack([broad_blur(self._hair, blur * exemplar.size) / np.float32(most)
                                  for most, blur in (COVERED, SHADED)])
        self._outline = outline(exemplar)

    def begin(self, shape: tuple[int, ...], scale: float) -> None:
        """Lay out the exemplar for a photo [H, W, 3] in another thread; `refine` waits for it."""
        width, height = _laid_size(shape, scale)
        ratio = (width / shape[1] + height / shape[0]) / 2
        size = round(1 / (scale / ratio), 3)
        aside = ThreadPoolExecutor(1)
        self._coming = size, aside.submit(self._painter.source, size)
        aside.shutdown(wait=False)

    def _source(self, size: float) -> tuple[PatchSource, ExemplarMaterials]:
        if self._coming is not None and self._coming[0] == size:
            return self._coming[1].result()
        return self._painter.source(size)

    def refine(self, photo: NDArray[np.generic], landmarks: Float64, regions: Regions,
               result: TransferResult, scale: float, turned: bool = False) -> Float32:
        """Lay patches around the face of a photo that StyleBlit has painted, float32 [H, W, 3].

        The colors of ``result.synthesis`` stay in the face, and where the guide is NaN.

        Parameters
        ----------
        photo : uint8 or float in [0, 1], [H, W, 3].
        landmarks, regions : [68, 2] in pixels, and the regions of the photo.
        result : StyleBlit's, of the same photo and exemplar.
        scale : Exemplar pixels per pixel of the photo (`Transfer.scale`).
        turned : Whether the face is turned far: its side, which the exemplar shows as a narrow
            strip, is patches, too.
        """
        painted = result.synthesis.image
        height, width = photo.shape[:2]
        size = _laid_size(photo.shape, scale)
        guides = result.guides
        place = guides.anchor + result.synthesis.shift
        work = _Work(to_uint8(photo), landmarks, regions, guides.position, place, painted, scale,
                     turned)
        if size != (width, height):
            work = work.shrunk(*size)
        color, core = self._lay(work)
        if size != (width, height):
            color = np.clip(_resized(color, (width, height), Image.Resampling.BICUBIC), 0, 1)
            core = np.clip(_resized(core, (width, height)), 0, 1)
        # The fixed face ends within its own paint: nothing is mixed but at the border's pixels.
        core = np.where(np.isfinite(guides.position[..., 0]), core, np.float32(1))[..., None]
        return np.asarray(painted * core + color * (1 - core), np.float32)

    def _lay(self, work: _Work) -> tuple[Float32, Float32]:
        """The picture [H, W, 3], and 1 where it is fixed [H, W]."""
        painter = self._painter
        size = round(1 / work.scale, 3)
        _, theirs = self._source(size)
        unit = painter.unit(size)
        covered = np.isfinite(work.position[..., 0])
        position = np.nan_to_num(work.position)
        labels = work.regions.labels()
        planes = photo_shares(work.photo, work.regions, labels, position, self._hair,
                              theirs.present)
        light_neck(planes.reshape(-1, len(MATERIALS)), grey(work.photo).reshape(-1), theirs)
        tone, detail, trust = photo_looks(work.photo, work.landmarks, planes, theirs)
        shares = planes.reshape(-1, len(MATERIALS))
        soft = soft_face(work.photo.shape, work.landmarks).astype(np.float32) / np.float32(255)
        rigid = _rigid(work.position * np.float32(size))
        near = np.clip(2 * broad_blur(soft, 0.12 * face_size(work.landmarks)), 0, 1).reshape(-1)
        guided = position.reshape(-1, 2) * np.float32(size)
        placed = Placement.of(shares, theirs, guided, unit)
        # StyleBlit lays backgrounds in rows: there the guide itself is the better beginning.
        behind = shares[:, GROUND] > 0.5
        begin, kept = self._begin(work, placed, theirs, behind, tone.reshape(-1), rigid, size)
        core = covered & _core(work, soft, kept.reshape(soft.shape),
                               (shares[:, SKIN] + shares[:, FEATURES]).reshape(soft.shape))
        # Eyes and brows stay: patches of features would take those of others.
        bare, clear = self._bare(work)
        core = _round(work, core & bare & clear) | core & (planes[..., FEATURES] > 0.5)
        # Under a strand is plain skin: a fold there would be painted with what is left of it.
        trust = np.where(clear, trust, np.minimum(trust, np.float32(UNDER)))
        tone = tone + flesh(planes) * _extrapolated_light(work, core, tone)
        # Where StyleBlit's chunks are of the right material and not stretched, they stay.
        wanted = np.where(kept[:, None], begin, placed.wanted)
        # But not under the photo's patterns; those of its hair are none.
        loose = np.minimum(trust.reshape(-1), 1) * (1 - shares[:, HAIR])
        weight = np.where(kept, CHUNK * (1 - loose), FAR_PLACE)
        weight = np.maximum(weight, PLACE * near * shares[:, SKIN] * placed.agreement) / unit ** 2
        state = np.where(core, FIXED, np.where(covered, ACTIVE, OUTSIDE)).astype(np.uint8)
        often = EVEN.copy()
        if has_plain_ground(theirs):
            often[GROUND] = PLAIN_EVEN
        trusted = trust.reshape(-1)
        color = painter.paint(PhotoAtlas((soft.shape[0], soft.shape[1])), size, PatchRequest(
            shares, tone.reshape(-1), detail.reshape(-1), wanted, begin, weight.astype(np.float32),
            np.stack([trusted, trusted], axis=1), state, work.painted, often))
        color = with_folds(color, grey(work.photo), planes[..., CLOTHES], face_size(work.landmarks))
        return color, core.astype(np.float32)

    def _bare(self, work: _Work) -> tuple[Bool, Bool]:
        """Where StyleBlit has not laid the exemplar's hair over a face, nor a strand, bool [H, W].

        A fringe, a curl, the shade at its hairline: on a higher forehead they would be stains.
        """
        height, width = self._covered.shape[1:]
        x, y = (np.clip(np.nan_to_num(work.place[..., axis]), 0, size - 1).astype(np.int64)
                for axis, size in ((0, width), (1, height)))
        _, down = work.regions.frame.local(work.painted.shape[:2])
        hair, strand = self._covered[(down < 0).astype(np.int64), y, x], self._strand[y, x]
        if work.regions.hair is not None:
            hair, strand = (plane * (1 - work.regions.hair) for plane in (hair, strand))
        # No crumbs, and no edges of chunks; a strand is narrow, though, and its end no crumb.
        edge = max(1.0, EDGE * face_size(work.landmarks))
        bare, inside = (gaussian_blur(np.asarray(plane, np.float32), edge) for plane in (
            hair < 1, ~self._outline[y, x]))
        clear = gaussian_blur(np.asarray(strand, np.float32), edge / 2) < 0.1
        return np.asarray((bare > 0.8) & (inside > 0.95)), np.asarray(clear)

    def _begin(self, work: _Work, placed: Placement, theirs: ExemplarMaterials, behind: Bool,
               tone: Float32, rigid: Bool, size: float) -> tuple[Float32, Bool]:
        """Where the search begins, [N, 2]: StyleBlit's chunks where [N], rigid pieces elsewhere."""
        plane = pixel_centres(work.painted.shape[:2]).reshape(-1, 2)
        piece = pieces(placed.material, theirs, placed.wanted, plane, tone,
                       self.exemplar.size * size)
        own = np.nan_to_num(work.place).reshape(-1, 2) * np.float32(size)
        moved = nearest_of_material(placed.material, theirs, own)
        moved[behind] = placed.wanted[behind]
        kept = rigid.reshape(-1) & (moved == own).all(axis=1) & ~behind
        home = behind | (guide_agreement(own, moved, self.exemplar.size * size / 50) > 0.5)
        return np.where((rigid.reshape(-1) & home)[:, None], moved, piece), kept


@dataclass
class _Work:
    """A photo and what StyleBlit did, at the size at which patches are laid."""

    photo: UInt8
    landmarks: Float64
    regions: Regions
    position: Float32
    place: Float32
    painted: Float32
    scale: float
    turned: bool

    def shrunk(self, width: int, height: int) -> _Work:
        """The same at another size."""
        size = width, height
        ratio = np.array(size) / self.painted.shape[1::-1]
        hair = self.regions.hair
        points = self.landmarks * ratio
        regions = Regions(points, _resized(self.regions.person, size),
                          None if hair is None else _resized(hair, size))
        photo = np.asarray(Image.fromarray(self.photo).resize(size, Image.Resampling.BOX))
        # Places are not mixed: their neighbours may lie far apart.
        nearest = Image.Resampling.NEAREST
        return _Work(photo, points, regions, _resized(self.position, size, nearest),
                     _resized(self.place, size, nearest), _resized(self.painted, size),
                     self.scale / float(ratio.mean()), self.turned)


def _laid_size(shape: tuple[int, ...], scale: float) -> tuple[int, int]:
    """Size that patches are laid at, for a photo; ``scale`` is exemplar pixels per photo pixel."""
    step = max(1.0, float(np.sqrt(shape[0] * shape[1] / LARGEST)), 1 / (ENLARGED * scale))
    return (round(shape[1] / step), round(shape[0] / step)) if step > 1 else (shape[1], shape[0])


def _resized(planes: Float32, size: tuple[int, int],
             resample: Image.Resampling = Image.Resampling.BILINEAR) -> Float32:
    """Planes [H, W] or [H, W, C] at another size (width, height)."""
    if planes.ndim == 2:
        return np.asarray(Image.fromarray(np.ascontiguousarray(planes)).resize(size, resample))
    return np.stack([_resized(planes[..., n], size, resample)
                     for n in range(planes.shape[2])], axis=-1)


def _core(work: _Work, soft: Float32, kept: Bool, skin: Float32) -> Bool:
    """The face that stays as StyleBlit painted it, and the forehead where that is skin, [H, W]."""
    frame = work.regions.frame
    right, down = frame.local(soft.shape)
    half = 0.5 * frame.width / frame.height
    forehead = (np.hypot(right / (0.95 * half), down / 0.75) < 1) & (down < 0.1)
    broad = gaussian_blur(np.asarray(skin * kept, np.float32), max(1.0, 0.02 * frame.height))
    face = (soft > 0.5) & (skin > 0.5)
    if work.turned:
        plane = np.float32(work.scale) * pixel_centres(soft.shape)
        steady = relative_stretch(np.nan_to_num(work.position), plane)
        steady = broad_blur(steady, CALM * face_size(work.landmarks))
        # Not the features: of a nose patches would make several.
        near = -np.sign(frame.turn(work.landmarks))
        eyes = (work.landmarks[[36, 45]] - frame.origin) @ frame.right / frame.height
        face &= (steady > DRAWN_OUT) | (near * right < (near * eyes).max())
    return np.asarray(face | (forehead & (broad > 0.9)), bool)


def _round(work: _Work, core: Bool) -> Bool:
    """A face without what is narrow at its edge, bool [H, W]: skin that shows between locks."""
    kernel = disk(0.08 * face_size(work.landmarks))
    return cv2.morphologyEx(core.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0


def _extrapolated_light(work: _Work, core: Bool, tone: Float32) -> Float32:
    """How much lighter the face is painted than its tones ask for, [H, W] (`light_beside`)."""
    light = light_beside(pixel_centres(core.shape).reshape(-1, 2), work.regions.frame.height,
                         core.reshape(-1), (grey(work.painted) - tone).reshape(-1),
                         core.reshape(-1), UTMOST)
    return light.reshape(core.shape)


def _rigid(position: Float32) -> Bool:
    """Where a map [H, W, 2] is nearly a turn by a small angle and a change of size, bool [H, W]."""
    shape = position.shape[0], position.shape[1]
    small: Float32 = np.nan_to_num(position[CELL // 2::CELL, CELL // 2::CELL])
    if min(small.shape[:2]) < 3:
        return np.ones(shape, bool)
    down, across = (np.asarray(np.gradient(small, CELL, axis=n), np.float32) for n in (0, 1))
    mean = np.clip((across[..., 0] + down[..., 1]) / 2, 0.7, 1.4)
    away = np.sqrt(((across[..., 0] - mean) ** 2 + (down[..., 1] - mean) ** 2
                    + across[..., 1] ** 2 + down[..., 0] ** 2) / 2)
    soft = enlarged(gaussian_blur(np.asarray(np.minimum(away, 1), np.float32), 1.0), CELL, shape)
    return np.asarray(soft < BENT, bool)
