"""What any error means to the user: whose it is, and one line about it."""

from __future__ import annotations

import errno
import traceback
from dataclasses import dataclass

from ..errors import UserError

__all__ = ["Failure", "failure_of"]

_FULL = {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)}
_FORBIDDEN = {errno.EACCES, errno.EPERM, errno.EROFS}


@dataclass(frozen=True)
class Failure:
    """An error, read.

    Attributes
    ----------
    code
        ``user_error``, ``disk_full``, ``memory``, or ``internal``: a fault of ours.
    message
        One line: what is wrong and what to do.
    trace
        Where a fault of ours was; else empty.
    """

    code: str
    message: str
    trace: str = ""


def failure_of(error: BaseException) -> Failure:
    """What an error means."""
    line = " ".join(str(error).split())
    if isinstance(error, UserError):
        return Failure("disk_full" if "No space left" in line else "user_error", line)
    if isinstance(error, OSError) and error.errno in _FULL:
        where = f": {error.filename}" if error.filename else ""
        return Failure("disk_full", f"no space is left on a disk{where}; free some, or choose "
                       "folders with more room (--out, and TMPDIR for temporary files)")
    if isinstance(error, OSError) and error.errno in _FORBIDDEN:
        return Failure("user_error", f"can't write {error.filename or 'a file'}: {error.strerror}; "
                       "see that its folder may be written to, then try it once more")
    if isinstance(error, MemoryError):
        return Failure("memory", "the memory is too small: close other programs, let fewer tasks "
                       "of a batch run at once (--workers), or make the field smaller "
                       "(reconstruct.max_voxels)")
    if type(error).__name__ == "OutOfMemoryError":  # torch's, which is not imported for this
        return Failure("memory", "the GPU has too little memory for this: use --device cpu")
    return Failure("internal", f"internal error: {type(error).__name__}: {line}",
                   "".join(traceback.format_exception(error)))
