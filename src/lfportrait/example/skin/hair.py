"""Hair of a sitter's head: as its field knows it, by the network, by color, relief, or place.

A head that was fitted to one photo knows what of it is hair, or that it is bald. Of others the
segmentation network is asked about the charts that stand upright. What looks like the hair that it
knows is hair behind, too. Without it hair is what lies around the face in another color; or, as
curls of stone or bronze have the color of the face, where the crown is much rougher than forehead
and cheeks, what is as rough as the crown and hangs together with it. A shaven or veiled head has no
such crown: one on which the network sees no hair is painted bald, others have hair where most heads
have it.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Bool, Float32, Int32, UInt8
from ...field import SurfaceGraph, VoxelField
from ...simd.threads import side_by_side
from ..guides.filters import skin_distance
from ..painter.light import Cells
from ..surface_guide import HeadPlane
from .charts import Atlas

UPRIGHT, TURNED = 30.0, 75.0
"""Charts of this pitch and yaw (degrees) at most are shown to the network of the hair."""
ROOM, GROUND = 1.4, 0.35
"""Side of the picture it is shown over that of the chart, and the grey around the head."""
AGREED = 0.35
"""Share of its hair (intersection over union) that charts which show the same places must agree on.
A real head's: 0.72; statues and shaven heads: 0.1 at most."""
BARE = 0.06
"""Where the network calls less than this share of each chart hair, it sees none. A shaven head: up
to 0.035."""
LOWEST = -0.75  # Hair hangs at least this far below the brows (up, in the face's heights).
BESIDE_NECK, HANGS, LONGEST = (-1.15, -0.85), 0.5, -1.6
"""Where long hair hangs beside the neck (up, in the face's heights), if this share of it there is
of the crown's color; and how far down it is looked for then."""
BARE_EAR = 0.6  # Share of an ear whose color is the skin's rather than the hair's, if it is bare.
BEARD = -0.45, -1.5  # A beard lies between these (up, in the face's heights).
OTHER = 2.3  # A crown of hair is further than this from the face's colors, in standard deviations.
GRAPH = 0.025  # Side of the cells that regions are decided in as a whole, over the face's height.
UNSURE = 0.01
"""Trust in what is said of places that no photo saw, over that in those that photos saw well."""
HAIRLINE = 0.64, 88.0
"""Where hair begins: above the brows (chin -1) in the middle; at their height, in degrees."""
LOCKS = ((0.03, 11), (0.025, 29), (0.02, 67))
"""Locks that hair ends in at the nape: lengths over the face's height, numbers around a head."""
BAY, BAY_CELL = 0.15, 0.03
"""Bays of skin less than twice so wide close, and the cells that this is looked at in; over the
face's height."""
STRAND, STRAND_CELL = 0.04, 0.01
"""Gaps in hair less than twice so wide are strands of it, and the cells that this is looked at in;
over the face's height."""
CURL_CELL, CURL_BLUR = 0.02, 2.0
"""Side of the cells that roughness is measured in, over the face's height; its blur in cells."""
CURLS = 0.08  # Gaps and specks less than twice so wide are none; over the face's height.
ROUGH, ROUGHER = 0.5, 1.6
"""A crown of curls has so strong contours, so many times those of forehead and cheeks."""
ROUGH_LIMIT = 0.4  # What is rougher than this share of the way from skin to crown is hair.
LOWEST_CURL = -1.1
"""Curls end here at the latest (up from the brows, in the face's heights): below the chin."""
REACH = 20.0
"""What photos saw is carried on so many cells; further on hair is where most heads have it."""


def network_hair(atlas: Atlas, index: Int32) -> Float32 | None:
    """Hair by the network on the charts that show a face, [N]; NaN on others. None without it.

    It is 0 where it looked if it sees (almost) none.

    It has learnt from selfies: large, on a dark ground with room around it a head is found; from
    behind a shaven one is called hair. Nor is it believed where it calls one place hair in one
    chart and not in the next: the curls of a statue.
    """
    from ... import models
    from ...face import hair_mask

    if models.missing(["hair-segmentation"]):
        return None
    out, most = np.full(atlas.depth.shape, np.nan, np.float32), 0.0
    away = -atlas.cameras.pose[:, :3, 2]  # towards each chart's eye, in the portrait frame
    for n, (x0, y0, x1, y1, dx, dy) in enumerate(atlas.boxes.tolist()):
        if abs(away[n, 1]) > np.sin(np.radians(UPRIGHT)) or away[n, 2] < np.cos(np.radians(TURNED)):
            continue
        part = slice(y0 + dy, y1 + dy), slice(x0 + dx, x1 + dx)
        there = np.isfinite(atlas.depth[part])[..., None]
        picture = np.where(there, atlas.color_of(part), np.float32(GROUND))
        rows, columns = picture.shape[:2]
        side = int(ROOM * max(rows, columns))
        square = np.full((side, side, 3), np.uint8(GROUND * 255), np.uint8)
        top, left = (side - rows) // 2, (side - columns) // 2
        square[top:top + rows, left:left + columns] = np.uint8(picture * 255 + 0.5)
        out[part] = hair_mask(square, size=512)[top:top + rows, left:left + columns]
        if there.any():
            most = max(most, float((out[part][there[..., 0]] > 0.5).mean()))
    known = out.reshape(-1)
    if most < BARE:
        return np.where(np.isnan(known[index]), known[index], np.float32(0))
    return known[index] if _agreed(atlas, known) else None


def _agreed(atlas: Atlas, hair: Float32) -> bool:
    """Whether charts that show the same places call the same ones hair, [H x W]."""
    owner = atlas.owner.reshape(-1)
    copies = np.flatnonzero((owner >= 0) & ~atlas.own.reshape(-1))
    here, there = hair[copies], hair[owner[copies]]
    known = np.isfinite(here) & np.isfinite(there)
    either, both = (float(part(here[known], there[known]).sum())
                    for part in (np.maximum, np.minimum))
    return both >= AGREED * either


def hair_of_head(field: VoxelField, points: Float32, normals: Float32) -> Float32 | None:
    """Hair at places [N, 3] of a head that knows it (`VoxelField.hair`), [N]; None if it does not.

    Half a voxel before the surface, as under thin hair lies skin.
    """
    return None if field.hair is None else _shares_at(field, field.hair, points, normals)


def clothes_of_head(field: VoxelField, points: Float32, normals: Float32) -> Float32 | None:
    """Clothes at places [N, 3] of a head that knows them (`VoxelField.clothes`), [N]; else None."""
    return None if field.clothes is None else _shares_at(field, field.clothes, points, normals)


def _shares_at(field: VoxelField, known: UInt8, points: Float32, normals: Float32) -> Float32:
    """How much places [N, 3] are what rows are ``known`` to be, uint8 [R]; [N].

    It is mixed as colors are: between the lattice's points around a place, before the surface.
    """
    shares = np.append(known, np.uint8(0)).astype(np.float32) / np.float32(255)
    there = np.append(np.ones(len(known), np.float32), np.float32(0))

    def mixed(part: Float32) -> Float32:
        at = (part - field.bounds[0]) / field.spacing - 0.5
        low = np.floor(at).astype(np.int64)
        way = (at - low).astype(np.float32)
        total, sure = np.zeros(len(part), np.float32), np.full(len(part), 1e-6, np.float32)
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, way, 1 - way), axis=1)
            x, y, z = np.clip(low + corner, 0, np.array(field.links.shape[::-1]) - 1).T
            row = field.links[z, y, x]
            total += weight * shares[row]
            sure += weight * there[row]
        return total / sure

    before = points + np.float32(0.5 * field.spacing.min()) * normals
    pieces = np.array_split(before, max(1, len(points) >> 15))
    return np.concatenate(side_by_side(mixed, pieces))


def hair_behind(plane: HeadPlane, colors: Float32, flat: Float32, seen: Float32,
                 ears: Float32, known: Float32) -> Float32:
    """Hair [N] where it is not ``known`` (NaN): what looks like the hair that is, not like skin.

    Along the outline of its picture the network takes hair for ground: there color decides, too.
    """
    up = -flat[:, 1] / plane.height
    hairy, bare = known > 0.7, (known < 0.2) & (up < 0.3) & (up > -0.9)
    # Down to where hair hangs at the sides.
    lowest = min(LOWEST, float(np.percentile(up[hairy], 2))) if hairy.any() else LOWEST
    parted = _classified_hair(plane, colors, flat, seen, ears, hairy & (seen > 0.5),
                              bare & (seen > 0.5), around_face(plane, flat, lowest))
    unknown = np.isnan(known) | ((known < 0.5) & (seen < 0.5))
    return np.asarray(np.where(unknown, parted, known), np.float32)


def hair_by_color(plane: HeadPlane, colors: Float32, flat: Float32, seen: Float32,
                   ears: Float32) -> Float32 | None:
    """Hair as what lies around the face, above the chin, in another color, [N]; None if alike."""
    up, angle = -flat[:, 1] / plane.height, np.abs(flat[:, 0]) / plane.radius
    crown = (up > 0.7) & (seen > 0.5)
    face, bearded = _bare_face(colors, up, (angle < 0.7) & (seen > 0.5), crown)
    if crown.sum() < 100 or face.sum() < 100:
        return None
    if np.median(skin_distance(colors[crown | face], face[crown | face], 1.0)[
            crown[crown | face]]) < OTHER:
        return None
    lowest = LOWEST
    # Long hair: beside the neck is its color, too.
    beside = (angle > 0.9) & (up > BESIDE_NECK[0]) & (up < BESIDE_NECK[1]) & (seen > 0.5)
    if beside.sum() >= 100:
        chosen = beside | crown | face
        hairy, bare = (skin_distance(colors[chosen], part[chosen], 1.0)[beside[chosen]]
                       for part in (crown, face))
        if np.mean((hairy < bare) & (hairy < OTHER)) > HANGS:
            lowest = LONGEST
    around = around_face(plane, flat, lowest)
    if bearded:  # on chin and upper lip, too
        around |= (up < BEARD[0]) & (up > BEARD[1])
    return _classified_hair(plane, colors, flat, seen, ears, crown, face, around)


def _bare_face(colors: Float32, up: Float32, front: Bool, crown: Bool) -> tuple[Bool, bool]:
    """Skin of the face among places in ``front``, bool [N], and whether there is a beard.

    A forehead under a fringe and a bearded chin are more like the crown than like the cheeks.
    ``up`` [N] is 0 at the brows and -1 at the chin.
    """
    out = front & (up < 0.3) & (up > -0.9)
    cheeks = front & (up < -0.1) & (up > -0.45)
    hairy = []
    for part in (front & (up > 0) & (up < 0.3), front & (up < -0.6) & (up > -0.9)):
        away = [np.median(skin_distance(colors[part | other], other[part | other], 1.0)[
            part[part | other]]) if min(part.sum(), other.sum()) > 100 else 0.0
            for other in (cheeks, crown)]
        hairy.append(bool(away[1] < away[0]))
        if hairy[-1]:
            out &= ~part
    return out, hairy[1]


def settled_hair(graph: SurfaceGraph, hair: Float32, seen: Float32) -> Float32:
    """Hair [N] as the surface has it on the whole, where photos do not show it for sure.

    Where photos end, they and the network see neither hair nor skin: a seam of skin would run
    through the hair, and streaks of hair over a neck.
    """
    sure = (2 * hair - 1) ** 2
    whole = graph.decided(hair, seen * sure + UNSURE * sure)
    firm = seen * sure
    return np.asarray(firm * hair + (1 - firm) * np.clip(3 * whole - 1, 0, 1), np.float32)


def without_bare_ears(plane: HeadPlane, points: Float32, colors: Float32, flat: Float32,
                      seen: Float32, ears: Float32, hair: Float32) -> Float32:
    """Hair [N] without ears that photos hardly see, if most of such an ear has the skin's color.

    Around an ear lies hair, which goes on over it where photos say nothing. Of N places in the
    portrait frame, ``points`` [N, 3], in world units, ``colors`` [N, 3] are sRGB in [0, 1],
    ``flat`` [N, 2] unwrapped; ``seen``, ``ears`` and ``hair`` [N] in [0, 1].
    """
    up, angle = -flat[:, 1] / plane.height, np.abs(flat[:, 0]) / plane.radius
    shown = seen > 0.5
    locks = shown & (hair > 0.8)
    skin, _ = _bare_face(colors, up, shown & (angle < 0.7) & (hair < 0.2), locks)
    if min(skin.sum(), locks.sum()) < 100:
        return hair
    out = hair.copy()
    for side in (points[:, 0] < plane.origin[0], points[:, 0] >= plane.origin[0]):
        ear = side & (ears > 0.5)
        chosen = skin | locks | ear
        away = [skin_distance(colors[chosen], part[chosen], 1.0)[ear[chosen]]
                for part in (skin, locks)]
        if ear.any() and np.mean(away[0] < away[1]) > BARE_EAR:
            hidden = side & ~shown
            out[hidden] *= 1 - ears[hidden]
    return out


def _classified_hair(plane: HeadPlane, colors: Float32, flat: Float32, seen: Float32, ears: Float32,
                     hairy: Bool, bare: Bool, around: Bool) -> Float32:
    """Hair ``around`` the face [N] by its color, [N], from samples [N] of hair and of skin.

    Strands close over no ``ears`` [N].
    """
    chosen = (around | hairy | bare) & (seen > 0.5)
    # A neck in the shade is not of the face's color, but of the hair's even less.
    from_face = skin_distance(colors[chosen], bare[chosen], 1.0)
    from_hair = skin_distance(colors[chosen], hairy[chosen], 1.0)
    hair = np.zeros(len(colors), np.float32)
    hair[chosen] = 1 / (1 + np.exp(np.clip((from_hair - from_face) / 0.5, -30, 30)))
    hair[~around] = 0
    hair = with_strands(plane, flat, hair, around & (seen > 0.5) & (ears < 0.5))
    # What no photo saw goes on as it begins, and further on as hair goes on.
    unseen, parted = around & (seen <= 0.5), around & (seen > 0.5)
    beside = Cells.over(flat, 0.03 * plane.height).extrapolated(3 * hair - 1.5, parted, 1.0, 20.0)
    hair[unseen] = np.clip(hair_by_place(plane, flat[unseen]) + beside[unseen], 0, 1)
    return np.asarray(hair, np.float32)


def plausible_hair(plane: HeadPlane, points: Float32, hair: Float32) -> bool:
    """Whether a good part of the head above the brows is hair: else it is shaven, or a statue.

    Where it is not known, ``hair`` is NaN.
    """
    above = (points[:, 1] > plane.origin[1]) & np.isfinite(hair)
    return bool(above.any() and hair[above].mean() > 0.2)


def hair_by_place(plane: HeadPlane, flat: Float32) -> Float32:
    """Where hair is on most heads, float32 [N]: around the forehead, down to ears and nape.

    Of places ``flat`` [N, 2] in the head's unwrapping.
    """
    up, angle = -flat[:, 1] / plane.height, _angle(plane, flat)
    # A superellipse: round at the temples, then down to the sideburns.
    middle, side = HAIRLINE
    around = (np.maximum(up, 0) / middle) ** 3 + (angle / side) ** 3
    above = np.clip((np.cbrt(around) - 1) / 0.15 + 0.5, 0, 1) * (up > 0)
    # Below the brows it leaves the cheeks, and begins behind the ears.
    begins = side + (100 - side) * np.clip(-up / 0.25, 0, 1)
    behind = np.clip((angle - begins) / 10 + 0.5, 0, 1) * (up <= 0)
    behind *= np.clip((up + _hair_end(plane, flat)) / 0.1, 0, 1)
    return np.asarray(above + behind, np.float32)


def below_hair(plane: HeadPlane, flat: Float32) -> Float32:
    """Where a head has hair only if it is long, float32 [N] in [0, 1]: around jaw and neck.

    Arguments as for `hair_by_place`.
    """
    down, angle = flat[:, 1] / plane.height, _angle(plane, flat)
    # Down to the chin in the middle; beside the eyes it leaves the cheeks.
    cheek = np.clip((angle - 45) / 15, 0, 1)
    beside = np.where(angle < 90, 0.1 + 0.25 * np.clip((angle - 60) / 25, 0, 1),
                      _hair_end(plane, flat))
    end = (1 - cheek) * (0.95 - 0.2 * (np.minimum(angle, 55) / 55) ** 2) + cheek * beside
    return np.asarray(np.clip((down - end) / 0.1, 0, 1), np.float32)


def without_bays(plane: HeadPlane, flat: Float32, hair: Float32) -> Float32:
    """Hair [N] that has closed over narrow bays and islands of skin, float32 [N].

    The painter's locks and the head's hairline leave them between each other. Arguments as for
    `hair_by_place`; ``hair`` [N] in [0, 1].
    """
    cells = Cells.over(flat, BAY_CELL * plane.height)
    return np.maximum(hair, cells.closed(hair, round(BAY / BAY_CELL)))


def with_strands(plane: HeadPlane, flat: Float32, hair: Float32, known: Bool) -> Float32:
    """Hair [N] by color, with its strands that shine or lie in shade, float32 [N].

    They have the colors of skin, or half of them: painted so they would be streaks of skin, or of
    the painter's hairline. But bare skin is broader. Arguments as for `hair_by_place`; ``hair`` [N]
    in [0, 1] closes over gaps where it is ``known``, bool [N], and no others.
    """
    cells = Cells.over(flat, STRAND_CELL * plane.height)
    # Between what is hair for sure; cells at a strand's edge are half filled.
    sure = np.clip(2 * hair - 1, 0, 1)
    gaps = 2 * cells.gaps(sure, known, round(STRAND / STRAND_CELL))
    return np.asarray(np.where(known, np.minimum(hair + gaps, 1), hair), np.float32)


def _angle(plane: HeadPlane, flat: Float32) -> Float32:
    """Degrees from the middle of the face, [N]."""
    return np.asarray(np.degrees(np.abs(flat[:, 0]) / plane.radius), np.float32)


def _hair_end(plane: HeadPlane, flat: Float32) -> Float32:
    """How far down short hair grows (brows 0, chin 1), [N]; a level line would show.

    Sideburns to the middle of the ears, behind them to their lobes, and on to the nape, where it
    ends in locks of several breadths: an even edge would be that of a cap.
    """
    angle = _angle(plane, flat)
    behind, nape = np.clip((angle - 90) / 15, 0, 1), np.clip((angle - 100) / 60, 0, 1)
    turns = flat[:, 0] / np.float32(2 * np.pi * plane.radius)
    # Straight sides, as strokes have: triangles, not waves.
    locks = sum(size * (2 * np.abs(2 * ((count * turns + 0.3) % 1) - 1) - 1)
                for size, count in LOCKS)
    return np.asarray(0.35 + 0.2 * behind + 0.25 * nape * nape * (3 - 2 * nape)
                      + np.clip((angle - 110) / 20, 0, 1) * locks, np.float32)


def around_face(plane: HeadPlane, flat: Float32, lowest: float) -> Bool:
    """Where a head may have hair, bool [N]: around the face, down to ``lowest`` behind.

    That is how far hair hangs below the brows, in units of the face's height upwards; ``flat`` [N,
    2] are places in the head's unwrapping.
    """
    up, angle = -flat[:, 1] / plane.height, np.abs(flat[:, 0]) / plane.radius
    # Above the brows; towards the temples hair grows further down.
    above = up > 0.35 - 0.25 * np.clip((angle - 0.4) / 0.3, 0, 1)
    return np.asarray(above | (angle > 0.9) & (up > lowest))


def hair_by_relief(plane: HeadPlane, flat: Float32, contours: Float32, seen: Float32,
                   ears: Float32) -> Float32 | None:
    """Hair as what is as rough as the crown, float32 [N] in [0, 1]; None if that is smooth.

    Of places ``flat`` [N, 2] in the head's unwrapping; ``contours``, ``seen`` and ``ears`` are
    float32 [N] in [0, 1]: strength of edges and patterns, how well photos saw a place, ears.
    """
    up, angle = -flat[:, 1] / plane.height, np.abs(flat[:, 0]) / plane.radius
    shown = seen > 0.5
    crown, forehead = shown & (up > 0.7), shown & (angle < 0.6) & (up > 0.15) & (up < 0.45)
    cheeks = shown & (angle > 0.25) & (angle < 0.8) & (up > -0.75) & (up < -0.15)
    if min(part.sum() for part in (crown, forehead, cheeks)) < 100:
        return None
    rough, *smooth = (float(np.median(contours[part])) for part in (crown, forehead, cheeks))
    if rough < max(ROUGH, ROUGHER * max(smooth)):
        return None
    cells = Cells.over(flat, CURL_CELL * plane.height)
    step = rough - max(smooth)
    lean = (contours - max(smooth) - ROUGH_LIMIT * step) / (0.2 * step)
    begin = np.where(shown, np.float32(0.5), hair_by_place(plane, flat))
    hair = np.clip(begin + cells.extrapolated(lean, shown, CURL_BLUR, REACH), 0, 1)
    hair *= around_face(plane, flat, LOWEST_CURL) * (1 - ears)
    reach = round(CURLS / CURL_CELL)
    hair = cells.joined(cells.opened(cells.closed(hair.astype(np.float32), reach), reach), crown)
    return np.asarray(np.clip(3 * hair - 1, 0, 1) * (1 - ears), np.float32)
