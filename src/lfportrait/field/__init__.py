"""The radiance field of a head: a `Capture` becomes a `VoxelField` (Paper 2.1, Eq. 1-3).

`reconstruct` trains it, starting from what `geometry` carves and by the steps of `training`; `grid`
holds and renders it, `storage` is its file, `surface` its surface as points or as a mesh. What
trains is imported when it is asked for.
"""

from typing import TYPE_CHECKING

from ..lazy import attach
from .backdrop import Backdrop, head_points
from .grid import Rendering, SampleWeights, VoxelField, camera_row
from .harmonics import C0
from .storage import check_field_path, read_arrays, save_checkpoint, save_field
from .texture import SurfaceTexture

if TYPE_CHECKING:
    from .config import ReconstructConfig, lattice_points
    from .coverage import Coverage
    from .quality import held_out_quality
    from .reconstruction import reconstruct, reconstruct_with_figures
    from .surface import Mesh, PointCloud, field_mesh, field_points

__all__ = ["C0", "Backdrop", "Coverage", "Mesh", "PointCloud", "ReconstructConfig", "Rendering",
           "SampleWeights", "SurfaceTexture", "VoxelField", "camera_row", "check_field_path",
           "field_mesh", "field_points", "head_points", "held_out_quality", "lattice_points",
           "read_arrays", "reconstruct", "reconstruct_with_figures", "save_checkpoint",
           "save_field"]

__getattr__, __dir__ = attach(__name__, __file__)
