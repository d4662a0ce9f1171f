"""Position guide of a photo, from landmarks and contours, with matched outlines.

For a capture the surface says where in the exemplar a pixel belongs (`surface_guide`). A photo has
its landmarks, the rays to hairline and outline (`control_points`), and signed distances from the
edges of its regions (`outline`). From the front the exemplar's own neck and shoulders fit below the
face. A turned head lies beside its neck, though, hides one ear and shows its back, and what the
face alone asks for below and behind it is the exemplar's background. So in videos, and for turned
heads, neck and body are laid onto the exemplar's by their edges, and what is person or background
is held on its side of the exemplar's outline.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..labels import PICTURE_LABELS
from .exemplar import Exemplar, face_size
from .guides.control_points import lay_body, lengthen_neck, match_regions, plain_neck
from .guides.filters import grey
from .guides.outline import EdgeMatch, signed_distances
from .guides.position import fold_inside, folded_position_guide
from .guides.regions import Regions, missing_labels
from .kernels.labels import own_body, shrink_label
from .styleblit import label_words
from .turned.aside import SPACING, FaceAside

__all__ = ["FlatGuide"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

EDGES = (("background", True), ("hair", False))
"""Regions whose edges are made to meet, by label: all that is not background, and the hair."""
KEEP = 8.0
"""What is further from the outline stays on its side of the exemplar's by so much, in units."""
TURNED = 0.5
"""Heads turned this much against the exemplar (`FaceFrame.turn`) hide or show other parts."""
GRID = 4
"""The guide is evaluated every Nth pixel and bilinear between: it changes slowly."""


class FlatGuide:
    """The map from photos to one exemplar.

    Parameters
    ----------
    exemplar
        The painting.
    regions, labels
        Of the painting; labels uint8 [h, w, len(PICTURE_LABELS)].
    """

    def __init__(self, exemplar: Exemplar, regions: Regions, labels: NDArray[np.uint8]) -> None:
        self.exemplar, self.regions = exemplar, regions
        self._words = label_words(labels)
        self._box = regions.box()
        self._neck = plain_neck(grey(exemplar.image), exemplar.landmarks)
        self._turn = regions.frame.turn(exemplar.landmarks)
        self._body = "body" not in missing_labels(labels)
        self._unit = unit = exemplar.size / 50.0
        edges = [np.float32(1) - plane if invert else plane for plane, invert in (
            (_label(labels, name), invert) for name, invert in EDGES)]
        self._edges = (EdgeMatch.of(edges[0], 8 * unit, 6 * unit),
                       EdgeMatch.of(edges[1], 4 * unit, 5 * unit))

    def turned(self, landmarks: Float64, regions: Regions) -> bool:
        """Whether a head is turned against the exemplar's."""
        return abs(regions.frame.turn(landmarks) - self._turn) > TURNED

    def __call__(self, cover: Float32, landmarks: Float64, regions: Regions,
                 labels: NDArray[np.uint8], hold: bool = False,
                 aside: FaceAside | None = None) -> Float32:
        """Position guide of a photo, float32 [H, W, 2]; NaN where it is not covered.

        Parameters
        ----------
        cover
            float32 [H, W], 0 where nothing is to be painted.
        landmarks, regions, labels
            Of the photo.
        hold
            Lay neck and body onto the exemplar's, and hold person and background on their sides.
        aside
            What is seen of a face that is turned far to one side; ``landmarks`` are its own.
        """
        points = match_regions(landmarks, regions, self.exemplar.landmarks, self.regions)
        sources, targets, weights, softness = (
            points if aside is None else self._seen(aside, *points))
        scale, shape = self.exemplar.size / face_size(landmarks), self.exemplar.image.shape

        def move(nodes: Float32) -> None:
            if hold and self._body:
                lay_body(nodes, GRID, regions, self.regions)
            else:
                lengthen_neck(nodes, float(landmarks[8, 1]), shape[0], self._neck, scale, GRID)
            if hold:
                fold_inside(nodes, shape, self._box, nodes)
            self._meet(nodes, labels, scale, KEEP * self._unit if hold else 0.0)

        return folded_position_guide(cover, sources, targets, weights, softness,
                                     shape, self._box, GRID, move)

    def _seen(self, aside: FaceAside, sources: Float64, targets: Float64, weights: Float64,
              softness: Float64) -> tuple[Float64, Float64, Float64, Float64]:
        """Control points with those of what is seen of a turned face, without those hidden."""
        more = aside.in_exemplar(self.exemplar.landmarks)
        weights = weights.copy()
        weights[:68][aside.hidden] *= 1 - aside.share
        kept = weights > 0
        soft = np.full(len(more), 0.5 * SPACING * aside.pose.scale)
        return (np.concatenate([sources[kept], aside.places]),
                np.concatenate([targets[kept], more]),
                np.concatenate([weights[kept], np.full(len(more), aside.share)]),
                np.concatenate([softness[kept], soft]))

    def _meet(self, nodes: Float32, labels: NDArray[np.uint8], scale: float, keep: float) -> None:
        """Move the guide's nodes so that outlines and hairlines meet."""
        known = [(match, edge) for match, edge in zip(self._edges, EDGES) if match is not None]
        small = np.empty((len(known), *(-(-n // GRID) for n in labels.shape[:2])), np.float32)
        for plane, (_, (name, invert)) in zip(small, known):
            shrink_label(labels, PICTURE_LABELS.index(name), invert, GRID, plane)
        away = signed_distances(small, [match.far(GRID, scale) for match, _ in known])
        for distance, (match, (name, _)) in zip(away, known):
            match.pull(nodes, distance * np.float32(GRID), GRID, scale,
                       keep if name == "background" else 0.0)

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
            uint8 [H, W, len(PICTURE_LABELS)] of the photo, changed in place.
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
    """One label of [H, W, len(PICTURE_LABELS)], float32 [H, W] in [0, 1]."""
    return labels[..., PICTURE_LABELS.index(name)].astype(np.float32) * np.float32(1 / 255)
