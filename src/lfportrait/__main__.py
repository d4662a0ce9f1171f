"""``python -m lfportrait`` is the command line."""

import sys

from .cli.dispatch import program

sys.exit(program())
