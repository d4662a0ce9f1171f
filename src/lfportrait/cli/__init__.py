"""The command line: a data class for each command, its fields are the options.

`dispatch` knows all commands; the other modules hold them by theme.
"""

from .dispatch import COMMANDS, main, program

__all__ = ["COMMANDS", "main", "program"]
