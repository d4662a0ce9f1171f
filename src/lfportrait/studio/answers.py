"""What the page sends, gets and hears: checked fields, names and ids; JSON, errors, events.

An error is ``{"error": {"code", "message", "about"}}``: the page translates the code, and shows the
message, one English sentence, where it knows no other.

The page sends ids alone, which are never paths: the server lists a folder and compares. Names come
from people and their files; each is cleaned into one that every system takes as a file's name.

What happens, pages hear as server-sent lines (`Events`): numbered, replayed to one that comes back.
"""

import asyncio
import hashlib
import json
import math
import re
import threading
import unicodedata
from collections import deque
from collections.abc import AsyncIterator, Collection, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from starlette.responses import JSONResponse, Response

from ..errors import UserError
from ..files import DEVICES
from ..runner import Failure, failure_of

STATUS = {
    "bad_request": 400, "bad_name": 400, "no_session": 401, "refused": 403, "not_found": 404,
    "too_slow": 408, "busy": 409, "exists": 409, "not_ready": 409, "no_length": 411,
    "too_large": 413, "bad_type": 415, "user_error": 422, "bad_hash": 422, "internal": 500,
    "preview_lost": 503, "killed": 503, "disk_full": 507}
"""The codes of errors, and the HTTP status of each."""

_LONGEST = 80  # Characters of a name.


class Refusal(Exception):
    """A request that is not done.

    A code of `STATUS`, a sentence with what is wrong and what to do, and facts for the page.
    """

    def __init__(self, code: str, message: str, **about: Any) -> None:
        super().__init__(message)
        self.code, self.message, self.about = code, message, about

    def entry(self) -> dict[str, Any]:
        """As JSON."""
        return {"code": self.code, "message": self.message, "about": self.about}

    def answer(self) -> Response:
        """As a response."""
        return JSONResponse({"error": self.entry()}, STATUS[self.code])


_UNWRITTEN = re.compile(r"^can't write (.*): (.*); (?:free some space or )?"
                        r"choose another output with --out$")


def failed(error: BaseException) -> Refusal:
    """Any error as a refusal (`lfportrait.runner.failure_of`), with advice for the page."""
    if isinstance(error, Refusal):
        return error
    found = failure_of(error)
    if isinstance(error, UserError):
        return Refusal(found.code, _UNWRITTEN.sub(
            r"can't write \1: \2; see that its folder may be written to, then try it once more",
            found.message))
    if found.code == "disk_full":
        return Refusal("disk_full", "the disk is full: make room, then go on; nothing is lost")
    if found.code == "memory":
        return Refusal("killed", "the memory is too small: close other programs, or make the field "
                       "smaller (reconstruct.max_voxels)")
    return Refusal(found.code, found.message)


def read_error(error: BaseException) -> Failure:
    """Any error of the studio's own processes, and where a fault of ours was."""
    refusal = failed(error)
    return Failure(refusal.code, refusal.message, failure_of(error).trace
                   if refusal.code == "internal" else "")


def _wrong(field: str, words: str) -> Refusal:
    return Refusal("bad_request", f"{field} must be {words}", field=field)


def text(data: Mapping[str, Any], field: str, default: str | None = None,
         longest: int = _LONGEST) -> str:
    """A text of a request, without spaces around it; control characters are refused."""
    value = data.get(field, default)
    if not isinstance(value, str) or len(value) > longest or any(ord(c) < 32 for c in value[:200]):
        raise _wrong(field, f"a text of at most {longest} characters on one line")
    return value.strip()


def choice(data: Mapping[str, Any], field: str, known: tuple[str, ...],
           default: str | None = None) -> str:
    """One of some words."""
    value = data.get(field, default)
    if value not in known:
        raise _wrong(field, f"one of {', '.join(known)}")
    return str(value)


def truth(data: Mapping[str, Any], field: str, default: bool = False) -> bool:
    """True or false."""
    value = data.get(field, default)
    if not isinstance(value, bool):
        raise _wrong(field, "true or false")
    return value


def number(data: Mapping[str, Any], field: str, low: float, high: float,
           default: float | None = None) -> float:
    """A finite number in a range."""
    value = data.get(field, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or (
            not math.isfinite(value) or not low <= value <= high):
        raise _wrong(field, f"a number from {low:g} to {high:g}")
    return float(value)


def whole(data: Mapping[str, Any], field: str, low: int, high: int,
          default: int | None = None) -> int:
    """A whole number in a range."""
    value = number(data, field, low, high, default)
    if value != int(value):
        raise _wrong(field, f"a whole number from {low} to {high}")
    return int(value)


def numbers(data: Mapping[str, Any], field: str, count: int, bound: float = 1e6) -> list[float]:
    """So many finite numbers, each of at most ``bound``."""
    value = data.get(field)
    if not isinstance(value, list) or len(value) != count:
        raise _wrong(field, f"a list of {count} numbers")
    return [number({field: one}, field, -bound, bound) for one in value]


def points(data: Mapping[str, Any], field: str) -> list[list[float]]:
    """The 68 landmarks: 68 pairs of pixels."""
    value = data.get(field)
    if not isinstance(value, list) or len(value) != 68:
        raise _wrong(field, "a list of 68 points [x, y]")
    return [numbers({field: one}, field, 2) for one in value]


_ID = re.compile(r"[a-z0-9][a-z0-9-]{0,79}")
_FORBIDDEN = re.compile(r'[\x00-\x1f\x7f/\\:*?"<>|]')
_FORMLESS = ("Cf", "Cs", "Co", "Cn")  # Signs that are not seen, or that nobody knows.
_LONGEST_NAME = 120


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

    Raises `Refusal` if it can't: it is empty, hidden, a device's, or holds what paths are made of.
    """
    name = unicodedata.normalize("NFC", name).strip()
    stem = name.partition(".")[0].strip().lower()
    if (not name or len(name) > _LONGEST_NAME or name[0] == "." or name[-1] == "."
            or _FORBIDDEN.search(name) or stem in DEVICES
            or any(unicodedata.category(sign) in _FORMLESS for sign in name)):
        raise Refusal("bad_name", f"{name[:_LONGEST]!r} can't be a file's name: leave out / \\ : "
                      '* ? " < > | and dots at its ends', name=name[:_LONGEST_NAME])
    return name


def folder_name(title: str) -> str:
    """A folder's name for a title: what no name may hold becomes a dash, also signs without form.

    Raises `Refusal` if nothing is left of it.
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


def free_place(folder: Path, name: str) -> Path:
    """Where a thing of this name goes in a folder, which is made if missing (`free_name`)."""
    folder.mkdir(parents=True, exist_ok=True)
    return folder / free_name(name, [path.name for path in folder.iterdir()])


def stamp_of(state: Any, digits: int = 16) -> str:
    """Changes when a state does, which is compared as it is printed."""
    return hashlib.sha256(repr(state).encode()).hexdigest()[:digits]


_KEPT = 1000
_WAITING = 500  # Lines that a page may be behind; a page that does not read any more is let go.
_ALIVE = 15.0  # Seconds between two lines at least, so that both ends see a broken connection.


class Events:
    """The events of one run of the server. `tell` may be called from any thread."""

    def __init__(self) -> None:
        self.number = 0
        self._kept: deque[tuple[int, str]] = deque(maxlen=_KEPT)
        self._pages: set[asyncio.Queue[str | None]] = set()
        self._lock = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closed = False

    def tell(self, kind: str, data: Any = None, *, numbered: bool = True) -> None:
        """Tell all pages."""
        text = json.dumps({} if data is None else data, separators=(",", ":"))
        with self._lock:
            line = f"event: {kind}\ndata: {text}\n\n"
            if numbered:
                self.number += 1
                line = f"id: {self.number}\n{line}"
                self._kept.append((self.number, line))
            loop = self._loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._send, line)

    def _send(self, line: str) -> None:
        for page in list(self._pages):
            if page.qsize() >= _WAITING:
                self._pages.discard(page)
                while not page.empty():
                    page.get_nowait()
                page.put_nowait(None)
            else:
                page.put_nowait(line)

    def after(self, number: int | None) -> list[str]:
        """The lines after a number, or a reset where they are not known any more."""
        with self._lock:
            if number is None or number == self.number:
                return []
            oldest = self._kept[0][0] if self._kept else self.number + 1
            if not oldest - 1 <= number <= self.number:
                return [f"id: {self.number}\nevent: reset\ndata: {{}}\n\n"]
            return [line for count, line in self._kept if count > number]

    async def stream(self, number: int | None) -> AsyncIterator[str]:
        """The lines after a number for one page, as long as it listens.

        The number is that of the last line that it has seen; None: it has just asked for the state.
        """
        page: asyncio.Queue[str | None] = asyncio.Queue()
        with self._lock:
            self._loop = asyncio.get_running_loop()
            hello = f'event: hello\ndata: {{"event":{self.number}}}\n\n'
        # Between these two nothing is sent: the loop is ours until the next await.
        lines = self.after(number)
        self._pages.add(page)
        try:
            yield hello + "".join(lines)
            while not self._closed:
                try:
                    line = await asyncio.wait_for(page.get(), _ALIVE)
                except TimeoutError:
                    line = ": alive\n\n"
                if line is None:
                    return
                yield line
        finally:
            self._pages.discard(page)

    def close(self) -> None:
        """Let all pages go."""
        self._closed = True
        for page in list(self._pages):
            page.put_nowait(None)
