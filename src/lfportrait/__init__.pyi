from .capture import Camera, Capture, calibrate
from .demo import demo_capture
from .errors import UserError
from .example import Exemplar, Skin, TransferConfig, transfer
from .face.one_photo.portrait import head_from_photos
from .field import ReconstructConfig, Rendering, VoxelField, reconstruct
from .files import write_image
from .job import Session, make
from .job.batch import batch
from .lightfield import (
    Display,
    EncodeConfig,
    Renderer,
    ViewMask,
    deinterlace,
    encode,
    encode_views,
    render_view,
    simulate,
)
from .lightfield.prints import PrintConfig, PrintSheet, SheetView, write_print
from .lightfield.screens import OffscreenWindow, show_field
from .media.pictures import read_image
from .share import ExportConfig, PageConfig, SplatConfig, export_field, orbit_cameras, write_page
from .share.splats.cloud import render_splats
from .share.splats.fitting import field_splats
from .stylize import StyledField, StylizeConfig, load_network, paint, stylize
from .stylize.losses import content_loss, laplacian_loss, nearest_neighbour_loss
from .version import __version__

__all__ = [
    "Camera", "Capture", "Display", "EncodeConfig", "Exemplar", "ExportConfig", "OffscreenWindow",
    "PageConfig", "PrintConfig", "PrintSheet", "ReconstructConfig", "Renderer", "Rendering",
    "Session", "SheetView", "Skin", "SplatConfig", "StyledField", "StylizeConfig",
    "TransferConfig", "UserError",
    "ViewMask", "VoxelField", "__version__", "batch", "calibrate", "content_loss", "deinterlace",
    "demo_capture", "encode", "encode_views", "export_field", "field_splats",
    "head_from_photos", "laplacian_loss",
    "load_network", "make", "nearest_neighbour_loss", "orbit_cameras", "paint", "read_image",
    "reconstruct", "render_splats", "render_view", "show_field", "simulate", "stylize", "transfer",
    "write_image", "write_page", "write_print",
]
