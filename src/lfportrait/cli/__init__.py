"""The command line: a data class for each command, its fields are the options.

`dispatch` knows all commands; the other modules hold them by theme. A command of another package is
a data class of the same kind (`Common`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
