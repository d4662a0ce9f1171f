"""Errors of any kind in one line."""

import errno

import pytest

from lfportrait.errors import UserError
from lfportrait.runner import failure_of


@pytest.mark.parametrize("error, code, message", [
    (UserError("name the\nfolder"), "user_error", "name the folder"),
    (UserError("can't write a: No space left on device"), "disk_full", "can't write a"),
    (OSError(errno.ENOSPC, "full", "/a/b"), "disk_full", "/a/b; free some"),
    (PermissionError(errno.EACCES, "Permission denied", "/a"), "user_error",
     "can't write /a: Permission denied; see that"),
    (MemoryError(), "memory", "--workers"),
    (KeyError("nothing"), "internal", "internal error: KeyError: 'nothing'")])
def test_errors_are_read(error, code, message):
    try:
        raise error
    except Exception as caught:
        found = failure_of(caught)
    assert found.code == code and message in found.message and "\n" not in found.message
    assert ("Traceback" in found.trace) == (code == "internal")
