"""Names and ids: what people call things, and what the page sends.

The page sends ids alone, which are never paths: the server lists a folder and compares. Names come
from people and their files; each is cleaned into one that every system takes as a file's name.
"""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Collection
from pathlib import PurePosixPath

from .answers import Refusal

__all__ = ["clean_name", "file_name", "folder_name", "free_name", "id_of", "is_id"]

_ID = re.compile(r"[a-z0-9][a-z0-9-]{0,79}")
_FORBIDDEN = re.compile(r'[\x00-\x1f\x7f/\\:*?"<>|]')
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt")
                                           for n in range(1, 10))}
"""Names that mean devices on Windows, with any ending."""
_FORMLESS = ("Cf", "Cs", "Co", "Cn")
"""Signs that are not seen, or that nobody knows."""
_LONGEST = 120


def is_id(word: str) -> bool:
    """Whether a word can be an id."""
    return _ID.fullmatch(word) is not None


def id_of(name: str) -> str:
    """The id of a thing by its name: the name where that is one, else its letters and a hash.

    The same name has the same id at all times, so that none must be kept.
    """
    if is_id(name):
        return name
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    plain = re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:60].strip("-")
    return f"{plain or 'x'}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def clean_name(name: str) -> str:
    """A name that can be a folder's or a file's on every system.

    Raises
    ------
    Refusal
        If it can't: it is empty, hidden, a device's, or holds what paths are made of.
    """
    name = unicodedata.normalize("NFC", name).strip()
    stem = name.partition(".")[0].strip().lower()
    if (not name or len(name) > _LONGEST or name[0] == "." or name[-1] == "."
            or _FORBIDDEN.search(name) or stem in _DEVICES
            or any(unicodedata.category(sign) in _FORMLESS for sign in name)):
        raise Refusal("bad_name", f"{name[:_LONGEST]!r} can't be a file's name: leave out / \\ : "
                      '* ? " < > | and dots at its ends', name=name[:_LONGEST])
    return name


def folder_name(title: str) -> str:
    """A folder's name for a title: what no name may hold becomes a dash, also signs without form.

    Raises
    ------
    Refusal
        If nothing is left of it.
    """
    name = _FORBIDDEN.sub("-", unicodedata.normalize("NFC", title))
    name = "".join("-" if unicodedata.category(sign) in _FORMLESS else sign for sign in name)
    return clean_name(re.sub(r"\s+", " ", name).strip(" .")[:60].strip(" ."))


def file_name(name: str) -> tuple[str, str]:
    """The name of a file that was sent, cleaned; and its ending in small letters, with the dot."""
    name = clean_name(name)
    return name, PurePosixPath(name).suffix.lower()


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, or the name with a number, so that it is none of those that are taken.

    Capitals do not count: some disks do not tell them apart.
    """
    path = PurePosixPath(name)
    known = {one.lower() for one in taken}
    found, count = name, 1
    while found.lower() in known:
        count += 1
        found = f"{path.stem}-{count}{path.suffix}"
    return found
