"""``--quality best`` on a photo: patch synthesis for everything but the face.

The face stays as StyleBlit paints it (`transfers`). Beyond it a photo asks for what the exemplar
does not show: shoulders, loose hair, a hat, a wide background; chunks that are laid by place then
stand in rows. Here the photo itself says what is hair, skin, neck, clothes and background, and each
is filled with patches of like material that agree with each other and with the face, follow the
photo's edges and patterns, and use the exemplar evenly (`patches`). What the position guide maps
nearly rigidly begins with StyleBlit's own chunks, all else with rigid pieces from well inside the
material. What the exemplar does not show is painted with what comes nearest. A sitter's beard is
hair below the cheeks, which the networks take for skin.

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
from PIL import Image

from ...arrays import Array, Bool, Float32, Float64, Floats, UInt8, box_about
from ...color import LUMA, to_uint8
from ...labels import MATERIALS, PICTURE_LABELS
from ..exemplar import Exemplar, face_size
from ..guides.filters import broad_blur, disk, enlarged, gaussian_blur, grey, skin_distance
from ..guides.position import pixel_centres, relative_stretch
from ..guides.regions import Regions, soft_face
from ..kernels.patches import ACTIVE, FIXED, OUTSIDE
from ..patches import PatchSearch, PatchSource
from .light import light_beside
from .materials import (
    BLUR,
    ExemplarMaterials,
    Placement,
    contours,
    guide_agreement,
    light_neck,
    matched_looks,
    nearest_of_material,
    pieces,
    stand_in,
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
from .picture_materials import (
    CLOTHES,
    FEATURES,
    GROUND,
    HAIR,
    NECK,
    PLAIN,
    SKIN,
    give,
    known_shares,
    picture_shares,
)
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
FACE = 60.0  # Pixels from the brows to the chin in the picture that is looked at.
CHEEKS, CHIN, REACH = (0.12, 0.45), (0.78, 0.98), (0.3, 2.2)
"""Cheeks, a chin and all of a beard lie between these (brows 0, chin 1)."""
ASIDE = 0.75, 0.4, 1.25  # And so far from the middle, over half the face's width.
BARE = 2.3
"""A chin nearer to the cheeks' colors than this, in standard deviations, is bare, or in shade."""
NEARER = 0.6
"""A beard's distance from the colors of the hair is no more than this share of that from skin's."""
FEWEST = 30  # Fewer pixels than this have no color.


def with_folds(color: Float32, luma: Float32, worn: Float32, size: float) -> Float32:
    """A painted picture whose clothes have at least the photo's light and shade, [H, W, 3].

    The same array where nothing is worn. ``luma`` is the photo's, ``worn`` how far it shows
    clothes, float32 [H, W] in [0, 1]; ``size`` is the face's in pixels.
    """
    box = box_about(worn > 0.02)
    if box is None or (worn > 0.5).sum() < FEW:
        return color
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


def _odds(values: Floats) -> Float32:
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

    def refine(self, photo: Array, landmarks: Float64, regions: Regions,
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


def grow_beard(photo: UInt8, regions: Regions, labels: UInt8, shares: Float32) -> None:
    """Let a beard be hair, in place in shares [H, W, 7].

    It is what hangs together with a chin that is as the hair is.
    """
    step = max(1, int(regions.frame.height / FACE))
    part = shares[::step, ::step]
    size = part.shape[1], part.shape[0]
    colors = cv2.resize(photo, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    right, down = (plane[::step, ::step] for plane in regions.frame.local(shares.shape[:2]))
    half = 0.5 * regions.frame.width / regions.frame.height
    lips = labels[::step, ::step, PICTURE_LABELS.index("lips")] > 60
    bare = (part[..., SKIN] > 0.9) & (part[..., FEATURES] < 0.05) & ~lips
    cheeks, chin, low = ((down > high) & (down < deep) & (np.abs(right) < aside * half)
                         for (high, deep), aside in zip((CHEEKS, CHIN, REACH), ASIDE))
    cheeks, chin = cheeks & bare, chin & ~lips
    hair = (part[..., HAIR] > 0.8) & (down < CHEEKS[1])
    low &= (part[..., [SKIN, NECK, CLOTHES]].sum(axis=-1) > 0.02) & ~lips
    if min(one.sum() for one in (cheeks, chin, hair)) < FEWEST:
        return
    chosen = cheeks | chin | hair | low
    to_skin, to_hair = (np.zeros(chosen.shape, np.float32) for _ in range(2))
    for away, sample in ((to_skin, cheeks), (to_hair, hair)):
        away[chosen] = skin_distance(colors[chosen], sample[chosen], 1.0)
    of_chin = float(np.median(to_skin[chin]))
    if of_chin < BARE or np.median(to_hair[chin]) > NEARER * of_chin:
        return
    _, pieces = cv2.connectedComponents((low & (to_hair < NEARER * to_skin)).astype(np.uint8))
    known = np.unique(pieces[chin])
    beard = np.isin(pieces, known[known > 0]).astype(np.float32)
    whole = cv2.resize(gaussian_blur(beard, 0.7), shares.shape[1::-1],
                       interpolation=cv2.INTER_LINEAR)
    for material in (SKIN, NECK, CLOTHES):
        give(shares, shares[..., material] * whole, material, HAIR)


ODD = 3.5  # On the head above the brows, what is no hair and further from the skin's color is worn.
SETTLED = 60.0
"""Pixels from the brows to the chin in the picture in which pieces of a body are found."""
PIECE = 0.18
"""Bare pieces that are nowhere wider than twice this, over the face's height, are none."""
THROAT, CHEST = 1.15, 1.4
"""What reaches above the one is a neck, and below the other clothes (brows 0, chin 1)."""
EARS_FROM = 0.9, 0.06
"""A bare head's ears lie this far from the middle, over half the width, and below the brows."""
FOREHEAD = 0.82, 0.42
"""A bare head's forehead reaches so far to both sides, over half the width, and so high above the
brows, over the face's height; round, as hairlines are."""
GROUND_TRUST = 4.0, 0.05
"""Weight of the tone in a plain background (paper), and in others, against 1 on edges."""
LEAST_TRUST = 0.5  # The same where the photo is plain: borders of paint follow its shading.
DARKEST = 0.05
"""Skin and neck are not darker than all but this share of the exemplar's: crumbs of its outline."""
HAIR_TRUST = 0.4  # The same of tone and detail in the hair: its strokes are the exemplar's.


def photo_shares(photo: UInt8, regions: Regions, labels: UInt8,
                 position: Float32, painted_hair: Float32,
                 present: Bool) -> Float32:
    """Shares of `MATERIALS` of a photo, of those that the exemplar has, float32 [H, W, 7].

    Parameters
    ----------
    photo, regions, labels : uint8 [H, W, 3], and its regions and labels (uint8 [H, W,
        len(PICTURE_LABELS)]).
    position : float32 [H, W, 2], exemplar pixels; no NaN.
    painted_hair : float32 [h, w] in [0, 1], the exemplar's hair, or what it wears instead.
    present : bool [7], what the exemplar shows enough of; others stand in for the rest.
    """
    shares = picture_shares(Exemplar(photo, regions.landmarks), regions, labels, strict=False)
    _settle_body(shares, regions)
    if regions.hair is None:
        # A shaven head, or a statue's hair: there is hair where the exemplar has it, but not on the
        # forehead, where its fringe would be a cap's edge.
        height, width = painted_hair.shape
        x = np.clip(position[..., 0], 0, width - 1).astype(np.int64)
        y = np.clip(position[..., 1], 0, height - 1).astype(np.int64)
        hair = painted_hair[y, x] * shares[..., SKIN] * (1 - _bare(regions, photo.shape[:2]))
        give(shares, hair, SKIN, HAIR)
    else:
        _, down = regions.frame.local(photo.shape[:2])
        _set_apart(photo, shares, np.asarray(down, np.float32))
        grow_beard(photo, regions, labels, shares)
    stand_in(shares, present)
    return shares


def _bare(regions: Regions, shape: tuple[int, int]) -> Float32:
    """Where a bare head's ears and forehead are, float32 [H, W] in [0, 1]: no hair lies there."""
    right, down = regions.frame.local(shape)
    across = np.abs(right) / (0.5 * regions.frame.width / regions.frame.height)
    ears = (np.clip((across - EARS_FROM[0]) / 0.05 + 0.5, 0, 1)
            * np.clip((down - EARS_FROM[1]) / 0.1 + 0.5, 0, 1))
    away = np.hypot(across / FOREHEAD[0], np.minimum(down, 0) / FOREHEAD[1])
    return np.asarray(np.maximum(ears, np.clip((1 - away) / 0.08 + 0.5, 0, 1)), np.float32)


def _settle_body(shares: Float32, regions: Regions) -> None:
    """Let small pieces of a body be what is around them; in place.

    A zip as light as skin is no neck, and the chin's shade on a bare throat is no shirt.
    """
    right, down = regions.frame.local(shares.shape[:2])
    step = max(1, int(regions.frame.height / SETTLED))
    right, down = right[::step, ::step], down[::step, ::step]
    half = 0.5 * regions.frame.width / regions.frame.height
    kernel = disk(PIECE * regions.frame.height / step)
    around = np.ones((7, 7), np.uint8)
    for own, other in ((NECK, CLOTHES), (CLOTHES, NECK)):
        here = shares[::step, ::step, own] > 0.3
        if own == NECK:
            # Whatever begins right below the jaw is a neck.
            sure = cv2.erode(here.astype(np.uint8), kernel) > 0
            sure |= here & (down < THROAT)
        else:
            # Clothes may be narrow, as straps are, but not lie below the chin only.
            sure = here & ((down > CHEST) | (np.abs(right) > half))
        _, parts = cv2.connectedComponents(here.astype(np.uint8), connectivity=4)
        # A little around, for what is soft at its edge.
        kept = cv2.dilate(np.isin(parts, np.setdiff1d(parts[sure], 0)).astype(np.float32), around)
        kept = cv2.resize(kept, shares.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        give(shares, shares[..., own] * (1 - kept), own, other)


def _set_apart(photo: UInt8, shares: Float32, down: Float32) -> None:
    """What is worn on the head (sunglasses, hats) may look like hair or like clothes; in place.

    ``down`` [H, W] is 0 at the brows and 1 at the chin.
    """
    high = (down < -0.12) & (shares[..., SKIN] > 0.3)
    face = (down > 0.2) & (down < 0.8) & (shares[..., SKIN] > 0.95)
    chosen = high | face
    if not high.any() or face.sum() < 50:
        return
    away = skin_distance(photo[chosen] / np.float32(255), face[chosen])
    worn = np.zeros(down.shape, np.float32)
    worn[chosen] = 1 / (1 + np.exp(np.clip((ODD - away) / 0.3, -30, 30)))
    worn *= np.clip((-0.12 - down) / 0.08, 0, 1).astype(np.float32)
    worn = gaussian_blur(worn, 1.0) * shares[..., SKIN]
    shares[..., SKIN] -= worn
    shares[..., HAIR] += 0.5 * worn
    shares[..., CLOTHES] += 0.5 * worn


def has_plain_ground(theirs: ExemplarMaterials) -> bool:
    """Whether the exemplar's background is plain, as paper is."""
    behind = theirs.shares[..., GROUND] > 0.9
    return bool(behind.any() and theirs.luma[behind].std() < PLAIN)


def photo_looks(photo: UInt8, landmarks: Float64, shares: Float32,
                theirs: ExemplarMaterials) -> tuple[Float32, Float32, Float32]:
    """Tone, detail and their trust of a photo in the exemplar's paint, float32 [H, W] each.

    ``shares`` are its `photo_shares`. The background of the photo says nothing, a plain one is to
    stay plain.
    """
    shape, face = photo.shape[:2], face_size(landmarks)
    luma = grey(photo)
    fine = luma - broad_blur(luma, BLUR * face)
    tone, detail = (plane.reshape(shape) for plane in matched_looks(
        luma.reshape(-1), fine.reshape(-1), shares.reshape(-1, shares.shape[-1]), theirs,
        theirs.luma, darkest=DARKEST))
    ground = shares[..., GROUND]
    behind = theirs.shares[..., GROUND] > 0.9
    if behind.any():
        tone = tone + ground * np.float32(np.median(theirs.luma[behind]))
    _, strong = contours(luma, np.ones_like(luma), face)
    trust = np.maximum(strong, np.float32(LEAST_TRUST))
    trust *= 1 - ground - np.float32(1 - HAIR_TRUST) * shares[..., HAIR]
    trust += np.float32(GROUND_TRUST[0 if has_plain_ground(theirs) else 1]) * ground
    return tone, detail, np.ascontiguousarray(trust, np.float32)
