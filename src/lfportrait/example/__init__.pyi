from .exemplar import Exemplar, face_size
from .frontal import FRONTAL, PROFILE, frontal_view, head_mesh, suited
from .guides.position import Guides, position_guide
from .guides.regions import Regions, find_regions
from .lids import Lids, asked_lids, closed_words, eye_openings, shut_eyes
from .mouth import parts_lips
from .painter.ground import GroundSize, known_ground
from .painter.picture_materials import painted_shares
from .skin.charts import Atlas, draw_atlas
from .skin.painting import Painting, SkinConfig, SkinPainter, rehearse_painting
from .skin.sitter import SKIN_PIXELS, Skin, canvas_of
from .skin.storage import as_stored, load_skin, save_skin, skin_key
from .styleblit import BlitConfig, Style, TableConfig, TransferResult, build_table, synthesise
from .surface_guide import SurfaceGuide
from .transfers import (
    Method,
    MethodConfig,
    PhotoMethod,
    Sitting,
    Transfer,
    TransferConfig,
    as_painted,
    face_landmarks,
    fitting,
    mix_regions,
    photo_method,
    prepare,
    transfer,
)
from .video import VideoTransfer
from .worn.hat import Wear, not_worn
from .worn.inpainting import bared

__all__ = [
    "FRONTAL",
    "PROFILE",
    "SKIN_PIXELS",
    "Atlas",
    "BlitConfig",
    "Exemplar",
    "GroundSize",
    "Guides",
    "Lids",
    "Method",
    "MethodConfig",
    "Painting",
    "PhotoMethod",
    "Regions",
    "Sitting",
    "Skin",
    "SkinConfig",
    "SkinPainter",
    "Style",
    "SurfaceGuide",
    "TableConfig",
    "Transfer",
    "TransferConfig",
    "TransferResult",
    "VideoTransfer",
    "Wear",
    "as_painted",
    "as_stored",
    "asked_lids",
    "bared",
    "build_table",
    "canvas_of",
    "closed_words",
    "draw_atlas",
    "eye_openings",
    "face_landmarks",
    "face_size",
    "find_regions",
    "fitting",
    "frontal_view",
    "head_mesh",
    "known_ground",
    "load_skin",
    "mix_regions",
    "not_worn",
    "painted_shares",
    "parts_lips",
    "photo_method",
    "position_guide",
    "prepare",
    "rehearse_painting",
    "save_skin",
    "shut_eyes",
    "skin_key",
    "suited",
    "synthesise",
    "transfer",
]
