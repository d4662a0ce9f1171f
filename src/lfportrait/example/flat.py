"""The position guide of a photo: landmarks, contours, neck and body, brought onto the exemplar's.

Landmarks, hairline and outline of the head pin the face. From the front the exemplar's own neck
fits below it. A turned head lies beside its neck, though, hides one ear and shows its back, and
what the face alone asks for below and behind it is the exemplar's background. So in videos, and for
turned heads, neck and body are laid onto the exemplar's by their edges, and what is person or
background is held on its side of the exemplar's outline.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernels.example_labels import shrink_label
from .correspond import lay_body, match_regions
from .exemplar import Exemplar, face_size
from .guides import fold_inside, folded_position_guide
from .labels import LABELS, missing_labels
from .outline import EdgeMatch, signed_distances
from .regions import Regions

__all__ = ["FlatGuide"]

Float32 = NDArray[np.float32]

KEEP = 8.0
"""What is further from the outline stays on its side of the exemplar's by so much, in units."""
TURNED = 0.5
"""Heads turned this much against the exemplar (`FaceFrame.turn`) hide or show other parts."""


class FlatGuide:
    """The exemplar's side of the guide.

    Parameters
    ----------
    exemplar, regions, labels
        The painting, its regions and their soft labels, uint8 [h, w, len(LABELS)].
    unit
        Length in exemplar pixels that goes with the size of the face.
    grid
        The guide is evaluated every so many pixels, bilinear between.
    contours
        Let hairline, outline and body join the landmarks.
    """

    def __init__(self, exemplar: Exemplar, regions: Regions, labels: NDArray[np.uint8],
                 unit: float, grid: int, contours: bool) -> None:
        self.exemplar, self.regions = exemplar, regions
        self.unit, self.grid, self.contours = unit, grid, contours
        self._turn = regions.frame.turn(exemplar.landmarks)
        self._box = regions.box()
        self._body = "body" not in missing_labels(labels)
        person = np.float32(1) - _label(labels, "background")
        edges = (("background", True, EdgeMatch.of(person, 8 * unit, 6 * unit)),
                 ("hair", False, EdgeMatch.of(_label(labels, "hair"), 4 * unit, 5 * unit)))
        # Label, whether what is not it is meant, and the match; without those that have no edge.
        self._edges = [(name, invert, match) for name, invert, match in edges if match is not None]

    def turned(self, landmarks: NDArray[np.float64], regions: Regions) -> bool:
        """Whether a head is turned against the exemplar's."""
        return abs(regions.frame.turn(landmarks) - self._turn) > TURNED

    def __call__(self, cover: Float32, landmarks: NDArray[np.float64], regions: Regions,
                 labels: NDArray[np.uint8], hold: bool) -> Float32:
        """Position guide of a photo.

        Parameters
        ----------
        cover
            float32 [H, W]; what is 0 is not painted.
        landmarks
            [68, 2] in pixels.
        regions, labels
            Of the photo, and their soft labels, uint8 [H, W, len(LABELS)].
        hold
            Lay neck and body onto the exemplar's, and hold person and background on their sides.

        Returns
        -------
        float32 [H, W, 2] in exemplar pixels, inside the exemplar; NaN where not covered.
        """
        hold = hold and self.contours
        sources, targets, weights, softness = match_regions(
            landmarks, regions, self.exemplar.landmarks, self.regions, self.contours,
            foot=not (hold and self._body))
        scale, shape = self.exemplar.size / face_size(landmarks), self.exemplar.image.shape

        def meet(nodes: Float32) -> None:
            if hold:
                if self._body:
                    lay_body(nodes, self.grid, regions, self.regions)
                fold_inside(nodes, shape, self._box, nodes)
            self._meet_edges(nodes, labels, scale, hold)

        return folded_position_guide(cover, sources, targets, weights, softness, shape, self._box,
                                     self.grid, meet if self.contours else None)

    def _meet_edges(self, nodes: Float32, labels: NDArray[np.uint8], scale: float,
                    hold: bool) -> None:
        """Move the guide's nodes [h, w, 2] so that edges of regions meet, in place."""
        grid = self.grid
        small = np.empty((len(self._edges), *(-(-n // grid) for n in labels.shape[:2])), np.float32)
        for plane, (name, invert, _) in zip(small, self._edges):
            shrink_label(labels, LABELS.index(name), invert, grid, plane)
        away = signed_distances(small, [match.far(grid, scale) for _, _, match in self._edges])
        for distance, (name, _, match) in zip(away, self._edges):
            keep = KEEP * self.unit if hold and name == "background" else 0.0
            match.pull(nodes, distance * np.float32(grid), grid, scale, keep)


def _label(labels: NDArray[np.uint8], name: str) -> Float32:
    """One label of [H, W, len(LABELS)], float32 [H, W] in [0, 1]."""
    return labels[..., LABELS.index(name)].astype(np.float32) * np.float32(1 / 255)
