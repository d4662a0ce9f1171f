"""``python -m lfportrait`` is the command line."""

import sys

from .cli.dispatch import main

sys.exit(main())
