"""Gaussian splats: what they are, what they look like, and the frame in which a file holds them.

Programs that show PLY and SOG files take them for what Kerbl et al. 2023 write, whose captures have
+y down, and turn them upright. SuperSplat turns by 180 degrees about z and looks from +z. Turned
the same way beforehand, a head stands upright there and faces the camera. glTF says +y up and
metres, SPZ's description +y up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...arrays import Float32, Float64, Int32, Int64
from ...capture import Camera
from ...errors import UserError
from ...field import C0
from ..kernels import COLUMNS, TILE, composite, differentiate, fill_tiles, project, pull
from ..kinds import METRES, Up


@dataclass(frozen=True)
class Splats:
    """Gaussian splats.

    Attributes
    ----------
    positions
        float32 [N, 3], middles, in the world.
    scales
        float32 [N, 3], standard deviations along the splat's axes, world units, > 0.
    turns
        float32 [N, 4], unit quaternions (w, x, y, z): from the splat's axes to the world's.
    opacity
        float32 [N], at the middle, 0 to 1.
    sh
        float32 [N, 3, B], spherical harmonics (B = 1, 4 or 9, in the field's order); color =
        max(0, coefficients . basis + 0.5), sRGB, for the direction from the camera to the splat.
    """

    positions: Float32
    scales: Float32
    turns: Float32
    opacity: Float32
    sh: Float32

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def axes(self) -> Float32:
        """Directions of the splats' axes as columns, float32 [N, 3, 3]."""
        return axes_of(self.turns)

    @property
    def normals(self) -> Float32:
        """Direction of the thin axis, the third one, float32 [N, 3]."""
        return np.ascontiguousarray(self.axes[:, :, 2])

    @property
    def degree(self) -> int:
        """Degree of the spherical harmonics."""
        return {1: 0, 4: 1, 9: 2}[self.sh.shape[2]]

    def moved(self, similarity: NDArray[np.floating]) -> Splats:
        """Splats after a similarity, [4, 4], without reflection."""
        size = float(np.cbrt(np.linalg.det(similarity[:3, :3])))
        turn = similarity[:3, :3] / size
        # What the turned basis of a few directions must show says how coefficients turn.
        away = np.random.default_rng(0).standard_normal((64, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        count = self.sh.shape[2]
        mixed, *_ = np.linalg.lstsq(sh_bases(away @ turn.T, count), sh_bases(away, count),
                                    rcond=None)
        return replace(
            self, positions=(self.positions @ similarity[:3, :3].T + similarity[:3, 3]
                             ).astype(np.float32),
            scales=(self.scales * size).astype(np.float32),
            turns=quaternions_of((turn @ self.axes).astype(np.float32)),
            sh=(self.sh @ mixed.T).astype(np.float32))

    def colors(self, eye: Float64) -> Float32:
        """Colors from an eye [3] in the world, float32 [N, 3], not below 0."""
        return np.maximum(np.einsum("ncb,nb->nc", self.sh, self.bases(eye)) + np.float32(0.5), 0)

    def bases(self, eye: Float64) -> Float32:
        """The basis in the direction from an eye [3] to each splat, float32 [N, B]."""
        away = self.positions - eye
        return sh_bases(away / np.linalg.norm(away, axis=1, keepdims=True), self.sh.shape[2])


def sh_bases(directions: NDArray[np.floating], count: int) -> Float32:
    """Spherical harmonics of unit directions [K, 3], float32 [K, count], in the field's order."""
    out = np.full((len(directions), count), C0, np.float32)
    if count == 1:
        return out
    x, y, z = directions.T
    out[:, 1:4] = 0.4886025119029199 * np.stack([-y, z, -x], axis=1)
    if count == 9:
        out[:, 4:] = np.stack([
            1.0925484305920792 * x * y, -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * z * z - x * x - y * y),
            -1.0925484305920792 * x * z, 0.5462742152960396 * (x * x - y * y)], axis=1)
    return out


def axes_of(turns: Float32) -> Float32:
    """Rotation matrices of unit quaternions [N, 4] (w, x, y, z), float32 [N, 3, 3]."""
    w, x, y, z = turns.astype(np.float32).T
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    return np.ascontiguousarray(np.moveaxis(np.array(rows, np.float32), 2, 0))


def quaternions_of(axes: Float32) -> Float32:
    """Unit quaternions (w, x, y, z), w >= 0, of rotation matrices [N, 3, 3], float32 [N, 4]."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(axes.astype(np.float64)).as_quat().T
    out = np.stack([w, x, y, z], axis=1)
    return (out * np.where(w < 0, -1.0, 1.0)[:, None]).astype(np.float32)


@dataclass(frozen=True)
class Slopes:
    """Derivatives of a loss by the splats' numbers, each of the shape of what it is of.

    ``scales`` are derivatives by the logarithms; ``positions`` leave out what a move does to the
    splat's shape in the picture. ``weights``, float32 [N], are a splat's sums of weights over the
    pixels, 0 where it is hidden.
    """

    colors: Float32
    opacity: Float32
    scales: Float32
    positions: Float32
    weights: Float32


@dataclass(frozen=True)
class SplatView:
    """A picture of splats, and how it came about.

    Attributes
    ----------
    image
        float32 [H, W, 4], color times alpha (sRGB), and alpha.
    order
        int64 [M], splats in the picture, from front to back.
    """

    image: Float32
    order: Int64
    _splats: Splats
    _camera: Float64
    _colors: Float32
    _flat: Float32
    _starts: Int64
    _members: Int32

    def slopes(self, slope: Float32) -> Slopes:
        """Derivatives of a loss.

        Parameters
        ----------
        slope
            float32 [H, W, 4], derivative of the loss by ``image``.
        """
        through = np.concatenate([self.image[..., :3], 1 - self.image[..., 3:]], axis=2)
        by_through = np.concatenate([slope[..., :3], -slope[..., 3:]], axis=2).astype(np.float32)
        pairs = np.empty((len(self._members), 10), np.float32)
        differentiate(len(self._starts) - 1, self._flat, self._colors, self._starts, self._members,
                      through, by_through, pairs)
        splats = self._splats
        out = np.empty((len(splats), 11), np.float32)
        pull(pairs, self._members, self.order, splats.positions, splats.scales, splats.axes,
             self._camera, self._flat, out)
        return Slopes(out[:, :3], out[:, 3], out[:, 4:7], out[:, 7:10], out[:, 10])


def splat_view(splats: Splats, cameras: Camera, view: int = 0) -> SplatView:
    """Render splats as Kerbl et al. 2023 do, sorted by the depth along the optical axis.

    Parameters
    ----------
    splats
        The splats.
    cameras, view
        Batch of cameras and which of them.
    """
    width, height = int(cameras.width[view]), int(cameras.height[view])
    camera = cameras.row(view)
    flat = np.empty((len(splats), COLUMNS), np.float32)
    depth = np.empty(len(splats), np.float32)
    project(splats.positions, splats.scales, splats.axes, splats.opacity, camera, (width, height),
            flat, depth)
    order = np.argsort(depth, kind="stable")[:int(np.isfinite(depth).sum())]
    starts, members = fill_tiles(flat, order, (width, height))
    colors = splats.colors(cameras.pose[view, :3, 3])
    image = np.empty((height, width, 4), np.float32)
    composite(-(-width // TILE) * -(-height // TILE), flat, colors, starts, members, image)
    image[..., 3] = 1 - image[..., 3]
    return SplatView(image, order, splats, camera, colors, flat, starts, members)


def render_splats(splats: Splats, cameras: Camera, view: int = 0,
                  background: float = 1.0) -> Float32:
    """A picture of splats.

    Parameters
    ----------
    splats
        In the world of the cameras.
    cameras, view
        A batch of cameras and which of them.
    background
        Grey level in [0, 1] behind the splats.

    Returns
    -------
    picture
        float32 [H, W, 3], sRGB.
    """
    image = splat_view(splats, cameras, view).image
    return np.asarray(image[..., :3] + (1 - image[..., 3:]) * np.float32(background), np.float32)


DOWN = {".ply", ".sog"}
"""Endings of files that programs take to have +y down."""
_ACROSS = np.array([-1, -1, 1], np.float32)
_HARMONICS = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1], np.float32)
"""Signs of the harmonics that half a turn about z changes: those odd in x and y together."""


def framed(splats: Splats, suffix: str, up: Up = "auto") -> Splats:
    """Splats as a file is to hold them.

    Parameters
    ----------
    splats
        In the portrait frame (+y up, +z out of the face).
    suffix
        Of the file's name, such as ``.ply``.
    up
        ``"y-up"``; ``"y-down"``: half a turn about z; ``"auto"``: what is usual for such files.

    Raises
    ------
    UserError
        If a glTF is to have y down.
    """
    if is_down(suffix, up):
        return half_turned(splats)
    if suffix != ".glb":
        return splats
    return replace(splats, positions=splats.positions * np.float32(METRES),
                   scales=splats.scales * np.float32(METRES))


def is_down(suffix: str, up: Up = "auto") -> bool:
    """Whether such a file is to have +y down.

    Raises
    ------
    UserError
        If a glTF is to have it.
    """
    if suffix == ".glb" and up == "y-down":
        raise UserError("a .glb file has y up by its specification; leave --splats.up at auto")
    return suffix in DOWN if up == "auto" else up == "y-down"


def half_turned(splats: Splats) -> Splats:
    """Splats after half a turn about z, which turns itself back: nothing but signs change."""
    w, x, y, z = splats.turns.T
    return replace(splats, positions=splats.positions * _ACROSS,
                   turns=np.stack([-z, -y, x, w], axis=1),
                   sh=splats.sh * _HARMONICS[:splats.sh.shape[2]])
