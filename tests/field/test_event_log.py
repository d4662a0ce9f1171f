"""TensorBoard's event files, read back by a parser of their published layout."""

import math
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lfportrait.errors import UserError
from lfportrait.field.training.event_log import EventLog, _checksum


def crc32c(data: bytes) -> int:
    """Bit by bit, by polynomial division (Castagnoli, reflected)."""
    crc = 0xFFFFFFFF
    for byte in data:
        for bit in range(8):
            out = (crc ^ (byte >> bit)) & 1
            crc = (crc >> 1) ^ (0x82F63B78 * out)
    return crc ^ 0xFFFFFFFF


def unmasked(stored: bytes) -> int:
    value = (int.from_bytes(stored, "little") - 0xA282EAD8) % 2**32
    return ((value << 15) | (value >> 17)) % 2**32


def records(path: Path) -> list[bytes]:
    data, found, at = path.read_bytes(), [], 0
    while at < len(data):
        length, = struct.unpack_from("<Q", data, at)
        assert unmasked(data[at + 8:at + 12]) == crc32c(data[at:at + 8])
        body = data[at + 12:at + 12 + length]
        assert len(body) == length
        assert unmasked(data[at + 12 + length:at + 16 + length]) == crc32c(body)
        found.append(body)
        at += 16 + length
    return found


def message(data: bytes) -> dict[int, object]:
    """Fields of a protocol buffer by their number."""
    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    fields: dict[int, object] = {}
    at = 0
    while at < len(data):
        key = varint()
        number, kind = key >> 3, key & 7
        assert number not in fields
        if kind == 0:
            value = varint()
            fields[number] = value - 2**64 if value >= 2**63 else value
        elif kind == 2:
            size = varint()
            fields[number] = data[at:at + size]
            assert len(fields[number]) == size
            at += size
        else:
            size, layout = {1: (8, "<d"), 5: (4, "<f")}[kind]
            fields[number], = struct.unpack_from(layout, data, at)
            at += size
    return fields


def scalars(path: Path) -> list[tuple[str, float, int]]:
    first, *others = [message(record) for record in records(path)]
    assert first[3] == b"brain.Event:2"
    assert all(abs(event[1] - time.time()) < 600 for event in [first, *others])
    points = []
    for event in others:
        assert set(event) == {1, 2, 5}
        value = message(message(event[5])[1])
        points.append((value[1].decode(), value[2], event[2]))
    return points


def test_the_checksum_is_the_published_one() -> None:
    assert crc32c(b"123456789") == 0xE3069283  # the polynomial's check value
    assert unmasked(_checksum(b"123456789")) == 0xE3069283
    assert unmasked(_checksum(bytes(32))) == 0x8A9136AA  # RFC 3720, B.4


def test_scalars_come_back(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "log")
    log.scalar("train/psnr", 31.25, 100)
    # On the disk while the log is still open.
    assert scalars(log.path) == [("train/psnr", 31.25, 100)]
    log.scalar("test/psnr", np.float32(0.1), np.int64(2**40))
    log.close()
    log.close()
    assert scalars(log.path) == [("train/psnr", 31.25, 100),
                                 ("test/psnr", float(np.float32(0.1)), 2**40)]
    assert log.path.parent == tmp_path / "log"
    assert "tfevents" in log.path.name


@settings(max_examples=50, deadline=None)
@given(points=st.lists(st.tuples(st.text(max_size=200), st.floats(), st.integers(-5, 2**62)),
                       max_size=6))
def test_any_scalars_come_back(tmp_path_factory: pytest.TempPathFactory, points: list) -> None:
    path = tmp_path_factory.mktemp("log") / "events.out.tfevents.x"
    with EventLog(path) as log:
        for point in points:
            log.scalar(*point)
    assert log.path == path
    with np.errstate(over="ignore"):
        expected = [(tag, float(np.float32(value)), step) for tag, value, step in points]
    for found, wanted in zip(scalars(path), expected, strict=True):
        assert found[::2] == wanted[::2]
        assert found[1] == wanted[1] or (math.isnan(found[1]) and math.isnan(wanted[1]))


def test_each_log_is_a_file_of_its_own(tmp_path: Path) -> None:
    paths = []
    for _ in range(3):
        with EventLog(tmp_path) as log:
            paths.append(log.path)
    assert len(set(paths)) == 3
    assert sorted(tmp_path.iterdir()) == sorted(paths) == paths


def test_a_log_that_can_not_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UserError, match="can't write the log"):
        EventLog(tmp_path / "file" / "log")
    with pytest.raises(UserError, match="can't write the log"):
        EventLog(tmp_path / "file")
