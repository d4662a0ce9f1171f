"""Curves for TensorBoard, written without TensorBoard.

An event file is a chain of records (TFRecord): length as 8 bytes, the length's checksum, the data,
the data's checksum; checksums are CRC-32C, turned by 15 bits and moved by a constant. The data is a
protocol buffer: an ``Event`` with wall time (field 1), step (2) and either the file's version (3)
or a ``Summary`` (5) whose value has a tag (1) and a number (2).
"""

from __future__ import annotations

import struct
import time
from pathlib import Path
from types import TracebackType

import numpy as np

from ...errors import UserError

__all__ = ["EventLog"]


def _crc_table() -> tuple[int, ...]:
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)
        table.append(value)
    return tuple(table)


_TABLE = _crc_table()


def _checksum(data: bytes) -> bytes:
    """Masked CRC-32C."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc = (crc >> 8) ^ _TABLE[(crc ^ byte) & 0xFF]
    crc ^= 0xFFFFFFFF
    return struct.pack("<I", (((crc >> 15) | (crc << 17)) + 0xA282EAD8) & 0xFFFFFFFF)


def _varint(value: int) -> bytes:
    """An integer in groups of 7 bits, lowest first; a negative one as 64 bits."""
    value &= 0xFFFFFFFFFFFFFFFF
    groups = bytearray()
    while value > 0x7F:
        groups.append(value & 0x7F | 0x80)
        value >>= 7
    groups.append(value)
    return bytes(groups)


def _text(number: int, data: bytes) -> bytes:
    """A field of bytes: its number, type 2, the length, the bytes."""
    return _varint(number << 3 | 2) + _varint(len(data)) + data


class EventLog:
    """A file of scalars that TensorBoard shows as curves.

    Every record is on the disk when `scalar` returns, so that curves can be watched as they grow.

    Parameters
    ----------
    path
        Folder for the log, as in ``tensorboard --logdir FOLDER``, made if missing; each log is a
        new file in it. A path with ``tfevents`` in its name is the file itself.

    Raises
    ------
    UserError
        If the file can't be written.
    """

    def __init__(self, path: str | Path) -> None:
        path = Path(path)
        folder = path.parent if "tfevents" in path.name else path
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if folder is path:
                path = _new_file(folder)
            self.path = path
            self._stream = open(path, "wb", buffering=0)  # noqa: SIM115 - closed by `close`
        except OSError as error:
            raise UserError(f"can't write the log {path}: {error.strerror}") from error
        self._write(0, _text(3, b"brain.Event:2"))

    def scalar(self, tag: str, value: float, step: int) -> None:
        """Add a point to the curve ``tag``."""
        with np.errstate(over="ignore"):  # too large for single precision is infinite
            single = np.array(value, "<f4").tobytes()
        number = _text(1, tag.encode()) + bytes([2 << 3 | 5]) + single
        self._write(int(step), _text(5, _text(1, number)))

    def _write(self, step: int, what: bytes) -> None:
        data = struct.pack("<Bd", 1 << 3 | 1, time.time()) + b"\x10" + _varint(step) + what
        length = struct.pack("<Q", len(data))
        try:
            self._stream.write(length + _checksum(length) + data + _checksum(data))
        except OSError as error:
            raise UserError(f"can't write the log {self.path}: {error.strerror}; free some "
                            "space") from error

    def close(self) -> None:
        """Close the file; it may be done twice."""
        self._stream.close()

    def __enter__(self) -> EventLog:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()


def _new_file(folder: Path) -> Path:
    """A name that TensorBoard looks for and that is not taken; later ones sort behind."""
    number = 0
    start = int(time.time())
    while True:
        path = folder / f"events.out.tfevents.{start}.lfportrait.{number:03d}"
        if not path.exists():
            return path
        number += 1
