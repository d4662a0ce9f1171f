"""People and paintings that are measured, prepared once, and all figures of a pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfportrait.example import Exemplar, Regions, photo_regions

from ..likeness import Detector, landmark_error
from .forehead import Tones, forehead_found, tones_of
from .gaze import gaze_found
from .mouth import corners_found, painters_corners
from .seams import face_seams, seam_found

__all__ = ["PreparedPainting", "Sitter", "landmarks_found", "people_found"]

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Sitter:
    """Real views of a person.

    Attributes
    ----------
    views
        uint8 [H, W, 3] each; the first one is frontal.
    landmarks
        [68, 2] pixels found in each, or None.
    regions
        Of the first view.
    arc
        Landmarks found in the views from -45 to 45 degrees (`landmarks_kept`); none for a photo.
    """

    views: Sequence[Picture]
    landmarks: Sequence[NDArray[np.float64] | None]
    regions: Regions
    arc: Sequence[NDArray[np.float64] | None] = ()

    @staticmethod
    def of(views: Sequence[Picture], detect: Detector, arc: Sequence[Picture] = (),
           ) -> Sitter | None:
        """A person in these views, or None if the first one shows no face."""
        found = [detect(view) for view in views]
        if found[0] is None:
            return None
        # As photos are painted: with a fringe, and without a scalp in the shade as hair.
        return Sitter(views, found, photo_regions(views[0], found[0]),
                      [detect(view) for view in arc])


@dataclass(frozen=True)
class PreparedPainting:
    """What is known of a painting.

    Attributes
    ----------
    tones
        Of its skin, and of all else.
    seam
        Its own strongest straight step.
    corner, uneven
        Contrast of its mouth's corner, and how unlike both are (`painters_corners`).
    """

    tones: Tones
    seam: float
    corner: float
    uneven: float

    @staticmethod
    def of(exemplar: Exemplar) -> PreparedPainting:
        """Prepare a painting."""
        image, points = exemplar.image, exemplar.landmarks
        return PreparedPainting(tones_of(exemplar), float(face_seams(image, points).max()),
                                *painters_corners(image, points))


def landmarks_found(painted: Sequence[Picture],
                    wanted: Sequence[NDArray[np.floating] | None], detect: Detector,
                    ) -> tuple[list[float], list[float]]:
    """Landmark errors of painted views over the distance of the outer eye corners.

    Parameters
    ----------
    painted
        uint8 [H, W, 3] each.
    wanted
        [68, 2] found in the real view of each; None where nothing was.
    detect
        Picture -> landmarks [68, 2] or None.

    Returns
    -------
    whole, inner
        By view, of all 68 and of the 51 without the jaw (`landmark_error`); NaN where the real
        view shows no face, infinite where only the painted one shows none.
    """
    whole, inner = [], []
    for image, points in zip(painted, wanted, strict=True):
        found = None if points is None else detect(image)
        if points is None or found is None:
            missing = float("nan") if points is None else float("inf")
            whole.append(missing)
            inner.append(missing)
            continue
        eyes = max(float(np.linalg.norm(points[36] - points[45])), 1e-9)
        whole.append(float(np.linalg.norm(found - points, axis=1).mean()) / eyes)
        inner.append(landmark_error(found, points))
    return whole, inner


def _mean(values: Sequence[float]) -> float:
    """Mean of those that are known; NaN if none is."""
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")


def people_found(painted: Sequence[Picture], sitter: Sitter, painting: PreparedPainting,
                 detect: Detector, arc: Sequence[Picture] = ()) -> dict[str, Any]:
    """All figures of one person in one painter's manner.

    Parameters
    ----------
    painted
        The sitter's views painted, uint8 [H, W, 3] each.
    sitter, painting
        Who was painted, and by which painting.
    detect
        Picture -> landmarks [68, 2] or None.
    arc
        Painted views from -45 to 45 degrees, if the sitter has those.

    Returns
    -------
    figures
        ``landmarks`` (all 68, mean over the views; ``by_view``), ``inner`` (51, without the jaw);
        ``arc`` (the 51, from -45 to 45 degrees, as in `landmarks_kept`); ``lost``, share of the
        views in which no face is found any more; those of `gaze_found`, `forehead_found`,
        `seam_found` (with ``seam_painting``, the painting's own) and `corners_found`, all of the
        frontal view.
    """
    whole, inner = landmarks_found(painted, sitter.landmarks, detect)
    _, around = landmarks_found(arc, sitter.arc[:len(arc)], detect)
    tried = [error for error in (*whole, *around) if not np.isnan(error)]
    points = sitter.landmarks[0]
    assert points is not None
    pair = painted[0], sitter.views[0], points
    return {"landmarks": _mean(whole), "inner": _mean(inner), "by_view": whole,
            "arc": _mean(around), "lost": float(np.mean(np.isinf(tried))),
            **gaze_found(*pair), **forehead_found(*pair, painting.tones, sitter.regions),
            **seam_found(*pair), "seam_painting": painting.seam,
            **corners_found(painted[0], points, painting.corner, painting.uneven)}
