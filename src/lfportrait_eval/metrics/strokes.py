"""Stability of strokes: views stylised separately, warped into each other by depth.

For views one degree apart the same exemplar is transferred to both: rendered from a field that was
stylised by it, looked up on the skin that was painted once for all views, with guides and seeds
anchored on the surface, and with guides of each view alone (the paper's way). One stylised view is
warped into the other by the field's depth (`consistency.warp`); what is left is the strokes' own
motion, and what the resampling of fine strokes costs. So the errors are also taken of views blurred
by one pixel, where the latter is small. Errors are over the contrast of the stylised view, so that
flat colors gain nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.example import (
    Exemplar,
    Painting,
    Skin,
    SkinPainter,
    SurfaceGuide,
    Transfer,
    TransferConfig,
)
from lfportrait.example.skin import PIXELS
from lfportrait.field import Rendering, VoxelField

from .consistency import pair_error, warp
from .likeness import Detector
from .views import head_cameras

__all__ = ["strokes_stick", "strokes_table"]

WAYS = ("rendered", "skin", "anchored", "per_view", "detected")
"""The stylised field, filtered as its renderings are; painted once on the surface, one look-up a
pixel; guides on the surface; of each view from the projected landmarks; from newly detected
landmarks."""


def strokes_stick(field: VoxelField, landmarks: NDArray[np.floating], exemplar: Exemplar, *,
                  angles: Sequence[float] = (0.0, 15.0, 30.0, 45.0), gap: float = 1.0,
                  size: int = 1024, distance: float = 4.4, detect: Detector | None = None,
                  config: TransferConfig | None = None, styled: VoxelField | None = None,
                  pixels: float = PIXELS) -> dict[str, Any]:
    """Error between neighbouring stylised views.

    Parameters
    ----------
    field
        The head, in the portrait frame.
    landmarks
        [68, 3] in space.
    exemplar
        The painting.
    angles
        Directions of the pairs' first views, in degrees from the front.
    gap
        Degrees between the views of a pair.
    size
        Side of the views in pixels.
    distance
        Of the cameras from the middle of the head, in the field's units.
    detect
        Picture -> landmarks [68, 2] or None: also measures landmarks detected in each view.
    config
        Of the transfer.
    styled
        The field stylised by the exemplar: its renderings are measured, too.
    pixels
        Of the skin, per world unit.

    Returns
    -------
    figures
        ``skin``, ``anchored``, ``per_view`` and, with ``detect``, ``detected``, with ``styled``,
        ``rendered``: contrast-normalised errors by angle, their ``mean``, and ``blurred``, the mean
        for views blurred by a pixel; ``floor``: those of the photoreal views; ``ratio`` and
        ``ratio_blurred``: mean anchored over mean per-view error, ``skin_ratio`` and
        ``rendered_ratio`` those of the skin and of the renderings. NaN where no face is detected.
    """
    prepared = Transfer(exemplar, config)
    guide = SurfaceGuide(landmarks, exemplar, prepared.regions)
    skin = Skin.of(field, landmarks, pixels=pixels, networks=False)
    painting = SkinPainter(exemplar, transfer=config).paint(skin)
    left_out = {way for way, given in (("detected", detect), ("rendered", styled)) if given is None}
    rows: dict[str, list[tuple[float, float]]] = {way: [] for way in (*WAYS, "floor")
                                                  if way not in left_out}
    for angle in angles:
        cameras = head_cameras(landmarks, (angle, angle + gap), size, distance)
        shots = [field.render(cameras, view) for view in range(2)]
        for way, values in rows.items():
            shown = styled if way == "rendered" else field if way == "floor" else None
            pictures = [np.clip(shown.render(cameras, view).color, 0, 1) if shown is not None else
                        _looked_up(painting, shot, cameras, view) if way == "skin" else
                        _stylised(way, prepared, guide, shot, cameras, view, landmarks, detect)
                        for view, shot in enumerate(shots)]
            values.append((_error(pictures, shots, cameras),
                           _error([_blurred(picture) for picture in pictures], shots, cameras)))
    figures: dict[str, Any] = {}
    for way, values in rows.items():
        sharp, blurred = zip(*values)
        figures[way] = {**{f"{angle:g}": value for angle, value in zip(angles, sharp)},
                        "mean": _mean(sharp), "blurred": _mean(blurred)}
    anchored, per_view = figures["anchored"], figures["per_view"]
    ratios = {f"{way}_ratio": figures[way]["mean"] / per_view["mean"]
              for way in ("skin", "rendered") if way in figures}
    return {**figures, "ratio": anchored["mean"] / per_view["mean"],
            "ratio_blurred": anchored["blurred"] / per_view["blurred"], **ratios}


def _looked_up(painting: Painting, shot: Rendering, cameras: Camera, view: int,
               ) -> NDArray[np.float32]:
    """What a view shows of a painted skin, float32 [H, W, 3]; the photo where it shows none."""
    points = shot.points(cameras, view)
    inside = np.isfinite(points[..., 0])
    places, _ = painting.skin.atlas.locate(points[inside].astype(np.float32), 0.03, 0.05)
    picture = np.clip(shot.color, 0, 1).astype(np.float32)
    found = painting.at(places)
    picture[inside] = np.where(np.isfinite(found), found, picture[inside])
    return picture


def _blurred(picture: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
    return None if picture is None else np.asarray(
        ndimage.gaussian_filter(picture, (1.0, 1.0, 0.0)), np.float32)


def _stylised(way: str, prepared: Transfer, guide: SurfaceGuide, shot: Rendering, cameras: Camera,
              view: int, landmarks: NDArray[np.floating], detect: Detector | None,
              ) -> NDArray[np.float32] | None:
    """One view stylised, float32 [H, W, 3]; None if no face is found."""
    color = np.clip(shot.color, 0, 1)
    pixels = cameras.project(np.asarray(landmarks, np.float64))[0][view]
    if way == "anchored":
        position, anchor = guide(shot.points(cameras, view))
        return prepared.apply(color, pixels, position=position, seeds_anchor=anchor,
                              mask=shot.alpha).image
    if way == "detected":
        assert detect is not None
        found = detect(np.asarray(color * 255 + 0.5, np.uint8))
        if found is None:
            return None
        pixels = found
    return prepared.apply(color, pixels, mask=shot.alpha).image


def _error(pictures: Sequence[NDArray[np.float32] | None], shots: Sequence[Rendering],
           cameras: Camera) -> float:
    """Contrast-normalised error of the second view warped into the first."""
    first, second = pictures
    if first is None or second is None:
        return float("nan")
    warped, valid = warp(second, cameras, 1, 0, shots[1].depth, shots[0].depth)
    return pair_error(first, warped, valid)[1]


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")


def strokes_table(figures: dict[str, dict[str, Any]]) -> str:
    """Figures of `strokes_stick` by style, a line each: means over the angles."""
    unknown = {"mean": float("nan")}
    lines = [f"{'style':<16}{'rendered':>10}{'skin':>8}{'anchored':>10}{'per view':>10}"
             f"{'detected':>10}{'photo':>8}{'ratio':>8}{'blurred':>10}{'skin':>8}{'rendered':>10}"]
    for style, row in figures.items():
        rendered, detected = (row.get(way, unknown)["mean"] for way in ("rendered", "detected"))
        lines.append(f"{style:<16}{rendered:>10.3f}{row['skin']['mean']:>8.3f}"
                     f"{row['anchored']['mean']:>10.3f}{row['per_view']['mean']:>10.3f}"
                     f"{detected:>10.3f}{row['floor']['mean']:>8.3f}{row['ratio']:>8.2f}"
                     f"{row['ratio_blurred']:>10.2f}{row['skin_ratio']:>8.2f}"
                     f"{row.get('rendered_ratio', float('nan')):>10.3f}")
    return "\n".join(lines)
