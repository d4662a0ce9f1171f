"""Capture -> `VoxelField`: reconstruct, render, save and load (Shen et al. 2023, 2.1, Eq. 1-3)."""

from .grid import Rendering, SampleWeights, VoxelField
from .reconstruct import (
    ReconstructConfig,
    held_out_quality,
    reconstruct,
    reconstruct_with_figures,
)

__all__ = ["ReconstructConfig", "Rendering", "SampleWeights", "VoxelField", "held_out_quality",
           "reconstruct", "reconstruct_with_figures"]
