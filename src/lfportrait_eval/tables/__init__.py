"""The paper's comparisons: every method on the same fields and views, every figure in one table.

`run` does the work cell by cell (a sitter in a style by a method) and resumes, and measures speed
(Table 1, Fig. 6); `methods` say who is painted and how, and make a cell's views, `figures` measure
them, `documents` sum up and write it down.
"""

from .documents import BEGIN, COLUMNS, END, Cell, Spread, fill_document, place_in, spreads
from .figures import Target, agreement, measure, missing_networks, photo_agreement, photo_pairs
from .methods import (
    METHODS,
    MethodEntry,
    Sitter,
    Sizes,
    Source,
    TablesConfig,
    Views,
    paint_views,
    real_views,
    sources_of,
)
from .run import write_tables

__all__ = ["BEGIN", "COLUMNS", "END", "METHODS", "Cell", "MethodEntry", "Sitter", "Sizes", "Source",
           "Spread", "TablesConfig", "Target", "Views", "agreement", "fill_document", "measure",
           "missing_networks", "paint_views", "photo_agreement", "photo_pairs", "place_in",
           "real_views", "sources_of", "spreads", "write_tables"]
