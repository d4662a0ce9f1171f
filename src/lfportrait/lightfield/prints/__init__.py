"""Lenticular prints: a page of ink behind a sheet of lenses, one ray for each printed pixel.

A print is a `Display` (`PrintSheet`): its columns are the printer's pixels, its lenses those of the
sheet, and the three colors of a pixel lie in its middle. So prints are coded as panels are, never
from finished views. `fitted` places the head within the depth that the sheet shows sharply; pages
are coded and written in bands (`write_print`), as are test pages for pitch and phase
(`write_pitch_test`) and the height map of the lenses (`write_lenses`), for printers that print
these, too. `SheetView` is what an eye sees through the lenses.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
