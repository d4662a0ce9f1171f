"""What a folder of pictures holds, in which order, and what is left out.

- Order: numbers in names count as numbers, so ``view_2`` comes before ``view_10``.
- What systems leave in folders is no picture: ``._X`` (macOS), ``@eaDir`` (Synology),
  ``__MACOSX``, ``.thumbnails``, ``Thumbs.db``.
- Of twins one is taken: ``IMG_1.HEIC`` beside ``IMG_1.JPG``, ``IMG_1-edited.jpg`` beside
  ``IMG_1.jpg``, and copies of the same bytes. A photo beside a held-out twin would be measured by
  itself.
- Names are found as people write them: in any case, and with accents as one character or as two
  (Unicode NFC and NFD; macOS writes the latter).
"""

import functools
import hashlib
import re
import unicodedata
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from ..files import own_output
from .kinds import PHOTOS, RAW, UNREAD, VIDEOS, kind_of

RAW_PHOTOS = "raw photos are not read"  # The reason why raw photos are left out of a listing.
_JUNK = {"@eadir", "__macosx", "#recycle", "#snapshot", "$recycle.bin", "lost+found",
         "system volume information", "thumbs.db", "ehthumbs.db", "desktop.ini", "icon\r"}
_EDITED = re.compile(
    r"(?P<stem>.+?)[-_ ~.]?(?:[-_ ](?:edited|edit|bearbeitet|modifi[eé]|editad[oa]|modificato|"
    r"bewerkt|edytowane|redigeret|redigerad|muokattu|upraveno|編集済み|已修改|수정됨)"
    r"(?:[-_ ]?\(?\d+\)?)?)$", re.IGNORECASE)
"""How Google Photos and others name what was edited, in some languages."""
_PHONE_EDIT = re.compile(r"(?P<first>[A-Z]{3}_)E(?P<number>\d{4,})$", re.IGNORECASE)
"""An iPhone names the edited copy of ``IMG_1234`` ``IMG_E1234``."""
_PIXEL = re.compile(r"(?P<stem>.+\.(?:PORTRAIT|NIGHT|MP|RAW))-\d+\.(?:COVER|ORIGINAL)$",
                    re.IGNORECASE)
"""A Pixel stores a portrait as the blurred ``-01.COVER`` and the sharp ``-02.ORIGINAL``."""
_RANK = (".heic", ".heif", ".hif", ".tif", ".tiff", ".jpg", ".jpeg", ".png")
"""Of twins with one stem that of the commoner ending is taken, else the first of these: what the
camera wrote, with its depth."""


def is_junk(path: Path) -> bool:
    """Whether a system left this file or folder there, or hides it."""
    return path.name.startswith(".") or path.name.lower() in _JUNK


def natural_key(name: str | Path) -> tuple[tuple[Any, ...], str]:
    """A key to sort names by, numbers in them as numbers."""
    text = unicodedata.normalize("NFC", str(name)).casefold()
    # Words and numbers take turns, so that a number is never compared with a word.
    parts = re.split(r"([0-9]+)", text)
    return (tuple(int(part) if number % 2 else part for number, part in enumerate(parts)),
            str(name))


def visible(folder: Path) -> list[Path]:
    """What a folder holds, without junk, in natural order; nothing where it is no folder."""
    try:
        found = [path for path in folder.iterdir() if not is_junk(path)]
    except OSError:
        return []
    return sorted(found, key=lambda path: natural_key(path.name))


def folders_below(folder: Path, depth: int = 8) -> list[Path]:
    """All folders within a folder, without junk, in natural order; links are not followed."""
    found = []
    for path in visible(folder) if depth else ():
        if path.is_dir() and not path.is_symlink():
            found += [path, *folders_below(path, depth - 1)]
    return found


def files_below(folder: Path) -> list[Path]:
    """All files within a folder, without junk and our own sheets, in natural order."""
    return [path for place in (folder, *folders_below(folder)) for path in visible(place)
            if path.is_file() and not own_output(path)]


@dataclass(frozen=True)
class Listing:
    """Pictures of a folder, and what is left out."""

    files: list[Path]  # The pictures, in natural order.
    # Other pictures and videos by the reason why they are not among them, in few words.
    left_out: dict[str, list[Path]] = field(default_factory=dict)


def list_pictures(folder: Path, *, photos: bool = False) -> Listing:
    """The pictures of a folder, not of folders in it; one that is missing holds none.

    Of equal copies of ``photos``, too, one is taken. Views of a light field may be equal.
    """
    pictures: list[Path] = []
    left: dict[str, list[Path]] = {}
    for path in visible(folder):
        if not path.is_file() or _plain(path) or own_output(path):
            continue
        kind = kind_of(path)
        if kind == "picture":
            pictures.append(path)
        elif kind != "other":
            left.setdefault({"raw": RAW_PHOTOS, "video": "a video among pictures",
                             "unread": "of a kind that is not read"}[kind], []).append(path)
    # A raw photo beside its JPEG is what cameras write: nothing is lost.
    developed = {stem_key(path) for path in pictures}
    raw = [path for path in left.pop(RAW_PHOTOS, []) if stem_key(path) not in developed]
    if raw:
        left[RAW_PHOTOS] = raw
    files, twins = one_of_each(pictures, copies=photos)
    return Listing(files, {**left, **twins})


def _plain(path: Path) -> bool:
    """Whether an ending says that a file is no picture, so that it need not be opened."""
    suffix = path.suffix.lower()
    return suffix in {".txt", ".json", ".npz", ".npy", ".xml", ".csv", ".md", ".html", ".toml",
                      ".bin", ".db", ".ply", ".obj", ".glb", ".zip", ".exe", ".py", ".xmp", ".aae"
                      } and suffix not in PHOTOS | VIDEOS | RAW | UNREAD


def stem_key(path: Path) -> str:
    """A file's name without its ending, the same in any case and form of its accents."""
    return unicodedata.normalize("NFC", path.stem).casefold()


def one_of_each(files: Iterable[Path], *, copies: bool = True,
                ) -> tuple[list[Path], dict[str, list[Path]]]:
    """Pictures of one folder without their twins, in their order; those left out by the reason.

    ``copies``: whether of files with the same bytes one is taken.
    """
    files = list(files)
    stems = {stem_key(path) for path in files}
    common = Counter(path.suffix.lower() for path in files)
    left: dict[str, list[Path]] = {}

    def leave(path: Path, reason: str) -> None:
        left.setdefault(reason, []).append(path)

    kept: dict[str, Path] = {}
    for path in files:
        stem = stem_key(path)
        if (whole := _original(stem)) is not None and whole in stems:
            leave(path, "edited copies of other photos")
            continue
        pixel = _PIXEL.match(stem)
        key = pixel["stem"] if pixel else stem
        if key in kept and kept[key].suffix == path.suffix and not pixel:
            key = path.name  # names that differ in case alone are two photos
        other = kept.get(key)
        if other is None:
            kept[key] = path
        else:
            better, worse = sorted((path, other), key=lambda one: _rank(one, common))
            kept[key] = better
            leave(worse, "the same photos in another format")
    taken = sorted(kept.values(), key=files.index)
    if copies:
        taken = _without_copies(taken, leave)
    return taken, left


def _rank(path: Path, common: Counter[str]) -> tuple[bool, int, int]:
    suffix = path.suffix.lower()
    return (path.stem.lower().endswith(".cover"), -common[suffix],
            _RANK.index(suffix) if suffix in _RANK else len(_RANK))


def _original(stem: str) -> str | None:
    """The stem of the photo that this one was edited from, if its name says so."""
    if (found := _EDITED.match(stem)) is not None:
        return found["stem"]
    if (found := _PHONE_EDIT.match(stem)) is not None:
        return (found["first"] + found["number"]).casefold()
    return None


def _without_copies(files: list[Path], leave: Callable[[Path, str], None]) -> list[Path]:
    """Of files with the same bytes the first; only those of one size are read."""
    sizes: dict[int, list[Path]] = {}
    for path in files:
        sizes.setdefault(path.stat().st_size, []).append(path)
    gone: set[Path] = set()
    for alike in sizes.values():
        seen: dict[bytes, Path] = {}
        for path in alike if len(alike) > 1 else ():
            digest = hashlib.sha256(path.read_bytes()).digest()
            if seen.setdefault(digest, path) is not path:
                leave(path, "copies of other photos")
                gone.add(path)
    return [path for path in files if path not in gone]


def say_left_out(listing: Listing, place: Path, stacklevel: int = 2) -> None:
    """A warning for each reason why pictures of a folder are left out."""
    for reason, files in listing.left_out.items():
        names = ", ".join(path.name for path in files[:3])
        more = f" and {len(files) - 3} more" if len(files) > 3 else ""
        hint = "; export them as JPEG or TIFF" if "not read" in reason else ""
        warnings.warn(f"{len(files)} of {place} left out ({reason}): {names}{more}{hint}",
                      stacklevel=stacklevel + 1)


@functools.cache
def folded(name: str) -> str:
    """A name in any case, with accents in any form, as one."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


class Finder:
    """Finds files by the names that programs noted, though a disk may spell them otherwise.

    What was read of folders is kept for as long as the finder lives.
    """

    def __init__(self) -> None:
        self._folders: dict[Path, dict[str, list[str]]] = {}

    def _names(self, folder: Path) -> dict[str, list[str]]:
        if folder not in self._folders:
            names: dict[str, list[str]] = {}
            for path in visible(folder):
                names.setdefault(folded(path.name), []).append(path.name)
            self._folders[folder] = names
        return self._folders[folder]

    def find(self, folder: Path, name: str) -> Path | None:
        """The file of that name in a folder.

        An exact name goes first, then one that differs in case or in the form of its accents, then
        one with another spelling of the same ending (``.jpeg`` for ``.jpg``). The name is a
        relative path, with slashes or, as Windows writes it, backslashes.
        """
        name = name.replace("\\", "/")
        place = folder / name
        if _is_file(place):
            return place
        if Path(name).is_absolute():
            return None
        here, parts = folder, PurePosixPath(name).parts
        for number, part in enumerate(parts):
            if part == "..":
                here = here.parent
                continue
            found = self._names(here).get(folded(part), [])
            if not found and number == len(parts) - 1:
                found = self._other_ending(here, part)
            if len(found) != 1:
                return None
            here = here / found[0]
        return here if parts and _is_file(here) else None

    def _other_ending(self, folder: Path, name: str) -> list[str]:
        stem, suffix = Path(name).stem, Path(name).suffix.lower()
        for group in ((".jpg", ".jpeg", ".jpe", ".jfif"), (".tif", ".tiff"),
                      (".heic", ".heif", ".hif")):
            if suffix in group:
                return [found for other in group if other != suffix
                        for found in self._names(folder).get(folded(stem + other), [])]
        return []

    def find_picture(self, folder: Path, stem: str) -> Path | None:
        """The picture with this name before its ending; of several the first in `PHOTOS`' order."""
        for suffix in (".png", *sorted(PHOTOS - {".png"})):
            found = self.find(folder, f"{stem}{suffix}")
            if found is not None:
                return found
        return None


def _is_file(path: Path) -> bool:
    try:
        return path.is_file() and not is_junk(path)
    except (OSError, ValueError):  # a name with a null character, or too long
        return False
