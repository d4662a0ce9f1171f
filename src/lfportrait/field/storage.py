"""The field's file: svox2's checkpoint with a few keys more.

svox2 keeps ``radius``, ``center``, ``links`` [X, Y, Z], ``density_data`` [N, 1], ``sh_data``
float16 [N, 3 B], ``basis_type`` (1 = spherical harmonics); ours has the links transposed to
[Z, Y, X] in memory and adds ``frame``, ``lfportrait_version`` and, where a field has them, the
arrays of its texture (``texture_...``, see `SurfaceTexture`), those of a painted ground
(``backdrop_...``, see `Backdrop`), ``cone`` and ``hair`` to the file. Other stages may add arrays
of their own (`save_field`, `read_arrays`); those that read a field alone leave them be.

An ``.npz`` is a zip archive of arrays. The tables of links are nearly empty and are deflated;
densities and colors hold few strings that come again, so that only runs and rare bytes are made use
of. A member of the archive is one stream: large arrays are put together from pieces that all cores
deflate and inflate; where each begins, and the sum over what it holds, stand in an extra field of
the archive's directory, which other readers (`numpy.load`, and so svox2) skip.
"""

import functools
import io
import struct
import zipfile
import zlib
from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..arrays import Array, Float32, Float64, Int32, UInt8
from ..cache import check_writable
from ..errors import UserError
from ..files import UNREADABLE_ARRAYS, array_header, atomic_write, read_member
from ..measure import usable_cores
from ..simd.threads import share_out, side_by_side
from ..version import __version__
from .background import Backdrop, Background
from .kernels.bricks import floats_of, halves
from .texture import SurfaceTexture


class FieldData(Protocol):
    """What a file keeps of a `VoxelField`; see there for shapes and units."""

    links: Int32
    density: Float32
    sh: Float32
    center: Float64
    radius: Float64
    frame: Float64
    background: Background | None
    texture: SurfaceTexture | None
    backdrop: Backdrop | None
    cone: float
    hair: UInt8 | None
    clothes: UInt8 | None


Loaded = tuple[Int32, Float32, Float32, Float64,
               Float64, Float64, Background | None, SurfaceTexture | None,
               Backdrop | None, float, UInt8 | None, UInt8 | None]
"""The same in that order, as `VoxelField` takes it."""

_DEFLATED = ("links", "background_links", "texture_texels", "texture_charts",
             "backdrop_picture", "hair", "clothes")
"""The arrays of a file that are worth compressing."""
_NOISY = ("density_data", "sh_data")  # Those in which no string comes again.

_NEEDED = ("links", "density_data", "sh_data")
_READ = (*_NEEDED, "data", "radius", "center", "frame", "basis_type", "basis_data",
         "background_links", "background_data", "cone", "hair", "clothes")
_TEXTURE = ("texture_texels", "texture_projections", "texture_charts", "texture_pixels")
_BACKDROP = ("backdrop_picture", "backdrop_pixels", "backdrop_light", "backdrop_points")


def check_field_path(path: Any) -> None:
    """Raise `UserError` if no field can be written there; for a check before hours of work."""
    if Path(path).suffix != ".npz":
        raise UserError(f"a field is written as .npz, not {Path(path).name}")
    check_writable(Path(path).parent)


def save_field(field: FieldData, path: Any, *, deflated: Collection[str] = (), **more: Any) -> None:
    """Write a field, and further arrays by name; coefficients become float16, as svox2's are.

    ``deflated`` are those that are worth compressing. Raises `UserError` if the file does not end
    in ``.npz`` or can't be written.
    """
    texture = field.texture
    values = () if texture is None else (texture.texels, texture.projections, texture.charts,
                                         np.float64(texture.pixels))
    drop = field.backdrop
    behind = () if drop is None else (drop.picture, np.float64(drop.pixels), drop.light,
                                      drop.points)
    more = {"frame": field.frame, "lfportrait_version": np.str_(__version__),
            **dict(zip(_TEXTURE, values)), **dict(zip(_BACKDROP, behind)),
            **({"cone": np.float64(field.cone)} if field.cone else {}),
            **{name: shares for name in ("hair", "clothes")
               if (shares := getattr(field, name)) is not None}, **more}
    _write(field, path, deflated, more)


def save_checkpoint(field: FieldData, path: Any) -> None:
    """Write a field with svox2's own keys alone, in the order in which svox2 writes them."""
    _write(field, path, (), {})


def _write(field: FieldData, path: Any, deflated: Collection[str], more: dict[str, Any]) -> None:
    check_field_path(path)
    behind: dict[str, Any] = {}
    if field.background is not None:
        behind = {"background_links": field.background.links,
                  "background_data": field.background.data.astype(np.float32)}
    with atomic_write(path) as stream, zipfile.ZipFile(
            stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        _write_arrays(archive, {
            "radius": field.radius.astype(np.float32), "center": field.center.astype(np.float32),
            # svox2's kernels take the table in C order alone.
            "links": _turned(field.links),
            "density_data": field.density[:, None].astype(np.float32),
            "sh_data": halves(field.sh.reshape(len(field.sh), -1)),
            **behind, "basis_type": np.int64(1), **more}, (*_DEFLATED, *_NOISY, *deflated))


def read_back(field: FieldData) -> Loaded:
    """What `load_field` gives of the file that `save_field` writes."""
    behind, texture, drop = field.background, field.texture, field.backdrop
    if behind is not None:
        behind = Background(np.maximum(np.ascontiguousarray(behind.links, np.int32), -1),
                            np.ascontiguousarray(behind.data, np.float32))
    if texture is not None:
        texture = replace(texture, projections=texture.projections.astype(np.float64))
    if drop is not None:
        drop = replace(drop, light=drop.light.astype(np.float64),
                       points=drop.points.astype(np.float32))
    links = np.ascontiguousarray(field.links, np.int32)
    if links.min(initial=-1) < -1:
        links = np.maximum(links, -1)
    return (links,
            np.ascontiguousarray(field.density, np.float32), floats_of(halves(field.sh)),
            field.center.astype(np.float32).astype(np.float64),
            field.radius.astype(np.float32).astype(np.float64),
            field.frame.astype(np.float64), behind, texture, drop, float(field.cone), field.hair,
            field.clothes)


def _write_arrays(archive: zipfile.ZipFile, arrays: dict[str, Any],
                  deflated: Collection[str]) -> None:
    """What `numpy.savez` writes, dates included (the same bytes each time), some of it deflated."""
    for name, array in arrays.items():
        if name in deflated:
            write_array(archive, name, np.asanyarray(array), noisy=name in _NOISY)
            continue
        with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as target:
            np.lib.format.write_array(target, np.asanyarray(array), allow_pickle=False)


def read_arrays(path: Any, names: Collection[str]) -> dict[str, Array]:
    """Read the named arrays that a field's file has; others are not read.

    Raises `UserError` if the file is missing or damaged.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as data:
            wanted = [name for name in data.files if name in names]
        with ThreadPoolExecutor(usable_cores()) as threads:  # inflating lets go of the lock
            return dict(zip(wanted, threads.map(functools.partial(read_array, path), wanted),
                            strict=True))
    except FileNotFoundError as error:
        raise UserError(f"no such field file: {path}") from error
    except UNREADABLE_ARRAYS as error:
        raise UserError(f"{path} is not a field (.npz written by lfportrait or svox2), or it is "
                        f"damaged: {error}") from error


def load_field(path: Any) -> Loaded:
    """Read a field: what `VoxelField` is made of, in its order.

    Raises `UserError` if the file is missing, damaged, or not a field.
    """
    path = Path(path)
    arrays = read_arrays(path, (*_READ, *_TEXTURE, *_BACKDROP))
    if "data" in arrays and "density_data" not in arrays:  # svox2's old form
        arrays["density_data"], arrays["sh_data"] = arrays["data"][:, :1], arrays["data"][:, 1:]
    missing = [name for name in _NEEDED if name not in arrays]
    if missing:
        raise UserError(f"{path} is not a field: it has no {', '.join(missing)}")
    # As in svox2, older files without a cube have the unit cube.
    arrays.setdefault("radius", np.ones(3))
    arrays.setdefault("center", np.zeros(3))
    if any(arrays[name].dtype.kind not in "fiu" for name in (*_NEEDED, "radius", "center")):
        raise UserError(f"{path} is not a field: it holds text where numbers should be")
    # Learned bases: the earliest files have them without saying so.
    basis = np.asarray(arrays.get("basis_type", 4 if "basis_data" in arrays else 1))
    if basis.size != 1 or basis.dtype.kind not in "iuf" or basis.item() != 1:
        raise UserError(f"{path} uses a color basis other than spherical harmonics, which "
                        "lfportrait does not read")
    links, density, sh = arrays["links"], arrays["density_data"].reshape(-1), arrays["sh_data"]
    if links.ndim != 3 or sh.ndim != 2 or len(sh) != len(density) or sh.shape[1] not in (3, 12, 27):
        raise UserError(f"{path} is not a field: links {links.shape}, density {density.shape} and "
                        f"color {sh.shape} do not fit together")
    if links.max(initial=-1) >= len(density):
        raise UserError(f"{path} is damaged: its links point beyond its {len(density)} voxels")
    # Half floats are slow to look at.
    sh = floats_of(sh) if sh.dtype == np.float16 else sh.astype(np.float32)
    if not (np.isfinite(density).all() and np.isfinite(sh).all()):
        raise UserError(f"{path} is damaged: it holds values that are not finite")
    center, radius = arrays["center"], arrays["radius"]
    frame = arrays.get("frame", np.eye(4))
    if center.size not in (1, 3) or radius.size not in (1, 3) or frame.shape != (4, 4) or not (
            np.isfinite(center).all() and np.isfinite(radius).all() and (radius > 0).all()):
        raise UserError(f"{path} is damaged: its cube or its frame is invalid")
    turned = _turned(links.astype(np.int32, copy=False))
    return (np.maximum(turned, -1, out=turned), np.ascontiguousarray(density, np.float32),
            sh.reshape(len(sh), 3, -1),
            np.broadcast_to(center.ravel(), (3,)).astype(np.float64),
            np.broadcast_to(radius.ravel(), (3,)).astype(np.float64),
            frame.astype(np.float64), _background(arrays, path),
            _texture(arrays, len(density), path), _backdrop(arrays, path), _cone(arrays, path),
            _shares(arrays, "hair", len(density), path),
            _shares(arrays, "clothes", len(density), path))


def _cone(arrays: dict[str, Array], path: Path) -> float:
    """Degrees over which the head can be looked at; 0 where the file says nothing of it."""
    cone = arrays.get("cone", np.zeros(()))
    if cone.size != 1 or cone.dtype.kind not in "fiu" or not 0 <= cone.item() <= 360:
        raise UserError(f"{path} is damaged: its cone is invalid")
    return float(cone.item())


def _shares(arrays: dict[str, Array], name: str, rows: int, path: Path) -> UInt8 | None:
    """How much of each row is hair or clothes, if the file says so."""
    shares = arrays.get(name)
    if shares is not None and (shares.shape != (rows,) or shares.dtype != np.uint8):
        raise UserError(f"{path} is damaged: its {name} is invalid")
    return shares


def _turned(links: Int32) -> Int32:
    """Links [Z, Y, X] as [X, Y, Z] and back, in C order.

    Plane by plane, so that both fit into the cache: half the time of one copy of it all.
    """
    out = np.empty(links.shape[::-1], links.dtype)

    def turn(first: int, last: int) -> None:
        for y in range(first, last):
            out[:, y] = links[:, y].T

    share_out(turn, links.shape[1])  # copies let go of Python's lock
    return out


def _texture(arrays: dict[str, Array], rows: int, path: Path) -> SurfaceTexture | None:
    """The surface's texture, if the file has one."""
    if not any(name in arrays for name in _TEXTURE):
        return None
    try:
        texels, projections, charts, pixels = (arrays[name] for name in _TEXTURE)
        texture = SurfaceTexture(np.ascontiguousarray(texels), projections.astype(np.float64),
                                 np.ascontiguousarray(charts), float(pixels))
        if len(charts) != rows:
            raise ValueError("it belongs to another field")
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(f"{path} is damaged: its texture is invalid ({error})") from error
    return texture


def _backdrop(arrays: dict[str, Array], path: Path) -> Backdrop | None:
    """The painted ground, if the file has one."""
    if not any(name in arrays for name in _BACKDROP):
        return None
    try:
        picture, pixels, light, points = (arrays[name] for name in _BACKDROP)
        return Backdrop(np.ascontiguousarray(picture), float(pixels), light.astype(np.float64),
                        points.astype(np.float32))
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(f"{path} is damaged: its backdrop is invalid ({error})") from error


def _background(arrays: dict[str, Array], path: Path) -> Background | None:
    """svox2's spheres behind the lattice, if there are any: links [2 R, R], data [N, layers, 4]."""
    if "background_data" not in arrays or "background_links" not in arrays:
        return None
    links, data = arrays["background_links"], arrays["background_data"]
    if data.size == 0:
        return None
    if (links.ndim != 2 or links.shape[0] != 2 * links.shape[1] or data.ndim != 3
            or data.shape[1] < 2 or data.shape[2] != 4 or links.max(initial=-1) >= len(data)
            or not np.isfinite(data).all()):
        raise UserError(f"{path} is damaged: its background is invalid")
    return Background(np.maximum(np.ascontiguousarray(links, np.int32), -1),
                      np.ascontiguousarray(data, np.float32))


_PIECE = 1 << 20  # Bytes that are deflated together: as many on any machine, for the same file.
_FIELD = 0x666C  # The kind of our extra field.
_MOST = 0xFFFF  # Bytes that an extra field may have.
_HEADER = 30  # Bytes of a member's header without its name and its extra fields.


class _Piece(NamedTuple):
    """A part of a stream: its bytes in the file, those that it holds, and their sum (CRC-32)."""

    deflated: int
    whole: int
    check: int


def write_array(archive: zipfile.ZipFile, name: str, array: Array, *, noisy: bool = False) -> None:
    """Write a deflated array as `numpy.savez_compressed` does, on all cores.

    The archive is of ``ZIP_DEFLATED``. In a ``noisy`` array no string comes again: runs and rare
    bytes alone are made use of, in less time.
    """
    deflater = _Deflater(noisy)
    file = f"{name}.npy"
    # A mere name bears the date 1980-01-01: the same bytes each time.
    with archive.open(file, "w", force_zip64=True) as target:
        if hasattr(target, "_compressor"):
            setattr(target, "_compressor", deflater)  # noqa: B010
        np.lib.format.write_array(target, array, allow_pickle=False)
    table = b"".join(struct.pack("<III", *piece) for piece in deflater.pieces)
    if table and len(table) + 4 <= _MOST:
        archive.getinfo(file).extra = struct.pack("<HH", _FIELD, len(table)) + table


class _Deflater:
    """Deflates like zlib's own object, on all cores: pieces of a fixed size, each by itself."""

    def __init__(self, noisy: bool) -> None:
        self._strategy = zlib.Z_RLE if noisy else zlib.Z_DEFAULT_STRATEGY
        self.pieces: list[_Piece] = []

    def compress(self, data: Any) -> bytes:
        """Whole bytes of the stream for some data."""
        rest = memoryview(data).cast("B")
        parts = [rest[start:start + _PIECE] for start in range(0, len(rest), _PIECE)]
        made = side_by_side(self._deflated, parts)
        self.pieces += [piece for _, piece in made]
        return b"".join(stream for stream, _ in made)

    @staticmethod
    def flush() -> bytes:
        """The stream's end: an empty last block."""
        return b"\x03\x00"

    def _deflated(self, part: memoryview) -> tuple[bytes, _Piece]:
        packer = zlib.compressobj(1, zlib.DEFLATED, -zlib.MAX_WBITS, strategy=self._strategy)
        stream = packer.compress(part) + packer.flush(zlib.Z_SYNC_FLUSH)
        return stream, _Piece(len(stream), len(part), zlib.crc32(part))


def read_array(path: Path, name: str) -> Array:
    """One array of a file, inflated on all cores if it was written so.

    Raises `UNREADABLE_ARRAYS` if it is damaged (`lfportrait.files`).
    """
    # Threads that share one open archive read each other's bytes.
    with open(path, "rb") as stream, zipfile.ZipFile(stream) as archive:
        member = archive.getinfo(f"{name}.npy")
        pieces = _pieces(member)
        if pieces:
            stream.seek(member.header_offset)
            lengths = struct.unpack("<HH", stream.read(_HEADER)[-4:])
            stream.seek(member.header_offset + _HEADER + sum(lengths))
            return _array(_joined(stream.read(member.compress_size), pieces))
        return read_member(archive, member)


def _pieces(member: zipfile.ZipInfo) -> list[_Piece]:
    """The pieces of a member that was written so."""
    rest = member.extra
    while len(rest) >= 4:
        kind, size = struct.unpack("<HH", rest[:4])
        if kind == _FIELD:
            return [_Piece(*piece) for piece in struct.iter_unpack("<III", rest[4:4 + size])]
        rest = rest[4 + size:]
    return []


def _joined(data: bytes, pieces: list[_Piece]) -> UInt8:
    """What a stream holds."""
    ends = np.cumsum([[0, 0], *(piece[:2] for piece in pieces)], axis=0)
    out = np.empty(ends[-1, 1], np.uint8)
    whole = memoryview(data)

    def inflate(number: int) -> None:
        (since, first), (until, last) = ends[number:number + 2].tolist()
        part = zlib.decompressobj(-zlib.MAX_WBITS).decompress(whole[since:until], last - first)
        if len(part) != last - first or zlib.crc32(part) != pieces[number].check:
            raise ValueError("an array is damaged")
        out[first:last] = np.frombuffer(part, np.uint8)

    side_by_side(inflate, range(len(pieces)))
    return out


def _array(data: UInt8) -> Array:
    """The array of an ``.npy`` file."""
    head = io.BytesIO(data[:_PIECE].tobytes())
    shape, order, dtype = array_header(head)
    return np.ndarray(shape, dtype, data[head.tell():], order=order)
