"""The command line: one command per stage, one data class a command."""

from .dispatch import COMMANDS, main

__all__ = ["COMMANDS", "main"]
