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
