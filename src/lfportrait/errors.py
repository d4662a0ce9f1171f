"""Errors that the user can correct, as opposed to internal errors."""

import re

_LONGEST = 1500  # Letters of a message: more is what a damaged file holds, not what anybody reads.


class UserError(Exception):
    """An error that the user can correct: one line that says what is wrong and what to do.

    The command line prints the message alone, on standard error, and exits with code 2. Any other
    exception is a fault of lfportrait's and exits with code 1. What a file holds may be quoted in
    it: line breaks and control characters become spaces, and the middle of what is endless goes.
    """

    def __init__(self, message: object = "") -> None:
        line = re.sub(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+\s*", " ", str(message))
        super().__init__(line if len(line) <= _LONGEST else
                         f"{line[:_LONGEST * 3 // 4]} ... {line[-_LONGEST // 4:]}")
