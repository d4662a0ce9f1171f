"""Stylise a field by one or more exemplars, with notes on what sitter and exemplar differ in.

The notes are a line each: eyes, mouth, stroke size.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture import Capture
from ..device import check_device
from ..errors import UserError
from ..example import Exemplar, Skin, asked_lids, closed_words, known_ground
from ..example.worn import not_worn
from ..field import C0, Backdrop, SurfaceTexture, VoxelField, head_points
from ..labels import PICTURE_LABELS
from ..progress import Progress
from .config import FieldTask, StylizeConfig
from .mixing import StyledField
from .on_skin import Painters, Sitter, stylize_skin
from .skin import row_labels, texel_rows
from .vignette import vignetted

Points = NDArray[np.floating]

PARTED = 0.14
"""Height of the gap between the lips over the mouth's width, of a mouth that is open."""
COARSE = 100.0
"""An exemplar whose face is smaller (`face_size`, pixels) is coarse beside a display's rows."""


def _opening(points: Points, pairs: Sequence[tuple[int, int]], ends: tuple[int, int]) -> float:
    """Mean distance of pairs of landmarks over that of two ends; NaN where they are unknown."""
    width = float(np.linalg.norm(points[ends[0]] - points[ends[1]]))
    return float(np.mean([np.linalg.norm(points[a] - points[b]) for a, b in pairs])) / max(
        width, 1e-9)


def mouth_opening(points: Points) -> float:
    """Height of the gap between the lips over the mouth's width, from landmarks [68, 2 or 3]."""
    return _opening(points, ((61, 67), (62, 66), (63, 65)), (48, 54))


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
        if "lips" not in kept and (mouths[0] > PARTED) != (mouths[1] > PARTED):
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


Float32 = NDArray[np.float32]


def stylize(field: VoxelField, capture: Capture, exemplar: Exemplar | Sequence[Exemplar],
            config: StylizeConfig | None = None, progress: Progress | None = None,
            device: str = "auto", dump: Path | None = None,
            skin: Skin | None = None) -> StyledField:
    """Stylise a field by one or more exemplars: the field of `stylize_with_figures`.

    Parameters
    ----------
    field, capture
        The real radiance field, and its capture: the landmarks in space, and where the photos were
        taken from.
    exemplar
        The painting with its landmarks, or several; the field shows the first.
    config
        Parameters.
    progress
        Progress line.
    device
        Where to compute: ``"auto"``, ``"cpu"``, ``"gpu"`` or ``"gpu:NAME"`` (`lfportrait.device`).
    dump
        Folder for pictures of intermediates; None writes none.
    skin
        Of the field, where it is known already (`Skin.of`).

    Raises
    ------
    UserError
        If the capture has no landmarks, a region to keep is unknown, or weights of networks are
        missing.
    """
    return stylize_with_figures(field, capture, exemplar, config, progress, device, dump, skin)[0]


def stylize_with_figures(field: VoxelField, capture: Capture,
                         exemplar: Exemplar | Sequence[Exemplar],
                         config: StylizeConfig | None = None, progress: Progress | None = None,
                         device: str = "auto", dump: Path | None = None,
                         skin: Skin | None = None, painters: Painters | None = None,
                         ) -> tuple[StyledField, dict[str, Any]]:
    """Stylise a field by one or more exemplars.

    Parameters
    ----------
    field
        The real radiance field.
    capture
        Its capture: the landmarks in space, and where the photos were taken from.
    exemplar
        The painting with its landmarks, or several; the field shows the first.
    config
        Parameters.
    progress
        Progress line.
    device
        Where to compute: ``"auto"``, ``"cpu"``, ``"gpu"`` or ``"gpu:NAME"`` (`lfportrait.device`).
    dump
        Folder for pictures of intermediates; None writes none.
    skin
        Of the field, where it is known already (`Skin.of`, `kept_skin`).
    painters
        Exemplars that were prepared before (`Session` keeps them).

    Returns
    -------
    styled, figures
        A field with direction-independent colors, which can be mixed again (`StyledField.mix`),
        and with the same densities but for its vignette (`lfportrait.stylize.vignette`); and the
        figures for ``--json``: per-term losses and gradient norms, networks, ``device`` (where the
        networks computed; painting and fit are on the CPU), ``vignette`` (where the bust is cut
        off: below, left, right), ``seconds``, ``notices`` on what sitter and exemplar do not share.

    Raises
    ------
    UserError
        If the capture has no landmarks, a region to keep is unknown, or weights of networks are
        missing.
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
                       sitter.skin.once(("vignette", config.seed),
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
