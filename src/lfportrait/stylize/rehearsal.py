"""Warm-up: every step of a stylisation on tiny data, to compile the kernels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..capture import Capture
from ..example import Exemplar, Painting, Skin
from ..example.skin import rehearse_painting
from ..field import VoxelField
from .config import StylizeConfig
from .fit import ColorModel
from .refinement import Refinement
from .skin_fit import chart_views, look_up_rows, show_painting
from .skin_texture import surface_texture

__all__ = ["rehearse"]


def rehearse(field: VoxelField, capture: Capture, exemplar: Exemplar) -> None:
    """Run through a stylisation on the skin, the painting of the face left out.

    The face's kernels are those of the transfer, which can be compiled at the same time elsewhere.

    Parameters
    ----------
    field, capture, exemplar
        As small as can be; the capture has landmarks.
    """
    assert capture.landmarks is not None
    skin = Skin.of(field, capture.landmarks, capture.cameras, pixels=64.0, networks=False)
    rehearse_painting(skin)
    painting = Painting(skin, np.ascontiguousarray(skin.atlas.color), 1, {})
    model, views = ColorModel(field, 1.0), chart_views(field, skin, 1.0)
    look_up_rows(model, painting)
    show_painting(views, painting, 1.0)
    model.fit(views, 1)
    shown = model.shown(field)
    replace(shown, texture=surface_texture(shown, painting)).render(capture.cameras, 0)
    Refinement(model, views, StylizeConfig(
        steps=1, content_network="embedded", style_network="embedded"),
        device="cpu").run(None)
