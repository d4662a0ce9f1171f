"""Answers of the server: JSON, errors with a fixed code, and fields of a request that are checked.

An error is ``{"error": {"code", "message", "about"}}``: the page translates the code, and shows the
message, one English sentence, where it knows no other.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from starlette.responses import JSONResponse, Response

from ..errors import UserError
from ..runner import failure_of

__all__ = [
    "STATUS",
    "Refusal",
    "choice",
    "failed",
    "number",
    "numbers",
    "points",
    "text",
    "truth",
    "whole",
]

STATUS = {
    "bad_request": 400, "bad_name": 400, "no_session": 401, "refused": 403, "not_found": 404,
    "too_slow": 408, "busy": 409, "exists": 409, "not_ready": 409, "no_length": 411,
    "too_large": 413, "bad_type": 415, "user_error": 422, "bad_hash": 422, "internal": 500,
    "preview_lost": 503, "killed": 503, "disk_full": 507}
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
