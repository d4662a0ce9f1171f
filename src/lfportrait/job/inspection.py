"""What files and folders are, and how they will be read, before anything is computed.

Nothing is decided here: what a file is, how it is read and what is left out is asked of the modules
that read it (`lfportrait.media`, `lfportrait.capture`, `lfportrait.lightfield`). `inspection_text`
puts it in words.
"""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ..capture import (
    DataSetFacts,
    PictureFacts,
    VideoFacts,
    data_set_facts,
    is_calibrated,
    is_video,
    photo_listing,
    picture_facts,
    video_facts,
)
from ..errors import UserError
from ..files import own_output
from ..lightfield import QuiltHint, QuiltLayout, layout_of_file, quilt_part
from ..measure import usable_cores
from ..media.folders import Listing, is_junk
from ..media.kinds import file_format, kind_of

__all__ = ["FolderFacts", "Inspection", "OtherFacts", "QuiltFacts", "inspect"]


@dataclass(frozen=True)
class FolderFacts:
    """Of a folder of photos.

    Attributes
    ----------
    path
        As it was given.
    fault
        Why no photos can be taken from it; empty where they can.
    pictures
        Of each photo, in the order in which they are read; those with a fault are left out.
    left_out
        Other files by the reason why they are not among them, the place where photos lie alone.
    """

    path: Path
    fault: str = ""
    pictures: list[PictureFacts] = field(default_factory=list)
    left_out: dict[str, list[Path]] = field(default_factory=dict)


@dataclass(frozen=True)
class OtherFacts:
    """Of a file that no reader takes: its format by its content, and why."""

    path: Path
    fault: str
    format: str = ""


@dataclass(frozen=True)
class QuiltFacts:
    """The layout of a quilt, or what is wrong with it in words; the other one is None or empty."""

    layout: QuiltLayout | None = None
    fault: str = ""


@dataclass(frozen=True)
class Inspection:
    """What one path is.

    Attributes
    ----------
    facts
        By its kind.
    quilts
        Of files that are quilts, by the path.
    notes
        What the readers warn of.
    """

    facts: PictureFacts | VideoFacts | DataSetFacts | FolderFacts | OtherFacts
    quilts: dict[Path, QuiltFacts] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def kind(self) -> str:
        """For people: ``"a picture"``, ``"a video"``, ..."""
        if isinstance(self.facts, OtherFacts) and kind_of(self.facts.path) == "raw":
            return "a raw photo"
        return _KINDS[type(self.facts)]

    def figures(self) -> dict[str, Any]:
        """As JSON: ``kind``, the facts, ``quilts`` and ``notes``; paths as text."""
        found: dict[str, Any] = _plain({"kind": self.kind, **asdict(self.facts),
                                        "notes": self.notes})
        found["quilts"] = {str(path): _plain(asdict(one)) for path, one in self.quilts.items()}
        return found


_KINDS: dict[type, str] = {
    PictureFacts: "a picture", VideoFacts: "a video", DataSetFacts: "a calibrated data set",
    FolderFacts: "a folder of photos", OtherFacts: "neither picture nor video"}


def _plain(value: Any) -> Any:
    """A value of dictionaries and lists with paths as text."""
    if isinstance(value, dict):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return str(value) if isinstance(value, Path) else value


def inspect(path: Path) -> Inspection:
    """Look at a file or a folder; what is damaged is told in the result.

    Raises
    ------
    UserError
        If there is no such file or folder.
    """
    if not path.exists():
        raise UserError(f"there is no file or folder {path}; check the name")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        facts = _facts(path)
        quilts = _quilts(facts)
    notes = dict.fromkeys(" ".join(str(one.message).split()) for one in told
                          if issubclass(one.category, UserWarning))
    return Inspection(facts, quilts, list(notes))


def _facts(path: Path) -> PictureFacts | VideoFacts | DataSetFacts | FolderFacts | OtherFacts:
    if is_calibrated(path):
        return data_set_facts(path)
    if path.is_dir():
        return _folder(path)
    if is_video(path):
        return video_facts(path)
    return picture_facts(path) if kind_of(path) == "picture" else _other(path)


def _other(path: Path) -> OtherFacts:
    reason = {"raw": "raw photos are not read; export it as JPEG or TIFF",
              "unread": "pictures of this kind are not read; export it as JPEG or TIFF",
              }.get(kind_of(path), "it is neither a picture nor a video")
    return OtherFacts(path, reason, file_format(path))


def _folder(path: Path) -> FolderFacts:
    try:
        listing = photo_listing(path)
    except UserError as error:
        return FolderFacts(path, str(error))
    with ThreadPoolExecutor(usable_cores()) as threads:
        pictures = list(threads.map(picture_facts, listing.files))
    fault = "" if listing.files else "it has no photos"
    return FolderFacts(path, fault, pictures, _left_out(path, listing))


def _left_out(folder: Path, listing: Listing) -> dict[str, list[Path]]:
    """All files where the photos lie that are none of them, by the reason."""
    left = {reason: list(files) for reason, files in listing.left_out.items()}
    known = {*listing.files, *(path for files in left.values() for path in files)}
    places = {path.parent for path in known} or {folder}
    for path in sorted(path for place in places for path in place.iterdir()):
        if path in known or (path.is_dir() and not is_junk(path)):
            continue
        reason = ("left there by a system, or hidden" if is_junk(path) else
                  "a sheet that lfportrait drew" if own_output(path) else
                  "a raw photo of one that is taken" if kind_of(path) == "raw" else
                  "no picture")
        left.setdefault(reason, []).append(path)
    return left


def _quilts(facts: PictureFacts | VideoFacts | DataSetFacts | FolderFacts | OtherFacts,
            ) -> dict[Path, QuiltFacts]:
    """Layouts of quilts; in a folder only names are asked, as few photos are quilts."""
    if isinstance(facts, PictureFacts | VideoFacts):
        found = {facts.path: _quilt(facts.path)} if not facts.fault else {}
    elif isinstance(facts, FolderFacts):
        found = {one.path: _quilt(one.path) for one in facts.pictures
                 if not one.fault and _named(one.path)}
    else:
        found = {}
    return {path: quilt for path, quilt in found.items() if quilt != QuiltFacts()}


def _named(path: Path) -> bool:
    """Whether a name is a quilt's; one with two layouts is, too."""
    try:
        return quilt_part(path.name) is not None
    except UserError:
        return True


def _quilt(path: Path) -> QuiltFacts:
    try:
        layout = layout_of_file(path)
        hint = QuiltHint.of_name(path.name) if layout is None else None
    except UserError as error:
        return QuiltFacts(fault=str(error))
    if hint is not None:
        return QuiltFacts(fault=f"{hint.said()}, without an aspect: that of the display counts")
    return QuiltFacts(layout)
