"""Errors that are the user's to mend, as opposed to faults of ours."""

__all__ = ["UserError"]


class UserError(Exception):
    """A mistake in the input: one line that says what is wrong and what to do about it.

    The command line prints the message alone, on standard error, and exits with code 2. Any other
    exception is a fault of lfportrait's and exits with code 1.
    """
