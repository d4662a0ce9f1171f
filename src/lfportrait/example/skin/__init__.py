"""Painting on the skin: a head's surface as an atlas of charts, painted once for all views.

`charts` looks at a field from all around, `sitter` adds what the sitter shows where, `painting`
paints it by one exemplar.
"""

from .charts import Atlas, draw_atlas
from .painting import Painting, SkinConfig, SkinPainter, rehearse_painting
from .sitter import PIXELS, Skin, canvas_of, face_pixels
from .storage import as_stored, load_skin, save_skin, skin_key

__all__ = ["PIXELS", "Atlas", "Painting", "Skin", "SkinConfig", "SkinPainter", "as_stored",
           "canvas_of", "draw_atlas", "face_pixels", "load_skin", "rehearse_painting", "save_skin",
           "skin_key"]
