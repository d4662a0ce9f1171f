"""A field stylised on its skin: painted once on the surface, then fitted, then refined.

`Skin` is computed once for a field (and kept in a file beside it), a painting takes seconds, and
the lattice's colors come straight from it: that is the preview. The least-squares fit then
sharpens strokes between lattice points, with the charts of the skin as its views, and the losses
refine them at half the size. What the lattice is too coarse for becomes the field's texture
(`skin.surface_texture`). Skin, weights and the photo's features serve any number of exemplars.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Float32
from ..capture import Capture
from ..device import torch_device
from ..example import Exemplar, Painting, Skin, SkinPainter, asked_lids
from ..example.skin import canvas_of
from ..field import SurfaceTexture, VoxelField
from ..files import write_image
from ..progress import Progress
from .config import StylizeConfig
from .fit import ColorModel, StyleView
from .skin import (
    PREVIEW,
    ChartLattice,
    chart_lattice,
    chart_views,
    for_lattice,
    look_up_rows,
    row_labels,
    show_painting,
    surface_texture,
)

RELAXATION = 0.35
"""Share of each update of the fit that is taken: more gets sharper, but less alike in all views."""
FINER = 2.0
"""Pixels of an exemplar, at most, per pixel of the skin."""
PREVIEWED, LEAST, STEPS = 1.0, 48.0, 16
"""The same per painted pixel of a preview; the size of a face, in pixels, that is always enough to
find a painting's materials; and the steps from one size of such a picture to half of it."""


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
    return Painters().of(exemplar, skin, config).paint(skin, PREVIEW if config.preview else 1)


def _reduced(exemplar: Exemplar, face: float, preview: bool) -> float:
    """How much smaller an exemplar is made, at most 1: what is finer would only cost time.

    Neither a skin nor a preview can show it. ``face`` is the size of the skin's face in pixels.
    For previews the size is one of a few steps, so that the picture stays the same while its
    landmarks are moved.
    """
    finest, least = (size / exemplar.size for size in (
        FINER * face, max(PREVIEWED * face / PREVIEW, LEAST)))
    if preview and least < finest:
        finest = 2.0 ** (math.floor(STEPS * math.log2(least)) / STEPS)
    return min(finest, 1.0)


class Sitter:
    """A field to be painted: its skin, and data shared by all its paintings.

    Parameters
    ----------
    field, capture
        The real field, and its capture with landmarks.
    config
        Parameters.
    skin
        Of the field; None computes it.
    """

    def __init__(self, field: VoxelField, capture: Capture, config: StylizeConfig,
                 skin: Skin | None) -> None:
        assert capture.landmarks is not None
        self.field, self.capture, self.config = field, capture, config
        self.step = PREVIEW if config.preview else 1
        self.skin = skin or Skin.of(field, capture.landmarks, capture.cameras, config.pixels)
        canvas_of(self.skin, self.step)
        if self._refined:
            # Torch is imported here, not beside: SciPy looks at it as soon as it begins to load.
            from . import refinement  # noqa: F401
        # What is shared takes a while: a painting is looked at meanwhile.
        self._views: dict[int, list[StyleView]] = {}
        aside = ThreadPoolExecutor(1)
        self._shared = aside.submit(self._share)
        aside.shutdown(wait=False)

    @property
    def _refined(self) -> bool:
        """Whether networks look at what is painted."""
        return not self.config.preview and self.config.refinements > 0

    def _share(self) -> None:
        if self.config.preview and self.config.texture:
            chart_lattice(self.field, self.skin, self.step)
        row_labels(self.skin)
        if self._refined:
            from .refinement import Refinement

            Refinement.load(self.config, torch_device().place)
            self._charts(2)

    def wait(self) -> None:
        """Wait for the data that all paintings share."""
        self._shared.result()

    def views(self, painting: Painting, step: int) -> list[StyleView]:
        """The charts at every ``step``-th pixel as views that should show a painting."""
        views = self._charts(step)
        show_painting(views, painting, self.config.background, step)
        return views

    def _charts(self, step: int) -> list[StyleView]:
        """The charts at every ``step``-th pixel as views, made once."""
        if step not in self._views:
            self._views[step] = chart_views(self.field, self.skin, self.config.background, step)
        return self._views[step]


class Painters:
    """Exemplars prepared for painting skins, kept from one stylisation to the next."""

    MOST = 8

    def __init__(self) -> None:
        self._known: dict[tuple[Any, ...], tuple[Exemplar, SkinPainter]] = {}

    def of(self, exemplar: Exemplar, skin: Skin, config: StylizeConfig) -> SkinPainter:
        """The painter of an exemplar for a skin, and for others like it."""
        asked = _asked(exemplar, skin, config)
        key = (id(exemplar), *asked)
        found = self._known.pop(key, None)
        if found is None:
            reduced, fringe, lids = asked[:3]
            painter = SkinPainter(exemplar.within(reduced * exemplar.size), config.painting,
                                  config.transfer, config.seed, fringe, lids, config.wear)
            # The exemplar is kept: its identity is not given to another.
            found = exemplar, painter
        self._known[key] = found
        while len(self._known) > self.MOST:
            del self._known[next(iter(self._known))]
        return found[1]

    def alike(self, exemplar: Exemplar, asked: tuple[Any, ...]) -> Iterator[SkinPainter]:
        """Painters of the same picture, asked for the same, with whatever landmarks."""
        for key, (known, painter) in self._known.items():
            if key[1:] == asked and _same_picture(known, exemplar):
                yield painter


class NearbyPainters(Painters):
    """Painters of a painting while its landmarks are moved, for previews.

    One that was prepared for landmarks close by serves others as well (`SkinPainter.moved`): what
    is found in a picture takes longer than to paint by it.

    Parameters
    ----------
    kept
        Painters that may serve, too.
    """

    MOST = 1

    def __init__(self, kept: Painters) -> None:
        super().__init__()
        self._kept = kept

    def of(self, exemplar: Exemplar, skin: Skin, config: StylizeConfig) -> SkinPainter:
        """The painter of an exemplar, moved from another one where that is close."""
        asked = _asked(exemplar, skin, config)
        for painters in (self, self._kept):
            for painter in painters.alike(exemplar, asked):
                moved = painter.moved(exemplar.landmarks * np.divide(
                    painter.given.image.shape[1::-1], exemplar.image.shape[1::-1]))
                if moved is not None:
                    return moved
        return super().of(exemplar, skin, config)


def _asked(exemplar: Exemplar, skin: Skin, config: StylizeConfig) -> tuple[Any, ...]:
    """All that a painter depends on but its exemplar; its size, fringe and lids come first."""
    lids = ((False, False) if config.eyes == "painted"
            else asked_lids(exemplar, skin.plane.landmarks))
    return (_reduced(exemplar, skin.face, config.preview), skin.hair is not None, lids,
            config.painting, config.transfer, config.seed, config.wear)


def _same_picture(one: Exemplar, other: Exemplar) -> bool:
    """Whether two exemplars differ in nothing but their landmarks."""
    def same(plane: Any, twin: Any) -> bool:
        return plane is twin or (plane is not None and twin is not None
                                 and np.array_equal(plane, twin))

    return (same(one.image, other.image) and same(one.mask, other.mask)
            and same(one.hair, other.hair) and same(one.by_hand, other.by_hand))


def stylize_skin(sitter: Sitter, exemplars: Sequence[Exemplar], config: StylizeConfig,
                 progress: Progress | None, dump: Path | None, painters: Painters | None = None,
                 device: str = "auto",
                 ) -> tuple[list[Float32], list[SurfaceTexture], dict[str, Any]]:
    """Colors of a field's rows, float32 [N, 3], and textures, by exemplar, and figures.

    The networks of the refinement compute on ``device``, everything else on the CPU.
    """
    colors, textures, rows = [], [], []
    constants: Any = None
    lattice: ChartLattice | None = None
    skin, field, painters = sitter.skin, sitter.field, painters or Painters()
    for exemplar in exemplars:
        clock = time.perf_counter()
        if progress is not None:
            progress.update(progress.done, f"paint after {exemplar.name}")
        painter = painters.of(exemplar, skin, config)
        painting = painter.paint(skin, sitter.step)
        painted = time.perf_counter()
        sitter.wait()
        model = ColorModel(field, config.background)
        look_up_rows(model, for_lattice(painting, field) if config.texture else painting)
        figures: dict[str, Any] = {"style": exemplar.name, "painting": painting.seconds,
                                   "pose": painter.pose.angles,
                                   "materials": painter.materials()}
        if not config.preview and config.iterations > 0:
            known = model.seen.copy()
            errors = model.fit(sitter.views(painting, 1), config.iterations, progress,
                               RELAXATION)
            model.seen = np.maximum(model.seen, known)
            figures["fit"] = {"rmse": [round(float(np.sqrt(e)), 5) for e in errors]}
        fitted = time.perf_counter()
        figures["unseen_share"] = round(model.fill_unseen(), 4)
        if config.texture:
            if len(exemplars) > 1 and lattice is None and sitter.step == 1:
                lattice = ChartLattice(field, skin, 1, whole=True)
            # Before the refinement: what that changes is to be seen, not painted over.
            textures.append(surface_texture(model.shown(field), painting, lattice))
        textured = time.perf_counter()
        if not config.preview and config.refinements > 0:
            from .refinement import Constants, Refinement

            constants = constants or Constants()
            figures["refinement"] = Refinement(model, sitter.views(painting, 2), config,
                                               constants, device).run(progress)
        end = time.perf_counter()
        figures["seconds"] = {"paint": round(painted - clock, 3),
                              "fit": round(fitted - painted, 3),
                              "texture": round(textured - fitted, 3),
                              "refine": round(end - textured, 3)}
        if dump is not None:
            write_image(dump / f"skin_{exemplar.name}.png", painting.color)
            if painter.turned:
                write_image(dump / f"frontal_{exemplar.name}.png", painter.exemplar.image)
        colors.append(model.colors)
        rows.append(figures)
    return colors, textures, {"skin": {"pixels": len(skin.index)}, **rows[0],
                              **({"styles": rows} if len(rows) > 1 else {})}
