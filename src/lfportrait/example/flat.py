"""Position guide of a photo: from landmarks and contours, with outlines that meet.

For a capture the surface says where in the exemplar a pixel belongs (`surface`); a photo has its
landmarks, the rays to hairline and outline (`correspond`), and signed distances from the edges of
its regions (`outline`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernels.example_labels import own_body, shrink_label
from .correspond import lengthen_neck, match_regions, plain_neck
from .exemplar import Exemplar, face_size
from .guides import folded_position_guide, grey
from .labels import LABELS
from .outline import EdgeMatch, signed_distances
from .regions import Regions
from .styleblit import label_words

__all__ = ["FlatGuide"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

EDGES = (("background", True), ("hair", False))
"""Regions whose edges are made to meet, by label: all that is not background, and the hair."""


class FlatGuide:
    """The map from photos to one exemplar.

    Parameters
    ----------
    exemplar
        The painting.
    regions, labels
        Of the painting; labels uint8 [h, w, len(LABELS)].
    """

    def __init__(self, exemplar: Exemplar, regions: Regions, labels: NDArray[np.uint8]) -> None:
        self.exemplar, self.regions = exemplar, regions
        self._words = label_words(labels)
        self._box = regions.box()
        self._neck = plain_neck(grey(exemplar.image), exemplar.landmarks)
        unit = exemplar.size / 50.0
        edges = [np.float32(1) - plane if invert else plane for plane, invert in (
            (_label(labels, name), invert) for name, invert in EDGES)]
        self._edges = (EdgeMatch.of(edges[0], 8 * unit, 6 * unit),
                       EdgeMatch.of(edges[1], 4 * unit, 5 * unit))

    def __call__(self, cover: Float32, landmarks: Float64, regions: Regions,
                 labels: NDArray[np.uint8], grid: int, contours: bool) -> Float32:
        """Position guide of a photo, float32 [H, W, 2]; NaN where it is not covered.

        Parameters
        ----------
        cover
            float32 [H, W], 0 where nothing is to be painted.
        landmarks, regions, labels
            Of the photo.
        grid
            The guide is evaluated every so many pixels.
        contours
            Whether hairline and outline join the landmarks.
        """
        sources, targets, weights, softness = match_regions(
            landmarks, regions, self.exemplar.landmarks, self.regions, contours)
        scale = self.exemplar.size / face_size(landmarks)

        def move(nodes: Float32) -> None:
            lengthen_neck(nodes, float(landmarks[8, 1]), self.exemplar.image.shape[0], self._neck,
                          scale, grid)
            self._meet(nodes, labels, scale, grid)

        return folded_position_guide(cover, sources, targets, weights, softness,
                                     self.exemplar.image.shape, self._box, grid,
                                     move if contours else None)

    def _meet(self, nodes: Float32, labels: NDArray[np.uint8], scale: float, grid: int) -> None:
        """Move the guide's nodes so that outlines and hairlines meet."""
        known = [(match, edge) for match, edge in zip(self._edges, EDGES) if match is not None]
        small = np.empty((len(known), *(-(-n // grid) for n in labels.shape[:2])), np.float32)
        for plane, (_, (name, invert)) in zip(small, known):
            shrink_label(labels, LABELS.index(name), invert, grid, plane)
        away = signed_distances(small, [match.far(grid, scale) for match, _ in known])
        for distance, (match, _) in zip(away, known):
            match.pull(nodes, distance * np.float32(grid), grid, scale)

    def own_shoulders(self, position: Float32, landmarks: Float64, labels: NDArray[np.uint8],
                      person: Float32) -> Float32:
        """Let the exemplar's body have its own outline below the chin.

        Shoulders differ too much to be made to meet: where the photo's labels insist on a body
        that the exemplar does not have at the guided place, chunks of it stand out as ledges.

        Parameters
        ----------
        position
            float32 [H, W, 2], the guide.
        landmarks
            [68, 2] of the photo.
        labels
            uint8 [H, W, len(LABELS)] of the photo, changed in place.
        person
            float32 [H, W].

        Returns
        -------
        ``person`` with the exemplar's body, another array.
        """
        person = person.copy()
        own_body(position, self._words, max(int(landmarks[8, 1]), 0), label_words(labels), person)
        return person


def _label(labels: NDArray[np.uint8], name: str) -> Float32:
    """One label of [H, W, len(LABELS)], float32 [H, W] in [0, 1]."""
    return labels[..., LABELS.index(name)].astype(np.float32) * np.float32(1 / 255)
