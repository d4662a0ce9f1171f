"""What a file is: by its content, as names lie.

Phones and messengers name HEIC pictures ``.JPG``, browsers save WebP as ``.jpg``, and some files
have no ending. The first bytes of a file say what it is. The ending counts only where they do not:
a raw photo begins like a TIFF.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

__all__ = ["HEIC", "PHOTOS", "RAW", "UNREAD", "VIDEOS", "Kind", "file_format", "kind_of"]

Kind = Literal["picture", "raw", "unread", "video", "other"]
"""``unread``: a picture of a kind that is not read; ``other``: neither picture nor video."""

HEIC = {".heic", ".heif", ".hif"}
"""Endings of what phones write; read by pillow-heif."""
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
    """The format of a file by its first bytes.

    Returns
    -------
    format
        ``"jpeg"``, ``"png"``, ``"heic"``, ``"mp4"``, ...; empty where they are of no known kind, or
        the file can't be read.
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
