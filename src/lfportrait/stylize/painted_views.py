"""A field stylised by painted views: the paper's way (Shen et al. 2023, 2.2).

Views on arcs are rendered, each is painted by example, and the field's colors are fitted to all of
them; `refinement` follows. Every view decides independently which chunks to take, and the fit
averages what neighbours decided differently: the skin (`skin_fit`) is steadier, sharper and faster.
This is what comparisons with the paper use.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture import Capture
from ..errors import UserError
from ..example import Exemplar, SurfaceGuide, Transfer
from ..field import VoxelField
from ..files import write_image
from ..progress import Progress
from .config import StylizeConfig
from .fit import ColorModel
from .refinement import Refinement
from .views import StyleView, prepare_view, style_cameras

__all__ = ["stylize_views"]

Float32 = NDArray[np.float32]


def stylize_views(field: VoxelField, capture: Capture, exemplar: Exemplar, config: StylizeConfig,
                  progress: Progress | None, dump: Path | None, device: str = "auto",
                  ) -> tuple[Float32, dict[str, Any]]:
    """Colors of a field's rows, float32 [N, 3], by painted views, and figures.

    The networks of the refinement compute on ``device``.
    """
    start = time.perf_counter()
    views, transfer_seconds = _prepare(field, capture, exemplar, config, progress, dump)
    prepared = time.perf_counter()
    model = ColorModel(field, config.background)
    errors = model.fit(views, config.iterations, progress)
    fitted = time.perf_counter()
    figures: dict[str, Any] = {"views": len(views), "transfer": transfer_seconds,
                               "fit": {"rmse": [round(float(np.sqrt(e)), 5) for e in errors]}}
    if config.refinements > 0:
        figures["refinement"] = Refinement(model, views, config,
                                           device=device).run(progress)
    refined = time.perf_counter()
    figures["unseen_share"] = round(model.fill_unseen(), 4)
    figures["seconds"] = {"views": round(prepared - start, 3), "fit": round(fitted - prepared, 3),
                          "refine": round(refined - fitted, 3)}
    if dump is not None:
        for index, view in enumerate(views[::3]):
            write_image(dump / f"view_{index:02d}.png", np.concatenate(
                [view.content, view.example, model.picture(view)], axis=1))
    return model.colors, figures


def _prepare(field: VoxelField, capture: Capture, exemplar: Exemplar, config: StylizeConfig,
             progress: Progress | None, dump: Path | None,
             ) -> tuple[list[StyleView], dict[str, float]]:
    """Render and transfer all views."""
    cameras = style_cameras(field, config.size, config.arc, config.views, config.pitches)
    # By landmarks alone, as published.
    transfer = Transfer(exemplar, replace(config.transfer, seed=config.seed, aside=90.0))
    guide = None
    if config.guide == "surface":
        assert capture.landmarks is not None
        guide = SurfaceGuide(capture.landmarks, exemplar, transfer.regions)
    views: list[StyleView] = []
    seconds = {"table_seconds": 0.0, "guides_seconds": 0.0, "synthesis_seconds": 0.0}
    total = len(cameras) + config.refinements
    for index in range(len(cameras)):
        view = prepare_view(field, cameras, index, transfer, guide, capture.landmarks,
                            config.background, keep=True)
        if view is not None:
            if view.result is not None:
                for name in ("guides_seconds", "synthesis_seconds"):
                    seconds[name] += view.result.seconds[name]
                seconds["table_seconds"] = view.result.seconds["table_seconds"]
                if dump is not None and index % 3 == 0:
                    view.result.dump(dump / f"transfer_{index // 3:02d}")
                view.result = None
            views.append(view)
        if progress is not None:
            progress.total = total
            progress.update(index + 1, f"transfer by example: view {index + 1} of {len(cameras)}")
    if not views:
        raise UserError("the field is empty: no view shows anything to stylise")
    return views, {name: round(value, 3) for name, value in seconds.items()}
