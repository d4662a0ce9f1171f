"""Arrays of an ``.npz``, deflated and inflated by all cores.

An archive's member is one stream. Here it is put together from pieces that are deflated apart from
each other; where each begins, and the sum over what it holds, stand in an extra field of the
archive's directory. Other readers (`numpy.load`, and so svox2) skip that field and read the stream.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import UInt8
from ..simd.threads import side_by_side

__all__ = ["read_array", "write_array"]

_PIECE = 1 << 20
"""Bytes that are deflated together: as many on any machine, for the same file."""
_FIELD = 0x666C
"""The kind of our extra field."""
_MOST = 0xFFFF
"""Bytes that an extra field may have."""
_HEADER = 30
"""Bytes of a member's header without its name and its extra fields."""


class _Piece(NamedTuple):
    """A part of a stream: its bytes in the file, those that it holds, and their sum (CRC-32)."""

    deflated: int
    whole: int
    check: int


def write_array(archive: zipfile.ZipFile, name: str, array: NDArray[Any], *,
                noisy: bool = False) -> None:
    """Write a deflated array as `numpy.savez_compressed` does, on all cores.

    Parameters
    ----------
    archive
        Made with ``ZIP_DEFLATED``.
    name, array
        Of the array.
    noisy
        No string in it comes again: runs and rare bytes alone are made use of, in less time.
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


def read_array(path: Path, name: str) -> NDArray[Any]:
    """One array of a file, inflated on all cores if it was written so.

    Raises
    ------
    UNREADABLE_ARRAYS
        If it is damaged (`lfportrait.files`).
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
    with np.load(path, allow_pickle=False) as data:
        return np.asarray(data[name])


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


def _array(data: UInt8) -> NDArray[Any]:
    """The array of an ``.npy`` file."""
    head = io.BytesIO(data[:_PIECE].tobytes())
    version = np.lib.format.read_magic(head)
    if version != (1, 0):
        raise ValueError(f"an array has the unknown version {version}")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(head)
    if dtype.hasobject:
        raise ValueError("an array holds objects")
    return np.ndarray(shape, dtype, data[head.tell():], order="F" if fortran else "C")
