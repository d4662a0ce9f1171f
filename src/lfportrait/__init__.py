"""lfportrait: photos and one painting in, a stylised 3D portrait for a light-field display out.

The whole job in five lines::

    import lfportrait as lf

    capture = lf.Capture.load("photos/")            # or lf.calibrate("photos/")
    field = lf.reconstruct(capture)
    styled = lf.stylize(field, capture, lf.Exemplar.load("ken.png"))
    image = lf.encode(styled, lf.Display.preset("lookingglass-16"))  # uint8 [H, W, 3]
"""

from typing import TYPE_CHECKING

from .lazy import attach
from .version import __version__

if TYPE_CHECKING:
    from .capture import Camera, Capture, calibrate
    from .demo import demo_capture
    from .errors import UserError
    from .example import Exemplar, Skin, transfer
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
    from .share import ExportConfig, PageConfig, export_field, orbit_cameras, write_page
    from .share.splats import SplatConfig, field_splats, render_splats
    from .stylize import StyledField, StylizeConfig, load_network, paint, stylize
    from .stylize.losses import content_loss, laplacian_loss, nearest_neighbour_loss

__all__ = [
    "Camera", "Capture", "Display", "EncodeConfig", "Exemplar", "ExportConfig", "OffscreenWindow",
    "PageConfig", "PrintConfig", "PrintSheet", "ReconstructConfig", "Renderer", "Rendering",
    "Session", "SheetView", "Skin", "SplatConfig", "StyledField", "StylizeConfig", "UserError",
    "ViewMask", "VoxelField", "__version__", "batch", "calibrate", "content_loss", "deinterlace",
    "demo_capture", "encode", "encode_views", "export_field", "field_splats", "laplacian_loss",
    "load_network", "make", "nearest_neighbour_loss", "orbit_cameras", "paint", "read_image",
    "reconstruct", "render_splats", "render_view", "show_field", "simulate", "stylize", "transfer",
    "write_image", "write_page", "write_print",
]

__getattr__, __dir__ = attach(__name__, __file__, {"evaluate": "lfportrait_eval"})
