"""Example-based transfer: one painted portrait -> any portrait photo in its manner (Paper 2.2)."""

from .exemplar import Exemplar, face_size
from .faceblit import FaceBlit, FaceBlitConfig
from .facestyle import FaceStyle, FaceStyleConfig
from .guides import Guides, appearance_guide, position_guide
from .labels import LABELS
from .methods import METHODS, Method, MethodConfig, paint, prepare
from .mixed import RegionStyle, mix_regions, read_region
from .network import NetworkConfig, StyleNetwork
from .painted import Painted
from .regions import Regions, find_regions
from .styleblit import BlitConfig, Synthesis, synthesise
from .surface import SurfaceGuide, surface_position_guide
from .table import LookUpTable, TableConfig, build_table
from .transfer import Transfer, TransferConfig, TransferResult, face_landmarks, transfer
from .video import VideoTransfer

__all__ = [
    "LABELS", "METHODS", "BlitConfig", "Exemplar", "FaceBlit", "FaceBlitConfig", "FaceStyle",
    "FaceStyleConfig", "Guides", "LookUpTable", "Method", "MethodConfig", "NetworkConfig",
    "Painted", "RegionStyle", "Regions", "StyleNetwork", "SurfaceGuide", "Synthesis",
    "TableConfig", "Transfer", "TransferConfig", "TransferResult", "VideoTransfer",
    "appearance_guide", "build_table", "face_landmarks", "face_size", "find_regions",
    "mix_regions", "paint", "position_guide", "prepare", "read_region",
    "surface_position_guide", "synthesise", "transfer",
]
