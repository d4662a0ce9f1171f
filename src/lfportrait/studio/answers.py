"""Answers of the server: JSON, errors with a fixed code, and fields of a request that are checked.

An error is ``{"error": {"code", "message", "about"}}``: the page translates the code, and shows the
message, one English sentence, where it knows no other.
"""

from __future__ import annotations

import errno
import math
import re
from collections.abc import Mapping
from typing import Any

from starlette.responses import JSONResponse, Response

from ..errors import UserError

__all__ = [
    "STATUS",
    "Refusal",
    "choice",
    "failed",
    "number",
    "numbers",
    "on_page",
    "points",
    "text",
    "truth",
    "whole",
]

STATUS = {
    "bad_request": 400, "bad_name": 400, "no_session": 401, "refused": 403, "not_found": 404,
    "too_slow": 408, "busy": 409, "exists": 409, "not_ready": 409, "no_length": 411,
    "too_large": 413, "bad_type": 415, "user_error": 422, "bad_hash": 422, "internal": 500,
    "preview_lost": 503, "disk_full": 507}
"""The codes of errors, and the HTTP status of each."""

_LONGEST = 80
"""Characters of a name."""


class Refusal(Exception):
    """A request that is not done.

    Parameters
    ----------
    code
        One of `STATUS`.
    message
        One sentence: what is wrong and what to do.
    about
        Facts for the page.
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


_UNWRITTEN = re.compile(r"can't write (.*): (.*); (?:free some space or )?"
                        r"choose another output with --out")


def on_page(message: str) -> str:
    """An error's message without advice that is only of use on the command line."""
    found = _UNWRITTEN.fullmatch(message)
    return message if found is None else unwritten(*found.groups())


def unwritten(path: object, reason: object) -> str:
    """What is said where a file can't be written."""
    return (f"can't write {path}: {reason}; see that its folder may be written to, then try it "
            "once more")


def failed(error: BaseException) -> Refusal:
    """Any error as a refusal: the user's, a full disk, or a fault of ours."""
    if isinstance(error, Refusal):
        return error
    full = errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)
    if isinstance(error, OSError) and error.errno in full:
        return Refusal("disk_full", "the disk is full: make room, then go on; nothing is lost")
    if isinstance(error, UserError):
        if "No space left" in str(error):
            return Refusal("disk_full", f"{error}")
        return Refusal("user_error", on_page(str(error)))
    if isinstance(error, OSError) and error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        return Refusal("user_error", unwritten(error.filename or "a file", error.strerror))
    return Refusal("internal", f"internal error: {type(error).__name__}: "
                   f"{' '.join(str(error).split())}")


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
