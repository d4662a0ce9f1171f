"""Test a field on held-out photos."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..arrays import Float64, Int64
from ..capture import Capture
from ..metrics import psnr, ssim
from ..simd.threads import side_by_side
from .grid import VoxelField

__all__ = ["held_out_quality"]

_TOGETHER = 8_000_000
"""Pixels of views that are compared at a time: each takes some 200 bytes."""


def held_out_quality(field: VoxelField, capture: Capture, background: float = 1.0,
                     gains: Float64 | None = None,
                     some: Int64 | None = None,
                     others: Mapping[str, tuple[Capture, Float64 | None]] | None = None,
                     ) -> dict[str, float]:
    """Mean PSNR (dB) and SSIM of the held-out views, composited on ``background``.

    Renders are multiplied by ``gains`` [V, 3], the photos' exposures, before they are compared.
    ``some`` are numbers of held-out views, from 0; by default all count. ``others`` are the same
    views with other mattes or exposures: their PSNR comes by their names.
    """
    tests = capture.testing()
    # Layouts are built on first use: not by several threads.
    _ = field.bricks.rows

    variants = {"psnr": (capture, gains), **(others or {})}

    def scores(index: int) -> list[float]:
        """PSNR of one view in all variants, and SSIM in the first."""
        view = int(tests[index])
        shot = field.render(capture.cameras, view, background=background)
        found: list[float] = []
        for photos, factors in variants.values():
            image = shot.color
            if factors is not None:
                gain = factors[index].astype(np.float32)
                # Behind a person with a matte stands the same grey whatever the exposure.
                behind = (background * (1.0 - shot.alpha[..., None])
                          if photos.alphas is not None else 0)
                image = (image - behind) * gain + behind
            pair = np.clip(image, 0, 1), photos.image_float(view, background)
            found += [psnr(*pair)] if found else [ssim(*pair), psnr(*pair)]
        return found

    numbers = range(len(tests)) if some is None else [int(one) for one in some]
    largest = int((capture.cameras.width * capture.cameras.height).max())
    found = side_by_side(scores, numbers, max(1, _TOGETHER // largest))
    means = np.mean(found, axis=0)
    return {"ssim": float(means[0]), "views": len(found),
            **dict(zip(variants, map(float, means[1:])))}
