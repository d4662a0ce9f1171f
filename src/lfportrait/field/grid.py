"""The sparse voxel radiance field: what it holds and how it is rendered.

Density and spherical-harmonic color live on the points of a lattice, of which only those near the
surface are kept; between them both are interpolated trilinearly (Plenoxels, Fridovich-Keil and Yu
et al. 2022). A ray's color is Eq. 1 of Shen et al. 2023.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arrays import Bool, Float32, Float64, Floats, Int32, Int64, UInt8
from ..capture import Camera
from ..device import gpu_adapter
from ..gpu import GpuProcess, attempted
from .background import SOLID, Backdrop, Background, cube_rays
from .kernels.bricks import Bricks, Places, Stretches, build_bricks, fill_stretches, place_stretches
from .kernels.march import lattice_of_world
from .kernels.render import CAPACITY, pixel_weights, render_kernel
from .kernels.texture import PROBES, REACH, add_texture
from .storage import load_field, read_back, save_field
from .texture import NO_TEXTURE, SurfaceTexture, TextureRows, texture_cells

_NO_COLORS = np.zeros((0, 3, 1), np.float32)


@dataclass(eq=False)
class Layouts:
    """The layouts of a lattice, each made when it is first asked for.

    Attributes
    ----------
    extent : `VoxelField.solid_extent`, once it is known.
    """

    extent: tuple[float, float, float] | None = None
    _bricks: Bricks | None = None
    _places: Places | None = None
    _cells: tuple[UInt8, Int32] | None = None

    def bricks(self, links: Int32, density: Float32, sh: Floats) -> Bricks:
        """The layout for casting, in the colors ``sh``, float [N, 3, B]."""
        if self._bricks is None:
            built = build_bricks(links, density, sh)
            self._bricks = replace(built, sh=_NO_COLORS)
            return built
        return replace(self._bricks, sh=sh)

    def stretches(self, links: Int32, density: Float32, sh: Floats) -> Stretches:
        """The layout for slices, in the colors ``sh``, float [N, 3, B]."""
        if self._places is None:
            self._places = place_stretches(links)
        return fill_stretches(self._places, links, density, sh)

    def cells(self, texture: SurfaceTexture, bricks: Bricks) -> Int32:
        """`texture_cells`; those of the last charts are kept."""
        if self._cells is None or self._cells[0] is not texture.charts:
            self._cells = texture.charts, texture_cells(texture, bricks)
        return self._cells[1]


TEXEL = 1.6
"""Width in pixels of the texture's detail in a view. A picture of the head that is filtered ideally
has detail of about this width (a Gaussian with sigma 0.5); what is finer flickers when it turns."""


@dataclass(frozen=True)
class Rendering:
    """One rendered view.

    Attributes
    ----------
    color : float32 [H, W, 3], sRGB in [0, 1] (a bright highlight may exceed 1), on the
        background.
    alpha : float32 [H, W], opacity in [0, 1].
    depth : float32 [H, W], distance along the optical axis in world units of the surface where
        the transmittance passes 0.5; infinite where the ray meets none.
    """

    color: Float32
    alpha: Float32
    depth: Float32

    def points(self, cameras: Camera, view: int) -> Float64:
        """World point of the surface under each pixel, float64 [H, W, 3], NaN without one."""
        return surface_points(cameras, view, self.depth)


def surface_points(cameras: Camera, view: int, depth: Float32) -> Float64:
    """World points [H, W, 3] at depths [H, W] along a view's optical axis; NaN where infinite."""
    height, width = depth.shape
    origins, directions = cameras.rays(view)
    forward = cameras.pose[view, :3, 2]
    along = depth.reshape(-1, 1) / (directions @ forward)[:, None]
    points = origins + np.where(np.isfinite(along), along, np.nan) * directions
    return points.reshape(height, width, 3)


_PIXELS = 1 << 15  # Pixels whose weights are found together.


@dataclass(frozen=True)
class SampleWeights:
    """A view as a sparse matrix: pixel = sum over lattice rows of weight * color."""

    # indptr, rows, weights: CSR: int64 [P + 1], int32 [K], float32 [K], for P = H W pixels in scan
    # order. The weights of a pixel add up to its opacity.
    indptr: Int64
    rows: Int32
    weights: Float32
    alpha: Float32  # float32 [P].


@dataclass(frozen=True)
class Cut:
    """A plane: what lies below it goes."""

    normal: Float64  # float64 [3], unit, upwards.
    height: float  # Its distance from the origin along the normal, world units.

    def above(self, points: Floats) -> Float64:
        """How far points [..., 3] lie above the plane, [...]."""
        return np.asarray(points @ self.normal - self.height, np.float64)


@dataclass
class VoxelField:
    """A sparse voxel radiance field in the portrait frame.

    Attributes
    ----------
    links : int32 [Z, Y, X], row of each lattice point, -1 where it is empty.
    density : float32 [N], opacity per world unit, >= 0.
    sh : float32 [N, 3, B], spherical-harmonic coefficients of red, green, blue (B = 1, 4 or 9,
        in svox2's order); color = max(0, coefficients . basis + 0.5).
    center, radius : float64 [3] (x, y, z): the cube; lattice point i lies at center + radius (2
        (i + 0.5) / resolution - 1).
    frame : float64 [4, 4], similarity from the source's frame to the portrait frame.
    background : Spheres behind the lattice that hold the room, or None.
    texture : Detail of the surface that the lattice is too coarse for, or None.
    backdrop : The painted ground that panels show behind the head, or None.
    cone : Degrees in all over which the head can be looked at; 0: no limit is known.
    hair, clothes : uint8 [N], how much of each row is hair or clothes (255: all of it), as what
        made the head knows; None where colors alone say it.
    """

    links: Int32
    density: Float32
    sh: Float32
    center: Float64 = field(default_factory=lambda: np.zeros(3))
    radius: Float64 = field(default_factory=lambda: np.ones(3))
    frame: Float64 = field(default_factory=lambda: np.eye(4))
    background: Background | None = None
    texture: SurfaceTexture | None = None
    backdrop: Backdrop | None = None
    cone: float = 0.0
    hair: UInt8 | None = None
    clothes: UInt8 | None = None
    _bricks: Bricks | None = field(default=None, init=False, repr=False, compare=False)
    _stretches: Stretches | None = field(default=None, init=False, repr=False, compare=False)
    _layouts: Layouts = field(default_factory=Layouts, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        count = len(self.density)
        if self.links.ndim != 3 or self.sh.shape[:2] != (count, 3) or (
                self.sh.shape[2] not in (1, 4, 9)):
            raise ValueError(f"a field needs links [Z, Y, X], density [N] and sh [N, 3, 1|4|9], "
                             f"not {self.links.shape}, {self.density.shape}, {self.sh.shape}")
        if self.texture is not None and len(self.texture.charts) != count:
            raise ValueError(f"a texture for {len(self.texture.charts)} rows does not fit a field "
                             f"of {count}")
        for name in ("hair", "clothes"):
            shares = getattr(self, name)
            if shares is not None and shares.shape != (count,):
                raise ValueError(f"{name} of {shares.shape} does not fit a field of {count} rows")

    @property
    def basis(self) -> int:
        """Spherical-harmonic coefficients a channel: 1, 4 or 9."""
        return int(self.sh.shape[2])

    @property
    def bounds(self) -> Float64:
        """float64 [2, 3]: the lowest and the highest corner of the cube in the world."""
        return np.stack([self.center - self.radius, self.center + self.radius])

    @property
    def spacing(self) -> Float64:
        """float64 [3], world units between lattice points along x, y and z."""
        return np.asarray(2.0 * self.radius / np.array(self.links.shape[::-1]), np.float64)

    @property
    def bricks(self) -> Bricks:
        """The layout for casting, built on first use."""
        if self._bricks is None:
            self._bricks = self._layouts.bricks(self.links, self.density, self.sh)
        return self._bricks

    @property
    def stretches(self) -> Stretches:
        """The layout for slices, built on first use."""
        if self._stretches is None:
            self._stretches = self._layouts.stretches(self.links, self.density, self.sh)
        return self._stretches

    def take_layouts(self, other: VoxelField) -> None:
        """Use what another field of the same links, densities and coefficients has laid out."""
        self.take_lattice(other)
        self._bricks, self._stretches = other._bricks, other._stretches

    def take_lattice(self, other: VoxelField) -> None:
        """Lay out together with a field of the same links and densities, cube and frame."""
        self._layouts = other._layouts

    @property
    def lattice(self) -> Float64:
        """float64 [9]: lattice points along x, y, z; scale and offset of lattice coordinates."""
        scale, offset = lattice_of_world(self.center, self.radius, self.bricks.shape)
        return np.concatenate([np.array(self.links.shape[::-1], np.float64), scale, offset])

    def texture_rows(self, footprint: float, whole: bool = False) -> TextureRows:
        """The texture as kernels take it, with detail down to ``footprint`` world units.

        ``whole``: of the nearest octave, which other renderers can look up exactly alike.
        """
        if self.texture is None:
            return NO_TEXTURE
        cells = self._layouts.cells(self.texture, self.bricks)
        return self.texture.rows(cells, self.lattice, footprint, whole)

    def lattice_points(self) -> Float64:
        """World positions of the rows, float64 [N, 3]."""
        # In three dimensions `numpy.nonzero` takes four times as long.
        there = np.flatnonzero(self.links >= 0)
        rows = self.links.ravel()[there]
        points = np.empty((len(self.density), 3))
        for k, place in enumerate(np.unravel_index(there, self.links.shape)[::-1]):
            size = float(self.links.shape[2 - k])
            points[rows, k] = self.center[k] + self.radius[k] * (2.0 * (place + 0.5) / size - 1.0)
        return points

    @property
    def solid_extent(self) -> tuple[float, float, float]:
        """How far the solid voxels reach from the vertical axis, and from where to where along it.

        Thin fog does not count: only what stops light within about a twentieth of the head.
        """
        if self._layouts.extent is None:
            solid = self.density > SOLID
            points = self.lattice_points()[solid] if solid.any() else self.bounds
            reach = float(np.quantile(np.hypot(points[:, 0], points[:, 2]), 0.999))
            low, high = (float(v) for v in np.quantile(points[:, 1], [0.001, 0.999]))
            self._layouts.extent = reach, low, high
        return self._layouts.extent

    def with_sh(self, sh: Floats) -> VoxelField:
        """The same densities with other coefficients [N, 3, B], and without the texture."""
        out = VoxelField(self.links, self.density, np.ascontiguousarray(sh, np.float32),
                         self.center, self.radius, self.frame, self.background, cone=self.cone,
                         hair=self.hair, clothes=self.clothes)
        out.take_lattice(self)
        return out

    def render(self, cameras: Camera, view: int = 0, *, background: float | Any = 1.0,
               step: float = 0.5, threshold: float = 1e-2, stop: float = 1e-3,
               anisotropic: bool = True, device: str = "cpu") -> Rendering:
        """Render one view.

        Parameters
        ----------
        cameras, view : Batch of cameras and which of them.
        background : Grey level or RGB behind the field; the field's own room, where it has one,
            hides it.
        step : Distance between samples in voxels.
        threshold : Densities up to this are skipped.
        stop : A ray ends when its transmittance falls below this.
        anisotropic : Filter the texture along the surface where that is turned away; False looks
            up one place a pixel, as coded pictures and the page do.
        device : Where to compute (`lfportrait.device.gpu_adapter`). A field that is rendered
            once or twice is done on the CPU before it is on a GPU.
        """
        width, height = int(cameras.width[view]), int(cameras.height[view])
        parts = attempted(gpu_adapter(device), lambda process: self._rendered_on(
            process, cameras, view, step, threshold, stop, anisotropic))
        if parts is not None:
            return self.finished(cameras, view, parts, background=background, painted=True)
        color = np.empty(3 * width * height, np.float32)
        alpha = np.empty(width * height, np.float32)
        depth = np.empty(width * height, np.float32)
        bricks = self.bricks
        render_kernel(bricks.width)(
            bricks.table, bricks.links, bricks.density, bricks.rows, self.lattice, bricks.basis,
            cameras.row(view), (width, height), step, threshold, stop, color, alpha, depth)
        cast = Rendering(color.reshape(height, width, 3), alpha.reshape(height, width),
                         depth.reshape(height, width))
        return self.finished(cameras, view, cast, background=background, anisotropic=anisotropic)

    def depth(self, cameras: Camera, view: int = 0) -> tuple[Float32, Float32]:
        """Opacity and depth [H, W] of one view as `render` gives them, in less time."""
        size = int(cameras.width[view]), int(cameras.height[view])
        alpha, depth = (np.empty(size[0] * size[1], np.float32) for _ in range(2))
        bricks = self.bricks
        render_kernel(0)(
            bricks.table, bricks.links, bricks.density, np.zeros(0, np.uint16), self.lattice, 0,
            cameras.row(view), size, 0.5, 1e-2, 1e-3, np.zeros(0, np.float32), alpha,
            depth)
        return alpha.reshape(size[::-1]), depth.reshape(size[::-1])

    def finished(self, cameras: Camera, view: int, cast: Rendering, *,
                 background: float | Any = 1.0, anisotropic: bool = True,
                 painted: bool = False) -> Rendering:
        """A view from what the lattice alone gives of it: with the texture, and a background.

        Parameters
        ----------
        cameras, view, background, anisotropic : As for `render`.
        cast : Color without a background, opacity and depth, in contiguous arrays; its color is
            changed in place.
        painted : It has its texture already.
        """
        image, opacity = cast.color, cast.alpha
        height, width = opacity.shape
        if self.texture is not None and not painted:
            footprint, covered = self.detail_of(cameras, view, anisotropic)
            add_texture(self.bricks.table, *self.texture_rows(footprint), covered, self.lattice,
                        cameras.row(view), (width, height), opacity.reshape(-1),
                        cast.depth.reshape(-1), image.reshape(-1))
        behind = np.asarray(background, np.float32)
        if self.background is not None:
            rays = cube_rays(cameras, view, self.center, self.radius)
            grey = float(behind.mean())
            behind = self.background.color(rays, grey).reshape(image.shape)
        if behind.any():
            image += (1.0 - opacity[..., None]) * behind
        return cast

    def detail_of(self, cameras: Camera, view: int, anisotropic: bool = True,
                  ) -> tuple[float, float]:
        """Width of the texture's detail that a view wants, and the length that one look-up covers.

        Both in world units; without ``anisotropic`` one look-up covers everything.
        """
        away = float(np.linalg.norm(cameras.pose[view, :3, 3] - self.center))
        footprint = TEXEL * away / float(cameras.focal[view].mean())
        if self.texture is None or not anisotropic:
            return footprint, math.inf
        return footprint, self.texture.width(footprint) / TEXEL

    def _rendered_on(self, process: GpuProcess, cameras: Camera, view: int, step: float,
                     threshold: float, stop: float, anisotropic: bool) -> Rendering:
        """A view without a background from a GPU, with the texture."""
        from .gpu import ViewJob, views_on_gpu

        footprint, covered = self.detail_of(cameras, view, anisotropic)
        size = int(cameras.width[view]), int(cameras.height[view])
        job = ViewJob(cameras.row(view)[None], size, self.lattice, 0, step, threshold, stop,
                      False, covered, PROBES, REACH)
        color, alpha, depth = views_on_gpu(process, self, job, footprint)
        return Rendering(color[0], alpha[0], depth[0])

    def sample_weights(self, cameras: Camera, view: int = 0, *, step: float = 0.5,
                       inside: Bool | None = None) -> SampleWeights:
        """The view as a sparse linear map of the lattice rows' colors.

        Parameters
        ----------
        cameras, view : Batch of cameras and which of them.
        step : Distance between samples in voxels.
        inside : Bool [H, W], pixels that are wanted; the others get no rows. None: all that show
            anything.

        Returns
        -------
        weights : Weights below 1e-3 are dropped and the rest of the pixel scaled to its opacity.
        """
        cameras = cameras[view]
        if inside is None:
            inside = self.render(cameras, 0, step=step).alpha > 4e-3
        wanted = np.flatnonzero(inside).astype(np.int64)
        counts = np.zeros(len(wanted), np.int64)
        bricks, density = self.bricks, np.append(self.density, np.float32(0.0))
        # Some pixels at a time: most of the room that each of them gets stays empty.
        room = min(len(wanted), _PIXELS)
        rows = np.empty((room, CAPACITY), np.int32)
        weights = np.empty((room, CAPACITY), np.float32)
        found: list[tuple[Int32, Float32]] = [(rows[:0, 0], weights[:0, 0])]
        for since in range(0, len(wanted), _PIXELS):
            part = slice(since, since + _PIXELS)
            size = len(counts[part])
            pixel_weights(bricks.table, bricks.links, density, self.lattice, cameras.row(0),
                          (int(cameras.width[0]), int(cameras.height[0])), wanted[part], step,
                          1e-3, rows[:size], weights[:size], counts[part])
            kept = np.arange(CAPACITY)[None] < counts[part][:, None]
            found.append((rows[:size][kept], weights[:size][kept]))
        lengths = np.zeros(inside.size, np.int64)
        lengths[wanted] = counts
        indptr = np.concatenate([[0], np.cumsum(lengths)])
        values = np.concatenate([one for _, one in found])
        opacity = np.zeros(inside.size, np.float32)
        sums = np.add.reduceat(values, indptr[wanted[counts > 0]]) if len(values) else values
        opacity[wanted[counts > 0]] = sums
        return SampleWeights(indptr, np.concatenate([one for one, _ in found]), values, opacity)

    def save(self, path: Any) -> None:
        """Write the field as an ``.npz`` that svox2 reads, too (`lfportrait.field.storage`)."""
        save_field(self, path)

    def as_read(self) -> VoxelField:
        """What `load` gives of the file that `save` writes, without the file."""
        return VoxelField(*read_back(self))

    @staticmethod
    def load(path: Any) -> VoxelField:
        """Read a field that lfportrait or svox2 wrote.

        Raises
        ------
        UserError : If the file is missing, damaged or not a field.
        """
        return VoxelField(*load_field(path))
