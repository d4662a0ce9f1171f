"""What a file is, by its content, and what is broken in it: names lie, and decoders say little.

Phones and messengers name HEIC pictures ``.JPG``, browsers save WebP as ``.jpg``, and some files
have no ending. The first bytes of a file say what it is. The ending counts only where they do not:
a raw photo begins like a TIFF.

A memory card or a broken download leaves a photo whose file is as long as it should be, with zeros
(or, of erased flash memory, bytes 255) from some place on. libjpeg decodes them as well as it can
and says nothing that Pillow passes on: stripes, or grey. But compressed data never look like that:

- in a JPEG's scan a long run of zeros means something only where the shortest codes, which are all
  zeros, say "as before": in flat parts of a picture, at two bits or more a block of 8 x 8. A run
  that would fill more blocks than the picture has, or zeros where those codes say something else,
  is damage;
- bytes 255 in a scan are followed by a zero, unless they begin a marker;
- in other compressed pictures no eighth of the file is zeros.
"""

import mmap
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

Kind = Literal["picture", "raw", "unread", "video", "other"]
"""``unread``: a picture of a kind that is not read; ``other``: neither picture nor video."""

HEIC = {".heic", ".heif", ".hif"}  # Endings of what phones write; read by pillow-heif.
PHOTOS = {".jpg", ".jpeg", ".jpe", ".jfif", ".pjpeg", ".pjp", ".png", ".webp", ".tif", ".tiff",
          ".bmp", ".gif", ".avif"} | HEIC
"""Endings of pictures that are read, by every reader."""
VIDEOS = {".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".3gp", ".mts", ".m2ts", ".mpg",
          ".mpeg", ".wmv", ".flv", ".ogv"}
"""Endings of videos that are read."""
RAW = {".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dng", ".erf", ".iiq", ".nef", ".nrw", ".orf",
       ".pef", ".raf", ".raw", ".rw2", ".srw", ".x3f"}
"""Endings of raw photos, which are not read."""
UNREAD = {".jxl", ".psd", ".psb", ".xcf", ".kra", ".svg", ".ai", ".eps", ".pdf", ".exr", ".hdr",
          ".jp2", ".j2k", ".heics", ".insp", ".tga", ".dcm"}
"""Endings of pictures of kinds that are not read."""

_HEAD = 64
_SIGNS: tuple[tuple[bytes, str], ...] = (
    (b"\xff\xd8\xff", "jpeg"), (b"\x89PNG\r\n\x1a\n", "png"), (b"GIF87a", "gif"),
    (b"GIF89a", "gif"), (b"II*\0", "tiff"), (b"MM\0*", "tiff"), (b"II+\0", "tiff"),
    (b"MM\0+", "tiff"), (b"\x1aE\xdf\xa3", "matroska"), (b"FLV\x01", "flv"), (b"OggS", "ogg"),
    (b"\x30\x26\xb2\x75\x8e\x66\xcf\x11", "asf"), (b"\0\0\x01\xba", "mpeg"),
    (b"\0\0\x01\xb3", "mpeg"), (b"\xff\x0a", "jxl"), (b"\0\0\0\x0cJXL ", "jxl"),
    (b"\0\0\0\x0cjP  ", "jp2"), (b"8BPS", "psd"), (b"gimp xcf", "xcf"), (b"%PDF", "pdf"),
    (b"\x76\x2f\x31\x01", "exr"), (b"FUJIFILMCCD-RAW", "raw"), (b"FOVb", "raw"),
    (b"IIRO", "raw"), (b"IIU\0", "raw"), (b"\0\x05\x16\x07", "appledouble"))
"""First bytes of files (their formats' specifications)."""
_HEIF_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1", b"mif2"}
_AVIF_BRANDS = {b"avif", b"avis"}
_PICTURES = {"jpeg", "png", "gif", "tiff", "bmp", "webp", "heic", "avif"}
_MOVING = {"mp4", "matroska", "avi", "flv", "ogg", "asf", "mpeg", "mpegts"}


def _head(path: Path) -> bytes:
    try:
        with open(path, "rb") as stream:
            return stream.read(_HEAD + 512)
    except OSError:
        return b""


def _boxed(head: bytes) -> str:
    """The format of a file of the ISO base media family, by its brands (ISO/IEC 14496-12)."""
    size = max(int.from_bytes(head[:4], "big"), 16)
    brands = [head[8:12], *(head[at:at + 4] for at in range(16, min(size, len(head)) - 3, 4))]
    if brands[0] == b"crx ":
        return "raw"
    if _AVIF_BRANDS & set(brands) and brands[0] not in _HEIF_BRANDS - {b"mif1", b"msf1"}:
        return "avif"
    return "heic" if brands[0] in _HEIF_BRANDS else "mp4"


def file_format(path: Path) -> str:
    """The format of a file by its first bytes: ``"jpeg"``, ``"png"``, ``"heic"``, ``"mp4"``, ...

    Empty where they are of no known kind, or the file can't be read.
    """
    head = _head(path)
    for sign, name in _SIGNS:
        if head.startswith(sign):
            return name
    if head[:4] == b"RIFF":
        return {b"WEBP": "webp", b"AVI ": "avi"}.get(head[8:12], "")
    if head[4:8] == b"ftyp":
        return _boxed(head)
    if head[4:8] in (b"moov", b"mdat", b"wide", b"free", b"skip"):
        return "mp4"  # QuickTime without a list of brands
    if head[:2] == b"BM" and head[14:18] in (b"\x0c\0\0\0", b"\x28\0\0\0", b"\x6c\0\0\0",
                                             b"\x7c\0\0\0", b"\x40\0\0\0"):
        return "bmp"
    for start, packet in ((0, 188), (4, 192)):  # packets of a transport stream
        if len(head) > start + 2 * packet and head[start::packet][:3] == b"\x47\x47\x47":
            return "mpegts"
    return ""


def kind_of(path: Path) -> Kind:
    """What a file is, by its content, or by its ending where the content says nothing.

    A damaged file counts as what its ending names, so that it is named as damaged. Folders and
    what can't be opened are ``"other"``, unless they have such an ending.
    """
    suffix = path.suffix.lower()
    if path.is_dir():
        return "other"
    if suffix in RAW:
        return "raw"  # many begin as a TIFF, and Pillow would show their thumbnail
    found = file_format(path)
    if found in _PICTURES:
        return "picture"
    if found in _MOVING:
        return "video"
    if found == "appledouble":
        return "other"
    if found:
        return "raw" if found == "raw" else "unread"
    return ("picture" if suffix in PHOTOS else "video" if suffix in VIDEOS
            else "unread" if suffix in UNREAD else "other")


_ZEROS, _ONES = 256, 64  # Bytes of a run that is looked at.
_REST = re.compile(rb"\0+|\xff+")
_LONG = re.compile(rb"\0{4096,}")
_FRAMES = {0xC0, 0xC1, 0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF}
_BASELINE = {0xC0, 0xC1}


def damage_of(path: Path) -> str:
    """What is wrong with a picture's compressed data, such as "zeros from 33 % of the file on".

    Empty where nothing is found.
    """
    kind = file_format(path)
    if kind not in ("jpeg", "heic", "avif", "webp"):
        return ""  # PNG has checksums
    try:
        with open(path, "rb") as stream, \
                mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            place = _in_jpeg(data) if kind == "jpeg" else _in_boxes(data)
            size = len(data)
    except (OSError, ValueError, struct.error, IndexError):
        return ""  # what can't be opened or parsed, the decoder names
    if place is None:
        return ""
    return f"its data are gone from {100 * place // size} % of the file on"


def _in_boxes(data: mmap.mmap) -> int | None:
    for found in _LONG.finditer(data):
        if found.end() - found.start() > len(data) // 8:
            return found.start()
    return None


_MARKER = re.compile(rb"\xff[\x01-\xcf\xd8-\xfe]")
"""Neither a stuffed byte (FF 00) nor a restart (FF D0 to D7)."""
SCAN, END = 0xDA, 0xD9  # Markers of a JPEG.


def jpeg_segments(data: mmap.mmap, at: int = 2, *, scans: bool = True,
                  ) -> Iterator[tuple[int, int, int, int]]:
    """A JPEG's segments from a place on (ITU-T T.81), or only those before its first scan.

    Of each its marker, where its content begins and ends, and where the next one begins.
    """
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # padding
            at += 1
            continue
        if marker == END:
            yield marker, at + 2, at + 2, at + 2
            return
        if marker == SCAN and not scans:
            return
        first, last = at + 4, at + 2 + int.from_bytes(data[at + 2:at + 4], "big")
        at = last
        if marker == SCAN:
            found = _MARKER.search(data, last)
            at = len(data) if found is None else found.start()
        yield marker, first, last, at


def _in_jpeg(data: mmap.mmap) -> int | None:
    """Where the scans' data end being data, or None."""
    blocks, baseline = 0, False
    tables: dict[int, int] = {}
    for marker, begin, last, end in jpeg_segments(data):
        if marker in _FRAMES:
            blocks, baseline = _blocks(data[begin:last]), marker in _BASELINE
        elif marker == 0xC4:
            tables.update(_shortest(data[begin:last]))
        elif marker == SCAN:
            flat = not baseline or all(symbol == 0 for symbol in tables.values())
            # Two bits a block: one for the difference of means, one for "no details".
            most = blocks // 4 if flat else 0
            for first, until in _runs(data, last, end):
                # Fill bytes before a marker are few.
                if data[first] == 0xFF or until - first > max(most, _ZEROS):
                    return first
    return None


def _runs(data: mmap.mmap, at: int, end: int) -> Iterator[tuple[int, int]]:
    """Where long runs of zeros and of bytes 255 begin and end, in order.

    Each is looked for as text: a pattern with both takes ten times as long.
    """
    runs = [bytes(_ZEROS), b"\xff" * _ONES]
    places = [data.find(run, at, end) for run in runs]
    while any(place >= 0 for place in places):
        first = min(place for place in places if place >= 0)
        whole = _REST.match(data, first, end)
        last = first + 1 if whole is None else whole.end()
        yield first, last
        places = [data.find(run, last, end) if 0 <= place < last else place
                  for run, place in zip(runs, places)]


def scans_end(data: mmap.mmap) -> bool:
    """Whether a JPEG has all its scans, and the mark of its end behind the last."""
    at = 2
    for marker, _, _, end in jpeg_segments(data):
        if marker == END:
            return True
        at = end
    return data[at:at + 2] == b"\xff\xd9"


def _blocks(frame: bytes) -> int:
    """Blocks of 8 x 8 of all components of a frame (an upper bound)."""
    height, width, count = struct.unpack(">HHB", frame[1:6])
    factors = [(frame[7 + 3 * one] >> 4, frame[7 + 3 * one] & 15) for one in range(count)]
    across = max((factor[0] for factor in factors), default=0) or 1
    down = max((factor[1] for factor in factors), default=0) or 1
    units = -(-width // (8 * across)) * -(-height // (8 * down))
    return int(units * sum(one * two for one, two in factors))


def _shortest(segment: bytes) -> dict[int, int]:
    """The symbol whose code is all zeros, the first, of each Huffman table of a segment."""
    found, at = {}, 0
    while at + 17 <= len(segment):
        count = sum(segment[at + 1:at + 17])
        if count and at + 17 < len(segment):
            found[segment[at]] = segment[at + 17]
        at += 17 + count
    return found
