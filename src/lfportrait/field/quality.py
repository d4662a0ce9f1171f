"""Test a field on held-out photos."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..capture import Capture
from ..lanes.threads import side_by_side
from ..metrics import psnr, ssim
from .grid import VoxelField

__all__ = ["held_out_quality"]

_TOGETHER = 8_000_000
"""Pixels of views that are compared at a time: each takes some 200 bytes."""


def held_out_quality(field: VoxelField, capture: Capture, background: float = 1.0,
                     gains: NDArray[np.float64] | None = None,
                     some: NDArray[np.int64] | None = None) -> dict[str, float]:
    """Mean PSNR (dB) and SSIM of the held-out views, composited on ``background``.

    Renders are multiplied by ``gains`` [V, 3], the photos' exposures, before they are compared.
    ``some`` are numbers of held-out views, from 0; by default all count.
    """
    tests = capture.testing()
    # Layouts are built on first use: not by several threads.
    _ = field.bricks.rows

    def scores(index: int) -> tuple[float, float]:
        """PSNR and SSIM of one view."""
        view = int(tests[index])
        shot = field.render(capture.cameras, view, background=background)
        image = shot.color
        if gains is not None:
            gain = gains[index].astype(np.float32)
            # Behind a person with a matte stands the same grey whatever the exposure.
            behind = background * (1.0 - shot.alpha[..., None]) if capture.alphas is not None else 0
            image = (image - behind) * gain + behind
        image = np.clip(image, 0, 1)
        truth = capture.image_float(view, background)
        return psnr(image, truth), ssim(image, truth)

    numbers = range(len(tests)) if some is None else [int(one) for one in some]
    largest = int((capture.cameras.width * capture.cameras.height).max())
    found = side_by_side(scores, numbers, max(1, _TOGETHER // largest))
    means = np.mean(found, axis=0)
    return {"psnr": float(means[0]), "ssim": float(means[1]), "views": len(found)}
