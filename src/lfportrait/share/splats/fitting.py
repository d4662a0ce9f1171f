"""From a field to splats: laid on its surface, then fitted to what it shows.

The field is looked at from all around. Where a ray's transmittance passes one half there is a
surface point; where the field is too thin for that (stray hair, the rim of a beard), one lies where
a few percent of the light are taken. A splat is the middle of all points in a small cell: a disc
along the surface, as wide as its distance to its neighbours.

They are fitted in color, opacity, size and place by gradient descent. A view is rendered by the
field and by the splats; the derivative of their squared difference, in color on black and in
opacity, moves the splats (Adam, Kingma and Ba 2015). Of three views two are close-ups, so that
splats stay as large as the gaps between them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array, Bool, Float32, Float64, Int64
from ...capture import Camera
from ...errors import UserError
from ...field import C0, Rendering, VoxelField
from ..kinds import SplatConfig
from ..video import orbit_cameras
from .cloud import Splats, quaternions_of, render_splats, splat_view

LOOKS = ((0.0, 8), (40.0, 6), (-30.0, 6), (75.0, 3), (-65.0, 3))
"""Pitch in degrees and number of cameras on each ring around the head."""
DISTANCE = 3.5  # Of the cameras from the middle, in radii of what the field holds.
PIXEL = 1.0  # Of their pictures, in distances between neighbouring splats.
LARGEST = 1000  # Side of those pictures at most, pixels.
THIN = 12.0
"""By this factor a copy of the field is denser that shows where something thin is: where the field
itself takes 1 - 0.5^(1 / 12) = 6 % of the light."""
DEEP = 4  # How much deeper than wide a cell is.
FACING = 0.35
"""Where the cosine between normal and view is lower, a ray is stopped by the soft layer over the
surface: what it meets counts as thin."""
FAINT = 0.04  # Pixels that are more transparent show no color that could be trusted.
WIDTH = 0.48  # Standard deviation of a disc along the surface, in distances to its neighbours.
FLAT = 0.25  # Its standard deviation across the surface, in those along it.


@dataclass(frozen=True)
class _Points:
    """Surface points: places, normals and colors, float32 [K, 3], and opacities [K]."""

    places: Float32
    normals: Float32
    colors: Float32
    opacity: Float32

    def part(self, rows: Array) -> _Points:
        return _Points(self.places[rows], self.normals[rows], self.colors[rows], self.opacity[rows])


@dataclass(frozen=True)
class Ball:
    """A ball around what a field holds: its middle, float64 [3], and its radius, world units."""

    middle: Float64
    radius: float

    @staticmethod
    def around(field: VoxelField) -> Ball:
        """The ball of a field."""
        dense = field.lattice_points()[field.density > 0]
        if not len(dense):
            raise UserError("the field is empty; reconstruct it again")
        middle = (dense.min(axis=0) + dense.max(axis=0)) / 2
        away = float(np.linalg.norm(dense - middle, axis=1).max())
        return Ball(middle, away + float(field.spacing.max()))

    def seen(self, yaw: float, pitch: float, pixels: int) -> Camera:
        """A square camera that sees all of it, from angles in degrees as of `Camera.arc`."""
        focal = pixels / 2 * np.sqrt(DISTANCE ** 2 - 1)
        return Camera.arc(np.array([yaw]), distance=DISTANCE * self.radius, width=pixels,
                          height=pixels, focal=focal, target=self.middle.tolist(), pitch=pitch)


def _all_around(ball: Ball, pixels: int) -> Iterator[Camera]:
    """One camera after the other."""
    for ring, (pitch, count) in enumerate(LOOKS):
        turns = (np.arange(count) + ring % 2 / 2) * 360 / count
        yield from (ball.seen(turn, pitch, pixels) for turn in turns.tolist())


def _seen(field: VoxelField, ball: Ball, pixels: int, low: Float64, fine: float,
          ) -> tuple[_Points, _Points]:
    """Points from all around, merged in fine cells: the surface's, and those of thin matter."""
    dense = VoxelField(field.links, field.density * np.float32(THIN), field.sh[:, :, :1],
                       field.center, field.radius)
    solid, thin = [], []
    for camera in _all_around(ball, pixels):
        shot = field.render(camera, 0, background=0.0)
        hint = dense.render(camera, 0, background=0.0)
        places, outer = shot.points(camera, 0), hint.points(camera, 0)
        normals, forward = _normals(places), camera.pose[0, :3, 2]
        faced = -(normals @ forward) > FACING
        found = np.isfinite(shot.depth)
        solid.append(_merged(_points(places, normals, shot, found & faced), low, fine))
        outer[found] = places[found]
        thin.append(_merged(_points(outer, _normals(outer), shot, ~(found & faced)), low, fine))
    return _merged(_joined(solid), low, fine), _merged(_joined(thin), low, fine)


def _points(places: Float64, normals: Float32, shot: Rendering, wanted: Bool,
            ) -> _Points:
    """Those of the points of a picture [H, W] that are wanted."""
    there = wanted & np.isfinite(places[..., 0]) & (shot.alpha > FAINT)
    alpha = shot.alpha[there]
    shown = np.asarray(shot.color[there] / alpha[:, None], np.float32)
    return _Points(places[there].astype(np.float32), normals[there], shown, alpha)


def _normals(places: Float64) -> Float32:
    """Vectors across a surface of points [H, W, 3]; 0 where the neighbours are missing."""
    with np.errstate(invalid="ignore"):
        right = np.full_like(places, np.nan)
        down = np.full_like(places, np.nan)
        right[:, 1:-1] = places[:, 2:] - places[:, :-2]
        down[1:-1] = places[2:] - places[:-2]
        normals = np.cross(down, right)
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return np.nan_to_num(normals).astype(np.float32)


def _joined(parts: list[_Points]) -> _Points:
    return _Points(*(np.concatenate([getattr(part, name) for part in parts])
                     for name in ("places", "normals", "colors", "opacity")))


def _cells(points: _Points, low: Float64, side: float) -> tuple[Int64, int]:
    """Which cell each point lies in, int64 [K], and how many cells hold any.

    Cells are square columns, `DEEP` times as deep, along the axis that a normal is nearest to: a
    surface that leans, or that views see at slightly different depths, does not fill two of them.
    """
    axis = np.abs(points.normals).argmax(axis=1)
    outwards = np.take_along_axis(points.normals, axis[:, None], axis=1)[:, 0] > 0
    size = np.where(np.arange(3) == axis[:, None], DEEP * side, side)
    index = np.floor((points.places - low) / size).astype(np.int64)
    number = 2 * axis + outwards
    for column in index.T:
        number = (number << 20) + column
    known, cell = np.unique(number, return_inverse=True)
    return cell.reshape(-1), len(known)


def _merged(points: _Points, low: Float64, side: float) -> _Points:
    """One point for each cell, the mean of those in it."""
    if not len(points.places):
        return points
    cell, count = _cells(points, low, side)
    number = np.bincount(cell, minlength=count).astype(np.float64)[:, None]

    def mean(values: Float32) -> Float32:
        columns = values.reshape(len(values), -1)
        sums = np.stack([np.bincount(cell, column, count) for column in columns.T], axis=1)
        return (sums / number).astype(np.float32).reshape(count, *values.shape[1:])

    return _Points(mean(points.places), mean(points.normals), mean(points.colors),
                   mean(points.opacity))


def place_splats(field: VoxelField, count: int, degree: int | None = None) -> Splats:
    """At most ``count`` flat splats on the surface of a field, by default of its degree."""
    ball = Ball.around(field)
    # A ball has this area for each splat; heads have less or more, which the search finds out.
    pitch = ball.radius * float(np.sqrt(4 * np.pi / count))
    pixels = int(np.clip(np.ceil(2.2 * ball.radius / (PIXEL * pitch)), 64, LARGEST))
    low = field.bounds[0] - 1e-3
    solid, thin = _seen(field, ball, pixels, low, 0.25 * pitch)
    if not len(solid.places) + len(thin.places):
        raise UserError("the field shows nothing to be exported as splats; reconstruct it again")
    side = _side(_joined([solid, thin]), low, 0.25 * pitch, count, 4 * ball.radius)
    chosen = _chosen(field, solid, thin, low, side)
    # A cell may hold one point of each kind.
    while len(chosen.places) > count and side < 4 * ball.radius:
        side *= 1.005
        chosen = _chosen(field, solid, thin, low, side)
    # Even one cell as large as the head holds a point for each side of it.
    few = np.linspace(0, len(chosen.places), min(count, len(chosen.places)), endpoint=False)
    chosen = chosen.part(few.astype(np.int64))
    return _discs(chosen, side, field.basis if degree is None else (degree + 1) ** 2)


def _side(points: _Points, low: Float64, least: float, count: int, largest: float) -> float:
    """The smallest side of cells of which at most ``count`` hold points, within a percent."""
    most = least
    while most < largest and _cells(points, low, most)[1] > count:
        least, most = most, 2 * most
    while most > 1.01 * least:
        middle = float(np.sqrt(least * most))
        if _cells(points, low, middle)[1] > count:
            least = middle
        else:
            most = middle
    return most


def _chosen(field: VoxelField, solid: _Points, thin: _Points, low: Float64, side: float,
            ) -> _Points:
    """Points of the surface, and those of thin matter that are not close to it.

    What is thin was seen along the surface, where it hides most. It is as opaque as the field is on
    a way as long as a cell.
    """
    from scipy.spatial import cKDTree

    solid, thin = (_merged(points, low, side) for points in (solid, thin))
    if not len(thin.places) or not len(solid.places):
        return solid if len(solid.places) else thin
    away, _ = cKDTree(solid.places).query(thin.places, distance_upper_bound=side)
    free = np.isinf(away)
    opacity = -np.expm1(-side * _density(field, thin.places[free]))
    return _joined([solid, replace(thin.part(free), opacity=opacity.astype(np.float32))])


def _density(field: VoxelField, places: Float32) -> Float32:
    """The field's density at the lattice points next to places [K, 3], float32 [K]."""
    size = np.array(field.links.shape[::-1])
    x, y, z = np.clip(np.rint(((places - field.center) / field.radius + 1) * size / 2 - 0.5),
                      0, size - 1).astype(np.int64).T
    rows = field.links[z, y, x]
    return np.where(rows >= 0, np.maximum(field.density[rows], 0), np.float32(0))


def _discs(points: _Points, side: float, basis: int) -> Splats:
    """Discs at points, as wide as their distance to their neighbours."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points.places)
    near, around = tree.query(points.places, k=min(7, len(points.places) + 1))
    near, around = near.reshape(len(points.places), -1), around.reshape(len(points.places), -1)
    near[~np.isfinite(near)] = side
    width = np.clip(near[:, 1:5].mean(axis=1) if near.shape[1] > 1 else side, 0.3 * side, 2 * side)
    around = np.where(around < len(points.places), around, np.arange(len(around))[:, None])
    normals = points.normals[around].mean(axis=1)
    scales = np.stack([width * WIDTH, width * WIDTH, width * WIDTH * FLAT], axis=1)
    sh = np.zeros((len(points.places), 3, basis), np.float32)
    sh[:, :, 0] = (points.colors - 0.5) / C0
    return Splats(points.places, scales.astype(np.float32), quaternions_of(_frames(normals)),
                  np.clip(points.opacity, 0.02, 0.95).astype(np.float32), sh)


def _frames(normals: Float32) -> Float32:
    """Rotation matrices [N, 3, 3] whose third column is the normal."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    third = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), np.array([0, 0, 1]))
    helper = np.where(np.abs(third[:, 1:2]) < 0.9, np.array([0, 1, 0]), np.array([1, 0, 0]))
    first = np.cross(helper, third)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(third, first), third], axis=2).astype(np.float32)


PITCH = (-35.0, 60.0)  # Of the views, in degrees.
CLOSE = (1.0, 2.0, 2.0)  # How large views show the head, one after the other; 1 shows all of it.
RATES = {"opacity": 0.2, "scales": 0.06, "positions": 0.1}
"""Step sizes: of the logit of the opacity, of the logarithm of the scales, and of places in widths
of the splat. They fall to a tenth."""
KEPT = 0.93
"""How much of a splat's weight in the views before counts, beside that in a view, when its color is
corrected: about fifteen views have a say."""
FIRST, SECOND = 0.9, 0.97
"""How much of the means of the derivatives and of their squares stays at each step."""


class _Adam:
    """Steps of one array, of those rows alone that a view shows."""

    def __init__(self, values: Float32, rate: float) -> None:
        self.values, self.rate = values, rate
        self.mean, self.square = np.zeros_like(values), np.zeros_like(values)
        self.seen = np.zeros(len(values), np.float32)

    def step(self, rows: Int64, slope: Float32, share: float) -> None:
        """Move ``rows`` against the derivatives ``slope`` [M, ...], by a share of the rate."""
        self.seen[rows] += 1
        mean = FIRST * self.mean[rows] + (1 - FIRST) * slope
        square = SECOND * self.square[rows] + (1 - SECOND) * slope * slope
        self.mean[rows], self.square[rows] = mean, square
        seen = self.seen[rows].reshape(-1, *[1] * (slope.ndim - 1))
        mean /= 1 - FIRST ** seen
        square /= 1 - SECOND ** seen
        size = np.sqrt(square)
        # What hardly matters hardly moves.
        self.values[rows] -= np.float32(self.rate * share) * mean / (size + size.mean() + 1e-12)


def fit_splats(field: VoxelField, splats: Splats, steps: int,
               tell: Callable[[int], None] = lambda step: None) -> Splats:
    """Fit splats, as `place_splats` lays them, to a field, looking at ``steps`` views of it.

    ``tell`` is given the number of each step.
    """
    width, start = splats.scales[:, 0].copy(), splats.positions
    ball = Ball.around(field)
    logit = np.log(splats.opacity / (1 - splats.opacity))
    parts = {name: _Adam(values, RATES[name]) for name, values in (
        ("opacity", logit), ("scales", np.log(splats.scales)),
        ("positions", np.zeros_like(start)))}
    weights = np.zeros(len(start), np.float32)
    pixels = _pixels(ball, float(np.median(width)))
    for number, camera in enumerate(_views(ball, pixels, steps)):
        tell(number)
        sh = _step(field, splats, camera, parts, weights, width, number / max(steps - 1, 1))
        opacity = (1 / (1 + np.exp(-parts["opacity"].values))).astype(np.float32)
        splats = replace(splats, sh=sh, opacity=opacity, scales=np.exp(parts["scales"].values),
                         positions=start + width[:, None] * parts["positions"].values)
    return splats


def _step(field: VoxelField, splats: Splats, camera: Camera, parts: dict[str, _Adam],
          weights: Float32, width: Float32, done: float) -> Float32:
    """Move the splats that one view shows, and return the colors' new coefficients."""
    shot = field.render(camera, 0, background=0.0)
    target = np.concatenate([np.clip(shot.color, 0, 1), shot.alpha[..., None]], axis=2)
    shown = splat_view(splats, camera)
    slopes = shown.slopes(shown.image - target)
    # Hidden ones are not moved.
    rows = np.flatnonzero(slopes.weights)
    share = 0.1 ** done
    opacity = splats.opacity[rows]
    parts["opacity"].step(rows, slopes.opacity[rows] * opacity * (1 - opacity), share)
    parts["scales"].step(rows, slopes.scales[rows], share)
    parts["positions"].step(rows, slopes.positions[rows] * width[rows, None], share)
    # Pixels are linear in the colors: each gets the mean error of what it shows (SIRT).
    basis = splats.bases(camera.pose[0, :3, 3])[rows]
    weights[rows] = KEPT * weights[rows] + slopes.weights[rows]
    lack = slopes.colors[rows] / (weights[rows, None] * (basis * basis).sum(axis=1, keepdims=True))
    sh = splats.sh.copy()
    sh[rows] -= lack[:, :, None] * basis[:, None]
    return sh


def _pixels(ball: Ball, width: float) -> int:
    """Size of the views: a splat is about one pixel wide."""
    return int(np.clip(1.1 * ball.radius / width, 64, 768))


def _views(ball: Ball, pixels: int, steps: int) -> Iterator[Camera]:
    """Cameras all around, evenly spread; of three two are close-ups."""
    random = np.random.default_rng(0)
    low, high = np.sin(np.radians(PITCH))
    for number in range(steps):
        # A sequence that fills angle and height evenly, however long it gets (Roberts 2018).
        turn = 360 * ((number * 0.7548776662466927 + 0.1 * random.random()) % 1)
        height = low + (high - low) * ((number * 0.5698402909980532 + 0.5) % 1)
        camera = ball.seen(turn, float(np.degrees(np.arcsin(height))), pixels)
        close = CLOSE[number % len(CLOSE)]
        away = (random.random(2) - 0.5) * (close - 1) * 0.5 * pixels
        camera = Camera(camera.pose, camera.focal * close, camera.center + away, camera.width,
                        camera.height)
        yield camera


CHECKED = 8  # Views of a level orbit with which splats are compared to the field.


def field_splats(field: VoxelField, config: SplatConfig | None = None,
                 tell: Callable[[float, str], None] = lambda share, text: None,
                 ) -> tuple[Splats, float]:
    """Gaussian splats that look like a field.

    Parameters
    ----------
    field : The field.
    config : Parameters.
    tell : Called with how much is done, 0 to 1, and what is being done.

    Returns
    -------
    splats : In the field's world.
    psnr : In dB, of pictures of the splats against the field's, see `splat_psnr`.

    Raises
    ------
    UserError : If a parameter makes no sense or the field shows nothing.
    """
    config = config or SplatConfig()
    if config.count < 1 or config.steps < 0:
        raise UserError(f"--splats.count must be at least 1 and --splats.steps at least 0, not "
                        f"{config.count} and {config.steps}")
    tell(0.0, "surface points")
    splats = place_splats(field, config.count, config.degree)
    splats = fit_splats(field, splats, config.steps, tell=lambda step: tell(
        0.2 + 0.7 * step / config.steps, "fit"))
    tell(0.9, "comparison")
    return splats, splat_psnr(field, splats)


def splat_psnr(field: VoxelField, splats: Splats, size: int = 512) -> float:
    """PSNR in dB of splats to a field, on a level orbit on white, which no fit has seen."""
    cameras = orbit_cameras(CHECKED, size, field)
    errors = []
    for view in range(len(cameras)):
        expected = np.clip(field.render(cameras, view).color, 0, 1)
        shown = np.clip(render_splats(splats, cameras, view), 0, 1)
        errors.append(float(((shown - expected) ** 2).mean()))
    return round(-10 * math.log10(max(sum(errors) / CHECKED, 1e-10)), 2)
