"""Regions of a stylised head in any view, and whether the paint in them repeats itself.

A stylised field may carry labels: how far each of its lattice rows lies in each region. Rendered as
if they were colors they give the region's mask in any view, from behind as well, where no picture
of the head could be segmented. The exemplar's regions are those of its own segmentation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from lfportrait.capture import Camera
from lfportrait.example import Exemplar
from lfportrait.field import C0, VoxelField
from lfportrait.labels import PICTURE_LABELS

from .repeats import Repeat, over_exemplar, strongest_repeat
from .views import arc_cameras, face_unit

__all__ = ["RowLabels", "exemplar_regions", "region_repeats"]

Masks = dict[str, NDArray[np.bool_]]

DEGREES = (-20.0, 0.0, 20.0, 90.0, 180.0)
"""Yaws of the views: ends and middle of a display's arc, a profile, and from behind."""
LEAST_AREA = 1.0
"""Square units; in smaller regions chance alone makes high peaks."""
MARGIN = 0.05
"""Units that regions are eroded by: what lies at their borders is neither's paint."""

BODY = ("neck", "clothes")
"""Parts of what an exemplar's labels call the body."""


@dataclass(frozen=True)
class RowLabels:
    """How far the rows of a field lie in each of some regions.

    Attributes
    ----------
    weights
        uint8 [N, R]; 255 is wholly inside.
    names
        Names of the R regions, as in `lfportrait.example.PICTURE_LABELS`.
    """

    weights: NDArray[np.uint8]
    names: tuple[str, ...]

    @staticmethod
    def of(styled: VoxelField) -> RowLabels | None:
        """Those that a field carries as ``labels`` and ``regions``, or None."""
        weights, names = getattr(styled, "labels", None), getattr(styled, "regions", ())
        return None if weights is None else _with_body(weights, tuple(names))

    @staticmethod
    def joined(weights: NDArray[np.uint8], names: Sequence[str]) -> RowLabels:
        """From labels with separate parts of the body: adds the body as one region."""
        return _with_body(weights, tuple(names))

    @staticmethod
    def read(path: str | Path) -> RowLabels | None:
        """Those that lie beside the field in its file, or None."""
        with np.load(path, allow_pickle=False) as arrays:
            if not {"labels", "region_names"} <= set(arrays.files):
                return None
            return _with_body(arrays["labels"],
                              tuple(map(str, arrays["region_names"].ravel())))

    def masks(self, field: VoxelField, cameras: Camera, names: Sequence[str],
              margin: float = 0.0) -> list[Masks]:
        """Where the regions are seen in some views.

        Parameters
        ----------
        field
            A field whose rows these are.
        cameras
            V views.
        names
            Regions that are wanted; those without labels are left out.
        margin
            Pixels that a region keeps from its borders and from the head's silhouette.

        Returns
        -------
        masks
            For each view a bool [H, W] by region: pixels of the head (opacity over 0.5) that lie in
            it by more than half.
        """
        if len(self.weights) != len(field.density):
            raise ValueError(f"labels of {len(self.weights)} rows are not those of a field of "
                             f"{len(field.density)}")
        known = [name for name in names if name in self.names]
        out: list[Masks] = [{} for _ in range(len(cameras))]
        for first in range(0, len(known), 3):  # three regions are the three colors of a field
            three = known[first:first + 3]
            colors = np.zeros((len(self.weights), 3, 1), np.float32)
            for channel, name in enumerate(three):
                colors[:, channel, 0] = self.weights[:, self.names.index(name)] / np.float32(255)
            shown = field.with_sh((colors - 0.5) / C0)
            for view, masks in enumerate(out):
                shot = shown.render(cameras, view, background=0.0)
                opaque = shot.alpha > 0.5
                for channel, name in enumerate(three):
                    inside = opaque & (shot.color[..., channel] > 0.5 * shot.alpha)
                    masks[name] = _eroded(inside, margin)
        return out


def _with_body(weights: NDArray[np.uint8], names: tuple[str, ...]) -> RowLabels:
    """Labels, with the body as one region if its parts are separate."""
    parts = [names.index(name) for name in BODY if name in names]
    if "body" in names or not parts:
        return RowLabels(weights, names)
    body = np.minimum(weights[:, parts].sum(axis=1, dtype=np.int64), 255).astype(np.uint8)
    return RowLabels(np.column_stack([weights, body]), (*names, "body"))


def _eroded(mask: NDArray[np.bool_], margin: float) -> NDArray[np.bool_]:
    """A mask without what is nearer than ``margin`` pixels to its border."""
    if margin <= 0 or mask.all():
        return mask
    return np.asarray(ndimage.distance_transform_edt(mask) > margin, bool)


def exemplar_regions(exemplar: Exemplar, unit: float, names: Sequence[str],
                     margin: float = 0.0) -> tuple[NDArray[np.uint8], Masks]:
    """An exemplar resized to a face of ``unit`` pixels, and its regions.

    Parameters
    ----------
    exemplar
        The painting.
    unit
        Wanted size of its face in pixels (`Exemplar.size`).
    names
        Regions of `lfportrait.example.PICTURE_LABELS`; others are left out.
    margin
        Pixels that a region keeps from its borders.

    Returns
    -------
    picture
        uint8 [h, w, 3].
    masks
        bool [h, w] by region.
    """
    labels = exemplar.regions().labels()
    height, width = exemplar.image.shape[:2]
    scale = unit / exemplar.size
    size = max(round(width * scale), 1), max(round(height * scale), 1)

    def resized(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.LANCZOS))

    return resized(exemplar.image), {
        name: _eroded(resized(np.ascontiguousarray(labels[..., PICTURE_LABELS.index(name)])) > 127,
                      margin)
        for name in names if name in PICTURE_LABELS}


def region_repeats(styled: VoxelField, exemplar: Exemplar, labels: RowLabels, *,
                   names: Sequence[str] = ("hair", "body"), degrees: Sequence[float] = DEGREES,
                   size: int = 768, landmarks: NDArray[np.floating] | None = None,
                   ) -> dict[str, dict[str, Any]]:
    """Repetition of paint in a stylised field, per region.

    Parameters
    ----------
    styled
        The stylised field.
    exemplar
        Its painting.
    labels
        Of the field's rows.
    names
        Regions to measure; ``body`` is neck, shoulders and clothes.
    degrees
        Yaws of the views.
    size
        Width and height of the views in pixels.
    landmarks
        [68, 3] in space, for the size of the face; see `face_unit`.

    Returns
    -------
    figures
        By region: ``views`` (the peak of `strongest_repeat` by yaw), ``exemplar`` (its own peak at
        the same scale), ``chance`` (of the worst view) and ``ratio``, the worst view's peak over
        that of the exemplar (`over_exemplar`). NaN where a view or the exemplar shows less than
        `LEAST_AREA` of the region; the ratio is then over chance alone.
    """
    unit = face_unit(styled, size, landmarks)
    cameras = arc_cameras(styled, degrees, size)
    seen = labels.masks(styled, cameras, names, MARGIN * unit)
    painting, theirs = exemplar_regions(exemplar, unit, names, MARGIN * unit)
    shots = [np.clip(styled.render(cameras, view).color, 0, 1) for view in range(len(cameras))]
    figures = {}
    for name in (name for name in names if name in labels.names):
        ours = [_repeat(shot, masks[name], unit) for shot, masks in zip(shots, seen)]
        own = _repeat(painting, theirs.get(name), unit)
        # An exemplar without this material sets no measure but chance.
        measure = Repeat(0.0, (0, 0), 1.0) if np.isnan(own.peak) else own
        ratios = np.array([over_exemplar(one, measure) for one in ours])
        worst = int(np.argmax(np.nan_to_num(ratios, nan=-1.0)))
        figures[name] = {"views": {f"{yaw:g}": one.peak for yaw, one in zip(degrees, ours)},
                         "exemplar": own.peak, "chance": ours[worst].chance,
                         "ratio": float(ratios[worst])}
    return figures


def _repeat(picture: NDArray[Any], mask: NDArray[np.bool_] | None, unit: float) -> Repeat:
    """The strongest repeat of a region that is large enough."""
    if mask is None or mask.sum() < LEAST_AREA * unit ** 2:
        return Repeat(float("nan"), (0, 0), float("nan"))
    return strongest_repeat(picture, mask, unit)
