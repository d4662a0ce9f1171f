"""Gaussian splats: what they are, what they look like, and the files that hold them.

Programs that show PLY and SOG files take them for what Kerbl et al. 2023 write, whose captures have
+y down, and turn them upright. SuperSplat turns by 180 degrees about z and looks from +z. Turned
the same way beforehand, a head stands upright there and faces the camera. glTF says +y up and
metres, SPZ's description +y up.

PLY has the names that Kerbl et al. gave to its columns; SPZ, version 3 (Niantic), numbers in few
bits, one attribute after the other, deflated; SOG, version 2 (PlayCanvas), lossless WebP pictures
with a pixel for each splat, and a JSON; binary glTF the extension ``KHR_gaussian_splatting``.
"""

from __future__ import annotations

import gzip
import json
import struct
import zipfile
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, BinaryIO

import numpy as np

from ...arrays import Float32, Float64, Floats, Int32, Int64, UInt8
from ...capture import Camera
from ...color import linear_light
from ...errors import UserError
from ...field import C0, real_harmonics
from ...files import image_bytes
from ...version import __version__
from ..gltf import Glb
from ..kernels import COLUMNS, TILE, composite, differentiate, fill_tiles, project, pull
from ..kinds import METRES, Up


@dataclass(frozen=True)
class Splats:
    """Gaussian splats."""

    positions: Float32  # float32 [N, 3], middles, in the world.
    scales: Float32  # float32 [N, 3], standard deviations along the splat's axes, world units, > 0.
    # float32 [N, 4], unit quaternions (w, x, y, z): from the splat's axes to the world's.
    turns: Float32
    opacity: Float32  # float32 [N], at the middle, 0 to 1.
    # float32 [N, 3, B], spherical harmonics (B = 1, 4 or 9, in the field's order); color = max(0,
    # coefficients . basis + 0.5), sRGB, for the direction from the camera to the splat.
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

    def moved(self, similarity: Floats) -> Splats:
        """Splats after a similarity, [4, 4], without reflection."""
        size = float(np.cbrt(np.linalg.det(similarity[:3, :3])))
        turn = similarity[:3, :3] / size
        # What the turned basis of a few directions must show says how coefficients turn.
        away = np.random.default_rng(0).standard_normal((64, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        count = self.sh.shape[2]
        turned, here = (real_harmonics(one, count).astype(np.float32)
                        for one in (away @ turn.T, away))
        mixed, *_ = np.linalg.lstsq(turned, here, rcond=None)
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
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        return real_harmonics(away, self.sh.shape[2]).astype(np.float32)


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
    """A picture of splats, and how it came about."""

    image: Float32  # float32 [H, W, 4], color times alpha (sRGB), and alpha.
    order: Int64  # int64 [M], splats in the picture, from front to back.
    _splats: Splats
    _camera: Float64
    _colors: Float32
    _flat: Float32
    _starts: Int64
    _members: Int32

    def slopes(self, slope: Float32) -> Slopes:
        """Derivatives of a loss, by its derivative by ``image``, float32 [H, W, 4]."""
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
    """Render splats as Kerbl et al. 2023 do, sorted by the depth along the optical axis."""
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
    splats : In the world of the cameras.
    cameras, view : A batch of cameras and which of them.
    background : Grey level in [0, 1] behind the splats.

    Returns
    -------
    picture : float32 [H, W, 3], sRGB.
    """
    image = splat_view(splats, cameras, view).image
    return np.asarray(image[..., :3] + (1 - image[..., 3:]) * np.float32(background), np.float32)


DOWN = {".ply", ".sog"}  # Endings of files that programs take to have +y down.
_ACROSS = np.array([-1, -1, 1], np.float32)
_HARMONICS = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1], np.float32)
"""Signs of the harmonics that half a turn about z changes: those odd in x and y together."""


def framed(splats: Splats, suffix: str, up: Up = "auto") -> Splats:
    """Splats in the portrait frame (+y up, +z out of the face) as a file of a suffix holds them.

    ``"y-down"``: half a turn about z; ``"auto"``: what is usual for such files.
    """
    if is_down(suffix, up):
        return half_turned(splats)
    if suffix != ".glb":
        return splats
    return replace(splats, positions=splats.positions * np.float32(METRES),
                   scales=splats.scales * np.float32(METRES))


def is_down(suffix: str, up: Up = "auto") -> bool:
    """Whether such a file is to have +y down."""
    if suffix == ".glb" and up == "y-down":
        raise UserError("a .glb file has y up by its specification; leave --splats.up at auto")
    return suffix in DOWN if up == "auto" else up == "y-down"


def half_turned(splats: Splats) -> Splats:
    """Splats after half a turn about z, which turns itself back: nothing but signs change."""
    w, x, y, z = splats.turns.T
    return replace(splats, positions=splats.positions * _ACROSS,
                   turns=np.stack([-z, -y, x, w], axis=1),
                   sh=splats.sh * _HARMONICS[:splats.sh.shape[2]])


def logit(opacity: Float32) -> Float32:
    """The logit of opacities [N]; finite, as 0 and 1 are moved inwards a little."""
    value = np.clip(opacity.astype(np.float64), 1e-4, 1 - 1e-4)
    return np.log(value / (1 - value)).astype(np.float32)


def to_bytes(values: Floats) -> UInt8:
    """The nearest whole numbers from 0 to 255."""
    return np.asarray(np.clip(np.rint(values), 0, 255), np.uint8)


def smallest_three(turns: Float32) -> tuple[Int64, Float32]:
    """Quaternions [N, 4] without their largest component, which is positive and follows from these.

    int64 [N], which one that is, and float32 [N, 3], the others in order, within 1 / sqrt(2) of 0.
    """
    largest = np.abs(turns).argmax(axis=1)
    sign = np.sign(turns[np.arange(len(turns)), largest])
    places = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[largest]
    return largest, np.take_along_axis(turns, places, axis=1) * sign[:, None]


NAME = "KHR_gaussian_splatting"


def write_glb(stream: BinaryIO, splats: Splats) -> None:
    """Write splats; programs without the extension show them as colored points."""
    glb = Glb([NAME])
    color = linear_light(np.clip(C0 * splats.sh[:, :, 0] + 0.5, 0, 1))
    points = np.rint(255 * np.column_stack([color, splats.opacity])).astype(np.uint8)
    attributes = {"POSITION": glb.add(splats.positions, bounds=True),
                  "COLOR_0": glb.add(points, normalized=True),
                  f"{NAME}:ROTATION": glb.add(np.roll(splats.turns, -1, axis=1)),
                  f"{NAME}:SCALE": glb.add(splats.scales),
                  f"{NAME}:OPACITY": glb.add(splats.opacity)}
    for place in range(splats.sh.shape[2]):
        degree = int(np.sqrt(place))
        attributes[f"{NAME}:SH_DEGREE_{degree}_COEF_{place - degree ** 2}"] = glb.add(
            splats.sh[:, :, place])
    # Colors are mixed as sRGB, as the field's are.
    glb.scene["meshes"] = [{"primitives": [{
        "attributes": attributes, "mode": 0,
        "extensions": {NAME: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display",
                              "sortingMethod": "cameraDistance", "projection": "perspective"}}}]}]
    glb.write(stream)


def write_ply(stream: BinaryIO, splats: Splats) -> None:
    """Write splats; opacities as logits, scales as logarithms, quaternions as (w, x, y, z)."""
    # Channel by channel: all red coefficients, all green, all blue ones.
    rest = splats.sh[:, :, 1:].reshape(len(splats), -1)
    columns = np.concatenate([
        splats.positions, splats.normals, splats.sh[:, :, 0], rest, logit(splats.opacity)[:, None],
        np.log(splats.scales), splats.turns], axis=1)
    names = ["x", "y", "z", "nx", "ny", "nz", *(f"f_dc_{n}" for n in range(3)),
             *(f"f_rest_{n}" for n in range(rest.shape[1])), "opacity",
             *(f"scale_{n}" for n in range(3)), *(f"rot_{n}" for n in range(4))]
    header = ["ply", "format binary_little_endian 1.0", f"comment lfportrait {__version__}",
              f"element vertex {len(splats)}", *(f"property float {name}" for name in names),
              "end_header"]
    stream.write(("\n".join(header) + "\n").encode())
    stream.write(columns.astype("<f4").tobytes())



PALETTE = 4096  # Sets of coefficients above degree 0 that a file holds at most.
SAMPLE = 40_000  # Splats from which those sets are chosen.


def write_sog(stream: BinaryIO, splats: Splats) -> None:
    """Write splats, in an order in which neighbours in the world are neighbours in the pictures."""
    order = _along_a_curve(splats.positions)
    # Sizes in an archive matter more than those in memory: the curve makes them a third smaller.
    positions = splats.positions[order].astype(np.float64)
    logs = np.sign(positions) * np.log1p(np.abs(positions))
    low, high = logs.min(axis=0), logs.max(axis=0)
    fixed = np.rint((logs - low) / np.maximum(high - low, 1e-9) * 65535).astype(np.uint16)
    scales, scale_book = _indexed(np.log(splats.scales[order]))
    colors, color_book = _indexed(splats.sh[order, :, 0])
    # Of w, x, y, z; bytes 252 to 255 say which is left out.
    largest, others = smallest_three(splats.turns[order])
    turns = to_bytes((others / np.sqrt(2) + 0.5) * 255)
    pictures = {
        "means_l": (fixed & 255).astype(np.uint8), "means_u": (fixed >> 8).astype(np.uint8),
        "scales": scales, "quats": np.column_stack([turns, 252 + largest.astype(np.uint8)]),
        "sh0": np.column_stack([colors, to_bytes(255 * splats.opacity[order])])}
    meta: dict[str, Any] = {
        "version": 2, "asset": {"generator": f"lfportrait {__version__}"}, "count": len(splats),
        "antialias": False,
        "means": {"mins": low.tolist(), "maxs": high.tolist(),
                  "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": scale_book, "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": color_book, "files": ["sh0.webp"]}}
    shapes = {name: _picture(pixels) for name, pixels in pictures.items()}
    if splats.degree:
        meta["shN"], more = _palette(splats.sh[order, :, 1:], splats.degree)
        shapes.update(more)
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        # Members without a time: the same splats give the same file.
        archive.writestr(zipfile.ZipInfo("meta.json"), json.dumps(meta, separators=(",", ":")))
        for name, pixels in shapes.items():
            # Without loss; the colors of transparent pixels are kept, too.
            archive.writestr(zipfile.ZipInfo(f"{name}.webp"), image_bytes(
                pixels, "WEBP", lossless=True, exact=True, method=4, quality=80))


def _along_a_curve(positions: Float32) -> Int64:
    """An order along a Z-curve (Morton), int64 [N]."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    cells = ((positions - low) / max(float((high - low).max()), 1e-9) * 1023).astype(np.uint64)
    code = np.zeros(len(positions), np.uint64)
    for bit in range(10):
        for axis in range(3):
            code |= (cells[:, axis] >> np.uint64(bit) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(code, kind="stable")


def _indexed(values: Float32) -> tuple[UInt8, list[float]]:
    """Values [N, 3] as indices uint8 [N, 3] into 256 numbers, chosen by Lloyd's iteration."""
    flat = np.sort(values.reshape(-1).astype(np.float64))
    # Half of the numbers where values are many, half evenly: a few odd ones are kept, too.
    book = np.sort(np.concatenate([np.quantile(flat, np.linspace(0, 1, 128)),
                                   np.linspace(flat[0], flat[-1], 128)]))
    sums = np.concatenate([[0.0], np.cumsum(flat)])
    for _ in range(12):
        edges = np.searchsorted(flat, (book[1:] + book[:-1]) / 2)
        edges = np.concatenate([[0], edges, [len(flat)]])
        count = np.diff(edges)
        mean = np.diff(sums[edges]) / np.maximum(count, 1)
        book = np.where(count > 0, mean, book)
    book = np.sort(book)
    return (np.searchsorted((book[1:] + book[:-1]) / 2, values).astype(np.uint8),
            [float(number) for number in book.astype(np.float32)])


def _palette(rest: Float32, degree: int) -> tuple[dict[str, Any], dict[str, UInt8]]:
    """Coefficients [N, 3, K] as a palette (k-means) and an index for each splat."""
    from scipy.cluster.vq import kmeans2
    from scipy.spatial import cKDTree

    rows = rest.reshape(len(rest), -1).astype(np.float64)
    random = np.random.default_rng(0)
    sample = rows[random.permutation(len(rows))[:SAMPLE]]
    count = min(PALETTE, len(np.unique(sample, axis=0)))
    start = np.unique(sample, axis=0)[random.permutation(count)] if count < PALETTE else sample[
        :count]
    centers, _ = kmeans2(sample, start, iter=5, minit="matrix", missing="warn")
    labels = cKDTree(centers).query(rows)[1]
    indices, book = _indexed(centers.astype(np.float32))
    # A row of the picture holds 64 sets, each one pixel a coefficient.
    width = 64 * rest.shape[2]
    pixels = np.moveaxis(indices.reshape(count, 3, -1), 1, 2).reshape(-1, 3)
    picture = np.zeros((-(-len(pixels) // width) * width, 3), np.uint8)
    picture[:len(pixels)] = pixels
    label = np.column_stack([labels & 255, labels >> 8, np.zeros_like(labels)]).astype(np.uint8)
    meta = {"count": count, "bands": degree, "codebook": book,
            "files": ["shN_centroids.webp", "shN_labels.webp"]}
    return meta, {"shN_centroids": picture.reshape(-1, width, 3), "shN_labels": _picture(label)}


def _picture(pixels: UInt8) -> UInt8:
    """Rows of pixels [N, C] as a nearly square picture [H, W, C]; the last ones are repeated."""
    width = 4 * int(np.ceil(np.sqrt(len(pixels)) / 4))
    height = -(-len(pixels) // width)
    more = width * height - len(pixels)
    return np.concatenate([pixels, np.repeat(pixels[-1:], more, axis=0)]).reshape(height, width, -1)


COLOR = 0.15
"""Coefficients of degree 0 are multiplied by this, as colors beyond black and white occur."""
BITS = 18  # Binary places of positions, at most: 4 millionths of a world unit.
HALF_TURN = 511 * np.sqrt(2)
"""What a component of a quaternion is multiplied with: nine bits and a sign."""
STEPS = (2, 4)
"""Steps of the coefficients of degree 1, and of those above, in 128ths: finer than usual."""


def write_spz(stream: BinaryIO, splats: Splats) -> None:
    """Write splats."""
    reach = float(np.abs(splats.positions).max())
    bits = min(BITS, int(np.floor(np.log2((2 ** 23 - 1) / max(reach, 1e-9)))))
    if bits < 0:
        raise UserError("an .spz file can't hold coordinates beyond 8 million; leave --world at "
                        "portrait")
    fixed = np.rint(splats.positions.astype(np.float64) * 2.0 ** bits).astype("<i4")
    parts = [struct.pack("<4sIIBBBB", b"NGSP", 3, len(splats), splats.degree, bits, 0, 0),
             np.ascontiguousarray(fixed[:, :, None].view(np.uint8)[:, :, :3]).tobytes(),
             to_bytes(255 * splats.opacity).tobytes(),
             to_bytes(255 * (COLOR * splats.sh[:, :, 0] + 0.5)).tobytes(),
             to_bytes(16 * (np.log(splats.scales) + 10)).tobytes(),
             _turns(splats).tobytes()]
    if splats.degree:
        step = np.full(splats.sh.shape[2] - 1, STEPS[1])
        step[:3] = STEPS[0]
        # Coefficient by coefficient, red, green and blue side by side; 128 is nothing.
        rest = np.rint(np.moveaxis(splats.sh[:, :, 1:], 2, 1) * 128 / step[:, None])
        parts.append(to_bytes(rest * step[:, None] + 128).tobytes())
    with gzip.GzipFile(fileobj=stream, mode="wb", filename="", mtime=0) as packed:
        for part in parts:
            packed.write(part)


def _turns(splats: Splats) -> np.ndarray:
    """Quaternions as uint32: which component is left out (of x, y, z, w), then three others."""
    largest, others = smallest_three(np.roll(splats.turns, -1, axis=1))
    size = np.minimum(np.rint(np.abs(others) * HALF_TURN), 511).astype("<u4")
    word = largest.astype("<u4")
    for axis in range(3):
        word = word << 10 | (others[:, axis] < 0).astype("<u4") << 9 | size[:, axis]
    return word.astype("<u4")


SPLAT_WRITERS = {".ply": write_ply, ".glb": write_glb, ".spz": write_spz, ".sog": write_sog}
"""By the file's suffix: functions (stream, splats)."""
