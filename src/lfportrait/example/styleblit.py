"""StyleBlit: pieces of the exemplar that the look-up table of Eq. 6 finds are copied together.

The table has for every (x, y, appearance) the nearest pixel of the exemplar. Both readings of the
error are separable, so a distance transform that carries the arg-min gives the exact table over the
whole exemplar in a fraction of a second. Exact means: the exemplar's guides are quantised to cells,
and no cell's pixel is worse than any other pixel of the exemplar. Equal costs go to the pixel that
comes first in scan order (for the weighted L1 form; for the squared form any pixel of least cost,
always the same one).

The synthesis walks levels 6 to 1 (cells of 64 to 2 exemplar pixels). A pixel takes the shift of the
nearest jittered seed if the guides agree well enough there, else it tries the next finer level, and
at last its own look-up. Seeds live in the anchor plane: for a capture they stick to the surface.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from ..arrays import Array, Float32, Float64, Floats, Int32, Int64, UInt8
from ..files import write_image
from ..labels import PICTURE_LABELS
from .guides.position import Guides, anchor_scale
from .kernels.blit import blit, look_up
from .kernels.seeds import finite_range, seed_points, seed_regular, seed_splat
from .kernels.table import extract_indices, scatter_pixels, sweep_linear, sweep_squared
from .kernels.vote import elect, pack, vote

FIXED = 64.0  # Costs are whole numbers of 1 / FIXED.


@dataclass(frozen=True)
class TableConfig:
    """Error of the look-up table (Eq. 6) and its resolution."""

    form: Literal["linear", "squared"] = "linear"
    """linear: weighted L1 as FaceBlit has it; squared: the paper's Eq. 6."""
    position_weight: float = 10.0
    """Weight of one position unit (1/50 of the face's size, about 3 pixels of a 768 x 1024
    exemplar), 1 to 30: high keeps pixels in place, low lets look-ups move far."""
    appearance_weight: float = 1.25
    """Weight of one grey level (of 255) of the appearance, 0 to 4: low keeps patches of the
    exemplar whole, high keeps the likeness; above 2, noise of the photo scatters the look-ups."""
    cell: int = 3
    """Side of a table cell in exemplar pixels, 1 to 8."""
    levels: int = 64
    """Number of appearance levels, 8 to 256."""


@dataclass
class LookUpTable:
    """Nearest exemplar pixel of every cell."""

    indices: Int32  # int32 [rows, columns, levels], flat pixel index y * width + x.
    cell: int  # Side of a cell in exemplar pixels.
    # low, step: Appearance of level 0, and the distance of levels.
    low: float
    step: float


def quantise(appearance: Float32, levels: int) -> tuple[Int32, float, float]:
    """Levels of an appearance guide: (int32 [H, W], value of level 0, distance of levels)."""
    reach = float(max(np.abs(appearance).max(), 1e-3))
    step = 2 * reach / (levels - 1)
    index = np.rint((appearance + np.float32(reach)) / np.float32(step)).astype(np.int32)
    return np.clip(index, 0, levels - 1), -reach, step


def integer_costs(config: TableConfig, unit: float, step: float) -> tuple[int, int]:
    """Cost of one cell along x or y, and of one appearance level, in 1 / FIXED; at least 1.

    So where the appearance has no weight it still decides among equals.
    """
    grey_levels = 255.0 * step
    if config.form == "squared":
        position = config.position_weight * (config.cell / unit) ** 2
        appearance = config.appearance_weight * grey_levels ** 2
    else:
        position = config.position_weight * config.cell / unit
        appearance = config.appearance_weight * grey_levels
    return max(1, round(FIXED * position)), max(1, round(FIXED * appearance))


def build_table(appearance: Float32, config: TableConfig, unit: float) -> LookUpTable:
    """Build the exact table of one exemplar (Eq. 6) by its appearance guide, float32 [H, W].

    ``unit`` is the position unit in exemplar pixels.
    """
    height, width = appearance.shape
    if height * width >= 1 << 28:
        raise ValueError("exemplar too large for a table")
    level, low, step = quantise(appearance, config.levels)
    shape = (config.levels, -(-height // config.cell), -(-width // config.cell))
    keys = np.empty(shape, np.int64)
    scatter_pixels(level, config.cell, keys)
    position, look = integer_costs(config, unit, step)
    sweep = sweep_squared if config.form == "squared" else sweep_linear
    sweep(keys, position, position, look)
    indices = np.empty((*shape[1:], shape[0]), np.int32)
    extract_indices(keys, indices)
    return LookUpTable(indices, config.cell, low, step)


BACKGROUND_LEVELS = 8  # Coarsest level where appearance has little weight (background, clothes).
LANES = 16  # Pixels that the kernels work on at once.


@dataclass(frozen=True)
class BlitConfig:
    """Chunks and voting."""

    threshold: float = 52.0
    """Largest guide error of a chunk, 0 to 200: 24 is smooth and stable, 52 keeps strokes, above
    100 copies the exemplar's own face."""
    tolerance: float = 8.0
    """Also keep a chunk if its error exceeds that of the pixel's own look-up by less than this."""
    min_improvement: float = 14.0
    """Error by which a look-up must be better than the guided place to be used, 0 to 50: high
    values suppress scattered pixels from photo noise."""
    levels: int = 6
    """Coarsest level, 1 to 8: its cells are 2^levels exemplar pixels wide."""
    radius: int = 1
    """Voting window, in which the most frequent chunk wins and colors are averaged: 0 none, 1 is
    3 x 3, 2 is 5 x 5."""

    @property
    def top(self) -> int:
        """The coarsest of all levels."""
        return max(self.levels, BACKGROUND_LEVELS)


@dataclass
class Synthesis:
    """What StyleBlit did."""

    image: Float32  # float32 [H, W, 3] in [0, 1]; 0 where the position guide is NaN.
    shift: Float32  # float32 [H, W, 2], exemplar place minus anchor of the chunk of each pixel.
    level: UInt8  # uint8 [H, W], level of the accepted chunk; 0 = own look-up.
    error: Float32  # float32 [H, W], guide error of each pixel's own look-up.


@dataclass
class Seeds:
    """Seeds of all levels from ``finest``, one level after the other (`example.kernels.seeds`)."""

    points: Float32
    pixels: Int32
    starts: Int64
    firsts: Int64
    shapes: Int64
    finest: int


def _extent(anchor: Float32) -> tuple[Float64, Float64]:
    """Least and largest finite place of an anchor plane, [2] each; 0 where there is none."""
    low, high = (np.empty((anchor.shape[0], 2), np.float32) for _ in range(2))
    finite_range(anchor, low, high)
    ends = np.array([low.min(axis=0), high.max(axis=0)], np.float64)
    ends[~np.isfinite(ends)] = 0
    return ends[0], ends[1]


def finest_level(scale: float) -> int:
    """The finest level worth having where a target pixel is ``scale`` exemplar pixels wide.

    Cells of less than one and a half target pixels hold one pixel: its own look-up will do.
    """
    return max(1, int(np.ceil(np.log2(1.5 * scale))))


def plant(anchor: Float32, top: int, seed: int, scale: float | None, finest: int = 1) -> Seeds:
    """Seeds of levels ``finest`` to ``top`` for an anchor plane [H, W, 2]; ``seed`` of the jitter.

    ``scale`` is set where the anchor is that times the pixel; then the seeds depend on the size of
    the picture alone and serve all pictures of that size.
    """
    height, width = anchor.shape[:2]
    low, high = (_extent(anchor) if scale is None
                 else (np.zeros(2), np.array([width, height]) * scale))
    starts, firsts, shapes = (np.zeros(shape, np.int64)
                              for shape in ((top + 1,), (top + 1, 2), (top + 1, 2)))
    points, pixels, total = [], [], 0
    for level in range(finest, top + 1):
        # One cell more all around, so that every pixel has neighbours on all sides; and ends that
        # rarely change from frame to frame.
        round_to = 1 if scale is not None else 16
        first = (np.floor(low / 2 ** level).astype(np.int64) - 1) // round_to * round_to
        last = -(-(np.floor(high / 2 ** level).astype(np.int64) + 2) // round_to) * round_to - 1
        columns, rows = (int(n) for n in last - first + 1)
        point = _jittered(seed, level, int(first[0]), int(first[1]), rows, columns)
        pixel = np.full((rows, columns), -1, np.int32)
        if scale is not None:
            point = point.copy()
            seed_regular(point, np.float32(scale), height, width, pixel)
        starts[level], firsts[level], shapes[level] = total, first, (rows, columns)
        total += rows * columns
        points.append(point.reshape(-1, 2))
        pixels.append(pixel.ravel())
    seeds = Seeds(np.concatenate(points), np.concatenate(pixels), starts, firsts, shapes, finest)
    if scale is None:
        seed_splat(anchor, firsts, starts, shapes, finest, seeds.points, seeds.pixels)
    return seeds


@functools.lru_cache(maxsize=32)
def _jittered(seed: int, level: int, first_x: int, first_y: int, rows: int,
              columns: int) -> Float32:
    """Jittered seeds of some cells, [rows, columns, 2]; not to be changed."""
    points = np.empty((rows, columns, 2), np.float32)
    seed_points(seed, level, first_x, first_y, points)
    return points


def label_words(labels: UInt8) -> Int32:
    """Up to eight labels [H, W, K] of a pixel as the bytes of two words, [H, W, 2]."""
    height, width, count = labels.shape
    if count > 8:
        raise ValueError(f"at most 8 labels, not {count}")
    if count < 8:
        labels = np.concatenate([labels, np.zeros((height, width, 8 - count), np.uint8)], axis=-1)
    return np.ascontiguousarray(labels).view(np.int32).reshape(height, width, 2)


def shift_planes(height: int, width: int, margin: int) -> Float32:
    """Planes for the shifts of a picture, float32 [2, rows, columns], with a margin of NaN.

    Pixel (x, y) is at [:, margin + y, margin + x]. Only the margin is filled.
    """
    rows, columns = height + 2 * margin, -(-width // LANES) * LANES + 2 * margin
    planes = np.empty((2, rows, columns), np.float32)
    planes[:, :margin] = planes[:, rows - margin:] = np.nan
    planes[:, :, :margin] = planes[:, :, margin + width:] = np.nan
    return planes


def pack_colors(picture: Array) -> Int32:
    """Colors [h, w, 3] in [0, 1] as words [h, w] of ten bits a channel."""
    words = np.empty(picture.shape[:2], np.int32)
    pack(picture, words)
    return words


class Style(NamedTuple):
    """What a synthesis copies from."""

    appearance: Float32  # float32 [h, w], of the exemplar.
    labels: UInt8  # uint8 [h, w, K], of the exemplar.
    table: LookUpTable
    # The colors to copy, float32 [h, w, 3] in [0, 1], or int32 [h, w] of `pack_colors`.
    picture: Float32 | Int32


def synthesise(guides: Guides, weights: Float32, label_weight: float, style: Style,
               config: BlitConfig, seeds: Seeds, *, scale: float | None = None,
               calm: float = 0.0) -> Synthesis:
    """Synthesise a picture from an exemplar.

    Parameters
    ----------
    weights : float32 [H, W, 2], weight of a pixel of displacement and of an appearance of 1, per
        pixel.
    label_weight : Error of a label that is wholly wrong.
    style : What is copied from.
    config : Chunks and voting.
    seeds : Of the chunks (`plant`); the same ones give the same bytes.
    scale : Set where the anchor is ``scale`` times the pixel (a photo), as for the seeds; None for
        free anchors.
    calm : Weight of the appearance below which chunks may be as large as ``config.calm_levels``
        says.
    """
    height, width = guides.appearance.shape
    exact = scale == 1.0
    words, style_words = label_words(guides.labels), label_words(style.labels)
    per_label, table = np.float32(label_weight / 255), style.table
    margin = max(config.radius, 1)
    own_shift = shift_planes(height, width, margin)
    error = np.empty((height, width), np.float32)
    look_up(guides.position, guides.appearance, guides.anchor, weights, words, per_label,
            table.indices, table.cell, np.float32(table.low), np.float32(table.step),
            style.appearance, style_words, np.float32(config.min_improvement), exact, margin,
            own_shift, error)
    shift = shift_planes(height, width, margin)
    level = np.empty((height, width), np.uint8)
    blit(guides.position, guides.appearance, guides.anchor, weights, words, per_label,
         style.appearance, style_words, own_shift, error, config.top, config.levels,
         np.float32(calm), seeds.finest, seeds.points, seeds.pixels, seeds.starts, seeds.firsts,
         seeds.shapes, np.float32(config.threshold), np.float32(config.tolerance),
         scale is None, margin, shift, level)
    # Neighbours on one piece of the anchor plane; a photo's is one piece.
    pitch = scale if scale is not None else anchor_scale(guides.anchor)
    reach = np.float32((3 * config.radius + 2) * pitch)
    if config.radius > 0:
        # Its own look-ups are not needed any more.
        elect(guides.anchor, reach, shift, margin, width, own_shift)
        shift = own_shift
    image = np.empty((height, width, 3), np.float32)
    picture = style.picture
    colors = picture if picture.dtype == np.int32 else pack_colors(picture)
    vote(colors, guides.anchor, reach, shift, margin, config.radius, exact, image)
    inside = np.moveaxis(shift[:, margin:margin + height, margin:margin + width], 0, -1)
    return Synthesis(image, inside, level, error)


LABEL_COLORS = np.array([[0.8, 0.2, 0.2], [0.2, 0.3, 0.9], [0.9, 0.8, 0.2], [0.9, 0.3, 0.8],
                          [0.3, 0.75, 0.4], [0.95, 0.55, 0.15], [0.4, 0.4, 0.5], [0, 0, 0]])
LEVEL_COLORS = np.array([[0, 0, 0], [0.5, 0, 0.5], [0.2, 0.2, 0.9], [0.1, 0.6, 0.8],
                          [0.2, 0.75, 0.3], [0.8, 0.8, 0.2], [1, 0.6, 0.2], [1, 0.9, 0.8],
                          [1, 1, 1]])


def position_picture(position: Floats, shape: tuple[int, int]) -> Array:
    """Positions as red (x) and green (y), as the paper shows them; black without one: [H, W, 3]."""
    height, width = shape
    picture = np.zeros((*position.shape[:2], 3), np.float32)
    picture[..., :2] = np.nan_to_num(position / np.array([width, height], np.float32))
    return picture


def chunk_picture(shift: Floats, level: UInt8) -> Array:
    """Chunks by level (own look-up black, coarse light), their borders drawn, [H, W, 3]."""
    picture = LEVEL_COLORS[np.minimum(level, len(LEVEL_COLORS) - 1)]
    border = np.zeros(level.shape, bool)
    border[:, 1:] |= (shift[:, 1:] != shift[:, :-1]).any(axis=-1)
    border[1:] |= (shift[1:] != shift[:-1]).any(axis=-1)
    return picture * np.where(border, 0.6, 1.0)[..., None]


@dataclass
class TransferResult:
    """A stylised picture with everything that led to it.

    Attributes
    ----------
    image : float32 [H, W, 3] in [0, 1].
    guides : Position, appearance, labels and anchor of the target.
    mask : float32 [H, W], where the synthesis covers the photo.
    synthesis : Chunk shifts, levels and table error.
    seconds : ``table_seconds`` and ``regions_seconds`` (segmentation by networks):
        pre-calculation of the style and of the photo; ``guides_seconds``, ``synthesis_seconds``
        (with voting and blending).
    """

    image: Float32
    guides: Guides
    mask: Float32
    synthesis: Synthesis
    seconds: dict[str, float]
    exemplar_shape: tuple[int, int] = (0, 0)
    style_appearance: Float32 | None = field(default=None, repr=False)

    def dump(self, folder: str | Path) -> None:
        """Write every intermediate as a picture into ``folder``; table errors are white at 100."""
        guides, synthesis = self.guides, self.synthesis
        error = np.where(np.isfinite(synthesis.error), synthesis.error, 0)
        labels = guides.labels.astype(np.float32) / 255
        pictures = {
            "position": position_picture(guides.position, self.exemplar_shape),
            "appearance": 0.5 + guides.appearance,
            "labels": labels @ LABEL_COLORS[:len(PICTURE_LABELS)],
            "table_error": error / 100,
            "chunks": chunk_picture(synthesis.shift, synthesis.level),
            "synthesis": synthesis.image,
            "mask": self.mask,
            "result": self.image,
        }
        if self.style_appearance is not None:
            pictures["style_appearance"] = 0.5 + self.style_appearance
        for name, picture in pictures.items():
            write_image(Path(folder) / f"{name}.png", picture)
