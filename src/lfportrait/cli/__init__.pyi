from .common import Common
from .dispatch import COMMANDS, main, program

__all__ = ["COMMANDS", "Common", "main", "program"]
