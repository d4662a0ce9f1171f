"""A small field of the modelled head, its capture and a painted exemplar, for all methods."""

import numpy as np
import pytest


@pytest.fixture(scope="session")
def small_head():
    """Field, capture, exemplar."""
    from lfportrait.demo import demo_capture, demo_exemplar
    from lfportrait.field import ReconstructConfig, reconstruct_with_figures

    capture = demo_capture(size=96, views=20)
    # With as many coefficients as usual: rows of another width have kernels of their own.
    field, _ = reconstruct_with_figures(capture, ReconstructConfig(
        resolutions=(32, 64), rays=(0.15, 0.3), batch=(4096,)))
    field = field.with_sh(np.ascontiguousarray(field.sh[..., :1]))
    return field, capture, demo_exemplar(width=240, height=320)
