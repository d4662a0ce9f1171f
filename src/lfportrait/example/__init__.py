"""Transfer by example: any portrait repainted in the manner of one painting (Paper 2.2, Eq. 6).

An `Exemplar` is the painting, a `Transfer` repaints photos by it: `guides` say which place of the
painting answers a pixel, `table` looks it up, `styleblit` copies pieces. `surface_guide` does it on
a head, the same from every side; `rivals` are other methods, `video` is for moving pictures.
"""

from typing import TYPE_CHECKING

from ..lazy import attach

if TYPE_CHECKING:
    from .exemplar import Exemplar, face_size
    from .guides.appearance import appearance_guide
    from .guides.maps import Guides
    from .guides.position import position_guide
    from .guides.regions import Regions, find_regions
    from .methods import METHODS, Method, MethodConfig, paint, prepare
    from .patches import PatchConfig
    from .providers import Sitting, provided_styles
    from .region_styles import mix_regions
    from .rivals import (
        FaceBlit,
        FaceBlitConfig,
        FaceStyle,
        FaceStyleConfig,
        NetworkConfig,
        Painted,
        StyleNetwork,
    )
    from .skin import Painting, Skin, SkinConfig, SkinPainter
    from .styleblit import BlitConfig, Synthesis, synthesise
    from .surface_guide import SurfaceGuide, surface_position_guide
    from .table import LookUpTable, TableConfig, build_table
    from .transfers import Transfer, TransferConfig, TransferResult, face_landmarks, transfer
    from .turned import FRONTAL, PROFILE, frontal_view, head_mesh, suited
    from .video import VideoTransfer

__all__ = [
    "FRONTAL",
    "METHODS",
    "PROFILE",
    "BlitConfig",
    "Exemplar",
    "FaceBlit",
    "FaceBlitConfig",
    "FaceStyle",
    "FaceStyleConfig",
    "Guides",
    "LookUpTable",
    "Method",
    "MethodConfig",
    "NetworkConfig",
    "Painted",
    "Painting",
    "PatchConfig",
    "Regions",
    "Sitting",
    "Skin",
    "SkinConfig",
    "SkinPainter",
    "StyleNetwork",
    "SurfaceGuide",
    "Synthesis",
    "TableConfig",
    "Transfer",
    "TransferConfig",
    "TransferResult",
    "VideoTransfer",
    "appearance_guide",
    "build_table",
    "face_landmarks",
    "face_size",
    "find_regions",
    "frontal_view",
    "head_mesh",
    "mix_regions",
    "paint",
    "position_guide",
    "prepare",
    "provided_styles",
    "suited",
    "surface_position_guide",
    "synthesise",
    "transfer",
]

__getattr__, __dir__ = attach(__name__, __file__)
