"""The ground behind a head on a panel: a painted plane with the head's shadow on it.

The plane is parallel to the panel. A ray that leaves the field with transparency left goes on to
it, so that it has the parallax of its depth; its picture is mirrored beyond its borders, so that no
panel sees an edge. Light falls on it from where it falls on the exemplar's face, and what the head
keeps from it is its shadow, blurred as that of a large window.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..arrays import Array, Float32, Float64, Floats, Int64, UInt8
from ..capture import Camera
from ..color import to_uint8
from ..errors import UserError
from ..field import Backdrop, VoxelField, head_points
from ..media.pictures import read_image
from .display import Display
from .kernels.ground import fill_ground, shade_ground, view_ground
from .placement import EncodeConfig, Placement

_LIGHT = np.array([-0.5, 0.55, 1.0])  # Where the light comes from, where no painting says so.
_HIGH = 3.6
"""Height of a picture that is taken for the ground, in world units: all that most panels see."""
_CELL = 0.04  # Width of a cell of the shadow in half panel heights.
_CLOSED = 0.05  # Sigma of the blur that joins the places of the head, in half panel heights.
_PENUMBRA = 0.22  # Width of a shadow's soft edge over the distance of what throws it.
_PART = 0.8  # Width of a blurred ground's texels over the sigma of its blur.
_BACK = 0.005  # So few of the head's places lie farther back than its back.


@dataclass(frozen=True)
class Ground:
    """A plane behind a panel, as far as it is seen."""

    planes: Float32  # float32 [3, R, C], red, green, blue in its shadow, 0 to 255.
    depth: float  # How far it lies behind the panel, in half panel heights.
    # left, top: Where the first texel's middle lies in the display frame.
    left: float
    top: float
    texel: tuple[float, float]  # Width and height of a texel in half panel heights.
    placement: Placement  # Of the head that it lies behind.

    def fill(self, display: Display, panel: Float64, views: Array, fixed: int,
             eyes: Float64, out: UInt8) -> None:
        """Fill a panel's rows with what each sub-pixel sees of it (`fill_ground`)."""
        share = self.depth / display.distance
        across = 3 * display.width
        place = np.arange(across)
        base = np.empty((4, across), np.float32)
        channel = 2 - place % 3 if display.subpixels == "BGR" else place % 3
        for row in range(4):
            moved = panel[37 + 6 * row + 3 * (place // 3 % 2) + place % 3]
            side = display.aspect * (2.0 * (place + 0.5 + moved) / across - 1.0)
            base[row] = (((1 + share) * side - self.left) / self.texel[0]
                         + self.planes.shape[2] * channel)
        rows = panel[4] + np.arange(len(out)) * panel[7]
        height = 1.0 - 2.0 * (rows + 0.5) / panel[5]
        line = (self.top - ((1 + share) * height - share * display.eye_height)) / self.texel[1]
        fill_ground(self.planes, line, base, share / self.texel[0], views, fixed, eyes, panel, out)

    def seen(self, cameras: Camera, view: int = 0) -> Float32:
        """What a camera in the field's world sees of it, float32 [H, W, 3] in [0, 1]."""
        out = np.empty((int(cameras.height[view]), int(cameras.width[view]), 3), np.float32)
        view_ground(self.planes, *self.rays(cameras, view), out)
        return out

    def rays(self, cameras: Camera, view: int = 0) -> Float64:
        """A camera's rays in texels and height above the ground, float64 [4, 3].

        Its place, their growth for a pixel to the right and for one below, and the first pixel's.
        """
        placement = self.placement
        pose = cameras.pose[view]
        # The deep frame: x and y of the ground are the same before and after the flattening.
        turn = placement.to_world.T @ pose[:3, :3]
        place = placement.scale * (placement.to_world.T @ pose[:3, 3]) + placement.deep_shift
        to_texels = np.array([1.0 / self.texel[0], -1.0 / self.texel[1], 1.0])
        origin = (place - [self.left, self.top, -self.depth / placement.depth]) * to_texels
        focal, center = cameras.focal[view], cameras.center[view]
        across = turn[:, 0] / focal[0] * to_texels
        down = turn[:, 1] / focal[1] * to_texels
        corner = (turn[:, 2] * to_texels + (0.5 - center[0]) * across + (0.5 - center[1]) * down)
        return np.stack([origin, across, down, corner])


def panel_reach(display: Display, depth: float) -> tuple[float, float, float]:
    """How far a panel's views see on a plane at a depth: half width, lowest and highest point."""
    share = depth / display.distance
    wide = (1 + share) * display.aspect + share * display.eye_reach
    up = share * display.eye_height
    return wide, -(1 + share) - up, 1 + share - up


def backdrop_of(field: VoxelField, config: EncodeConfig) -> Backdrop | None:
    """What a configuration asks to be shown behind a field; None: a grey level."""
    own = field.backdrop
    if config.ground == "painted":
        # Who asks for a grey level gets it.
        return own if config.background == 0 else None
    if config.ground == "black":
        return None
    light, points = (_LIGHT, head_points(field)) if own is None else (own.light, own.points)
    if config.ground == "white":
        return Backdrop(np.full((2, 2, 3), 255, np.uint8), 0.3, light, points)
    if not Path(config.ground).is_file():
        raise UserError(f"the ground {config.ground!r} is no picture's file; give one, or painted, "
                        "black or white")
    picture = to_uint8(np.ascontiguousarray(read_image(config.ground)[..., :3]))
    return Backdrop(picture, picture.shape[0] / _HIGH, light, points)


def ground_of(field: VoxelField, display: Display, config: EncodeConfig) -> Ground | None:
    """The ground behind a field on a panel, or None where a grey level is shown."""
    drop = backdrop_of(field, config)
    if drop is None:
        return None
    placement = Placement.of(display, config)
    depth = _depth(drop, placement, config.ground_depth, display)
    wide, low, high = panel_reach(display, depth)
    row = 2.0 / display.height
    # A view's rays are a row apart downwards and a lens across.
    apart = row * np.sqrt(max(display.pitch / 3.0, 1.0)) * (1 + depth / display.distance)
    # Under its lens a sub-pixel takes up one in L_n of the cone: so far apart do rays look that an
    # eye can't tell from each other.
    blur = config.ground_blur * 2.0 * display.eye_reach / display.pitch * depth / display.distance
    return _ground(drop, placement, depth, (-wide, wide, low, high), config.shadow, float(apart),
                   blur / math.sqrt(12.0))


def world_ground(field: VoxelField, config: EncodeConfig, pixel: float) -> Ground | None:
    """The ground behind a field that cameras in its world look at.

    A pixel of the pictures shows ``pixel`` world units. The head is taken to be as large as usual.
    """
    drop = backdrop_of(field, config)
    if drop is None:
        return None
    placement = Placement(1.0, (0.0, 0.0, 0.0))
    depth = _depth(drop, placement, config.ground_depth / EncodeConfig.size, None)
    half = np.array(drop.picture.shape[1::-1]) / drop.pixels / 2
    return _ground(drop, placement, depth, (-half[0], half[0], -half[1], half[1]), config.shadow,
                   pixel)


def _depth(drop: Backdrop, placement: Placement, behind: float, display: Display | None) -> float:
    """How far the ground lies behind the panel's plane."""
    back = _placed(drop.points, placement)[:, 2]
    depth = behind - float(np.quantile(back, _BACK))
    # It can't lie before the panel, where no view sees all of it.
    return depth if display is None else max(depth, 0.0)


def _placed(points: Floats, placement: Placement) -> Float64:
    """Points [P, 3] of the world in the display frame."""
    out = placement.scale * (points @ placement.to_world) + placement.deep_shift
    out[:, 2] *= placement.depth
    return np.asarray(out, np.float64)


def _ground(drop: Backdrop, placement: Placement, depth: float,
            reach: tuple[float, float, float, float], strength: float, apart: float,
            blur: float = 0.0) -> Ground:
    """The part of a backdrop within ``reach`` (left, right, low, high), in its shadow."""
    picture: Array = drop.picture
    size = np.array(picture.shape[1::-1])
    texel = np.full(2, placement.scale / drop.pixels)
    # Texels that are a little finer than the blur, and their interpolation, are a part of it.
    apart = max(apart, _PART * blur)
    if apart > 1.25 * texel[0]:
        # Coarser rays would see single texels.
        texel, size = texel * size, np.maximum(np.rint(size * texel / apart), 2).astype(int)
        texel /= size
        picture = cv2.resize(picture, tuple(map(int, size)), interpolation=cv2.INTER_AREA)
    left = blur ** 2 - (texel.max() / 2) ** 2
    if left > 0:
        picture = cv2.GaussianBlur(picture, (0, 0), math.sqrt(left) / float(texel.max()),
                                   borderType=cv2.BORDER_REFLECT)
    west, east, low, high = reach
    # Its middle lies behind the eyes, as they are seen from the middle.
    x0 = placement.shift[0] - (size[0] - 1) / 2 * texel[0]
    y0 = placement.shift[1] + (size[1] - 1) / 2 * texel[1]
    first = np.floor(np.array([west - x0, y0 - high]) / texel).astype(int) - 1
    last = np.ceil(np.array([east - x0, y0 - low]) / texel).astype(int) + 2
    columns, rows = (np.arange(begin, end) for begin, end in zip(first, last, strict=True))
    x0, y0 = x0 + first[0] * texel[0], y0 - first[1] * texel[1]
    window = x0, y0, len(columns) * texel[0], len(rows) * texel[1]
    shade, cell = _shade(drop, placement, depth, window, strength)
    planes = np.empty((3, len(rows), len(columns)), np.float32)
    steps = texel / cell
    picture = np.ascontiguousarray(picture).view()
    # As those of files are; for others the kernel would be compiled once more.
    picture.flags.writeable = False
    shade_ground(picture, _folded(rows, picture.shape[0]),
                 _folded(columns, picture.shape[1]), shade,
                 (np.arange(len(rows)) * steps[1]).astype(np.float32),
                 (np.arange(len(columns)) * steps[0]).astype(np.float32), planes)
    across, down = texel.tolist()
    return Ground(planes, depth, float(x0), float(y0), (across, down), placement)


def _folded(places: Int64, size: int) -> Int64:
    """Texels of a picture of ``size`` whose mirror images lie side by side."""
    turned = places % (2 * size)
    return np.asarray(np.minimum(turned, 2 * size - 1 - turned), np.int64)


def _shade(drop: Backdrop, placement: Placement, depth: float,
           window: tuple[float, float, float, float], strength: float) -> tuple[Float32, float]:
    """What a head leaves of the light on the ground, float32 [a, b] in [0, 1]; its cells' width.

    The first cell lies at the window's corner.

    Parameters
    ----------
    window : Left, top, width and height of what is seen of the ground.
    strength : Share of the light that the middle of the shadow lacks.
    """
    left, top, width, height = window
    shape = int(height / _CELL) + 3, int(width / _CELL) + 3
    if strength == 0:
        return np.ones(shape, np.float32), _CELL
    points = _placed(drop.points, placement)
    away = points[:, 2] + depth
    foot = points[:, :2] - away[:, None] * (drop.light[:2] / drop.light[2])
    row, column = (np.rint((top - foot[:, 1]) / _CELL).astype(int),
                   np.rint((foot[:, 0] - left) / _CELL).astype(int))
    # A frame around it: what is beside the window has its soft edge within.
    edge = int(_PENUMBRA * max(float(np.mean(away)), 0.1) * 3 / _CELL)
    row, column = row + edge, column + edge
    framed = shape[0] + 2 * edge, shape[1] + 2 * edge
    inside = (row >= 0) & (row < framed[0]) & (column >= 0) & (column < framed[1])
    count = np.bincount(row[inside] * framed[1] + column[inside],
                        minlength=framed[0] * framed[1]).reshape(framed)
    covered = cv2.GaussianBlur((count > 0).astype(np.float32), (0, 0), _CLOSED / _CELL)
    soft = cv2.GaussianBlur(np.minimum(np.float32(3.0) * covered, np.float32(1.0)), (0, 0),
                            _PENUMBRA * max(float(np.mean(away)), 0.1) / _CELL)
    dark = soft[edge:edge + shape[0], edge:edge + shape[1]]
    return np.asarray(1.0 - strength * dark, np.float32), _CELL
