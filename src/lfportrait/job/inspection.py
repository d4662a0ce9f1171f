"""What files and folders are, and how they will be read, before anything is computed.

Nothing is decided here: what a file is, how it is read and what is left out is asked of the modules
that read it (`lfportrait.media`, `lfportrait.capture`, `lfportrait.lightfield`). In lines for
people, a fact that all files of a folder share is said once; where they differ, each value is said
with the number of files that have it.
"""

import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from .. import capture
from ..capture import DataSetFacts, DepthFacts, PictureFacts, VideoFacts
from ..errors import UserError
from ..files import own_output, plain_json
from ..lightfield import QuiltHint, QuiltLayout, layout_of_file, quilt_part
from ..measure import usable_cores
from ..media.folders import Listing, is_junk
from ..media.kinds import file_format, kind_of


@dataclass(frozen=True)
class FolderFacts:
    """Of a folder of photos."""

    path: Path  # As it was given.
    fault: str = ""  # Why no photos can be taken from it; empty where they can.
    # Of each photo, in the order in which they are read; those with a fault are left out.
    pictures: list[PictureFacts] = field(default_factory=list)
    # Other files by the reason why they are not among them, the place where photos lie alone.
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
    """What one path is."""

    facts: PictureFacts | VideoFacts | DataSetFacts | FolderFacts | OtherFacts  # By its kind.
    # Of files that are quilts, by the path.
    quilts: dict[Path, QuiltFacts] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)  # What the readers warn of.

    @property
    def kind(self) -> str:
        """For people: ``"a picture"``, ``"a video"``, ..."""
        if isinstance(self.facts, OtherFacts) and kind_of(self.facts.path) == "raw":
            return "a raw photo"
        return _KINDS[type(self.facts)]

    def figures(self) -> dict[str, Any]:
        """As JSON: ``kind``, the facts, ``quilts`` and ``notes``; paths as text."""
        found: dict[str, Any] = plain_json({"kind": self.kind, **asdict(self.facts),
                                        "notes": self.notes})
        found["quilts"] = {str(path): plain_json(asdict(one)) for path, one in self.quilts.items()}
        return found


_KINDS: dict[type, str] = {
    PictureFacts: "a picture", VideoFacts: "a video", DataSetFacts: "a calibrated data set",
    FolderFacts: "a folder of photos", OtherFacts: "neither picture nor video"}


def inspect(path: Path) -> Inspection:
    """Look at a file or a folder; what is damaged is noted in the result."""
    if not path.exists():
        raise UserError(f"there is no file or folder {path}; check the name")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        facts = _facts(path)
        quilts = _quilts(facts)
    notes = dict.fromkeys(" ".join(str(one.message).split()) for one in caught
                          if issubclass(one.category, UserWarning))
    return Inspection(facts, quilts, list(notes))


def _facts(path: Path) -> PictureFacts | VideoFacts | DataSetFacts | FolderFacts | OtherFacts:
    if capture.is_calibrated(path):
        return capture.data_set_facts(path)
    if path.is_dir():
        return _folder(path)
    if capture.is_video(path):
        return capture.video_facts(path)
    return capture.picture_facts(path) if kind_of(path) == "picture" else _other(path)


def _other(path: Path) -> OtherFacts:
    reason = {"raw": "raw photos are not read; export it as JPEG or TIFF",
              "unread": "pictures of this kind are not read; export it as JPEG or TIFF",
              }.get(kind_of(path), "it is neither a picture nor a video")
    return OtherFacts(path, reason, file_format(path))


def _folder(path: Path) -> FolderFacts:
    try:
        listing = capture.photo_listing(path)
    except UserError as error:
        return FolderFacts(path, str(error))
    with ThreadPoolExecutor(usable_cores()) as threads:
        pictures = list(threads.map(capture.picture_facts, listing.files))
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


_ORIENTATIONS = {1: "", 2: "mirrored", 3: "turned by 180 degrees", 4: "mirrored upside down",
                 5: "mirrored and turned", 6: "turned clockwise by 90 degrees",
                 7: "mirrored and turned", 8: "turned counter-clockwise by 90 degrees"}
"""What is done to the stored pixels, by EXIF's orientation."""
_NAMES = 3
Rows = dict[str, str]


def inspection_lines(inspection: Inspection) -> list[str]:
    """What one path is: a heading, and a line a fact."""
    facts = inspection.facts
    rows: list[tuple[str, str]] = []
    heading = f"{facts.path}: {inspection.kind}"
    if isinstance(facts, FolderFacts):
        heading += _counted(facts.pictures)
        rows += _shared(facts.pictures)
        rows += [("left out", line) for line in left_out_lines(facts)]
    elif isinstance(facts, DataSetFacts):
        heading += f", {facts.format}" if facts.format else ""
        rows += _data_set(facts)
    elif isinstance(facts, PictureFacts):
        rows += [] if facts.fault else [*_picture(facts).items()]
    elif isinstance(facts, VideoFacts):
        rows += [] if facts.fault else _video(facts)
    if facts.fault:
        rows.insert(0, ("not read", facts.fault))
    for path, quilt in inspection.quilts.items():
        name = f"{path.name}: " if path != facts.path else ""
        rows.append(("quilt", name + _quilt_rows(quilt)))
    rows += [("note", note) for note in inspection.notes]
    width = max((len(label) for label, _ in rows), default=0)
    return [heading, *(f"  {label:<{width}}  {text}" for label, text in rows)]


def left_out_lines(facts: FolderFacts) -> list[str]:
    """What is left out of a folder of photos and why, a line a reason."""
    damaged: dict[str, list[Path]] = {}
    for one in facts.pictures:
        if one.fault:
            damaged.setdefault(one.fault, []).append(one.path)
    return [f"{_names(files)}: {reason}" for reason, files in (*facts.left_out.items(),
                                                              *damaged.items())]


def mixed_lines(facts: FolderFacts) -> list[str]:
    """In what the photos of a folder differ: size, orientation, colors."""
    return [f"{label}: {text}" for label, text, differs in _grouped(facts.pictures)
            if differs and label in ("size", "orientation", "colors")]


def _names(files: list[Path]) -> str:
    more = f" and {len(files) - _NAMES} more" if len(files) > _NAMES else ""
    return ", ".join(path.name for path in files[:_NAMES]) + more


def _counted(pictures: list[PictureFacts]) -> str:
    read = sum(not one.fault for one in pictures)
    return f", {read} of {len(pictures)} can be read" if read < len(pictures) else f", {read}"


def _size(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"


def _colors(name: str, source: str) -> str:
    return f"{name}, by {source}" if source else f"{name}, as the file says nothing"


def _picture(one: PictureFacts) -> Rows:
    """Facts of a picture that can be read, by their labels."""
    stored = f" (stored {_size(one.stored)})" if one.stored != one.upright else ""
    rows = {"format": one.format + (f", {one.mode}" if one.mode != "RGB" else ""),
            "size": _size(one.upright) + stored,
            "orientation": _ORIENTATIONS[one.orientation] or "as stored",
            "colors": _colors(one.colors, one.colors_by),
            "lens": one.noted.lens or "not noted"}
    if one.noted.focal:
        rows["focal length"] = (f"{one.noted.focal * max(one.upright):.0f} pixels, by "
                                f"{_FOCAL_FROM.get(one.noted.source, one.noted.source)}")
    if one.depth is not None:
        rows["depth"] = _depth(one.depth)
    return rows


_FOCAL_FROM = {"35 mm": "the equal lens on 35-mm film", "focal plane": "the sensor's resolution",
               "camera model": "the camera's name"}


def _depth(depth: DepthFacts) -> str:
    unit = "m" if depth.metric else "of no known unit"
    reach = (f", {depth.nearest:.3g} to {depth.farthest:.3g} {unit}"
             if depth.nearest is not None and depth.farthest is not None else ", all unknown")
    return (f"{depth.source}, {_size(depth.size)}{reach}"
            f"{', with confidence' if depth.confidence else ''}")


def _video(one: VideoFacts) -> list[tuple[str, str]]:
    turned = one.turns * 90
    return [("codec", one.codec),
            ("size", _size(one.upright) + (f" (stored {_size(one.stored)})"
                                           if one.stored != one.upright else "")),
            ("pixels", "square" if abs(one.aspect - 1) < 1e-3 else
             f"{one.aspect:.4g} times as wide as high"),
            ("rotation", f"{turned} degrees counter-clockwise" if turned else "none"),
            ("frames", f"{one.frames or 'not noted'}, {one.rate:.4g} a second, "
                       f"{one.seconds:.1f} seconds"),
            ("colors", _colors(one.colors, one.colors_by))]


def _data_set(facts: DataSetFacts) -> list[tuple[str, str]]:
    if facts.fault:
        return []
    rows = [("cameras", str(facts.source)), ("views", str(len(facts.pictures))),
            ("lens model", ", ".join(f"{model} ({count})" if len(facts.lenses) > 1 else model
                                     for model, count in facts.lenses.items())),
            ("masks", f"of {facts.masks} views" if facts.masks else "none")]
    if facts.test:
        rows.append(("test views", f"{facts.test}, as the data set says"))
    damaged = FolderFacts(facts.path, pictures=facts.pictures)
    return [*rows, *_shared(facts.pictures),
            *(("left out", line) for line in left_out_lines(damaged))]


def _shared(pictures: list[PictureFacts]) -> list[tuple[str, str]]:
    return [(label, text) for label, text, _ in _grouped(pictures)]


def _grouped(pictures: list[PictureFacts]) -> list[tuple[str, str, bool]]:
    """Facts of many pictures: label, text, and whether the pictures differ in it."""
    tables = [(one.path, _picture(one)) for one in pictures if not one.fault]
    found = []
    for label in dict.fromkeys(label for _, rows in tables for label in rows):
        groups: dict[str, list[Path]] = {}
        for path, rows in tables:
            value = rows.get(label, "none")
            if label == "depth":  # its range differs; what it is and of what size, does not
                value = ", ".join(value.split(", ")[:2])
            groups.setdefault(value, []).append(path)
        ordered = sorted(groups.items(), key=lambda group: -len(group[1]))
        text = "; ".join(f"{value}: {_few(files, len(tables))}" for value, files in ordered[:4])
        more = f"; {len(ordered) - 4} more kinds" if len(ordered) > 4 else ""
        found.append((label, ordered[0][0] if len(ordered) == 1 else text + more, len(ordered) > 1))
    return found


def _few(files: list[Path], total: int) -> str:
    """A number of files, with their names where they are few."""
    named = len(files) <= _NAMES and len(files) < total
    return f"{len(files)} ({_names(files)})" if named else str(len(files))


def _quilt_rows(quilt: QuiltFacts) -> str:
    layout = quilt.layout
    if layout is None:
        return quilt.fault
    return (f"{layout.columns} x {layout.rows} views of aspect {layout.aspect:.4g}, by "
            f"{layout.place}")
