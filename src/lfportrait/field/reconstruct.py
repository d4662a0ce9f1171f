"""Reconstruction: Plenoxels' optimisation on the CPU, coarse to fine.

Each level of resolution trains density and colour by RMSProp on the squared colour error (Shen et
al. 2023, Eq. 2) with total variation (Eq. 3) and a distortion loss that makes surfaces thin;
between levels, lattice points that no training ray sees are pruned and the rest are upsampled.
Where the photos have mattes, the field starts from their visual hull, the opacity of each ray is
fitted, too, and every batch is composited on random backgrounds, so that empty space ends clean;
rays that the hull and the mattes make idle are not drawn. Photos without mattes get spheres behind
the lattice that learn the room. Steps are counted in rays, not in seconds, unless a time budget is
given.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture import Capture
from ..metrics import psnr, ssim
from ..progress import Progress
from .config import ReconstructConfig
from .grid import VoxelField
from .trainer import Trainer

__all__ = ["ReconstructConfig", "held_out_quality", "reconstruct", "reconstruct_with_figures"]


def reconstruct(capture: Capture, config: ReconstructConfig | None = None,
                progress: Progress | None = None, checkpoint: Path | None = None) -> VoxelField:
    """Reconstruct a radiance field from a capture: `reconstruct_with_figures`' field alone."""
    return reconstruct_with_figures(capture, config, progress, checkpoint)[0]


def reconstruct_with_figures(capture: Capture, config: ReconstructConfig | None = None,
                             progress: Progress | None = None, checkpoint: Path | None = None,
                             ) -> tuple[VoxelField, dict[str, Any]]:
    """Reconstruct a radiance field from a capture.

    Parameters
    ----------
    capture
        Views with their cameras in the portrait frame; held-out views are only tested on.
    config
        Parameters.
    progress
        Progress line.
    checkpoint
        File that the state is written to after each level; a run that finds one there goes on
        from it to the same field.

    Returns
    -------
    field, figures
        The field and the figures for ``--json``: ``test.psnr`` (dB) and ``test.ssim`` over the
        held-out views, ``train.rays``, ``train.rays_per_second``, ``voxels``, ``seconds``.

    Raises
    ------
    UserError
        If nothing is left to train on.
    """
    nearest = float(np.linalg.norm(capture.cameras.position, axis=1).min())
    config = (config or ReconstructConfig()).resolved(capture.alphas is None, nearest)
    start = time.perf_counter()
    trainer = Trainer(capture, config, progress)
    trainer.restore(checkpoint)
    while trainer.level < len(config.resolutions):
        trainer.run_level(start)
        trainer.save(checkpoint)
    trainer.finish()
    trained = time.perf_counter() - start
    field = trainer.field()
    figures: dict[str, Any] = {
        "train": {"rays": trainer.rays_done, "views": len(trainer.views),
                  "rays_per_second": trainer.rays_done / max(trained, 1e-9)},
        "voxels": len(field.density), "resolution": config.resolutions[-1],
        "levels": trainer.log, "device": "cpu"}
    if len(capture.testing()):
        figures["test"] = held_out_quality(field, capture, config.background, trainer.test_gains)
        if not np.allclose(trainer.test_gains, 1.0):
            plain = held_out_quality(field, capture, config.background)
            figures["test"]["psnr_without_exposure"] = plain["psnr"]
    figures["seconds"] = {"train": round(trained, 3),
                          "test": round(time.perf_counter() - start - trained, 3)}
    if progress is not None and "test" in figures:
        progress.update(progress.total, f"held-out views {figures['test']['psnr']:.2f} dB")
    return field, figures


def held_out_quality(field: VoxelField, capture: Capture, background: float = 1.0,
                     gains: NDArray[np.float64] | None = None) -> dict[str, float]:
    """Mean PSNR (dB) and SSIM of the held-out views, composited on ``background``.

    Renders are multiplied by ``gains`` [V, 3], the photos' exposures, before they are compared.
    """
    scores = []
    for index, view in enumerate(capture.testing()):
        image = field.render(capture.cameras, view, background=background).color
        if gains is not None:
            image = image * gains[index].astype(np.float32)
        image = np.clip(image, 0, 1)
        truth = capture.image_float(view, background)
        scores.append((psnr(image, truth), ssim(image, truth)))
    means = np.mean(scores, axis=0)
    return {"psnr": float(means[0]), "ssim": float(means[1]), "views": len(scores)}
