"""Lenticular prints: a page of ink behind a sheet of lenses, one ray for each printed pixel.

A print is a `Display` (`PrintSheet`): its columns are the printer's pixels, its lenses those of the
sheet, and the three colors of a pixel lie in its middle. So prints are coded as panels are, never
from finished views. `fitted` places the head within the depth that the sheet shows sharply; pages
are coded and written in bands (`write_print`), as are test pages for pitch and phase
(`write_pitch_test`) and the height map of the lenses (`write_lenses`), for printers that print
these, too. `SheetView` is what an eye sees through the lenses.
"""

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .config import PrintConfig
    from .depth import PrintDepth, fitted
    from .files import check_file
    from .lenses import write_lenses
    from .pages import write_print
    from .sheet import PrintSheet
    from .sizes import paper_size
    from .trial import write_pitch_test
    from .view import SheetView, through_lenses

__all__ = ["PrintConfig", "PrintDepth", "PrintSheet", "SheetView", "check_file", "fitted",
           "paper_size", "through_lenses", "write_lenses", "write_pitch_test", "write_print"]

__getattr__, __dir__ = attach(__name__, __file__)
