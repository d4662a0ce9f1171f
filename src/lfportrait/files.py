"""Files: written so that a half-written one never appears under its final name; read; compared.

Whether a file is the same as before is known without reading it (`file_state`). The size and the
time of the last change are not enough for that: many programs set that time back (``cp -p``, rsync,
editors of photos). The system also notes when it last changed anything of a file, and that nobody
can set.
"""

from __future__ import annotations

import base64
import contextlib
import errno
import io
import json
import mmap
import os
import re
import stat
import struct
import sys
import tempfile
import threading
import time
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, BinaryIO, Literal

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from .arrays import Array, Floats, UInt8
from .color import to_uint8
from .errors import UserError
from .png import write_png
from .temporary import moved_name, part_folder, part_name, remove_part, sweep_once, temporary_place

if TYPE_CHECKING:
    from filelock import BaseFileLock

UNREADABLE_ARRAYS = (
    OSError, EOFError, KeyError, TypeError, ValueError, AttributeError, IndexError, SyntaxError,
    OverflowError, MemoryError, RuntimeError, struct.error, tokenize.TokenError,
    zipfile.BadZipFile, zlib.error)
"""What NumPy and the modules below it raise for damaged ``.npy`` and ``.npz`` files."""
_ARRAY = re.compile(r"\{'descr': '([^']+)', 'fortran_order': (True|False), "
                    r"'shape': \(([0-9, ]*)\), \} *\n?")
"""The head of an array, as NumPy writes it."""

_PIECE = 1 << 20  # Bytes of an array that are read at a time.
_ALIGNED = 64  # Alignment of mapped numbers in bytes.
_HEADER, _ZIP64 = 30, 20
"""Bytes of a member's header without its name, and of the field with 64-bit sizes."""
_PADDING = 0xD935  # The kind of a field that only takes room.
_SHEET, _HEAD = b"lfportrait sheet", 1024
"""Mark of pictures that look at photos, and within how many bytes of their files it stands."""
_UMASK_LOCK = threading.Lock()
DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{number}" for port in ("com", "lpt")
                                         for number in range(1, 10))}
"""Names that mean devices on Windows, with any ending."""


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside ``path`` that is renamed to it if the block succeeds.

    The temporary name keeps the suffix, so that writers which look at it choose the right format.
    """
    path = Path(path)
    sweep_once(path.parent)
    temporary = part_name(path)
    try:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600))
        except OSError as error:
            raise UserError(f"can't write {path}: {error.strerror}; choose another output with "
                            "--out") from error
        yield temporary
        with contextlib.suppress(OSError):  # memory cards and network drives know no permissions
            os.chmod(temporary, 0o666 & ~_umask())
        try:
            os.replace(temporary, path)
        except OSError:  # some file systems refuse to rename over an older file
            if not path.is_file():
                raise
            _rename_in_place(temporary, path)
    except OSError as error:
        raise UserError(f"can't write {path}: {error.strerror or error}; free some space or choose "
                        "another output with --out") from error
    finally:
        remove_part(temporary)


@contextlib.contextmanager
def fresh_folder(path: Path) -> Iterator[Path]:
    """Yield a new, empty folder beside ``path`` that takes its place if the block succeeds.

    At no time is there a folder with half of its files; an older one is moved away in one step.
    Raises `OSError` if it can't be made or moved.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with part_folder(path) as temporary:
        yield temporary
        with contextlib.suppress(OSError):  # some file systems know no permissions
            temporary.chmod(0o777 & ~_umask())
        if path.exists():
            _rename_in_place(temporary, path)
        else:
            temporary.rename(path)


def _umask() -> int:
    """What new files may not be: it can be read only by changing it, for the whole process."""
    with _UMASK_LOCK:  # else a thread could take another one's 0 for it, and set that for good
        umask = os.umask(0)
        os.umask(umask)
    return umask


def _rename_in_place(temporary: Path, path: Path) -> None:
    """Move an older file or folder away, rename, and remove the older one; or put it back."""
    old = moved_name(temporary)
    path.rename(old)
    try:
        temporary.rename(path)
    except OSError:
        old.rename(path)
        raise
    remove_part(old)


@contextlib.contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open ``path`` for binary writing; it appears only when the block has succeeded."""
    with atomic_path(path) as temporary, open(temporary, "wb") as stream:
        yield stream


def write_bytes(path: str | os.PathLike[str], contents: bytes | memoryview) -> None:
    """Write a file's contents; it appears when it is complete."""
    with atomic_write(path) as stream:
        stream.write(contents)


def lock(path: Path, wait: float = 0.0) -> BaseFileLock:
    """Lock a file, made if missing, until ``release()`` is called or the process ends.

    Another process that has it is waited for, ``wait`` seconds; below 0 as long as it takes.
    Network drives that know no locks leave it unlocked. Raises `filelock.Timeout` if another
    process still has it, `OSError` if the file can't be written.
    """
    from filelock import FileLock

    found = FileLock(path, timeout=wait, thread_local=False, fallback_to_soft=False)
    try:
        found.acquire(poll_interval=0.01)
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.EINVAL, errno.ENOSYS):
            raise
    return found


def temporary_home() -> Path:
    """A private temporary folder of this user, for files without a home folder.

    Its name is the same each time; where somebody else made a folder of that name, a new one is
    made, as what lies in it is run.
    """
    user = getattr(os, "getuid", lambda: 0)()
    place = temporary_place() / f"lfportrait-{user}"
    with contextlib.suppress(OSError):
        place.mkdir(mode=0o700, exist_ok=True)
        state = place.lstat()
        own = not hasattr(os, "getuid") or (state.st_uid == user and not state.st_mode & 0o022)
        if stat.S_ISDIR(state.st_mode) and own and os.access(place, os.W_OK):
            return place
    try:
        return Path(tempfile.mkdtemp(prefix="lfportrait-"))
    except OSError as error:
        raise UserError(f"can't write to the temporary folder (TMPDIR): {error.strerror}; set "
                        "TMPDIR to a folder with more room") from error


def write_json(path: str | os.PathLike[str], data: Any) -> None:
    """Write ``data`` as indented JSON, NumPy scalars and arrays included."""
    write_bytes(path, (json.dumps(plain_json(data), indent=1) + "\n").encode())


def plain_json(value: Any) -> Any:
    """Dictionaries and lists as JSON takes them: paths as text, no arrays of NumPy."""
    if isinstance(value, dict):
        return {str(key): plain_json(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(one) for one in value]
    if isinstance(value, Path):
        return str(value)
    # Scalars of torch, too, which is not imported for that.
    return value.tolist() if hasattr(value, "tolist") else value


def script_json(data: Any) -> str:
    """JSON that can stand in a script element: no ``</script>`` ends it early."""
    return json.dumps(data, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")


def script_streams(streams: dict[str, bytes]) -> str:
    """Script elements that hold bytes in base64, by name."""
    return "\n".join(f'<script type="application/octet-stream" data-stream="{name}">'
                     f"{base64.b64encode(data).decode()}</script>"
                     for name, data in streams.items())


def read_json(path: str | os.PathLike[str]) -> Any:
    """Read a JSON file; `UserError` if the file is missing or not JSON."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise UserError(f"can't read {path}: {error.strerror}") from error
    except ValueError as error:
        raise UserError(f"{path} is not valid JSON: {error}") from error
    except RecursionError as error:
        raise UserError(f"{path} can't be read: its lists lie too deep in each other") from error


def picture_format(path: str | os.PathLike[str]) -> str:
    """Pillow's name for a file's format, by its ending: to be asked before hours of work."""
    suffix = Path(path).suffix.lower()
    formats = Image.registered_extensions()
    if suffix not in formats:
        raise UserError(f"can't write {path}: unknown picture format {suffix!r}; use .png or .jpg")
    return formats[suffix]


def write_image(path: str | os.PathLike[str], image: Array, *, fast: bool = False,
                sheet: bool = False, **options: Any) -> None:
    """Write a picture whose format follows from the suffix.

    Parameters
    ----------
    path : ``.png``, ``.jpg`` or any format Pillow writes.
    image : uint8, or float in [0, 1] (rounded): [H, W], [H, W, 3] or [H, W, 4].
    fast : A PNG is written by `write_png`: for pictures that are large and hard to compress.
    sheet : It looks at photos: a PNG or JPEG gets a mark, by which `own_output` knows that it is
        none.
    options : Passed on to Pillow's ``save`` (``compress_level``, ``quality``, ...).
    """
    array = to_uint8(np.asarray(image))
    kind = picture_format(path)
    buffer = io.BytesIO()
    if kind == "PNG" and fast:
        write_png(buffer, array)
    else:
        if kind == "PNG":
            options.setdefault("compress_level", 2)
        if sheet and kind == "PNG":
            options["pnginfo"] = PngInfo()
            options["pnginfo"].add_text("Software", _SHEET.decode())
        elif sheet and kind == "JPEG":
            options["comment"] = _SHEET
        Image.fromarray(array).save(buffer, format=kind, **options)
    write_bytes(path, buffer.getbuffer())


def image_bytes(image: UInt8, kind: str, **options: Any) -> bytes:
    """A picture [H, W] or [H, W, 1 to 4] as the contents of a file of a format, as Pillow's."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, kind, **options)
    return buffer.getvalue()


def own_output(path: Path) -> bool:
    """Whether a picture is a sheet that looks at photos, and so none of them (`write_image`)."""
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        return False
    try:
        with open(path, "rb") as stream:
            return _SHEET in stream.read(_HEAD)
    except OSError:  # whoever reads it says so
        return False


def write_exr(path: str | os.PathLike[str], values: Floats) -> None:
    """Write values [H, W] as channel ``Z`` (depth) of an uncompressed 32-bit OpenEXR file.

    Infinity is kept.
    """
    plane = np.ascontiguousarray(values, "<f4")
    height, width = plane.shape

    def attribute(name: str, kind: str, data: bytes) -> bytes:
        return b"%s\0%s\0%s%s" % (name.encode(), kind.encode(), struct.pack("<i", len(data)), data)

    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channel = b"Z\0" + struct.pack("<iB3xii", 2, 0, 1, 1) + b"\0"
    header = struct.pack("<ii", 20000630, 2) + b"".join([
        attribute("channels", "chlist", channel),
        attribute("compression", "compression", b"\0"),
        attribute("dataWindow", "box2i", window),
        attribute("displayWindow", "box2i", window),
        attribute("lineOrder", "lineOrder", b"\0"),
        attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
        attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0)),
        attribute("screenWindowWidth", "float", struct.pack("<f", 1.0))]) + b"\0"
    line = 4 * width
    first = len(header) + 8 * height
    with atomic_write(path) as stream:
        stream.write(header)
        stream.write(struct.pack(f"<{height}Q", *(first + row * (line + 8)
                                                  for row in range(height))))
        for row in range(height):
            stream.write(struct.pack("<ii", row, line) + plane[row].tobytes())


def aligned_member(stream: BinaryIO, name: str, padding: int, *, zip64: bool = False,
                   ) -> zipfile.ZipInfo:
    """A member for the end of a zip file's stream; its content begins at a multiple of 64 bytes.

    A field of the kind ``padding`` takes the room before it (as ``zipalign`` does for Android).
    """
    member = zipfile.ZipInfo(name)
    room = -(stream.tell() + _HEADER + len(name) + zip64 * _ZIP64 + 4) % _ALIGNED
    member.extra = struct.pack("<HH", padding, room) + bytes(room)
    return member


def write_mappable(stream: BinaryIO, arrays: dict[str, Any]) -> None:
    """Write arrays, by name, as an uncompressed ``.npz`` that `map_arrays` can map.

    It is what `numpy.savez` writes, but for a little room before each array (`aligned_member`).
    """
    with zipfile.ZipFile(stream, "w") as archive:
        for name, array in arrays.items():
            member = aligned_member(stream, f"{name}.npy", _PADDING, zip64=True)
            with archive.open(member, "w", force_zip64=True) as target:
                np.lib.format.write_array(target, np.asanyarray(array), allow_pickle=False)


def map_arrays(path: Path) -> dict[str, Array]:
    """The arrays of an uncompressed ``.npz`` by name, memory-mapped: read only on access.

    What is written to them stays in memory. Raises `UNREADABLE_ARRAYS` if there is no such file, or
    it is damaged or no such archive.
    """
    with open(path, "rb") as stream, zipfile.ZipFile(stream) as archive:
        memory = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_COPY)
        return {member.filename.removesuffix(".npy"): _array(stream, memory, member)
                for member in archive.infolist()}


def _array(stream: BinaryIO, memory: mmap.mmap, member: zipfile.ZipInfo) -> Array:
    if member.compress_type != zipfile.ZIP_STORED:
        raise ValueError(f"{member.filename} is compressed")
    stream.seek(member.header_offset)
    name, extra = struct.unpack("<HH", stream.read(_HEADER)[-4:])
    begin = member.header_offset + _HEADER + name + extra
    stream.seek(begin)
    shape, order, dtype = array_header(stream)
    if stream.tell() - begin + int(np.prod(shape)) * dtype.itemsize != member.file_size:
        raise ValueError(f"{member.filename} is cut off")
    return np.ndarray(shape, dtype, memory, stream.tell(), order=order)


def array_header(stream: IO[bytes]) -> tuple[tuple[int, ...], Literal["C", "F"], np.dtype[Any]]:
    """Shape, order and type of the ``.npy`` file that a stream is at; it goes on to the numbers.

    NumPy has Python parse the head, and CPython 3.11 fails now and then where several threads parse
    at once (its issue 106905). Raises `UNREADABLE_ARRAYS` if it is damaged or holds objects.
    """
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("an array is of another version")
    length, = struct.unpack("<H", stream.read(2))
    found = _ARRAY.fullmatch(stream.read(length).decode("latin1"))
    if found is None:
        raise ValueError("an array has no head as NumPy writes it")
    dtype = np.dtype(found[1])
    if dtype.hasobject:
        raise ValueError("an array holds objects")
    shape = tuple(int(size) for size in found[3].split(",") if size.strip())
    return shape, "F" if found[2] == "True" else "C", dtype


def read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Array:
    """An array of an ``.npz``, as `numpy.load` reads it; see `array_header`."""
    with archive.open(member) as content:
        shape, order, dtype = array_header(content)
        array = np.empty(shape, dtype, order)
        whole = array.reshape(-1, order="A").view(np.uint8)
        for start in range(0, len(whole), _PIECE):
            part = whole[start:start + _PIECE]
            data = content.read(len(part))
            if len(data) < len(part):
                raise ValueError("an array is cut off")
            part[:] = np.frombuffer(data, np.uint8)
    return array


def load_arrays(path: Path) -> dict[str, Array]:
    """All arrays of an ``.npz`` by name, which several threads may read at once.

    Raises `UNREADABLE_ARRAYS` if there is no such file, or it is damaged.
    """
    with zipfile.ZipFile(path) as archive:
        return {member.filename.removesuffix(".npy"): read_member(archive, member)
                for member in archive.infolist()}


_CARD = 10_000_000  # Nanoseconds of a step of the clock of memory cards (exFAT; FAT: 2 s).
_SOON = 2_000_000_000  # Nanoseconds within which two changes may have the same time.


def file_state(path: Path) -> tuple[int, int, int, int]:
    """Size in bytes, times of change of contents and of anything (ns), and number of a file.

    Raises `OSError` if there is none.
    """
    status = path.stat()
    return status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino


def tells_changes(state: tuple[int, int, int, int]) -> bool:
    """Whether the same state will mean the same contents.

    Not on Windows, which notes the creation instead, nor on memory cards, which note one time for
    all and in coarse steps; nor for a file that was changed only now and may be again at once.
    """
    changed = state[2]
    return (sys.platform != "win32" and changed % _CARD != 0 and time.time_ns() - changed > _SOON)
