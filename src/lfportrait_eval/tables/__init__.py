"""The paper's comparisons: every method on the same fields and views, every figure in one table.

`run` does the work cell by cell (a sitter in a style by a method) and resumes; `sitters` and
`methods` say who is painted and how, `painting` makes a cell's views, `figures`
measure them, `speed` is Table 1 and Fig. 6; `summary` and `documents` write it down.
"""

from .config import TablesConfig
from .documents import BEGIN, END, fill_document, place_in
from .figures import Target, agreement, measure, missing_networks, photo_agreement, photo_pairs
from .methods import METHODS, MethodEntry, Sizes
from .painting import Views, paint_views, real_views
from .run import write_tables
from .sitters import Sitter, Source, sources_of
from .summary import COLUMNS, Cell, Spread, spreads

__all__ = ["BEGIN", "COLUMNS", "END", "METHODS", "Cell", "MethodEntry", "Sitter", "Sizes", "Source",
           "Spread", "TablesConfig", "Target", "Views", "agreement", "fill_document", "measure",
           "missing_networks", "paint_views", "photo_agreement", "photo_pairs", "place_in",
           "real_views", "sources_of", "spreads", "write_tables"]
