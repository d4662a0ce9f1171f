"""How well a person is kept in a painter's manner, by what one looks at first in a face.

`gaze` and `mouth`, the `forehead`, and `seams` between pieces of paint; `sitters` prepares people
and paintings and measures a pair, `report` holds the limits and prints tables.
"""

from .forehead import Tones, forehead_found, forehead_region, tones_of
from .gaze import Eyes, dark_gaze, eyes_seen, gaze_found
from .mouth import corners_found, painters_corners
from .report import LIMITS, counts, people_table, people_table_compared
from .seams import face_seams, seam_found
from .sitters import PreparedPainting, Sitter, people_found

__all__ = ["LIMITS", "Eyes", "PreparedPainting", "Sitter", "Tones", "corners_found", "counts",
           "dark_gaze", "eyes_seen", "face_seams", "forehead_found", "forehead_region",
           "gaze_found", "painters_corners", "people_found", "people_table",
           "people_table_compared", "seam_found", "tones_of"]
