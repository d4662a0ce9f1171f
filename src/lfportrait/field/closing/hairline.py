"""Where hair ends on a head that photos show in part, by its own colors.

Most heads have hair where this one's photos show the color of its crown and not that of its face;
where no photo looks, hair goes on as it does beside what they show, and further on as on most
heads (`lfportrait.field.surface`). A head whose crown has the face's color has no border
that colors would have to keep to.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ...arrays import Bool, Float64
from ..geometry.chart import Chart
from ..surface import SurfaceGraph

__all__ = ["NAPE", "hair_cells", "usual_hair"]

NAPE = -0.35
"""Height at which hair usually ends behind, portrait units."""
_HAIRLINE = np.array([
    # height, degrees from the front
    (NAPE - 0.01, 181.0), (NAPE, 125.0), (-0.15, 108.0), (-0.02, 105.0), (0.05, 85.0), (0.20, 60.0),
    (0.36, 0.0), (0.37, -1.0)])
"""Where hair begins on most heads: before the crown, above and behind the ears, at the nape."""
_FACE = (-0.30, -0.02), np.radians(40.0)
"""Heights of the cheeks, and how far from the front they reach."""
_EAR = (-0.30, 0.15, 78.0)
"""Heights of ears, and degrees from the front from which on they are looked at."""
_CROWN = 0.12
"""What lies so much higher than most hairlines shows the crown."""
_ALIKE = 2.0
"""Colors of crown and face are one if their middles are less far apart, over their spread."""
_SPREAD = 0.03
"""Of colors, at least (sRGB in [0, 1])."""
_USUAL = 3e-3
"""Trust in what most heads have, over that in colors of a cell that photos see."""
_FEW = 20


def hair_cells(chart: Chart, distance: Float64, colors: Float64, well: Bool,
               ) -> tuple[Bool | None, Bool]:
    """The chart's cells that are hair, and those whose colors are those of their region.

    Parameters
    ----------
    chart, distance
        The closed surface, [V, U].
    colors
        float64 [V, U, 3], sRGB in [0, 1].
    well
        bool [V, U], cells whose colors photos show well.

    Returns
    -------
    hair
        bool [V, U]; None where crown and face have one color.
    own
        bool [V, U], of the cells that photos show well: not an ear before hair.
    """
    height = _heights(chart, distance)
    aside = np.degrees(np.abs(chart.angle))[None]
    usual = usual_hair(chart, distance)
    # Of a fringe or a bald forehead photos know more than most heads.
    crown = well & (aside > np.interp(height - _CROWN, *_HAIRLINE.T))
    (low, high), front = _FACE
    face = well & (height > low) & (height < high) & (np.abs(chart.angle) < front)[None]
    if min(crown.sum(), face.sum()) < _FEW:
        return usual, well
    likes = [_away(colors, part) for part in (crown, face)]
    if np.median(likes[1][crown]) < _ALIKE:
        return None, well
    vote = 1.0 / (1.0 + np.exp(np.clip(likes[0] - likes[1], -30, 30)))
    # Dark brows, eyes and a beard are none of it: they have skin around them.
    vote = ndimage.median_filter(np.where(well, vote, usual), 3, mode="wrap")
    inner = (aside < 60.0) & (height < 0.05)
    vote = np.where(inner, 0.0, vote)
    # An ear's skin says nothing of what lies behind it.
    low, high, before = _EAR
    ear = (height > low) & (height < high) & (aside > before) & (vote < 0.5)
    trust = np.where(well & ~ear, (2 * vote - 1) ** 2, 0.0) + _USUAL
    graph = SurfaceGraph.over(chart.points(distance).reshape(-1, 3),
                              np.where(well[..., None], colors, np.nan).reshape(-1, 3),
                              chart.cell / chart.scale)
    found = graph.decided(np.where(well, vote, usual).ravel(), trust.ravel())
    hair = _joined(found.reshape(well.shape) > 0.5, crown)
    # Clothes may well have the hair's color.
    return hair, well & ((hair == (vote > 0.5)) | (height < NAPE))


def usual_hair(chart: Chart, distance: Float64) -> Bool:
    """Where most heads have hair on a chart's surface, bool [V, U]."""
    begins = np.interp(_heights(chart, distance), *_HAIRLINE.T)
    return np.asarray(np.degrees(np.abs(chart.angle))[None] > begins)


def _joined(cells: Bool, seeds: Bool) -> Bool:
    """Of cells [V, U] those that hang together with seeds; columns go around."""
    pieces, count = ndimage.label(np.tile(cells, 2))
    kept = np.zeros(count + 1, bool)
    kept[pieces[np.tile(seeds, 2)]] = True
    kept[0] = False
    half = cells.shape[1]
    return np.asarray(kept[pieces[:, :half]] | kept[pieces[:, half:]])


def _heights(chart: Chart, distance: Float64) -> Float64:
    """Heights of the surface's cells, [V, U], portrait units."""
    return np.asarray(chart.axis[:, 1][:, None]
                      + np.sin(chart.elevation)[:, None] * distance * chart.scale)


def _away(colors: Float64, part: Bool) -> Float64:
    """How far colors [V, U, 3] are from those of a part, in standard deviations, [V, U]."""
    sample = colors[part]
    spread = np.cov(sample.T) + _SPREAD ** 2 * np.eye(3)
    root = np.linalg.cholesky(np.linalg.inv(spread))
    return np.asarray(np.linalg.norm((colors - np.median(sample, axis=0)) @ root, axis=-1))
