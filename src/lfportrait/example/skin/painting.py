"""A skin painted by example, once for all views (after Shen et al. 2023, 2.2 and Eq. 6).

The face is painted as on a photo: guides, look-up table, StyleBlit (`face`). Everything else
becomes patches of the exemplar that agree with each other and with the face (`patches`), guided by
what the sitter is made of, by the photo's tones and by its detail. So what the exemplar does not
show - the back of a head, a neck, a chest - goes on from what it does show, from like material, and
edges and patterns of the photo stay.

Materials come from the exemplar's where the guide leads, and from the sitter itself where that is
known better: hair, clothes, ears.
"""

from __future__ import annotations

import copy
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

from ...arrays import Bool, Float32, UInt8
from ...labels import MATERIALS
from ...measure import give_back_memory
from ..exemplar import Exemplar
from ..frontal import FRONTAL, in_front
from ..guides.filters import grey
from ..kernels.atlas import exchange, look_up_colors, sample_nodes
from ..kernels.labels import largest_share, move_to_material
from ..kernels.patches import ACTIVE, FIXED, OUTSIDE
from ..kernels.seeds import nearest_sites
from ..lids import Lids
from ..mouth import Palette, lips_apart, parts_lips, with_open_mouth
from ..painter.light import evened_beside, light_beside
from ..painter.materials import (
    FEW,
    LEAST,
    ExemplarMaterials,
    Placement,
    exemplar_pixels,
    light_neck,
    matched_looks,
    mostly,
    pieces,
    stand_in,
)
from ..painter.patch_painter import FAR_PLACE, PLACE, PatchPainter, PatchRequest, flesh
from ..painter.picture_materials import (
    CLOTHES,
    EARS,
    FEATURES,
    GROUND,
    HAIR,
    NECK,
    SKIN,
    known_shares,
    material_shares,
    one_hue,
)
from ..painter.plain_skin import plain_skin, take_out_strands
from ..patches import PatchSearch, PatchSource, PatchTarget, synthesise_patches
from ..surface_guide import Sites, SurfaceGuide
from ..transfers import Transfer, TransferConfig, from_the_front
from ..worn.hat import Wear
from .ears import missing_relief
from .face import DARKEST, DRAWN_OUT, CopiedFace
from .hair import below_hair, hair_by_place, without_bays
from .hat import HatPainter
from .sitter import Canvas, Skin, canvas_of
from .wires import painted_wires, wires

MIDDLING = 0.25, 0.75  # Hair that no photo saw has tones between these quantiles of what they saw.
JAW = 0.7
"""Below this (brows 0, chin 1) what hangs beside a head leaves a neck bare, above it a cheek."""
SHARP = 8.0  # How much narrower skin's way into neck is than the guide makes it.
SHOWN = 0.4
"""Cosine to the best photo from which on a place counts in the distribution of the sitter's
tones."""
UNDER_JAW, JAW_EDGE = 1.0, 0.2
"""Below the first (brows 0, chin 1) lies the underside of a jaw, and a softly fading edge above."""
HARDLY = 0.6  # Ears that no photo saw better have so much of their light and shade.
BEARD = 0.15, 0.4  # Where the guide leads to so much of a beard, it begins to be painted, and is.
EITHER = 0.51  # Share of ears in what a sitter's ears are painted of; the rest is skin.


def sitter_shares(skin: Skin, labels: UInt8, present: Bool) -> Float32:
    """Shares of `MATERIALS` of a skin's N places, float32 [N, 7]; no background, no features.

    Features are painted with the face; elsewhere nobody wants an eye. ``labels`` are uint8 [N, K],
    the exemplar's where the guide leads; ``present`` is bool [7], what it shows: others stand in.
    """
    shares = material_shares(labels)
    shares[:, SKIN] += shares[:, FEATURES]
    shares[:, FEATURES] = 0
    if skin.hair is None:
        # A shaven head, or a statue's: the painter's hair, where hair is, and none on the neck.
        below = skin.cached("below hair", lambda: below_hair(skin.plane, skin.flat))
        hanging = shares[:, HAIR] * below
        neck = np.clip((skin.flat[:, 1] / skin.plane.height - JAW) / 0.1, 0, 1)
        shares[:, HAIR] -= hanging
        shares[:, NECK] += hanging * neck
        shares[:, SKIN] += hanging * (1 - neck)
        common = skin.cached("hair by place", lambda: hair_by_place(skin.plane, skin.flat))
        wanted = np.maximum(common, shares[:, HAIR])
        wanted = (1 - below) * without_bays(skin.plane, skin.flat, wanted)
        more = np.maximum(wanted - shares[:, HAIR], 0)
        shares *= (1 - more)[:, None]
        shares[:, HAIR] += more
    else:
        rest = np.maximum(1 - shares[:, HAIR], np.float32(1e-3))
        shares[:, [SKIN, NECK]] *= ((1 - skin.hair) / rest)[:, None]
        shares[:, GROUND] *= 1 - skin.hair
        # What the exemplar has as hair and the sitter does not is skin.
        bare = shares[:, [SKIN, NECK, GROUND]].sum(axis=1)
        shares[:, SKIN] += np.maximum(1 - skin.hair - bare, 0)
        shares[:, HAIR] = skin.hair
    # Hair covers ears: an ear that is painted with hair was taken for hair in `sitter.py`.
    ears = skin.ears if skin.hair is None else skin.ears * (1 - skin.hair)
    shares *= (1 - ears)[:, None]
    # Skin or the painter's ears, whichever is more alike.
    shares[:, SKIN] += (1 - EITHER) * ears
    shares[:, EARS] += EITHER * ears
    shares *= (1 - skin.clothes)[:, None]
    shares[:, CLOTHES] = skin.clothes
    shares[:, NECK] += shares[:, GROUND]
    shares[:, GROUND] = 0
    shares /= np.maximum(shares.sum(axis=-1, keepdims=True), np.float32(1e-3))
    for one, other in ((SKIN, NECK), *(((HAIR, SKIN), (HAIR, NECK)) if skin.hair is None else ())):
        _parted(shares, one, other)
    stand_in(shares, present)
    return shares


def _parted(shares: Float32, one: int, other: int) -> None:
    """Let one material end where another begins, in place.

    A guide that is stretched makes a broad band of half one and half the other, and so does hair
    that is known by its place alone. The exemplar has such places along a line alone, and patches
    would repeat that line.
    """
    both = shares[:, one] + shares[:, other]
    part = shares[:, one] / np.maximum(both, np.float32(1e-6))
    shares[:, one] = both * np.clip(SHARP * (part - np.float32(0.5)) + np.float32(0.5), 0, 1)
    shares[:, other] = both - shares[:, one]


def sitter_looks(skin: Skin, shares: Float32, theirs: ExemplarMaterials) -> tuple[Float32, Float32]:
    """Tones and detail of a skin's places as the exemplar would have them, float32 [N] each."""
    # A painter's deepest shade has hard edges, which on a neck or a back look like stains.
    tone, detail = matched_looks(skin.tone, skin.detail, shares, theirs, shown=skin.seen > SHOWN,
                                 darkest=DARKEST)
    hair = shares[:, HAIR]
    inside = mostly(hair, skin.seen > SHOWN)
    if inside.sum() >= FEW:
        # A field that was closed behind is darker there or lighter: nobody knows how much.
        kept = np.clip(tone, *np.quantile(tone[inside], MIDDLING))
        tone += hair * (1 - skin.seen) * (kept - tone)
    return tone, detail * skin.seen


def extrapolated_light(skin: Skin, canvas: Canvas, core: Bool, color: Float32,
                       tone: Float32, plain: Bool) -> Float32:
    """How much lighter the face is painted than its tones ask for, float32 [N] (`light_beside`).

    ``core`` are the places of the face that are painted, ``color`` its paint, float32 [H, W, 3] in
    [0, 1], ``tone`` the tones asked for, [N]; ``plain``: it is no beard, whose dark is no shade.
    """
    paint = canvas.gathered(grey(color), len(core))
    return light_beside(skin.flat, skin.plane.height, core, paint - tone,
                        core & skin.outwards & plain)


NODES = 0.03  # Nodes of the guide are so far apart, over the exemplar's face size.
NAPE, THROAT = 0.7, 1.2
"""Where a nape begins, over half a turn; how far below the brows the throat lies, over the face's
height."""
UNSEEN = 0.5
"""So much do tones count where no photo saw them: a field closed there has likely ones."""
NEARBY, UNMOVED, EYES = 0.15, 0.03, slice(36, 48)
"""Landmarks are a little beside others if they are no further away than this over the face's size,
and those of the eyes than that: their lids and irises are painted over by them."""
ALMOST = 0.02  # Paint is as large as it was before if it is so by this share.
STRETCHED = 0.7
"""A guide that changes more slowly than this against the surface would stretch its paint."""


@dataclass(frozen=True)
class SkinConfig:
    """Painting on the skin."""

    patchmatch: bool = True
    """Patch synthesis outside the face; otherwise only chunks and pieces, with repetitions and
    seams but without patented methods (docs/methods.md)."""
    hasty: tyro.conf.Suppress[bool] = False
    """Fewer alternations of the patch synthesis, for previews."""

    @property
    def search(self) -> PatchSearch:
        """How patches are searched."""
        return PatchSearch().hasty() if self.hasty else PatchSearch()


@dataclass
class Painting:
    """A painted skin."""

    skin: Skin  # What was painted on.
    # float32 [H / step, W / step, 3] in [0, 1], sRGB, of the atlas; copies and fringes filled.
    color: Float32
    step: int  # Pixels of the atlas per pixel of the painting.
    seconds: dict[str, float]  # By step.

    def at(self, places: Float32) -> Float32:
        """Colors at places [N, 2] of the atlas, float32 [N, 3]; NaN where those are."""
        out = np.full((len(places), 3), np.nan, np.float32)
        look_up_colors(self.color, places / np.float32(self.step), out)
        return out


class _Guided(NamedTuple):
    """Where the guide leads a skin's N places in the exemplar, and what is there."""

    position: Float32  # float32 [N, 2], pixels of the exemplar.
    anchor: Float32  # float32 [N, 2], the same by scale and shift of the unwrapped head alone.
    ratio: Float32  # float32 [N], how much slower than the unwrapped head the position changes.
    labels: UInt8  # uint8 [N, K], of the exemplar.
    near: Float32  # float32 [N] in [0, 1], how near the face's parts are.
    core: Bool  # bool [N], where the painted face is copied.
    bearded: Float32  # float32 [N] in [0, 1], how far the guide leads to a beard.


class SkinPainter:
    """One exemplar prepared for painting skins.

    Parameters
    ----------
    config, transfer : Parameters; ``transfer`` those of the face.
    seed : Of chunks and search.
    fringe : Whether a painted fringe is taken off, for sitters whose own hair is known.
    lids : Which of its eyes are to be shut (`asked_lids`).
    wear : What of the painting's sitter is put on: its hat; its spectacles are left on.

    Attributes
    ----------
    given : The exemplar as it was given.
    exemplar : As it is painted by: from the front, with its eyes as the sitter's.
    pose : Of the face in the painting.
    turned : Whether the painting's own face is not from the front.
    """

    def __init__(self, exemplar: Exemplar, config: SkinConfig | None = None,
                 transfer: TransferConfig | None = None, seed: int = 0, fringe: bool = False,
                 lids: Lids = (False, False), wear: tuple[Wear, ...] = ()) -> None:
        self.given = exemplar
        # The painter that this one was moved from.
        self._first: SkinPainter | None = None
        # Size of the last painting, and that which the next ones are to have if they nearly do.
        self._last = self._like = 0.0
        self.pose = exemplar.pose()
        # Of a face that is turned, the frontal picture.
        self.turned = abs(self.pose.yaw) >= FRONTAL
        self.exemplar = exemplar = from_the_front(exemplar, self.pose, fringe, lids, wear)
        self.seed = seed
        self.config = config or SkinConfig()
        regions = exemplar.regions()
        with ThreadPoolExecutor(1) as aside:
            aside.submit(lambda: regions.nearest)
            self.transfer = Transfer(exemplar, replace(transfer or TransferConfig(), seed=seed),
                                     regions=regions)
            self._hat = HatPainter.of(exemplar, regions, self.config.search, seed) if (
                "hat" in wear) else None
            self._prepare()

    def moved(self, landmarks: NDArray[np.floating]) -> SkinPainter | None:
        """The painter of the same painting with landmarks a little beside, for previews.

        The landmarks are [68, 2] in pixels of the painting that was given; None if they lie too far
        from those that it was prepared by (`NEARBY`). What lies in the painting - where is hair,
        what was taken off, its frontal picture - stays as it was found by the landmarks before; the
        guides are those of the new ones.
        """
        first = self._first or self
        painted = first.given.landmarks
        way = np.asarray(landmarks, np.float64) - painted
        far = np.abs(way).max(axis=1) / first.given.size
        if far.max() > NEARBY or far[EYES].max() > UNMOVED:
            return None
        other = copy.copy(first)
        other._first, other._like = first, first._last
        other.given = replace(first.given, landmarks=painted + way)
        if first.turned:
            way = in_front(way, painted, first.pose)
        other.exemplar = replace(first.exemplar, landmarks=first.exemplar.landmarks + way)
        other.transfer = first.transfer.moved(other.exemplar.landmarks)
        other._face = CopiedFace(other.transfer, first._hair, first._strand, first._bearded)
        return other

    def _prepare(self) -> None:
        """Find the exemplar's materials and the part of its face that is copied."""
        exemplar = self.exemplar
        # The mask, too: labels know no hair within the landmarks.
        shares = known_shares(exemplar, self.transfer.regions, self.transfer.labels)
        if self._hat is not None:
            self._hat.take_from(shares)
        self._hair, self._strand = take_out_strands(shares, exemplar, self.transfer.regions,
                                                    self.transfer.labels)
        plain, self._bearded = plain_skin(shares, exemplar.landmarks, exemplar.image)
        regions = self.transfer.regions
        one_hue(exemplar, regions, self.transfer.labels, plain)
        self._painter = PatchPainter(exemplar, plain, self.config.search, self.seed, sharp=False)
        self._face = CopiedFace(self.transfer, self._hair, self._strand, self._bearded)

    def paint(self, skin: Skin, step: int = 1) -> Painting:
        """Paint a skin, a pixel for ``step`` of the atlas: 1, or 2 for a preview."""
        with ThreadPoolExecutor(2) as aside:
            return self._painted(skin, step, aside)

    def _painted(self, skin: Skin, step: int, aside: ThreadPoolExecutor) -> Painting:
        """The painting; what depends only on the exemplar is computed ``aside``."""
        clock = _Clock()
        exemplar = self.exemplar
        if parts_lips(exemplar, skin.plane.landmarks):
            exemplar = replace(exemplar, landmarks=lips_apart(exemplar.landmarks))
        guide = SurfaceGuide(skin.plane.landmarks, exemplar, self.transfer.regions)
        size = skin.pixels / guide.scale / step
        if abs(size - self._like) < ALMOST * size:
            size = self._like  # its pictures are there already
        self._last = size
        source = (aside.submit(self._painter.source, size)
                  if self.config.patchmatch else None)
        canvas, places = canvas_of(skin, step)
        position, ratio = self._positions(guide, places)
        if not self.config.patchmatch:
            points = places.atlas.points.reshape(-1, 3)[places.index]
            position = guide(points[None])[0][0]
        anchor = np.asarray(guide.scale * places.flat + guide.shift, np.float32)
        pixel = np.clip(position.astype(np.int32), 0,
                        np.array(self.exemplar.image.shape[1::-1], np.int32) - 1)
        labels = self.transfer.labels[pixel[:, 1], pixel[:, 0]]
        face = self._face.planes[pixel[:, 1], pixel[:, 0]]
        begins, ends = BEARD
        bearded = np.clip((self._bearded[pixel[:, 1], pixel[:, 0]] - begins) / (ends - begins),
                          0, 1)
        bearded *= places.outwards
        bearded *= np.clip(ratio / DRAWN_OUT - 1, 0, 1)
        clock.lap("guides")
        core = np.ones(len(face), bool)
        if self.config.patchmatch:
            core = self._face.core(places, canvas, face, ratio, size)
        painted = aside.submit(self._face.paint, places, guide, canvas, position, anchor, ratio,
                               core)
        if source is None:
            color = painted.result()
            self._draw(places, canvas, color)
            exchange(canvas.owner, color)
            clock.lap("face")
            return Painting(skin, color, step, clock.seconds)
        request = [self._request(
            places, source.result()[1], size, canvas,
            _Guided(position, anchor, ratio, labels, face[:, 1], core, bearded), painted)]
        bare = flesh(request[0].shares)
        # Nothing but the painter holds on to the request, and to the face that it begins with.
        del painted, pixel, labels, face, bearded
        clock.lap("face, targets")
        if step == 1:
            # The search takes the most of all; what lies free is in pieces that are too small.
            give_back_memory()
        color = self._painter.paint(canvas, size, request.pop())
        even_edge(places, canvas, core, bare, color)
        shade_ears(places, canvas, color)
        self._draw(places, canvas, color)
        if self._hat is not None:
            self._hat.paint(places, canvas, position, size, color)
        exchange(canvas.owner, color)
        clock.lap("patches")
        return Painting(skin, color, step, clock.seconds)

    def _draw(self, skin: Skin, canvas: Canvas, color: Float32) -> None:
        """Draw what only the photo knows: an open mouth, spectacles; as for `even_edge`."""
        smiles = parts_lips(self.exemplar, skin.plane.landmarks)
        if not (smiles or wires(skin).any()):
            return
        palette = Palette.of(self.given)
        if palette is None:
            return
        width = skin.atlas.depth.shape[1]
        photo = skin.atlas.color_of((skin.index // width, skin.index % width))
        paint = np.stack([canvas.gathered(color[..., n], len(photo)) for n in range(3)], axis=1)
        if smiles:
            landmarks = skin.plane.unwrap(np.nan_to_num(skin.plane.landmarks))
            paint = with_open_mouth(paint, photo, skin.flat, landmarks, palette)
        paint = painted_wires(skin, paint, grey(photo[None])[0], palette)
        color[canvas.own] = paint[canvas.slots[canvas.own]]

    def _positions(self, guide: SurfaceGuide, skin: Skin) -> tuple[Float32, Float32]:
        """Exemplar places [N, 2] of a skin's, and how much slower than the plane they change."""
        spacing = NODES * self.exemplar.size / guide.scale
        low, high = (np.array([end(axis) for axis in skin.flat.T], np.float64)  # faster than both
                     for end in (np.min, np.max))
        nodes = guide.nodes(low, high, spacing)
        out = np.empty((len(skin.flat), 3), np.float32)
        sample_nodes(nodes, low, spacing, _meeting_behind(skin), out)
        return np.ascontiguousarray(out[:, :2]), out[:, 2]

    def _request(self, skin: Skin, theirs: ExemplarMaterials, size: float, canvas: Canvas,
                 guided: _Guided, painted: Future[Float32]) -> PatchRequest:
        """What the patches are to do; ``size`` pixels of the canvas per pixel of the exemplar.

        ``painted`` is the face, soon.
        """
        core = guided.core
        unit = self._painter.unit(size)
        shares = sitter_shares(skin, guided.labels, theirs.present)
        light_neck(shares, skin.tone, theirs, skin.seen > SHOWN)
        tone, detail = sitter_looks(skin, shares, theirs)
        bearded = guided.bearded * shares[:, SKIN]
        shares[:, FEATURES] += bearded
        shares[:, SKIN] -= bearded
        placed = Placement.of(shares, theirs, guided.position * np.float32(size), unit)
        color = painted.result()
        tone += flesh(shares) * extrapolated_light(skin, canvas, core, color, tone,
                                                  bearded < 0.5)
        tone += bearded * (theirs.tone[exemplar_pixels(placed.wanted, theirs)] - tone)
        # Where the guide would stretch its paint, the search begins with rigid pieces.
        rigid = pieces(placed.material, theirs, placed.wanted,
                       guided.anchor * np.float32(size), tone, self.exemplar.size * size)
        begin = np.where((guided.ratio > STRETCHED)[:, None] & (placed.agreement > 0.5)[:, None],
                         placed.wanted, rigid)
        # Around the face patches stay in place; elsewhere like material will do.
        near = np.clip(2 * guided.near, 0, 1)
        hold = (near * shares[:, SKIN] + shares[:, FEATURES]) * placed.agreement
        weight = (FAR_PLACE + (PLACE - FAR_PLACE) * hold) * guided.ratio ** 2 / unit ** 2
        # An ear is recognised by its own light and shade.
        trust = skin.contours * (1 + 3 * skin.ears)
        state = canvas.states(np.ones(len(core), bool))
        state[canvas.own & np.append(core, False)[canvas.slots]] = FIXED
        active = np.zeros(len(core), bool)
        active[canvas.slots[state == ACTIVE]] = True
        often = float((state == ACTIVE).sum() / max(int(active.sum()), 1))
        exchange(canvas.owner, color)
        sure = np.stack([trust, UNSEEN + (1 - UNSEEN) * skin.seen], axis=1)
        # Where patches stay in place the painter's own hues do, too.
        hue = hold * theirs.hue[exemplar_pixels(placed.wanted, theirs)]
        return PatchRequest(shares, tone, detail, placed.wanted, begin, weight, sure, state, color,
                            often, own=True, hue=np.asarray(hue, np.float32))

    def materials(self) -> dict[str, float]:
        """Shares of the exemplar's picture by material; what it does not show is left out."""
        shares = self._painter.shares.reshape(-1, len(MATERIALS))
        means = np.ones(len(shares), np.float32) @ shares / len(shares)  # faster than a mean
        return {name: round(float(share), 4) for name, share in zip(MATERIALS, means)
                if share > LEAST}


def even_edge(skin: Skin, canvas: Canvas, core: Bool, bare: Float32, color: Float32) -> None:
    """Let the broad colors of bare skin beside the copied face begin as the face ends, in place.

    Not under the jaw: there a head has an edge of its own, and shade. ``core`` is bool [N], the
    copied face, ``bare`` float32 [N] in [0, 1], how far places are flesh; ``color`` is the
    painting, float32 [H, W, 3] in [0, 1].
    """
    paint = np.stack([canvas.gathered(color[..., channel], len(core)) for channel in range(3)], 1)
    low = np.clip((UNDER_JAW - skin.flat[:, 1] / skin.plane.height) / JAW_EDGE, 0, 1)
    beside = np.clip(2 * bare - 1, 0, 1) * low * (1 - skin.ears) * skin.outwards
    evened = evened_beside(skin.flat, skin.plane.height, core & skin.outwards,
                           np.asarray(np.where(core, 0, beside), np.float32), paint)
    changed = canvas.own & np.append(beside > 0, False)[canvas.slots]
    color[changed] = evened[canvas.slots[changed]]


def shade_ears(skin: Skin, canvas: Canvas, color: Float32) -> None:
    """Lay the sitter's light and shade over ears that are painted without their relief.

    As for `even_edge`, in place.
    """
    ears = skin.ears * np.maximum(skin.seen, HARDLY)
    if skin.hair is not None:
        ears = ears * (1 - skin.hair)
    face = skin.outwards & (skin.ears < 0.1) & (skin.seen > 0.5)
    # Photos that only graze an ear show grain elsewhere, but this relief is better than none.
    width = skin.atlas.depth.shape[1]
    light = grey(skin.atlas.color_of((skin.index // width, skin.index % width))[None])[0]
    factors = missing_relief(ears, face, skin.flat[:, 0], light,
                             canvas.gathered(grey(color), len(ears), np.nan))
    if factors is not None:
        color[canvas.own] *= factors[canvas.slots[canvas.own]][:, None]
        np.minimum(color, 1, out=color)


def _meeting_behind(skin: Skin) -> Float32:
    """Unwrapped places [N, 2], as the guide is asked: bare napes come around to the throat.

    Left and right of the nape the guide ends at the exemplar's left and right; what it paints there
    may be light on one side and shade on the other, with a line between them.
    """
    flat, plane = skin.flat, skin.plane
    turn = (np.abs(flat[:, 0]) / plane.radius / np.pi - NAPE) / (1 - NAPE)
    turn = np.clip(np.where(flat[:, 1] > 0, turn, 0), 0, 1)
    if skin.hair is not None:
        turn *= skin.hair < 0.5
    turn *= turn * (3 - 2 * turn)
    x, y = flat.T
    return np.stack([x * (1 - turn), y + turn * np.maximum(THROAT * plane.height - y, 0)],
                    axis=1).astype(np.float32)


class _Clock:
    """Seconds by step."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """End a step."""
        now = time.perf_counter()
        self.seconds[name], self._last = round(now - self._last, 4), now


def rehearse_painting(skin: Skin) -> None:
    """Lay a few patches of the photo on the photo: all kernels of a painting but the face's."""
    canvas = Canvas.of(skin, 2)
    flat = np.stack([skin.index % 32, skin.index // 32 % 32], axis=1).astype(np.float32)
    nodes = np.zeros((2, 2, 3), np.float32)
    sample_nodes(nodes, np.zeros(2), 1.0, flat, np.empty((len(flat), 3), np.float32))
    number = np.empty(len(flat), np.int32)
    sites = Sites.around(flat, 8.0)
    nearest_sites(flat, np.float32(8.0), sites.first, sites.points, number)
    material = np.empty(len(flat), np.int64)
    largest_share(np.zeros((len(flat), len(MATERIALS)), np.float32), material)
    move_to_material(flat, material, np.zeros((len(MATERIALS), 48, 48), np.int32),
                     np.empty_like(flat))
    places = canvas.spread(flat)
    guides = canvas.spread(np.repeat(skin.tone[:, None], 4, axis=1))
    source = PatchSource.of(np.zeros((48, 48, 3), np.float32), np.zeros((48, 48, 4), np.float32))
    state = np.where(canvas.own, ACTIVE, OUTSIDE).astype(np.uint8)
    weight = canvas.spread(skin.seen[:, None])[..., 0]
    trust = np.stack([weight, weight], axis=-1)
    color = np.zeros((*state.shape, 3), np.float32)
    exchange(canvas.owner, color)
    synthesise_patches(PatchTarget(guides, places, places, places, weight, 9.0, None, trust, state,
                                   canvas.owner, color), source,
                       PatchSearch(levels=2, votes=1, passes=1))
