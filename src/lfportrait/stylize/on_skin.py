"""A field stylised on its skin: painted once on the surface, then fitted, then refined.

`Skin` is computed once for a field (and kept in a file beside it), a painting takes seconds, and
the lattice's colours come straight from it: that is the preview. The least-squares fit then
sharpens strokes between lattice points, with the charts of the skin as its views, and the losses
refine them at half the size. What the lattice is too coarse for becomes the field's texture
(`skin_texture`). Skin, weights and the photo's features serve any number of exemplars.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..example import Exemplar, Painting, Skin, SkinPainter
from ..field import SurfaceTexture, VoxelField
from ..files import write_image
from ..progress import Progress
from .config import StylizeConfig
from .fit import ColorModel
from .skin_fit import chart_views, for_lattice, look_up_rows, show_painting
from .skin_texture import surface_texture
from .views import StyleView

__all__ = ["paint", "stylize_skin"]

Float32 = NDArray[np.float32]

PREVIEW = 2
"""Pixels of the skin per painted pixel in a preview."""
FINER = 2.0
"""Pixels of an exemplar, at most, per pixel of the skin."""


def paint(skin: Skin, exemplar: Exemplar, config: StylizeConfig | None = None) -> Painting:
    """Paint a skin by one exemplar.

    Parameters
    ----------
    skin
        Of a field (`Skin.of`).
    exemplar
        The painting.
    config
        Parameters; ``preview`` halves the resolution. For several paintings by one exemplar, keep
        a `SkinPainter`.
    """
    config = config or StylizeConfig()
    painter = _painter(_fitting(exemplar, skin), config)
    return painter.paint(skin, PREVIEW if config.preview else 1)


def _fitting(exemplar: Exemplar, skin: Skin) -> Exemplar:
    """The exemplar without what is finer than a skin can show: that would only cost time."""
    return exemplar.within(FINER * skin.face)


def _painter(exemplar: Exemplar, config: StylizeConfig) -> SkinPainter:
    return SkinPainter(exemplar, config.painting, config.transfer, config.seed)


class _Views:
    """The charts as views of the fit and of the refinement, made when first needed."""

    def __init__(self, field: VoxelField, skin: Skin, config: StylizeConfig) -> None:
        self.field, self.skin, self.config = field, skin, config
        self._made: dict[int, list[StyleView]] = {}

    def of(self, painting: Painting, step: int) -> list[StyleView]:
        """Views at every ``step``-th pixel that should show a painting."""
        if step not in self._made:
            self._made[step] = chart_views(self.field, self.skin, self.config.background, step)
        show_painting(self._made[step], painting, self.config.background, step)
        return self._made[step]


def stylize_skin(field: VoxelField, skin: Skin, exemplars: Sequence[Exemplar],
                 config: StylizeConfig, progress: Progress | None,
                 dump: Path | None,
                 ) -> tuple[list[Float32], list[SurfaceTexture], dict[str, Any]]:
    """Colours of a field's rows, float32 [N, 3], and textures, by exemplar, and figures."""
    views = _Views(field, skin, config)
    colors, textures, rows = [], [], []
    constants: Any = None
    for exemplar in (_fitting(one, skin) for one in exemplars):
        clock = time.perf_counter()
        if progress is not None:
            progress.update(progress.done, f"paint after {exemplar.name}")
        painter = _painter(exemplar, config)
        painting = painter.paint(skin, PREVIEW if config.preview else 1)
        painted = time.perf_counter()
        model = ColorModel(field, config.background)
        look_up_rows(model, for_lattice(painting, field) if config.texture else painting)
        figures: dict[str, Any] = {"style": exemplar.name, "painting": painting.seconds,
                                   "pose": painter.pose.angles,
                                   "materials": painter.materials()}
        if not config.preview and config.iterations > 0:
            known = model.seen.copy()
            errors = model.fit(views.of(painting, 1), config.iterations, progress,
                               config.relaxation)
            model.seen = np.maximum(model.seen, known)
            figures["fit"] = {"rmse": [round(float(np.sqrt(e)), 5) for e in errors]}
        fitted = time.perf_counter()
        figures["unseen_share"] = round(model.fill_unseen(), 4)
        if config.texture:
            # Before the refinement: what that changes is to be seen, not painted over.
            textures.append(surface_texture(model.shown(field), painting))
        textured = time.perf_counter()
        if not config.preview and config.refinements > 0:
            from .refinement import Constants, Refinement

            constants = constants or Constants()
            figures["refinement"] = Refinement(model, views.of(painting, 2), config,
                                               constants).run(progress)
        end = time.perf_counter()
        figures["seconds"] = {"paint": round(painted - clock, 3),
                              "fit": round(fitted - painted, 3),
                              "texture": round(textured - fitted, 3),
                              "refine": round(end - textured, 3)}
        if dump is not None:
            write_image(dump / f"skin_{exemplar.name}.png", painting.color)
            if painter.exemplar is not exemplar:
                write_image(dump / f"frontal_{exemplar.name}.png", painter.exemplar.image)
        colors.append(model.colors)
        rows.append(figures)
    return colors, textures, {"skin": {"pixels": len(skin.index)}, **rows[0],
                              **({"styles": rows} if len(rows) > 1 else {})}
