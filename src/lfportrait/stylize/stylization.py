"""Stylise a field by one or more exemplars, with notes on what sitter and exemplar differ in.

By default it is painted on its skin. `Skin` is computed once for a field (and kept in a file beside
it), a painting takes seconds, and the lattice's colors come straight from it: that is the preview.
The least-squares fit then sharpens strokes between lattice points, with the charts of the skin as
its views, and the losses refine them at half the size. What the lattice is too coarse for becomes
the field's texture (`skin.surface_texture`). Skin, weights and the photo's features serve any
number of exemplars.

The notes are a line each: eyes, mouth, stroke size.
"""

import math
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Float32
from ..capture import Capture
from ..device import check_device, torch_device
from ..errors import UserError
from ..example import (
    Exemplar,
    Painting,
    Skin,
    SkinPainter,
    asked_lids,
    canvas_of,
    closed_words,
    known_ground,
    not_worn,
    parts_lips,
)
from ..face import mouth_opening
from ..field import C0, Backdrop, SurfaceTexture, VoxelField, head_points
from ..files import write_image
from ..labels import PICTURE_LABELS
from ..measure import give_back_memory
from ..progress import Progress, note
from .config import FieldTask, StylizeConfig
from .fit import ColorModel, StyleView
from .mixing import StyledField
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
    texel_rows,
)
from .vignette import vignetted

RELAXATION = 0.35
"""Share of each update of the fit that is taken: more gets sharper, but less alike in all views."""
FINER = 2.0  # Pixels of an exemplar, at most, per pixel of the skin.
PREVIEWED, LEAST, STEPS = 1.0, 48.0, 16
"""The same per painted pixel of a preview; the size of a face, in pixels, that is always enough to
find a painting's materials; and the steps from one size of such a picture to half of it."""


def paint(skin: Skin, exemplar: Exemplar, config: StylizeConfig | None = None) -> Painting:
    """Paint a skin by one exemplar.

    Parameters
    ----------
    skin : Of a field (`Skin.of`).
    exemplar : The painting.
    config : Parameters; ``preview`` halves the resolution. For several paintings by one
        exemplar, keep a `SkinPainter`.
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
    """A field to be painted: its capture with landmarks, its skin, and what all paintings share."""

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

    One that was prepared for landmarks close by, or is ``kept`` elsewhere, serves others as well
    (`SkinPainter.moved`): what is found in a picture takes longer than to paint by it.
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
    constants: dict[Any, Any] = {}
    lattice: ChartLattice | None = None
    skin, field = sitter.skin, sitter.field
    for exemplar in exemplars:
        clock = time.perf_counter()
        note(progress, f"paint after {exemplar.name}")
        painter = (painters or Painters()).of(exemplar, skin, config)
        painting = painter.paint(skin, sitter.step)
        frontal = painter.exemplar.image if painter.turned else None
        figures: dict[str, Any] = {"style": exemplar.name, "painting": painting.seconds,
                                   "pose": painter.pose.angles,
                                   "materials": painter.materials()}
        del painter  # if nobody keeps it: 300 MB that the networks can use
        painted = time.perf_counter()
        sitter.wait()
        model = ColorModel(field, config.background)
        look_up_rows(model, for_lattice(painting, field) if config.texture else painting)
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
            from .refinement import Refinement

            views = sitter.views(painting, 2)
            if dump is None:
                del painting
            # What the painting took is free, in pieces of other sizes than the networks ask for.
            give_back_memory()
            figures["refinement"] = Refinement(model, views, config, constants, device).run(
                progress)
        end = time.perf_counter()
        figures["seconds"] = {"paint": round(painted - clock, 3),
                              "fit": round(fitted - painted, 3),
                              "texture": round(textured - fitted, 3),
                              "refine": round(end - textured, 3)}
        if dump is not None:
            write_image(dump / f"skin_{exemplar.name}.png", painting.color)
            if frontal is not None:
                write_image(dump / f"frontal_{exemplar.name}.png", frontal)
        colors.append(model.colors)
        rows.append(figures)
    return colors, textures, {"skin": {"pixels": len(skin.index)}, **rows[0],
                              **({"styles": rows} if len(rows) > 1 else {})}


PARTED = 0.14
"""Height of the gap between the lips over the mouth's width, of a mouth that is open."""
COARSE = 100.0
"""An exemplar whose face is smaller (`face_size`, pixels) is coarse beside a display's rows."""


def notices(capture: Capture, exemplars: Sequence[Exemplar], config: StylizeConfig) -> list[str]:
    """Notes for the user about the result, one line each."""
    out: list[str] = []
    points = capture.landmarks
    if points is None:
        return out
    for exemplar in exemplars:
        theirs = exemplar.landmarks
        if exemplar.faces > 1:
            out.append(f"{exemplar.name} shows {exemplar.faces} faces, the largest was taken: "
                       "`lfportrait styles add PICTURE --face 2` takes another")
        kept = set(config.keep)
        lids = asked_lids(exemplar, points)
        if any(lids) and "eyes" not in kept:
            them = "them" if all(lids) else "it"
            how = (f"and painted so: --eyes painted opens {them}"
                   if config.on_skin and config.eyes == "auto" else
                   f"but painted open, after {exemplar.name}"
                   + (f": --eyes auto closes {them}" if config.on_skin else ""))
            out.append(f"{closed_words(lids)} closed, {how}, --keep eyes leaves the photo's")
        mouths = mouth_opening(points), mouth_opening(theirs)
        if "lips" not in kept and (mouths[0] > PARTED) != (mouths[1] > PARTED) and not (
                config.on_skin and parts_lips(exemplar, points)):
            which = "open" if mouths[0] > PARTED else "closed"
            other = "closed" if mouths[0] > PARTED else "open"
            out.append(f"the sitter's mouth is {which}, that of {exemplar.name} is {other}: "
                       "--keep lips leaves the photo's")
        if config.on_skin:
            out += not_worn(exemplar, config.wear)
        if exemplar.size < COARSE:
            out.append(f"the face of {exemplar.name} is only about {3.2 * exemplar.size:.0f} "
                       "pixels wide: its strokes will be coarse on a large display; use a larger "
                       "picture of it")
    return out


def stylize(field: VoxelField, capture: Capture, exemplar: Exemplar | Sequence[Exemplar],
            config: StylizeConfig | None = None, progress: Progress | None = None,
            device: str = "auto", dump: Path | None = None,
            skin: Skin | None = None) -> StyledField:
    """Stylise a field by one or more exemplars: the field of `stylize_with_figures`.

    Parameters
    ----------
    field, capture : The real radiance field, and its capture: the landmarks in space, and where
        the photos were taken from.
    exemplar : The painting with its landmarks, or several; the field shows the first.
    config : Parameters.
    progress : Progress line.
    device : Where to compute: ``"auto"``, ``"cpu"``, ``"gpu"`` or ``"gpu:NAME"``
        (`lfportrait.device`).
    dump : Folder for pictures of intermediates; None writes none.
    skin : Of the field, where it is known already (`Skin.of`).

    Raises
    ------
    UserError : If the capture has no landmarks, a region to keep is unknown, or weights of
        networks are missing.
    """
    return stylize_with_figures(field, capture, exemplar, config, progress, device, dump, skin)[0]


def stylize_with_figures(field: VoxelField, capture: Capture,
                         exemplar: Exemplar | Sequence[Exemplar],
                         config: StylizeConfig | None = None, progress: Progress | None = None,
                         device: str = "auto", dump: Path | None = None, skin: Skin | None = None,
                         painters: Painters | None = None) -> tuple[StyledField, dict[str, Any]]:
    """Stylise a field by one or more exemplars: `stylize`, with the figures for ``--json``.

    The field has direction-independent colors, which can be mixed again (`StyledField.mix`), and
    the same densities but for its vignette (`lfportrait.stylize.vignette`). The figures are
    per-term losses and gradient norms, networks, ``device`` (where the networks computed; painting
    and fit are on the CPU), ``vignette`` (where the bust is cut off: below, left, right),
    ``seconds``, ``notices`` on what sitter and exemplar do not share. ``painters`` are exemplars
    that were prepared before (`Session` keeps them).
    """
    config = config or StylizeConfig()
    exemplars = [exemplar] if isinstance(exemplar, Exemplar) else list(exemplar)
    if not exemplars:
        raise UserError("no style is given; name at least one painting")
    config.check()
    if capture.landmarks is None and config.needs_face:
        raise UserError("the capture has no facial landmarks; run `lfportrait calibrate` on the "
                        "photos, or use --method arf")
    check_device(device)
    start = time.perf_counter()
    figures: dict[str, Any] = {"method": config.method, "device": "cpu"}
    textures: list[SurfaceTexture] = []
    blocks = None
    sitter: Sitter | None = None
    if config.on_skin:
        sitter = Sitter(field, capture, config, skin)
        colors, textures, found = stylize_skin(sitter, exemplars, config, progress, dump,
                                                painters, device)
        labels, regions = row_labels(sitter.skin)
        if textures:
            blocks = texel_rows(sitter.skin, textures[0])
    else:
        regions = PICTURE_LABELS
        labels = np.zeros((len(field.density), len(regions)), np.uint8)
        colors, found = _by_views(field, capture, exemplars, config, progress, dump, device)
    figures.update(found)
    # That of the networks: painting and fit are on the CPU in any case.
    figures["device"] = found.get("device", found.get("refinement", {}).get("device", "cpu"))
    figures["notices"] = notices(capture, exemplars, config)
    shown = field
    if config.vignette:
        clock = time.perf_counter()
        # Kept with the skin: all previews of a head end alike, and are laid out together.
        shown, ends = (vignetted(field, capture, config.seed) if sitter is None else
                       sitter.skin.cached(("vignette", config.seed),
                                        lambda: vignetted(field, capture, config.seed)))
        figures["vignette"] = [end.name for end in ends]
        figures["seconds"]["vignette"] = round(time.perf_counter() - clock, 3)
    photo = np.clip(C0 * field.sh[:, :, 0] + 0.5, 0.0, 1.0).astype(np.float32)
    styled = StyledField.of(shown, np.stack(colors), [one.name for one in exemplars], photo,
                            labels, regions, textures, blocks)
    if config.ground and not config.preview:
        clock = time.perf_counter()
        styled.backdrop = Backdrop(*known_ground(exemplars[0], seed=config.seed),
                                   head_points(shown))
        figures["seconds"]["ground"] = round(time.perf_counter() - clock, 3)
    if config.strength != 1.0 or config.keep:
        styled = styled.mix(strength=config.strength, keep=config.keep)
    figures["seconds"]["total"] = round(time.perf_counter() - start, 3)
    return styled, figures


def _by_views(field: VoxelField, capture: Capture, exemplars: list[Exemplar],
              config: StylizeConfig, progress: Progress | None, dump: Path | None, device: str,
              ) -> tuple[list[Float32], dict[str, Any]]:
    """Colors for each exemplar by the paper's or another package's method."""
    # Here: their losses need torch, which paints of a skin do without.
    from .refinement import stylize_views

    colors, rows = [], []
    for one in exemplars:
        if config.other is not None:
            task = FieldTask(field, capture, one, config.background, config.seed, progress, dump,
                             config.transfer, device)
            painted, row = config.other.paint(task, config.parameters_of(config.other))
        else:
            painted, row = stylize_views(field, capture, one, config, progress, dump,
                                         device)
        colors.append(painted)
        rows.append(row)
    return colors, {**rows[0], **({"styles": rows} if len(rows) > 1 else {})}
