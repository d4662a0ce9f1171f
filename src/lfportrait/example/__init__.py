"""Transfer by example: any portrait repainted in the manner of one painting (Paper 2.2, Eq. 6).

An `Exemplar` is the painting, a `Transfer` repaints photos by it: `guides` say which place of the
painting answers a pixel, `table` looks it up, `styleblit` copies pieces. `surface_guide` does it on
a head, the same from every side; `video` is for moving pictures; `methods` finds those of other
packages.
"""

from typing import TYPE_CHECKING

from ..lazy import attach

if TYPE_CHECKING:
    from .exemplar import Exemplar, face_size
    from .guides.appearance import appearance_guide
    from .guides.face_frame import FaceFrame
    from .guides.maps import Guides
    from .guides.position import position_guide
    from .guides.regions import Regions, find_regions
    from .guides.scalp import photo_regions
    from .lids import Lids, asked_lids, closed_words, eye_opening, eye_openings, shut_eyes
    from .methods import Method, MethodConfig, PhotoMethod, paint, photo_method, prepare
    from .painter.ground import GroundConfig, known_ground
    from .painter.picture_materials import painted_shares
    from .patches import PatchConfig
    from .providers import Sitting, provided_styles
    from .region_styles import mix_regions
    from .skin import Atlas, Painting, Skin, SkinConfig, SkinPainter, draw_atlas
    from .styleblit import BlitConfig, Synthesis, synthesise
    from .surface_guide import SurfaceGuide, surface_position_guide
    from .table import LookUpTable, TableConfig, build_table
    from .transfers import Transfer, TransferConfig, TransferResult, face_landmarks, transfer
    from .turned import FRONTAL, PROFILE, frontal_view, head_mesh, suited
    from .versions import as_painted, fitting, from_the_front
    from .video import VideoTransfer
    from .worn import bared, spectacles, without_spectacles

__all__ = [
    "FRONTAL",
    "PROFILE",
    "Atlas",
    "BlitConfig",
    "Exemplar",
    "FaceFrame",
    "GroundConfig",
    "Guides",
    "Lids",
    "LookUpTable",
    "Method",
    "MethodConfig",
    "Painting",
    "PatchConfig",
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
    "provided_styles",
    "shut_eyes",
    "spectacles",
    "suited",
    "surface_position_guide",
    "synthesise",
    "transfer",
    "without_spectacles",
]

__getattr__, __dir__ = attach(__name__, __file__, dict.fromkeys(
    ("FaceBlit", "FaceBlitConfig", "FaceStyle", "FaceStyleConfig", "NetworkConfig", "Painted",
     "StyleNetwork"), "lfportrait_eval.baselines.transfer"))
