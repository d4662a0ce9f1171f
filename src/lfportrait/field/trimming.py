"""Trim the frayed lower end of a bust by a plane.

Below the chest photos end one after the other, and what the last of them saw ends in rags. Where
fewer than two fifths of the photos still show the body (one fifth, where mattes were given and not
guessed by a network), a plane cuts it. Where they show it to its end, the lowest surface on each
side decides: the plane goes through these ends, raised until hardly anything frays above it. Busts
that end evenly are left alone, and so is all that hangs together with the head above the plane.

Under a bust that ends before a wall, a network calls a strip of that wall clothes, in all photos
alike: it has the colors of the wall beside the person, which the body above it has not
(`above_wall`). A cut that is a little too high costs some linen; holes in it would cost more.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..arrays import Bool, Float32, Float64, Floats, Int32, UInt8
from ..capture import Camera, Capture
from .grid import Cut, VoxelField, surface_points
from .training.lattice import dilated, labelled

SIDES = 72  # Directions around the body in which its lower end is looked for.
OPAQUE = 8.0  # Density per voxel from which on a point is surface.
FRAYED = 2.5
"""Voxels by which the ends' heights deviate from a plane (standard deviation) in a frayed bust."""
CLEAN = 92.0  # Per cent of the ends that lie below the cut.
SHOWN, SHOWN_SURELY = 0.4, 0.2
"""Share of the photos that still show the body where it is cut; the same with mattes that were
given: a network's take some of the floor for the person."""
ASKED = 0.25  # Places that a smaller share of all photos than this could show are ignored.
UNSEEN = 0.01
"""Where a smaller share of the surface than this lies lower, the photos' end is not the body's."""
SAMPLES = 20_000  # Points of the surface, at most, that are looked up in all photos.
CHIN = 0.35
"""The cut stays further below the chin than this part of the face's height (brows to chin)."""
STEEP = 8.0  # Optical depth of a voxel one voxel above the cut, at most.
FIRM = 3.0
"""Factor of the densities at the cut, where rays end in a wedge thinner than the surface."""
NEAR = 4.0  # Voxels above the cut from which on all is as it was.
FAINT, NEXT, LOST = 0.02, 3, 0.2
"""Opacity from which on a pixel shows matter, pixels from it that are next to it, and what a pixel
loses of its opacity if what it shows is gone."""
HANGS = 0.12  # Portrait units above the cut up to which what nothing holds from above goes.
CRUMB = 0.02  # Pieces smaller than this part of the largest are crumbs.
WALL_PHOTOS, WALL_PIXEL = 12, 2.0
"""Photos, at most, that are asked whether a bust ends in a wall, and the width of their pixels in
voxels."""
SHOULDERS = 0.8
"""What lies less far below the chin than this part of the face's height is the body: no collar
and no neckline is taken for a bust's end."""
SHADES = 16  # Levels of red, of green and of blue that colors of wall and body are counted in.
RATHER, SELDOM_SHADE = 20.0, 1e-5
"""A color that is so many times as frequent on the wall as on the body is the wall's; and the share
of the body that any color has."""
MUCH_WALL, LITTLE_WALL = 0.5, 0.1
"""Share of the wall's colors below most ends, at least, and close above the cut, at most."""
STRIP, HEM = 99.0, 0.1
"""Per cent of a strip that lie below the cut; it rises for that by this part of the face's height
above most ends at most."""
LEFT = 0.25  # Share of what has the wall's colors that a cut may leave.


def find_cut(field: VoxelField, landmarks: Floats, cameras: Camera,
             surely: bool = False) -> Cut | None:
    """Where a bust is to be cut, or None where it ends evenly, or not far enough below the face.

    The field is in the portrait frame, landmarks are [68, 3], iBUG order; ``surely``: the mattes
    were given, not guessed.
    """
    voxel = float(field.spacing.mean())
    points = field.lattice_points()[field.density > OPAQUE]
    chin = float(landmarks[8, 1])
    tall = float(landmarks[17:27, 1].mean() - chin)
    points = points[points[:, 1] < chin]
    if not np.isfinite(tall) or len(points) < 20 * SIDES:
        return None
    plane = _end_of_photos(points, chin, cameras, SHOWN_SURELY if surely else SHOWN)
    if plane is None:
        plane = _end_of_body(points, FRAYED * voxel)
    if plane is None:
        return None
    cut = _plane_cut(plane)
    face = np.asarray(landmarks)[np.isfinite(landmarks).all(axis=1)]
    if cut.above(face).min() < CHIN * tall:
        return None
    return cut


def _plane_cut(plane: Float64) -> Cut:
    """The cut along a plane (`median_plane` of x, z)."""
    normal = np.array([-plane[0], 1.0, -plane[1]])
    length = float(np.linalg.norm(normal))
    return Cut(normal / length, float(plane[2]) / length)


def _end_of_photos(points: Float64, chin: float, cameras: Camera, share: float) -> Float64 | None:
    """The plane (`median_plane` of x, z) on which all but ``share`` of the photos end, or None.

    A photo counts for a point if it shows the place above it at the chin's height: one that passes
    by on the other side says nothing of the lower end.
    """
    points = points[::max(1, len(points) // SAMPLES)]
    level = points.copy()
    level[:, 1] = chin
    shown, asked = np.zeros((2, len(points)))
    for view in range(len(cameras)):
        above = cameras[view].shows(level)[0]
        asked += above
        shown += above & cameras[view].shows(points)[0]
    known = asked > ASKED * len(cameras)
    points, enough = points[known], (shown >= share * asked)[known]
    if not len(points) or (~enough).mean() < UNSEEN:
        return None
    border = [_border(points[here], enough[here]) for here in _sides(points)]
    ends = np.array([point for point in border if point is not None]).reshape(-1, 3)
    return median_plane(ends[:, ::2], ends[:, 1]) if len(ends) >= SIDES // 4 else None


def above_wall(field: VoxelField, capture: Capture, cut: Cut | None) -> Cut | None:
    """A cut that leaves no strip of a wall under a bust; ``cut`` where there is no such strip.

    The capture has landmarks, in the portrait frame, and mattes that were guessed.
    """
    landmarks = np.asarray(capture.landmarks, np.float64)
    face = landmarks[np.isfinite(landmarks).all(axis=1)]
    chin = float(landmarks[8, 1])
    tall = float(landmarks[17:27, 1].mean() - chin)
    if not np.isfinite(tall):
        return cut
    points, colors, around = _shown_below(field, capture, chin)
    body = points[:, 1] > chin - SHOULDERS * tall
    if min(body.sum(), len(around)) < 4 * SIDES:
        return cut
    often, there = _shares(around), _shares(colors[body]) + SELDOM_SHADE
    wall = (often > RATHER * there)[_shades(colors)]
    ends = np.array([end for here in _sides(points)
                     if (end := _border(points[here], ~wall[here])) is not None]).reshape(-1, 3)
    if len(ends) < SIDES // 4 or not (wall & ~body).any():
        return cut
    below = _above_plane(points, median_plane(ends[:, ::2], ends[:, 1])) < 0
    plane = _above_most(ends)
    strip = _above_plane(points[wall & ~body], plane)
    plane[2] += float(np.clip(np.percentile(strip, STRIP), 0, HEM * tall)) + field.spacing.mean()
    found = _plane_cut(plane)
    above = found.above(points)
    near = wall[(above > 0) & (above < HEM * tall)]
    if (found.above(face).min() < SHOULDERS * tall or wall[below].mean() < MUCH_WALL
            or not len(near) or near.mean() > LITTLE_WALL):
        return cut
    if cut is not None and (cut.above(points[wall]) > 0).mean() < LEFT:
        return cut
    return found


def _shown_below(field: VoxelField, capture: Capture, height: float,
                 ) -> tuple[Float64, UInt8, UInt8]:
    """What photos show of a field below a height, and of what is beside the person there.

    Places float64 [N, 3] and colors uint8 [N, 3]; colors uint8 [M, 3] of the lower half of the
    mattes' surroundings.
    """
    assert capture.alphas is not None
    views = capture.training()
    views = views[np.linspace(0, len(views) - 1, min(WALL_PHOTOS, len(views))).astype(int)]
    voxel = float(field.spacing.mean())
    cameras = capture.cameras[views].scaled(
        float(np.clip(capture.cameras.pixel / (WALL_PIXEL * voxel), 0.1, 1.0)))
    places, colors, around = [], [], []
    for number, view in enumerate(views):
        size = int(cameras.width[number]), int(cameras.height[number])
        photo, matte = (cv2.resize(of[view], size, interpolation=cv2.INTER_AREA)
                        for of in (capture.images, capture.alphas))
        alpha, depth = field.depth(cameras, number)
        at = np.asarray(surface_points(cameras, number, depth), np.float64)
        on = (alpha > 0.5) & (matte > 127) & np.isfinite(at).all(axis=-1)
        on[on] = at[on][:, 1] < height
        beside = cv2.dilate(matte, np.ones((9, 9))) < 20
        rows = np.flatnonzero((matte > 127).any(axis=1))
        beside[:int(rows.mean()) if len(rows) else None] = False
        places.append(at[on])
        colors.append(photo[on])
        around.append(photo[beside])
    return np.concatenate(places), np.concatenate(colors), np.concatenate(around)


def _shades(colors: UInt8) -> tuple[NDArray[np.integer], ...]:
    return tuple((colors.astype(np.int64) * SHADES // 256).T)


def _shares(colors: UInt8) -> Float64:
    """How frequent colors [N, 3] are, float64 [SHADES, SHADES, SHADES]."""
    count = np.zeros((SHADES,) * 3)
    np.add.at(count, _shades(colors), 1.0)
    return np.asarray(ndimage.gaussian_filter(count / len(colors), 0.7), np.float64)


def _border(points: Float64, enough: Bool) -> Float64 | None:
    """The point of a side that parts best, by height, those that are shown enough from the rest."""
    order = np.argsort(points[:, 1])
    lower = ~enough[order]
    if not 0 < lower.sum() < len(lower):
        return None
    wrong = np.cumsum(~lower) + lower.sum() - np.cumsum(lower)
    return np.asarray(points[order[np.argmin(wrong)]], np.float64)


def _end_of_body(points: Float64, frayed: float) -> Float64 | None:
    """The plane (`median_plane`) above a body's rags; None if its ends are within ``frayed``."""
    ends = _ends(points)
    if len(ends) < SIDES // 2:
        return None
    rough = _above_plane(ends, median_plane(ends[:, ::2], ends[:, 1]))
    return None if rough.std() < frayed else _above_most(ends)


def _above_most(ends: Float64) -> Float64:
    """The plane of ends [N, 3], raised above most of them."""
    plane = median_plane(ends[:, ::2], ends[:, 1])
    plane[2] += float(np.percentile(_above_plane(ends, plane), CLEAN))
    return plane


def _above_plane(points: Float64, plane: Float64) -> Float64:
    """How much higher than a plane points [N, 3] lie, [N]."""
    return np.asarray(points[:, 1] - (plane[0] * points[:, 0] + plane[1] * points[:, 2]
                                      + plane[2]), np.float64)


def _ends(points: Float64) -> Float64:
    """The lowest surface points of the body by direction around its middle, [K, 3]."""
    found = [points[here][np.argmin(points[here, 1])] for here in _sides(points)]
    return np.asarray(found, np.float64).reshape(-1, 3)


def _sides(points: Float64) -> list[Bool]:
    """Which points lie in each direction around the body's middle, where eight or more do."""
    middle = np.median(points[:, [0, 2]], axis=0)
    angle = np.arctan2(points[:, 2] - middle[1], points[:, 0] - middle[0])
    side = ((angle / (2 * np.pi) + 0.5) * SIDES).astype(int) % SIDES
    return [side == number for number in range(SIDES) if (side == number).sum() >= 8]


def median_plane(flat: Float64, height: Float64) -> Float64:
    """Heights [N] at places (u, v), [N, 2], as a u + b v + c by their median deviation, [3]."""
    design = np.column_stack([flat, np.ones(len(flat))])
    weights = np.ones(len(flat))
    plane: Float64 = np.zeros(3)
    for _ in range(12):  # reweighted least squares: the least sum of deviations
        scaled = design * weights[:, None]
        # A leaning cut looks like a mistake: slopes are held back.
        ridge = np.diag([0.05 * weights.sum(), 0.05 * weights.sum(), 0.0])
        plane = np.asarray(np.linalg.solve(scaled.T @ design + ridge, scaled.T @ height),
                           np.float64)
        weights = 1.0 / np.maximum(np.abs(height - design @ plane), 1e-3)
    return plane


def trim(field: VoxelField, cut: Cut) -> VoxelField:
    """A field, without a texture, without what lies below a plane (`find_cut`), and without crumbs.

    It has fewer rows; densities fall through zero at the plane.
    """
    voxel = float(field.spacing.mean())
    above = cut.above(field.lattice_points()) / voxel
    # Through zero at the plane, so that it cuts between lattice points; a surface that runs along
    # the plane would be bitten into by a share of its density.
    ramp = np.where(above < NEAR, STEEP / voxel * above, np.inf)
    firm = 1 + (FIRM - 1) * np.clip(1 - above / NEAR, 0, 1)
    density = np.minimum(field.density * firm, ramp).astype(np.float32)
    density[_hanging(field, density, above)] = 0
    density[_crumbs(field, density)] = 0
    filled = field.links >= 0
    solid = np.zeros(filled.shape, bool)
    solid[filled] = density[field.links[filled]] > 0
    # With one clear layer around: beyond it there are no colors to mix.
    kept = filled & dilated(solid)
    rows = field.links[kept]
    links = np.full(field.links.shape, -1, np.int32)
    links[kept] = np.arange(len(rows), dtype=np.int32)
    return VoxelField(links, density[rows], field.sh[rows], field.center, field.radius, field.frame,
                      field.background, hair=None if field.hair is None else field.hair[rows],
                      clothes=None if field.clothes is None else field.clothes[rows])


def kept_pixels(field: VoxelField, cameras: Camera, view: int, cut: Cut,
                trimmed: VoxelField) -> Bool:
    """Pixels [H, W] of a view that do not show what a cut takes away, nor lie next to any.

    ``trimmed`` is the field after that (`trim`).
    """
    alpha, depth = field.depth(cameras, view)
    above = cut.above(surface_points(cameras, view, depth))
    gone = (alpha > FAINT) & ~(above > 0)  # beside a surface its depth is not known
    gone &= ndimage.binary_dilation(above < 0, iterations=NEXT)
    gone |= trimmed.depth(cameras, view)[0] < alpha - LOST  # slivers and crumbs
    return np.asarray(~ndimage.binary_dilation(gone, iterations=NEXT), np.bool_)


def _hanging(field: VoxelField, density: Float32, above: Float64) -> Int32:
    """Rows of what ends near the cut with nothing above it that holds it.

    A surface that the cut runs along is left in slivers, which hang on to the bust by their ends.
    ``above``: height of the rows over the cut, float64 [N], voxels.
    """
    filled = field.links >= 0
    solid, low = np.zeros((2, *filled.shape), bool)
    rows = field.links[filled]
    solid[filled] = density[rows] > 0.25 * OPAQUE
    low[filled] = solid[filled] & (above[rows] * field.spacing.mean() < HANGS)
    held, around = solid & ~low, np.ones((3, 3), bool)
    for level in np.flatnonzero(low.any(axis=(0, 2)))[::-1]:
        if level + 1 < solid.shape[1]:
            held[:, level] |= solid[:, level] & ndimage.binary_dilation(held[:, level + 1], around)
        # A second step aside: shoulders are flat.
        held[:, level] |= solid[:, level] & ndimage.binary_dilation(held[:, level], around)
    return np.asarray(field.links[solid & ~held], np.int32)


def _crumbs(field: VoxelField, density: Float32) -> Int32:
    """Rows of pieces that do not hang together with any large one."""
    filled = field.links >= 0
    thick = np.zeros(filled.shape, np.float32)
    thick[filled] = density[field.links[filled]]
    pieces, count = labelled(thick > 0.25 * OPAQUE)
    if count < 2:
        return np.empty(0, np.int32)
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    small = np.flatnonzero((sizes < CRUMB * sizes.max()) & (sizes > 0))
    gone = np.zeros(count + 1, bool)
    gone[small] = True
    return np.asarray(field.links[gone[pieces] & filled], np.int32)
