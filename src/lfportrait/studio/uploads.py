"""Uploads: one streamed request a photo, resumed by its hash.

What comes goes into ``.studio/uploads/HASH.part`` of the project and gets its name when it is
complete and its SHA-256 is the announced one. A broken connection keeps what came: the next request
says how much that is. Photos that are here already, by their hash, are not sent again.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import threading
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool

from ..files import file_state
from ..measure import free_disk_bytes
from ..media.kinds import PHOTOS, RAW, VIDEOS
from .answers import Refusal, failed, file_name, free_name, id_of
from .photos import one_kind
from .projects import Project

__all__ = ["Uploads"]

_PHOTO, _VIDEO = 128 << 20, 8 << 30
"""Bytes of the largest photo and video."""
_ROOM = 512 << 20
"""Bytes that stay free on the disk."""
_MOST = 500
_SLOWEST, _WITHIN = 16 << 10, 20.0
"""Bytes that must come in so many seconds."""
_BLOCK = 1 << 20
_HASH = re.compile("[0-9a-f]{64}")
_KEPT = 14 * 86400.0
"""Seconds after which an unfinished upload is deleted."""


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
        """Take in what a page sends; the photo under its own name.

        Parameters
        ----------
        project, number
            Of the upload, as `announce` said.
        offset
            Where the bytes begin.
        length
            How many will come.
        body
            The bytes.
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
