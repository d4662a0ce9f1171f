from .background import Backdrop, head_points
from .closing.photos import Coverage
from .config import ReconstructConfig, lattice_points
from .grid import Rendering, SampleWeights, VoxelField
from .kernels.march import C0, real_harmonics
from .reconstruction import reconstruct, reconstruct_with_figures
from .storage import check_field_path, read_arrays, save_checkpoint, save_field
from .surface import Mesh, PointCloud, SurfaceGraph, field_mesh, field_points
from .texture import SurfaceTexture
from .training.meter import Curves, held_out_quality
from .trimming import median_plane

__all__ = ["C0", "Backdrop", "Coverage", "Curves", "Mesh", "PointCloud", "ReconstructConfig",
           "Rendering", "SampleWeights", "SurfaceGraph", "SurfaceTexture", "VoxelField",
           "check_field_path", "field_mesh", "field_points", "head_points", "held_out_quality",
           "lattice_points", "median_plane", "read_arrays", "real_harmonics", "reconstruct",
           "reconstruct_with_figures", "save_checkpoint", "save_field"]
