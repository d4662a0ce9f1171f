"""The command line: a data class for each command, its fields are the options.

`dispatch` knows all commands; the other modules hold them by theme. A command of another package is
a data class of the same kind (`Common`).
"""

from typing import TYPE_CHECKING

from ..lazy import attach
from .dispatch import COMMANDS, main, program

if TYPE_CHECKING:
    from .common import Common

__all__ = ["COMMANDS", "Common", "main", "program"]

__getattr__, __dir__ = attach(__name__, __file__)
