"""Colors where no photo looks: beside what photos show, and from other directions.

Where photos end, their colors go on: a membrane hangs from the last cells that they show well
(Laplace's equation: the smooth colors with the photos' own at the border, Perez et al. 2003 with no
gradients within). A membrane alone is flat: hair beside its strands would look like a cap, so their
detail is laid on as in mirrors that stand where photos end.

Hair and skin keep apart. Most heads have hair where this one's photos show the color of its crown
and not that of its face; where no photo looks, hair goes on as it does beside what they show, and
further on as on most heads (`lfportrait.field.surface`). A head whose crown has the face's color
has no border that colors would have to keep to.

A membrane that hangs from a lit cheek is as bright below the jaw. But skin is the darker the more
it turns away from the light, and what photos show of a face tells where that is: the logarithm of
its lightness is nearly linear in its normal (the first order of spherical harmonics, most of what
light does to a matt surface; Ramamoorthi and Hanrahan 2001). So colors go on without this shade,
and it is laid on where they come to lie; no part gets lighter or darker than the shades that photos
show.

Photos of a narrow arc look at a point from nearly one direction. They say what color it has from
there, and how that changes a little to the sides; but a training spreads what it learns over all
coefficients alike, so that the mean over all directions, the zeroth coefficient, stays near the
gray that it began with, and the others make up for it where photos looked. Whoever looks from
further aside sees the gray come back, and the others' noise grow. So the coefficients are fitted
once more to the colors that they give in the photos' directions, with a price on all but the zeroth
(ridge regression, Hoerl and Kennard 1970). It is linear, and the same for all points of a place.

Where colors are evened for those who look from aside (`grazed`), photos' directions keep what was
trained (`as_photographed`): harmonics of degree 2 have room for a difference that is there in an
arc, and fades beyond it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...arrays import Bool, Float32, Float64, Int64
from ...capture import Camera
from ...simd.threads import side_by_side
from ..geometry.chart import Chart, continued, smoothed
from ..grid import VoxelField
from ..kernels.march import real_harmonics
from ..surface import SurfaceGraph

BORDER = 1.5
"""Sigma, in cells, of the colors that the membrane hangs from: finer, each cell's noise would begin
a streak; broader, the border would show as a step."""
STRANDS = 3.0  # Sigma, in cells, of the colors that the detail of hair is what is left of.
GRAIN = 0.8  # Sigma, in cells, of what in that detail is noise.
_DARK = 0.05  # Lightness below which nothing tells how light falls.
_SHADE_PRICE = 1e-3
"""Of the square of what shade changes with a normal, over the mean square error."""
_OTHER = 0.1  # Logarithm of lightness by which a cell is of another color, and counts half.
_EXTREME = 0.05
"""Share of the cells that are lighter, and that are darker, than any shade that is laid on."""
_ROUNDS = 6
_TINTLESS = 0.1  # Lightness below which colors have hardly any tint.
_LEAST_TINT = 0.06  # Difference of tints, over lightness, that is noise.


def of_another_tint(colors: Float64, usual: Float64) -> Bool:
    """Which of colors [..., 3] have not half of the tint of ``usual`` [..., 3], or another hue.

    Both are sRGB in [0, 1]. Shaded skin is darker and has more tint; a wall behind is grayer than
    skin, or of another hue. Gloss is grayer, too.
    """
    def tint(of: Float64) -> Float64:
        light = of.mean(axis=-1, keepdims=True)
        return np.asarray((of - light) / np.maximum(light, _TINTLESS), np.float64)

    wanted, found = tint(usual), tint(colors)
    square = (wanted ** 2).sum(axis=-1)
    share = (found * wanted).sum(axis=-1) / np.maximum(square, _LEAST_TINT ** 2)
    across = np.linalg.norm(found - share[..., None] * wanted, axis=-1)
    less = (share < 0.5) & (square > _LEAST_TINT ** 2)
    return np.asarray(less | (across > _LEAST_TINT))


def continued_colors(colors: Float64, well: Bool, upwards: Float64 | float,
                     hair: Bool | None) -> Float64:
    """Colors [V, U, 3] everywhere, from the cells that photos show well.

    Parameters
    ----------
    colors, well : float64 [V, U, 3] and bool [V, U]; columns go around.
    upwards : How strongly a color holds together up and down, over sideways: one, or one a row,
        [V].
    hair : bool [V, U]: these cells keep apart from the others; None: one color.
    """
    if hair is None:
        return continued(smoothed(colors, well, BORDER), well, upwards=upwards)
    base = np.empty_like(colors)
    for part in (hair, ~hair):
        base[part] = smoothed(colors, well & part, BORDER)[part]
    out = continued(base, well, upwards=upwards, apart=hair)
    shown = well & hair
    detail = smoothed(colors, shown, GRAIN) - smoothed(colors, shown, STRANDS)
    out[hair] += _mirrored(detail, shown)[hair]
    return out


def continued_in_shade(colors: Float64, well: Bool, upwards: Float64 | float, hair: Bool | None,
                       bare: Bool, normals: Float64) -> Float64:
    """Colors [V, U, 3] everywhere, all but hair as dark as its normals make it.

    Parameters
    ----------
    colors, well, upwards, hair : As for `continued_colors`.
    bare : bool [V, U], cells that are no clothes, and tell how light falls.
    normals : float64 [V, U, 3], of unit length.
    """
    skin = bare if hair is None else bare & ~hair
    shade = shade_of(colors, well & skin, normals)[..., None]
    if hair is not None:
        shade[hair] = 1.0
    return shade * continued_colors(colors / shade, well, upwards, hair)


def shade_of(colors: Float64, skin: Bool, normals: Float64) -> Float64:
    """How bright a surface's normals make it, float64 [V, U], over what lies on the average.

    Parameters
    ----------
    colors, normals : float64 [V, U, 3], sRGB in [0, 1], and unit normals.
    skin : bool [V, U], cells of one material that photos show well.
    """
    if skin.sum() < _FEW:
        return np.ones(skin.shape)
    facing = normals[skin]
    light = np.log(np.maximum(colors[skin].mean(axis=-1), _DARK))
    rows = np.column_stack([np.ones(len(facing)), facing])
    price = _SHADE_PRICE * len(rows) * np.diag([0.0, 1.0, 1.0, 1.0])
    weight, found = np.ones(len(rows)), np.zeros(4)
    for _ in range(_ROUNDS):
        weighted = rows * weight[:, None]
        found = np.linalg.solve(weighted.T @ rows + price, weighted.T @ light)
        # Brows, lips and stubble have another color.
        weight = 1.0 / (1.0 + ((light - rows @ found) / _OTHER) ** 2)
    low, high = np.quantile(facing @ found[1:], (_EXTREME, 1.0 - _EXTREME))
    return np.asarray(np.exp(np.clip(normals @ found[1:], low, high)), np.float64)


def _mirrored(detail: Float64, shown: Bool) -> Float64:
    """Detail [V, U, C] beyond the shown cells, as mirrors at their ends show it; 0 else.

    The mirrors stand left and right where hair ends in most rows, so that strands stay whole, and
    where it ends above and below in each column.
    """
    rows, columns = shown.shape
    some = shown.any(axis=1)
    out = np.zeros_like(detail)
    if not some.any():
        return out
    low, high = (int(np.median(ends)) for ends in _ends(shown[some]))
    column = np.clip(_between(np.arange(columns), low, high), 0, columns - 1)
    bottom, top = _ends(shown.T)
    row = _between(np.arange(rows)[:, None], bottom[column], top[column])
    found = ~shown & shown[row, column[None]]
    out[found] = detail[row, column[None]][found]
    return out


def _ends(shown: Bool) -> tuple[Int64, Int64]:
    """The first and the last shown cell of each line [N, M], [N] each."""
    return shown.argmax(axis=1), shown.shape[1] - 1 - shown[:, ::-1].argmax(axis=1)


def _between(place: Int64, low: Int64 | int, high: Int64 | int) -> Int64:
    """Where places are seen between two mirrors: there and back again."""
    width = np.maximum(np.subtract(high, low), 1)
    way = (place - low) % (2 * width)
    return np.asarray(low + np.where(way > width, 2 * width - way, way), np.int64)


NAPE = -0.35  # Height at which hair usually ends behind, portrait units.
_HAIRLINE = np.array([
    # height, degrees from the front
    (NAPE - 0.01, 181.0), (NAPE, 125.0), (-0.15, 108.0), (-0.02, 105.0), (0.05, 85.0), (0.20, 60.0),
    (0.36, 0.0), (0.37, -1.0)])
"""Where hair begins on most heads: before the crown, above and behind the ears, at the nape."""
_FACE = (-0.30, -0.02), np.radians(40.0)
"""Heights of the cheeks, and how far from the front they reach."""
EARS = (-0.30, 0.15, 78.0)
"""Heights of most ears, portrait units, and degrees from the front at which they begin."""
_CROWN = 0.12  # What lies so much higher than most hairlines shows the crown.
_ALIKE = 2.0
"""Colors of crown and face are one if their middles are less far apart, over their spread."""
_SPREAD = 0.03  # Of colors, at least (sRGB in [0, 1]).
_USUAL = 3e-3  # Trust in what most heads have, over that in colors of a cell that photos see.
_FEW = 20


def hair_cells(chart: Chart, distance: Float64, colors: Float64, well: Bool,
               ) -> tuple[Bool | None, Bool]:
    """The chart's cells that are hair, and those whose colors are those of their region.

    Parameters
    ----------
    chart, distance : The closed surface, [V, U].
    colors : float64 [V, U, 3], sRGB in [0, 1].
    well : bool [V, U], cells whose colors photos show well.

    Returns
    -------
    hair : bool [V, U]; None where crown and face have one color.
    own : bool [V, U], of the cells that photos show well: not an ear before hair.
    """
    height = heights_of(chart, distance)
    aside = np.degrees(np.abs(chart.angle))[None]
    usual = usual_hair(chart, distance)
    crown, face = _crown_and_face(chart, height, well)
    if min(crown.sum(), face.sum()) < _FEW:
        return usual, well
    likes = [_away(colors, colors[part]) for part in (crown, face)]
    if np.median(likes[1][crown]) < _ALIKE:
        return None, well
    vote = 1.0 / (1.0 + np.exp(np.clip(likes[0] - likes[1], -30, 30)))
    # Dark brows, eyes and a beard are none of it: they have skin around them.
    vote = ndimage.median_filter(np.where(well, vote, usual), 3, mode="wrap")
    inner = (aside < 60.0) & (height < 0.05)
    vote = np.where(inner, 0.0, vote)
    # An ear's skin says nothing of what lies behind it.
    low, high, before = EARS
    ear = (height > low) & (height < high) & (aside > before) & (vote < 0.5)
    trust = np.where(well & ~ear, (2 * vote - 1) ** 2, 0.0) + _USUAL
    graph = SurfaceGraph.over(chart.points(distance).reshape(-1, 3),
                              np.where(well[..., None], colors, np.nan).reshape(-1, 3),
                              chart.cell / chart.scale)
    found = graph.decided(np.where(well, vote, usual).ravel(), trust.ravel())
    hair = _joined(found.reshape(well.shape) > 0.5, crown)
    # Clothes may well have the hair's color.
    return hair, well & ((hair == (vote > 0.5)) | (height < NAPE))


def skin_by_color(chart: Chart, distance: Float64, colors: Float64, well: Bool,
                  ) -> Callable[[Float64], Bool] | None:
    """Which of colors [N, 3] are rather the face's than the crown's; None where both are alike.

    The parameters are those of `hair_cells`.
    """
    crown, face = (colors[part] for part in
                   _crown_and_face(chart, heights_of(chart, distance), well))
    if min(len(crown), len(face)) < _FEW or np.median(_away(crown, face)) < _ALIKE:
        return None
    return lambda given: np.asarray(_away(given, face) < _away(given, crown))


def _crown_and_face(chart: Chart, height: Float64, well: Bool) -> tuple[Bool, Bool]:
    """Cells whose colors are those of a head's crown, and of its face, bool [V, U] each."""
    aside = np.degrees(np.abs(chart.angle))[None]
    # Of a fringe or a bald forehead photos know more than most heads.
    crown = well & (aside > np.interp(height - _CROWN, *_HAIRLINE.T))
    (low, high), front = _FACE
    return crown, well & (height > low) & (height < high) & (np.abs(chart.angle) < front)[None]


def usual_hair(chart: Chart, distance: Float64) -> Bool:
    """Where most heads have hair on a chart's surface, bool [V, U]."""
    begins = np.interp(heights_of(chart, distance), *_HAIRLINE.T)
    return np.asarray(np.degrees(np.abs(chart.angle))[None] > begins)


def _joined(cells: Bool, seeds: Bool) -> Bool:
    """Of cells [V, U] those that hang together with seeds; columns go around."""
    pieces, count = ndimage.label(np.tile(cells, 2))
    kept = np.zeros(count + 1, bool)
    kept[pieces[np.tile(seeds, 2)]] = True
    kept[0] = False
    half = cells.shape[1]
    return np.asarray(kept[pieces[:, :half]] | kept[pieces[:, half:]])


def heights_of(chart: Chart, distance: Float64) -> Float64:
    """Heights of the surface's cells, [V, U], portrait units."""
    return np.asarray(chart.axis[:, 1][:, None]
                      + np.sin(chart.elevation)[:, None] * distance * chart.scale)


def _away(colors: Float64, sample: Float64) -> Float64:
    """How far colors [..., 3] are from those of a sample [M, 3], in standard deviations, [...]."""
    spread = np.cov(sample.T) + _SPREAD ** 2 * np.eye(3)
    root = np.linalg.cholesky(np.linalg.inv(spread))
    return np.asarray(np.linalg.norm((colors - np.median(sample, axis=0)) @ root, axis=-1))


PRICE = 0.003
"""Of a coefficient's square, over the mean square error of the colors. At three times more,
held-out photos inside the arc lost 0.1 to 0.3 dB."""
PHOTOS = 40  # Photos, at most, whose directions are asked.
BLOCK = 16  # Lattice points along a side of a place that is treated alike.
FACING = 6.0
"""Photos from the side that a place faces count up to exp(2 x this) times those from behind."""
FADES = 3.0
"""Weight of fading beyond an arc, over that of the photos in it. At 1 crowns are streaked."""
BEYOND = np.radians(np.arange(6.0, 80.0, 10.0))
"""Angles beyond the ends of an arc from which on the photos' own colors fade."""


def with_steady_colors(field: VoxelField, cameras: Camera, middle: NDArray[np.floating],
                       price: float = PRICE) -> VoxelField:
    """A field whose colors beyond its photos' directions go on as they are in them.

    Parameters
    ----------
    field : Trained on photos; without a texture.
    middle : [3], inside the head, in the world: places are taken to face away from it.
    price : Of a coefficient's square (`PRICE`).

    Returns
    -------
    field : The same lattice points and densities.
    """
    if field.basis == 1:
        return field
    return replace(field, sh=_by_place(field, field.sh, cameras, middle, price))


def as_photographed(field: VoxelField, trained: Float32, cameras: Camera,
                    middle: NDArray[np.floating]) -> VoxelField:
    """A field that from its photos' directions has the colors that it was trained to.

    From further aside it keeps its own: what they differ by fades beyond the photos' arc.

    Parameters
    ----------
    field : Without a texture.
    trained : float32 [N, 3, B], coefficients of its lattice points.
    cameras, middle : As for `with_steady_colors`.

    Returns
    -------
    field : The same lattice points and densities.
    """
    if field.basis == 1:
        return field
    apart = _by_place(field, trained - field.sh, cameras, middle, PRICE, fades=FADES)
    return replace(field, sh=field.sh + apart)


def _by_place(field: VoxelField, sh: Float32, cameras: Camera, middle: NDArray[np.floating],
              price: float, fades: float = 0.0) -> Float32:
    """Coefficients [N, 3, B] of a field's points, by the `_operator` of each place."""
    chosen = np.linspace(0, len(cameras) - 1, min(PHOTOS, len(cameras))).astype(int)
    positions = np.asarray(cameras.position[chosen], np.float64)
    flat = np.flatnonzero(field.links >= 0)
    rows = field.links.ravel()[flat]
    # In three dimensions `numpy.argwhere` takes four times as long.
    blocks: NDArray[Any] = np.stack(np.unravel_index(flat, field.links.shape), axis=1) // BLOCK
    number = np.ravel_multi_index(tuple(blocks.T), tuple(blocks.max(axis=0) + 1))
    order = np.argsort(number, kind="stable")
    since = np.flatnonzero(np.diff(number[order], prepend=-1))
    out = sh.copy()

    def fit(part: NDArray[Any]) -> None:
        center = (blocks[part[0], ::-1] + 0.5) * BLOCK * field.spacing + field.bounds[0]
        there = rows[part]
        out[there] = sh[there] @ _operator(center, positions, middle, field.basis, price, fades).T

    side_by_side(fit, np.split(order, since[1:]))
    return out


def _operator(center: Float64, positions: Float64, middle: NDArray[np.floating], basis: int,
              price: float, fades: float = 0.0) -> Float32:
    """What coefficients [B] at a place [3] are multiplied with, float32 [B, B].

    ``fades`` : Weight of nothing beyond the photos' arc, over what is in it.
    """
    away = center - positions
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    outwards = center - middle
    outwards /= max(float(np.linalg.norm(outwards)), 1e-9)
    seen = _moments(away, outwards, basis)
    priced = seen + price * np.diag(np.arange(basis) > 0)
    if fades > 0:
        priced += fades * _moments(_beyond(away), outwards, basis)
    return np.asarray(np.linalg.solve(priced, seen), np.float32)


def _moments(away: Float64, outwards: Float64, basis: int) -> Float64:
    """Mean products [B, B] of the harmonics over directions [N, 3], by how a place faces them."""
    weight = np.exp(-FACING * away @ outwards)
    harmonics = real_harmonics(away, basis) * np.sqrt(weight / weight.sum())[:, None]
    return np.asarray(harmonics.T @ harmonics, np.float64)


def _beyond(away: Float64) -> Float64:
    """Unit directions [K, 3] beyond both ends of the arc that directions [N, 3] lie on."""
    middle = away.mean(axis=0)
    along = np.linalg.svd(away - middle, full_matrices=False)[2][0]
    middle /= max(float(np.linalg.norm(middle)), 1e-9)
    along -= (along @ middle) * middle
    along /= max(float(np.linalg.norm(along)), 1e-9)
    turn = np.arctan2(away @ along, away @ middle)
    beyond = np.concatenate([turn.max() + BEYOND, turn.min() - BEYOND])[:, None]
    return np.asarray(np.cos(beyond) * middle + np.sin(beyond) * along, np.float64)
