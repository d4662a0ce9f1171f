from .depth import PrintDepth, SheetView, fitted, through_lenses
from .pages import check_file, write_lenses, write_pitch_test, write_print
from .sheet import PrintConfig, PrintSheet, paper_size

__all__ = ["PrintConfig", "PrintDepth", "PrintSheet", "SheetView", "check_file", "fitted",
           "paper_size", "through_lenses", "write_lenses", "write_pitch_test", "write_print"]
