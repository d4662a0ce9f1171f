"""Guided patch synthesis: a picture made of overlapping, consistent exemplar patches.

After FaceStyle (Fiser et al. 2017), which stands on texture optimisation (Kwatra et al. 2005;
Wexler et al. 2007): patches agree in color with each other and in guides with the target. On every
level of a pyramid, votes of the patches and a search for better patches alternate. A penalty on
exemplar pixels that are used often keeps areas from being filled with the one cheapest patch
(uniformity). The search starts from given places, so that few levels and steps do.

The target may be an atlas of charts: after each vote and each search, pixels that show what others
own take over the owner's color and place, so that charts agree across their borders. Pixels whose
colors are given (`FIXED`) stay as they are, and what is synthesised beside them goes on from them.

Patch synthesis of this kind touches patents; see docs/methods.md before you use it in a product.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Array, Float16, Float32, Int32, UInt8, UInt16
from ..measure import give_back_memory
from .kernels.atlas import exchange
from .kernels.patches import (
    ACTIVE,
    CELL,
    CHANNELS,
    MARGIN,
    count_uses,
    finer_places,
    level_places,
    patch_errors,
    search_pass,
    vote_patches,
)

_LARGE = 1 << 22
"""Pixels of a target whose planes are worth giving back before the search has ended."""
SCALE = 4.0  # Colors and guides are in 1 / SCALE grey levels, times the root of a weight.


@dataclass(frozen=True)
class PatchSearch:
    """Parameters of the synthesis."""

    style_weight: float = 1.0
    """Weight of the colors' agreement between overlapping patches, 0.2 to 4."""
    uniformity: float = 8000.0
    """Penalty on exemplar pixels used more often than the average, 0 to 20000: low repeats
    patches, high spreads them over the whole exemplar."""
    levels: int = 5
    """Levels of the pyramid, 1 to 8."""
    votes: int = 4
    """Alternations of search and voting on each level, 1 to 10."""
    last_votes: int = 2
    """The same on the finest level; 0 = as many."""
    passes: int = 2
    """Passes of the search in each alternation, 1 to 6."""
    reach: int = 16
    """Widest random step of the search on the finest level, in pixels."""
    final_3x3: bool = True
    """Finish with patches of 3 x 3 pixels, which blur less."""

    def hasty(self) -> PatchSearch:
        """The same for a preview: fewer alternations."""
        return replace(self, votes=max(1, self.votes // 2), last_votes=1, passes=1, final_3x3=False)


@dataclass
class PatchSource:
    """An exemplar's pyramid."""

    pictures: list[Float32]  # float32 [h, w, 3] in [0, 1], each half the size of the one before.
    # float32 [h, w, G], G <= 5, times the roots of their weights and `SCALE`.
    guides: list[Float32]

    @staticmethod
    def of(picture: Float32, guides: Float32) -> PatchSource:
        """The pyramid of one picture, down to where no patch fits."""
        pictures, planes = [picture], [guides]
        while min(pictures[-1].shape[:2]) >= 2 * (2 * MARGIN + 2):
            pictures.append(halved(pictures[-1]))
            planes.append(halved(planes[-1]))
        return PatchSource(pictures, planes)


@dataclass
class GuideLevels:
    """A target's guides on all levels of its pyramid, for one search."""

    shape: tuple[int, int]  # Height and width of the finest level.
    finest: UInt16  # That level as the search takes it (`_interleaved`).
    coarser: list[Float32]  # float32 [h, w, G], from fine to coarse.

    @staticmethod
    def of(guides: Float32, source: PatchSource, config: PatchSearch) -> GuideLevels:
        """The levels of guides [H, W, G] that a search goes through."""
        shape = guides.shape[0], guides.shape[1]
        return GuideLevels(shape, _interleaved(shape, MARGIN, None, guides),
                           _pyramid(guides, _count(source, config))[1:])


@dataclass
class PatchTarget:
    """What is to be synthesised."""

    # float32 [H, W, G] as the source's; or their levels, which take half of the memory.
    guides: Float32 | GuideLevels
    # Exemplar places (x, y) where the search begins, float32 [H, W, 2]; or `start_levels`.
    start: Float32 | list[Int32]
    guided: Float32 | list[Int32]  # Places that the search always tries, likewise.
    # wanted, weight, limit: float32 [H, W, 2] and [H, W]: the error of coming from elsewhere is the
    # weight times the squared distance from the wanted place, at most ``limit`` (squared pixels),
    # for each pixel of the patch; no weights: everywhere alike.
    wanted: Float32 | None = None
    weight: Float32 | None = None
    limit: float = np.inf
    # float32 [h, w], how often each exemplar pixel would be used if those of its material were used
    # alike; None: all alike.
    even: Float32 | None = None
    # float32 [H, W, 2], factors of the weights of the first two guides; None: 1.
    trust: Float32 | None = None
    state: UInt8 | None = None  # uint8 [H, W] of `kernels.patches`; None: all is synthesised.
    owner: Int32 | None = None  # int32 [H, W], see `skin.Atlas`; None: every pixel owns itself.
    colors: Float32 | None = None  # float32 [H, W, 3], of the fixed pixels.
    own: bool = False  # Whether the finest level may be painted into ``colors``.

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        height, width = self.guides.shape[:2]
        return height, width


def halved(planes: Float32) -> Float32:
    """Means of blocks of 2 x 2 of [H, W, C]; the last row or column is repeated if odd."""
    height, width = planes.shape[:2]
    if height % 2 or width % 2:
        planes = np.pad(planes, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    top, low = planes[::2], planes[1::2]
    total = (top[:, ::2] + top[:, 1::2]) + (low[:, ::2] + low[:, 1::2])
    return np.asarray(total * np.float32(0.25), np.float32)


def occupancy(places: Int32, source: tuple[int, int], state: UInt8 | None = None) -> Float32:
    """How many patches are copied from each cell of an exemplar of size ``source``, [h, w]."""
    uses = np.empty((-(-source[0] // CELL), -(-source[1] // CELL)), np.float32)
    if state is None:
        state = np.full(places.shape, ACTIVE, np.uint8)
    count_uses(places, state, source[1], uses)
    return uses


def middles(level: int, shape: tuple[int, int], full: tuple[int, int]) -> tuple[Any, Any]:
    """Rows and columns, for `np.ix_`, of the middles of a level's pixels in the full picture."""
    step = 2 ** level
    return np.ix_(np.minimum(np.arange(shape[0]) * step + step // 2, full[0] - 1),
                  np.minimum(np.arange(shape[1]) * step + step // 2, full[1] - 1))


def at_middles(plane: Array, level: int, shape: tuple[int, int]) -> Array:
    """A plane [H, W, ...] at the middles of a level's pixels, in C order."""
    if level == 0:
        return np.ascontiguousarray(plane)
    step = 2 ** level
    inner = plane[step // 2::step, step // 2::step]
    if inner.shape[:2] != shape:  # the last row or column is not whole
        inner = plane[middles(level, shape, (plane.shape[0], plane.shape[1]))]
    return np.ascontiguousarray(inner)


def settled(owner: Int32, rounds: int = 3) -> Int32:
    """Owners [H, W] that own themselves: chains are followed, and those without an end cut."""
    flat = owner.reshape(-1)
    for _ in range(rounds):
        further = flat[flat]
        flat = np.where((flat >= 0) & (further >= 0), further, flat)
    loose = (flat >= 0) & (flat[flat] != flat)
    return np.where(loose, np.arange(flat.size, dtype=np.int32), flat).reshape(owner.shape)


def coarser_owner(owner: Int32, level: int, shape: tuple[int, int]) -> Int32:
    """Owners, int32 [H, W], on a coarser level of a ``shape``, int32 of that shape.

    Whoever is owned by one that is not its own owner keeps itself.
    """
    if level == 0:
        return owner
    width = owner.shape[1]
    middle = at_middles(owner, level, shape)
    coarse = np.where(middle >= 0, ((middle // width) >> level) * shape[1]
                      + ((middle % width) >> level), -1).astype(np.int32)
    return settled(coarse, 2)


def synthesise_patches(target: PatchTarget, source: PatchSource, config: PatchSearch,
                       seed: int = 0) -> tuple[Float32, Int32]:
    """Synthesise, coarse to fine: float32 [H, W, 3] in [0, 1] of the finest level; 0 outside.

    With it int32 [H, W], the flat index of the exemplar's pixel behind each patch's middle.
    """
    levels = range(_count(source, config) - 1, -1, -1)
    guides = (target.guides if isinstance(target.guides, GuideLevels)
              else GuideLevels.of(target.guides, source, config))
    fixed = None if target.colors is None else _pyramid(target.colors, len(levels))
    places: Int32 | None = None
    colors = np.zeros((1, 1, 3), np.float32)
    with ThreadPoolExecutor(1) as aside:
        # Finer levels are laid out while the search goes on in coarser ones.
        engines = [aside.submit(_Level, target, source, guides,
                                None if fixed is None else fixed[level], level, config)
                   for level in levels]
        if guides.shape[0] * guides.shape[1] > _LARGE:
            aside.submit(give_back_memory)  # that of the target's planes
        # Each level has laid out its own: the planes of the finest one are hundreds of MB.
        del target, guides, fixed
        for level in levels:
            engine = engines.pop(0).result()
            places = engine.first_places(places)
            votes = config.last_votes if level == 0 and config.last_votes else config.votes
            radii = [MARGIN] * votes + [1] * (config.final_3x3 and level == 0)
            # The coarsest level is small, and what it finds is what all others build on.
            widest = (max(engine.size) if 0 < level == levels[0]
                      else max(2, config.reach >> max(0, level - 1)))
            for turn, radius in enumerate(radii):
                colors = engine.improve(places, radius,
                                        seed * 1000003 + 1000 * level + 10 * turn, widest)
    assert places is not None
    return colors, places


def start_levels(places: Float32, source: PatchSource, config: PatchSearch) -> list[Int32]:
    """Exemplar places [H, W, 2] as flat indices int32 [h, w] on each level, from fine to coarse."""
    shapes = [(places.shape[0], places.shape[1])]
    while len(shapes) < _count(source, config):
        shapes.append((-(-shapes[-1][0] // 2), -(-shapes[-1][1] // 2)))
    return [_flat(places, level, (picture.shape[0], picture.shape[1]), shape)
            for level, (picture, shape) in enumerate(zip(source.pictures, shapes))]


def _flat(places: Float32, level: int, size: tuple[int, int], shape: tuple[int, int]) -> Int32:
    """Places [H, W, 2] of the finest level as a level's flat indices, int32 of its ``shape``."""
    out = np.empty(shape, np.int32)
    level_places(np.ascontiguousarray(places), 2 ** level, size, out)
    return out


def _count(source: PatchSource, config: PatchSearch) -> int:
    """Levels that a search goes through."""
    return min(config.levels, len(source.pictures))


def _pyramid(planes: Float32, levels: int) -> list[Float32]:
    """Planes [H, W, C], each half the size of the one before."""
    out = [planes]
    while len(out) < levels:
        out.append(halved(out[-1]))
    return out


class _Level:
    """One level of the pyramid: votes and searches alternate on it."""

    def __init__(self, target: PatchTarget, source: PatchSource, guides: GuideLevels,
                 fixed: Float32 | None, level: int, config: PatchSearch) -> None:
        self.config, self.level, self.source = config, level, source
        self.picture = source.pictures[level]
        self.size = self.picture.shape[0], self.picture.shape[1]
        self.shape = guides.shape
        if level:
            height, width = guides.coarser[level - 1].shape[:2]
            self.shape = height, width
        self.root = np.float32(SCALE * 255 * np.sqrt(config.style_weight / 3))
        self.patches = _interleaved(self.size, 0, self.picture * self.root, source.guides[level])
        self.target = (_interleaved(self.shape, MARGIN, None, guides.coarser[level - 1]) if level
                       else guides.finest)
        self.state = (np.full(self.shape, ACTIVE, np.uint8) if target.state is None
                      else at_middles(target.state, level, self.shape))
        self.owner = (None if target.owner is None
                      else coarser_owner(target.owner, level, self.shape))
        self.trust = (np.ones((*self.shape, 2), np.float32) if target.trust is None
                      else at_middles(target.trust, level, self.shape))
        self._want(target)
        self.even = self._even(target)
        self.start = self._flat(target.start)
        self.guided = (self.start if target.guided is target.start else self._flat(target.guided))
        self.fixed = fixed
        self.own = target.own or level > 0
        self.voted: Float32 | None = None

    def _want(self, target: PatchTarget) -> None:
        """Wanted places, their weights and the limit on this level."""
        step = 2 ** self.level
        if target.wanted is None or target.weight is None:
            self.wanted = np.zeros((*self.shape, 2), np.float32)
            self.weight = np.zeros(self.shape, np.float32)
        else:
            self.wanted = at_middles(target.wanted, self.level, self.shape)
            if self.level:
                self.wanted = self.wanted / np.float32(step)
            self.weight = (at_middles(target.weight, self.level, self.shape)
                           * np.float32(SCALE ** 2 * step ** 2))
        self.limit = np.float32(target.limit / step ** 2)

    def _even(self, target: PatchTarget) -> Float32:
        """Uses of each cell of the exemplar if all of one material were used alike."""
        rows, columns = (-(-n // CELL) for n in self.size)
        overall = max(int((self.state == ACTIVE).sum()), 1) / (self.size[0] * self.size[1])
        if target.even is None:
            return np.full((rows, columns), overall * CELL ** 2, np.float32)
        step = 2 ** self.level * CELL
        y, x = (np.minimum(np.arange(n) * step + step // 2, m - 1)
                for n, m in zip((rows, columns), target.even.shape))
        # What is not wanted at all is dear, but not beyond measure.
        return np.maximum(target.even[np.ix_(y, x)], np.float32(0.3 * overall)) * CELL ** 2

    def _flat(self, places: Float32 | list[Int32]) -> Int32:
        """Places of a target as this level's flat indices."""
        return (places[self.level] if isinstance(places, list)
                else _flat(places, self.level, self.size, self.shape))

    def first_places(self, coarser: Int32 | None) -> Int32:
        """Where the search begins, int32 [H, W]: as the coarser level found, or the given start."""
        if coarser is None:
            return self.start.copy()
        out = np.empty(self.shape, np.int32)
        finer_places(coarser, self.source.pictures[self.level + 1].shape[1], self.state,
                     self.start, self.size, out)
        return out

    def improve(self, places: Int32, radius: int, seed: int, reach: int) -> Float32:
        """Search better patches for the voted colors, in place; new colors [H, W, 3]."""
        config = self.config
        if self.voted is None:
            # Without colors yet all patches weigh the same.
            self.error = np.zeros(self.shape, np.float32)
            if self.fixed is None:
                self.voted = np.zeros((*self.shape, 3), np.float32)
            else:
                self.voted = self.fixed if self.own else self.fixed.copy()
                self.fixed = None
            self._vote(places, self.error, radius)
        error = self.error
        self._show(self.voted)
        area = np.float32((2 * radius + 1) ** 2)
        want = (self.trust, self.wanted, self.weight, self.limit)
        patch_errors(radius)(self.target, self.patches, self.size[1], self.state, *want, places,
                             error)
        # The uniformity is meant for a patch of 5 x 5 pixels and for even use of the exemplar.
        part = area / (2 * MARGIN + 1) ** 2
        penalty = np.asarray(config.uniformity * SCALE ** 2 * part / self.even, np.float32)
        for step in range(config.passes):
            uses = occupancy(places, self.size, self.state)
            search_pass(radius)(self.target, self.patches, self.size[1], self.state, *want, uses,
                                penalty, self.guided, places.copy(), places, error, reach,
                                step % 2 == 0, (seed + step) & 0xFFFFFFFF)
            self._agree(places[..., None])
        self._vote(places, error, radius)
        return self.voted

    def _vote(self, places: Int32, error: Float32, radius: int) -> None:
        assert self.voted is not None
        vote_patches(places, error, self.state, self.picture, radius,
                     np.float32(SCALE ** 2 * (2 * radius + 1) ** 2), self.voted)
        self._agree(self.voted)

    def _agree(self, values: Array) -> None:
        """Give the pixels of an atlas that others own their owner's values."""
        if self.owner is not None:
            exchange(self.owner, values)

    def _show(self, colors: Float32) -> None:
        """Write the voted colors into the target picture."""
        shown = _channels(self.target, self.shape, MARGIN)[..., :3]
        np.multiply(colors, self.root, out=shown[MARGIN:-MARGIN, MARGIN:-MARGIN],
                    casting="same_kind")
        _repeat_border(shown, MARGIN)


def _interleaved(shape: tuple[int, int], margin: int, colors: Float32 | None, planes: Float32,
                 ) -> UInt16:
    """Colors [h, w, 3] and guides [h, w, G] as flat float16 bits; channels not used are 0.

    So many pixels around them repeat the border.
    """
    out = np.zeros((shape[0] + 2 * margin) * (shape[1] + 2 * margin) * CHANNELS + 16, np.uint16)
    values = _channels(out, shape, margin)
    inner = values[margin:margin + shape[0], margin:margin + shape[1]]
    if colors is not None:
        inner[..., :3] = colors
    inner[..., 3:3 + planes.shape[2]] = planes
    if margin:
        _repeat_border(values, margin)
    return out


def _channels(bits: UInt16, shape: tuple[int, int], margin: int) -> Float16:
    """A flat array of `_interleaved` as float16 [h + 2 m, w + 2 m, CHANNELS], not copied."""
    return bits[:-16].view(np.float16).reshape(shape[0] + 2 * margin, shape[1] + 2 * margin,
                                               CHANNELS)


def _repeat_border(values: Float16, margin: int) -> None:
    """Let the margin of a picture [h, w, C] repeat what lies within, in place."""
    inside = slice(margin, -margin)
    values[inside, :margin] = values[inside, margin:margin + 1]
    values[inside, -margin:] = values[inside, -margin - 1:-margin]
    values[:margin] = values[margin]
    values[-margin:] = values[-margin - 1]
