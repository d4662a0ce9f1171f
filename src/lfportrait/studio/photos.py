"""Photos of a sitter: uploaded, judged on the contact sheet, and the arc that they cover.

The check of the photos (`lfportrait.job.check_photos`) runs in a process of its own, which writes
``.studio/check.json``; on the sheet each photo has its grade and reasons. The cameras, once they
are placed, are read from the capture.

An upload is one streamed request a photo, resumed by its hash. What comes goes into
``.studio/uploads/HASH.part`` of the project and gets its name when it is complete and its SHA-256
is the announced one. A broken connection keeps what came: the next request says how much that is.
Photos that are here already, by their hash, are not sent again.
"""

import hashlib
import itertools
import math
import os
import re
import secrets
import shutil
import threading
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image
from starlette.concurrency import run_in_threadpool

from ..files import file_state, write_image
from ..measure import free_disk_bytes
from ..media.kinds import PHOTOS, RAW, VIDEOS
from ..media.pictures import file_of, open_picture
from .answers import Refusal, failed, file_name, free_name, free_place, id_of, stamp_of
from .projects import Project, record_in

_SIDES = (240, 1280)
VIDEO_FRAME = "video.jpg"  # Picture of a video among the small pictures: a frame of its middle.
_FACTS = ("sharpness", "yaw", "pitch", "face", "brightness")


def find_photo(project: Project, photo: str) -> Path:
    """The file of a photo, by its id."""
    for path in (*project.files(), *project.files(project.left_out)):
        if id_of(path.name) == photo:
            return path
    raise Refusal("not_found", "there is no such photo any more")


def check_key(project: Project) -> str:
    """Changes whenever the photos that are used do."""
    return stamp_of([(path.name, path.stat().st_size, path.stat().st_mtime_ns)
                     for path in project.files()])


def _placed(project: Project) -> dict[str, dict[str, float]] | None:
    """Where each photo was taken from, by its name without ending; None before it is known."""
    data = record_in(project.job / "capture" / "transforms.json") or {}
    found = {}
    try:
        for frame in data["frames"]:
            x, y, z = (float(row[3]) for row in frame["transform_matrix"][:3])
            distance = math.sqrt(x * x + y * y + z * z)
            found[Path(frame["file_path"]).stem] = {
                "yaw": math.degrees(math.atan2(x, z)), "distance": distance,
                "pitch": math.degrees(math.asin(max(-1.0, min(1.0, y / max(distance, 1e-9)))))}
    except (KeyError, TypeError, ValueError, IndexError):
        return None
    return found


def _grade(facts: dict[str, Any] | None, placed: dict[str, float] | None, known: bool,
           checked: bool) -> tuple[str, list[str]]:
    """Color of a photo's frame, and why."""
    reasons: list[str] = []
    grade = "none"
    if facts is None and checked:
        return "red", ["can't be read"]
    if facts is not None:
        wrong = [one for one in str(facts["wrong"]).split(", ") if one]
        reasons = wrong + [one for one in str(facts["fair"]).split(", ") if one]
        grade = "red" if wrong else "yellow" if reasons else "green"
    if known and placed is None:
        return "red", [*reasons, "not placed"]
    return grade, reasons


def photo_entry(project: Project, path: Path, check: dict[str, Any] | None = None,
                placed: dict[str, dict[str, float]] | None = None, checked: bool = False,
                ) -> dict[str, Any]:
    """A photo as the page sees it."""
    check = record_in(project.own / "check.json") or {} if check is None else check
    video, out = path.suffix.lower() in VIDEOS, path.parent == project.left_out
    facts = None if video else check.get("facts", {}).get(path.name)
    place = None if placed is None else placed.get(path.stem)
    grade, reasons = ("none", []) if video else _grade(
        facts, place, placed is not None and not out, checked and not out)
    state = path.stat()
    stamp = f"{state.st_size:x}{state.st_mtime_ns:x}"
    if video:
        frame = _frame(project, path)
        stamp += f"{frame.stat().st_mtime_ns:x}" if frame is not None else ""
    number = id_of(path.name)
    return {"id": number, "name": path.name, "size": state.st_size, "left_out": out,
            "video": video, "grade": "grey" if out else grade, "reasons": reasons,
            **{key: None if facts is None else facts.get(key) for key in _FACTS}, "placed": place,
            "picture": None if video and frame is None else
            f"/api/projects/{project.id}/photos/{number}/picture?v={stamp}"}


def sheet(project: Project) -> dict[str, Any]:
    """The whole contact sheet."""
    check = record_in(project.own / "check.json") or {}
    checked = bool(check) and check.get("key") == check_key(project)
    known = _placed(project) if checked else None
    # Cameras of other photos than these say nothing; those of a video are its frames'.
    names = {path.stem for path in project.files()}
    placed = known if known and len(names & known.keys()) >= 0.5 * len(known) else None
    photos = [photo_entry(project, path, check, placed, checked)
              for path in (*project.files(), *project.files(project.left_out))]
    return {"photos": sorted(photos, key=lambda one: one["name"]), "checked": checked,
            "checking": None, "arc": _arc(check if checked else {}, placed, photos),
            "advice": check.get("advice", []) if checked else [],
            "looked": len(check.get("facts", {})) if checked else 0,  # of a video its frames
            "faces": check.get("faces", 0), "useless": check.get("useless", 0)}


def _arc(check: dict[str, Any], placed: dict[str, dict[str, float]] | None,
         photos: list[dict[str, Any]]) -> dict[str, Any]:
    """The angles that the photos cover, and the gaps between them."""
    used = [one for one in photos if not one["left_out"] and one["grade"] != "red"]
    if placed:
        yaws = sorted(place["yaw"] for one in used if (place := one["placed"]) is not None)
    elif any(one["video"] for one in used):  # of its frames
        yaws = sorted(one["yaw"] for one in check.get("facts", {}).values()
                      if one["yaw"] is not None and not one["wrong"])
    else:
        yaws = sorted(one["yaw"] for one in used if one["yaw"] is not None)
    gaps = check.get("gaps", [])
    if placed:
        step = check.get("step", 14.0)
        gaps = [[a, b] for a, b in itertools.pairwise(yaws) if b - a > step]
    return {"gaps": gaps, "reach": [yaws[0], yaws[-1]] if yaws else None, "yaws": yaws,
            "placed": placed is not None}


def leave_out(project: Project, path: Path, out: bool) -> Path:
    """Leave a photo out, or take it in again; its new place."""
    if out == (path.parent == project.left_out):
        return path
    if project.calibrated:
        raise Refusal("exists", "these photos are a calibrated data set: none can be left out")
    if not out:
        one_kind(project, path.name)
    place = free_place(project.left_out if out else project.photos, path.name)
    os.replace(path, place)
    return place


def remove_photo(project: Project, path: Path) -> None:
    """Move a photo into the project's trash."""
    if project.calibrated:
        raise Refusal("exists", "these photos are a calibrated data set: none can be removed")
    shutil.move(path, free_place(project.own / "trash", path.name))


def _frame(project: Project, video: Path) -> Path | None:
    """The picture of a video, made when it is checked; another one's is older than the video."""
    frame = project.own / "small" / VIDEO_FRAME
    if frame.is_file() and frame.stat().st_mtime >= video.stat().st_mtime:
        return frame
    return None


def one_kind(project: Project, name: str) -> None:
    """A project has photos, or one video: raise a `Refusal` where another file would be both."""
    kinds = [path.suffix.lower() in VIDEOS for path in project.files()]
    video = Path(name).suffix.lower() in VIDEOS
    if any(kinds) or (video and kinds):
        raise Refusal("exists", "a project has photos or one video, not both: remove what is "
                      "there, or make a new project", name=name)


def photo_picture(project: Project, path: Path, size: int) -> Path:
    """A small JPEG of a photo, made once; `Refusal` if the photo can't be read, or is a video."""
    if size not in _SIDES:
        raise Refusal("bad_request", f"size must be one of {_SIDES}", field="size")
    state = path.stat()
    if path.suffix.lower() in VIDEOS:
        frame = _frame(project, path)
        if frame is None:
            raise Refusal("not_found", "a video has a picture once it is checked")
        return frame
    name = f"{id_of(path.name)}-{state.st_size:x}{state.st_mtime_ns:x}-{size}.jpg"
    target = project.own / "small" / name
    if not target.is_file():
        target.parent.mkdir(parents=True, exist_ok=True)
        small_picture(path, target, size)
    return target


def small_picture(path: Path, target: Path, size: int) -> None:
    """Write a picture's reduced copy, upright, as JPEG."""
    import numpy as np

    from ..media.colors import srgb

    try:
        with open_picture(path) as picture:
            picture.draft(None, (2 * size, 2 * size))
            upright = srgb(picture, file_of(picture))
            upright.thumbnail((size, size), Image.Resampling.LANCZOS)
            if upright.mode == "RGBA":
                upright = Image.alpha_composite(Image.new("RGBA", upright.size, "white"), upright)
            write_image(target, np.asarray(upright.convert("RGB")), quality=85)
    except (OSError, ValueError, SyntaxError, RuntimeError) as error:
        raise Refusal("user_error", f"{path.name} can't be read: it is damaged") from error


_PHOTO, _VIDEO = 128 << 20, 8 << 30  # Bytes of the largest photo and video.
_ROOM = 512 << 20  # Bytes that stay free on the disk.
_MOST = 500
_SLOWEST, _WITHIN = 16 << 10, 20.0  # Bytes that must come in so many seconds.
_BLOCK = 1 << 20
_HASH = re.compile("[0-9a-f]{64}")
_KEPT = 14 * 86400.0  # Seconds after which an unfinished upload is deleted.


@dataclass
class _Upload:
    """One photo that is expected."""

    project: Project
    name: str
    size: int
    sha256: str
    part: Path
    busy: bool = False


class Uploads:
    """The photos that are on their way."""

    def __init__(self) -> None:
        self._expected: dict[str, _Upload] = {}
        self._hashes: dict[tuple[str, tuple[int, ...]], str] = {}
        self._lock = threading.Lock()

    def announce(self, project: Project, files: Any) -> list[dict[str, Any]]:
        """What is to be done with each of the files that a page would send."""
        if not isinstance(files, list) or not 1 <= len(files) <= _MOST:
            raise Refusal("bad_request", f"files must be a list of 1 to {_MOST}", field="files")
        if project.calibrated:
            raise Refusal("exists", "the photos of this project are a calibrated data set; make a "
                          "new project for other photos")
        _sweep(project)
        here = self._here(project)
        return [self._announced(project, entry, here) for entry in files]

    def _here(self, project: Project) -> dict[str, Path]:
        """The photos of a project by their hashes."""
        found = {}
        for path in (*project.files(), *project.files(project.left_out)):
            key = str(path), file_state(path)
            if key not in self._hashes:
                with open(path, "rb") as stream:
                    self._hashes[key] = hashlib.file_digest(stream, "sha256").hexdigest()
            found[self._hashes[key]] = path
        return found

    def _announced(self, project: Project, entry: Any, here: dict[str, Path]) -> dict[str, Any]:
        found: dict[str, Any] = {"name": "", "state": "refused", "upload": None, "offset": 0,
                                 "photo": None, "error": None}
        try:
            name, size, digest = _checked(project, entry)
            found["name"] = name
            if digest and digest in here:
                return found | {"state": "have", "photo": id_of(here[digest].name)}
            part = project.own / "uploads" / f"{digest or secrets.token_hex(16)}.part"
            offset = part.stat().st_size if digest and part.is_file() else 0
            number = f"u-{secrets.token_hex(8)}"
            with self._lock:
                self._expected[number] = _Upload(project, name, size, digest, part)
                while len(self._expected) > 4 * _MOST:
                    del self._expected[next(iter(self._expected))]
            return found | {"state": "resume" if offset else "send", "upload": number,
                            "offset": min(offset, size)}
        except Refusal as error:
            sent = entry.get("name") if isinstance(entry, dict) else ""
            return found | {"name": str(sent)[:120], "error": error.entry()}

    async def receive(self, project: Project, number: str, offset: int, length: int,
                      body: AsyncIterator[bytes]) -> Path:
        """Take in what a page sends of an upload that `announce` named; the photo by its own name.

        The bytes begin at ``offset``, and ``length`` of them will come.
        """
        upload = self._taken(project, number)
        try:
            await self._written(upload, offset, length, body)
            path = await run_in_threadpool(self._finished, upload)
        except OSError as error:
            raise failed(error) from error
        finally:
            upload.busy = False
        with self._lock:
            self._expected.pop(number, None)
        return path

    def _taken(self, project: Project, number: str) -> _Upload:
        with self._lock:
            upload = self._expected.get(number)
            if upload is None or upload.project.id != project.id:
                raise Refusal("not_found", "this upload is not expected; announce the photo again")
            if any(other.busy and other.part == upload.part for other in self._expected.values()):
                raise Refusal("busy", f"{upload.name} is being sent already")
            upload.busy = True
        return upload

    async def _written(self, upload: _Upload, offset: int, length: int,
                       body: AsyncIterator[bytes]) -> None:
        part = upload.part
        part.parent.mkdir(parents=True, exist_ok=True)
        here = part.stat().st_size if part.is_file() else 0
        if offset != here and offset != 0:
            raise Refusal("exists", f"{here} bytes of {upload.name} are here", offset=here)
        if offset + length != upload.size:
            raise Refusal("bad_request", f"{upload.name} was announced with {upload.size} bytes",
                          field="offset")
        seen, began, block = offset, time.monotonic(), bytearray()
        window = seen
        with open(part, "r+b" if offset else "wb") as stream:
            stream.seek(offset)
            try:
                async for chunk in body:
                    seen += len(chunk)
                    if seen > upload.size:
                        raise Refusal("too_large", f"{upload.name} is longer than was announced")
                    block += chunk
                    if len(block) >= _BLOCK:
                        await run_in_threadpool(stream.write, bytes(block))
                        block.clear()
                    now = time.monotonic()
                    if now - began >= _WITHIN:
                        if seen - window < _SLOWEST and seen < upload.size:
                            raise Refusal("too_slow", f"{upload.name} comes too slowly; send it "
                                          "again: it goes on where it stopped")
                        began, window = now, seen
            finally:  # what came before the connection broke is kept
                await run_in_threadpool(stream.write, bytes(block))
        if seen < upload.size:
            raise Refusal("bad_request", f"{upload.name} broke off; send it again: it goes on "
                          "where it stopped")

    def _finished(self, upload: _Upload) -> Path:
        """Check the hash, and give the photo its name."""
        with open(upload.part, "rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
        if upload.sha256 and digest != upload.sha256:
            upload.part.unlink()
            raise Refusal("bad_hash", f"{upload.name} was damaged on its way; send it again")
        project = upload.project
        with self._lock:
            here = self._here(project)
            if digest in here:
                upload.part.unlink()
                return here[digest]
            project.photos.mkdir(exist_ok=True)
            one_kind(project, upload.name)
            taken = {path.name for place in (project.photos, project.left_out)
                     if place.is_dir() for path in place.iterdir()}
            target = project.photos / free_name(upload.name, taken)
            os.replace(upload.part, target)
        return target


def _checked(project: Project, entry: Any) -> tuple[str, int, str]:
    """Name, size and hash of a file that a page would send."""
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise Refusal("bad_request", "each file needs a name, a size and a sha256", field="files")
    name, suffix = file_name(entry["name"])
    size, digest = entry.get("size"), entry.get("sha256") or ""
    if suffix in RAW:
        raise Refusal("bad_type", f"{name}: raw photos are not read; export it as JPEG or TIFF",
                      name=name)
    if suffix not in PHOTOS | VIDEOS:
        raise Refusal("bad_type", f"{name} is no photo and no video", name=name)
    if isinstance(size, bool) or not isinstance(size, int) or size < 1:
        raise Refusal("bad_request", f"{name} is empty", field="size", name=name)
    if not isinstance(digest, str) or (digest and not _HASH.fullmatch(digest)):
        raise Refusal("bad_request", f"{name}: sha256 must be 64 hexadecimal digits",
                      field="sha256")
    if not digest and suffix not in VIDEOS:
        raise Refusal("bad_request", f"{name} needs its sha256", field="sha256")
    most = _VIDEO if suffix in VIDEOS else _PHOTO
    if size > most:
        raise Refusal("too_large", f"{name} has {size / 2 ** 20:.0f} MB; {most / 2 ** 20:.0f} are "
                      "the most", name=name)
    one_kind(project, name)
    free = free_disk_bytes(project.folder)
    if size + _ROOM > free:
        raise Refusal("disk_full", f"{name} does not fit: {free / 1e9:.1f} GB are free; make room, "
                      "then send it again", name=name, free_bytes=free)
    return name, size, digest


def _sweep(project: Project) -> None:
    """Delete uploads that were never finished."""
    for path in (project.own / "uploads").glob("*.part"):
        if time.time() - path.stat().st_mtime > _KEPT:
            path.unlink(missing_ok=True)
