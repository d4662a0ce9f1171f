"""A painted skin becomes a field's colors, and the texture of what these cannot hold.

A lattice point takes the color of the surface point above it, along the normal of the head's large
shape. That is all a preview needs. Between lattice points, though, strokes are soft: so the charts
themselves become the views of a least-squares fit (`fit.ColorModel`), each trusted where it owns
the surface. The texture is the painted atlas minus what the lattice shows in its charts
(`ChartLattice`): added where a ray meets the surface, it shows the painting itself.

With the density frozen a chart is linear in the lattice's colors. The weights are found once for a
skin and a resolution; what the colors of any painting show is a product with them. Those of a
preview are kept with the skin, which lies beside the field, and in the user's cache: only previews
of the same head need them again.
"""

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from ..arrays import Array, Bool, Float32, Float64, Int32, UInt8
from ..cache import kept_arrays, key_of
from ..capture import Camera, Capture
from ..errors import UserError
from ..example import Painting, Skin, as_stored, load_skin, save_skin, skin_key
from ..field import C0, SampleWeights, SurfaceTexture, VoxelField
from .config import check_pixels
from .fit import ColorModel, StyleView
from .kernels import gather_colors
from .mixing import BLOCK


def kept_skin(path: Path, field: VoxelField | Callable[[], VoxelField], capture: Capture,
              pixels: float, kept: Path | None = None) -> Skin:
    """The skin of the field that was read from ``path``.

    Its file, ``NAME.skin.npz`` or ``kept``, lies beside the field's; where it is missing, or was
    made of another field, other landmarks or at another resolution (``pixels`` per world unit), the
    skin is computed and written. If nothing can be written there, it is computed each time.
    ``field`` may be what gives it: it is needed only where there is no skin yet. Raises `UserError`
    if the capture has no landmarks, or ``pixels`` is out of range.
    """
    if capture.landmarks is None:
        raise UserError("the capture has no facial landmarks; run `lfportrait calibrate` on the "
                        "photos, or use --method arf")
    check_pixels(pixels)
    from .. import models

    state = path.stat()
    key = skin_key(state.st_size, state.st_mtime_ns, capture.landmarks, capture.cameras.pose,
                   pixels, not models.missing(["hair-segmentation"]))
    beside = kept or path.with_suffix(".skin.npz")
    skin = load_skin(beside, key)
    if skin is None:
        whole = field if isinstance(field, VoxelField) else field()
        # A file keeps rounded numbers: this run continues with the numbers that the next one reads.
        skin = as_stored(Skin.of(whole, capture.landmarks, capture.cameras, pixels), key)
        with suppress(OSError, UserError):
            save_skin(skin, beside, key)
    return skin


ASIDE = 0.02  # Weight in the fit of what a chart shows but does not own.
SMOOTH = 0.75
"""Sigma of the blur, in lattice spacings, of what the lattice shows below a texture. A point that
takes the paint at its place has strokes in it that no lattice can show. In the chart the texture
makes up for them; seen from elsewhere both lie a little apart, and strokes look embossed. On a
scanned head in three manners this is where neighbouring views agree best for their sharpness."""


def for_lattice(painting: Painting, field: VoxelField) -> Painting:
    """A painting on a skin, low-passed to a field's lattice; the texture has the finer detail."""
    atlas, step = painting.skin.atlas, painting.step
    sigma = SMOOTH * float(field.spacing.mean()) * painting.skin.pixels / step
    height, width = painting.color.shape[:2]
    known = (atlas.owner[::step, ::step][:height, :width] >= 0).astype(np.float32)
    sums = cv2.GaussianBlur(painting.color * known[..., None], (0, 0), sigma)
    share = cv2.GaussianBlur(known, (0, 0), sigma)
    color = sums / np.maximum(share, np.float32(1e-3))[..., None]
    return replace(painting, color=np.asarray(color, np.float32))


def look_up_rows(model: ColorModel, painting: Painting) -> None:
    """Give a model's rows the painting's colors at their places; marks them as seen."""
    found = painting.at(painting.skin.rows)
    known = np.isfinite(found[:, 0])
    model.colors[known] = found[known]
    model.seen[known] = 1.0


def row_labels(skin: Skin) -> tuple[UInt8, tuple[str, ...]]:
    """Soft regions of a field's rows, uint8 [N, R], and the regions' names.

    Rows that no chart shows belong to none. Kept with the skin.
    """
    return skin.cached("row labels", lambda: _row_labels(skin))


def _row_labels(skin: Skin) -> tuple[UInt8, tuple[str, ...]]:
    labels, names = skin.labels
    owner = skin.atlas.owner
    known = np.flatnonzero(np.isfinite(skin.rows[:, 0]))
    pixel = skin.rows[known].astype(np.int32)
    slot = skin.slots_of(owner[np.clip(pixel[:, 1], 0, owner.shape[0] - 1),
                               np.clip(pixel[:, 0], 0, owner.shape[1] - 1)])
    out = np.zeros((len(skin.rows), len(names)), np.uint8)
    # The last one stands for none, -1.
    out[known] = np.take(np.concatenate([labels, np.zeros_like(labels[:1])]), slot, axis=0)
    return out, names


def chart_views(field: VoxelField, skin: Skin, background: float, step: int = 1) -> list[StyleView]:
    """The charts as views of a fit, and the lattice rows behind each pixel.

    Every ``step``-th pixel is used, a power of two up to 16, on a grey ``background``.
    """
    atlas = skin.atlas
    own = atlas.own
    views = []
    for n in range(len(atlas.boxes)):
        there = chart_pixels(skin, n, step)
        camera = chart_camera(skin, n, step)
        width, height = int(camera.width[0]), int(camera.height[0])
        # The networks look at whole pictures; the fit only at what a chart owns.
        inside = own[there] if step == 1 else atlas.owner[there] >= 0
        weights = field.sample_weights(camera, 0, inside=inside)
        alpha = weights.alpha.reshape(height, width)
        content = _shown(atlas.color_of(there), alpha, background)
        trust = np.where(own[there], np.float32(1), np.float32(ASIDE)) * alpha
        trust[alpha < 0.05] = 0.0
        views.append(StyleView(content, content, alpha, trust, weights, trust))
    return views


def chart_camera(skin: Skin, n: int, step: int) -> Camera:
    """The camera of the part of a chart that the atlas holds, at every ``step``-th pixel."""
    camera = skin.atlas.cameras[n]
    x0, y0, x1, y1 = skin.atlas.boxes[n, :4].tolist()
    return Camera(camera.pose, camera.focal / step, (camera.center - [x0, y0]) / step,
                  np.array([(x1 - x0) // step]), np.array([(y1 - y0) // step]))


def chart_pixels(skin: Skin, n: int, step: int) -> tuple[slice, slice]:
    """Rows and columns of the atlas that hold every ``step``-th pixel of a chart."""
    x0, y0, x1, y1, dx, dy = (int(value) for value in skin.atlas.boxes[n])
    width, height = (x1 - x0) // step, (y1 - y0) // step
    left, top = x0 + dx + step // 2, y0 + dy + step // 2
    return slice(top, top + height * step, step), slice(left, left + width * step, step)


def show_painting(views: list[StyleView], painting: Painting, background: float,
                  step: int = 1) -> None:
    """Let the charts' views (`chart_views`) ask for a painting's colors."""
    for n, view in enumerate(views):
        rows, columns = chart_pixels(painting.skin, n, 1)
        x0, y0 = columns.start, rows.start
        if step == painting.step:
            picture = painting.color[y0 // step:, x0 // step:][:view.shape[0], :view.shape[1]]
        else:
            # Means of blocks: the middle alone would alias.
            block = step // painting.step
            part = painting.color[y0 // painting.step:, x0 // painting.step:]
            part = part[:view.shape[0] * block, :view.shape[1] * block]
            picture = part.reshape(view.shape[0], block, view.shape[1], block, 3).mean((1, 3))
        view.example = _shown(picture, view.alpha, background)


def _shown(picture: Float32, alpha: Float32, background: float) -> Float32:
    """A picture on the background, by its opacity."""
    opacity = alpha[..., None]
    return np.asarray(opacity * picture + (1 - opacity) * np.float32(background), np.float32)

PREVIEW = 2  # Pixels of the skin per painted pixel in a preview.
MARGIN = 12
"""Pixels kept around what a chart owns, so that cells at a border find theirs in either chart."""
HEADS = 4  # So many heads' maps for previews, 50 MB each, stay in the user's cache.
SOLID = 0.9
"""Where a chart's own view is clearer than this, nothing is known of the surface's color."""


_ARRAYS = "lattice_counts", "lattice_rows", "lattice_weights"
"""Rows a pixel of each chart in turn, uint8; which, int32; how much of each, float16."""

Map = tuple[tuple[slice, slice], SampleWeights]
"""Rows and columns of the atlas that a chart fills, and the weights of its pixels."""


class ChartLattice:
    """The charts of a skin as linear maps of a field's colors.

    Parameters
    ----------
    step : Use every ``step``-th pixel of the atlas. At the full resolution each chart's map is
        made when it is needed: all of them take four times the room of a preview's.
    arrays : From `arrays` of such a lattice, instead of finding the weights again.
    whole : Keep all maps at the full resolution, too: for several paintings.

    Attributes
    ----------
    near : bool [H, W] of the atlas at that resolution: what charts own, and a margin around it.
    """

    def __init__(self, field: VoxelField, skin: Skin, step: int,
                 arrays: Mapping[str, Array] | None = None, whole: bool = False) -> None:
        self.density = field.density
        atlas = skin.atlas
        shape = atlas.depth.shape[0] // step, atlas.depth.shape[1] // step
        own = atlas.own[::step, ::step][:shape[0], :shape[1]]
        around = np.ones((2 * MARGIN // step + 1,) * 2, np.uint8)
        self.near = cv2.dilate(own.astype(np.uint8), around) > 0
        charts = range(len(atlas.boxes))
        self._maps: Sequence[Map | functools.partial[Map]]
        if arrays is not None:
            self._maps = _read_maps([_place(skin, n, step) for n in charts], arrays)
        elif step > 1 or whole:
            self._maps = [_chart_map(field, skin, step, n, self.near) for n in charts]
        else:
            self._maps = [functools.partial(_chart_map, field, skin, step, n, self.near)
                          for n in charts]

    def arrays(self) -> dict[str, Array]:
        """The weights of all charts as arrays for a file, rounded to float16."""
        weights = [found for _, found in self._made()]
        return dict(zip(_ARRAYS, (
            np.concatenate([np.diff(one.indptr) for one in weights]).astype(np.uint8),
            np.concatenate([one.rows for one in weights]),
            np.concatenate([one.weights for one in weights]).astype(np.float16))))

    def _made(self) -> Iterator[Map]:
        """The charts' maps, one after the other."""
        for kept in self._maps:
            yield kept() if isinstance(kept, functools.partial) else kept

    def left_out(self, picture: Float32, colors: Float32) -> Float32:
        """What lattice colors [N, 3] leave out of a picture of the atlas, float32 [H, W, 3].

        0 where nothing solid is near.
        """
        out = np.zeros_like(picture)
        for there, weights in self._made():
            shown = np.empty((len(weights.alpha), 3), np.float32)
            gather_colors(weights.indptr, weights.rows, weights.weights, colors, shown)
            alpha = weights.alpha[:, None]
            shown /= np.maximum(alpha, np.float32(SOLID))
            shown = np.where(alpha > SOLID, picture[there].reshape(-1, 3) - shown, 0)
            out[there] = shown.reshape(out[there].shape)
        return out


def chart_lattice(field: VoxelField, skin: Skin, step: int) -> ChartLattice:
    """The maps of a field's colors to every ``step``-th pixel of its skin's charts.

    Those of previews are kept with the skin; if that comes from a file, in the user's cache, too.
    """
    if step == 1:
        return ChartLattice(field, skin, step)
    kept = skin.cached("lattices", dict[int, ChartLattice])
    if step not in kept or kept[step].density is not field.density:
        arrays = None
        if step == PREVIEW and "key" in skin.kept:
            arrays = kept_arrays(
                "lattices", key_of(__name__, skin.kept["key"], field.density),
                lambda: ChartLattice(field, skin, PREVIEW).arrays(), most=HEADS)
        kept[step] = ChartLattice(field, skin, step, arrays)
    return kept[step]


def _place(skin: Skin, n: int, step: int) -> tuple[slice, slice]:
    """Rows and columns of the atlas, every ``step``-th, that chart ``n`` fills."""
    camera = chart_camera(skin, n, step)
    top, left = (part.start // step for part in chart_pixels(skin, n, 1))
    return slice(top, top + int(camera.height[0])), slice(left, left + int(camera.width[0]))


def _chart_map(field: VoxelField, skin: Skin, step: int, n: int, near: Bool) -> Map:
    there = _place(skin, n, step)
    # As views are rendered; a preview takes longer strides.
    stride = 0.5 if step == 1 else 1.0
    return there, field.sample_weights(chart_camera(skin, n, step), 0, step=stride,
                                       inside=near[there])


def _read_maps(places: list[tuple[slice, slice]], arrays: Mapping[str, Array]) -> list[Map]:
    counts, rows, values = (arrays[name] for name in _ARRAYS)
    ends = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
    values = values.astype(np.float32)
    alpha = np.zeros(len(counts), np.float32)
    filled = counts > 0  # an empty pixel's sum would be its successor's first value
    alpha[filled] = np.add.reduceat(values, ends[:-1][filled])
    maps, since = [], 0
    for there in places:
        until = since + (there[0].stop - there[0].start) * (there[1].stop - there[1].start)
        part = slice(ends[since], ends[until])
        maps.append((there, SampleWeights(ends[since:until + 1] - ends[since], rows[part],
                                          values[part], alpha[since:until])))
        since = until
    return maps


KEEN = 0.1
"""Looking up between texels blurs: on average, over where a look-up falls, detail of four texels
keeps 2/3 of its energy, of two 1/3. The texture makes up for it (generalised sampling): neighbours
on either side are taken off with this weight. So views are nearest to what was painted, looked up
by a filter of eight texels (Lanczos)."""


def surface_texture(styled: VoxelField, painting: Painting,
                    lattice: ChartLattice | None = None) -> SurfaceTexture:
    """The texture that makes a field in a painting's colors show that painting of its skin.

    ``lattice``: how the field shows in its charts at the painting's resolution, if that is known.
    """
    skin, step = painting.skin, painting.step
    once = lattice is None and step == 1
    lattice = lattice or chart_lattice(styled, skin, step)
    colors = np.asarray(C0 * styled.sh[:, :, 0] + 0.5, np.float32)
    # To render the charts once takes less than half of the time in which their maps are made.
    detail = _keen(_not_shown(styled, skin, painting.color) if once
                   else lattice.left_out(painting.color, colors))
    detail *= lattice.near[..., None]
    charts = skin.cached("row charts", lambda: row_charts(skin))
    return SurfaceTexture.of(detail, projections(skin, step), charts, skin.pixels / step)


def _not_shown(styled: VoxelField, skin: Skin, picture: Float32) -> Float32:
    """What views of a field's charts lack of a picture of the atlas (`ChartLattice.left_out`)."""
    out = np.zeros_like(picture)
    bare = VoxelField(styled.links, styled.density, np.ascontiguousarray(styled.sh[:, :, :1]),
                      styled.center, styled.radius)
    bare.take_lattice(styled)
    for n in range(len(skin.atlas.boxes)):
        there = _place(skin, n, 1)
        cast = bare.render(chart_camera(skin, n, 1), background=0.0)
        alpha = cast.alpha[..., None]
        out[there] = np.where(alpha > SOLID, picture[there] - cast.color / np.maximum(alpha, SOLID),
                              np.float32(0))
    return out


def _keen(detail: Float32) -> Float32:
    """Differences [H, W, 3] that a bilinear look-up shows as sharp as they were."""
    row = np.array([-KEEN, 1 + 2 * KEEN, -KEEN], np.float32)
    return np.asarray(cv2.sepFilter2D(detail, -1, row, row), np.float32)


def projections(skin: Skin, step: int = 1) -> Float64:
    """From the world to the atlas at every ``step``-th pixel, float64 [C, 3, 4]."""
    cameras, boxes = skin.atlas.cameras, skin.atlas.boxes
    out = np.empty((len(boxes), 3, 4))
    for n, (x0, y0, _, _, dx, dy) in enumerate(boxes.tolist()):
        lens = np.eye(3)
        lens[[0, 1], [0, 1]] = cameras.focal[n] / step
        # Whole blocks of the atlas: as `chart_pixels` has them.
        corner = np.array([(x0 + dx) // step, (y0 + dy) // step])
        lens[:2, 2] = (cameras.center[n] - [x0, y0]) / step + corner
        turn = cameras.pose[n, :3, :3].T
        out[n] = lens @ np.concatenate([turn, -(turn @ cameras.pose[n, :3, 3])[:, None]], axis=1)
    return out


def row_charts(skin: Skin) -> UInt8:
    """The chart that shows each lattice row's place, uint8 [R]; 255 where none does."""
    out = np.full(len(skin.rows), 255, np.uint8)
    x, y = np.ascontiguousarray(skin.rows.T)
    for n, (x0, y0, x1, y1, dx, dy) in enumerate(skin.atlas.boxes.tolist()):
        # A comparison with NaN is false.
        out[(x >= x0 + dx) & (x < x1 + dx) & (y >= y0 + dy) & (y < y1 + dy)] = n
    return out


def texel_rows(skin: Skin, texture: SurfaceTexture) -> Int32:
    """A lattice row for each block of texels, int32 [H / 4, W / 4] rounded up: that nearest to it.

    ``texture`` is of the skin, with which they are kept.
    """
    shape = tuple(-(-size // BLOCK) for size in texture.texels.shape[:2])
    return skin.cached(("texel rows", texture.pixels, shape),
                     lambda: _block_rows(skin, texture, shape))


def _block_rows(skin: Skin, texture: SurfaceTexture, shape: tuple[int, ...]) -> Int32:
    found = np.full(shape, -1, np.int32)
    known = np.flatnonzero(np.isfinite(skin.rows[:, 0]))
    scale = texture.pixels / skin.pixels / BLOCK
    block = (skin.rows[known] * scale).astype(np.int64)
    block = np.minimum(block, np.array(shape[::-1]) - 1)
    found[block[:, 1], block[:, 0]] = known
    _, labels = cv2.distanceTransformWithLabels(
        (found < 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5,
        labelType=cv2.DIST_LABEL_PIXEL)
    # A label is a number of its own for each block that has a row.
    row_of = np.zeros(int(labels.max()) + 1, np.int32)
    row_of[labels[found >= 0]] = found[found >= 0]
    return np.asarray(row_of[labels], np.int32)
