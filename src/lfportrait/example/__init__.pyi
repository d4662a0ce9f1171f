from .exemplar import Exemplar, face_size
from .frontal import FRONTAL, PROFILE, frontal_view, head_mesh, suited
from .guides.filters import appearance_guide
from .guides.position import Guides, position_guide
from .guides.regions import FaceFrame, Regions, find_regions, photo_regions
from .lids import Lids, asked_lids, closed_words, eye_opening, eye_openings, shut_eyes
from .methods import Method, MethodConfig, PhotoMethod, Sitting, paint, photo_method, prepare
from .painter.ground import GroundSize, known_ground
from .painter.picture_materials import painted_shares
from .patches import PatchSearch
from .skin import Atlas, Painting, Skin, SkinConfig, SkinPainter, draw_atlas
from .styleblit import BlitConfig, Synthesis, TransferResult, synthesise
from .surface_guide import SurfaceGuide, surface_position_guide
from .table import LookUpTable, TableConfig, build_table
from .transfers import (
    Transfer,
    TransferConfig,
    as_painted,
    face_landmarks,
    fitting,
    from_the_front,
    mix_regions,
    transfer,
)
from .video import VideoTransfer
from .worn import bared, spectacles, without_spectacles

__all__ = [
    "FRONTAL",
    "PROFILE",
    "Atlas",
    "BlitConfig",
    "Exemplar",
    "FaceFrame",
    "GroundSize",
    "Guides",
    "Lids",
    "LookUpTable",
    "Method",
    "MethodConfig",
    "Painting",
    "PatchSearch",
    "PhotoMethod",
    "Regions",
    "Sitting",
    "Skin",
    "SkinConfig",
    "SkinPainter",
    "SurfaceGuide",
    "Synthesis",
    "TableConfig",
    "Transfer",
    "TransferConfig",
    "TransferResult",
    "VideoTransfer",
    "appearance_guide",
    "as_painted",
    "asked_lids",
    "bared",
    "build_table",
    "closed_words",
    "draw_atlas",
    "eye_opening",
    "eye_openings",
    "face_landmarks",
    "face_size",
    "find_regions",
    "fitting",
    "from_the_front",
    "frontal_view",
    "head_mesh",
    "known_ground",
    "mix_regions",
    "paint",
    "painted_shares",
    "photo_method",
    "photo_regions",
    "position_guide",
    "prepare",
    "shut_eyes",
    "spectacles",
    "suited",
    "surface_position_guide",
    "synthesise",
    "transfer",
    "without_spectacles",
]
