"""A skin painted by example, once for all views (after Shen et al. 2023, 2.2 and Eq. 6).

The face is painted as on a photo: guides, look-up table, StyleBlit. Everything else becomes patches
of the exemplar that agree with each other and with the face (`patches`), guided by what the sitter
is made of (`materials`), by the photo's tones and by its detail. So what the exemplar does not
show - the back of a head, a neck, a chest - goes on from what it does show, from like material, and
edges and patterns of the photo stay.
"""

from __future__ import annotations

import copy
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import tyro
from numpy.typing import NDArray

from ...labels import MATERIALS
from ..exemplar import Exemplar
from ..frontal import FRONTAL, in_front
from ..guides.filters import grey
from ..kernels.atlas import exchange, look_up_colors, sample_nodes
from ..kernels.patches import ACTIVE, FIXED, FOREIGN, OUTSIDE
from ..lids import Lids
from ..painter.materials import (
    LEAST,
    ExemplarMaterials,
    at_home,
    into,
    light_neck,
    mainly,
    pieces,
)
from ..painter.patch_painter import FAR_PLACE, PLACE, PatchPainter, Wish, flesh
from ..painter.picture_materials import HAIR, SKIN, known_shares
from ..painter.plain_skin import plain_skin, strands, unpainted
from ..patches import PatchSearch, PatchTarget
from ..surface_guide import SurfaceGuide
from ..transfers import Transfer, TransferConfig, from_the_front
from ..worn import Wear
from .ears import missing_relief
from .face import CopiedFace
from .hat import HatPainter
from .light import carried_light
from .materials import SHOWN, sitter_looks, sitter_shares
from .sitter import Canvas, Skin, canvas_of

__all__ = ["Painting", "SkinConfig", "SkinPainter"]

Float32 = NDArray[np.float32]

NODES = 0.03
"""Nodes of the guide are so far apart, over the exemplar's face size."""
NAPE, THROAT = 0.7, 1.2
"""Where a nape begins, over half a turn; how far below the brows the throat lies, over the face's
height."""
UNSEEN = 0.5
"""So much do tones count where no photo saw them: a field closed there has likely ones."""
NEARBY, UNMOVED, EYES = 0.15, 0.03, slice(36, 48)
"""Landmarks are a little beside others if they are no further away than this over the face's size,
and those of the eyes than that: their lids and irises are painted over by them."""
ALMOST = 0.02
"""Paint is as large as it was before if it is so by this share."""
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
    """A painted skin.

    Attributes
    ----------
    skin
        What was painted on.
    color
        float32 [H / step, W / step, 3] in [0, 1], sRGB, of the atlas; copies and fringes filled.
    step
        Pixels of the atlas per pixel of the painting.
    seconds
        By step.
    """

    skin: Skin
    color: Float32
    step: int
    seconds: dict[str, float]

    def at(self, places: Float32) -> Float32:
        """Colors at places [N, 2] of the atlas, float32 [N, 3]; NaN where those are."""
        out = np.full((len(places), 3), np.nan, np.float32)
        look_up_colors(self.color, places / np.float32(self.step), out)
        return out


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
    fringe
        Whether a painted fringe is taken off, for sitters whose own hair is known.
    lids
        Which of its eyes are to be shut (`asked_lids`).
    wear
        What of the painting's sitter is put on: its hat; its spectacles are left on.

    Attributes
    ----------
    given
        The exemplar as it was given.
    exemplar
        As it is painted by: from the front, with its eyes as the sitter's.
    pose
        Of the face in the painting.
    turned
        Whether the painting's own face is not from the front.
    """

    def __init__(self, exemplar: Exemplar, config: SkinConfig | None = None,
                 transfer: TransferConfig | None = None, seed: int = 0,
                 fringe: bool = False, lids: Lids = (False, False),
                 wear: tuple[Wear, ...] = ()) -> None:
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

        What lies in the painting - where is hair, what was taken off, its frontal picture - stays
        as it was found by the landmarks before; the guides are those of the new ones.

        Parameters
        ----------
        landmarks
            [68, 2] in pixels of the painting that was given.

        Returns
        -------
        painter
            None if they lie too far from those that the painting was prepared by (`NEARBY`).
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
        other._face = CopiedFace(other.transfer, first._hair, first._strand)
        return other

    def _prepare(self) -> None:
        """Find the exemplar's materials and the part of its face that is copied."""
        exemplar = self.exemplar
        # The mask, too: labels know no hair within the landmarks.
        shares = known_shares(exemplar, self.transfer.regions, self.transfer.labels)
        if self._hat is not None:
            self._hat.take_from(shares)
        hair = shares[..., HAIR]
        if self.transfer.regions.hair is not None:
            hair = np.maximum(hair, self.transfer.regions.hair)
        strand = strands(exemplar, hair, self.transfer.labels)
        unpainted(shares, strand)
        self._hair, self._strand = hair, strand
        plain = plain_skin(shares, exemplar.landmarks, exemplar.image)
        self._painter = PatchPainter(exemplar, plain, self.config.search, self.seed, sharp=False)
        self._face = CopiedFace(self.transfer, hair, strand)

    def paint(self, skin: Skin, step: int = 1) -> Painting:
        """Paint a skin.

        Parameters
        ----------
        skin
            Of the sitter.
        step
            Pixels of the atlas per painted pixel: 1, or 2 for a preview.
        """
        with ThreadPoolExecutor(2) as aside:
            return self._painted(skin, step, aside)

    def _painted(self, skin: Skin, step: int, aside: ThreadPoolExecutor) -> Painting:
        """The painting; what depends only on the exemplar is computed ``aside``."""
        clock = _Clock()
        guide = SurfaceGuide(skin.plane.landmarks, self.exemplar, self.transfer.regions)
        size = skin.pixels / guide.scale / step
        if abs(size - self._like) < ALMOST * size:
            size = self._like  # its pictures are there already
        self._last = size
        source = (aside.submit(self._painter.source, round(size, 3))
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
        clock.lap("guides")
        core = np.ones(len(face), bool)
        if self.config.patchmatch:
            core = self._face.core(places, canvas, face, ratio, size)
        painted = aside.submit(self._face.paint, places, guide, canvas, position, anchor, ratio,
                               core)
        if source is None:
            color = painted.result()
            exchange(canvas.owner, color)
            clock.lap("face")
            return Painting(skin, color, step, clock.seconds)
        pictures, theirs = source.result()
        target = self._target(places, theirs, size, canvas, position, anchor, ratio, labels,
                              face[:, 1], core, painted)
        clock.lap("face, targets")
        color = self._painter.lay(target, pictures)
        shade_ears(places, canvas, color)
        if self._hat is not None:
            self._hat.paint(places, canvas, position, anchor, size, color)
        exchange(canvas.owner, color)
        clock.lap("patches")
        return Painting(skin, color, step, clock.seconds)

    def _positions(self, guide: SurfaceGuide, skin: Skin) -> tuple[Float32, Float32]:
        """Exemplar places [N, 2] of a skin's, and how much slower than the plane they change."""
        spacing = NODES * self.exemplar.size / guide.scale
        low, high = (np.array([end(axis) for axis in skin.flat.T], np.float64)  # faster than both
                     for end in (np.min, np.max))
        nodes = guide.nodes(low, high, spacing)
        out = np.empty((len(skin.flat), 3), np.float32)
        sample_nodes(nodes, low, spacing, _meeting_behind(skin), out)
        return np.ascontiguousarray(out[:, :2]), out[:, 2]

    def _target(self, skin: Skin, theirs: ExemplarMaterials, size: float, canvas: Canvas,
                position: Float32, anchor: Float32, ratio: Float32, labels: NDArray[np.uint8],
                near: Float32, core: NDArray[np.bool_], painted: Future[Float32]) -> PatchTarget:
        """What the patches are to do; ``size`` pixels of the canvas per pixel of the exemplar.

        ``painted`` is the face, soon.
        """
        unit = self._painter.unit(size)
        shares = sitter_shares(skin, labels, theirs.present)
        light_neck(shares, skin.tone, theirs, skin.seen > SHOWN)
        tone, detail = sitter_looks(skin, shares, theirs)
        guided = position * np.float32(size)
        material = mainly(shares)
        wanted = into(material, theirs, guided)
        home = at_home(guided, wanted, unit)
        color = painted.result()
        tone += flesh(shares) * carried_light(skin, canvas, core, color, tone)
        # Where the guide would stretch its paint, the search begins with rigid pieces.
        rigid = pieces(material, theirs, wanted, anchor * np.float32(size), tone,
                       self.exemplar.size * size)
        begin = np.where((ratio > STRETCHED)[:, None] & (home > 0.5)[:, None], wanted, rigid)
        # Around the face patches stay in place; elsewhere like material will do.
        hold = np.clip(2 * near, 0, 1) * shares[:, SKIN] * home
        weight = (FAR_PLACE + (PLACE - FAR_PLACE) * hold) * ratio ** 2 / unit ** 2
        # An ear is recognised by its own light and shade.
        trust = skin.contours * (1 + 3 * skin.ears)
        own = canvas.own
        state = np.full(own.shape, OUTSIDE, np.uint8)
        state[canvas.surface & (canvas.slots >= 0)] = FOREIGN
        state[own] = ACTIVE
        state[own & np.append(core, False)[canvas.slots]] = FIXED
        active = np.zeros(len(core), bool)
        active[canvas.slots[state == ACTIVE]] = True
        often = float((state == ACTIVE).sum() / max(int(active.sum()), 1))
        exchange(canvas.owner, color)
        sure = np.stack([trust, UNSEEN + (1 - UNSEEN) * skin.seen], axis=1)
        return self._painter.target(canvas, theirs, size, Wish(
            shares, tone, detail, wanted, begin, weight, sure, state, color, often))

    def materials(self) -> dict[str, float]:
        """Shares of the exemplar's picture by material; what it does not show is left out."""
        shares = self._painter.shares.reshape(-1, len(MATERIALS))
        means = np.ones(len(shares), np.float32) @ shares / len(shares)  # faster than a mean
        return {name: round(float(share), 4) for name, share in zip(MATERIALS, means)
                if share > LEAST}


def shade_ears(skin: Skin, canvas: Canvas, color: Float32) -> None:
    """Lay the sitter's light and shade over ears that are painted without their relief.

    Parameters
    ----------
    skin, canvas
        Of the sitter, as the canvas has it, and of the painting.
    color
        float32 [H, W, 3] in [0, 1], the painting; what owners show is changed.
    """
    ears = skin.ears * skin.seen
    if skin.hair is not None:
        ears = ears * (1 - skin.hair)
    face = skin.outwards & (skin.ears < 0.1) & (skin.seen > 0.5)
    factors = missing_relief(ears, face, skin.flat[:, 0], skin.tone + skin.detail,
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
